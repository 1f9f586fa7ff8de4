//! Codebooks of a tree: leaves of similar density share one, and so do the grid nodes of a depth and kind of levels.
//!
//! Densities of a simulation span many decades, those inside one leaf few. With one codebook for all leaves most of its entries
//! are of no use to any one leaf; with several, each of its own range of densities, the same bits give much smaller
//! errors. Each costs `entries * (3 + attributes) * 4` bytes once.

mod books;

use super::column_error::{Pair, Picture};
use super::spill::{Blob, Spill};
use crate::codec::coordinates::unpack_leaf;
use crate::codec::positions::leaf_words;
use crate::codec::quantize::{Coded, Trained};
use crate::codec::{
    BatchInfo, Batches, CodeBits, Codebook, CodebookScope, Quantities, Quantized, Refinement, Scaling, VqBits, quantize,
};
use crate::hierarchy::octree::TreeNode;
use crate::hierarchy::{Encoding, NodeKey};
use crate::model::portable::{expect_that, portable};
use crate::model::progress::Progress;
pub(super) use books::{Book, Gathering, Part};
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
    /// The mean coordinate of densities, of leaves only: leaves of similar ones share a codebook.
    pub density: f32,
}

portable!(Batch { quantities, info, group, density });

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

/// A leaf that is drawn for the error of a picture: one of those that share a codebook, and the factor on its squares.
pub(super) struct Drawn {
    /// The codebook, among those of leaves.
    pub book: usize,
    /// Its number among those that share it.
    pub leaf: usize,
    factor: f64,
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
    let (leaves, grids): (Vec<Shared>, Vec<Shared>) =
        shared(nodes, batches, bits, scope).into_iter().partition(Shared::is_of_leaves);
    let mut coding = Coding::of(nodes);
    let code = |own: &Shared| own.code(scaling, spill, bits, progress);
    let coded: Vec<CodedBatches> = leaves.par_iter().map(code).collect::<Result<_, _>>()?;
    if let Some(measured) = measured {
        coding.column_error = measured.error(nodes, &leaves, &coded, spill, bits)?;
    }
    leaves.into_iter().zip(coded).try_for_each(|(own, coded)| coding.take(own, coded, spill))?;
    progress.advance(1);
    for own in grids {
        let coded = code(&own)?;
        coding.take(own, coded, spill)?;
        progress.advance(1);
    }
    Ok(coding)
}

/// Coded batches.
pub(super) type CodedBatches = Quantized<(Blob, usize)>;

/// A batch of a node.
pub(super) struct Entry {
    pub depth: usize,
    pub index: usize,
    pub batch: Batch,
}

portable!(Entry { depth, index, batch });

/// Batches that share a codebook, or a run of them.
pub(super) struct Shared {
    scope: CodebookScope,
    /// Codebooks that share the effort of training.
    books: usize,
    /// Batches before the first one.
    first: usize,
    entries: Vec<Entry>,
}

/// What shares a codebook, the leaves first, then the grid nodes of each depth, the deepest first.
pub(super) fn shared(
    nodes: &[Vec<TreeNode<()>>],
    batches: Vec<Vec<Vec<Batch>>>,
    bits: CodeBits,
    scope: impl Fn(u8) -> CodebookScope,
) -> Vec<Shared> {
    let mut leaves: Vec<Entry> = Vec::new();
    let mut grids: Vec<Vec<Entry>> = nodes.iter().map(|_| Vec::new()).collect();
    for (depth, level) in batches.into_iter().enumerate() {
        for (index, batches) in level.into_iter().enumerate() {
            let is_leaf = nodes[depth][index].encoding == Encoding::Leaf;
            let list = if is_leaf { &mut leaves } else { &mut grids[depth] };
            list.extend(batches.into_iter().map(|batch| Entry { depth, index, batch }));
        }
    }
    let groups = by_density(leaves, bits.entries);
    let books = groups.len();
    let leaves = groups.into_iter().map(|entries| Shared { scope: CodebookScope::Leaves, books, first: 0, entries });
    let grids = grids.into_iter().enumerate().rev().filter(|(_, entries)| !entries.is_empty());
    let grids = grids.map(|(depth, mut entries)| {
        // Those of a node stay in their order.
        entries.sort_by_key(|entry| entry.batch.group);
        Shared { scope: scope(depth as u8), books: 1, first: 0, entries }
    });
    leaves.chain(grids).collect()
}

/// Codebooks that leaves with so many particles share, unless there are fewer leaves.
pub(super) fn leaf_books(particles: u64, bits: VqBits) -> u64 {
    (particles / PARTICLES).clamp(1, (ENTRIES / bits.entries()).max(1) as u64)
}

/// The codebook of each leaf, the thinnest first, of which these are the particles: of each about as many. Some may have no leaf.
fn books_by_density(particles: impl Iterator<Item = u64> + Clone, bits: VqBits) -> impl Iterator<Item = usize> {
    let total: u64 = particles.clone().sum();
    let count = leaf_books(total, bits);
    let mut before = 0;
    particles.map(move |particles| {
        let share = (before + particles / 2) * count / total.max(1);
        before += particles;
        share.min(count - 1) as usize
    })
}

/// Leaves in groups of about the same number of particles and of similar mean density.
fn by_density(leaves: Vec<Entry>, bits: VqBits) -> Vec<Vec<Entry>> {
    let mut order: Vec<(f32, usize)> = leaves.iter().map(|leaf| leaf.batch.density).zip(0..).collect();
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut books = vec![0; leaves.len()];
    let particles = order.iter().map(|&(_, leaf)| leaves[leaf].batch.info.particles as u64);
    let most = order.iter().zip(books_by_density(particles, bits)).map(|(&(_, leaf), book)| {
        books[leaf] = book;
        book + 1
    });
    let mut groups: Vec<Vec<Entry>> = (0..most.max().unwrap_or(0)).map(|_| Vec::new()).collect();
    leaves.into_iter().zip(books).for_each(|(leaf, book)| groups[book].push(leaf));
    groups.retain(|group| !group.is_empty());
    // By the groups of buckets, and in the order of the tree: neighbours on the disk are read together.
    let order = |entry: &Entry| (entry.batch.group, entry.depth, entry.index);
    groups.iter_mut().for_each(|group| group.sort_unstable_by_key(order));
    groups
}

impl Shared {
    /// Whether these are leaves.
    pub fn is_of_leaves(&self) -> bool {
        self.scope == CodebookScope::Leaves
    }

    /// Copies the quantities of all batches to where the coding will look for them.
    ///
    /// # Errors
    /// When something cannot be put away or read back.
    pub fn copy(&mut self, from: &Spill, to: &Spill) -> io::Result<()> {
        self.entries.par_iter_mut().try_for_each(|Entry { batch, .. }| {
            let bytes = from.get(&batch.quantities)?;
            let copy = to.put(&[&bytes])?;
            drop(bytes);
            batch.quantities = copy;
            Ok(())
        })
    }

    /// The batches, and where they are.
    pub fn group<'a>(&'a self, spill: &'a Spill, bits: CodeBits, progress: &'a dyn Progress) -> Group<'a> {
        Group { entries: &self.entries, first: self.first, spill, bits: bits.of(self.is_of_leaves()), progress }
    }

    /// Trains the quantiser; where a code of a leaf has more bits than an entry's number it is refined.
    ///
    /// # Errors
    /// When something cannot be read back.
    pub fn train(&self, scaling: &Scaling, group: &Group<'_>, bits: CodeBits) -> io::Result<Trained> {
        Trained::of(group, scaling, bits.entries, self.scope, self.books, group.bits != bits.entries)
    }

    /// Trains the codebook and codes the batches; where a code of a leaf has more bits than an entry's number it is refined.
    ///
    /// # Errors
    /// When something cannot be put away or read back.
    pub fn code(
        &self,
        scaling: &Scaling,
        spill: &Spill,
        bits: CodeBits,
        progress: &dyn Progress,
    ) -> io::Result<CodedBatches> {
        let group = self.group(spill, bits, progress);
        quantize(&group, scaling, bits.entries, self.scope, self.books, group.bits != bits.entries)
    }
}

/// Batches that share a codebook, and where they are.
pub(super) struct Group<'a> {
    entries: &'a [Entry],
    /// Batches before the first of them.
    first: usize,
    spill: &'a Spill,
    /// Those of a code.
    bits: VqBits,
    progress: &'a dyn Progress,
}

impl Measured<'_> {
    /// The error of the picture by the codes of leaves; `None` where it has nothing.
    ///
    /// # Errors
    /// When something cannot be read back.
    fn error(
        &self,
        nodes: &[Vec<TreeNode<()>>],
        shared: &[Shared],
        coded: &[CodedBatches],
        spill: &Spill,
        bits: CodeBits,
    ) -> io::Result<Option<f64>> {
        let books: Vec<usize> = shared.iter().map(|own| own.entries.len()).collect();
        let about = shared.iter().flat_map(|own| &own.entries).map(|entry| (entry.depth, entry.batch.info.mass));
        let squares = |drawn: &Drawn| {
            let (entry, coded) = (&shared[drawn.book].entries[drawn.leaf], &coded[drawn.book]);
            let leaf = Leaf {
                entry,
                node: &nodes[entry.depth][entry.index],
                positions: (self.positions)(entry.depth, entry.index),
                decoded: &coded.batches[drawn.leaf],
            };
            drawn.squares(self.picture, &leaf, coded, spill, bits)
        };
        let drawn = drawn(self.picture, &books, about);
        let squares: Vec<[f64; 2]> = drawn.par_iter().map(squares).collect::<Result<_, _>>()?;
        Ok(picture_error(squares))
    }
}

/// The leaves to draw, of which these are depth and mass, in the order of the codebooks that so many share each.
pub(super) fn drawn(picture: &Picture, books: &[usize], about: impl Iterator<Item = (usize, f64)>) -> Vec<Drawn> {
    // Of a cell its size counts.
    let cell = |(depth, mass): (usize, f64)| (NodeKey { depth: depth as u8, ..NodeKey::ROOT }, mass);
    let drawn = |(number, factor): (usize, f64)| {
        let (mut book, mut leaf) = (0, number);
        while book + 1 < books.len() && leaf >= books[book] {
            leaf -= books[book];
            book += 1;
        }
        Drawn { book, leaf, factor }
    };
    picture.chosen(about.map(cell)).into_iter().map(drawn).collect()
}

/// A leaf that was coded.
pub(super) struct Leaf<'a> {
    pub entry: &'a Entry,
    pub node: &'a TreeNode<()>,
    /// Where its section of positions is.
    pub positions: Option<&'a Blob>,
    pub decoded: &'a Coded<(Blob, usize)>,
}

impl Drawn {
    /// The squares of the leaf, which was coded with others as `coded` says.
    ///
    /// # Errors
    /// When something cannot be read back.
    pub fn squares(
        &self,
        picture: &Picture,
        &Leaf { entry, node, positions, decoded }: &Leaf<'_>,
        coded: &CodedBatches,
        spill: &Spill,
        bits: CodeBits,
    ) -> io::Result<[f64; 2]> {
        let Some(positions) = positions else { return Ok([0.0; 2]) };
        let batch = &entry.batch;
        let group = Group { entries: std::slice::from_ref(entry), first: 0, spill, bits: bits.of(true), progress: &() };
        let section = spill.get(positions)?;
        let words = leaf_words(&section, node.points as usize, node.particles as usize)
            .map_err(|expected| spill.damaged(positions, &format!("positions: found others, expected {expected}")))?;
        let codes = group.codes(&decoded.codes, 0, coded.codes())?;
        // As the mode weighs it: so that the leaf's mass is its own.
        let scale = super::tree::scale(batch.info.mass, decoded.mass);
        let squares = batch.with(spill, |own| {
            let pairs = words.iter().zip(&codes).enumerate().map(|(i, (&word, &code))| {
                let entry = usize::from(coded.numbers[usize::from(code)]);
                let book = &coded.codebook;
                Pair {
                    place: unpack_leaf(word),
                    own: [own.mass[i], own.smoothing_length[i]],
                    decoded: [scale * book.mass[entry], book.smoothing_length[entry]],
                }
            });
            picture.squares(node.key, batch.info.mass, pairs)
        })?;
        Ok(squares.map(|sum| sum * self.factor))
    }
}

/// The error of a picture by the squares of the leaves that are drawn, in their order; `None` where it has nothing.
pub(super) fn picture_error(squares: impl IntoIterator<Item = [f64; 2]>) -> Option<f64> {
    let add = |sum: [f64; 2], own: [f64; 2]| [sum[0] + own[0], sum[1] + own[1]];
    let [difference, picture] = squares.into_iter().fold([0.0; 2], add);
    Some((difference / picture).sqrt()).filter(|error| error.is_finite())
}

impl Batch {
    /// Whether it has as many values as particles in so many columns; else what was expected.
    pub fn check(&self, columns: usize) -> Result<(), String> {
        let BatchInfo { particles, mass, mass_density } = self.info;
        let bytes = particles.checked_mul(columns * size_of::<f32>());
        expect_that(bytes == Some(self.quantities.len()), "quantities", "those of a batch's particles")?;
        expect_that(mass.is_finite() && mass_density.is_finite(), "mass", "a finite sum")
    }

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

impl Group<'_> {
    fn batch(&self, batch: usize) -> &Batch {
        &self.entries[batch - self.first].batch
    }
}

impl Batches for Group<'_> {
    type Error = io::Error;
    type Kept = (Blob, usize);

    fn len(&self) -> usize {
        self.entries.len()
    }

    fn info(&self, batch: usize) -> BatchInfo {
        self.batch(batch).info
    }

    fn group(&self, batch: usize) -> u32 {
        self.batch(batch).group
    }

    fn with<R>(&self, batch: usize, read: impl FnOnce(&Quantities) -> R) -> io::Result<R> {
        self.go_on();
        self.batch(batch).with(self.spill, read)
    }

    fn go_on(&self) {
        self.progress.go_on();
    }

    fn keep(&self, codes: Vec<u16>) -> io::Result<(Blob, usize)> {
        let mut bytes = Vec::with_capacity(self.bits.packed_len(codes.len()).unwrap_or(0));
        self.bits.pack(&codes, &mut bytes);
        Ok((self.spill.put(&[&bytes])?, codes.len()))
    }

    fn codes(&self, (blob, count): &(Blob, usize), batch: usize, end: usize) -> io::Result<Vec<u16>> {
        let particles = self.batch(batch).info.particles;
        if *count != particles || self.bits.packed_len(particles) != Some(blob.len()) {
            let what = format!("codes: found {count} in {} bytes, expected {particles}", blob.len());
            return Err(self.spill.damaged(blob, &what));
        }
        let bytes = self.spill.get(blob)?;
        let mut codes = Vec::with_capacity(particles);
        self.bits.unpack(&bytes, particles, &mut codes);
        match codes.iter().all(|code| usize::from(*code) < end) {
            true => Ok(codes),
            false => Err(self.spill.damaged(blob, &format!("codes: found others, expected some below {end}"))),
        }
    }

    fn forget(&self, kept: (Blob, usize)) {
        self.spill.forget(kept.0);
    }
}

impl CodedNode {
    /// Adds a batch, coded.
    pub fn add(&mut self, batch: &Batch, coded: Coded<(Blob, usize)>) {
        self.codes.push(coded.codes);
        self.mass += coded.mass;
        self.mass_density += coded.mass_density;
        self.true_mass_density += batch.info.mass_density;
        self.smoothing_length_max = self.smoothing_length_max.max(coded.smoothing_length_max);
    }
}

impl Coding {
    /// No code yet.
    pub fn of(nodes: &[Vec<TreeNode<()>>]) -> Coding {
        Coding {
            nodes: nodes.iter().map(|level| level.iter().map(|_| CodedNode::default()).collect()).collect(),
            codebooks: Vec::new(),
            refinements: Vec::new(),
            numbers: Vec::new(),
            column_error: None,
        }
    }

    /// Takes what comes next in the order of [`shared`]; its quantities are forgotten.
    ///
    /// # Errors
    /// Where it is of nodes that are not there.
    pub fn take(&mut self, shared: Shared, coded: CodedBatches, spill: &Spill) -> io::Result<()> {
        let number = self.codebooks.len() as u16;
        for (Entry { depth, index, batch }, coded) in shared.entries.into_iter().zip(coded.batches) {
            let node = self.nodes.get_mut(depth).and_then(|level| level.get_mut(index));
            let unknown =
                || io::Error::other(format!("node: found number {index} of depth {depth}, expected one of the tree"));
            let node = node.ok_or_else(unknown)?;
            node.codebook = number;
            node.add(&batch, coded);
            spill.forget(batch.quantities);
        }
        self.codebooks.push(coded.codebook);
        self.refinements.extend(coded.refinement);
        self.numbers.push(coded.numbers);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ReadMethod;

    /// However many a forged number says that there are.
    #[test]
    fn codes_are_those_that_their_bytes_hold() {
        let folder = tempfile::tempdir().unwrap();
        let spill = Spill::new(&folder.path().join("out"), folder.path(), 1 << 10, ReadMethod::default());
        let info = BatchInfo { particles: 3, ..BatchInfo::default() };
        let batch = Batch { quantities: spill.put(&[]).unwrap(), info, group: 0, density: 0.0 };
        let entries = [Entry { depth: 0, index: 0, batch }];
        for bits in [VqBits::Eight, VqBits::Twelve, VqBits::Sixteen] {
            let group = Group { entries: &entries, first: 0, spill: &spill, bits, progress: &() };
            let mut kept = group.keep(vec![1, 200, 3]).unwrap();
            assert_eq!(group.codes(&kept, 0, 201).unwrap(), [1, 200, 3]);
            assert!(group.codes(&kept, 0, 200).is_err());
            for forged in [0, 2, 4, usize::MAX] {
                kept.1 = forged;
                assert!(group.codes(&kept, 0, 201).is_err(), "{bits:?}: {forged}");
            }
            let fewer = group.keep(vec![1, 200]).unwrap();
            assert!(group.codes(&(fewer.0, 3), 0, 201).is_err(), "{bits:?}");
        }
    }
}
