//! The main world's handle on what the renderer holds: nodes of particles, attribute tables, and their state.
//!
//! [`ParticleScene`] is one resource, inserted in both worlds as a cheap clone. The main world queues nodes and tables
//! and asks what is resident; the render world takes from the queue under a byte budget a frame (see
//! [`super::arena`]). What a camera draws of it is said by its [`super::SplatView`] component. Nothing here waits:
//! every call takes a short lock.

use super::clusters::{ClusterNode, GpuCluster};
use super::moving::MovingNode;
use crate::store::{Page, Positions};
use crate::stream::copies::{CLUSTER_BYTES, MOVING_BYTES};
use bevy::prelude::Resource;
use bevy::render::render_resource::Buffer;
use glam::DVec3;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Names one node of one particle tree, or one batch of source particles. The caller chooses the numbers; they only
/// have to differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId {
    /// Which data source: one family of one open file.
    pub source: u32,
    /// The page, in the source.
    pub page: u32,
    /// The node, in the page.
    pub node: u32,
}

/// Names an attribute table; see [`ParticleScene::insert_table`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TableId(u32);

/// What a code of a quantised particle stands for, in one mode: the codebook's entry with the mode's weight applied.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TableEntry {
    /// Smoothing length (support radius), world units.
    pub smoothing_length: f32,
    /// The weight `w` that is accumulated into `P`.
    pub weight: f32,
    /// The attribute `a`; `w a` is accumulated into `P S`.
    pub attribute: f32,
    /// How much a particle's absence would show; see [`crate::mode::sample`].
    pub importance: f32,
}

/// One source particle at full precision.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct RawParticle {
    /// Position relative to the payload's frame; see [`Payload::Camera`].
    pub position: [f32; 3],
    /// Smoothing length (support radius), world units.
    pub smoothing_length: f32,
    /// The weight `w` that is accumulated into `P`.
    pub weight: f32,
    /// The attribute `a`; `w a` is accumulated into `P S`.
    pub attribute: f32,
    /// Its own density, for modes that draw with it; 0 for others.
    pub density: f32,
    /// Makes it eight numbers.
    pub unused: f32,
}

/// The particles of one node. Packed positions are those of [`crate::codec::coordinates`].
#[derive(Clone, Debug)]
pub enum Payload {
    /// A node of a page; shared, not copied.
    Page {
        /// The page.
        page: Arc<Page>,
        /// Index of the node in it.
        node: u32,
    },
    /// Grid encoding.
    Grid {
        /// Packed positions.
        positions: Vec<u32>,
        /// Index into the table, for each particle.
        codes: Vec<u16>,
    },
    /// Leaf encoding.
    Leaf {
        /// Packed positions.
        positions: Vec<u64>,
        /// Index into the table, for each particle.
        codes: Vec<u16>,
    },
    /// Source particles relative to the node's `min`, in world axes.
    World(Vec<RawParticle>),
    /// Source particles in camera space (right, up, depth; computed in double precision): valid for one camera only.
    Camera(Vec<RawParticle>),
    /// A node of a page that is on its way through an interval.
    Moving(MovingNode),
    /// The clusters of a node of a page.
    Clusters(ClusterNode),
    /// Ellipsoids relative to the node's `min`, in world axes.
    Ellipsoids(Vec<GpuCluster>),
    /// Source particles as [`Payload::World`] has them, in a storage buffer of somebody else's, which passes read where it is.
    Lent {
        /// The buffer: [`RawParticle`]s from its beginning.
        buffer: Buffer,
        /// How many.
        count: u32,
    },
}

/// A payload as the words that the arena holds.
pub(super) enum Words<'a> {
    /// One word a particle, and codes.
    Grid(&'a [u32], &'a [u16]),
    /// Two words (low, high) a particle, and codes.
    Leaf(&'a [u32], &'a [u16]),
    /// Eight words a particle, in world axes.
    World(&'a [u32]),
    /// Eight words a particle, in camera space.
    Camera(&'a [u32]),
    /// Still to be written, 24 words a particle.
    Moving(&'a MovingNode),
    /// Still to be written, 16 words each.
    Clusters(&'a ClusterNode),
    /// 16 words each.
    Ellipsoids(&'a [u32]),
    /// They are on the adapter.
    Lent(&'a Buffer, u32),
}

impl Payload {
    pub(super) fn words(&self) -> Words<'_> {
        match self {
            Payload::Page { page, node } => {
                let particles = page.particles(*node as usize);
                match particles.positions {
                    Positions::Grid(words) => Words::Grid(words, particles.codes),
                    Positions::Leaf(words) => Words::Leaf(bytemuck::cast_slice(words), particles.codes),
                }
            }
            Payload::Grid { positions, codes } => Words::Grid(positions, codes),
            Payload::Leaf { positions, codes } => Words::Leaf(bytemuck::cast_slice(positions), codes),
            Payload::World(particles) => Words::World(bytemuck::cast_slice(particles)),
            Payload::Camera(particles) => Words::Camera(bytemuck::cast_slice(particles)),
            Payload::Moving(node) => Words::Moving(node),
            Payload::Clusters(node) => Words::Clusters(node),
            Payload::Ellipsoids(ellipsoids) => Words::Ellipsoids(bytemuck::cast_slice(ellipsoids)),
            Payload::Lent { buffer, count } => Words::Lent(buffer, *count),
        }
    }

    /// Number of particles. Particles without a code, and codes without a position, do not count.
    pub fn len(&self) -> usize {
        match self.words() {
            Words::Grid(positions, codes) => positions.len().min(codes.len()),
            Words::Leaf(positions, codes) => (positions.len() / 2).min(codes.len()),
            Words::World(words) | Words::Camera(words) => words.len() / RAW_WORDS,
            Words::Moving(node) => node.len(),
            Words::Clusters(node) => node.len(),
            Words::Ellipsoids(words) => words.len() / CLUSTER_WORDS,
            Words::Lent(_, count) => count as usize,
        }
    }

    /// Whether it holds no particle.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes that its copy takes on the GPU.
    pub fn bytes(&self) -> u64 {
        match self.words() {
            Words::Grid(positions, codes) | Words::Leaf(positions, codes) => {
                (size_of_val(positions) + size_of_val(codes).next_multiple_of(4)) as u64
            }
            Words::World(words) | Words::Camera(words) | Words::Ellipsoids(words) => size_of_val(words) as u64,
            Words::Moving(node) => node.len() as u64 * MOVING_BYTES,
            Words::Clusters(node) => node.bytes(),
            Words::Lent(..) => 0,
        }
    }
}

/// Words of a [`RawParticle`].
pub(super) const RAW_WORDS: usize = size_of::<RawParticle>() / size_of::<u32>();
/// Words of a particle on its way.
pub(super) const MOVING_WORDS: usize = MOVING_BYTES as usize / size_of::<u32>();
/// Words of a cluster.
pub(super) const CLUSTER_WORDS: usize = CLUSTER_BYTES as usize / size_of::<u32>();

/// A node on its way to the renderer.
#[derive(Clone, Debug)]
pub struct NodeUpload {
    /// Its name.
    pub id: NodeId,
    /// The cell's lowest corner in world units (the origin of [`Payload::World`] and [`Payload::Lent`]).
    pub min: DVec3,
    /// The cell's edge length in world units; only the packed encodings use it.
    pub size: f64,
    /// Its particles.
    pub payload: Payload,
}

/// Where a node stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeState {
    /// Waiting for its turn to be uploaded.
    Queued,
    /// On the GPU: a camera may draw it.
    Resident,
    /// There was no room for it within the byte budget; remove something and insert it again.
    Rejected,
}

/// Numbers for panels and tests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneStats {
    /// Nodes on the GPU.
    pub resident_nodes: usize,
    /// Their bytes.
    pub resident_bytes: u64,
    /// Nodes that wait for upload.
    pub queued_nodes: usize,
    /// The arena's byte budget.
    pub budget_bytes: u64,
    /// The most that is uploaded in one frame, bytes (at least one node is, whatever its size).
    pub upload_bytes_per_frame: u64,
}

/// What the codes of nodes mean in one mode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// For each code.
    pub entries: Vec<TableEntry>,
    /// Each code's own density, for modes that draw with it; empty for others.
    pub densities: Vec<f32>,
}

impl From<Vec<TableEntry>> for Table {
    fn from(entries: Vec<TableEntry>) -> Table {
        Table { entries, densities: Vec::new() }
    }
}

/// What the render world has to carry out.
#[derive(Debug)]
pub(super) enum SceneCommand {
    Insert(NodeUpload),
    Remove(NodeId),
    InsertTable(TableId, Table),
    RemoveTable(TableId),
}

#[derive(Debug, Default)]
pub(super) struct SceneState {
    pub(super) queue: VecDeque<SceneCommand>,
    pub(super) nodes: HashMap<NodeId, NodeState>,
    pub(super) resident_bytes: u64,
    pub(super) budget_bytes: u64,
    pub(super) upload_bytes_per_frame: u64,
    next_table: u32,
}

/// The particles that cameras may draw. Clones share one state.
#[derive(Resource, Clone, Debug)]
pub struct ParticleScene(Arc<Mutex<SceneState>>);

impl ParticleScene {
    /// An empty scene with a budget for resident particle data, and one for what is uploaded in a frame.
    pub fn new(budget_bytes: u64, upload_bytes_per_frame: u64) -> ParticleScene {
        ParticleScene(Arc::new(Mutex::new(SceneState {
            budget_bytes,
            upload_bytes_per_frame,
            ..SceneState::default()
        })))
    }

    /// Changes both budgets; what is resident stays.
    pub fn set_budgets(&self, budget_bytes: u64, upload_bytes_per_frame: u64) {
        let mut state = self.lock();
        (state.budget_bytes, state.upload_bytes_per_frame) = (budget_bytes, upload_bytes_per_frame);
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, SceneState> {
        // A panic elsewhere leaves a queue that is still consistent: every change below is one push or insert.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues nodes for upload, in this order. A node that is queued or resident already is ignored.
    pub fn insert_nodes(&self, nodes: impl IntoIterator<Item = NodeUpload>) {
        let mut state = self.lock();
        for node in nodes {
            if matches!(state.nodes.get(&node.id), None | Some(NodeState::Rejected)) {
                state.nodes.insert(node.id, NodeState::Queued);
                state.queue.push_back(SceneCommand::Insert(node));
            }
        }
    }

    /// Frees nodes; they must not be in a [`super::SplatView`] from now on (they would be left out).
    pub fn remove_nodes(&self, ids: impl IntoIterator<Item = NodeId>) {
        let mut state = self.lock();
        for id in ids {
            if state.nodes.remove(&id).is_some() {
                state.queue.push_back(SceneCommand::Remove(id));
            }
        }
    }

    /// Uploads a table of up to 65536 entries: what the codes of a node mean in one mode (one table for each level and
    /// family of a file). Codes beyond its end draw its last entry.
    pub fn insert_table(&self, table: impl Into<Table>) -> TableId {
        let mut state = self.lock();
        let id = TableId(state.next_table);
        state.next_table += 1;
        state.queue.push_back(SceneCommand::InsertTable(id, table.into()));
        id
    }

    /// Frees a table.
    pub fn remove_table(&self, id: TableId) {
        self.lock().queue.push_back(SceneCommand::RemoveTable(id));
    }

    /// Where a node stands; `None` if it was never inserted, or was removed.
    pub fn node_state(&self, id: NodeId) -> Option<NodeState> {
        self.lock().nodes.get(&id).copied()
    }

    /// Numbers for panels and tests.
    pub fn stats(&self) -> SceneStats {
        let state = self.lock();
        let count = |wanted| state.nodes.values().filter(|node| **node == wanted).count();
        SceneStats {
            resident_nodes: count(NodeState::Resident),
            resident_bytes: state.resident_bytes,
            queued_nodes: count(NodeState::Queued),
            budget_bytes: state.budget_bytes,
            upload_bytes_per_frame: state.upload_bytes_per_frame,
        }
    }
}
