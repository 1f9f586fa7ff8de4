//! The source particles behind a picture at full precision, and how a request wants to see them.

use super::cache;
use super::progress_bar::TerminalProgress;
use super::request::Request;
use super::statistics::Times;
use crate::explore::data::source_path;
use crate::import::{AttributeChoice, LoadOptions, load};
use crate::look::Member;
use crate::mode::Depiction;
use crate::model::{Bounds, Dataset, Family, FamilyName};
use crate::picture::look;
use crate::store::PageFile;
use crate::view::frame;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// What an exact picture draws, and how.
pub(super) struct ExactSource {
    /// The first source.
    pub path: PathBuf,
    /// Its particles, and those of the others.
    pub dataset: Dataset,
    /// The mode and the attribute of the picture.
    pub depiction: Depiction,
    /// The box that a picture of them is framed by.
    pub framed: Bounds,
}

impl ExactSource {
    /// Loads the particles; `times` notes how long that takes.
    ///
    /// # Errors
    /// When a source cannot be read, or a setting does not fit the data.
    pub fn open(request: &Request, times: &mut Times) -> Result<ExactSource, Box<dyn std::error::Error + Send + Sync>> {
        let (path, dataset) = times.measure("load", || load_exact(request))?;
        let depiction =
            look::depict_particles(request.look(), &dataset).map_err(|why| format!("{}: {why}", path.display()))?;
        let framed = framed_of(&dataset);
        Ok(ExactSource { path, dataset, depiction, framed })
    }

    /// All families.
    pub fn families(&self) -> Vec<&Family> {
        self.dataset.families.iter().collect()
    }

    /// Their names.
    pub fn names(&self) -> Vec<FamilyName> {
        self.dataset.families.iter().map(|family| family.name).collect()
    }
}

/// The box that a picture of these particles is framed by.
pub fn framed_of(dataset: &Dataset) -> Bounds {
    let positions = dataset.families.iter().flat_map(|family| &family.positions);
    let samples: Vec<(DVec3, f64)> = positions.map(|&position| (DVec3::from_array(position), 1.0)).collect();
    frame::frame(dataset.bounds(), &samples)
}

/// The particles that an exact picture draws: those of the source, or of the one that a page file was built from; of several
/// datasets all, each where it lies.
pub fn load_exact(request: &Request) -> Result<(PathBuf, Dataset), Box<dyn std::error::Error + Send + Sync>> {
    let members = &request.members;
    let (path, mut whole) = load_one(request, &members[0])?;
    let units = (whole.length_unit.clone(), whole.mass_unit.clone());
    let place = |member: &Member, dataset: &mut Dataset| {
        let placement = member.placement((&dataset.length_unit, &dataset.mass_unit), (&units.0, &units.1));
        placement.place(dataset);
        placement.is_here()
    };
    let mut is_here = place(&members[0], &mut whole);
    for member in &members[1..] {
        let (_, mut next) = load_one(request, member)?;
        is_here &= place(member, &mut next) && next.provenance.box_size == whole.provenance.box_size;
        whole.families.append(&mut next.families);
        whole.skipped.append(&mut next.skipped);
    }
    whole.provenance.box_size = whole.provenance.box_size.filter(|_| is_here);
    Ok((path, whole))
}

fn load_one(
    request: &Request,
    member: &Member,
) -> Result<(PathBuf, Dataset), Box<dyn std::error::Error + Send + Sync>> {
    let source = source_of(&member.path)?;
    let attribute = request.look().attribute_name();
    let attributes =
        attribute.into_iter().chain(request.look().mode.iter().flat_map(|mode| mode.weight_attributes).copied());
    let own = ["mass", "density", "smoothing-length"];
    let named: Vec<String> = attributes.filter(|name| !own.contains(name)).map(str::to_owned).collect();
    let options = LoadOptions {
        families: match request.family {
            Some(family) => vec![family],
            None => member.families.clone().unwrap_or_default(),
        },
        attributes: if attribute.is_some() && !named.is_empty() {
            AttributeChoice::Named(named)
        } else {
            AttributeChoice::Usual
        },
        ..LoadOptions::default()
    };
    let dataset = load(&source, &options, &TerminalProgress::new())?;
    Ok((source, dataset))
}

/// The source itself, or the one that a page file was built from, if it is still there.
fn source_of(path: &Path) -> Result<PathBuf, Box<dyn std::error::Error + Send + Sync>> {
    if !cache::is_page_file(path)? {
        return Ok(path.to_owned());
    }
    let file = PageFile::open(path)?;
    source_path(&file).ok_or_else(|| {
        let (path, source) = (path.display(), file.metadata().provenance.path.display());
        format!("{path}: --exact draws the source {source}, which is not there any more; name the source instead")
            .into()
    })
}
