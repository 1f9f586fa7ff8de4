//! Particles as a grid's resampling wants them: in camera space, in single precision, those alone that reach into the
//! picture, none too small for the grid.
//!
//! A particle whose support is narrower than the grid would fall between cells. Its smoothing length is raised to
//! [`SMALLEST`] cells of its depth, its mass staying what it is (F12 5.5.1, 5.5.2): with a support of two cells the
//! cells' sum is the mass to half a percent wherever the particle lies. Setting the least size to 0 leaves
//! particles as they are, for comparisons with the exact sum. Of an ellipsoid every principal semi-axis is raised on its own
//! ([`Ellipsoid::at_least`]), which of a ball is the same.
//!
//! Ellipsoids come after all round particles, in chunks of their own that have shapes beside them.

use super::super::ellipsoid::Ellipsoid;
use super::super::{Extent, Splats};
use super::stretched::{Body, Stretched};
use crate::model::Kernel;
use crate::view::perspective_grid::GridError;
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Least smoothing length, in cells.
pub const SMALLEST: f64 = 2.0;

/// Particles that are projected by one task, and binned together: their columns fit into a cache.
pub const CHUNK: usize = 1 << 15;

/// One particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Particle {
    /// Camera coordinates, and the smoothing length: of an ellipsoid that of the ball of equal volume.
    pub place: [f32; 4],
    /// Mass `m`.
    pub mass: f32,
    /// `m A`; 0 without attribute.
    pub weighted: f32,
}

/// The particles of a view.
#[derive(Clone, Debug, Default)]
pub struct Projected {
    /// In the order of the batches, round ones first.
    pub chunks: Vec<Vec<Particle>>,
    /// The shapes of each chunk's particles; none for one of round particles.
    pub shapes: Vec<Vec<Stretched>>,
    /// The particles' own densities, one for each in `chunks`, where every batch has them; less for those that were raised.
    pub densities: Vec<Vec<f32>>,
    /// Particles whose size was raised.
    pub raised: u64,
    /// Whether there is an attribute.
    pub attribute: bool,
}

impl Projected {
    /// Number of particles that reach into the picture.
    pub fn len(&self) -> u64 {
        self.chunks.iter().map(|chunk| chunk.len() as u64).sum()
    }

    /// Memory that they take.
    pub fn bytes(&self) -> u64 {
        let of_density = if self.densities.is_empty() { 0 } else { size_of::<f32>() };
        let shapes: usize = self.shapes.iter().map(Vec::len).sum();
        self.len() * (size_of::<Particle>() + of_density) as u64 + (shapes * size_of::<Stretched>()) as u64
    }

    /// The particles of a chunk with their shapes.
    pub fn bodies(&self, chunk: usize) -> impl Iterator<Item = Body<'_>> {
        let shapes = &self.shapes[chunk];
        let with = |(index, particle)| Body { particle, shape: shapes.get(index) };
        self.chunks[chunk].iter().enumerate().map(with)
    }

    /// Adds those of other batches, which come after all batches so far; their own densities are left out.
    pub fn append(&mut self, more: Projected) {
        self.raised += more.raised;
        self.attribute |= more.attribute;
        for (particles, shapes) in more.chunks.into_iter().zip(more.shapes) {
            self.take(Part { particles, densities: Vec::new(), shapes, raised: 0 });
        }
    }

    /// Adds a part, if it has any particle. Nodes of a page file may hold few particles each; short chunks would cost more than they
    /// hold.
    fn take(&mut self, part: Part) {
        if part.particles.is_empty() {
            return;
        }
        self.raised += part.raised;
        match (self.chunks.last_mut(), self.densities.last_mut(), self.shapes.last_mut()) {
            (Some(last), Some(densities), Some(shapes))
                if last.len() + part.particles.len() <= CHUNK && shapes.is_empty() == part.shapes.is_empty() =>
            {
                last.extend(part.particles);
                densities.extend(part.densities);
                shapes.extend(part.shapes);
            }
            _ => {
                self.chunks.push(part.particles);
                self.densities.push(part.densities);
                self.shapes.push(part.shapes);
            }
        }
    }

    /// Whether none does.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The same.
    ///
    /// # Errors
    /// [`GridError::NothingInView`] when there are none: extents may reach into a picture that no particle does.
    pub fn unless_empty(self) -> Result<Projected, GridError> {
        if self.is_empty() { Err(GridError::NothingInView) } else { Ok(self) }
    }
}

/// What is taken of the batches.
#[derive(Clone, Copy, Debug)]
pub struct Taken {
    /// Width of a cell at depth 1 (perspective) or everywhere: see [`crate::view::PerspectiveGrid::sigma_of`].
    pub sigma: f64,
    /// Least smoothing length, cells.
    pub smallest: f64,
    /// Every how-manieth particle is taken, for a sketch: it counts for the others in mass and volume.
    pub stride: usize,
    /// The kernel, whose variance covariances are measured by.
    pub kernel: Kernel,
}

/// The factor on smoothing lengths where every `stride`-th particle counts for the others.
pub fn growth(stride: usize) -> f64 {
    (stride as f64).cbrt()
}

/// Projects batches. Particles without extent in world units and those with a value that is not finite are left out.
pub fn project(view: &View, batches: &[Splats<'_>], taken: &Taken) -> Projected {
    let jobs: Vec<(&Splats<'_>, usize)> = batches
        .iter()
        .flat_map(|batch| (0..batch.len()).step_by(CHUNK * taken.stride).map(move |start| (batch, start)))
        .collect();
    let attribute = batches.iter().any(|batch| batch.attribute().is_some());
    let parts: Vec<Part> = jobs.into_par_iter().map(|(batch, start)| part(view, batch, start, taken)).collect();
    let mut all = Projected { attribute, ..Projected::default() };
    let (round, stretched): (Vec<Part>, Vec<Part>) = parts.into_iter().partition(|part| part.shapes.is_empty());
    round.into_iter().chain(stretched).for_each(|part| all.take(part));
    if !batches.iter().all(|batch| batch.density().is_some()) {
        all.densities.clear();
    }
    all
}

/// `rho h^3 / m` of a particle with some forty others within its support, and how far from it densities may be.
const USUAL: (f32, f32) = (10.0, 30.0);

/// Ratios that are gone by: of others single precision has no factor, or one of few digits.
const USABLE: RangeInclusive<f32> = 1e-36..=1e36;

/// The factor on the particles' own densities in batches: see [`density_scale`]. 1 where some have none.
pub fn density_scale_of(batches: &[Splats<'_>]) -> f32 {
    let mut ratios = Vec::new();
    for batch in batches {
        let Some(densities) = batch.density() else { return 1.0 };
        for (i, (density, mass)) in densities.iter().zip(batch.weight()).enumerate() {
            let Some(h) = batch.ball(i) else { return 1.0 };
            ratios.push(density * h.powi(3) / mass);
        }
    }
    density_scale(ratios.into_iter())
}

/// `rho h^3 / m` of particles that weigh their volumes `m / rho`: what [`density_scale`] goes by.
pub fn ratios_of_volumes<'a>(batch: &Splats<'a>) -> impl Iterator<Item = f32> + use<'a> {
    let batch = *batch;
    let ratio = move |(i, volume): (usize, &f32)| Some(batch.ball(i)?.powi(3) / volume);
    batch.weight().iter().enumerate().filter_map(ratio)
}

/// Some files have no masses, or densities in another unit: then the particles' own densities are not of the size of the
/// sums that are drawn. This is the factor that makes the median of `rho h^3 / m` what it is where both belong together; 1
/// where they do, and where nothing is known.
///
/// It is a property of the data, never of the particles that one picture takes: a picture would change with what it need not
/// read.
pub fn density_scale(ratios: impl Iterator<Item = f32>) -> f32 {
    let mut ratios: Vec<f32> = ratios.filter(is_usable).collect();
    if ratios.is_empty() {
        return 1.0;
    }
    let middle = ratios.len() / 2;
    scale_of_median(*ratios.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Whether [`density_scale`] goes by a ratio `rho h^3 / m`.
pub fn is_usable(ratio: &f32) -> bool {
    USABLE.contains(ratio)
}

/// [`density_scale`] of particles the median of whose `rho h^3 / m` is known.
pub fn scale_of_median(median: f32) -> f32 {
    let (usual, most) = USUAL;
    if median > usual * most || median < usual / most { usual / median } else { 1.0 }
}

/// Ratios that [`density_scale`] goes by, of particles that are not all there at once: how many there are of each class of leading bits.
pub struct RatioCounts(Vec<u64>);

/// Bits of a ratio that its class does not tell.
const HIDDEN_BITS: u32 = 15;

impl Default for RatioCounts {
    fn default() -> RatioCounts {
        RatioCounts(vec![0; 1 << (31 - HIDDEN_BITS)])
    }
}

impl RatioCounts {
    /// Counts one more.
    pub fn add(&mut self, ratio: f32) {
        if is_usable(&ratio) {
            self.0[(ratio.to_bits() >> HIDDEN_BITS) as usize] += 1;
        }
    }

    /// What [`density_scale`] is of them. Where their median's class does not tell, `again` hands over the same ones once more.
    pub fn scale(&self, again: impl FnOnce(&mut dyn FnMut(f32))) -> f32 {
        let total: u64 = self.0.iter().sum();
        let Some((class, rank)) = find(&self.0, total / 2) else { return 1.0 };
        let first = (class as u32) << HIDDEN_BITS;
        let ends = [first, first | ((1 << HIDDEN_BITS) - 1)].map(f32::from_bits);
        if ends.map(scale_of_median) == [1.0; 2] {
            return 1.0;
        }
        let mut within = vec![0_u64; 1 << HIDDEN_BITS];
        again(&mut |ratio| {
            if is_usable(&ratio) && ratio.to_bits() >> HIDDEN_BITS == class as u32 {
                within[(ratio.to_bits() ^ first) as usize] += 1;
            }
        });
        find(&within, rank).map_or(1.0, |(bits, _)| scale_of_median(f32::from_bits(first | bits as u32)))
    }
}

/// The class of the element with this number in the order of classes, and its number among those of its class; `None` where there are fewer.
fn find(counts: &[u64], mut rank: u64) -> Option<(usize, u64)> {
    for (class, count) in counts.iter().enumerate() {
        match rank.checked_sub(*count) {
            Some(rest) => rank = rest,
            None => return Some((class, rank)),
        }
    }
    None
}

struct Part {
    particles: Vec<Particle>,
    densities: Vec<f32>,
    shapes: Vec<Stretched>,
    raised: u64,
}

fn part(view: &View, batch: &Splats<'_>, start: usize, taken: &Taken) -> Part {
    let mut part = Part { particles: Vec::new(), densities: Vec::new(), shapes: Vec::new(), raised: 0 };
    let perspective = matches!(view.projection, Projection::Perspective { .. });
    let edges = view.edges();
    // Lengths of the side planes' normals.
    let norms = edges.map(|sides| sides.map(|side| if perspective { side.hypot(1.0) } else { 1.0 }));
    let (factor, growth) = (taken.stride as f32, growth(taken.stride));
    let variance = taken.kernel.variance();
    let end = batch.len().min(start + CHUNK * taken.stride);
    for i in (start..end).step_by(taken.stride) {
        let place = view.to_camera(batch.positions().world(i));
        let mass = batch.weight()[i] * factor;
        let weighted = batch.attribute().map_or(0.0, |values| mass * values[i]);
        let least = taken.smallest * taken.sigma * if perspective { place.z.max(0.0) } else { 1.0 };
        let beyond = |axis: usize, reaches: [f64; 2]| {
            let depth = if perspective { place.z } else { 1.0 };
            let [low, high] = edges[axis];
            low * depth - place[axis] > reaches[0] || place[axis] - high * depth > reaches[1]
        };
        let (h, own) = match batch.extent() {
            Extent::Pixels(_) => break,
            Extent::World(lengths) => {
                let own = f64::from(lengths[i]) * growth;
                if !(place.is_finite() && own > 0.0 && own.is_finite() && mass.is_finite() && weighted.is_finite()) {
                    continue;
                }
                let h = own.max(least);
                let reaches = |axis: usize| norms[axis].map(|norm: f64| h * norm);
                if place.z + h <= 0.0 && perspective || beyond(0, reaches(0)) || beyond(1, reaches(1)) {
                    continue;
                }
                part.raised += u64::from(own < least);
                (h, own)
            }
            Extent::Ellipsoids(covariances) => {
                let Some(own) = Ellipsoid::of(covariances[i], variance, place, view) else { continue };
                if !(mass.is_finite() && weighted.is_finite()) {
                    continue;
                }
                let own = own.scaled(growth);
                let (ellipsoid, shortest) = own.at_least(least);
                let reaches = |axis: usize| {
                    let across = if axis == 0 { DVec3::X } else { DVec3::Y };
                    edges[axis].map(|side| ellipsoid.reach(across - if perspective { side } else { 0.0 } * DVec3::Z))
                };
                let behind = perspective && place.z + ellipsoid.half_depth() <= 0.0;
                if behind || beyond(0, reaches(0)) || beyond(1, reaches(1)) {
                    continue;
                }
                part.raised += u64::from(ellipsoid.axes != own.axes);
                part.shapes.push(Stretched::of(&ellipsoid, shortest));
                (ellipsoid.volume().cbrt(), own.volume().cbrt())
            }
        };
        let [x, y, z] = place.as_vec3().to_array();
        part.particles.push(Particle { place: [x, y, z, h as f32], mass, weighted });
        if let Some(densities) = batch.density() {
            let diluted = if batch.dilutes() { (own / h).powi(3) as f32 } else { 1.0 };
            part.densities.push(densities[i] * diluted);
        }
    }
    part
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::cpu::volume::tests::{Cloud, perspective};
    use glam::DVec3;

    #[test]
    fn densities_of_another_unit_are_brought_to_that_of_the_sums() {
        // Density 1 everywhere.
        let cloud = Cloud::lattice(8, 2.0);
        let with = |density: f32| {
            let densities = vec![density; cloud.h.len()];
            density * density_scale_of(&[cloud.batch().with_density(Some(&densities)).unwrap()])
        };
        assert_eq!(with(1.0), 1.0);
        assert!([2e7, 1e-9].map(with).iter().all(|density| (0.3..3.0).contains(density)));
        assert_eq!(density_scale_of(&[cloud.batch()]), 1.0);
    }

    /// Medians within what is usual, at its ends and far beyond.
    #[test]
    fn counted_ratios_have_the_scale_of_listed_ones() {
        for factor in [1e-20, 0.1, 0.33, 1.0 / 3.0, 1.0, 29.9, 30.0, 30.1, 1e20_f32] {
            for count in [0, 1, 2, 9, 1000] {
                let ratio = |i: u32| USUAL.0 * factor * (1.0 + 1e-6 * (i * 7919 % 1000) as f32);
                let ratios = (0..count).map(ratio).chain([f32::NAN, 0.0, -1.0, f32::INFINITY]);
                let mut counts = RatioCounts::default();
                ratios.clone().for_each(|ratio| counts.add(ratio));
                let found = counts.scale(|each| ratios.clone().for_each(&mut *each));
                assert_eq!(found, density_scale(ratios.clone()), "{count} of about {factor}");
            }
        }
    }

    #[test]
    fn densities_are_those_of_the_batches_and_there_if_all_have_some() {
        let cloud = Cloud::lattice(8, 2.0);
        let view = perspective(DVec3::new(0.0, 0.0, 9.0), 40, 30);
        let taken = Taken { sigma: 1e-3, smallest: 0.0, stride: 1, kernel: Kernel::default() };
        let densities = vec![2e7; cloud.h.len()];
        let batch = cloud.batch().with_density(Some(&densities)).unwrap();
        let projected = project(&view, &[batch], &taken);
        assert!(!projected.is_empty() && projected.densities.concat().iter().all(|&density| density == 2e7));
        assert!(project(&view, &[batch, cloud.batch()], &taken).densities.is_empty());
    }
}
