//! What the first picture of a tree shows, found from the nodes that stand for most particles.

use crate::hierarchy::Purpose;
use crate::model::Bounds;
use crate::store::{Node, NodeRef, Page, PageId, Tree};
use crate::view::frame;
use glam::DVec3;
use std::collections::{BinaryHeap, HashMap, HashSet};
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
    let mut pages = Pages { tree, read: HashMap::new(), beside: HashMap::new(), left_bytes: READ_BYTES };
    let roots = tree.roots(families, Purpose::Splats, time);
    pages.read_beside(roots.iter().map(|root| root.page).collect());
    // The heaviest node is replaced by its children, until only leaves are left or enough nodes are open: what stays
    // merged is then light.
    let mut open: BinaryHeap<(u64, NodeRef)> =
        roots.into_iter().zip(chosen()).map(|(root, family)| (family.count, root)).collect();
    let (mut samples, mut now) = (Vec::new(), Bounds::EMPTY);
    let mut reach = [f64::INFINITY, 0.0_f64];
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
            let room = nodes.saturating_sub(opened + open.len());
            pages.expect(page.children(index), &open, room);
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
        let lengths = particles.table().map(|table| &table.smoothing_length[..]);
        for i in taken() {
            let length = lengths.and_then(|lengths| lengths.get(particles.entry(i)?)).copied().map(f64::from);
            reach = length.map_or(reach, |length| [reach[0].min(length), reach[1].max(length)]);
        }
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
    frame::with_kernels(frame::frame(if now.is_empty() { full } else { now }, &samples), reach)
}

/// The pages of a tree that have been read.
struct Pages<'a> {
    tree: &'a dyn Tree,
    read: HashMap<PageId, Option<Arc<Page>>>,
    /// Pages that were read side by side with others and have not been looked at yet, and what was known before of the memory that they take.
    beside: HashMap<PageId, (u64, Option<Arc<Page>>)>,
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

    /// The pages of a node's children are about to be looked at. Over a link they come together with those of the nodes that are open, the
    /// heaviest first, as far as these may be read and there is room for their children among the nodes: one round trip, and none for each.
    /// What is found does not depend on it.
    fn expect(&mut self, children: &[NodeRef], open: &BinaryHeap<(u64, NodeRef)>, room: usize) {
        let is_new = |page: &PageId| !self.read.contains_key(page) && !self.beside.contains_key(page);
        let mut wanted: Vec<PageId> = children.iter().map(|child| child.page).filter(is_new).collect();
        if wanted.is_empty() || self.tree.reads_at_once().is_none() {
            return;
        }
        let held: u64 = self.beside.values().map(|(bytes, _)| bytes).sum();
        let more: u64 = wanted.iter().map(|page| self.tree.page_memory(*page)).sum();
        let mut left_bytes = self.left_bytes.saturating_sub(held + more);
        let mut room = room.saturating_sub(children.len());
        let mut others: Vec<(u64, NodeRef)> = open.iter().copied().collect();
        others.sort_unstable_by(|a, b| b.cmp(a));
        for (_, at) in others {
            let page = self.read.get(&at.page).or_else(|| Some(&self.beside.get(&at.page)?.1));
            let Some(Some(page)) = page else { continue };
            let below = page.children(at.node as usize);
            // The heavier ones take the room first. A relay is opened without.
            if room == 0 && page.nodes.get(at.node as usize).is_none_or(|node| node.particles > 0) {
                continue;
            }
            room = room.saturating_sub(below.len());
            for next in below.iter().map(|child| child.page).filter(is_new) {
                let bytes = self.tree.page_memory(next);
                if !wanted.contains(&next) && bytes <= left_bytes {
                    left_bytes -= bytes;
                    wanted.push(next);
                }
            }
        }
        self.read_beside(wanted);
    }

    /// Reads pages of a link side by side, the first ones, as many as it takes; others, and all of a disk, are read as they are looked at.
    fn read_beside(&mut self, mut wanted: Vec<PageId>) {
        let (tree, Some(most)) = (self.tree, self.tree.reads_at_once()) else { return };
        let mut known = HashSet::new();
        wanted.retain(|page| known.insert(*page));
        wanted.truncate(most);
        if wanted.len() < 2 {
            return;
        }
        std::thread::scope(|scope| {
            let begin = |page: PageId| {
                let bytes = tree.page_memory(page);
                let read = move || tree.read_page(page).ok().map(Arc::new);
                Some((page, bytes, std::thread::Builder::new().spawn_scoped(scope, read).ok()?))
            };
            let begun: Vec<_> = wanted.into_iter().filter_map(begin).collect();
            let ended = begun.into_iter().filter_map(|(page, bytes, read)| Some((page, (bytes, read.join().ok()?))));
            self.beside.extend(ended);
        });
    }

    /// A node and its page, if that can be read.
    fn node(&mut self, at: NodeRef) -> Option<(Arc<Page>, Node)> {
        let page = match self.read.get(&at.page) {
            Some(page) => page.clone(),
            None => {
                let read = || (self.tree.page_memory(at.page), self.tree.read_page(at.page).ok().map(Arc::new));
                let (bytes, page) = self.beside.remove(&at.page).unwrap_or_else(read);
                self.left_bytes = self.left_bytes.saturating_sub(bytes);
                self.read.insert(at.page, page.clone());
                page
            }
        }?;
        let node = page.nodes.get(at.node as usize)?.clone();
        Some((page, node))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{self, BuildOptions};
    use crate::store::{Metadata, PageBytes, PageFile, StoreError};
    use crate::synth::merger::Merger;
    use std::path::Path;
    use std::sync::Mutex;
    use std::time::Duration;

    /// A file as it is behind a link.
    #[derive(Debug)]
    struct Afar<'a> {
        file: &'a PageFile,
        /// The pages that were asked for, how many of them have not come, and the most that this was.
        asked: Mutex<(Vec<PageId>, usize, usize)>,
    }

    impl Tree for Afar<'_> {
        fn metadata(&self) -> &Metadata {
            self.file.metadata()
        }

        fn path(&self) -> &Path {
            self.file.path()
        }

        fn page_count(&self) -> u32 {
            self.file.page_count()
        }

        fn page_bytes(&self, page: PageId) -> u64 {
            self.file.page_bytes(page)
        }

        fn page_memory(&self, page: PageId) -> u64 {
            self.file.page_memory(page)
        }

        fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError> {
            {
                let mut asked = self.asked.lock().unwrap();
                asked.0.push(page);
                asked.1 += 1;
                asked.2 = asked.2.max(asked.1);
            }
            std::thread::sleep(Duration::from_millis(5));
            self.asked.lock().unwrap().1 -= 1;
            self.file.fetch_page(page)
        }

        fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError> {
            self.file.decode_page(bytes)
        }

        fn reads_at_once(&self) -> Option<usize> {
            Some(4)
        }
    }

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
        let options = BuildOptions { page_bytes: 16 << 10, ..BuildOptions::default() };
        build::build(dataset, &options, &path, &()).unwrap();
        let file = PageFile::open(&path).unwrap();
        for nodes in [1, 8, NODES] {
            let box_here = within(&file, &[0], 0.0, nodes);
            // Over a link the same is found, of pages that come together, each once.
            let afar = Afar { file: &file, asked: Mutex::default() };
            assert_eq!(within(&afar, &[0], 0.0, nodes), box_here);
            let (mut asked, _, most) = afar.asked.into_inner().unwrap();
            let count = asked.len();
            asked.sort_unstable();
            asked.dedup();
            assert!(asked.len() == count && (nodes < NODES || most > 1) && most <= 4, "{most} of {count} at a time");
            let found = box_here.size();
            // Merging moves particles by a cell of the root, a 256th of it.
            let bound = 0.1 * exact + bounds.size() / 128.0;
            assert!((found - exact).abs().cmple(bound).all(), "{nodes} nodes: {found}, exact {exact}");
        }
    }
    #[test]
    fn particles_at_one_place_are_seen_from_outside_of_their_kernels() {
        let mut dataset = crate::synth::dataset(&Merger::new(3, 100));
        let family = &mut dataset.families[0];
        family.positions.fill([1.0, 2.0, 3.0]);
        family.smoothing_length.fill(0.5);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("place.df");
        build::build(dataset, &BuildOptions::default(), &path, &()).unwrap();
        let framed = first_frame(&PageFile::open(&path).unwrap(), &[0], 0.0);
        assert!((framed.size() - DVec3::ONE).abs().max_element() < 0.01, "{framed:?}");
        assert!((framed.center() - DVec3::new(1.0, 2.0, 3.0)).length() < 0.01, "{framed:?}");
    }
}
