//! The points of a cut through the hierarchy of an image or a volume, as what they are in the world: how large, where, of what shape, and what
//! they show there.
//!
//! A point stands for its share of the samples of its node ([`Set::shares`]): all of them where the node is one large point, and a sample for
//! itself. A sample is a box of the grid, not a place. So the point's volume is that of these boxes, its place their mean and its shape their
//! second moments: round in the grid's own steps, or thin across the direction of a set; where the grid ends within the node, or samples are no
//! numbers or count as air, what is there counts. Its value is the mean of what the cut shows of its share, so that the sum of values times volumes
//! is the integral of the field that is shown, however large points blend with their neighbours.

use super::Field;
use crate::cpu::{NodeTraits, SplatKind};
use crate::hierarchy::wavelet::sets::MOST;
use crate::hierarchy::wavelet::{Cut, Drawn, Hierarchy, Level, Set};
use crate::model::Covariance;
use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Samples below the nodes that one task goes through, about.
const TASK: usize = 1 << 15;
/// The variance of a box one step wide.
const BOX: f64 = 1.0 / 12.0;

/// The points of a cut.
#[derive(Clone, Debug, Default)]
pub struct FieldPoints {
    /// World position of offset zero.
    pub origin: DVec3,
    /// The points, those of the finest nodes first.
    pub batches: Vec<PointBatch>,
}

/// Points of one kind and level as columns of one length.
#[derive(Clone, Debug)]
pub struct PointBatch {
    /// Their level, and what they stand for.
    pub traits: NodeTraits,
    /// World positions minus [`FieldPoints::origin`].
    pub offsets: Vec<[f32; 3]>,
    /// Second moments about these, world units squared; flat in images.
    pub covariances: Vec<Covariance>,
    /// What of the world each stands for: world units cubed, of images squared.
    pub volumes: Vec<f32>,
    /// The root of the mean squared difference of the first channel's values from the samples' in the point's node.
    pub misfits: Vec<f32>,
    /// Of each channel of the field the values.
    pub values: Vec<Vec<f32>>,
}

impl FieldPoints {
    /// The points of a cut that shows a field of these samples; `samples` are the true values of its first channel.
    pub fn new(hierarchy: &Hierarchy, cut: &Cut, field: &Field, samples: &[f32]) -> FieldPoints {
        let cutting = Cutting::new(hierarchy, cut, field, samples);
        if hierarchy.levels.is_empty() {
            // A single sample has no node.
            let mut batch = cutting.batch(SplatKind::Leaf, 0);
            cutting.sample([0; 3], &mut batch);
            return FieldPoints { origin: cutting.origin, batches: vec![batch] };
        }
        let mut tasks: Vec<(SplatKind, usize, Range<usize>)> = Vec::new();
        for (level, nodes) in hierarchy.levels.iter().enumerate() {
            let kinds = [SplatKind::Leaf, SplatKind::Cluster, SplatKind::Merged];
            let together = (TASK >> (hierarchy.dimensions * (level + 1)).min(31)).max(1);
            let (count, first) = (nodes.samples.len(), usize::from(level > 0));
            tasks.extend(kinds.into_iter().skip(first).flat_map(|kind| {
                (0..count).step_by(together).map(move |from| (kind, level, from..(from + together).min(count)))
            }));
        }
        let of_task = |(kind, level, nodes)| Some(cutting.points(kind, level, nodes)).filter(|batch| !batch.is_empty());
        FieldPoints { origin: cutting.origin, batches: tasks.into_par_iter().filter_map(of_task).collect() }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.batches.iter().map(PointBatch::len).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.batches.iter().all(PointBatch::is_empty)
    }
}

impl PointBatch {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }
}

/// A cut and what it shows.
struct Cutting<'a> {
    hierarchy: &'a Hierarchy,
    cut: &'a Cut,
    /// What each byte tells.
    sets: Vec<Option<Set>>,
    /// The values of each channel of the field.
    channels: Vec<&'a [f32]>,
    samples: &'a [f32],
    to_world: DAffine3,
    origin: DVec3,
    /// What of the world a sample stands for.
    cell: f64,
    /// The second moments of a sample.
    box_moments: Covariance,
}

/// Sums over the samples of a node of what one of its points has of them; places are steps of the grid from the node's middle.
#[derive(Clone, Copy, Default)]
struct Sums {
    share: f64,
    first: DVec3,
    /// xx, yy, zz, xy, xz, yz.
    second: [f64; 6],
}

/// Sums of values of a channel, and of the shares that they count with.
#[derive(Clone, Copy, Default)]
struct Shown {
    value: [f64; MOST],
    share: [f64; MOST],
}

impl Sums {
    fn add(&mut self, share: f64, at: DVec3) {
        let part = share * at;
        self.share += share;
        self.first += part;
        let products = [part.x * at.x, part.y * at.y, part.z * at.z, part.x * at.y, part.x * at.z, part.y * at.z];
        self.second.iter_mut().zip(products).for_each(|(sum, own)| *sum += own);
    }

    /// The mean place, and the second moments about it of boxes around the places, one step wide along as many axes as there are dimensions.
    fn moments(&self, dimensions: usize) -> (DVec3, DMat3) {
        let mean = self.first / self.share;
        let [xx, yy, zz, xy, xz, yz] = self.second.map(|sum| sum / self.share);
        let second = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
        let about = DMat3::from_cols(mean.x * mean, mean.y * mean, mean.z * mean);
        (mean, second - about + boxes(dimensions))
    }
}

/// The second moments of a sample in steps of the grid.
fn boxes(dimensions: usize) -> DMat3 {
    DMat3::from_diagonal(DVec3::new(BOX, BOX, if dimensions == 3 { BOX } else { 0.0 }))
}

impl<'a> Cutting<'a> {
    fn new(hierarchy: &'a Hierarchy, cut: &'a Cut, field: &'a Field, samples: &'a [f32]) -> Cutting<'a> {
        let to_world = field.to_world;
        let axes = to_world.matrix3;
        let middle = DVec3::from_array(hierarchy.shape.map(|side| 0.5 * side.saturating_sub(1) as f64));
        let is_flat = hierarchy.dimensions == 2;
        Cutting {
            hierarchy,
            cut,
            sets: (0..=u8::MAX).map(|code| Set::of(hierarchy.dimensions, code)).collect(),
            channels: field.channels.iter().map(|channel| channel.levels[0].values.as_slice()).collect(),
            samples,
            to_world,
            origin: to_world.transform_point3(middle),
            cell: if is_flat { axes.x_axis.cross(axes.y_axis).length() } else { axes.determinant().abs() },
            box_moments: Covariance::of(axes * boxes(hierarchy.dimensions) * axes.transpose()),
        }
    }

    /// A batch without points; steps from the root are those of a level, of samples one more than of the finest one.
    fn batch(&self, kind: SplatKind, level: usize) -> PointBatch {
        let steps = self.hierarchy.levels.len() - level - usize::from(kind != SplatKind::Leaf);
        PointBatch {
            traits: NodeTraits { level: steps.min(255) as u8, kind, misfit: None },
            offsets: Vec::new(),
            covariances: Vec::new(),
            volumes: Vec::new(),
            misfits: Vec::new(),
            values: vec![Vec::new(); self.channels.len()],
        }
    }

    /// The points of a kind of some nodes of a level; of the first one samples, too.
    fn points(&self, kind: SplatKind, level: usize, nodes: Range<usize>) -> PointBatch {
        let wanted = match kind {
            SplatKind::Leaf => Drawn::Refined,
            SplatKind::Merged => Drawn::Large,
            SplatKind::Cluster => Drawn::Directed,
        };
        let (own, drawn) = (&self.hierarchy.levels[level], &self.cut.drawn[level]);
        let mut batch = self.batch(kind, level);
        let mut shown = vec![Shown::default(); self.channels.len()];
        for node in nodes.filter(|&node| drawn[node] == wanted) {
            let corner = self.corner(own, level, node);
            match kind {
                SplatKind::Leaf => self.each(corner, 2, |at| self.sample(at, &mut batch)),
                SplatKind::Merged => self.node(None, level, corner, &mut shown, &mut batch),
                SplatKind::Cluster => {
                    let set = self.sets[usize::from(own.set[node])];
                    self.node(set.as_ref(), level, corner, &mut shown, &mut batch);
                }
            }
        }
        batch
    }

    /// The first sample of a node.
    fn corner(&self, own: &Level, level: usize, node: usize) -> [usize; 3] {
        let [width, height, _] = own.shape;
        let at = [node % width, node / width % height, node / (width * height)];
        std::array::from_fn(|axis| if axis < self.hierarchy.dimensions { at[axis] << (level + 1) } else { 0 })
    }

    /// Tells each sample that is there of a box with so many along each side.
    fn each(&self, corner: [usize; 3], side: usize, mut told: impl FnMut([usize; 3])) {
        let shape = self.hierarchy.shape;
        let span = |axis: usize| corner[axis]..(corner[axis] + side).min(shape[axis]);
        for z in span(2) {
            for y in span(1) {
                span(0).for_each(|x| told([x, y, z]));
            }
        }
    }

    /// The index of a sample.
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        let [width, height, _] = self.hierarchy.shape;
        (z * height + y) * width + x
    }

    /// Whether no point stands for a sample: it is no number, or counts as air.
    fn is_hole(&self, index: usize) -> bool {
        self.channels[0][index].is_nan() || self.hierarchy.planes.holes.get(index) == Some(&true)
    }

    /// Adds a sample as a point; none that is no number.
    fn sample(&self, at: [usize; 3], batch: &mut PointBatch) {
        let index = self.index(at);
        if self.is_hole(index) {
            return;
        }
        let place = self.to_world.transform_point3(DVec3::from_array(at.map(|step| step as f64)));
        batch.offsets.push((place - self.origin).as_vec3().to_array());
        batch.covariances.push(self.box_moments);
        batch.volumes.push(self.cell as f32);
        batch.misfits.push(0.0);
        batch.values.iter_mut().zip(&self.channels).for_each(|(values, channel)| values.push(channel[index]));
    }

    /// Adds the points of a node whose first sample this is: those of its set, or one.
    fn node(&self, set: Option<&Set>, level: usize, corner: [usize; 3], shown: &mut [Shown], batch: &mut PointBatch) {
        let side = 2_usize << level;
        let middle = DVec3::from_array(std::array::from_fn(|axis| {
            if axis < self.hierarchy.dimensions { corner[axis] as f64 + 0.5 * (side - 1) as f64 } else { 0.0 }
        }));
        let points = set.map_or(1, |set| set.points);
        let mut sums = [Sums::default(); MOST];
        let (mut squares, mut numbers) = (0.0, 0.0);
        shown.fill(Shown::default());
        self.each(corner, side, |at| {
            let index = self.index(at);
            if self.is_hole(index) {
                return;
            }
            let off = f64::from(self.channels[0][index]) - f64::from(self.samples[index]);
            squares += off * off;
            numbers += 1.0;
            let place = DVec3::from_array(at.map(|step| step as f64)) - middle;
            let extent = 1.0 / side as f64;
            let shares = set.map_or([1.0, 0.0, 0.0], |set| set.shares((extent * place).as_vec3().to_array()));
            let shares = shares.map(f64::from);
            sums.iter_mut().zip(shares).take(points).for_each(|(sums, share)| sums.add(share, place));
            for (shown, channel) in shown.iter_mut().zip(&self.channels) {
                let value = f64::from(channel[index]);
                if value.is_finite() {
                    for (k, share) in shares.iter().enumerate().take(points) {
                        shown.value[k] += share * value;
                        shown.share[k] += share;
                    }
                }
            }
        });
        let axes = self.to_world.matrix3;
        let misfit = f64::sqrt(squares / f64::max(numbers, 1.0)) as f32;
        for (k, sums) in sums.iter().enumerate().take(points).filter(|(_, sums)| sums.share > 0.0) {
            let (mean, moments) = sums.moments(self.hierarchy.dimensions);
            let place = self.to_world.transform_point3(middle + mean);
            batch.offsets.push((place - self.origin).as_vec3().to_array());
            batch.covariances.push(Covariance::of(axes * moments * axes.transpose()));
            batch.volumes.push((sums.share * self.cell) as f32);
            batch.misfits.push(misfit);
            let of = |shown: &Shown| (shown.value[k] / shown.share[k]) as f32;
            batch.values.iter_mut().zip(&*shown).for_each(|(values, shown)| values.push(of(shown)));
        }
    }
}

#[cfg(test)]
mod tests;
