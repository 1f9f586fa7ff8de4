//! Probes in the window: a region that is summed up over the whole data.

use super::answer::Answer;
use crate::explore::data::open_source;
use crate::explore::{Data, ExploreError, Members, Probe, ProbeOptions, ProfileOptions, Work, probe};
use crate::store::PageFile;
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
