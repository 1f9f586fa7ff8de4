//! Source particles at their full precision, as a tree.

use super::error::PictureError;
use super::session::Reporter;
use crate::explore::data::{open_source, source_path};
use crate::import::{AttributeChoice, LoadOptions, derivable, load_source, open};
use crate::look::{DataKind, LookPatch, Member};
use crate::model::{Bounds, Dataset, FamilyName, Moment, ReadMethod, When};
use crate::store::{PageFile, RunFile};
use crate::view::frame;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// What is loaded of sources.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    /// The one family that is drawn; what members say where it is `None`.
    pub family: Option<FamilyName>,
    /// Attributes.
    pub attributes: AttributeChoice,
    /// The moment of runs; the beginning where it is `None`.
    pub time: Option<When>,
}

impl Wanted {
    /// What these looks need.
    pub fn of<'a>(looks: impl IntoIterator<Item = &'a LookPatch>, family: Option<FamilyName>) -> Wanted {
        let mut time = None;
        let looks = looks.into_iter().inspect(|look| time = time.or(look.time));
        let both = |all: AttributeChoice, own: AttributeChoice| match (all, own) {
            (all, own) if all == own => all,
            (AttributeChoice::Named(all), AttributeChoice::Named(own)) => AttributeChoice::Named([all, own].concat()),
            _ => AttributeChoice::All,
        };
        let attributes = looks.map(attributes_of).reduce(both).unwrap_or_default();
        Wanted { family, attributes, time }
    }
}

/// The attributes that a look needs.
fn attributes_of(look: &LookPatch) -> AttributeChoice {
    let fields = look.mode_of_settings().technique.fields(&look.settings);
    let attribute = look.attribute_name();
    if attribute.is_none() && fields.is_empty() {
        return AttributeChoice::Usual;
    }
    let weights = look.mode.iter().flat_map(|mode| mode.weight_attributes).copied();
    let own = ["mass", "density", "smoothing-length"];
    let fields = fields.iter().map(String::as_str);
    let named = attribute.into_iter().chain(weights).chain(fields).filter(|name| !own.contains(name));
    match named.map(str::to_owned).collect::<Vec<_>>() {
        named if named.is_empty() => AttributeChoice::Usual,
        named => AttributeChoice::Named(named),
    }
}

/// The particles of members, each where it lies: those of the source, or of the one that a page file was built from. With the
/// path of the first source.
///
/// # Errors
/// When a source cannot be read or is not there any more.
pub fn particles(
    members: &[Member],
    wanted: &Wanted,
    reporter: &dyn Reporter,
) -> Result<(PathBuf, Dataset), PictureError> {
    let Some((first, others)) = members.split_first() else { return Err(PictureError::Asked("no data".into())) };
    let (path, mut whole) = load_one(first, wanted, reporter)?;
    let units = (whole.length_unit.clone(), whole.mass_unit.clone());
    let place = |member: &Member, dataset: &mut Dataset| {
        let placement = member.placement((&dataset.length_unit, &dataset.mass_unit), (&units.0, &units.1));
        placement.place(dataset);
        placement.is_here()
    };
    let mut is_here = place(first, &mut whole);
    for member in others {
        let (_, mut next) = load_one(member, wanted, reporter)?;
        is_here &= place(member, &mut next) && next.provenance.box_size == whole.provenance.box_size;
        whole.families.append(&mut next.families);
        whole.skipped.append(&mut next.skipped);
    }
    whole.provenance.box_size = whole.provenance.box_size.filter(|_| is_here);
    Ok((path, whole))
}

fn load_one(member: &Member, wanted: &Wanted, reporter: &dyn Reporter) -> Result<(PathBuf, Dataset), PictureError> {
    let source = source_of(&member.path, wanted.time, reporter)?;
    let opened = open(&source)?;
    // A page file may have been built with attributes that follow from velocities.
    let mut derive = member.said.derive.clone();
    derive.extend(derivable(opened.description(), &wanted.attributes));
    let options = LoadOptions {
        families: wanted.family.map_or_else(|| member.families.clone().unwrap_or_default(), |family| vec![family]),
        attributes: wanted.attributes.clone(),
        derive,
        ..LoadOptions::default()
    };
    let dataset = load_source(opened.as_ref(), &options, &*reporter.progress())?;
    Ok((source, dataset))
}

/// The source itself, or the one that a page file, or the step of a run, was built from, if it is still there. Between steps it is the one
/// before, which is told.
fn source_of(path: &Path, time: Option<When>, reporter: &dyn Reporter) -> Result<PathBuf, PictureError> {
    let file = match DataKind::of(path).map_err(|error| PictureError::Asked(error.to_string()))? {
        DataKind::Source => return Ok(path.to_owned()),
        DataKind::Pages => PageFile::open(path)?,
        DataKind::Heights => return Err(PictureError::of(path, "heights, expected particles")),
        DataKind::Grid => return Err(PictureError::of(path, "an image or a volume, expected particles")),
        DataKind::Run => {
            let run = RunFile::open(path, ReadMethod::default())?;
            let moment = time.map_or(Ok(Moment::default()), |when| run.moment(when))?;
            if moment.u > 0.0 {
                let at = run.times().times[moment.step];
                let what = format!("between steps: what is drawn is of step {}, at {at}", moment.step);
                reporter.tell(format!("{}: {what}", path.display()));
            }
            run.still(moment.step)?
        }
    };
    let found = source_path(&file).ok_or_else(|| {
        let source = file.metadata().provenance.path.display();
        let why = format!("--exact draws the source {source}, which is not there any more; name the source instead");
        PictureError::of(path, why)
    })?;
    // Another file of its name is of another size.
    open_source(&found, &file)?;
    Ok(found)
}

/// The box that a picture of all these particles is framed by.
pub fn framed(dataset: &Dataset) -> Bounds {
    let positions = dataset.families.iter().flat_map(|family| &family.positions);
    let samples: Vec<(DVec3, f64)> = positions.map(|&position| (DVec3::from_array(position), 1.0)).collect();
    let lengths = dataset.families.iter().flat_map(|family| &family.smoothing_length).map(|&length| f64::from(length));
    let reach = lengths.fold([f64::INFINITY, 0.0], |[least, most], length| [least.min(length), most.max(length)]);
    frame::with_kernels(frame::frame(dataset.bounds(), &samples), reach)
}
