//! The fields of particles on a plane, interpolated at the middle of each pixel as F12 has it (equations 3.1 and 3.2).
//!
//! Nothing is integrated along the line of sight: where a pixel's ray meets the plane, `sum w W` over the particles whose support holds that place, and
//! for every column `A` the mean `sum w A W / sum w W`, over those that have a value of it. With masses as weights the former is the density, with
//! volumes `m / rho` the latter is the normalised interpolation.
//!
//! Particles narrower than two pixels would fall between the middles of pixels; they are enlarged to that, with their weight.

use crate::cpu::Splats;
use crate::model::Kernel;
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// Least support of a particle, pixels.
const SMALLEST: f64 = 2.0;
/// Rows of the picture that are summed by one task.
const BAND: usize = 16;
/// Sums of a pixel: see [`Sums`].
const SUMS: usize = 8;

/// A plane of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldPlane {
    /// Its normal, of length 1.
    pub normal: DVec3,
    /// Its place along that: the plane is where `normal . x` is this.
    pub distance: f64,
}

impl WorldPlane {
    /// Where the ray through a place of the picture meets it, and at which depth; `None` where it does not in front of the eye.
    pub fn meets(&self, view: &View, pixel: [f64; 2]) -> Option<(DVec3, f64)> {
        let (start, end) = (view.at_depth(pixel, 0.0), view.at_depth(pixel, 1.0));
        let depth = (self.distance - self.normal.dot(start)) / self.normal.dot(end - start);
        let is_deep = matches!(view.projection, Projection::Perspective { .. });
        let is_seen = depth.is_finite() && (depth > 0.0 || !is_deep);
        is_seen.then(|| (start + depth * (end - start), depth))
    }
}

/// What is summed beside the weights, by the place of columns in [`Splats::fields`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summed {
    /// A column.
    pub column: Option<usize>,
    /// The first of three columns that are the components of a vector.
    pub vector: Option<usize>,
}

/// The sums of a pixel.
///
/// In this order: `w W`; `w W` and `w A W` over the particles that have a value of the column; `w A W` of the attribute; `w W` over the particles
/// that have a vector, and `w A W` of its three components.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sums([f32; SUMS]);

impl Sums {
    /// `sum w W` of all particles.
    pub fn weight(&self) -> f32 {
        self.0[0]
    }

    /// `sum w W` over the particles that have a value of the column.
    pub fn column_weight(&self) -> f32 {
        self.0[1]
    }

    /// `sum w A W` of the column.
    pub fn column(&self) -> f32 {
        self.0[2]
    }

    /// The mean of the attribute, which all particles of a picture have or none; `None` where there are no particles.
    pub fn attribute(&self) -> Option<f32> {
        (self.0[0] > 0.0).then(|| self.0[3] / self.0[0])
    }

    /// The mean of the vector over the particles that have one; `None` without any.
    pub fn vector(&self) -> Option<DVec3> {
        let [.., weight, x, y, z] = self.0.map(f64::from);
        (weight > 0.0).then(|| DVec3::new(x, y, z) / weight)
    }
}

/// A particle that a plane cuts.
struct Cut {
    middle: DVec3,
    /// `1 / h^2` and `1 / h^3`.
    per: [f64; 2],
    /// What it adds to each sum for a value of the kernel.
    terms: [f64; SUMS],
    /// Columns and rows of pixels that it may reach, the last not included.
    columns: [usize; 2],
    rows: [usize; 2],
}

/// The sums of each pixel, row by row, and how many particles the plane cuts in the picture. Those whose extent is in pixels, and those with a weight
/// or a size that is no number, are left out.
pub fn sum(
    view: &View,
    batches: &[Splats<'_>],
    plane: &WorldPlane,
    kernel: Kernel,
    summed: Summed,
) -> (Vec<Sums>, u64) {
    let [width, height] = [view.width, view.height].map(|pixels| pixels as usize);
    let across = plane.normal.any_orthonormal_pair();
    let of_batch = |batch: &Splats<'_>| -> Vec<Cut> {
        let of_one = |index: usize| cut(view, batch, index, plane, across.into(), summed);
        (0..batch.len()).into_par_iter().filter_map(of_one).collect()
    };
    // In the order of the particles, so that sums do not depend on who adds them.
    let cuts: Vec<Cut> = batches.par_iter().map(of_batch).collect::<Vec<_>>().into_iter().flatten().collect();
    let mut bands: Vec<Vec<usize>> = vec![Vec::new(); height.div_ceil(BAND)];
    for (index, cut) in cuts.iter().enumerate() {
        for band in &mut bands[cut.rows[0] / BAND..=(cut.rows[1] - 1) / BAND] {
            band.push(index);
        }
    }
    let mut sums = vec![Sums([0.0; SUMS]); width * height];
    let parts = sums.par_chunks_mut((BAND * width).max(1)).zip(&bands).enumerate();
    parts.for_each(|(band, (sums, inside))| {
        let first = band * BAND;
        let place = |at: usize| {
            let pixel = [(at % width) as f64 + 0.5, (first + at / width) as f64 + 0.5];
            plane.meets(view, pixel).map_or(DVec3::NAN, |(place, _)| place)
        };
        let places: Vec<DVec3> = (0..sums.len()).map(place).collect();
        let last = first + sums.len() / width.max(1);
        for cut in inside.iter().map(|index| &cuts[*index]) {
            for y in cut.rows[0].max(first)..cut.rows[1].min(last) {
                for x in cut.columns[0]..cut.columns[1] {
                    let at = (y - first) * width + x;
                    let square = places[at].distance_squared(cut.middle) * cut.per[0];
                    // Not where there is no place.
                    if square < 1.0 {
                        let value = kernel.value(square.sqrt()) * cut.per[1];
                        let Sums(cell) = &mut sums[at];
                        cell.iter_mut().zip(cut.terms).for_each(|(sum, term)| *sum += (value * term) as f32);
                    }
                }
            }
        }
    });
    (sums, cuts.len() as u64)
}

/// What a plane cuts of a particle; `None` where it does not cut it, or not in the picture.
fn cut(
    view: &View,
    batch: &Splats<'_>,
    index: usize,
    plane: &WorldPlane,
    across: [DVec3; 2],
    summed: Summed,
) -> Option<Cut> {
    let own = f64::from(batch.ball(index)?);
    let middle = batch.positions().world(index);
    let weight = f64::from(batch.weight()[index]);
    if !(middle.is_finite() && weight.is_finite() && own > 0.0 && own.is_finite()) {
        return None;
    }
    let away = plane.normal.dot(middle) - plane.distance;
    let pixel = match view.projection {
        Projection::Perspective { .. } => view.to_camera(middle).z.max(0.0) / view.focal_pixels(),
        Projection::Orthographic { .. } => 1.0 / view.focal_pixels(),
    };
    let h = own.max(SMALLEST * pixel);
    if away.abs() >= h {
        return None;
    }
    // The disc of the plane that the support holds, in a square of it.
    let (foot, radius) = (middle - away * plane.normal, (h * h - away * away).sqrt());
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]
        .map(|[a, b]| view.to_pixels(view.to_camera(foot + radius * (a * across[0] + b * across[1]))));
    let span = |axis: usize, side: u32| {
        let seen = corners.iter().flatten().map(|corner| corner[axis]);
        let [low, high] = match corners.iter().flatten().count() {
            0 => return None,
            4 => seen.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]),
            // It reaches beside the eye, where places are anywhere.
            _ => [0.0, f64::from(side)],
        };
        // Casts saturate, so that what lies outside becomes the border.
        let [low, high] = [low.floor() as usize, high.ceil() as usize].map(|end| end.min(side as usize));
        (low < high).then_some([low, high])
    };
    let (columns, rows) = (span(0, view.width)?, span(1, view.height)?);
    let value = |column: usize| {
        let value = f64::from(*batch.fields().get(column)?.get(index)?);
        value.is_finite().then_some(weight * value)
    };
    let attribute = batch.attribute().map_or(0.0, |values| f64::from(values[index]));
    let mut terms = [0.0; SUMS];
    terms[0] = weight;
    if let Some(value) = summed.column.and_then(value) {
        (terms[1], terms[2]) = (weight, value);
    }
    terms[3] = if attribute.is_finite() { weight * attribute } else { 0.0 };
    let component = |axis: usize| value(summed.vector? + axis);
    if let (Some(x), Some(y), Some(z)) = (component(0), component(1), component(2)) {
        [terms[4], terms[5], terms[6], terms[7]] = [weight, x, y, z];
    }
    Some(Cut { middle, per: [h.powi(-2), h.powi(-3)], terms, columns, rows })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::volume::exact::ExactField;
    use crate::cpu::{Extent, Positions};

    /// A lattice of `side` particles along each axis of a cube around the origin, 1 apart, of volume 1 each.
    fn lattice(side: usize) -> Vec<[f64; 3]> {
        let place = |i: usize| i as f64 - 0.5 * (side - 1) as f64;
        let all = 0..side * side * side;
        all.map(|i| [place(i % side), place(i / side % side), place(i / (side * side))]).collect()
    }

    /// Of a linear vector field the mean is that field, to what the lattice's sum errs, wherever supports are full; on an oblique plane, in perspective.
    #[test]
    fn a_linear_vector_field_is_met() {
        let positions = lattice(14);
        let h = vec![2.6f32; positions.len()];
        let volumes = vec![1.0f32; positions.len()];
        let truth = |at: DVec3| DVec3::new(1.0 + 2.0 * at.y, at.x - 3.0 * at.z, 0.5 * at.x + at.y - 2.0);
        let field = |axis: usize| -> Vec<f32> {
            positions.iter().map(|at| truth(DVec3::from_array(*at))[axis] as f32).collect()
        };
        let mut fields: Vec<Vec<f32>> = vec![positions.iter().map(|at| (3.0 + at[0]) as f32).collect()];
        fields.extend((0..3).map(field));
        // What has no value is not there.
        fields[0][100] = f32::NAN;
        let batch = Splats::new(Positions::World(&positions), Extent::World(&h), &volumes, None)
            .and_then(|batch| batch.with_fields(&fields))
            .expect("columns of the same length");
        let normal = DVec3::new(0.3, -0.5, 1.0).normalize();
        let plane = WorldPlane { normal, distance: 0.37 };
        let eye = DVec3::new(3.0, 4.0, 20.0);
        let view =
            View::look_at(eye, DVec3::ZERO, DVec3::Y, Projection::Perspective { fov_y: 0.5 }, 80, 60).expect("a view");
        let summed = Summed { column: Some(0), vector: Some(1) };
        let (sums, cut) = sum(&view, &[batch], &plane, Kernel::CubicSpline, summed);
        assert!(cut > 100);
        let (mut met, mut worst) = (0, 0.0f64);
        assert!(sums.iter().all(|sums| sums.column().is_finite()));
        for (at, sums) in sums.iter().enumerate() {
            let pixel = [(at % 80) as f64 + 0.5, (at / 80) as f64 + 0.5];
            let Some((place, depth)) = plane.meets(&view, pixel) else { continue };
            assert!(
                (normal.dot(place) - plane.distance).abs() < 1e-9 && (view.to_camera(place).z - depth).abs() < 1e-9
            );
            if place.abs().max_element() > 6.5 - 2.7 {
                continue;
            }
            met += 1;
            let off = sums.vector().expect("particles all around") - truth(place);
            worst = worst.max(off.abs().max_element());
            assert!((f64::from(sums.column() / sums.column_weight()) - 3.0 - place.x).abs() < 0.004, "{place}");
        }
        // The lattice's sum misses a place by up to 0.002, where components have slopes of up to 4.
        assert!(met > 500 && worst < 0.012, "{met} {worst}");
    }

    /// Sums are those of all particles at that place, of any size, and the same from any number of threads.
    #[test]
    fn sums_are_the_exact_ones() {
        let mut random = crate::synth::random::Random::new(11, 1);
        let mut next = || random.uniform();
        let positions: Vec<[f64; 3]> = (0..400).map(|_| [next(), next(), next()]).collect();
        let h: Vec<f32> = (0..400).map(|_| 10f64.powf(-0.7 + 0.6 * next()) as f32).collect();
        let mass: Vec<f32> = (0..400).map(|_| next() as f32).collect();
        let batch = Splats::new(Positions::World(&positions), Extent::World(&h), &mass, Some(&h)).expect("columns");
        let exact = ExactField::new(&[batch], Kernel::WendlandC2);
        let plane = WorldPlane { normal: DVec3::new(0.2, 1.0, 0.4).normalize(), distance: 0.7 };
        // From within, so that discs reach beside the eye.
        let eye = DVec3::new(0.5, 0.9, 0.6);
        let projection = Projection::Perspective { fov_y: 1.2 };
        let view = View::look_at(eye, DVec3::new(0.45, 0.3, 0.5), DVec3::Z, projection, 50, 40).expect("a view");
        let drawn = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| sum(&view, &[batch], &plane, Kernel::WendlandC2, Summed::default()).0)
        };
        let sums = drawn(1);
        assert_eq!(sums, drawn(3));
        let mut met = 0;
        for (at, sums) in sums.iter().enumerate() {
            let pixel = [(at % 50) as f64 + 0.5, (at / 50) as f64 + 0.5];
            let Some((place, _)) = plane.meets(&view, pixel) else { continue };
            let expected = exact.at(place);
            let error = (f64::from(sums.weight()) - expected.density).abs();
            assert!(error <= 3e-5 * expected.density.max(1e-3), "{place}: {sums:?} for {expected:?}");
            if let Some(mean) = sums.attribute() {
                met += 1;
                assert!((f64::from(mean) - expected.mean()).abs() <= 1e-4 * expected.mean(), "{place}");
            }
        }
        assert!(met > 1000, "{met}");
    }
}
