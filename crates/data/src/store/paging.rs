//! Which node goes into which page (F12 4.8.1), and writing a tree's pages.
//!
//! A page begins with the children of one parent and is filled breadth-first with nodes below them while they fit. Where
//! that leaves it half empty, the next families of siblings that hang below the same parent page join it, so that
//! shallow subtrees do not end as pages of a few kilobytes. Siblings that are together larger than a page are spread over
//! several.
//!
//! Levels for volumes and clusters are further trees over the same leaves. Their inner nodes have pages of their own, which come first:
//! so every child comes after its parents in all trees.

mod sizes;

use super::error::StoreError;
use super::layout::{PAGE_HEADER_LEN, StoredNode, particles_memory};
use super::page::{Encoding, NodeRef, PageId};
use super::writer::{PageFileWriter, PageNode, encode_page, node_bytes};
use crate::hierarchy::Purpose;
use crate::model::progress::Progress;
use rayon::prelude::*;
pub use sizes::{PageSize, Placed, TreeSizes};
use std::collections::VecDeque;

/// Bytes that a page aims at (F12 4.8.1) unless a build says otherwise; only a page of a single node may be longer.
pub const PAGE_BYTES: usize = 3 << 20;

/// A node of a tree that is to be written.
#[derive(Clone, Debug)]
pub struct PlannedNode {
    /// The node, without its children.
    pub node: StoredNode,
    /// Its children: indices into the nodes of the next depth. None for clusters of a leaf, whose child is the leaf of the same depth and
    /// index.
    pub children: [Option<usize>; 8],
    /// Bytes of its positions and of its codes.
    pub sections: (usize, usize),
}

impl PlannedNode {
    fn bytes(&self) -> usize {
        node_bytes(self.sections.0, self.sections.1)
    }
}

/// The particles of a node as they are stored.
#[derive(Clone, Debug, Default)]
pub struct Sections {
    /// Encoded positions ([`crate::codec::positions`]).
    pub positions: Vec<u8>,
    /// Packed codes.
    pub codes: Vec<u8>,
}

/// A node of the tree: depth and index.
type Place = (usize, usize);

/// Siblings that wait for a page, and the number of the page that holds their parent.
struct Group {
    members: Vec<Place>,
    parent_page: Option<usize>,
}

/// What decides which page a node is in.
trait Nodes {
    /// Bytes that a node takes.
    fn bytes(&self, place: Place) -> usize;
    /// Its children.
    fn children(&self, place: Place) -> impl Iterator<Item = Place>;
    /// Whether it is a leaf.
    fn is_leaf(&self, place: Place) -> bool;
}

impl Nodes for [Vec<PlannedNode>] {
    fn bytes(&self, (depth, index): Place) -> usize {
        self[depth][index].bytes()
    }

    fn children(&self, (depth, index): Place) -> impl Iterator<Item = Place> {
        self[depth][index].children.iter().flatten().map(move |&child| (depth + 1, child))
    }

    fn is_leaf(&self, (depth, index): Place) -> bool {
        self[depth][index].node.encoding == Encoding::Leaf
    }
}

/// Hands out the nodes of each page of about `page_bytes`, in order, as far as they are `own`. Parents come before children.
fn plan(
    nodes: &(impl Nodes + ?Sized),
    page_bytes: usize,
    own: impl Fn(Place) -> bool,
    mut sink: impl FnMut(Vec<Place>),
) {
    let bytes = |place: &Place| nodes.bytes(*place);
    let children = |place: Place| -> Vec<Place> { nodes.children(place).filter(|place| own(*place)).collect() };
    let mut pages = 0;
    let mut waiting = VecDeque::new();
    if own((0, 0)) {
        waiting.push_back(Group { members: vec![(0, 0)], parent_page: None });
    }
    while let Some(mut group) = waiting.pop_front() {
        let mut page = Vec::new();
        let mut len = 0;
        // Siblings that do not fit go on waiting, at the front.
        let fitting = group.members.iter().take_while(|member| {
            len += bytes(member);
            len <= page_bytes
        });
        let fitting = fitting.count().max(1);
        let rest = group.members.split_off(fitting);
        if !rest.is_empty() {
            waiting.push_front(Group { members: rest, parent_page: group.parent_page });
        }
        len = group.members.iter().map(bytes).sum();
        page.append(&mut group.members);
        let mut next = 0;
        loop {
            // Breadth-first below what the page holds.
            while next < page.len() {
                let below = children(page[next]);
                next += 1;
                let more: usize = below.iter().map(bytes).sum();
                if below.is_empty() {
                    continue;
                }
                if len + more <= page_bytes {
                    len += more;
                    page.extend(below);
                } else {
                    waiting.push_back(Group { members: below, parent_page: Some(pages) });
                }
            }
            let joins = |other: &Group| {
                other.parent_page == group.parent_page
                    && other.parent_page.is_some()
                    && len + other.members.iter().map(bytes).sum::<usize>() <= page_bytes
            };
            if len > page_bytes / 2 || !waiting.front().is_some_and(joins) {
                break;
            }
            let Some(other) = waiting.pop_front() else { break };
            len += other.members.iter().map(bytes).sum::<usize>();
            page.extend(other.members);
        }
        sink(page);
        pages += 1;
    }
}

/// Where a tree was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The page of its root.
    pub root_page: PageId,
    /// Bytes of each depth's own nodes.
    pub bytes: Vec<u64>,
}

/// A tree on its way to the file: its nodes, the nodes of each of its pages, and where every node will be.
pub struct Paged<'a> {
    /// What its inner nodes are for.
    pub purpose: Purpose,
    nodes: &'a [Vec<PlannedNode>],
    pages: Vec<Vec<Place>>,
    first: u32,
    places: Vec<Vec<NodeRef>>,
    /// Those of the tree that has the leaves, where this one does not.
    leaves: Vec<Vec<NodeRef>>,
}

impl<'a> Paged<'a> {
    /// A tree whose pages begin with number `first`; `leaves` has the places of nodes that belong to another tree.
    fn new(
        purpose: Purpose,
        nodes: &'a [Vec<PlannedNode>],
        pages: Vec<Vec<Place>>,
        first: u32,
        leaves: Vec<Vec<NodeRef>>,
    ) -> Paged<'a> {
        let mut places = leaves.clone();
        for (number, page) in pages.iter().enumerate() {
            for (i, &(depth, index)) in page.iter().enumerate() {
                places[depth][index] = NodeRef { page: PageId(first + number as u32), node: i as u32 };
            }
        }
        Paged { purpose, nodes, pages, first, places, leaves }
    }

    fn written(&self, own: impl Fn(&PlannedNode) -> bool) -> Written {
        let of = |level: &Vec<PlannedNode>| level.iter().filter(|node| own(node)).map(|node| node.bytes() as u64).sum();
        Written { root_page: self.places[0][0].page, bytes: self.nodes.iter().map(of).collect() }
    }

    /// Number of its pages.
    pub fn len(&self) -> usize {
        self.pages.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.pages.is_empty()
    }

    /// Its page `page`, counted from 0, and the nodes in it, as they are stored, each with its depth and index.
    pub fn page(&self, page: usize) -> (PageId, impl Iterator<Item = (StoredNode, Place)>) {
        let nodes = self.pages[page].iter().map(|&(depth, index)| {
            let planned = &self.nodes[depth][index];
            let below = self.places.get(depth + 1).map_or(&[][..], Vec::as_slice);
            let mut children = planned.children.map(|child| child.map(|child| below[child]));
            if planned.node.encoding == Encoding::LeafClusters {
                children[0] = Some(self.leaves[depth][index]);
            }
            (StoredNode { children, ..planned.node.clone() }, (depth, index))
        });
        (PageId(self.first + page as u32), nodes)
    }

    /// Bytes that a page takes.
    pub fn page_bytes(&self, page: usize) -> u64 {
        let nodes = self.pages[page].iter().map(|&(depth, index)| self.nodes[depth][index].bytes() as u64);
        PAGE_HEADER_LEN as u64 + nodes.sum::<u64>()
    }
}

/// The trees of a family, which have the same cells.
#[derive(Clone, Copy, Debug)]
pub struct FamilyTrees<'a> {
    /// The one for splats, with the leaves.
    pub splats: &'a [Vec<PlannedNode>],
    /// Whether its other nodes are written, too.
    pub has_octree: bool,
    /// Further ones.
    pub others: &'a [(Purpose, &'a [Vec<PlannedNode>])],
}

impl<'a> FamilyTrees<'a> {
    /// The trees in the order of their pages, which aim at `page_bytes` and begin with number `first`; and where each is, that for splats
    /// first.
    pub fn paged(&self, mut first: u32, page_bytes: usize) -> (Vec<Paged<'a>>, Vec<Written>) {
        let is_inner = |node: &PlannedNode| node.node.encoding != Encoding::Leaf;
        let own = |node: &PlannedNode| self.has_octree || !is_inner(node);
        let others = self.others.iter().map(|(purpose, nodes)| {
            let mut pages = Vec::new();
            plan(*nodes, page_bytes, |place| !nodes.is_leaf(place), |page| pages.push(page));
            let from = first;
            first += pages.len() as u32;
            (*purpose, *nodes, pages, from)
        });
        let others: Vec<_> = others.collect();
        let mut splat_pages = Vec::new();
        match self.has_octree {
            true => plan(self.splats, page_bytes, |_| true, |page| splat_pages.push(page)),
            false => splat_pages = leaf_pages(self.splats, page_bytes),
        }
        let nowhere =
            self.splats.iter().map(|level| vec![NodeRef { page: PageId(first), node: 0 }; level.len()]).collect();
        let splats = Paged::new(Purpose::Splats, self.splats, splat_pages, first, nowhere);
        let mut trees: Vec<Paged<'a>> = others
            .into_iter()
            .map(|(purpose, nodes, pages, from)| Paged::new(purpose, nodes, pages, from, splats.places.clone()))
            .collect();
        let written = std::iter::once(splats.written(own)).chain(trees.iter().map(|tree| tree.written(is_inner)));
        let written = written.collect();
        trees.push(splats);
        (trees, written)
    }
}

/// Appends the pages of a family's trees to a file. Pages aim at `page_bytes`; `sections` gives the particles of the node of a depth and
/// index. Where the trees were written, that for splats first.
///
/// # Errors
/// When the file cannot be written; those of `sections`.
pub fn write_trees<E: From<StoreError> + Send>(
    writer: &mut PageFileWriter,
    family: u32,
    trees: FamilyTrees<'_>,
    page_bytes: usize,
    sections: impl Fn(Purpose, usize, usize) -> Result<Sections, E> + Sync,
    progress: &dyn Progress,
) -> Result<Vec<Written>, E> {
    let (trees, written) = trees.paged(writer.page_count(), page_bytes);
    progress.begin("writing pages", trees.iter().map(|tree| tree.len() as u64).sum());
    for tree in &trees {
        append(writer, family, tree, &sections, progress)?;
    }
    Ok(written)
}

/// Pages of leaves alone, neighbours together.
fn leaf_pages(nodes: &[Vec<PlannedNode>], page_bytes: usize) -> Vec<Vec<Place>> {
    let mut pages: Vec<Vec<Place>> = Vec::new();
    let mut held = usize::MAX;
    let mut waiting = vec![(0, 0)];
    while let Some((depth, index)) = waiting.pop() {
        let node = &nodes[depth][index];
        if node.node.encoding != Encoding::Leaf {
            waiting.extend(node.children.iter().rev().flatten().map(|&child| (depth + 1, child)));
            continue;
        }
        let bytes = node.bytes();
        if held.saturating_add(bytes) > page_bytes {
            pages.push(Vec::new());
            held = 0;
        }
        held += bytes;
        if let Some(page) = pages.last_mut() {
            page.push((depth, index));
        }
    }
    pages
}

/// Appends the pages of a tree.
fn append<E: From<StoreError> + Send>(
    writer: &mut PageFileWriter,
    family: u32,
    tree: &Paged,
    sections: &(impl Fn(Purpose, usize, usize) -> Result<Sections, E> + Sync),
    progress: &dyn Progress,
) -> Result<(), E> {
    // Some pages at a time: memory for them is needed.
    let pages: Vec<usize> = (0..tree.len()).collect();
    for batch in pages.chunks(2 * rayon::current_num_threads()) {
        let encode = |&page: &usize| {
            let (id, nodes) = tree.page(page);
            let records = nodes.map(|(node, (depth, index))| Ok((node, sections(tree.purpose, depth, index)?)));
            Ok(EncodedPage::new(id, family, &records.collect::<Result<Vec<_>, E>>()?))
        };
        let encoded: Vec<Option<EncodedPage>> = batch.par_iter().map(encode).collect::<Result<_, E>>()?;
        for page in encoded {
            let EncodedPage { nodes, memory, bytes } = page.ok_or_else(|| writer.unwritable(TOO_LONG))?;
            writer.append(family, nodes, memory, &bytes)?;
            progress.advance(1);
        }
    }
    Ok(())
}

/// Why a page cannot be written.
pub const TOO_LONG: &str = "a page would be longer than 4 GiB";

/// A page as bytes, and what the table of pages says of it.
pub struct EncodedPage {
    /// Number of its nodes.
    pub nodes: u32,
    /// Bytes that its particles take in memory.
    pub memory: u64,
    /// Its bytes, without the zeros that align the next one.
    pub bytes: Vec<u8>,
}

impl EncodedPage {
    /// A page with these nodes; `None` where it would be longer than 4 GiB.
    pub fn new(id: PageId, family: u32, records: &[(StoredNode, Sections)]) -> Option<EncodedPage> {
        let page: Vec<PageNode> = records.iter().map(|(node, sections)| PageNode { node, sections }).collect();
        let memory = records.iter().map(|(node, _)| particles_memory(node.encoding, node.particles)).sum();
        Some(EncodedPage { nodes: records.len() as u32, memory, bytes: encode_page(id, family, &page)? })
    }
}
