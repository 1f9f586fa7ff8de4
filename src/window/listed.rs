//! What the data camera draws with an adapter.

use crate::gpu::DrawItem;
use crate::mode::Plan;
use crate::view::Extent;
use std::sync::Arc;

/// What is drawn of a selection, or of live particles.
pub(super) struct Listed {
    /// The nodes.
    pub items: Arc<[DrawItem]>,
    /// How far the particles of each reach.
    pub extents: Arc<[Extent]>,
    /// What is left out of them.
    pub plan: Plan,
    /// How many particles are drawn.
    pub taken: u64,
}
