//! Probes in the window: a region that is summed up over the whole data.

use crate::explore::data::{open_source, source_of};
use crate::explore::{Data, ExploreError, Members, Probe, ProbeOptions, ProfileOptions, Work, probe};
use crate::import::Source;
use crate::store::PageFile;
use crate::window::scene::Scene;
use crate::window::state::answer::Answer;
use bevy::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Shells of a profile.
const SHELLS: usize = 24;

/// What is looked at, and what is known of it.
#[derive(Resource, Default)]
pub struct Prober {
    /// What is summed up.
    pub members: Option<Members>,
    /// Its sums.
    pub sums: Answer<Probe>,
}

impl Prober {
    /// Sums up over the page file, or over the source where `source` names it; what was going on is stopped.
    pub fn start(&mut self, file: &Arc<PageFile>, members: Members, source: Option<PathBuf>) {
        let (file, asked) = (Arc::clone(file), members.clone());
        self.members = Some(members);
        self.sums = Answer::ask("probe", move |work| sum_up(&file, &asked, source.as_deref(), work));
    }
}

/// The source that has to be asked about these members, if any: page files hold no ids.
pub fn source_for(scene: &Scene, members: &Members) -> Option<PathBuf> {
    members.ids().and_then(|_| scene.source())
}

/// The source of a page file: the one that is named, else the one that the file names itself.
///
/// # Errors
/// Where it cannot be opened, is not there any more, or is another one.
pub fn opened(file: &PageFile, source: Option<PathBuf>) -> Result<Box<dyn Source>, ExploreError> {
    match source {
        Some(path) => open_source(&path, file),
        None => source_of(file),
    }
}

fn sum_up(file: &PageFile, members: &Members, source: Option<&Path>, work: Work<'_>) -> Result<Probe, ExploreError> {
    over(file, source, |data| {
        let sphere = match members {
            Members::Region(region) => region.first_sphere(),
            Members::Ids(_) => None,
        };
        let profile = sphere.map(|_| ProfileOptions::logarithmic(SHELLS));
        let options = ProbeOptions { profile, periodic: data.periodic_edge()?, ..ProbeOptions::default() };
        probe(data, members, &options, work)
    })
}

/// Asks the source where it is named, else the page file.
///
/// # Errors
/// When the source cannot be opened, and those of what is asked.
pub fn over<T>(
    file: &PageFile,
    source: Option<&Path>,
    ask: impl FnOnce(Data<'_>) -> Result<T, ExploreError>,
) -> Result<T, ExploreError> {
    match source {
        Some(path) => {
            let source = open_source(path, file)?;
            ask(Data::Source(source.as_ref()))
        }
        None => ask(Data::Pages(file)),
    }
}
