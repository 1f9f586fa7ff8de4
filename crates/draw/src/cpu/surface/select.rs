//! Which chunks are drawn for a view, and as what.
//!
//! From the whole field downwards a chunk is refined while
//! - its largest distance from T may show as more than `tau` pixels,
//! - or there are holes in it and neighbouring samples may be more than `tau` pixels apart: so no pixel further than that inside a hole is
//!   covered, and none further inside T is missing; nor more than [`MOST_APART`], so that none is where nobody looks for it,
//! - or what it looks like differs from what finer levels look like, and its samples are more than about a pixel of the picture apart
//!   ([`looked`]).
//!
//! The worst is refined first, so that what a budget leaves out is what shows least. A chunk whose finer ones are not there stands in for them.

use super::coverage::MOST_APART;
use super::horizon::Horizon;
use super::placed::Placed;
use super::sight::Sight;
use super::source::{NodeFacts, SurfaceNodes};
use super::walls;
use crate::model::Bounds;
use crate::view::Extent;
use deepfield_heights::hierarchy::chunks::lattice::SIDE_BITS;
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

/// Points are drawn where neighbours are at most so many of a point's sides apart: one, less what snapping to the rasteriser's lattice may add.
pub const POINT_LIMIT: f64 = 0.999;
/// The least error in pixels at which points are drawn: they show a place of their pixel, but not its middle.
pub const EXACT: f64 = 0.05;
/// Samples that looks differ between are at most so many pixels of the picture apart: what a pixel looks like is read from about there.
const LOOKED: f64 = 0.7;
/// The largest error in pixels where nobody says which.
pub const USUAL_TAU: f64 = 0.8;
/// The share of the interval between lines of equal height that a surface may be away from T for them to be where they belong.
const LINES: f64 = 1e-3;
/// Differences of normals, and of colours from 0 to 1, that do not show.
pub const UNSEEN: f32 = 0.01;
/// Most chunks of a cut: as many as a pixel's number has room for.
pub const MOST_NODES: usize = 1 << 14;

/// What the surface is drawn as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Technique {
    /// Points where they leave no gap, triangles elsewhere.
    #[default]
    Hybrid,
    /// Points of whole pixels, whatever gaps they leave.
    Points,
    /// Triangles alone.
    Triangles,
    /// A ray for each pixel: the reference.
    Rays,
}

impl Technique {
    /// Samples of the picture along the side of a point: `point` of them; where points may leave gaps that many pixels, with `parts` along a side.
    pub fn side(self, point: u32, parts: u32) -> u32 {
        if self == Technique::Points { point * parts } else { point }
    }
}

/// What coarse levels are made of, and how they are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coarse {
    /// Samples of the field, chosen by how far the surface may be from T.
    #[default]
    Nested,
    /// Means of four samples, chunk by chunk, chosen by how far samples are apart.
    Means,
}

/// What a chunk is drawn as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primitive {
    /// A square of pixels for each sample.
    Points,
    /// The triangles of its cells.
    Triangles,
}

/// How chunks are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Largest error in pixels of the picture that is drawn; 0: none.
    pub tau: f64,
    /// What the surface is drawn as.
    pub technique: Technique,
    /// The side of points where they leave no gap, pixels; 1 at least.
    pub point: u32,
    /// How much farther from its place a point may show than one of a single pixel does, pixels.
    pub reach: f64,
    /// Most pixels between samples that looks, or lines, differ between; infinite where only places are asked for.
    pub looks: f64,
    /// The interval between lines of equal height, in units of height; infinite where there are none.
    pub lines: f64,
    /// The largest difference of changes since an earlier field that does not show; infinite where they are not shown.
    pub change: f64,
    /// Most cells that a membrane over holes spans along rows or columns; 0: there is none.
    pub spans: f64,
    /// The height that walls at the field's border, and where it is cut, go down or up to.
    pub walls: Option<f64>,
    /// Most chunks.
    pub most: usize,
}

/// How many pixels of the picture are at most between samples that looks differ between: a larger error than usual lets them be coarser, too.
pub fn looked(tau: f64) -> f64 {
    LOOKED * (tau / USUAL_TAU).max(1.0)
}

/// A chunk that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutNode {
    /// Which one.
    pub key: ChunkKey,
    /// What it says of itself.
    pub facts: NodeFacts,
    /// The box that holds it in the world.
    pub extent: Extent,
    /// What it is drawn as.
    pub primitive: Primitive,
    /// The largest error of its pixels, pixels.
    pub error_px: f64,
    /// What borders with coarser chunks add to `facts.delta` there, in units of height.
    pub added: f64,
}

/// The chunks that are drawn: none lies in another.
#[derive(Clone, Debug, Default)]
pub struct SurfaceCut {
    /// In the order of their keys.
    pub nodes: Vec<CutNode>,
    /// The number of each chunk.
    index: HashMap<ChunkKey, usize>,
    levels: Vec<u8>,
    /// The last column of cells that has a chunk of its own: that after it, which closes a globe, is in the same one.
    last_column: Option<u64>,
    /// Chunks that would be drawn if they were there, the worst first: those that they would refine, and the error in pixels.
    pub missing: Vec<(ChunkKey, f64)>,
    /// Whether nothing is missing and the budget sufficed.
    pub is_converged: bool,
    /// Whether nothing is missing, but the budget did not suffice: then it follows from the field, the view and the budget alone.
    pub is_coarser: bool,
}

impl SurfaceCut {
    /// The chunk that holds a cell of full resolution.
    pub fn at(&self, row: u64, column: u64) -> Option<usize> {
        let column = self.last_column.map_or(column, |last| column.min(last));
        self.levels.iter().find_map(|&level| {
            let shift = u32::from(level) + SIDE_BITS;
            let key = ChunkKey { level, row: (row >> shift) as u32, column: (column >> shift) as u32 };
            self.index.get(&key).copied()
        })
    }

    /// The number of a chunk that is drawn.
    pub fn number(&self, key: ChunkKey) -> Option<usize> {
        self.index.get(&key).copied()
    }

    /// The same without some chunks.
    pub fn without(self, is_left_out: impl Fn(&ChunkKey) -> bool) -> SurfaceCut {
        let SurfaceCut { nodes, missing, is_converged, is_coarser, last_column, .. } = self;
        let nodes = nodes.into_iter().filter(|node| !is_left_out(&node.key)).collect();
        SurfaceCut { missing, is_converged, is_coarser, last_column, ..SurfaceCut::new(nodes) }
    }

    /// The same of a field that may be closed.
    #[must_use]
    pub fn of(self, lattice: &Lattice) -> SurfaceCut {
        SurfaceCut { last_column: lattice.is_closed.then(|| lattice.samples[1].saturating_sub(3)), ..self }
    }

    /// A cut of these chunks, of which none lies in another, in any order.
    pub fn new(mut nodes: Vec<CutNode>) -> SurfaceCut {
        nodes.sort_by_key(|node| node.key);
        let index = nodes.iter().enumerate().map(|(number, node)| (node.key, number)).collect();
        let mut levels: Vec<u8> = nodes.iter().map(|node| node.key.level).collect();
        levels.dedup();
        SurfaceCut { nodes, index, levels, ..SurfaceCut::default() }
    }
}

/// A chunk on the way to the cut, and how many times too coarse it is.
struct Waiting {
    want: f64,
    node: CutNode,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Waiting) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Waiting) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    fn cmp(&self, other: &Waiting) -> Ordering {
        self.want.total_cmp(&other.want).then_with(|| other.node.key.cmp(&self.node.key))
    }
}

/// Chooses the chunks for a view, whose pixels are the samples of the picture.
pub fn choose(source: &dyn SurfaceNodes, placed: &Placed, sight: &Sight, choice: &Choice) -> SurfaceCut {
    let lattice = source.lattice();
    // A border that is laid upon a coarser one may reach beyond its chunk's box by what shows as `tau` pixels, and so may wide points.
    let padded = match sight {
        Sight::Flat(view) => Sight::Flat(view.padded((choice.tau.min(64.0) + choice.reach).ceil() as u32 + 2)),
        around => *around,
    };
    // Through holes, and where the field ends, the far side is seen.
    let closed = source.facts(lattice.root()).filter(|root| placed.is_whole && root.coverage == [u8::MAX; 2]);
    let lowest = closed.map(|root| placed.lifted(root.min).min(placed.lifted(root.max)));
    let horizon = lowest.and_then(|lowest| Horizon::new(placed, sight, lowest));
    // What allows no error is drawn whole.
    let room = if choice.tau > 0.0 { source.room() } else { u64::MAX };
    let chooser = Chooser { source, placed, sight, padded, choice, lattice, horizon, room };
    let mut waiting = BinaryHeap::new();
    waiting.extend(chooser.visit(lattice.root()));
    let (mut done, mut missing): (Vec<CutNode>, Vec<(ChunkKey, f64)>) = (Vec::new(), Vec::new());
    let most = choice.most.clamp(1, MOST_NODES);
    let mut is_within = true;
    let mut used: u64 = waiting.iter().map(|waiting| source.bytes(waiting.node.key)).sum();
    while let Some(Waiting { want, node }) = waiting.pop() {
        if want <= 1.0 {
            done.push(node);
            continue;
        }
        let finer = chooser.finer(node.key);
        match finer {
            Some(finer) => {
                let bytes: u64 = finer.iter().map(|waiting| source.bytes(waiting.node.key)).sum();
                let after = used - source.bytes(node.key) + bytes;
                match done.len() + waiting.len() + 4 > most || after > room {
                    true => {
                        is_within = false;
                        done.push(node);
                    }
                    false => {
                        used = after;
                        waiting.extend(finer);
                    }
                }
            }
            None => {
                missing.push((node.key, node.error_px));
                done.push(node);
            }
        }
    }
    let mut cut = chooser.balanced(done, most, &mut missing, &mut is_within);
    missing.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    (cut.is_converged, cut.is_coarser) = (is_within && missing.is_empty(), !is_within && missing.is_empty());
    cut.missing = missing;
    cut
}

struct Chooser<'a> {
    source: &'a dyn SurfaceNodes,
    placed: &'a Placed,
    sight: &'a Sight,
    padded: Sight,
    choice: &'a Choice,
    lattice: Lattice,
    /// Where a globe hides its own far side.
    horizon: Option<Horizon>,
    /// Bytes of the samples that may be drawn.
    room: u64,
}

impl Chooser<'_> {
    /// A chunk that something may be seen of, and how many times too coarse it is.
    fn visit(&self, key: ChunkKey) -> Option<Waiting> {
        let mut facts = self.source.facts(key)?;
        if facts.is_empty() {
            facts = self.spanned(key, facts)?;
        }
        let highest = self.placed.lifted(facts.min).max(self.placed.lifted(facts.max));
        if self.horizon.is_some_and(|horizon| horizon.hides(self.lattice.rectangle(key), highest)) {
            return None;
        }
        let mut extent = self.extent(self.lattice.rectangle(key), &facts, key.level);
        if let Some(base) = self.choice.walls {
            self.add_walls(&mut extent, base);
        }
        if !self.padded.sees(&extent) || !self.sight.cut().reaches(&extent.bounds) {
            return None;
        }
        let (sight, tau) = (self.sight, self.choice.tau);
        let error_px = sight.error_pixels(&extent, self.world_delta(&facts, key.level, 0.0));
        let whole = (1_u64 << key.level) as f64;
        let spacing = self.placed.spacing().map(|step| step * whole);
        let apart_px = sight.error_pixels(&extent, self.placed.apart(key.level, facts.step));
        let is_flat = matches!(sight, Sight::Flat(_));
        let most_apart = POINT_LIMIT * f64::from(self.choice.point);
        // Holes keep their area by the samples in each pixel: there are some where they are no farther apart than that.
        let dense = if facts.is_mixed() { POINT_LIMIT } else { most_apart };
        let primitive = match self.choice.technique {
            _ if facts.is_empty() => Primitive::Triangles,
            Technique::Points if is_flat => Primitive::Points,
            Technique::Hybrid if is_flat && apart_px <= dense && tau >= EXACT => Primitive::Points,
            _ => Primitive::Triangles,
        };
        let ratio = |pixels: f64, most: f64| if pixels <= most { 0.0 } else { pixels / most };
        let mut want = ratio(error_px, tau);
        if facts.is_mixed() {
            want = want.max(ratio(apart_px, tau.min(MOST_APART)));
        }
        if self.choice.technique == Technique::Points {
            want = want.max(ratio(apart_px, most_apart));
        }
        // A line on a gentle slope moves far for little. Where there are more lines than pixels none is seen.
        let lines = (facts.max - facts.min) / self.choice.lines;
        let moves_lines = facts.delta > LINES * self.choice.lines
            && lines < sight.error_pixels(&extent, f64::from(1 << SIDE_BITS) * spacing[0].max(spacing[1]));
        let looks_different = facts.deviation > UNSEEN || facts.change > self.choice.change;
        if looks_different || moves_lines {
            want = want.max(ratio(sight.error_pixels(&extent, spacing[0].max(spacing[1])), self.choice.looks));
        }
        if key.level == 0 || facts.is_empty() {
            want = 0.0;
        }
        let node = CutNode { key, facts, extent, primitive, error_px, added: 0.0 };
        Some(Waiting { want, node: CutNode { error_px: self.own_error(&node), ..node } })
    }

    /// The largest error of a chunk's pixels but for its borders. What is shown beside triangles has the place of the sample that it belongs to.
    fn own_error(&self, node: &CutNode) -> f64 {
        let CutNode { key, facts, extent, primitive, .. } = node;
        let error_px = self.sight.error_pixels(extent, self.world_delta(facts, key.level, 0.0));
        let has_margins = facts.is_mixed() && key.level > 0;
        match primitive {
            Primitive::Points => error_px + self.choice.reach,
            Primitive::Triangles if has_margins => {
                error_px.max(0.5 * self.sight.error_pixels(extent, self.placed.apart(key.level, facts.step)))
            }
            Primitive::Triangles => error_px,
        }
    }

    /// With the walls that a chunk of a flat field has where it ends or is cut.
    fn add_walls(&self, extent: &mut Extent, base: f64) {
        let inside = walls::inside(self.placed.corners(), &self.sight.cut().bounds);
        let bounds = &mut extent.bounds;
        if (0..2).any(|axis| bounds.min[axis] <= inside.min[axis] || bounds.max[axis] >= inside.max[axis]) {
            let base = self.placed.lifted(base);
            (bounds.min.z, bounds.max.z) = (bounds.min.z.min(base), bounds.max.z.max(base));
        }
    }

    /// Facts of a chunk in which nothing was measured, where a membrane may go through it: between the heights around it.
    fn spanned(&self, key: ChunkKey, facts: NodeFacts) -> Option<NodeFacts> {
        // Who spans it spans all of its cells.
        if self.choice.spans < (self.lattice.side() << key.level) as f64 {
            return None;
        }
        let around = (key.level + 1..=self.lattice.top()).filter_map(|level| self.source.facts(key.ancestor(level)));
        let around = around.into_iter().find(|facts| !facts.is_empty())?;
        Some(NodeFacts { delta: 0.0, step: 0.0, min: around.min, max: around.max, deviation: 0.0, ..facts })
    }

    /// The finer chunks in the place of one that something may be seen of; `None` where one of them is not there.
    fn finer(&self, key: ChunkKey) -> Option<Vec<Waiting>> {
        if key.level == 0 || self.lattice.children(key).any(|child| !self.source.is_there(child)) {
            return None;
        }
        Some(self.lattice.children(key).filter_map(|child| self.visit(child)).collect())
    }

    fn world_delta(&self, facts: &NodeFacts, level: u8, added: f64) -> f64 {
        let whole = (1_u64 << level) as f64;
        (facts.delta + added) * self.placed.lift.abs() + self.placed.sag(whole, whole)
    }

    /// The box around a rectangle of samples in the world.
    fn extent(&self, [rows, columns]: [[u64; 2]; 2], facts: &NodeFacts, level: u8) -> Extent {
        let ends = [rows, columns].map(|ends| ends.map(|end| end as f64));
        extent_of(self.placed, ends, [facts.min, facts.max], (1_u64 << level) as f64)
    }

    /// Refines chunks until what borders between levels add keeps within the error, too: a finer border lies on the coarser one's edges, which
    /// are within the coarser chunk's distance of T.
    fn balanced(
        &self,
        mut nodes: Vec<CutNode>,
        most: usize,
        missing: &mut Vec<(ChunkKey, f64)>,
        is_within: &mut bool,
    ) -> SurfaceCut {
        loop {
            let mut cut = SurfaceCut::new(nodes).of(&self.lattice);
            let mut coarse = Vec::new();
            // Coarser ones first: what their own borders add counts for those that lie on them.
            for number in (0..cut.nodes.len()).rev() {
                let node = cut.nodes[number];
                let mut worst = node.error_px;
                for (other, strip) in self.coarser_beside(&cut, &node) {
                    let beside = cut.nodes[other];
                    let added = beside.facts.delta + beside.added;
                    let extent = self.extent(strip, &node.facts, node.key.level);
                    // On a globe the coarser one's chords sink deeper, too.
                    let error =
                        self.sight.error_pixels(&extent, self.world_delta(&node.facts, beside.key.level, added));
                    if error > self.choice.tau && added > 0.0 && self.padded.sees(&extent) {
                        coarse.push(beside.key);
                    }
                    if self.sight.sees(&extent) {
                        worst = worst.max(error);
                    }
                    cut.nodes[number].added = cut.nodes[number].added.max(added);
                }
                cut.nodes[number].error_px = worst;
            }
            coarse.sort();
            coarse.dedup();
            let mut refined = Vec::new();
            let mut used: u64 = cut.nodes.iter().map(|node| self.source.bytes(node.key)).sum();
            for key in coarse {
                if missing.iter().any(|(parent, _)| *parent == key) {
                    continue;
                }
                if cut.nodes.len() + 3 * (refined.len() + 1) > most {
                    *is_within = false;
                    break;
                }
                match self.finer(key) {
                    Some(finer) => {
                        let added: u64 = finer.iter().map(|waiting| self.source.bytes(waiting.node.key)).sum();
                        used = used - self.source.bytes(key) + added;
                        if used > self.room {
                            *is_within = false;
                            break;
                        }
                        refined.push((key, finer));
                    }
                    None => missing.push((key, cut.index.get(&key).map_or(0.0, |number| cut.nodes[*number].error_px))),
                }
            }
            if refined.is_empty() {
                return cut;
            }
            let is_refined = |key: &ChunkKey| refined.iter().any(|(refined, _)| refined == key);
            nodes = cut.nodes.into_iter().filter(|node| !is_refined(&node.key)).map(reset).collect();
            nodes.extend(refined.into_iter().flat_map(|(_, finer)| finer).map(|waiting| waiting.node));
            // The error of what stays is worked out anew.
            for node in &mut nodes {
                node.error_px = self.own_error(node);
            }
        }
    }

    /// The coarser chunks that share a side with one, each with the rectangle of the cells that lie on it.
    fn coarser_beside(&self, cut: &SurfaceCut, node: &CutNode) -> Vec<(usize, [[u64; 2]; 2])> {
        let rectangle @ [rows, columns] = self.lattice.rectangle(node.key);
        let whole = 1_u64 << node.key.level;
        let mut found = Vec::new();
        for (axis, is_last) in [(0, false), (0, true), (1, false), (1, true)] {
            // A coarser neighbour is beside the whole side, and at the rim there is none.
            let [first, last] = rectangle[axis];
            let Some(place) =
                beside(&self.lattice, self.placed.around, axis, if is_last { last } else { first }, is_last)
            else {
                continue;
            };
            let cell = if axis == 0 { [place, columns[0]] } else { [rows[0], place] };
            let Some(other) = cut.at(cell[0], cell[1]) else { continue };
            if cut.nodes[other].key.level > node.key.level {
                let mut strip = rectangle;
                strip[axis] = if is_last {
                    [last.saturating_sub(whole).max(first), last]
                } else {
                    [first, (first + whole).min(last)]
                };
                found.push((other, strip));
            }
        }
        found
    }
}

/// The box around what stands in the world between rows, between columns and between heights, of samples that are so many rows and columns apart.
pub(super) fn extent_of(placed: &Placed, [rows, columns]: [[f64; 2]; 2], heights: [f64; 2], whole: f64) -> Extent {
    if placed.is_flat() {
        let corners = rows.into_iter().zip(columns).zip(heights);
        let points = corners.map(|((row, column), height)| placed.world(row, column, height));
        return Extent { bounds: Bounds::of(points.map(|point| point.to_array())), margin: 0.0 };
    }
    // Places between those looked at stand out of their box by no more than the arc between them does.
    const PARTS: u32 = 4;
    let between = |ends: [f64; 2], part: u32| ends[0] + (ends[1] - ends[0]) * f64::from(part) / f64::from(PARTS);
    let points = (0..=PARTS).flat_map(|i| (0..=PARTS).map(move |j| (i, j))).flat_map(|(i, j)| {
        heights.map(|height| placed.world(between(rows, i), between(columns, j), height).to_array())
    });
    let bounds = Bounds::of(points);
    let part = |ends: [f64; 2]| (ends[1] - ends[0]) / f64::from(PARTS);
    let sag = placed.sag(part(columns).max(whole), part(rows).max(whole));
    let bounds = Bounds { min: bounds.min - DVec3::splat(sag), max: bounds.max + DVec3::splat(sag) };
    Extent { bounds, margin: 0.0 }
}

/// The row (axis 0) or column (1) of cells on the other side of a chunk's first or last row or column; `None` at a rim. Where the field goes round,
/// and its last column is the first one again, the seam is no rim.
pub(super) fn beside(lattice: &Lattice, around: Option<u64>, axis: usize, line: u64, is_last: bool) -> Option<u64> {
    let last = lattice.samples[axis] - 1;
    let goes_round = axis == 1 && around == Some(last);
    match is_last {
        false if line == 0 => goes_round.then(|| last - 1),
        false => Some(line - 1),
        true if line >= last => goes_round.then_some(0),
        true => Some(line),
    }
}

fn reset(node: CutNode) -> CutNode {
    CutNode { added: 0.0, ..node }
}

#[cfg(test)]
mod tests;
