//! Codebooks of a tree: leaves of similar density share one, and so do the grid nodes of a depth and kind of levels.
//!
//! Densities of a simulation span many decades, those inside one leaf few. With one codebook for all leaves most of its entries
//! are of no use to any one leaf; with several, each of its own range of densities, the same bits give much smaller
//! errors. Each costs `entries * (3 + attributes) * 4` bytes once.

use super::column_error::{Pair, Picture};
use super::spill::{Blob, Spill};
use crate::codec::coordinates::unpack_leaf;
use crate::codec::positions::decode_leaf;
use crate::codec::{
    BatchInfo, Batches, CodeBits, Codebook, CodebookScope, Quantities, Quantized, Refinement, Scaling, VqBits, quantize,
};
use crate::hierarchy::Encoding;
use crate::hierarchy::octree::TreeNode;
use crate::model::progress::Progress;
use rayon::prelude::*;
use std::io;

/// Leaf particles for each codebook at least: with 8 bits the entries of one take a fortieth of the space of so many.
const PARTICLES: u64 = 1 << 14;

/// Entries of all leaf codebooks of a family at most, for bits that allow several, lines where codes are refined; they stay in the GPU's
/// memory, a line as 16 entries.
const ENTRIES: usize = 1 << 12;

/// Particles whose quantities have been put away: one column after the other.
#[derive(Debug)]
pub(super) struct Batch {
    pub quantities: Blob,
    pub info: BatchInfo,
    /// That of the bucket that it comes from: [`crate::hierarchy::octree::Plan::group`].
    pub group: u32,
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
    /// How the lines of those of the leaves run, where codes are refined.
    pub refinements: Vec<Refinement>,
    /// The entry of each code, for each codebook.
    pub numbers: Vec<Vec<u16>>,
    /// Error of the picture that was asked for, relative to it.
    pub column_error: Option<f64>,
}

/// A picture whose error is asked for, and where the sections of the leaves' positions are, by depth and index.
pub(super) struct Measured<'a> {
    pub picture: &'a Picture,
    pub positions: &'a (dyn Fn(usize, usize) -> Option<&'a Blob> + Sync),
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
    bits: CodeBits,
    scope: impl Fn(u8) -> CodebookScope,
    measured: Option<Measured<'_>>,
    progress: &dyn Progress,
) -> io::Result<Coding> {
    let mut coding = Coding {
        nodes: nodes.iter().map(|level| level.iter().map(|_| CodedNode::default()).collect()).collect(),
        codebooks: Vec::new(),
        refinements: Vec::new(),
        numbers: Vec::new(),
        column_error: None,
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
    let groups = by_density(leaves, scaling, spill, bits.entries, progress)?;
    let count = groups.len();
    let coded: Vec<_> = groups
        .par_iter()
        .map(|group| {
            let group = Group { entries: group, scaling, spill, bits: bits.leaves, progress };
            group.code(bits.entries, CodebookScope::Leaves, count)
        })
        .collect::<Result<_, _>>()?;
    if let Some(measured) = measured {
        let group = |entries| Group { entries, scaling, spill, bits: bits.leaves, progress };
        let groups: Vec<_> = groups.iter().map(|entries| group(&entries[..])).zip(&coded).collect();
        coding.column_error = measured.error(nodes, &groups)?;
    }
    for (group, coded) in groups.into_iter().zip(coded) {
        coding.take(group, coded, spill);
    }
    progress.advance(1);
    for (depth, mut entries) in grids.into_iter().enumerate().rev() {
        if !entries.is_empty() {
            // Those of a node stay in their order.
            entries.sort_by_key(|entry| entry.batch.group);
            let group = Group { entries: &entries, scaling, spill, bits: bits.entries, progress };
            let coded = group.code(bits.entries, scope(depth as u8), 1)?;
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
fn by_density(
    leaves: Vec<Entry>,
    scaling: &Scaling,
    spill: &Spill,
    bits: VqBits,
    progress: &dyn Progress,
) -> io::Result<Vec<Vec<Entry>>> {
    let total: u64 = leaves.iter().map(|leaf| leaf.batch.info.particles as u64).sum();
    let count = (total / PARTICLES).clamp(1, (ENTRIES / bits.entries()).max(1) as u64);
    let group = Group { entries: &leaves, scaling, spill, bits, progress };
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
    // By the groups of buckets, and in the order of the tree: neighbours on the disk are read together.
    let order = |entry: &Entry| (entry.batch.group, entry.depth, entry.index);
    groups.iter_mut().for_each(|group| group.sort_unstable_by_key(order));
    Ok(groups)
}

/// Batches that share a codebook.
struct Group<'a> {
    entries: &'a [Entry],
    scaling: &'a Scaling,
    spill: &'a Spill,
    /// Those of a code.
    bits: VqBits,
    progress: &'a dyn Progress,
}

impl Group<'_> {
    /// Codes the batches with entries of so many bits; where a code has more it is refined.
    fn code(&self, entries: VqBits, scope: CodebookScope, books: usize) -> io::Result<Quantized<(Blob, usize)>> {
        quantize(self, self.scaling, entries, scope, books, self.bits != entries)
    }
}

impl Measured<'_> {
    /// The error of the picture by the codes of leaves; `None` where it has nothing.
    fn error(
        &self,
        nodes: &[Vec<TreeNode<()>>],
        groups: &[(Group<'_>, &Quantized<(Blob, usize)>)],
    ) -> io::Result<Option<f64>> {
        let leaves: Vec<(usize, usize)> = (0..groups.len())
            .flat_map(|group| (0..groups[group].0.entries.len()).map(move |leaf| (group, leaf)))
            .collect();
        let about = |&(group, leaf): &(usize, usize)| {
            let Entry { depth, index, batch } = &groups[group].0.entries[leaf];
            (nodes[*depth][*index].key, batch.info.mass)
        };
        let squares: Vec<[f64; 2]> = self
            .picture
            .chosen(leaves.iter().map(about))
            .par_iter()
            .map(|&(number, factor)| -> io::Result<[f64; 2]> {
                let (group, leaf) = leaves[number];
                Ok(self.squares(nodes, &groups[group], leaf)?.map(|sum| sum * factor))
            })
            .collect::<Result<_, _>>()?;
        let [difference, picture] = squares.iter().fold([0.0; 2], |sum, own| [sum[0] + own[0], sum[1] + own[1]]);
        let error = (difference / picture).sqrt();
        Ok(error.is_finite().then_some(error))
    }

    /// [`Picture::squares`] of a leaf of a group.
    fn squares(
        &self,
        nodes: &[Vec<TreeNode<()>>],
        (group, coded): &(Group<'_>, &Quantized<(Blob, usize)>),
        leaf: usize,
    ) -> io::Result<[f64; 2]> {
        let (Entry { depth, index, batch }, decoded) = (&group.entries[leaf], &coded.batches[leaf]);
        let node = &nodes[*depth][*index];
        let Some(positions) = (self.positions)(*depth, *index) else { return Ok([0.0; 2]) };
        let mut words = vec![0_u64; node.particles as usize];
        decode_leaf(&group.spill.get(positions)?, node.points as usize, &mut words).map_err(io::Error::other)?;
        let codes = group.codes(&decoded.codes)?;
        // As the mode weighs it: so that the leaf's mass is its own.
        let scale = super::tree::scale(batch.info.mass, decoded.mass);
        batch.with(group.spill, |own| {
            let pairs = words.iter().zip(&codes).enumerate().map(|(i, (&word, &code))| {
                let entry = usize::from(coded.numbers[usize::from(code)]);
                let book = &coded.codebook;
                Pair {
                    place: unpack_leaf(word),
                    own: [own.mass[i], own.smoothing_length[i]],
                    decoded: [scale * book.mass[entry], book.smoothing_length[entry]],
                }
            });
            self.picture.squares(node.key, batch.info.mass, pairs)
        })
    }
}

impl Batch {
    /// Reads the quantities.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn with<R>(&self, spill: &Spill, read: impl FnOnce(&Quantities) -> R) -> io::Result<R> {
        let Batch { quantities, info, .. } = self;
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

    fn group(&self, batch: usize) -> u32 {
        self.entries[batch].batch.group
    }

    fn with<R>(&self, batch: usize, read: impl FnOnce(&Quantities) -> R) -> io::Result<R> {
        self.go_on();
        self.entries[batch].batch.with(self.spill, read)
    }

    fn go_on(&self) {
        self.progress.go_on();
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

    fn forget(&self, kept: (Blob, usize)) {
        self.spill.forget(kept.0);
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
        self.refinements.extend(coded.refinement);
        self.numbers.push(coded.numbers);
    }
}
