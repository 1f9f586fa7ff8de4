//! Which nodes to draw within a number of splats: those whose refinement shows most, first.
//!
//! Every node tells in steps what the next split of its clusters is worth ([`Step`]), so one threshold on that worth, the same for all nodes,
//! is the cut that best-first refinement would come to: a node is drawn with the clusters whose splits are worth more, and its children
//! take its place where all of them are. What a split is worth shrinks with what the view cannot show: spread below a pixel, and far away in
//! a perspective view. The threshold is found by bisection over what is resident; so the cut depends on the data and the view alone.
//! A leaf may have many more particles than clusters stand for it: where it does not fit, it is passed over, and the threshold falls further.

use super::selection::{Drawn, Missing, NodeInfo, NodeTree, Selection};
use super::{Extent, Scope, View};
use crate::codec::clusters::{MOST, whole_classes};
use crate::hierarchy::pca::{Step, count_at};
use glam::DVec3;

/// Halvings of the range of thresholds, base 2 logarithms from -[`RANGE`] to [`RANGE`].
const HALVINGS: usize = 28;
const RANGE: f64 = 1024.0;
/// Squared spread, in pixels, of which half shows: somewhat less than a pixel's own (1/12), since what is bright and small shows by how
/// it lies across pixels (`docs/results.md`).
const PIXEL: f64 = 0.03;

/// Share of the budget that may be left while other refinements than the next one may fit in it.
const LEFT: f64 = 0.01;
/// Nodes that are passed over at most since their refinement does not fit.
const PASSED: usize = 16;

/// Selects at most about `splats` splats below `roots`; every root has one at least.
pub fn select_within<Tree: NodeTree>(
    (view, scope): (&View, Scope),
    splats: u64,
    tree: &Tree,
    roots: &[Tree::Id],
) -> Selection<Tree::Id> {
    let mut walk = Walk::new((view, scope), tree, roots);
    let mut highest = RANGE;
    loop {
        let (low, high) = walk.threshold(splats, highest);
        let left = splats.saturating_sub(walk.count(high, u64::MAX));
        let is_used = left as f64 <= LEFT * splats as f64 || walk.passed.len() == PASSED;
        // What is refined just below the threshold is too much for what is left: others may be less.
        let next = if is_used { None } else { walk.next(low, high) };
        let Some(next) = next else {
            let mut selection = walk.select(high);
            fill(&mut selection, splats.saturating_sub(walk.pending), tree);
            selection.missing.sort_by(|a, b| b.error_pixels.total_cmp(&a.error_pixels));
            return selection;
        };
        walk.passed.push(next);
        highest = high;
    }
}

/// Adds clusters to nodes that are drawn with a part of theirs, the same factor to all, until the budget is used.
fn fill<Tree: NodeTree>(selection: &mut Selection<Tree::Id>, splats: u64, tree: &Tree) {
    let drawn = |part: u64, all: u64, factor: f64| -> u64 {
        let more = ((part as f64 * factor) as u64).clamp(part, all);
        if more == all { all } else { u64::from(whole_classes(more as u32)).max(part) }
    };
    let all = |id: Tree::Id| tree.node(id).map_or(0, |info| info.particles);
    let sum = |selection: &Selection<Tree::Id>, factor: f64| -> u64 {
        let one = |node: &Drawn<Tree::Id>| match node.part {
            true => drawn(node.particles, all(node.id), factor),
            false => node.particles,
        };
        selection.draw.iter().map(one).sum()
    };
    let (mut low, mut high) = (1.0, MOST as f64);
    if sum(selection, low) >= splats {
        return;
    }
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        match sum(selection, middle) <= splats {
            true => low = middle,
            false => high = middle,
        }
    }
    for node in selection.draw.iter_mut().filter(|node| node.part) {
        let all = all(node.id);
        node.particles = drawn(node.particles, all, low);
        node.part = node.particles < all;
    }
}

/// What a threshold comes to.
struct Walk<'a, Tree: NodeTree> {
    tree: &'a Tree,
    roots: &'a [Tree::Id],
    view: View,
    scope: Scope,
    /// Splats from which on a walk ends.
    limit: u64,
    /// Nodes that are not refined.
    passed: Vec<Tree::Id>,
    /// Where what is drawn is kept; a walk that only counts has none.
    selection: Option<Selection<Tree::Id>>,
    /// Where the refined node is kept that adds most of those that are refined at this threshold, but not at the next one.
    largest: Option<(f64, Option<(u64, Tree::Id)>)>,
    /// Splats that are expected of what is missing.
    pending: u64,
    count: u64,
}

impl<'a, Tree: NodeTree> Walk<'a, Tree> {
    fn new((view, scope): (&View, Scope), tree: &'a Tree, roots: &'a [Tree::Id]) -> Walk<'a, Tree> {
        let (limit, passed) = (u64::MAX, Vec::new());
        Walk { tree, roots, view: *view, scope, limit, passed, selection: None, largest: None, pending: 0, count: 0 }
    }

    /// The smallest threshold up to `high` at which there are at most so many splats, and one close below, at which there are more; twice
    /// the same where all that there is fits.
    fn threshold(&mut self, splats: u64, mut high: f64) -> (f64, f64) {
        let mut low = -RANGE;
        // Most often everything fits, or next to nothing.
        if self.count(low, splats) <= splats {
            return (low, low);
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            match self.count(middle, splats) <= splats {
                true => high = middle,
                false => low = middle,
            }
        }
        (low, high)
    }

    /// How many splats a threshold's base 2 logarithm comes to, or more than the limit.
    fn count(&mut self, threshold: f64, limit: u64) -> u64 {
        self.limit = limit;
        self.run(threshold);
        self.count + self.pending
    }

    /// The node whose refinement adds most of those that are refined at the threshold `low` and not at `high`.
    fn next(&mut self, low: f64, high: f64) -> Option<Tree::Id> {
        self.largest = Some((high, None));
        self.count(low, u64::MAX);
        self.largest.take().and_then(|(_, largest)| largest).map(|(_, id)| id)
    }

    fn select(&mut self, threshold: f64) -> Selection<Tree::Id> {
        let empty = || Selection { draw: Vec::new(), missing: Vec::new(), visited: Vec::new(), hidden: Vec::new() };
        self.selection = Some(empty());
        self.count(threshold, u64::MAX);
        self.selection.take().unwrap_or_else(empty)
    }

    fn run(&mut self, threshold: f64) {
        (self.count, self.pending) = (0, 0);
        let view = self.view;
        for offset in view.images.offsets() {
            let image = view.of_image(offset);
            for &root in self.roots {
                match self.tree.node(root) {
                    Some(info) => {
                        self.visit(&image, offset, root, &info, threshold);
                    }
                    None => {
                        if let Some(selection) = &mut self.selection {
                            selection.missing.push(Missing { id: root, error_pixels: f64::INFINITY });
                        }
                    }
                }
            }
        }
    }

    /// Draws a resident node or what refines it; false where neither is possible yet.
    fn visit(&mut self, view: &View, offset: DVec3, id: Tree::Id, info: &NodeInfo, threshold: f64) -> bool {
        if self.count + self.pending > self.limit {
            return true;
        }
        if let Some(selection) = &mut self.selection {
            selection.visited.push(id);
        }
        if !info.is_at(view.time) || !self.scope.sees(view, &info.extent) || !view.cut.reaches(&info.extent.bounds) {
            return true;
        }
        let steps = self.tree.steps(id);
        let worth = Worth::new((view, self.scope), &info.extent);
        let refinement =
            if info.is_leaf || self.passed.contains(&id) { f64::NEG_INFINITY } else { worth.refinement(info, steps) };
        let refines = refinement >= threshold;
        let before = self.count + self.pending;
        if refines && self.refine(view, offset, id, threshold) {
            let more = (self.count + self.pending - before).saturating_sub(info.particles);
            if let Some((above, largest)) = &mut self.largest
                && refinement < *above
                && largest.is_none_or(|(most, _)| more > most)
            {
                *largest = Some((more, id));
            }
            return true;
        }
        if info.delta.is_infinite() {
            return false;
        }
        let particles = if refines { info.particles } else { worth.clusters(info, steps, threshold) };
        self.count += particles;
        if refines && info.stands_for_leaf {
            // Of leaves that are not resident it is known how many particles they have; other children have hardly more clusters.
            self.pending += info.source_particles.saturating_sub(particles);
        }
        if let Some(selection) = &mut self.selection {
            let part = particles < info.particles;
            let displaced = steps.iter().rfind(|step| part && u64::from(step.clusters) <= particles);
            let delta = displaced.map_or(info.delta, |step| step.largest.sqrt().max(info.delta));
            let error_pixels = self.scope.error_pixels(view, &info.extent, delta);
            selection.draw.push(Drawn { id, error_pixels, particles, part, offset });
        }
        true
    }

    fn refine(&mut self, view: &View, offset: DVec3, id: Tree::Id, threshold: f64) -> bool {
        let tree = self.tree;
        let before = (self.count, self.pending, self.selection.as_ref().map_or(0, |selection| selection.draw.len()));
        let mut complete = true;
        for child in tree.children(id) {
            match tree.node(child) {
                Some(info) => complete &= self.visit(view, offset, child, &info, threshold),
                None => {
                    complete = false;
                    if let Some(selection) = &mut self.selection {
                        selection.missing.push(Missing { id: child, error_pixels: threshold });
                    }
                }
            }
        }
        if !complete {
            (self.count, self.pending) = (before.0, before.1);
            if let Some(selection) = &mut self.selection {
                selection.draw.truncate(before.2);
            }
        }
        complete
    }
}

/// What splits in a node are worth in a view, as base 2 logarithms.
struct Worth {
    /// Pixels for a length, where the node is nearest.
    scale: f64,
    /// The same of the nearest of its children.
    finer_scale: f64,
}

impl Worth {
    fn new((view, scope): (&View, Scope), extent: &Extent) -> Worth {
        let [scale, finer_scale] = scope.scales(view, extent, [0.5, 0.25]);
        Worth { scale, finer_scale }
    }

    /// That of the next split at a step: as much of the picture as is wrong without it.
    fn of(&self, step: &Step) -> f64 {
        worth(step, self.scale)
    }

    /// That of drawing its children instead, for each splat.
    fn refinement(&self, info: &NodeInfo, steps: &[Step]) -> f64 {
        match steps.last() {
            // Of a leaf's clusters the particles are drawn instead, for which many splits are left out at once.
            Some(last) if info.stands_for_leaf => {
                let more = info.source_particles.saturating_sub(info.particles).max(1) as f64;
                self.of(last) + (info.particles as f64 / more).min(1.0).log2()
            }
            // A child that is nearer shows the same splits for what they are worth there, so that their numbers go on without a jump.
            Some(last) => worth(last, self.finer_scale),
            None if info.delta.is_infinite() => f64::INFINITY,
            None => {
                let pixels = info.delta * self.scale;
                let wrong = info.mass * self.scale * self.scale * pixels / (1.0 + pixels);
                (wrong / info.particles.max(1) as f64).max(f64::MIN_POSITIVE).log2()
            }
        }
    }

    /// How many clusters of a node are drawn: those whose splits are worth as much as the threshold.
    fn clusters(&self, info: &NodeInfo, steps: &[Step], threshold: f64) -> u64 {
        if steps.is_empty() {
            return info.particles;
        }
        let count = count_at(steps, threshold, |step| self.of(step)) as u64;
        if count >= info.particles { info.particles } else { u64::from(whole_classes(count as u32)) }
    }
}

/// What the next split at a step is worth where a length takes `scale` pixels.
fn worth(step: &Step, scale: f64) -> f64 {
    let hidden = PIXEL / (scale * scale);
    let shows = step.scale / (step.scale + hidden);
    (step.priority * scale * scale * shows).max(f64::MIN_POSITIVE).log2()
}

#[cfg(test)]
mod tests;
