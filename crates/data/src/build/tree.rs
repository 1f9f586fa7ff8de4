//! A family's trees, from its buckets to coded nodes: one for each kind of levels that is asked for. They share the leaves,
//! which belong to the first.

mod checks;
mod joining;

use super::BuildError;
use super::clusters::{CodedClusters, Maker};
use super::coding::{self, Batch, CodedNode, Coding, Measured};
use super::column_error::Picture;
use super::partition::Partition;
use super::spill::{Blob, Spill};
use crate::codec::coordinates::unpack_leaf;
use crate::codec::positions::{encode_grid, encode_leaf, leaf_words};
use crate::codec::{BatchInfo, CodeBits, Codebook, CodebookScope, Quantities, Refinement, Scaling};
use crate::hierarchy::octree::{Bucket, Columns, Context, Open, Piece, Plan, Tree, TreeNode, Words};
use crate::hierarchy::{ClusterOptions, Encoding, LevelInfo, Purpose};
use crate::model::portable::{Portable, portable};
use crate::model::progress::Progress;
use crate::model::{FamilyName, Kernel};
use crate::store::layout::StoredNode;
use crate::store::paging::{PlannedNode, Sections};
pub(super) use checks::{Checked, check_built, most_in_nodes};
use joining::Nodes;
use rayon::prelude::*;
use std::ops::Range;

/// The particles of a piece, put away.
#[derive(Debug)]
pub(super) struct Kept {
    positions: Positions,
    batch: Batch,
}

portable!(Kept { positions, batch });

#[derive(Debug)]
enum Positions {
    /// A section as it will be stored.
    Encoded(Blob),
    /// Grid words of a part of a node.
    Words(Blob),
}

impl Portable for Positions {
    fn put(&self, to: &mut Vec<u8>) {
        let (is_encoded, blob) = match self {
            Positions::Encoded(blob) => (true, blob),
            Positions::Words(blob) => (false, blob),
        };
        is_encoded.put(to);
        blob.put(to);
    }

    fn take(from: &mut &[u8]) -> Option<Positions> {
        let (is_encoded, blob) = Portable::take(from)?;
        Some(if is_encoded { Positions::Encoded(blob) } else { Positions::Words(blob) })
    }
}

/// A tree before it is coded; leaves of other levels than the first have no data.
pub(super) type Grown = Tree<Option<Kept>>;

/// Coded trees that only have to be written.
pub(super) struct CodedTrees {
    spill: Spill,
    /// The levels for splats.
    pub splats: CodedTree,
    /// Those for volumes.
    pub volume: Option<CodedTree>,
    /// Clusters.
    pub clusters: Option<CodedClusters>,
    /// What codes stand for.
    pub books: Books,
}

/// The codebooks of all trees, those of the first before those of the second.
#[derive(Default)]
pub(super) struct Books {
    /// The codebooks.
    pub codebooks: Vec<Codebook>,
    /// How the lines of those of the leaves run, where codes are refined.
    pub refinements: Vec<Refinement>,
    /// What the codes of the leaves do to a picture of column density, where that was asked for.
    pub column_error: Option<f64>,
    /// Entry of each code, for each codebook.
    pub numbers: Vec<Vec<u16>>,
}

/// A coded tree.
pub(super) struct CodedTree {
    /// The nodes, without the places of their children.
    pub nodes: Vec<Vec<PlannedNode>>,
    sections: Vec<Vec<NodeSections>>,
    /// One for each depth, without bytes; what the tree shares with another is not counted.
    pub levels: Vec<LevelInfo>,
}

/// Where the sections of a node are.
#[derive(Debug, Default)]
pub(super) struct NodeSections {
    positions: Option<Blob>,
    codes: Vec<(Blob, usize)>,
}

portable!(NodeSections { positions, codes });

impl NodeSections {
    /// Of a node with its section of positions there, if it has one.
    pub fn new(positions: Option<Blob>, coded: CodedNode) -> NodeSections {
        NodeSections { positions, codes: coded.codes }
    }

    /// The sections as they are stored; `numbers` are those of [`Books`].
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn read(
        &self,
        node: &StoredNode,
        numbers: &[Vec<u16>],
        bits: CodeBits,
        spill: &Spill,
    ) -> std::io::Result<Sections> {
        let positions = self.positions.as_ref().map(|blob| spill.get(blob)).transpose()?;
        let bits = bits.of(node.encoding == Encoding::Leaf);
        let mut own: Vec<u16> = Vec::new();
        for (blob, count) in &self.codes {
            bits.unpack(&spill.get(blob)?, *count, &mut own);
        }
        if own.len() != node.particles as usize {
            let what = format!("codes: found {}, expected {}", own.len(), node.particles);
            return Err(std::io::Error::other(what));
        }
        if node.encoding != Encoding::Relay {
            let has_all = |numbers: &&Vec<u16>| own.iter().all(|code| usize::from(*code) < numbers.len());
            let Some(numbers) = numbers.get(usize::from(node.codebook)).filter(has_all) else {
                return Err(std::io::Error::other("codes: found some without an entry, expected those of a codebook"));
            };
            own.iter_mut().for_each(|code| *code = numbers[usize::from(*code)]);
        }
        let mut packed = Vec::with_capacity(bits.packed_len(own.len()).unwrap_or(0));
        bits.pack(&own, &mut packed);
        Ok(Sections { positions: positions.map_or_else(Vec::new, |bytes| bytes.to_vec()), codes: packed })
    }
}

/// What was built of a bucket: for each kind of levels its pieces, and what is left open.
pub(super) type Built = Vec<(Vec<Piece<Option<Kept>>>, Option<Open>)>;

/// What building trees of a family needs beside its particles.
pub(super) struct Grower<'a> {
    pub context: &'a Context<'a>,
    pub family: FamilyName,
    pub plan: &'a Plan,
    pub scaling: &'a Scaling,
    pub spill: &'a Spill,
    pub progress: &'a dyn Progress,
}

impl Grower<'_> {
    /// Builds the pieces of some buckets, at most `workers` at a time.
    ///
    /// # Errors
    /// When something cannot be put away or read back.
    pub fn grow(&self, partition: &Partition, buckets: Range<usize>, workers: usize) -> Result<Vec<Built>, BuildError> {
        let Grower { context, family, plan, progress, .. } = *self;
        progress.begin(&format!("merging {family}"), buckets.len() as u64);
        let one = |number: usize| -> Result<Built, BuildError> {
            progress.go_on();
            let (places, columns) = partition.read(number)?;
            let bucket = Bucket::new(context, plan, number, places, columns);
            let lane = self.spill.lane(number);
            let of = |levels: &Purpose| {
                let mut pieces = Vec::new();
                let open = bucket.build(*levels, &mut |piece| {
                    pieces.push(self.keep(piece, number, &lane)?);
                    Ok::<_, BuildError>(())
                })?;
                Ok((pieces, open))
            };
            let built = context.options.levels().iter().map(of).collect::<Result<Built, BuildError>>()?;
            lane.close().map_err(|error| BuildError::temporary(self.spill, error))?;
            progress.advance(1);
            Ok(built)
        };
        let all = || buckets.into_par_iter().with_max_len(1).map(one).collect();
        if workers < rayon::current_num_threads() { super::pool(workers)?.install(all) } else { all() }
    }

    /// Puts a piece of a bucket away.
    fn keep(&self, piece: Piece<Words>, bucket: usize, spill: &Spill) -> Result<Piece<Option<Kept>>, BuildError> {
        self.progress.go_on();
        piece.map(|words| {
            let kept = Kept::put(words, self.plan.group(bucket), self.scaling, spill);
            kept.map(Some).map_err(|error| BuildError::temporary(spill, error))
        })
    }

    /// Puts what was built of all buckets, in their order, together to a tree for each kind of levels.
    ///
    /// # Errors
    /// When something cannot be put away.
    pub fn join(&self, built: impl IntoIterator<Item = Built>) -> Result<Vec<Grown>, BuildError> {
        let mut joiner = self.joiner();
        let nodes = joiner.add(built, self.plan.len())?;
        let trees = nodes.into_iter().zip(joiner.levels()).map(|(nodes, levels)| Tree { nodes, levels });
        let trees: Vec<Grown> = trees.collect();
        match trees.iter().any(|tree| tree.nodes.is_empty()) {
            // A stream without particles was refused before.
            true => Err(super::survey::column_error(self.family, "count", "at least one particle")),
            false => Ok(trees),
        }
    }
}

/// Codes the trees of a family: that for splats, that for volumes if there is one, and clusters if `clustering` says how. What the codes do
/// to `picture` is measured.
///
/// # Errors
/// When something cannot be put away or read back.
pub(super) fn code(
    family: FamilyName,
    trees: Vec<Grown>,
    clustering: Option<(&Context, ClusterOptions, Kernel)>,
    scaling: &Scaling,
    picture: Option<Picture>,
    spill: Spill,
    bits: CodeBits,
    progress: &dyn Progress,
) -> Result<CodedTrees, BuildError> {
    let temporary = |error| BuildError::temporary(&spill, error);
    let maker =
        clustering.map(|(context, options, kernel)| Maker { context, options, kernel, spill: &spill, progress });
    // Leaves are read before they are coded.
    let clusters =
        maker.as_ref().zip(trees.first()).map(|(maker, tree)| maker.make(tree)).transpose().map_err(temporary)?;
    let steps = trees.iter().map(|tree| tree.nodes.len() as u64 + 1).sum();
    progress.begin(&format!("coding {family}"), steps);
    let mut books = Books::default();
    let mut trees = trees.into_iter();
    let mut next = |levels: Purpose, splats: Option<&CodedTree>| -> Result<Option<CodedTree>, BuildError> {
        let Some(tree) = trees.next() else { return Ok(None) };
        let Tree { nodes, levels: about } = tree;
        let (draft, batches) = Draft::of(nodes, &spill, progress).map_err(temporary)?;
        let positions = |depth: usize, index: usize| draft.positions(depth, index);
        // Leaves that are shared were measured with the tree that has them.
        let picture = picture.as_ref().filter(|_| splats.is_none());
        let measured = picture.map(|picture| Measured { picture, positions: &positions });
        let coded = coding::code(&draft.nodes, batches, scaling, &spill, bits, scope(levels), measured, progress);
        Ok(Some(draft.coded((levels, about), coded.map_err(temporary)?, splats, bits, &mut books)))
    };
    let splats = next(Purpose::Splats, None)?
        .ok_or_else(|| super::survey::column_error(family, "count", "at least one particle"))?;
    let volume = next(Purpose::Samples, Some(&splats))?;
    let clusters = maker.as_ref().zip(clusters);
    let clusters = clusters.map(|(maker, clusters)| clusters.code(maker, &splats, scaling, bits.entries)).transpose();
    let clusters = clusters.map_err(temporary)?;
    Ok(CodedTrees { spill, splats, volume, clusters, books })
}

/// The scope of the grid nodes of a depth.
pub(super) fn scope(levels: Purpose) -> fn(u8) -> CodebookScope {
    match levels {
        Purpose::Splats => CodebookScope::Depth,
        Purpose::Samples | Purpose::Clusters => CodebookScope::VolumeDepth,
    }
}

/// The nodes of a tree, or some that follow each other at each depth; positions are sections as they will be stored, and there are no
/// quantities.
pub(super) struct Draft {
    /// The nodes.
    pub nodes: Vec<Vec<TreeNode<()>>>,
    positions: Vec<Vec<Option<Blob>>>,
}

portable!(Draft { nodes, positions });

impl Draft {
    /// Makes sections of positions; gives the quantities of each node, too, in batches that are still to be coded.
    ///
    /// # Errors
    /// When something cannot be put away or read back.
    pub fn of(nodes: Nodes, spill: &Spill, progress: &dyn Progress) -> std::io::Result<(Draft, Vec<Vec<Vec<Batch>>>)> {
        let mut all = Draft { nodes: Vec::new(), positions: Vec::new() };
        let mut batches: Vec<Vec<Vec<Batch>>> = Vec::with_capacity(nodes.len());
        for level in nodes {
            let one = |node| {
                progress.go_on();
                split(node, spill)
            };
            let level: Vec<_> = level.into_par_iter().map(one).collect::<Result<_, _>>()?;
            let (mut own_nodes, mut own_positions, mut own_batches) = (Vec::new(), Vec::new(), Vec::new());
            for (node, positions, batches) in level {
                own_nodes.push(node);
                // One after the other, so that it does not depend on threads where they are.
                own_positions.push(match positions {
                    Section::There(blob) => blob,
                    Section::New(section) => Some(spill.put(&[&section])?),
                });
                own_batches.push(batches);
            }
            all.nodes.push(own_nodes);
            all.positions.push(own_positions);
            batches.push(own_batches);
        }
        Ok((all, batches))
    }

    /// Where the section of positions of a node is.
    pub fn positions(&self, depth: usize, index: usize) -> Option<&Blob> {
        self.positions[depth][index].as_ref()
    }

    /// The nodes of each depth, and where their sections of positions are.
    pub fn into_levels(
        self,
    ) -> impl ExactSizeIterator<Item = (Vec<TreeNode<()>>, Vec<Option<Blob>>)> + DoubleEndedIterator {
        self.nodes.into_iter().zip(self.positions)
    }

    /// The tree of a kind and with these levels with its codes, whose leaves are those of `shared`, if that is there; appends its codebooks.
    pub fn coded(
        self,
        (kind, mut levels): (Purpose, Vec<LevelInfo>),
        mut coded: Coding,
        shared: Option<&CodedTree>,
        bits: CodeBits,
        books: &mut Books,
    ) -> CodedTree {
        let Draft { nodes, positions } = self;
        let before = books.codebooks.len() as u16;
        books.codebooks.append(&mut coded.codebooks);
        books.refinements.append(&mut coded.refinements);
        books.numbers.append(&mut coded.numbers);
        books.column_error = books.column_error.or(coded.column_error);
        if shared.is_some() {
            levels.iter_mut().for_each(without_leaves);
        }
        let mut planned: Vec<Vec<PlannedNode>> = Vec::with_capacity(nodes.len());
        let mut sections: Vec<Vec<NodeSections>> = Vec::with_capacity(nodes.len());
        for (depth, ((level, positions), coded)) in nodes.into_iter().zip(positions).zip(coded.nodes).enumerate().rev()
        {
            let mut own = Vec::with_capacity(level.len());
            let mut own_sections = Vec::with_capacity(level.len());
            for (index, ((draft, positions), coded)) in level.into_iter().zip(positions).zip(coded).enumerate() {
                if let Some(shared) = shared.filter(|_| draft.encoding == Encoding::Leaf) {
                    // Both trees have the same cells, in the same order.
                    own.push(shared.nodes[depth][index].clone());
                    own_sections.push(NodeSections::default());
                    continue;
                }
                let below = planned.last().map_or(&[][..], |level: &Vec<PlannedNode>| level);
                let children = draft.children.iter().flatten().filter_map(|&child| below.get(child));
                let lengths = children.map(|child| child.node.smoothing_length_max);
                own.push(PlannedNode {
                    sections: section_lengths(&draft, positions.as_ref(), bits),
                    children: draft.children,
                    node: stored(&draft, &coded, (kind, before), lengths),
                });
                own_sections.push(NodeSections::new(positions, coded));
            }
            planned.push(own);
            sections.push(own_sections);
        }
        planned.reverse();
        sections.reverse();
        CodedTree { nodes: planned, sections, levels }
    }
}

/// Takes the leaves, which are another tree's, off a level.
pub(super) fn without_leaves(level: &mut LevelInfo) {
    (level.leaf_nodes, level.leaf_particles) = (0, 0);
}

/// Bytes of a node's positions and of its codes.
pub(super) fn section_lengths(node: &TreeNode<()>, positions: Option<&Blob>, bits: CodeBits) -> (usize, usize) {
    let packing = bits.of(node.encoding == Encoding::Leaf);
    (positions.map_or(0, Blob::len), packing.packed_len(node.particles as usize).unwrap_or(0))
}

/// A node of a tree of a kind as it is stored, but for the places of its children, below which smoothing lengths are up to these. Its tree's
/// codebooks come after so many others.
pub(super) fn stored(
    node: &TreeNode<()>,
    coded: &CodedNode,
    (kind, before): (Purpose, u16),
    lengths: impl Iterator<Item = f32>,
) -> StoredNode {
    // Particles that were enlarged have lost density: only what coding has changed is made up for.
    let mass_density = match kind {
        Purpose::Splats => node.mass_density,
        Purpose::Samples | Purpose::Clusters => coded.true_mass_density,
    };
    StoredNode {
        key: node.key,
        encoding: node.encoding,
        codebook: before + coded.codebook,
        // Nodes with more are relays, and leaves with more were refused.
        particles: node.particles as u32,
        points: node.points as u32,
        source_particles: node.source_particles,
        delta: node.delta,
        bounds: node.bounds,
        smoothing_length_max: lengths.fold(node.smoothing_length_max.max(coded.smoothing_length_max), f32::max),
        mass: node.mass,
        mass_density: node.mass_density,
        mass_scale: scale(node.mass, coded.mass),
        mass_density_scale: scale(mass_density, coded.mass_density),
        children: [None; 8],
    }
}

/// The factor that turns `decoded` into `real`; 1 where rounding leaves nothing to scale.
pub(super) fn scale(real: f64, decoded: f64) -> f32 {
    let factor = (real / decoded) as f32;
    if factor.is_finite() && factor > 0.0 { factor } else { 1.0 }
}

/// A section of positions.
enum Section {
    /// It is put away already, if there is one.
    There(Option<Blob>),
    /// One that has been made of several pieces.
    New(Vec<u8>),
}

/// A node without its particles, its section of positions, and its batches.
fn split(node: TreeNode<Option<Kept>>, spill: &Spill) -> std::io::Result<(TreeNode<()>, Section, Vec<Batch>)> {
    let TreeNode { key, encoding, particles, points, source_particles, delta, bounds, .. } = node;
    let TreeNode { smoothing_length_max, mass, mass_density, children, data, .. } = node;
    let mut positions = None;
    let mut words: Vec<u32> = Vec::new();
    let mut batches = Vec::with_capacity(data.len());
    for kept in data.into_iter().flatten() {
        match kept.positions {
            Positions::Encoded(blob) => positions = Some(blob),
            Positions::Words(blob) => {
                words.extend_from_slice(bytemuck::cast_slice(&spill.get(&blob)?));
                spill.forget(blob);
            }
        }
        batches.push(kept.batch);
    }
    let mut positions = Section::There(positions);
    if !words.is_empty() {
        let mut section = Vec::with_capacity(3 * words.len());
        encode_grid(&words, &mut section);
        positions = Section::New(section);
    }
    let draft = TreeNode {
        key,
        encoding,
        particles,
        points,
        source_particles,
        delta,
        bounds,
        smoothing_length_max,
        mass,
        mass_density,
        children,
        data: Vec::new(),
    };
    Ok((draft, positions, batches))
}

impl Kept {
    fn put(words: Words, group: u32, scaling: &Scaling, spill: &Spill) -> std::io::Result<Kept> {
        let mut section = Vec::new();
        let (positions, columns, whole) = match &words {
            Words::Leaf(words, columns) => {
                encode_leaf(words, &mut section);
                (&section[..], columns, true)
            }
            Words::Grid(words, columns, true) => {
                encode_grid(words, &mut section);
                (&section[..], columns, true)
            }
            Words::Grid(words, columns, false) => (bytemuck::cast_slice(words), columns, false),
        };
        let blob = spill.put(&[positions])?;
        let positions = if whole { Positions::Encoded(blob) } else { Positions::Words(blob) };
        let quantities: Vec<&[u8]> = columns.iter().map(|column| bytemuck::cast_slice::<f32, u8>(column)).collect();
        let info = BatchInfo::of(&borrowed(columns));
        let density = if matches!(words, Words::Leaf(..)) { scaling.mean_density(&columns.density) } else { 0.0 };
        Ok(Kept { positions, batch: Batch { quantities: spill.put(&quantities)?, info, group, density } })
    }
}

impl Kept {
    /// The group of the bucket that it comes from.
    pub fn group(&self) -> u32 {
        self.batch.group
    }

    /// Hands out what a leaf holds: places as fractions of its cell, and quantities.
    pub fn leaf<R>(
        &self,
        node: &TreeNode<Option<Kept>>,
        spill: &Spill,
        read: impl FnOnce(&mut dyn Iterator<Item = [f32; 3]>, &Quantities) -> R,
    ) -> std::io::Result<R> {
        let (Positions::Encoded(blob) | Positions::Words(blob)) = &self.positions;
        let words = leaf_words(&spill.get(blob)?, node.points as usize, node.particles as usize)
            .map_err(std::io::Error::other)?;
        self.batch.with(spill, |quantities| read(&mut words.iter().map(|&word| unpack_leaf(word)), quantities))
    }
}

/// Columns as the quantiser takes them.
fn borrowed(columns: &Columns) -> Quantities<'_> {
    Quantities {
        mass: &columns.mass,
        density: &columns.density,
        smoothing_length: &columns.smoothing_length,
        attributes: columns.attributes.iter().map(Vec::as_slice).collect(),
    }
}

impl CodedTrees {
    /// A tree.
    fn tree(&self, levels: Purpose) -> &CodedTree {
        match (&self.volume, levels) {
            (Some(volume), Purpose::Samples) => volume,
            _ => &self.splats,
        }
    }

    /// The sections of a node, as they are stored.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn sections(&self, levels: Purpose, depth: usize, index: usize, bits: CodeBits) -> std::io::Result<Sections> {
        if let (Some(clusters), Purpose::Clusters) = (&self.clusters, levels) {
            return clusters.sections(&self.spill, depth, index);
        }
        let tree = self.tree(levels);
        tree.sections[depth][index].read(&tree.nodes[depth][index].node, &self.books.numbers, bits, &self.spill)
    }

    /// What could not be read or put away.
    pub fn failed(&self, error: std::io::Error) -> BuildError {
        BuildError::temporary(&self.spill, error)
    }

    /// Bytes in the temporary file.
    pub fn on_disk(&self) -> u64 {
        self.spill.on_disk()
    }
}
