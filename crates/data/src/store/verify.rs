//! Checks every byte and every promise of a page file.
//!
//! The header, the footer and each page carry checksums, and the bytes between them must be zero, so that no change of
//! a single bit goes unnoticed. Beyond that the trees must be whole: every node but the roots is the child of exactly
//! one node of each tree that it is in, in the cell its parent gives it, and the counts of particles, masses and levels
//! add up. Leaves are in every tree of their family, other nodes in one.

use super::error::{Damage, StoreError};
use super::metadata::{ClusterLevel, FamilyMetadata, LevelInfo};
use super::page::{Encoding, Node, NodeRef, Page, PageId};
use super::page_file::PageFile;
use crate::hierarchy::{Kind, NodeKey, Purpose};
use crate::model::progress::Progress;
use std::collections::HashMap;
use std::path::Path;

/// What was verified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Length of the file.
    pub bytes: u64,
    /// Pages read.
    pub pages: u32,
    /// Nodes checked.
    pub nodes: u64,
    /// Source particles in all leaves.
    pub particles: u64,
}

/// A child that some node promised, and that has not come by yet.
struct Promise {
    key: NodeKey,
    /// The parent, as a key of `Verifier::open`.
    parent: NodeRef,
}

/// A node whose children have not all come by yet, with what they have summed up to.
struct Open {
    children: u32,
    source_particles: u64,
    expected: u64,
}

struct Verifier<'a> {
    file: &'a PageFile,
    promises: HashMap<(NodeRef, Purpose), Promise>,
    open: HashMap<NodeRef, Open>,
    /// What was counted of each family's trees.
    levels: Vec<[Vec<LevelInfo>; 3]>,
    /// What was counted of its clusters.
    clusters: Vec<Vec<ClusterLevel>>,
    done: Verified,
}

/// Verifies a page file. Memory use follows the widest level of the tree, not the file.
pub fn verify(path: &Path, progress: &dyn Progress) -> Result<Verified, StoreError> {
    verify_file(&PageFile::open(path)?, progress)
}

/// [`verify`] of an open page file; of several as one, of the first.
pub(super) fn verify_file(file: &PageFile, progress: &dyn Progress) -> Result<Verified, StoreError> {
    let damaged = |damage: Damage| damage.in_file(file.path());
    file.first().container().check_zeros(None)?;
    let families = &file.metadata().families;
    let mut verifier = Verifier {
        file,
        promises: HashMap::new(),
        open: HashMap::new(),
        levels: families
            .iter()
            .map(|family| Purpose::ALL.map(|levels| empty_levels(told(family, levels).len())))
            .collect(),
        clusters: families.iter().map(|family| empty_clusters(clusters_told(family).len())).collect(),
        done: Verified { bytes: file.bytes(), pages: file.page_count(), ..Verified::default() },
    };
    progress.begin("verifying", u64::from(file.page_count()));
    for number in 0..file.page_count() {
        let page = file.read_page(PageId(number))?;
        verifier.page(&page).map_err(damaged)?;
        file.first().container().check_zeros(Some(PageId(number)))?;
        progress.advance(1);
    }
    verifier.finish().map_err(damaged)
}

/// What the footer says of a tree's levels.
fn told(family: &FamilyMetadata, levels: Purpose) -> &[LevelInfo] {
    match levels {
        Purpose::Splats => &family.levels,
        Purpose::Samples => family.volume.as_ref().map_or(&[], |volume| &volume.levels),
        Purpose::Clusters => &[],
    }
}

/// What it says of the clusters.
fn clusters_told(family: &FamilyMetadata) -> &[ClusterLevel] {
    family.clusters.as_ref().map_or(&[], |clusters| &clusters.levels)
}

fn empty_clusters(count: usize) -> Vec<ClusterLevel> {
    (0..count).map(|depth| ClusterLevel { depth: depth as u8, ..ClusterLevel::default() }).collect()
}

fn empty_levels(count: usize) -> Vec<LevelInfo> {
    (0..count).map(|depth| LevelInfo { depth: depth as u8, ..LevelInfo::default() }).collect()
}

impl Verifier<'_> {
    fn page(&mut self, page: &Page) -> Result<(), Damage> {
        let family = &self.file.metadata().families[page.family as usize];
        for (i, node) in page.nodes.iter().enumerate() {
            let own = NodeRef { page: page.id, node: i as u32 };
            let here = |expected: &str| Damage::new(format!("page {}, node {i}", page.id.0), expected);
            self.done.nodes += 1;
            let mut trees = 0;
            let mut tree = Purpose::Splats;
            for levels in Purpose::ALL {
                let is_root = family.trees().any(|(own, root)| own == levels && root == page.id) && i == 0;
                match self.promises.remove(&(own, levels)) {
                    Some(promise) if promise.key == page.cells[i] && !is_root => {
                        self.settle(&promise, node).map_err(|e| here(&e))?
                    }
                    // What is drawn first must hold something.
                    None if is_root && (node.encoding != Encoding::Relay || levels == Purpose::Samples) => {
                        if page.cells[i] != NodeKey::ROOT || node.source_particles != family.count {
                            return Err(here("a root that stands for every particle of its family"));
                        }
                    }
                    None if !is_root => continue,
                    _ => return Err(here("to be a root, or the child of an earlier node in its parent's octant")),
                }
                (trees, tree) = (trees + 1, levels);
            }
            let expected = if node.is_leaf() { family.trees().count() } else { 1 };
            let kind = Kind::of(tree);
            if !node.is_leaf() && !kind.encodings.contains(&node.encoding) {
                return Err(here(&format!("nodes of the hierarchy {} in its tree", kind.name)));
            }
            if trees != expected {
                return Err(here("to be the root, or the child of one earlier node, of each tree that it is in"));
            }
            check_particles(page, i, node).map_err(here)?;
            // Leaves count for the tree that was looked for first.
            let tree = if node.is_leaf() { Purpose::Splats } else { tree };
            self.count(page, i, tree).map_err(here)?;
            for (&child, &key) in page.children(i).iter().zip(page.child_cells(i)) {
                if self.promises.insert((child, tree), Promise { key, parent: own }).is_some() {
                    return Err(here("children that no other node has"));
                }
            }
            let children = node.children.len() as u32;
            if children > 0 {
                self.open.insert(own, Open { children, source_particles: 0, expected: node.source_particles });
            }
        }
        Ok(())
    }

    /// Counts a child towards its parent.
    fn settle(&mut self, promise: &Promise, child: &Node) -> Result<(), String> {
        let Some(open) = self.open.get_mut(&promise.parent) else { return Ok(()) };
        open.children -= 1;
        open.source_particles = open.source_particles.saturating_add(child.source_particles);
        if open.children == 0 {
            if open.source_particles != open.expected {
                return Err(format!(
                    "siblings that stand for {} source particles, found {}",
                    open.expected, open.source_particles
                ));
            }
            self.open.remove(&promise.parent);
        }
        Ok(())
    }

    fn count(&mut self, page: &Page, index: usize, tree: Purpose) -> Result<(), &'static str> {
        let node = &page.nodes[index];
        if tree == Purpose::Clusters {
            let level = self.clusters[page.family as usize]
                .get_mut(usize::from(node.depth))
                .ok_or("a depth that the footer lists")?;
            level.nodes += 1;
            level.clusters += u64::from(node.particles);
            level.finest += if node.encoding == Encoding::LeafClusters { u64::from(node.particles) } else { 0 };
            level.bytes += page.node_bytes(index);
            return inside_its_cell(node);
        }
        let level = self.levels[page.family as usize][tree as usize]
            .get_mut(usize::from(node.depth))
            .ok_or("a depth that the footer lists")?;
        let particles = u64::from(node.particles);
        match node.encoding {
            Encoding::Relay => level.relay_nodes += 1,
            Encoding::Grid => {
                level.grid_nodes += 1;
                level.points += u64::from(node.points);
                level.sprites += particles - u64::from(node.points);
            }
            Encoding::Leaf => {
                level.leaf_nodes += 1;
                level.leaf_particles += particles;
                self.done.particles += particles;
            }
            Encoding::Clusters | Encoding::LeafClusters => {}
        }
        level.bytes += page.node_bytes(index);
        inside_its_cell(node)
    }

    fn finish(self) -> Result<Verified, Damage> {
        if let Some(promise) = self.promises.values().next() {
            return Err(Damage::new(format!("node {:?}", promise.key), "to exist"));
        }
        for (family, found) in self.file.metadata().families.iter().zip(&self.clusters) {
            for (told, found) in clusters_told(family).iter().zip(found) {
                let counted = ClusterLevel { size: told.size, misfit: told.misfit, ..*found };
                if *told != counted {
                    let place = format!("footer, {} clusters of depth {}", family.name, told.depth);
                    return Err(Damage::new(place, format!("the counts that its nodes have, {counted:?}")));
                }
            }
        }
        for (family, found) in self.file.metadata().families.iter().zip(&self.levels) {
            for (levels, found) in Purpose::ALL.into_iter().zip(found) {
                check_levels(family, levels, found)?;
            }
            let [found, ..] = found;
            let leaves = found.iter().map(|level| level.leaf_particles).sum::<u64>();
            if leaves != family.count {
                let expected = format!("{} particles in the leaves, found {leaves}", family.count);
                return Err(Damage::new(format!("footer, {}", family.name), expected));
            }
        }
        Ok(self.done)
    }
}

/// Whether a node's box lies in its cell.
fn inside_its_cell(node: &Node) -> Result<(), &'static str> {
    let cell = node.frame.bounds();
    // Rounding in the cell's corners is far below its size.
    let slack = glam::DVec3::splat(1e-6 * node.frame.size) + 1e-12 * cell.min.abs().max(cell.max.abs());
    let inside = (cell.min - slack).cmple(node.bounds.min).all() && node.bounds.max.cmple(cell.max + slack).all();
    if inside { Ok(()) } else { Err("bounds inside its cell") }
}

/// Checks what the footer says of a tree's levels against what was found.
fn check_levels(family: &FamilyMetadata, levels: Purpose, found: &[LevelInfo]) -> Result<(), Damage> {
    for (told, found) in told(family, levels).iter().zip(found) {
        let kind = if levels == Purpose::Samples { "volume " } else { "" };
        let place = || format!("footer, {} {kind}level {}", family.name, told.depth);
        let counted = LevelInfo {
            input: told.input,
            merged: told.merged,
            skipped: told.skipped,
            relayed: told.relayed,
            ..*found
        };
        if *told != counted {
            return Err(Damage::new(place(), format!("the counts that its nodes have, {counted:?}")));
        }
        let output = [told.merged, told.skipped, told.relayed, told.sprites, told.points];
        if output.iter().try_fold(0_u64, |sum, &count| sum.checked_add(count)) != Some(told.input) {
            return Err(Damage::new(place(), "input = merged + skipped + relayed + sprites + points"));
        }
    }
    Ok(())
}

/// Checks a node's words: the point flags as counted, and nothing in unused bits.
fn check_particles(page: &Page, index: usize, node: &Node) -> Result<(), &'static str> {
    let particles = page.particles(index);
    let points = (0..particles.len()).filter(|&i| particles.is_point(i)).count();
    if points != node.points as usize {
        return Err("as many point flags as points");
    }
    if let super::Positions::Grid(words) = particles.positions
        && words.iter().any(|word| word >> 31 != 0)
    {
        return Err("grid words with bit 31 clear");
    }
    Ok(())
}
