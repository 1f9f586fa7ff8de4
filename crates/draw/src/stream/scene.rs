//! What one view draws of a page file: the chosen families, selected at an error bound from what is resident.

use super::outline::Outline;
use super::{LookAhead, PageState, StreamOptions, Streamer};
use crate::hierarchy::Purpose;
use crate::model::Bounds;
use crate::store::{Metadata, NodeRef, Page, PageId, StoreError, Tree};
use crate::view::{Detail, Drawn, Extent, Hidden, Selection, View};
use glam::DVec3;
use std::sync::Arc;
use std::time::Duration;

/// A tree and the families of it that are drawn.
pub struct Scene {
    /// The tree's pages.
    pub streamer: Streamer,
    /// Indices of the drawn families in the file's metadata.
    pub families: Vec<u32>,
    /// What the inner nodes that are drawn are made for, of families that have such.
    pub purpose: Purpose,
    /// When all views of it are, the data's unit of time; `None`: each has its own time.
    pub time: Option<f64>,
    /// What is known of pages that views were listed of.
    pub(super) outline: Outline,
    /// Bytes of pages that were freed and not given back to the system yet.
    pub(super) freed_bytes: u64,
    /// Whether a view was selected in less detail than was asked for.
    pub(super) is_coarser: bool,
}

/// A node to draw, with the page that holds it.
#[derive(Clone, Debug)]
pub struct SceneNode {
    /// Its page; stays alive while this does, evicted or not.
    pub page: Arc<Page>,
    /// The node.
    pub node: NodeRef,
    /// Its screen-space error, pixels.
    pub error_pixels: f64,
    /// By how much its image is displaced from where the data is, world units; zero but in periodic boxes.
    pub offset: DVec3,
    /// When it is drawn, the data's unit of time.
    pub time: f64,
    /// How many of its clusters are drawn, where these are not all.
    pub part: Option<u32>,
}

/// What a view draws now.
#[derive(Clone, Debug, Default)]
pub struct SceneSelection {
    /// The nodes; none is an ancestor of another.
    pub nodes: Vec<SceneNode>,
    /// Whether every page that the view needs in the detail that it was selected in is resident.
    pub converged: bool,
    /// How many nodes the view lacks.
    pub missing: usize,
    /// Largest screen-space error among the drawn nodes, pixels.
    pub error_pixels: f64,
    /// Particles in the drawn nodes.
    pub particles: u64,
    /// The nodes that the streamer's occluder hides.
    pub hidden: Vec<Hidden<NodeRef>>,
    /// In what detail it was selected in place of the one that was asked for, where that needs more memory than there is.
    pub coarser: Option<Detail>,
}

impl SceneNode {
    /// A node that a view draws, with its page, if that is in memory; leaves are looked at particle by particle from `tau` pixels on.
    pub(super) fn of(streamer: &Streamer, view: &View, tau: f64, drawn: &Drawn<NodeRef>) -> Option<SceneNode> {
        let residency = &streamer.residency;
        let metadata = residency.tree().metadata();
        let page = Arc::clone(residency.page(drawn.id.page)?);
        let error_pixels = match page.nodes.get(drawn.id.node as usize)? {
            // Of other content no more is known than of the node.
            node if node.is_leaf() && drawn.error_pixels > tau && page.content(drawn.id.node as usize).is_none() => {
                leaf_error_pixels(&view.of_image(drawn.offset), metadata, &page, drawn.id.node as usize)
            }
            _ => drawn.error_pixels,
        };
        let part = drawn.part.then_some(drawn.particles as u32);
        let (node, offset) = (drawn.id, drawn.offset);
        Some(SceneNode { page, node, error_pixels, offset, time: view.time, part })
    }
}

/// Pages that are read at a time for a single picture.
pub const IN_FLIGHT: usize = 16;
/// Time without an answer after which a single picture does without a page.
pub(crate) const STALL: Duration = Duration::from_secs(20);

impl SceneSelection {
    /// A selection with the pages that hold its nodes.
    pub fn of(
        streamer: &Streamer,
        view: &View,
        detail: impl Into<Detail>,
        selection: &Selection<NodeRef>,
    ) -> SceneSelection {
        let tau = detail.into().tolerance(view);
        let nodes: Vec<SceneNode> =
            selection.draw.iter().filter_map(|drawn| SceneNode::of(streamer, view, tau, drawn)).collect();
        SceneSelection {
            error_pixels: nodes.iter().fold(0.0, |largest, node| largest.max(node.error_pixels)),
            nodes,
            converged: selection.is_converged(),
            missing: selection.missing.len(),
            particles: selection.particles(),
            hidden: selection.hidden.clone(),
            coarser: None,
        }
    }
}

impl Scene {
    /// Draws all families of `tree`; resident pages may take `budget` bytes.
    pub fn new(tree: impl Tree + 'static, budget: u64) -> Scene {
        // Nothing else reads while a picture is drawn.
        let ahead = LookAhead { share: 1.0, ..LookAhead::default() };
        let options = StreamOptions { budget, in_flight: IN_FLIGHT, stall: STALL, prefetch: false, ahead };
        Scene::with_options(tree, options)
    }

    /// The same with all options.
    pub fn with_options(tree: impl Tree + 'static, options: StreamOptions) -> Scene {
        let families = (0..tree.metadata().families.len() as u32).collect();
        Scene {
            streamer: Streamer::new(tree, options),
            families,
            purpose: Purpose::Splats,
            time: None,
            outline: Outline::default(),
            freed_bytes: 0,
            is_coarser: false,
        }
    }

    pub(super) fn timed(&self, view: &View) -> View {
        View { time: self.time.unwrap_or(view.time), ..*view }
    }

    /// Starts a frame: selects what `view` draws in this detail (a number is an error in pixels) from what is in memory.
    pub fn select(&mut self, view: &View, detail: impl Into<Detail>) -> SceneSelection {
        let (view, detail) = (&self.timed(view), detail.into());
        let roots = self.roots(view);
        let selection = self.streamer.select(view, detail, &roots);
        SceneSelection::of(&self.streamer, view, detail, &selection)
    }

    /// Selects and loads, waiting for the disk, until the view is converged or nothing more can be had: pages that
    /// cannot be read, or a disk that does not answer, leave `converged` false. A view that exceeds the budget is selected in less detail
    /// ([`SceneSelection::coarser`]). What there is to tell is handed to `tell`, a sentence at a time.
    ///
    /// # Errors
    /// [`StoreError`] if a root page cannot be read, since then nothing can be drawn.
    pub fn converge(
        &mut self,
        view: &View,
        detail: impl Into<Detail>,
        tell: &mut dyn FnMut(String),
    ) -> Result<SceneSelection, StoreError> {
        let (view, asked) = (&self.timed(view), detail.into());
        let detail = self.held_detail(view, asked, tell)?;
        let coarser = (detail != asked).then_some(detail);
        self.is_coarser |= coarser.is_some();
        let roots = self.roots(view);
        loop {
            let selection = self.streamer.select(view, detail, &roots);
            self.streamer.serve();
            self.streamer.take_evicted();
            if self.streamer.is_busy() {
                self.wait(tell);
            } else if self.has_roots(&roots, |_, _| false)? {
                return Ok(SceneSelection { coarser, ..SceneSelection::of(&self.streamer, view, detail, &selection) });
            }
        }
    }

    /// What a view that comes next needs is read while this one is drawn, as far as it is known.
    pub fn look_ahead(&mut self, view: &View, detail: impl Into<Detail>) {
        let view = &self.timed(view);
        let roots = self.roots(view);
        self.streamer.look_ahead(view, detail, &roots);
        self.streamer.serve();
    }

    /// The first nodes of the families that are drawn.
    pub(super) fn roots(&self, view: &View) -> Vec<NodeRef> {
        self.streamer.roots(self.families.iter().copied(), self.purpose, view.time)
    }

    /// Whether all roots are there, or are known anyway; one that was given up is read once more, and there from then on if it comes.
    ///
    /// # Errors
    /// Why a root is not there.
    pub(super) fn has_roots(
        &mut self,
        roots: &[NodeRef],
        is_known: impl Fn(&Scene, PageId) -> bool,
    ) -> Result<bool, StoreError> {
        let mut has_all = true;
        for page in roots.iter().map(|root| root.page) {
            if is_known(self, page) {
                continue;
            }
            let residency = &mut self.streamer.residency;
            match residency.state(page) {
                Some(PageState::Resident(_)) => {}
                Some(PageState::Failed(_)) => {
                    let read = residency.tree().read_page(page)?;
                    residency.loaded(page, Ok(read));
                    has_all = false;
                }
                _ => {
                    let path = residency.tree().path().to_path_buf();
                    let source = std::io::Error::from(std::io::ErrorKind::TimedOut);
                    return Err(StoreError::Page { path, page: page.0, source });
                }
            }
        }
        Ok(has_all)
    }

    /// Waits until something has come of what is being read, or may be tried again, or nothing will come. The pages whose reads have ended, and
    /// what is to be told of root pages among them that cannot be read.
    pub(super) fn wait(&mut self, tell: &mut dyn FnMut(String)) -> (Vec<PageId>, Vec<(PageId, String)>) {
        loop {
            // Short waits, since a read that stalls ends none of them.
            self.streamer.wait(Duration::from_millis(100));
            let (arrivals, of_roots) = self.streamer.arrive_apart();
            arrivals.messages.into_iter().for_each(&mut *tell);
            if !arrivals.pages.is_empty() || self.streamer.is_retry_due() || !self.streamer.is_busy() {
                return (arrivals.pages, of_roots);
            }
        }
    }

    /// [`Scene::converge`] for callers who have nobody to tell.
    ///
    /// # Errors
    /// As [`Scene::converge`].
    pub fn converge_blocking(&mut self, view: &View, detail: impl Into<Detail>) -> Result<SceneSelection, StoreError> {
        self.converge(view, detail, &mut |_| {})
    }
}

/// The first nodes of all families of a tree, in every image that a view draws: of a tree in memory, all of it.
///
/// # Errors
/// [`StoreError`] if a page cannot be read.
pub fn first_nodes(tree: &dyn Tree, view: &View) -> Result<Vec<SceneNode>, StoreError> {
    let families: Vec<u32> = (0..tree.metadata().families.len() as u32).collect();
    let mut nodes = Vec::new();
    for node in tree.roots(&families, Purpose::Splats, view.time) {
        let page = Arc::new(tree.read_page(node.page)?);
        let (error_pixels, time, part) = (0.0, view.time, None);
        let image = |offset| SceneNode { page: Arc::clone(&page), node, error_pixels, offset, time, part };
        nodes.extend(view.images.offsets().map(image));
    }
    Ok(nodes)
}

/// A particle that is displaced by less than this share of its kernel's radius is in its place however large it is drawn: what
/// that changes in the picture is far below what the quantised smoothing lengths do.
const KERNEL_SHARE: f64 = 1.0 / 128.0;

/// Screen-space error of a leaf, particle by particle: a bound over its whole box is infinite where the box reaches the
/// eye's plane, although its particles do not. Particles nearer to that plane than they may be displaced are left out, and so are
/// those that are stored to [`KERNEL_SHARE`] of their kernels.
fn leaf_error_pixels(view: &View, metadata: &Metadata, page: &Page, index: usize) -> f64 {
    let node = &page.nodes[index];
    let Some(family) = metadata.families.get(page.family as usize) else { return f64::INFINITY };
    let particles = page.particles(index);
    let smoothing_lengths = family.codebooks.get(usize::from(node.codebook)).map(|book| &book.smoothing_length[..]);
    let smoothing_length =
        |code: u16| smoothing_lengths.and_then(|all| all.get(usize::from(code))).copied().unwrap_or(0.0);
    (0..particles.len())
        .map(|i| {
            let position = node.frame.position(particles.fraction(i));
            // Particles with small kernels are stored more exactly than the node's least exact ones.
            let delta = node.delta.min(1.001 * 3.0_f64.sqrt() * particles.rounding(i) * node.frame.size);
            let h = f64::from(smoothing_length(particles.codes[i]));
            if view.to_camera(position).z <= delta || delta <= KERNEL_SHARE * h {
                return 0.0;
            }
            let bounds = Bounds { min: position - delta, max: position + delta };
            let extent = Extent { bounds, margin: 0.0 };
            let error = if view.sees(&extent) { view.error_pixels(&extent, delta) } else { 0.0 };
            if error.is_finite() { error } else { 0.0 }
        })
        .fold(0.0, f64::max)
}
