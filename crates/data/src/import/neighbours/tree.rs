//! A k-d tree with tight boxes around its nodes, over positions in units of about the box around them.

use super::group::Block;
use crate::model::Progress;
use glam::DVec3;

/// Most entries of a leaf.
pub(super) const LEAF: usize = 16;

/// Ranges of more items are divided by tasks of their own.
const TASK: usize = 1 << 14;

/// A particle on its way into a leaf.
#[derive(Clone, Copy)]
pub(super) struct Item {
    pub at: [f64; 3],
    pub particle: u32,
}

/// A node; its left child is the node after it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub bounds: Box3,
    /// Index of the right child; 0 for a leaf.
    pub right: u32,
    /// First entry of a leaf.
    pub start: u32,
    /// End of the entries of a leaf.
    pub end: u32,
    /// Number of a leaf among leaves.
    pub leaf: u32,
}

impl Node {
    /// The middle of its box.
    pub(super) fn center(&self) -> DVec3 {
        0.5 * self.bounds.min + 0.5 * self.bounds.max
    }
}

/// An axis-parallel box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Box3 {
    pub min: DVec3,
    pub max: DVec3,
}

impl Box3 {
    fn of(items: &[Item]) -> Box3 {
        let none = Box3 { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
        items
            .iter()
            .map(|item| DVec3::from_array(item.at))
            .fold(none, |all, at| Box3 { min: all.min.min(at), max: all.max.max(at) })
    }

    /// Squared distance of a point, 0 inside.
    pub(super) fn distance(&self, at: DVec3) -> f64 {
        (self.min - at).max(at - self.max).max(DVec3::ZERO).length_squared()
    }

    /// Squared distance of another box, 0 where they meet.
    pub(super) fn distance_to(&self, other: &Box3) -> f64 {
        (self.min - other.max).max(other.min - self.max).max(DVec3::ZERO).length_squared()
    }
}

/// The tree. Its entries are particles in the order of the leaves; more particles in one place than a leaf takes are one
/// entry, so that every place belongs to one leaf.
pub(super) struct Tree {
    pub nodes: Vec<Node>,
    /// Nodes that are leaves, in order.
    pub leaves: Vec<u32>,
    /// Places of the leaves' entries for SIMD lanes.
    pub blocks: Vec<Block>,
    /// Coordinates of the entries.
    pub at: Vec<DVec3>,
    /// Particle numbers by entry.
    pub particles: Vec<u32>,
    /// Where in `particles` each entry begins, and one more for the end.
    pub starts: Vec<u32>,
}

/// An entry near some point.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Near {
    /// Squared distance.
    pub squared: f64,
    pub entry: u32,
}

impl Tree {
    /// Builds the tree over at least one item.
    pub(super) fn of(mut items: Vec<Item>, progress: &dyn Progress) -> Tree {
        let mut nodes = divide(&mut items, 0, progress);
        let particles = items.iter().map(|item| item.particle).collect();
        let (leaves, blocks, at, starts) = Default::default();
        let mut tree = Tree { nodes: Vec::new(), leaves, blocks, at, particles, starts };
        tree.at.reserve(items.len());
        tree.starts.reserve(items.len() + 1);
        for (index, node) in nodes.iter_mut().enumerate().filter(|(_, node)| node.right == 0) {
            let range = node.start..node.end;
            // Only particles of one place make a leaf of more than this.
            let step = if range.len() > LEAF { range.len() } else { 1 };
            node.start = tree.at.len() as u32;
            tree.leaves.push(index as u32);
            for first in range.step_by(step) {
                tree.at.push(DVec3::from_array(items[first as usize].at));
                tree.starts.push(first);
            }
            node.end = tree.at.len() as u32;
            node.leaf = tree.blocks.len() as u32;
            tree.blocks.push(block(node, &tree.at[node.start as usize..]));
        }
        tree.starts.push(items.len() as u32);
        tree.nodes = nodes;
        tree
    }

    /// The particles of an entry.
    pub(super) fn particles_of(&self, entry: u32) -> &[u32] {
        &self.particles[self.starts[entry as usize] as usize..self.starts[entry as usize + 1] as usize]
    }

    /// The `wanted` entries nearest to a point among those whose squared distance is at most `most`, in any order.
    pub(super) fn nearest(&self, at: DVec3, wanted: usize, mut most: f64, found: &mut Vec<Near>) {
        found.clear();
        let full = (4 * wanted).max(64);
        // Depth first, the nearer child first: at most one node of each depth waits.
        let mut waiting = vec![(0u32, self.nodes[0].bounds.distance(at))];
        while let Some((index, distance)) = waiting.pop() {
            if distance > most {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.right != 0 {
                let (left, right) = (index + 1, node.right);
                let near = (left, self.nodes[left as usize].bounds.distance(at));
                let far = (right, self.nodes[right as usize].bounds.distance(at));
                waiting.extend(if far.1 < near.1 { [near, far] } else { [far, near] });
                continue;
            }
            for entry in node.start..node.end {
                let squared = self.at[entry as usize].distance_squared(at);
                if squared <= most {
                    found.push(Near { squared, entry });
                }
            }
            if found.len() >= full {
                most = keep_nearest(found, wanted);
            }
        }
        if found.len() > wanted {
            keep_nearest(found, wanted);
        }
    }
}

/// The places of a leaf's entries relative to its centre.
fn block(leaf: &Node, places: &[DVec3]) -> Block {
    let mut block = Block { center: leaf.center(), at: [[f32::MAX; LEAF]; 3], first: leaf.start };
    for (lane, at) in places.iter().enumerate() {
        let local = (*at - block.center).as_vec3();
        (block.at[0][lane], block.at[1][lane], block.at[2][lane]) = (local.x, local.y, local.z);
    }
    block
}

/// Keeps the `wanted` nearest of more; the squared distance of the farthest of them.
pub(super) fn keep_nearest(found: &mut Vec<Near>, wanted: usize) -> f64 {
    let (_, last, _) = found.select_nth_unstable_by(wanted - 1, |a, b| a.squared.total_cmp(&b.squared));
    let most = last.squared;
    found.truncate(wanted);
    most
}

/// Brings the farthest of some to their end; its squared distance, 0 for none.
pub(super) fn farthest_last(near: &mut [Near]) -> f64 {
    let farthest = (0..near.len()).max_by(|a, b| near[*a].squared.total_cmp(&near[*b].squared));
    if let (Some(farthest), Some(last)) = (farthest, near.len().checked_sub(1)) {
        near.swap(farthest, last);
    }
    near.last().map_or(0.0, |last| last.squared)
}

/// Divides items into leaves by medians; `offset` is the place of the first of them among all.
fn divide(items: &mut [Item], offset: u32, progress: &dyn Progress) -> Vec<Node> {
    progress.go_on();
    let mut nodes = Vec::new();
    divide_into(items, offset, &mut nodes, progress);
    nodes
}

fn divide_into(items: &mut [Item], offset: u32, nodes: &mut Vec<Node>, progress: &dyn Progress) {
    let bounds = Box3::of(items);
    let extent = bounds.max - bounds.min;
    let index = nodes.len();
    nodes.push(Node { bounds, right: 0, start: offset, end: offset + items.len() as u32, leaf: 0 });
    if items.len() <= LEAF || extent.max_element() <= 0.0 {
        return;
    }
    let axis = extent.max_position();
    let middle = items.len() / 2;
    let (_, median, _) = items.select_nth_unstable_by(middle, |a, b| a.at[axis].total_cmp(&b.at[axis]));
    // Equal coordinates stay together, and so do particles of one place.
    let value = median.at[axis];
    let mut cut = partition(&mut items[..middle], |item| item.at[axis] < value);
    if cut == 0 {
        cut = middle + partition(&mut items[middle..], |item| item.at[axis] <= value);
    }
    let (left, right) = items.split_at_mut(cut);
    let right_offset = offset + cut as u32;
    if left.len().max(right.len()) <= TASK {
        divide_into(left, offset, nodes, progress);
        nodes[index].right = nodes.len() as u32;
        divide_into(right, right_offset, nodes, progress);
        return;
    }
    let halves = rayon::join(|| divide(left, offset, progress), || divide(right, right_offset, progress));
    for (side, part) in <[_; 2]>::from(halves).into_iter().enumerate() {
        let base = nodes.len() as u32;
        if side == 1 {
            nodes[index].right = base;
        }
        nodes.extend(
            part.into_iter().map(|node| Node { right: if node.right == 0 { 0 } else { node.right + base }, ..node }),
        );
    }
}

/// Moves the items that satisfy `first` to the front; how many they are.
fn partition(items: &mut [Item], first: impl Fn(&Item) -> bool) -> usize {
    let mut count = 0;
    for index in 0..items.len() {
        if first(&items[index]) {
            items.swap(count, index);
            count += 1;
        }
    }
    count
}
