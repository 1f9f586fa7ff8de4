//! What datasets hold, as JSON.

use super::Failure;
use crate::heights::OpenHeights;
use crate::heights::store::HeightFile;
use crate::import::{GridOptions, find_source, open_grid};
use crate::look::{DataKind, Member, MemberKind, OpenData};
use crate::mode::Mode;
use crate::model::{Bounds, Grid, Moment, ReadMethod};
use crate::modes::{self, surface};
use crate::picture::field::attributes_of;
use crate::picture::{PictureError, Reporter};
use crate::store::{AttributeInfo, FamilyMetadata, GridFile};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// What datasets hold together. `page_file` turns sources of particles into page files.
///
/// # Errors
/// When they cannot be read or built.
pub fn about(
    members: &[Member],
    page_file: impl FnMut(&Path) -> Result<PathBuf, PictureError>,
    reporter: &dyn Reporter,
) -> Result<Value, Failure> {
    match members {
        [] => Err("open: found no path, expected at least one".into()),
        all if all.iter().all(|member| member.kind() == MemberKind::Particles) => {
            of_particles(all, page_file, reporter)
        }
        [only] if only.is_in_place() && only.kind() == MemberKind::Heights => of_heights(only),
        [only] if only.is_in_place() => of_field(&only.path),
        _ => Ok(json!({ "kind": "mixed", "unit": "", "bounds": null, "modes": [], "families": [] })),
    }
}

fn of_particles(
    members: &[Member],
    page_file: impl FnMut(&Path) -> Result<PathBuf, PictureError>,
    reporter: &dyn Reporter,
) -> Result<Value, Failure> {
    let opened = OpenData::open(members, ReadMethod::default(), page_file)?;
    let (file, notes) = opened.at(Moment::default())?;
    notes.into_iter().for_each(|note| reporter.tell(note));
    let metadata = file.metadata();
    let provenance = &metadata.provenance;
    // Paths are those of a run's tracks.
    let has_paths = opened.following().is_some();
    Ok(json!({
        "kind": if opened.run().is_some() { "run" } else { "particles" },
        "unit": metadata.length_unit,
        "mass_unit": metadata.mass_unit,
        "bounds": corners(metadata.bounds()),
        "count": metadata.particles(),
        "time": provenance.time,
        "redshift": provenance.redshift,
        "box_size": provenance.box_size,
        "steps": opened.run().map(|run| run.times().times.clone()),
        "notes": provenance.notes,
        "modes": modes_that(|mode| mode.takes_particles() && (has_paths || !mode.is_of_paths())),
        "families": metadata.families.iter().map(family).collect::<Vec<_>>(),
    }))
}

fn family(family: &FamilyMetadata) -> Value {
    let fields = family.quantities.iter().chain(&family.attributes).map(|one| field(one, family.count));
    json!({
        "name": family.name,
        "count": family.count,
        "mass": family.mass,
        "bounds": corners(family.bounds),
        "fields": fields.collect::<Vec<_>>(),
    })
}

/// A field of a family of so many particles.
fn field(field: &AttributeInfo, count: u64) -> Value {
    // Of values none of which is finite there are no ends, and the zeros that stand for them would be numbers like others.
    let known = |value: f64| (field.missing < count).then_some(value);
    let histogram = known(0.0).map(|_| {
        json!({
            "logarithmic": field.histogram.logarithmic,
            "min": field.histogram.min,
            "max": field.histogram.max,
            "counts": field.histogram.counts,
        })
    });
    json!({
        "name": field.name,
        "unit": field.unit,
        "min": known(field.min),
        "max": known(field.max),
        "mean": known(field.mean),
        "missing": field.missing,
        "histogram": histogram,
    })
}

/// The names of modes that draw something, by the processor.
fn modes_that(draw: impl Fn(&Mode) -> bool) -> Vec<&'static str> {
    let drawn = |&mode: &&'static Mode| mode.technique.on_processor() && draw(mode);
    modes::all().into_iter().filter(drawn).map(|mode| mode.name).collect()
}

fn corners(bounds: Bounds) -> Option<[[f64; 3]; 2]> {
    (!bounds.is_empty()).then(|| [bounds.min.to_array(), bounds.max.to_array()])
}

/// An image or a volume: one family of all samples, whose channels are its fields. Their ranges are not known without reading all of it.
fn of_field(path: &Path) -> Result<Value, Failure> {
    let (grid, source): (Grid, _) = match DataKind::of(path)? {
        DataKind::Grid => {
            let file = GridFile::open(path, ReadMethod::default())?;
            let about = file.about();
            (about.grid.clone(), source_of(path, &about.source, about.source_bytes))
        }
        _ => (open_grid(path, &GridOptions::default())?.grid().clone(), None),
    };
    let count = grid.shape.iter().fold(1_u64, |count, side| count.saturating_mul(*side));
    let channels = grid.channels.iter().map(|channel| json!({ "name": channel.name, "unit": channel.unit }));
    Ok(json!({
        "kind": grid.kind(),
        "source": source,
        "unit": grid.length_unit,
        "bounds": corners(grid.bounds()),
        "count": count,
        "shape": &grid.shape[..grid.dimensions.min(3)],
        "modes": modes_that(|mode| mode.takes_fields_of(grid.dimensions)),
        "attributes": attributes_of(&grid),
        "families": [{
            "name": grid.kind(),
            "count": count,
            "bounds": corners(grid.bounds()),
            "fields": channels.collect::<Vec<_>>(),
        }],
    }))
}

/// The source that a built file was made of, where it is there.
fn source_of(built: &Path, named: &Path, bytes: u64) -> Option<String> {
    find_source(named, built, bytes).map(|source| source.display().to_string())
}

/// Measured heights: one family of all samples with one field.
fn of_heights(member: &Member) -> Result<Value, Failure> {
    let path = &*member.path;
    let source = match DataKind::of(path)? {
        DataKind::Heights => {
            let file = HeightFile::open(path, ReadMethod::default())?;
            source_of(path, &file.about().source, file.about().source_bytes)
        }
        _ => None,
    };
    let found = OpenHeights::for_pictures(path, &member.said.options(ReadMethod::default()))?.0.summary()?;
    let ends = [0, 1].map(|axis| {
        let last = [found.columns, found.rows][axis].saturating_sub(1) as f64;
        let (first, other) = (found.origin[axis], found.origin[axis] + last * found.spacing[axis]);
        [first.min(other), first.max(other)]
    });
    let bounds = [[ends[0][0], ends[1][0], found.min], [ends[0][1], ends[1][1], found.max]];
    let planes = found.planes.iter().filter(|plane| plane.photo.is_none()).map(|plane| plane.name.as_str());
    let is_colored = ["red", "green", "blue"].iter().all(|color| planes.clone().any(|plane| plane == *color));
    let has_photo = member.said.texture.is_some() || found.planes.iter().any(|plane| plane.photo.is_some());
    let textures = (has_photo || is_colored).then_some("texture");
    let differences = member.said.before.as_ref().map(|_| "difference");
    Ok(json!({
        "kind": "heights",
        "source": source,
        "unit": found.xy_unit,
        "bounds": bounds,
        "count": found.samples,
        "shape": [found.columns, found.rows],
        "notes": found.notes,
        "modes": modes_that(Mode::takes_surfaces),
        "attributes": surface::ATTRIBUTES.into_iter().chain(differences).chain(textures).chain(planes).collect::<Vec<_>>(),
        "families": [{
            "name": "heights",
            "count": found.valid,
            "bounds": bounds,
            "fields": [{
                "name": "height",
                "unit": found.height_unit,
                "min": found.min,
                "max": found.max,
                "mean": found.mean,
                "missing": found.samples - found.valid,
            }],
        }],
    }))
}
