//! What a page file comes to in a picture, chosen, decoded and drawn as `render` does it.

use super::splat::Failure;
use crate::color::Accumulation;
use crate::color::transfer::TransferFunction;
use crate::mode::{Conserved, Depiction, LevelChoice, Levels, Plan, Settings};
use crate::modes::column_density;
use crate::picture::level_report::bound;
use crate::picture::{PictureError, Subject};
use crate::store::{PageFile, Tree};
use crate::stream::{Scene, SceneNode};
use crate::view::View;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A page file whose pages come into memory as they are needed, and stay.
pub struct Paged {
    /// The file.
    pub file: Arc<PageFile>,
    /// What is in memory of it.
    pub scene: Scene,
}

/// A picture of a hierarchy.
pub struct Drawn {
    /// Sums.
    pub sums: Accumulation,
    /// Splats that were drawn.
    pub splats: u64,
    /// Nodes of a page file that they are of.
    pub nodes: Vec<SceneNode>,
    /// Choosing the nodes, milliseconds; `None` of what was in memory.
    pub select_ms: Option<f64>,
    /// Choosing, decoding and drawing, each time.
    pub times: Vec<Duration>,
    /// What the error in L1 is at most, where something is promised.
    pub error_bound: Option<f64>,
}

impl Paged {
    /// Opens a page file.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(path: &Path) -> Result<Paged, Failure> {
        let file = Arc::new(PageFile::open(path)?);
        let scene = Scene::new(Arc::clone(&file), u64::MAX);
        Ok(Paged { file, scene })
    }

    /// Column density by a choice of levels.
    ///
    /// # Errors
    /// When the file has nothing that it could be drawn from.
    pub fn depiction(&self, choice: LevelChoice) -> Result<Depiction, Failure> {
        let depiction = Depiction::new(&column_density::MODE, Settings::default(), None, self.file.metadata())?;
        Ok(Depiction { choice, attribute: None, ..depiction })
    }

    /// Draws column density `repeat` times.
    ///
    /// # Errors
    /// When the file has no clusters, but they are chosen, or a page cannot be read.
    pub fn draw(
        &mut self,
        choice: LevelChoice,
        view: &View,
        tau: f64,
        plan: Plan,
        repeat: u32,
    ) -> Result<Drawn, Failure> {
        let depiction = self.depiction(choice)?;
        let metadata = self.file.metadata();
        if choice.levels == Levels::Clusters && !metadata.has_clusters() {
            let why = "clusters: not in this file, expected one built with --hierarchy octree,pca";
            return Err(Box::new(PictureError::Unfit { file: self.file.path().to_owned(), why: why.into() }));
        }
        self.scene.purpose = depiction.purpose(metadata);
        let detail = depiction.detail(view, tau, metadata);
        self.scene.converge_blocking(view, detail)?;
        let transfer = TransferFunction::default();
        let subject = Subject::new(metadata, &depiction, &transfer, 1.0);
        let (mut times, mut select_ms, mut last) = (Vec::new(), 0.0, None);
        for _ in 0..repeat {
            let start = Instant::now();
            let selection = self.scene.select(view, detail);
            select_ms = 1e3 * start.elapsed().as_secs_f64();
            let nodes = subject.decode(view, &selection.nodes, &plan);
            let drawn: u64 = nodes.iter().map(|node| node.len() as u64).sum();
            let sums = subject.draw(view, &nodes, &plan)?.sums(depiction.mode)?.0;
            times.push(start.elapsed());
            drop(nodes);
            last = Some((sums, drawn, selection.nodes));
        }
        let (sums, splats, nodes) = last.ok_or("--repeat: nothing was drawn")?;
        let total: f64 = sums.p.iter().map(|p| f64::from(*p)).sum();
        let promised = choice.levels == Levels::Clusters && depiction.mode.conserves == Conserved::Mass;
        let error_bound = promised.then(|| bound(view, &depiction, &nodes, total)).flatten();
        Ok(Drawn { sums, splats, nodes, select_ms: Some(select_ms), times, error_bound })
    }
}
