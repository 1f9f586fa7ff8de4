//! Codebooks of a tree: leaves of similar density share one, and so do the grid nodes of a depth and kind of levels.
//!
//! Densities of a simulation span many decades, those inside one leaf few. With one codebook for all leaves most of its entries
//! are of no use to any one leaf; with several, each of its own range of densities, the same bits give much smaller
//! errors. Each costs `entries * (3 + attributes) * 4` bytes once.

use super::spill::{Blob, Spill};
use crate::codec::{BatchInfo, Batches, Codebook, CodebookScope, Quantities, Quantized, Scaling, VqBits, quantize};
use crate::hierarchy::Encoding;
use crate::hierarchy::octree::TreeNode;
use crate::model::progress::Progress;
use rayon::prelude::*;
use std::io;

/// Leaf particles for each codebook at least: with 8 bits the entries of one take a fortieth of the space of so many.
const PARTICLES: u64 = 1 << 14;

/// Entries of all leaf codebooks of a family at most, for bits that allow several; they stay in the GPU's memory.
const ENTRIES: usize = 1 << 12;

/// Particles whose quantities have been put away: one column after the other.
#[derive(Debug)]
pub(super) struct Batch {
    pub quantities: Blob,
    pub info: BatchInfo,
}

/// The codes of a node and what they decode to.
#[derive(Debug, Default)]
pub(super) struct CodedNode {
    /// Index of its codebook.
    pub codebook: u16,
    /// Its codes in runs, and their numbers.
    pub codes: Vec<(Blob, usize)>,
    /// Sum of the decoded masses.
    pub mass: f64,
    /// Sum of the decoded `m rho`.
    pub mass_density: f64,
    /// Sum of the `m rho` that were coded.
    pub true_mass_density: f64,
    /// Largest decoded smoothing length.
    pub smoothing_length_max: f32,
}

/// All nodes, coded.
pub(super) struct Coding {
    /// By depth, as the tree's.
    pub nodes: Vec<Vec<CodedNode>>,
    /// Those of the leaves first, the thinnest first, then one for each depth that has grid nodes, the deepest first.
    pub codebooks: Vec<Codebook>,
    /// The entry of each code, for each codebook.
    pub numbers: Vec<Vec<u16>>,
}

/// Codes all nodes, the grid nodes of each depth for its `scope`; the quantities are forgotten.
///
/// # Errors
/// When something cannot be put away or read back.
pub(super) fn code(
    nodes: &[Vec<TreeNode<()>>],
    batches: Vec<Vec<Vec<Batch>>>,
    scaling: &Scaling,
    spill: &Spill,
    bits: VqBits,
    scope: impl Fn(u8) -> CodebookScope,
    progress: &dyn Progress,
) -> io::Result<Coding> {
    let mut coding = Coding {
        nodes: nodes.iter().map(|level| level.iter().map(|_| CodedNode::default()).collect()).collect(),
        codebooks: Vec::new(),
        numbers: Vec::new(),
    };
    let mut leaves: Vec<Entry> = Vec::new();
    let mut grids: Vec<Vec<Entry>> = nodes.iter().map(|_| Vec::new()).collect();
    for (depth, level) in batches.into_iter().enumerate() {
        for (index, batches) in level.into_iter().enumerate() {
            let is_leaf = nodes[depth][index].encoding == Encoding::Leaf;
            let list = if is_leaf { &mut leaves } else { &mut grids[depth] };
            list.extend(batches.into_iter().map(|batch| Entry { depth, index, batch }));
        }
    }
    let groups = by_density(leaves, scaling, spill, bits)?;
    let count = groups.len();
    let coded: Vec<_> = groups
        .par_iter()
        .map(|group| Group { entries: group, scaling, spill, bits }.code(CodebookScope::Leaves, count))
        .collect::<Result<_, _>>()?;
    for (group, coded) in groups.into_iter().zip(coded) {
        coding.take(group, coded, spill);
    }
    progress.advance(1);
    for (depth, entries) in grids.into_iter().enumerate().rev() {
        if !entries.is_empty() {
            let coded = Group { entries: &entries, scaling, spill, bits }.code(scope(depth as u8), 1)?;
            coding.take(entries, coded, spill);
        }
        progress.advance(1);
    }
    Ok(coding)
}

/// A batch of a node.
struct Entry {
    depth: usize,
    index: usize,
    batch: Batch,
}

/// Leaves in groups of about the same number of particles and of similar mean density.
fn by_density(leaves: Vec<Entry>, scaling: &Scaling, spill: &Spill, bits: VqBits) -> io::Result<Vec<Vec<Entry>>> {
    let total: u64 = leaves.iter().map(|leaf| leaf.batch.info.particles as u64).sum();
    let count = (total / PARTICLES).clamp(1, (ENTRIES / bits.entries()).max(1) as u64);
    let group = Group { entries: &leaves, scaling, spill, bits };
    let densities: Vec<f32> = (0..leaves.len())
        .into_par_iter()
        .map(|leaf| group.with(leaf, |quantities| scaling.mean_density(quantities.density)))
        .collect::<Result<_, _>>()?;
    let mut order: Vec<(f32, usize)> = densities.into_iter().zip(0..).collect();
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut leaves: Vec<Option<Entry>> = leaves.into_iter().map(Some).collect();
    let mut groups: Vec<Vec<Entry>> = (0..count).map(|_| Vec::new()).collect();
    let mut before = 0;
    for (_, leaf) in order {
        let Some(entry) = leaves[leaf].take() else { continue };
        let particles = entry.batch.info.particles as u64;
        let share = (before + particles / 2) * count / total.max(1);
        groups[share.min(count - 1) as usize].push(entry);
        before += particles;
    }
    groups.retain(|group| !group.is_empty());
    // In the order of the tree: neighbours on the disk are read together.
    groups.iter_mut().for_each(|group| group.sort_unstable_by_key(|entry| (entry.depth, entry.index)));
    Ok(groups)
}

/// Batches that share a codebook.
struct Group<'a> {
    entries: &'a [Entry],
    scaling: &'a Scaling,
    spill: &'a Spill,
    bits: VqBits,
}

impl Group<'_> {
    fn code(&self, scope: CodebookScope, books: usize) -> io::Result<Quantized<(Blob, usize)>> {
        quantize(self, self.scaling, self.bits, scope, books)
    }
}

impl Batch {
    /// Reads the quantities.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn with<R>(&self, spill: &Spill, read: impl FnOnce(&Quantities) -> R) -> io::Result<R> {
        let Batch { quantities, info } = self;
        let bytes = spill.get(quantities)?;
        let values: &[f32] = bytemuck::cast_slice(&bytes);
        let column = |k: usize| &values[k * info.particles..(k + 1) * info.particles];
        let columns = values.len() / info.particles.max(1);
        Ok(read(&Quantities {
            mass: column(0),
            density: column(1),
            smoothing_length: column(2),
            attributes: (3..columns).map(column).collect(),
        }))
    }
}

impl Batches for Group<'_> {
    type Error = io::Error;
    type Kept = (Blob, usize);

    fn len(&self) -> usize {
        self.entries.len()
    }

    fn info(&self, batch: usize) -> BatchInfo {
        self.entries[batch].batch.info
    }

    fn with<R>(&self, batch: usize, read: impl FnOnce(&Quantities) -> R) -> io::Result<R> {
        self.entries[batch].batch.with(self.spill, read)
    }

    fn keep(&self, codes: Vec<u16>) -> io::Result<(Blob, usize)> {
        let mut bytes = Vec::with_capacity(self.bits.packed_len(codes.len()).unwrap_or(0));
        self.bits.pack(&codes, &mut bytes);
        Ok((self.spill.put(&[&bytes])?, codes.len()))
    }

    fn codes(&self, kept: &(Blob, usize)) -> io::Result<Vec<u16>> {
        let mut codes = Vec::with_capacity(kept.1);
        self.bits.unpack(&self.spill.get(&kept.0)?, kept.1, &mut codes);
        Ok(codes)
    }
}

impl Coding {
    fn take(&mut self, entries: Vec<Entry>, coded: Quantized<(Blob, usize)>, spill: &Spill) {
        let number = self.codebooks.len() as u16;
        for (entry, coded) in entries.into_iter().zip(coded.batches) {
            let node = &mut self.nodes[entry.depth][entry.index];
            node.codebook = number;
            node.codes.push(coded.codes);
            node.mass += coded.mass;
            node.mass_density += coded.mass_density;
            node.true_mass_density += entry.batch.info.mass_density;
            node.smoothing_length_max = node.smoothing_length_max.max(coded.smoothing_length_max);
            spill.forget(entry.batch.quantities);
        }
        self.codebooks.push(coded.codebook);
        self.numbers.push(coded.numbers);
    }
}
