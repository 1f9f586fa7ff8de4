//! Where the nodes of trees will be that are not held: a few bytes of each decide that.

use super::{Nodes, Place, Written, node_bytes, plan};
use crate::store::layout::PAGE_HEADER_LEN;
use crate::store::page::{NodeRef, PageId};

/// A page that is planned: its bytes and nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageSize {
    /// Bytes that it takes.
    pub bytes: u64,
    /// Number of its nodes.
    pub nodes: u32,
}

/// What decides which page each node of a tree is in.
#[derive(Clone, Debug, Default)]
pub struct TreeSizes {
    depths: Vec<Vec<NodeSize>>,
    /// Children of the nodes of each depth so far.
    children: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct NodeSize {
    bytes: usize,
    /// Its children follow each other from this one on.
    first: u32,
    children: u8,
    is_leaf: bool,
}

/// Where each node of a tree will be.
#[derive(Clone, Debug)]
pub struct Placed {
    /// By depth, in order.
    pub places: Vec<Vec<NodeRef>>,
    /// What is told of it.
    pub written: Written,
}

impl TreeSizes {
    /// Bytes that are held of a node at most while pages are planned: its size, in a list that has just grown, its place, and what waits for
    /// a page.
    pub const HELD: u64 =
        2 * size_of::<NodeSize>() as u64 + size_of::<NodeRef>() as u64 + 2 * size_of::<Place>() as u64;

    /// Adds the node of a depth that comes next; its positions and codes take so many bytes, and its children are those that come next, too.
    pub fn add(&mut self, depth: usize, sections: (usize, usize), children: usize, is_leaf: bool) {
        while self.depths.len() <= depth {
            self.depths.push(Vec::new());
            self.children.push(0);
        }
        let first = self.children[depth];
        self.depths[depth].push(NodeSize {
            bytes: node_bytes(sections.0, sections.1),
            first,
            // Of at most eight.
            children: children as u8,
            is_leaf,
        });
        self.children[depth] = first + children as u32;
    }

    /// Plans the pages of a family's trees, that for splats, and maybe another one over its leaves with the same cells, as
    /// [`super::FamilyTrees::paged`] does; they follow `pages`. Where the nodes are, those of the tree for splats first.
    pub fn placed(self, other: Option<TreeSizes>, page_bytes: usize, pages: &mut Vec<PageSize>) -> Vec<Placed> {
        let other = other.map(|tree| {
            let places = tree.paged(|place| !tree.is_leaf(place), page_bytes, pages);
            (tree, places)
        });
        let places = self.paged(|_| true, page_bytes, pages);
        let splats = Placed { written: self.written(&places, |_| true), places };
        let other = other.map(|(tree, mut places)| {
            for (depth, level) in tree.depths.iter().enumerate() {
                for (index, _) in level.iter().enumerate().filter(|(_, node)| node.is_leaf) {
                    places[depth][index] = splats.places[depth][index];
                }
            }
            Placed { written: tree.written(&places, |place| !tree.is_leaf(place)), places }
        });
        std::iter::once(splats).chain(other).collect()
    }

    fn paged(&self, own: impl Fn(Place) -> bool, page_bytes: usize, pages: &mut Vec<PageSize>) -> Vec<Vec<NodeRef>> {
        let nowhere = NodeRef { page: PageId(pages.len() as u32), node: 0 };
        let mut places: Vec<Vec<NodeRef>> = self.depths.iter().map(|level| vec![nowhere; level.len()]).collect();
        plan(self, page_bytes, own, |page| {
            let id = PageId(pages.len() as u32);
            let bytes: u64 = page.iter().map(|place| self.bytes(*place) as u64).sum();
            pages.push(PageSize { bytes: PAGE_HEADER_LEN as u64 + bytes, nodes: page.len() as u32 });
            for (node, (depth, index)) in (0..).zip(page) {
                places[depth][index] = NodeRef { page: id, node };
            }
        });
        places
    }

    fn written(&self, places: &[Vec<NodeRef>], own: impl Fn(Place) -> bool) -> Written {
        let of = |depth: usize| {
            let own = (0..self.depths[depth].len()).map(|index| (depth, index)).filter(|place| own(*place));
            own.map(|place| self.bytes(place) as u64).sum()
        };
        Written { root_page: places[0][0].page, bytes: (0..self.depths.len()).map(of).collect() }
    }
}

impl Nodes for TreeSizes {
    fn bytes(&self, (depth, index): Place) -> usize {
        self.depths[depth][index].bytes
    }

    fn children(&self, (depth, index): Place) -> impl Iterator<Item = Place> {
        let NodeSize { first, children, .. } = self.depths[depth][index];
        (first as usize..first as usize + usize::from(children)).map(move |child| (depth + 1, child))
    }

    fn is_leaf(&self, (depth, index): Place) -> bool {
        self.depths[depth][index].is_leaf
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FamilyTrees, PlannedNode};
    use super::*;
    use crate::hierarchy::{NodeKey, Purpose};
    use crate::model::Bounds;
    use crate::store::layout::StoredNode;
    use crate::store::page::Encoding;
    use proptest::prelude::*;

    fn node(encoding: Encoding, children: [Option<usize>; 8], sections: (usize, usize)) -> PlannedNode {
        let node = StoredNode {
            key: NodeKey::ROOT,
            encoding,
            codebook: 0,
            particles: 0,
            points: 0,
            source_particles: 0,
            delta: 0.0,
            bounds: Bounds::EMPTY,
            smoothing_length_max: 0.0,
            mass: 0.0,
            mass_density: 0.0,
            mass_scale: 1.0,
            mass_density_scale: 1.0,
            children: [None; 8],
        };
        PlannedNode { node, children, sections }
    }

    proptest! {
        /// By sizes alone nodes come to the pages to which whole trees come.
        #[test]
        fn nodes_have_the_places_of_whole_trees(
            shape in prop::collection::vec((1..255_u8, any::<bool>(), 0..400_usize), 1..300),
            page_bytes in 300..4000_usize,
        ) {
            // Breadth-first: each node that is no leaf has the children that its bits say.
            let mut shape = shape.into_iter();
            let mut trees: [Vec<Vec<PlannedNode>>; 2] = [Vec::new(), Vec::new()];
            let mut sizes = [TreeSizes::default(), TreeSizes::default()];
            let (mut depth, mut count) = (0, 1);
            while count > 0 {
                let mut below = 0;
                trees.iter_mut().for_each(|tree| tree.push(Vec::new()));
                for _ in 0..count {
                    let (bits, is_inner, bytes) = shape.next().filter(|_| depth < 6).unwrap_or((0, false, 100));
                    let mut children = [None; 8];
                    for (octant, child) in children.iter_mut().enumerate() {
                        if is_inner && bits >> octant & 1 == 1 {
                            *child = Some(below);
                            below += 1;
                        }
                    }
                    let encoding = if is_inner { Encoding::Grid } else { Encoding::Leaf };
                    for (more, (tree, sizes)) in trees.iter_mut().zip(&mut sizes).enumerate() {
                        let sections = (bytes + 40 * more, bytes / 3);
                        tree[depth].push(node(encoding, children, sections));
                        sizes.add(depth, sections, children.iter().flatten().count(), !is_inner);
                    }
                }
                (depth, count) = (depth + 1, below);
            }
            let [splats, volume] = &trees;
            let others = [(Purpose::Samples, &volume[..])];
            let whole = FamilyTrees { splats, has_octree: true, others: &others };
            let (expected, written) = whole.paged(5, page_bytes);
            let mut pages = vec![PageSize { bytes: 0, nodes: 0 }; 5];
            let [splats, volume] = sizes;
            let placed = splats.placed(Some(volume), page_bytes, &mut pages);
            prop_assert_eq!(placed.iter().map(|tree| &tree.written).collect::<Vec<_>>(), written.iter().collect::<Vec<_>>());
            let mut found = pages[5..].iter();
            // Those of the other tree come first.
            for (tree, placed) in expected.iter().zip(placed.iter().rev()) {
                for page in 0..tree.len() {
                    let (id, nodes) = tree.page(page);
                    let nodes: Vec<(StoredNode, Place)> = nodes.collect();
                    let size = found.next().unwrap();
                    prop_assert_eq!((size.bytes, size.nodes), (tree.page_bytes(page), nodes.len() as u32));
                    for (number, (node, (depth, index))) in (0..).zip(nodes) {
                        prop_assert_eq!(placed.places[depth][index], NodeRef { page: id, node: number });
                        let children = trees[0][depth][index].children.map(|child| child.map(|child| placed.places[depth + 1][child]));
                        prop_assert_eq!(node.children, children);
                    }
                }
            }
            prop_assert!(found.next().is_none());
        }
    }
}
