//! Points of cuts against sums over the samples that they stand for.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::hierarchy::wavelet::{Options, Samples};
use crate::model::{Channel, Grid, SampleType, Unit};
use glam::Vec3;

/// A grid, its samples and the points over them.
struct Case {
    grid: Grid,
    values: Vec<f32>,
    hierarchy: Hierarchy,
}

impl Case {
    fn new(grid: Grid, value: impl Fn([f64; 3]) -> f64) -> Case {
        let [width, height, depth] = grid.shape.map(|side| side as usize);
        let at = |i: usize| [i % width, i / width % height, i / (width * height)].map(|step| step as f64);
        let values: Vec<f32> = (0..width * height * depth).map(|i| value(at(i)) as f32).collect();
        let shape = [width, height, depth];
        let samples = Samples { dimensions: grid.dimensions, shape, channels: vec![&values] };
        let hierarchy = Hierarchy::build(&samples, &Options::default());
        Case { grid, values, hierarchy }
    }

    /// The best cut of so many points, what it shows, and its points.
    fn drawn(&self, most: usize) -> (Cut, Field, FieldPoints) {
        let samples = Samples {
            dimensions: self.grid.dimensions,
            shape: self.hierarchy.shape,
            channels: vec![self.values.as_slice()],
        };
        let cut = self.hierarchy.cut_of_points(most);
        let shown = self.hierarchy.reconstruct(&samples, &cut).remove(0);
        let field = Field::new(&self.grid, vec![("value".into(), Unit::default(), shown)], None);
        let points = FieldPoints::new(&self.hierarchy, &cut, &field, &self.values);
        (cut, field, points)
    }
}

/// Axes that are neither orthogonal nor of one length.
fn oblique(dimensions: usize) -> DAffine3 {
    let third = if dimensions == 3 { DVec3::new(0.4, -0.3, 1.1) } else { DVec3::Z };
    let axes = DMat3::from_cols(DVec3::new(0.7, 0.2, 0.1), DVec3::new(-0.5, 1.6, 0.3), third);
    DAffine3::from_mat3_translation(axes, DVec3::new(30.0, -20.0, 5.0))
}

/// A ball with a soft edge beside a sharp plane, with some samples that are no numbers.
fn volume() -> Case {
    let grid = Grid::volume([29, 26, 19], SampleType::F32, Channel::numbered(1));
    Case::new(Grid { to_world: oblique(3), ..grid }, |[x, y, z]| {
        let away = ((x - 10.0).powi(2) + (y - 12.0).powi(2) + (z - 9.0).powi(2)).sqrt();
        let is_hole = x > 20.0 && y < 4.0 && z < 3.0;
        let plane = if x + 0.5 * y - z > 24.0 { 70.0 } else { 10.0 };
        if is_hole { f64::NAN } else { plane + 90.0 / (1.0 + (away - 6.0).exp()) }
    })
}

fn image() -> Case {
    let grid = Grid::image([61, 45], SampleType::F32, Channel::numbered(1));
    Case::new(Grid { to_world: oblique(2), ..grid }, |[x, y, _]| {
        40.0 + 30.0 * (0.2 * x).sin() * (0.11 * y).cos() + if 2.0 * x - y > 50.0 { 60.0 } else { 0.0 }
    })
}

#[test]
fn points_hold_the_integral_of_what_they_show() {
    for case in [volume(), image()] {
        let is_flat = case.grid.dimensions == 2;
        let axes = case.grid.to_world.matrix3;
        let cell = if is_flat { axes.x_axis.cross(axes.y_axis).length() } else { axes.determinant().abs() };
        let all = case.values.iter().filter(|value| value.is_finite()).count();
        for share in [1.0, 0.3, 0.1, 0.02, 0.0] {
            let (cut, field, points) = case.drawn((share * all as f64) as usize);
            assert_eq!(points.len(), cut.points, "{share}");
            let leaves = points.batches.iter().filter(|batch| batch.traits.kind == SplatKind::Leaf);
            assert_eq!(leaves.map(PointBatch::len).sum::<usize>(), cut.leaves, "{share}");
            let sum = |value: &dyn Fn(&PointBatch, usize) -> f64| -> f64 {
                points.batches.iter().map(|batch| (0..batch.len()).map(|i| value(batch, i)).sum::<f64>()).sum()
            };
            let numbers = |values: &[f32]| values.iter().filter(|v| v.is_finite()).map(|v| f64::from(*v)).sum::<f64>();
            let shown = cell * numbers(&field.channels[0].levels[0].values);
            let found = sum(&|batch, i| f64::from(batch.values[0][i]) * f64::from(batch.volumes[i]));
            assert!((found / shown - 1.0).abs() < 1e-5, "{share}: {found} of {shown}");
            let volume = sum(&|batch, i| f64::from(batch.volumes[i]));
            assert!((volume / (cell * all as f64) - 1.0).abs() < 1e-5, "{share}: {volume}");
            // Moments of the parts add up to those of the whole, about anywhere.
            let spread = sum(&|batch, i| {
                let [x, y, z] = batch.offsets[i].map(f64::from);
                f64::from(batch.volumes[i]) * (batch.covariances[i].trace() + x * x + y * y + z * z)
            });
            let own = boxes(case.grid.dimensions);
            let own = Covariance::of(axes * own * axes.transpose()).trace();
            let [width, height, _] = case.hierarchy.shape;
            let of_sample = |i: usize| {
                let at = [i % width, i / width % height, i / (width * height)].map(|step| step as f64);
                let place = case.grid.to_world.transform_point3(DVec3::from_array(at));
                cell * (own + (place - points.origin).length_squared())
            };
            let there = |i: &usize| case.values[*i].is_finite();
            let expected: f64 = (0..case.values.len()).filter(there).map(of_sample).sum();
            assert!((spread / expected - 1.0).abs() < 1e-4, "{share}: {spread} of {expected}");
        }
    }
}

/// Each point of a set has the moments of places all over the boxes of its samples, in the world, which count by its share.
#[test]
fn shapes_are_those_of_the_samples_that_points_share() {
    const FINE: usize = 6;
    for case in [volume(), image()] {
        let h = &case.hierarchy;
        let (cut, _, points) = case.drawn(case.values.len() / 6);
        let depth = if h.dimensions == 3 { FINE } else { 1 };
        // Steps within a box with the variance of the whole box.
        let fine = |k: usize, count: usize| {
            let widened = (1.0 - 1.0 / (count * count) as f64).sqrt().recip();
            if count == 1 { 0.0 } else { widened * ((k as f64 + 0.5) / count as f64 - 0.5) }
        };
        let (mut found, mut thin) = (0, 0);
        for (level, nodes) in h.levels.iter().enumerate() {
            let batches = points.batches.iter().filter(|batch| {
                batch.traits.kind == SplatKind::Cluster && usize::from(batch.traits.level) == h.levels.len() - level - 1
            });
            let mut drawn = batches.flat_map(|batch| (0..batch.len()).map(move |i| (batch, i)));
            for node in (0..nodes.set.len()).filter(|&node| cut.drawn[level][node] == Drawn::Directed) {
                let set = Set::of(h.dimensions, nodes.set[node]).unwrap();
                let [width, height, _] = nodes.shape;
                let at = [node % width, node / width % height, node / (width * height)];
                let side = 2_usize << level;
                for k in 0..set.points {
                    let (mut weight, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
                    for i in 0..side.pow(h.dimensions as u32) {
                        let own = [i % side, i / side % side, i / (side * side)];
                        let sample: [usize; 3] = std::array::from_fn(|axis| at[axis] * side + own[axis]);
                        let sample = if h.dimensions == 2 { [sample[0], sample[1], 0] } else { sample };
                        let index = (sample[2] * h.shape[1] + sample[1]) * h.shape[0] + sample[0];
                        if (0..3).any(|axis| sample[axis] >= h.shape[axis]) || case.values[index].is_nan() {
                            continue;
                        }
                        let in_node: [f32; 3] = std::array::from_fn(|axis| match axis < h.dimensions {
                            true => (own[axis] as f32 + 0.5) / side as f32 - 0.5,
                            false => 0.0,
                        });
                        let share = f64::from(set.shares(in_node)[k]);
                        for j in 0..FINE * FINE * depth {
                            let within =
                                [fine(j % FINE, FINE), fine(j / FINE % FINE, FINE), fine(j / (FINE * FINE), depth)];
                            let place = DVec3::from_array(sample.map(|step| step as f64)) + DVec3::from_array(within);
                            let place = case.grid.to_world.transform_point3(place) - points.origin;
                            weight += share;
                            first += share * place;
                            second += share * DMat3::from_cols(place.x * place, place.y * place, place.z * place);
                        }
                    }
                    if weight == 0.0 {
                        continue;
                    }
                    let mean = first / weight;
                    let about = DMat3::from_cols(mean.x * mean, mean.y * mean, mean.z * mean);
                    let expected = Covariance::of(second * weight.recip() - about);
                    let (batch, i) = drawn.next().unwrap();
                    let place = Vec3::from_array(batch.offsets[i]).as_dvec3();
                    assert!((place - mean).length() < 1e-4, "{level} {node} {k}: {place} {mean}");
                    let most = 1e-4 * expected.trace() as f32;
                    let pairs = batch.covariances[i].0.into_iter().zip(expected.0);
                    assert!(
                        pairs.clone().all(|(a, b)| (a - b).abs() < most),
                        "{:?} {expected:?}",
                        batch.covariances[i]
                    );
                    found += 1;
                    let radii = expected.radii();
                    thin += usize::from(radii.x > 2.0 * if h.dimensions == 2 { radii.y } else { radii.z });
                }
            }
            assert!(drawn.next().is_none());
        }
        assert!(found > 40 && thin > 20, "{found} {thin}");
    }
}

#[test]
fn points_of_an_edge_lie_along_it() {
    let grid = Grid::image([64, 64], SampleType::F32, Channel::numbered(1));
    // The edge goes along (1, 1) in the grid, whose rows go down in the world.
    let case = Case::new(grid, |[x, y, _]| if x - y > 3.0 { 200.0 } else { 20.0 });
    let along = DVec3::new(1.0, -1.0, 0.0).normalize();
    let (_, _, points) = case.drawn(500);
    let (mut long, mut all, mut off) = (0, 0, 0.0_f64);
    for batch in points.batches.iter().filter(|batch| batch.traits.kind == SplatKind::Cluster) {
        for covariance in &batch.covariances {
            let (values, axes) = covariance.principal();
            all += 1;
            if values.x > 2.0 * values.y {
                long += 1;
                off = off.max(axes.x_axis.dot(along).abs().min(1.0).acos().to_degrees());
            }
        }
    }
    // Two of three points of a set are corners of their node.
    assert!(long > 20 && 4 * long > all, "{long} of {all}");
    assert!(off < 1.0, "{off} degrees");
}
