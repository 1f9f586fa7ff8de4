//! Units of lengths of data that share a scene, and what they come to for where it lies.

use crate::heights::model::units;
use crate::import;
use crate::look::{DataKind, Member};
use crate::model::{ReadMethod, Unit};
use crate::picture::PictureError;
use crate::picture::placement::FieldPlacement;
use crate::store::{PageFile, RunFile};
use std::path::{Path, PathBuf};

/// Where a field lies that has lengths of its own.
pub(super) fn placement_of(member: &Member, own: &Unit, scene: &Unit) -> FieldPlacement {
    let scale = member.scale.or_else(|| ratio(own, scene)).unwrap_or(1.0);
    // A ratio of units that are the same may differ from 1 by rounding.
    let scale = if (scale - 1.0).abs() < 1e-12 { 1.0 } else { scale };
    FieldPlacement { offset: member.offset, scale }
}

/// Says of particles how long their lengths are in a world of something else, where both units are known and nobody has said it.
pub(super) fn in_lengths_of(
    unit: &Unit,
    particles: &mut [Member],
    read: ReadMethod,
    page_file: &mut dyn FnMut(&Path) -> Result<PathBuf, PictureError>,
) -> Result<(), PictureError> {
    for member in particles.iter_mut().filter(|member| member.scale.is_none()) {
        let own = unit_of(&member.path, read, page_file)?;
        member.scale = ratio(&own, unit).filter(|ratio| (ratio - 1.0).abs() > 1e-12);
    }
    Ok(())
}

/// How many of another unit one is, where both are lengths.
fn ratio(own: &Unit, other: &Unit) -> Option<f64> {
    let metres = |unit: &Unit| units::metres(unit).or_else(|| unit.ratio(&Unit::new("m")));
    metres(own).zip(metres(other)).map(|(own, other)| own / other).or_else(|| own.ratio(other))
}

/// The unit of a dataset's lengths.
fn unit_of(
    path: &Path,
    read: ReadMethod,
    page_file: &mut dyn FnMut(&Path) -> Result<PathBuf, PictureError>,
) -> Result<Unit, PictureError> {
    if matches!(DataKind::of(path), Ok(DataKind::Source)) {
        return Ok(import::open(path)?.description().length_unit.clone());
    }
    let path = page_file(path)?;
    Ok(match DataKind::of_particles(&path)? {
        DataKind::Run => RunFile::open(&path, read)?.directory().length_unit.clone(),
        _ => PageFile::open_with(&path, read)?.metadata().length_unit.clone(),
    })
}
