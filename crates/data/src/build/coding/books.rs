//! What shares a codebook of a tree whose nodes come bit by bit: batches are put away as they come, and sorted out once it is known which share
//! one, a group of buckets at a time. So of no batch more is held than what decides that.

use super::super::spill::{Blob, Spill};
use super::{Batch, Entry, Shared, books_by_density};
use crate::codec::quantize::{group_parts, parts_of_each};
use crate::codec::{CodebookScope, VqBits};
use crate::hierarchy::Encoding;
use crate::hierarchy::cell::MAX_DEPTH;
use crate::hierarchy::octree::TreeNode;
use crate::model::portable::{Portable, expect, expect_that, expect_within, portable, total};
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::ops::Range;

/// What shares a codebook: where its batches are, a run for each group, and the parts that can be coded by themselves.
pub(in crate::build) struct Book {
    scope: CodebookScope,
    /// Codebooks that share the effort of training.
    books: usize,
    runs: Vec<Blob>,
    /// Those of a group follow each other.
    pub parts: Vec<Part>,
}

portable!(Book { scope, books, runs, parts });

/// Batches that can be coded by themselves, all of one group.
#[derive(PartialEq)]
pub(in crate::build) struct Part {
    pub group: u32,
    pub particles: u64,
    pub batches: Range<usize>,
}

portable!(Part { group, particles, batches });

/// The parts of batches of a group, of which these are the particles, behind `first` others; a group has about `each`.
fn parts(
    first: usize,
    group: u32,
    particles: impl ExactSizeIterator<Item = usize> + Clone,
    each: usize,
) -> impl Iterator<Item = Part> {
    let mut rest = particles.clone();
    group_parts(first, particles, each).into_iter().map(move |batches| {
        let particles = rest.by_ref().take(batches.len()).map(|own| own as u64).sum();
        Part { group, particles, batches }
    })
}

/// Particles of each of some batches.
fn particles(entries: &[Entry]) -> impl ExactSizeIterator<Item = usize> + Clone {
    entries.iter().map(|entry| entry.batch.info.particles)
}

impl Book {
    /// Whether it is of leaves.
    pub fn is_of_leaves(&self) -> bool {
        self.scope == CodebookScope::Leaves
    }

    /// Number of batches.
    pub fn batches(&self) -> usize {
        self.parts.last().map_or(0, |part| part.batches.end)
    }

    /// The parts of each run, and where its batches are.
    pub fn runs(&self) -> impl Iterator<Item = (&[Part], &Blob)> {
        self.groups().zip(&self.runs)
    }

    /// Bytes by which the batches are told of.
    pub fn bytes(&self) -> u64 {
        total(self.runs.iter().map(|run| run.len() as u64))
    }

    /// The run that a part is of: its parts, and where its batches are.
    pub fn run_around(&self, part: usize) -> Option<(&[Part], &Blob)> {
        let group = self.parts.get(part)?.group;
        self.runs().find(|(parts, _)| parts.iter().any(|own| own.group == group))
    }

    /// Where batches are.
    pub fn blobs(self) -> Vec<Blob> {
        self.runs
    }

    fn groups(&self) -> impl Iterator<Item = &[Part]> {
        self.parts.chunk_by(|a, b| a.group == b.group)
    }

    /// Whether parts follow each other, and there is a run for each group; else what was found and expected.
    pub fn check(&self) -> Result<(), String> {
        expect("runs of batches", self.runs.len(), self.groups().count())?;
        expect_that(self.parts.is_sorted_by_key(|part| part.group), "parts", "those of each group together, in order")?;
        let mut end = 0;
        self.parts.iter().try_for_each(|part| {
            expect("first batch of a part", part.batches.start, end)?;
            end = part.batches.end;
            Ok(())
        })
    }

    /// Whether batches have the values that they tell of, so many columns, and together at most `most` particles; and whether they make these
    /// parts of a run; else what was found and expected.
    pub fn check_run(&self, own: &[Part], entries: &[Entry], columns: usize, most: u64) -> Result<(), String> {
        entries.iter().try_for_each(|entry| {
            expect_within("depth of a batch", entry.depth as u64, 0..=u64::from(MAX_DEPTH))?;
            entry.batch.check(columns)
        })?;
        expect_within("particles", total(particles(entries).map(|own| own as u64)), 0..=most)?;
        let (first, group) = own.first().map_or((0, 0), |part| (part.batches.start, part.group));
        let are_of_group = entries.iter().all(|entry| entry.batch.group == group);
        let made: Vec<Part> = parts(first, group, particles(entries), parts_of_each(self.runs.len())).collect();
        expect_that(are_of_group && made[..] == *own, "parts", "those that batches make")
    }

    /// Batches, behind `first` others, that share the codebook.
    pub fn shared(&self, first: usize, entries: Vec<Entry>) -> Shared {
        Shared { scope: self.scope, books: self.books, first, entries }
    }
}

/// The batches of a tree's nodes as they come.
#[derive(Default)]
pub(in crate::build) struct Gathering {
    leaves: Vec<LeafBatch>,
    /// Nodes of each depth that have come.
    nodes: Vec<usize>,
    /// Depths that have batches of other nodes, each with the groups of these.
    grids: BTreeSet<(usize, u32)>,
    /// Where the batches of each group are.
    put: BTreeMap<u32, Vec<Blob>>,
}

/// What decides with which others a leaf shares a codebook.
struct LeafBatch {
    density: f32,
    particles: u32,
    index: u32,
    depth: u8,
    group: u8,
}

/// In place of the codebook of a leaf: another node.
const NO_LEAF: u16 = u16::MAX;

impl Gathering {
    /// Bytes that are held of a node at a time at most: what decides, in a list that has just grown, and the number of a codebook.
    pub const HELD: u64 = 2 * size_of::<LeafBatch>() as u64 + size_of::<u16>() as u64;

    /// Puts the batches of nodes away that follow those before them at each depth.
    ///
    /// # Errors
    /// When the disk takes no more.
    pub fn add(&mut self, nodes: &[Vec<TreeNode<()>>], batches: Vec<Vec<Vec<Batch>>>, near: &Spill) -> io::Result<()> {
        self.nodes.resize(nodes.len().max(self.nodes.len()), 0);
        let mut by_group: BTreeMap<u32, Vec<Entry>> = BTreeMap::new();
        for (depth, (level, batches)) in nodes.iter().zip(batches).enumerate() {
            for (index, (node, batches)) in (self.nodes[depth]..).zip(level.iter().zip(batches)) {
                for batch in batches {
                    let group = batch.group;
                    if node.encoding == Encoding::Leaf {
                        self.leaves.push(LeafBatch {
                            density: batch.density,
                            // Those of a node are counted by as many bits, as nodes of a depth are, and groups are few.
                            particles: batch.info.particles as u32,
                            index: index as u32,
                            depth: depth as u8,
                            group: group as u8,
                        });
                    } else {
                        self.grids.insert((depth, group));
                    }
                    by_group.entry(group).or_default().push(Entry { depth, index, batch });
                }
            }
            self.nodes[depth] += level.len();
        }
        for (group, entries) in by_group {
            self.put.entry(group).or_default().push(near.put(&[&entries.bytes()])?);
        }
        Ok(())
    }

    /// Bytes of the batches of the group that has most of them.
    pub fn largest(&self) -> u64 {
        let bytes = |blobs: &Vec<Blob>| blobs.iter().map(|blob| blob.len() as u64).sum();
        self.put.values().map(bytes).max().unwrap_or(0)
    }

    /// What shares a codebook, in the order of [`super::shared`], put from `near` to `spill`.
    ///
    /// # Errors
    /// When something cannot be put away or read back.
    pub fn books(
        self,
        near: &Spill,
        spill: &Spill,
        bits: VqBits,
        scope: impl Fn(u8) -> CodebookScope,
    ) -> io::Result<Vec<Book>> {
        let Gathering { leaves, nodes, grids, put } = self;
        let (numbers, groups) = numbered(leaves, &nodes, bits);
        let growing = |scope: CodebookScope, books: usize, groups: usize| Growing {
            book: Book { scope, books, runs: Vec::new(), parts: Vec::new() },
            each: parts_of_each(groups),
        };
        let mut books: Vec<Growing> =
            groups.iter().map(|own| growing(CodebookScope::Leaves, groups.len(), own.len())).collect();
        let mut place_of_depth: BTreeMap<usize, usize> = BTreeMap::new();
        for depth in (0..nodes.len()).rev() {
            let groups = grids.range((depth, 0)..(depth + 1, 0)).count();
            if groups > 0 {
                place_of_depth.insert(depth, books.len());
                books.push(growing(scope(depth as u8), 1, groups));
            }
        }
        let unknown = || io::Error::other("batches: found others, expected those that were put away");
        for (group, blobs) in put {
            let mut entries: Vec<Entry> = Vec::new();
            for blob in blobs {
                let bytes = near.get(&blob)?;
                entries.extend(Vec::<Entry>::of_bytes(&bytes).ok_or_else(unknown)?);
                drop(bytes);
                near.forget(blob);
            }
            // Those of a node stay in their order.
            entries.sort_by_key(|entry| (entry.depth, entry.index));
            let mut runs: Vec<Vec<Entry>> = books.iter().map(|_| Vec::new()).collect();
            for entry in entries {
                let place = match numbers[entry.depth][entry.index] {
                    NO_LEAF => *place_of_depth.get(&entry.depth).ok_or_else(unknown)?,
                    number => usize::from(number),
                };
                runs[place].push(entry);
            }
            let mut own = books.iter_mut().zip(runs).filter(|(_, run)| !run.is_empty());
            own.try_for_each(|(growing, run)| growing.add(group, run, spill))?;
        }
        Ok(books.into_iter().map(|growing| growing.book).collect())
    }
}

/// The number of the codebook of each leaf, by depth and index; and the groups that leaves of each codebook are of.
fn numbered(mut leaves: Vec<LeafBatch>, nodes: &[usize], bits: VqBits) -> (Vec<Vec<u16>>, Vec<BTreeSet<u8>>) {
    let mut numbers: Vec<Vec<u16>> = nodes.iter().map(|count| vec![NO_LEAF; *count]).collect();
    let mut groups: Vec<BTreeSet<u8>> = Vec::new();
    let place = |leaf: &LeafBatch| (leaf.depth, leaf.index);
    leaves.sort_unstable_by(|a, b| a.density.total_cmp(&b.density).then(place(a).cmp(&place(b))));
    let particles = leaves.iter().map(|leaf| u64::from(leaf.particles));
    let mut last = None;
    for (leaf, book) in leaves.iter().zip(books_by_density(particles, bits)) {
        // They come in order; those without leaves are left out.
        if last != Some(book) {
            last = Some(book);
            groups.push(BTreeSet::new());
        }
        if let Some(groups) = groups.last_mut() {
            groups.insert(leaf.group);
        }
        numbers[usize::from(leaf.depth)][leaf.index as usize] = (groups.len() - 1) as u16;
    }
    (numbers, groups)
}

/// What shares a codebook while runs of its batches come.
struct Growing {
    book: Book,
    /// Parts of each group, about.
    each: usize,
}

impl Growing {
    fn add(&mut self, group: u32, run: Vec<Entry>, spill: &Spill) -> io::Result<()> {
        let first = self.book.batches();
        self.book.parts.extend(parts(first, group, particles(&run), self.each));
        self.book.runs.push(spill.put(&[&run.bytes()])?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BatchInfo, shared};
    use super::*;
    use crate::build::cluster::Parts;
    use crate::codec::CodeBits;
    use crate::hierarchy::NodeKey;
    use crate::model::{Bounds, ReadMethod};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn node(depth: usize, encoding: Encoding) -> TreeNode<()> {
        TreeNode {
            key: NodeKey { depth: depth as u8, ..NodeKey::ROOT },
            encoding,
            particles: 0,
            points: 0,
            source_particles: 0,
            delta: 0.0,
            bounds: Bounds::EMPTY,
            smoothing_length_max: 0.0,
            mass: 0.0,
            mass_density: 0.0,
            children: [None; 8],
            data: Vec::new(),
        }
    }

    /// Nodes of each depth: whether it is a leaf, and the group, the particles and the density of each of its batches.
    type Made = Vec<Vec<(bool, Vec<(u32, usize, f32)>)>>;

    /// What is held of this task alone.
    fn near(folder: &tempfile::TempDir) -> Spill {
        Spill::new(&folder.path().join("out"), folder.path(), 1 << 20, ReadMethod::default())
    }

    proptest! {
        /// However nodes come, and however little is held of them.
        #[test]
        fn gathered_batches_share_codebooks_as_those_of_a_whole_tree(
            made in prop::collection::vec(
                prop::collection::vec((any::<bool>(), prop::collection::vec((0..5_u32, 1..40_000_usize, 0..9_u8), 1..4)), 0..20),
                1..4,
            ),
            cut in 0..20_usize,
        ) {
            let made: Made = made.into_iter().map(|level| level.into_iter().map(|(is_leaf, batches)| {
                let batches = batches.into_iter().map(|(group, particles, density)| (group, particles, f32::from(density)));
                let count = if is_leaf { 1 } else { 4 };
                let mut batches: Vec<(u32, usize, f32)> = batches.take(count).collect();
                // A node's pieces are in order.
                batches.sort_by_key(|(group, ..)| *group);
                (is_leaf, batches)
            }).collect()).collect();
            // What tells a batch from others is where its quantities are.
            let mut number = 0;
            let folder = tempfile::tempdir().unwrap();
            let spill = Spill::of_parts(Arc::new(Parts::of_one(folder.path()).unwrap()));
            let mut all: Vec<Vec<(TreeNode<()>, Vec<u64>, Vec<(u32, usize, f32)>)>> = Vec::new();
            for (depth, level) in made.into_iter().enumerate() {
                all.push(level.into_iter().map(|(is_leaf, batches)| {
                    let names = batches.iter().map(|_| { number += 1; number }).collect();
                    (node(depth, if is_leaf { Encoding::Leaf } else { Encoding::Grid }), names, batches)
                }).collect());
            }
            let batch = |name: u64, (group, particles, density): (u32, usize, f32)| Batch {
                quantities: spill.put(&[&name.to_le_bytes()]).unwrap(),
                info: BatchInfo { particles, ..BatchInfo::default() },
                group,
                density,
            };
            let of = |range: &dyn Fn(usize) -> Range<usize>| {
                let (mut nodes, mut batches) = (Vec::new(), Vec::new());
                for level in &all {
                    let own = &level[range(level.len())];
                    nodes.push(own.iter().map(|(node, ..)| node.clone()).collect::<Vec<_>>());
                    let made = own.iter().map(|(_, names, made)| {
                        names.iter().zip(made).map(|(name, made)| batch(*name, *made)).collect::<Vec<_>>()
                    });
                    batches.push(made.collect::<Vec<_>>());
                }
                (nodes, batches)
            };
            let names = |entries: &[Entry]| -> Vec<Vec<u8>> {
                entries.iter().map(|entry| spill.get(&entry.batch.quantities).unwrap().to_vec()).collect()
            };
            let (nodes, batches) = of(&|len| 0..len);
            let expected = shared(&nodes, batches, CodeBits::plain(VqBits::Eight), CodebookScope::Depth);
            let mut gathering = Gathering::default();
            let near = near(&folder);
            let halves: [&dyn Fn(usize) -> Range<usize>; 2] = [&|len: usize| 0..len.min(cut), &|len: usize| len.min(cut)..len];
            for half in halves {
                let (nodes, batches) = of(half);
                gathering.add(&nodes, batches, &near).unwrap();
            }
            let books = gathering.books(&near, &spill, VqBits::Eight, CodebookScope::Depth).unwrap();
            prop_assert_eq!(books.len(), expected.len());
            for (book, expected) in books.iter().zip(&expected) {
                prop_assert_eq!((book.scope, book.books), (expected.scope, expected.books));
                prop_assert_eq!(book.check(), Ok(()));
                let mut found: Vec<Vec<u8>> = Vec::new();
                for (own, blob) in book.runs() {
                    let entries = Vec::<Entry>::of_bytes(&spill.get(blob).unwrap()).unwrap();
                    // The names are no quantities.
                    prop_assert!(book.check_run(own, &entries, 3, u64::MAX).unwrap_err().starts_with("quantities"));
                    prop_assert!(own[0].batches.start == found.len());
                    found.extend(names(&entries));
                }
                prop_assert_eq!(&found, &names(&expected.entries));
                // As one machine cuts them.
                let about = expected.entries.iter().map(|entry| (entry.batch.group, entry.batch.info.particles));
                let ranges = crate::codec::quantize::parts(&about.collect::<Vec<_>>());
                prop_assert!(book.parts.iter().map(|part| part.batches.clone()).eq(ranges));
            }
        }
    }
}
