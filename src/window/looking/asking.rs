//! Whom a question about a selection is put to: the page file, its source, or the run as it is at the moment that is shown.

use super::prober::opened;
use crate::explore::{Data, ExploreError, Members, Work};
use crate::store::PageFile;
use crate::window::scene::{RunNow, Scene};
use std::path::PathBuf;
use std::sync::Arc;

/// Who is asked.
pub struct Asking {
    file: Arc<PageFile>,
    /// The source, where it has to be asked.
    source: Option<Option<PathBuf>>,
    run: Option<RunNow>,
}

impl Asking {
    /// Who knows best of these members now; `exact`: not from a page file, where there is somebody else.
    pub fn about(scene: &Scene, members: &Members, exact: bool) -> Asking {
        // At a step, its page file says who is there without a look at all tracks.
        let needs_run = members.stay() || scene.moving.is_some();
        let run = RunNow::of(scene).filter(|_| needs_run);
        let source = (exact || members.ids().is_some()).then(|| scene.source());
        // Without a source, a page file answers as well as it can.
        let source = source.filter(|source| source.is_some() || members.ids().is_some());
        Asking { file: Arc::clone(&scene.file), source, run }
    }

    /// Asks: `question` is told whom, who is meant there, and the edge of the periodic box.
    ///
    /// # Errors
    /// When nobody can be asked, and those of the question.
    pub fn ask<T>(
        &self,
        members: &Members,
        work: Work<'_>,
        question: impl FnOnce(Data<'_>, &Members, Option<f64>) -> Result<T, ExploreError>,
    ) -> Result<T, ExploreError> {
        if let Some(RunNow { following, moment, interpolation }) = &self.run {
            let (snapshot, region) = following.snapshot(members, *moment, *interpolation, work)?;
            return question(Data::Source(&snapshot), &Members::Region(region), following.periodic());
        }
        match &self.source {
            Some(source) => {
                let source = opened(&self.file, source.clone())?;
                let data = Data::Source(source.as_ref());
                question(data, members, data.periodic_edge()?)
            }
            None => {
                let data = Data::Pages(&self.file);
                question(data, members, data.periodic_edge()?)
            }
        }
    }
}
