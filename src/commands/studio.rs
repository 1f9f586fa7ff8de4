//! A page file that is open for pictures: what one picture has read is there for the next.

use super::cache;
use super::progress_bar::TerminalProgress;
use super::render::families;
use super::request::Request;
use crate::look::{Member, open_members};
use crate::mode::Depiction;
use crate::model::{Bounds, ReadMethod};
use crate::picture::look;
use crate::store::PageFile;
use crate::stream::{Scene, first_frame};
use crate::view::{Detail, View};
use std::path::Path;
use std::sync::Arc;

/// An open page file with the pages in memory.
pub(super) struct Studio {
    /// The page file.
    pub file: Arc<PageFile>,
    /// Its pages.
    pub scene: Scene,
    /// What the first picture of some families shows, since that takes reading.
    framed: Option<(Vec<u32>, Bounds)>,
    /// The view of the picture after the next one: what it needs is read while the next one is drawn.
    pub ahead: Option<View>,
}

/// Begins to read what a view will need.
pub(super) fn look_ahead(scene: &mut Scene, view: Option<View>, detail: impl Into<Detail>) {
    if let Some(view) = view {
        scene.select(&view, detail);
        scene.streamer.serve();
    }
}

impl Studio {
    /// Opens the datasets as one; of a source, the page file in the cache, built first where there is none.
    ///
    /// # Errors
    /// When a source cannot be read or built, or they do not fit together.
    pub fn open(members: &[Member]) -> Result<Studio, Box<dyn std::error::Error + Send + Sync>> {
        let page_file = |path: &Path| cache::page_file_of(path, &TerminalProgress::new());
        let (file, notes) = open_members(members, ReadMethod::default(), page_file)?;
        notes.iter().for_each(|note| eprintln!("deepfield: {note}"));
        let file = Arc::new(file);
        // Nothing limits what a picture holds: it has to be converged.
        let scene = Scene::new(Arc::clone(&file), u64::MAX);
        Ok(Studio { file, scene, framed: None, ahead: None })
    }

    /// Forgets pages where they take more than so many bytes.
    pub fn keep_within(&mut self, bytes: u64) {
        if self.scene.streamer.residency.statistics().bytes > bytes {
            self.scene = Scene::new(Arc::clone(&self.file), u64::MAX);
        }
    }

    /// The mode and the attribute that the request names, on the open data.
    ///
    /// # Errors
    /// When they or a setting do not fit the data.
    pub fn depict(&self, request: &Request) -> Result<Depiction, String> {
        look::depict(request.look(), self.file.metadata()).map_err(|why| format!("{}: {why}", request.path().display()))
    }

    /// Draws the families that the request names from now on. The box that a picture of them is framed by.
    ///
    /// # Errors
    /// When the data has none of them.
    pub fn choose(&mut self, request: &Request) -> Result<Bounds, String> {
        let families = families(request, &self.file)?;
        self.scene.families = families.clone();
        match &self.framed {
            Some((known, framed)) if *known == families => Ok(*framed),
            _ => {
                let framed = first_frame(&self.file, &families);
                self.framed = Some((families, framed));
                Ok(framed)
            }
        }
    }
}
