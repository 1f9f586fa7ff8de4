//! The leaves that are drawn to tell what codes do to a picture: few of all, each read where it lies.

use super::pages::NODES;
use super::tables::BATCH;
use super::*;
use crate::build::coding::{Drawn, Leaf, drawn};
use crate::build::column_error::Picture;
use crate::hierarchy::Encoding;
use crate::hierarchy::octree::TreeNode;
use std::collections::BTreeSet;

/// A leaf that is drawn.
pub(super) struct DrawnLeaf {
    drawn: Drawn,
    entry: Entry,
    node: TreeNode<()>,
    /// Where its section of positions is.
    positions: Option<Blob>,
}

impl DrawnLeaf {
    /// The codebook that it shares, among those of its tree.
    pub fn book(&self) -> usize {
        self.drawn.book
    }
}

/// Depth and mass of a leaf.
type About = (usize, f64);

impl Joined {
    /// Bytes that are held at most while the leaves to draw are chosen and read: what is known of each leaf, in a list that has just grown; and
    /// a run of batches, or the nodes that were whole with a group of buckets.
    pub(super) fn held_by_drawing(&self) -> u64 {
        let books = || self.books.iter().filter(|book| book.is_of_leaves());
        let leaves = total(books().map(|book| book.batches() as u64));
        let len = |blob: &Blob| blob.len() as u64;
        let run = books().flat_map(|book| book.runs()).map(|(_, run)| len(run)).max().unwrap_or(0);
        let nodes = self.drafts.iter().map(len).max().unwrap_or(0);
        let read = run.saturating_mul(BATCH).max(nodes.saturating_mul(NODES));
        leaves.saturating_mul(2 * size_of::<About>() as u64).saturating_add(read)
    }
}

impl Task<'_> {
    /// The leaves of a tree to draw.
    pub(super) fn drawn_leaves(
        &self,
        spill: &Spill,
        tree: &Joined,
        scaled: &Scaled,
        picture: &Picture,
    ) -> Result<Vec<DrawnLeaf>, BuildError> {
        let books: Vec<&Book> = tree.books.iter().take_while(|book| book.is_of_leaves()).collect();
        let mut about: Vec<About> = Vec::new();
        for book in &books {
            for (parts, blob) in book.runs() {
                let entries = self.run_of(spill, scaled, book, parts, blob)?;
                about.extend(entries.iter().map(|entry| (entry.depth, entry.batch.info.mass)));
            }
        }
        let leaves: Vec<usize> = books.iter().map(|book| book.batches()).collect();
        let entry = |drawn: Drawn| {
            let book = books[drawn.book];
            let is_own = |(parts, _): &(&[Part], &Blob)| parts.iter().any(|part| part.batches.contains(&drawn.leaf));
            let (parts, blob) =
                book.runs().find(is_own).ok_or_else(|| self.unsound("fewer leaves than were counted"))?;
            let entries = self.run_of(spill, scaled, book, parts, blob)?;
            let place = drawn.leaf - parts[0].batches.start;
            let entry = entries.into_iter().nth(place);
            Ok((drawn, entry.ok_or_else(|| self.unsound("fewer leaves than were counted"))?))
        };
        let drawn = drawn(picture, &leaves, about.into_iter());
        let drawn = drawn.into_iter().map(entry).collect::<Result<Vec<(Drawn, Entry)>, BuildError>>()?;
        let mut nodes = self.nodes_at(spill, tree, drawn.iter().map(|(_, entry)| (entry.depth, entry.index)))?;
        let leaf = |(drawn, entry): (Drawn, Entry)| {
            let own = nodes.remove(&(entry.depth, entry.index));
            let is_own = |(node, _): &(TreeNode<()>, Option<Blob>)| {
                node.encoding == Encoding::Leaf && node.particles == entry.batch.info.particles as u64
            };
            let Some((node, positions)) = own.filter(is_own) else {
                return Err(self.damaged("join", 0, "batch: found that of another node, expected one of a leaf"));
            };
            Ok(DrawnLeaf { drawn, entry, node, positions })
        };
        drawn.into_iter().map(leaf).collect()
    }

    /// Some nodes of a tree, by depth and index, and where their sections of positions are.
    fn nodes_at(
        &self,
        spill: &Spill,
        tree: &Joined,
        places: impl Iterator<Item = (usize, usize)>,
    ) -> Result<BTreeMap<(usize, usize), (TreeNode<()>, Option<Blob>)>, BuildError> {
        let places: BTreeSet<(usize, usize)> = places.collect();
        let (mut found, mut checked) = (BTreeMap::new(), Checked::default());
        for blob in &tree.drafts {
            let before: Vec<usize> = checked.nodes().collect();
            let draft = self.next_draft(spill, blob, &mut checked)?;
            for (depth, (nodes, positions)) in draft.into_levels().enumerate() {
                let first = before.get(depth).copied().unwrap_or(0);
                let own = (first..).zip(nodes.into_iter().zip(positions));
                let own = own.map(|(index, node)| ((depth, index), node));
                found.extend(own.filter(|(place, _)| places.contains(place)));
            }
        }
        Ok(found)
    }

    /// The squares of a leaf that is drawn, which was coded with others.
    pub(super) fn leaf_squares(
        &self,
        spill: &Spill,
        picture: &Picture,
        DrawnLeaf { drawn, entry, node, positions }: &DrawnLeaf,
        book: &Book,
        coded: &CodedBook,
    ) -> Result<[f64; 2], BuildError> {
        let own = book.parts.iter().zip(&coded.parts).find(|(part, _)| part.batches.contains(&drawn.leaf));
        let (part, blob) = own.ok_or_else(|| self.unsound("fewer leaves than were coded"))?;
        let batches = self.coded_part(spill, part, blob)?;
        let decoded = &batches[drawn.leaf - part.batches.start];
        let leaf = Leaf { entry, node, positions: positions.as_ref(), decoded };
        let squares = drawn.squares(picture, &leaf, &coded.book, spill, self.options.octree.code_bits());
        squares.map_err(|error| BuildError::temporary(spill, error))
    }
}
