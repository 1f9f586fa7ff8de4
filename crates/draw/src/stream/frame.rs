//! What the first picture of a tree shows, found from the nodes that stand for most particles.

use crate::hierarchy::Purpose;
use crate::model::Bounds;
use crate::store::{Node, NodeRef, Page, PageId, Tree};
use crate::view::frame;
use glam::DVec3;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

/// Nodes that are opened at most: enough to hold every particle of a file of some hundred thousand, and a fraction of
/// a second of reading for any other.
const NODES: usize = 128;

/// Pages that are read at most beside those of the roots, bytes in memory: the first picture of a large file waits for them.
const READ_BYTES: u64 = 12 << 20;

/// Particles of one node that are looked at, about.
const SAMPLES: usize = 1 << 13;

/// The box to look at first: around `families` (indices in the metadata) at a time, without far outliers (see
/// [`crate::view::frame`]). Pages that cannot be read are left out here; drawing reports them.
pub fn first_frame(tree: &dyn Tree, families: &[u32], time: f64) -> Bounds {
    within(tree, families, time, NODES)
}

/// [`first_frame`] from so many nodes.
fn within(tree: &dyn Tree, families: &[u32], time: f64, nodes: usize) -> Bounds {
    let metadata = tree.metadata();
    let chosen = || families.iter().filter_map(|&index| metadata.families.get(index as usize));
    let full = chosen().fold(Bounds::EMPTY, |bounds, family| bounds.union(family.bounds));
    let mut pages = Pages { tree, read: HashMap::new(), left_bytes: READ_BYTES };
    // The heaviest node is replaced by its children, until only leaves are left or enough nodes are open: what stays
    // merged is then light.
    let mut open: BinaryHeap<(u64, NodeRef)> = tree
        .roots(families, Purpose::Splats, time)
        .into_iter()
        .zip(chosen())
        .map(|(root, family)| (family.count, root))
        .collect();
    let (mut samples, mut now) = (Vec::new(), Bounds::EMPTY);
    let mut opened = 0;
    while let Some((_, at)) = open.pop() {
        let Some((page, node)) = pages.node(at) else { continue };
        opened += 1;
        let index = at.node as usize;
        let can_open = opened + open.len() < nodes && pages.affords(page.children(index));
        // A relay holds no particles itself; a damaged file could be all relays.
        if !node.is_leaf()
            && (can_open || node.particles == 0 && opened < 4 * NODES && pages.affords(page.children(index)))
        {
            for &child in page.children(index) {
                open.extend(pages.node(child).map(|(_, node)| (node.source_particles, child)));
            }
            continue;
        }
        let Some(family) = metadata.families.get(page.family as usize) else { continue };
        let Some(particles) = page.block(index, family, time) else { continue };
        // What moves is where it is now, wherever else the data has been.
        if page.content(index).is_some() {
            now = (0..particles.len()).map(|i| particles.position(i)).fold(now, Bounds::with);
        }
        let stride = particles.len().div_ceil(SAMPLES).max(1);
        let taken = || (0..particles.len()).step_by(stride);
        // A merged particle stands for as many as its mass says: those of a dense place are few, and heavy.
        let masses = particles.table().map(|table| &table.mass[..]);
        let mass = |i: usize| {
            let mass = masses.and_then(|masses| masses.get(particles.entry(i)?)).copied();
            mass.map_or(1.0, f64::from).max(0.0)
        };
        let total: f64 = taken().map(mass).sum();
        let each = node.source_particles as f64 / total;
        let places = taken().map(|i| (particles.position(i), each * mass(i)));
        // A relay that is not opened counts as a whole.
        let whole = particles.is_empty().then(|| (node.bounds.center(), node.source_particles as f64));
        samples.extend(places.chain(whole).filter(|(position, _): &(DVec3, f64)| position.is_finite()));
    }
    frame::frame(if now.is_empty() { full } else { now }, &samples)
}

/// The pages of a tree that have been read.
struct Pages<'a> {
    tree: &'a dyn Tree,
    read: HashMap<PageId, Option<Arc<Page>>>,
    /// Bytes that may still be read.
    left_bytes: u64,
}

impl Pages<'_> {
    /// Whether the pages of a node's children may be read.
    fn affords(&self, children: &[NodeRef]) -> bool {
        let mut wanted: Vec<PageId> = children.iter().map(|child| child.page).collect();
        wanted.dedup();
        wanted.retain(|page| !self.read.contains_key(page));
        wanted.into_iter().map(|page| self.tree.page_memory(page)).sum::<u64>() <= self.left_bytes
    }

    /// A node and its page, if that can be read.
    fn node(&mut self, at: NodeRef) -> Option<(Arc<Page>, Node)> {
        if !self.read.contains_key(&at.page) {
            self.left_bytes = self.left_bytes.saturating_sub(self.tree.page_memory(at.page));
        }
        let page = self.read.entry(at.page).or_insert_with(|| self.tree.read_page(at.page).ok().map(Arc::new));
        let page = Arc::clone(page.as_ref()?);
        let node = page.nodes.get(at.node as usize)?.clone();
        Some((page, node))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{self, BuildOptions};
    use crate::store::PageFile;
    use crate::synth::merger::Merger;

    #[test]
    fn merged_particles_count_as_what_they_stand_for() {
        // One in fifty far away, the others so near to each other that they merge: what is left of them is few and heavy.
        let mut dataset = crate::synth::dataset(&Merger::new(3, 60_000));
        let family = &mut dataset.families[0];
        let bounds = family.bounds();
        for (index, (at, h)) in family.positions.iter_mut().zip(&mut family.smoothing_length).enumerate() {
            if index % 50 != 0 {
                *at = (bounds.center() + 1e-3 * (DVec3::from_array(*at) - bounds.center())).to_array();
                *h *= 1e-3;
            }
        }
        let positions = dataset.families[0].positions.iter();
        let samples: Vec<(DVec3, f64)> = positions.map(|&at| (DVec3::from_array(at), 1.0)).collect();
        let exact = frame::frame(dataset.bounds(), &samples).size();
        assert!(exact.max_element() < 0.1 * dataset.bounds().size().max_element());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("merger.df");
        build::build(dataset, &BuildOptions::default(), &path, &()).unwrap();
        let file = PageFile::open(&path).unwrap();
        for nodes in [1, 8, NODES] {
            let found = within(&file, &[0], 0.0, nodes).size();
            // Merging moves particles by a cell of the root, a 256th of it.
            let bound = 0.1 * exact + bounds.size() / 128.0;
            assert!((found - exact).abs().cmple(bound).all(), "{nodes} nodes: {found}, exact {exact}");
        }
    }
}
