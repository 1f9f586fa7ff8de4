//! Sampled fields: images and volumes in memory, asked for their values anywhere.
//!
//! Between samples values are interpolated linearly. What a picture shows at less than its own resolution is asked for from box means of
//! 2, 4, 8, ... samples along each axis, so that nothing between two pixels is lost.

pub mod bricks;
pub mod gradient;
pub mod plane;
pub mod points;
pub mod seen_points;
pub mod values;
pub mod xray;

pub use bricks::FieldBricks;
pub use points::FieldPoints;
pub use seen_points::{PointLook, SeenPoints};
pub use values::ValueAxis;

use crate::model::{Bounds, Grid, Unit};
use glam::{DAffine3, DVec3};
use rayon::prelude::*;

/// Samples along a side of the blocks whose ranges are known.
pub const BLOCK: usize = 8;

/// An image or a volume.
#[derive(Clone, Debug)]
pub struct Field {
    /// 2 or 3.
    pub dimensions: usize,
    /// What each sample holds; all of the same shape, at least one.
    pub channels: Vec<FieldChannel>,
    /// From indices of samples to the world.
    pub to_world: DAffine3,
    /// From the world to indices of samples.
    pub to_index: DAffine3,
    /// Whether the first three channels are red, green and blue, and a fourth opacity, with this value of full light.
    pub full_light: Option<f32>,
}

/// One of the values of samples.
#[derive(Clone, Debug)]
pub struct FieldChannel {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// The samples, then means of ever larger boxes.
    pub levels: Vec<FieldLevel>,
}

/// Samples, or means of boxes of them.
#[derive(Clone, Debug)]
pub struct FieldLevel {
    /// Their number along each axis.
    pub shape: [usize; 3],
    /// Their values, x fastest; NaN where there is none.
    pub values: Vec<f32>,
    /// Whether any is NaN.
    has_holes: bool,
    /// Number of blocks along each axis.
    blocks: [usize; 3],
    /// Smallest and largest value of each block.
    ranges: Vec<[f32; 2]>,
}

impl Field {
    /// A field of a grid's samples, a plane of them for each channel that is given.
    pub fn new(grid: &Grid, channels: Vec<(String, Unit, Vec<f32>)>, full_light: Option<f32>) -> Field {
        let shape = grid.shape.map(|side| side as usize);
        let channels = channels.into_iter().map(|(name, unit, values)| {
            let mut levels = vec![FieldLevel::new(shape, values)];
            while let Some(coarser) = levels.last().and_then(FieldLevel::coarser) {
                levels.push(coarser);
            }
            FieldChannel { name, unit, levels }
        });
        Field {
            dimensions: grid.dimensions,
            channels: channels.collect(),
            to_world: grid.to_world,
            to_index: grid.to_world.inverse(),
            full_light,
        }
    }

    /// Number of samples along each axis.
    pub fn shape(&self) -> [usize; 3] {
        self.channels[0].levels[0].shape
    }

    /// Smallest and largest value of a channel; `None` where no sample is a number.
    pub fn range(&self, channel: usize) -> Option<[f32; 2]> {
        let ranges = &self.channels[channel].levels[0].ranges;
        let whole = ranges.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |all, block| both(all, *block));
        (whole[0] <= whole[1]).then_some(whole)
    }

    /// The least distance of neighbouring samples, world units.
    pub fn spacing(&self) -> f64 {
        let columns = (0..self.dimensions).map(|axis| self.to_world.matrix3.col(axis).length());
        columns.fold(f64::INFINITY, f64::min)
    }

    /// The level for a picture whose samples are so far apart, world units: means over no more than that.
    pub fn level_for(&self, distance: f64) -> usize {
        let octaves = (distance / self.spacing()).log2();
        let most = self.channels[0].levels.len() - 1;
        if octaves > 0.0 { (octaves + 0.25).floor().min(most as f64) as usize } else { 0 }
    }

    /// Whether a place is within the box around all samples, by its indices.
    #[inline]
    pub fn holds(&self, at: [f32; 3]) -> bool {
        let shape = self.shape();
        (0..self.dimensions).all(|axis| at[axis] >= -0.5 && at[axis] <= shape[axis] as f32 - 0.5)
    }

    /// The box around all samples.
    pub fn bounds(&self) -> Bounds {
        let shape = self.shape();
        Bounds::of((0..8).map(|corner| {
            let end = |axis: usize| match (axis < self.dimensions, corner >> axis & 1) {
                (false, _) => 0.0,
                (true, 0) => -0.5,
                (true, _) => shape[axis] as f64 - 0.5,
            };
            self.to_world.transform_point3(DVec3::new(end(0), end(1), end(2))).to_array()
        }))
    }

    /// The largest extent of the box around all samples, world units.
    pub fn diameter(&self) -> f64 {
        self.bounds().size().length()
    }
}

/// What four samples count for in a cubic B-spline, at a share of the way from the second to the third, and in its slope.
fn spline(t: f32) -> [[f32; 4]; 2] {
    let (s, [t2, t3]) = (1.0 - t, [t * t, t * t * t]);
    let shares = [s * s * s, 3.0 * t3 - 6.0 * t2 + 4.0, 3.0 * (t + t2 - t3) + 1.0, t3].map(|share| share / 6.0);
    [shares, [-0.5 * s * s, 1.5 * t2 - 2.0 * t, 0.5 + t - 1.5 * t2, 0.5 * t2]]
}

/// What they count for where the second is the sample `first` of those up to `last`: one that is missing lies on the line of its neighbours.
fn within(mut weights: [f32; 4], first: usize, last: usize) -> [f32; 4] {
    if first == 0 {
        let [missing, a, b, c] = weights;
        weights = [0.0, a + 2.0 * missing, b - missing, c];
    }
    if first + 2 > last {
        let [a, b, c, missing] = weights;
        weights = [a, b - missing, c + 2.0 * missing, 0.0];
    }
    weights
}

fn both(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl FieldLevel {
    /// Values of a shape, with what is known of them.
    fn new(shape: [usize; 3], values: Vec<f32>) -> FieldLevel {
        let blocks = shape.map(|side| side.div_ceil(BLOCK));
        let range = |block: usize| {
            let at = [block % blocks[0], block / blocks[0] % blocks[1], block / (blocks[0] * blocks[1])];
            let span = |axis: usize| at[axis] * BLOCK..((at[axis] + 1) * BLOCK).min(shape[axis]);
            let (mut range, mut holes) = ([f32::INFINITY, f32::NEG_INFINITY], false);
            for (z, y) in span(2).flat_map(|z| span(1).map(move |y| (z, y))) {
                let row = (z * shape[1] + y) * shape[0];
                for value in &values[row + span(0).start..row + span(0).end] {
                    // The smaller one of a number and NaN is the number.
                    range = both(range, [*value; 2]);
                    holes |= value.is_nan();
                }
            }
            (range, holes)
        };
        let found: Vec<([f32; 2], bool)> = (0..blocks.iter().product()).into_par_iter().map(range).collect();
        let has_holes = found.iter().any(|(_, holes)| *holes);
        FieldLevel { shape, values, has_holes, blocks, ranges: found.into_iter().map(|(range, _)| range).collect() }
    }

    /// Means of pairs along each axis; `None` of a single sample.
    fn coarser(&self) -> Option<FieldLevel> {
        let shape = self.shape.map(|side| side.div_ceil(2));
        if shape == self.shape {
            return None;
        }
        let row = |row: usize| {
            let (y, z) = (row % shape[1], row / shape[1]);
            let span = |at: usize, axis: usize| 2 * at..(2 * at + 2).min(self.shape[axis]);
            (0..shape[0]).map(move |x| {
                let (mut sum, mut count) = (0.0f32, 0.0f32);
                for (z, y) in span(z, 2).flat_map(|z| span(y, 1).map(move |y| (z, y))) {
                    let row = (z * self.shape[1] + y) * self.shape[0];
                    for value in &self.values[row + span(x, 0).start..row + span(x, 0).end] {
                        if !value.is_nan() {
                            sum += value;
                            count += 1.0;
                        }
                    }
                }
                // 0 / 0 is NaN.
                sum / count
            })
        };
        let mut values = vec![0.0; shape.iter().product()];
        let rows = values.par_chunks_mut(shape[0]).enumerate();
        rows.for_each(|(index, out)| out.iter_mut().zip(row(index)).for_each(|(out, value)| *out = value));
        Some(FieldLevel::new(shape, values))
    }

    /// Number of blocks of [`BLOCK`] samples along each axis.
    pub fn blocks(&self) -> [usize; 3] {
        self.blocks
    }

    /// The largest value of each block, x fastest; `None` of holes alone.
    pub fn most_of_blocks(&self) -> impl Iterator<Item = Option<f32>> + '_ {
        self.ranges.iter().map(|[least, most]| (least <= most).then_some(*most))
    }

    /// Between which values those within a box lie, both ends of which are indices of samples; `None` outside and of holes alone.
    pub fn range_within(&self, low: [f32; 3], high: [f32; 3]) -> Option<[f32; 2]> {
        // Casts saturate, so that what lies outside becomes the border.
        let span = |axis: usize| {
            let last = self.shape[axis] - 1;
            (high[axis] >= -1.0 && low[axis] <= last as f32 + 1.0).then(|| {
                let (from, to) = (low[axis].floor() as usize, high[axis].ceil() as usize);
                from.min(last) / BLOCK..=to.min(last) / BLOCK
            })
        };
        let [x, y, z] = [span(0)?, span(1)?, span(2)?];
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for (z, y) in z.flat_map(|z| y.clone().map(move |y| (z, y))) {
            let row = (z * self.blocks[1] + y) * self.blocks[0];
            for block in &self.ranges[row + x.start()..=row + x.end()] {
                range = both(range, *block);
            }
        }
        (range[0] <= range[1]).then_some(range)
    }

    /// The value between samples, by their indices: trilinear, beyond the outermost samples theirs; NaN in holes.
    #[inline]
    pub fn at(&self, at: [f32; 3]) -> f32 {
        let axis = |axis: usize| {
            let last = self.shape[axis] - 1;
            let place = at[axis].clamp(0.0, last as f32);
            // Not negative.
            let first = place as usize;
            (first, (first + 1).min(last), place - first as f32)
        };
        let ((x0, x1, u), (y0, y1, v), (z0, z1, w)) = (axis(0), axis(1), axis(2));
        let row = |y: usize, z: usize| (z * self.shape[1] + y) * self.shape[0];
        let along = |row: usize| {
            let (a, b) = (self.values[row + x0], self.values[row + x1]);
            a + u * (b - a)
        };
        let plane = |z: usize| {
            let (a, b) = (along(row(y0, z)), along(row(y1, z)));
            a + v * (b - a)
        };
        let value = if z0 == z1 {
            plane(z0)
        } else {
            let (a, b) = (plane(z0), plane(z1));
            a + w * (b - a)
        };
        match self.has_holes && value.is_nan() {
            true => self.beside_holes(([x0, x1], u), ([y0, y1], v), ([z0, z1], w)),
            false => value,
        }
    }

    /// The value of what neighbours there are, where the nearest one is there.
    #[cold]
    fn beside_holes(&self, (x, u): ([usize; 2], f32), (y, v): ([usize; 2], f32), (z, w): ([usize; 2], f32)) -> f32 {
        let read = |corner: [usize; 3]| {
            self.values[(z[corner[2]] * self.shape[1] + y[corner[1]]) * self.shape[0] + x[corner[0]]]
        };
        let near = |share: f32| usize::from(share > 0.5);
        if read([near(u), near(v), near(w)]).is_nan() {
            return f32::NAN;
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for corner in (0..8).map(|corner| [corner & 1, corner >> 1 & 1, corner >> 2]) {
            let share = |side: usize, share: f32| if side == 1 { share } else { 1.0 - share };
            let weight = share(corner[0], u) * share(corner[1], v) * share(corner[2], w);
            let value = read(corner);
            if !value.is_nan() {
                sum += weight * value;
                weights += weight;
            }
        }
        sum / weights
    }

    /// How the field changes along each axis for a unit of the level's indices, by cubic B-splines of what `place` makes of samples: what is
    /// interpolated linearly has slopes that jump from sample to sample. Beyond the outermost samples it goes on as it ends; of holes `place`
    /// says what they are taken for.
    pub fn slope(&self, at: [f32; 3], place: impl Fn(f32) -> f32) -> [f32; 3] {
        let axis = |axis: usize| {
            let last = self.shape[axis] - 1;
            let at = at[axis].clamp(0.0, last as f32);
            let first = (at as usize).min(last.saturating_sub(1));
            let samples = [0, 1, 2, 3].map(|k: usize| (first + k).saturating_sub(1).min(last));
            let [shares, slopes] = spline(at - first as f32).map(|weights| within(weights, first, last));
            (samples, shares, slopes)
        };
        let [x, y, z] = [0, 1, 2].map(axis);
        let mut sum = [0.0f32; 3];
        for k in 0..4 {
            for j in 0..4 {
                let row = (z.0[k] * self.shape[1] + y.0[j]) * self.shape[0];
                let (mut value, mut slope) = (0.0, 0.0);
                for i in 0..4 {
                    let sample = place(self.values[row + x.0[i]]);
                    value += x.1[i] * sample;
                    slope += x.2[i] * sample;
                }
                sum[0] += y.1[j] * z.1[k] * slope;
                sum[1] += y.2[j] * z.1[k] * value;
                sum[2] += y.1[j] * z.2[k] * value;
            }
        }
        sum
    }

    /// The first and the last index of a level at which so many samples along an axis, each with its surroundings, still are.
    pub fn ends(level: usize, samples: f64) -> [f64; 2] {
        [-0.5, samples / f64::from(1u32 << level) - 0.5]
    }

    /// As [`FieldLevel::indices`], in double precision.
    pub fn fine_indices(level: usize, at: [f64; 3]) -> [f64; 3] {
        let scale = 1.0 / f64::from(1u32 << level);
        at.map(|index| (index + 0.5) * scale - 0.5)
    }

    /// The indices of this level for indices of samples, where each value here stands for `2^level` of them along an axis.
    #[inline]
    pub fn indices(level: usize, at: [f32; 3]) -> [f32; 3] {
        let scale = 1.0 / (1u32 << level) as f32;
        at.map(|index| (index + 0.5) * scale - 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Channel, SampleType};

    fn field(shape: [u64; 3], value: impl Fn(usize, usize, usize) -> f32) -> Field {
        let grid = Grid::volume(shape, SampleType::F32, Channel::numbered(1));
        let [x, y, z] = shape.map(|side| side as usize);
        let values = (0..x * y * z).map(|i| value(i % x, i / x % y, i / (x * y))).collect();
        Field::new(&grid, vec![("value".into(), Unit::default(), values)], None)
    }

    #[test]
    fn what_is_linear_is_met_everywhere_and_at_every_level() {
        let linear = |x: f32, y: f32, z: f32| 3.0 + 2.0 * x - y + 0.5 * z;
        let field = field([32, 16, 24], |x, y, z| linear(x as f32, y as f32, z as f32));
        for i in 0..200 {
            let at = [4.0 + 0.113 * i as f32, 4.0 + 0.037 * i as f32, 4.0 + 0.07 * i as f32];
            for level in 0..3 {
                let own = FieldLevel::indices(level, at);
                let value = field.channels[0].levels[level].at(own);
                assert!((value - linear(at[0], at[1], at[2])).abs() < 1e-3, "{level} {at:?} {value}");
            }
        }
        assert_eq!(field.range(0), Some([linear(0.0, 15.0, 0.0), linear(31.0, 0.0, 23.0)]));
        assert_eq!((field.level_for(0.5), field.level_for(2.0), field.level_for(1e9)), (0, 1, 5));
    }

    #[test]
    fn slopes_of_what_is_linear_are_exact_up_to_the_border() {
        let field = field([9, 6, 7], |x, y, z| 3.0 + 2.0 * x as f32 - y as f32 + 0.5 * z as f32);
        for i in 0..200 {
            let at = [-0.5 + 0.0455 * i as f32, 5.5 - 0.0301 * i as f32, -0.5 + 0.0352 * i as f32];
            let found = field.channels[0].levels[0].slope(at, |value| value);
            let error = found.iter().zip([2.0f32, -1.0, 0.5]).map(|(found, slope)| (found - slope).abs());
            assert!(error.fold(0.0, f32::max) < 1e-4, "{at:?} {found:?}");
        }
    }

    #[test]
    fn holes_stay_holes_and_do_not_grow() {
        let field = field([8, 8, 8], |x, _, _| if x == 4 { f32::NAN } else { 7.0 });
        let level = &field.channels[0].levels[0];
        assert!(level.at([4.0, 3.0, 3.0]).is_nan() && level.at([3.6, 3.0, 3.0]).is_nan());
        assert_eq!((level.at([3.4, 3.2, 3.0]), level.at([3.0, 3.0, 3.0])), (7.0, 7.0));
        assert_eq!(field.channels[0].levels[1].at([2.0, 1.0, 1.0]), 7.0);
    }
}
