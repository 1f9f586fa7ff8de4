//! What a picture shows of the points of a field: those that are no air, as splats that are classified by their value.

use super::points::{FieldPoints, PointBatch};
use super::values::ValueAxis;
use crate::cpu::{Extent, NodeTraits, Positions, SplatError, Splats};
use crate::model::{Bounds, Covariance, Kernel};
use crate::view::{self, View};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// What is made of points.
#[derive(Clone, Copy, Debug)]
pub struct PointLook<'a> {
    /// The camera: its clip boxes leave points out, and it fades them with depth.
    pub view: &'a View,
    /// The values of the first channel as numbers.
    pub axis: ValueAxis,
    /// Points up to this number are left out, and all that have no value.
    pub least: f32,
    /// The channel that colours them.
    pub hue: Option<usize>,
    /// Second moments of a splat, of those of what its point stands for.
    pub spread: f32,
    /// How thick what they stand for is: 1 for volumes, the thickness that an image counts with in world units.
    pub thickness: f64,
    /// The kernel that splats are drawn with.
    pub kernel: Kernel,
}

/// Points of one kind and level that are shown, as columns of one length.
#[derive(Clone, Debug)]
pub struct SeenPoints {
    origin: DVec3,
    traits: NodeTraits,
    offsets: Vec<[f32; 3]>,
    covariances: Vec<Covariance>,
    /// Volume times the value as a number: what a splat weighs if that is its density.
    weights: Vec<f32>,
    values: Vec<f32>,
    attributes: Option<Vec<f32>>,
    misfits: Vec<f32>,
    reach: view::Extent,
}

impl PointLook<'_> {
    /// The points that are shown, batch by batch; batches of which none is are left out.
    pub fn seen(&self, points: &FieldPoints) -> Vec<SeenPoints> {
        let of = |batch: &PointBatch| Some(self.of_batch(points.origin, batch)).filter(|seen| !seen.is_empty());
        points.batches.par_iter().filter_map(of).collect()
    }

    fn of_batch(&self, origin: DVec3, batch: &PointBatch) -> SeenPoints {
        let (clips, fades) = (self.view.cut.clips(), self.view.cut.fade_rate > 0.0);
        let hues = self.hue.and_then(|hue| batch.values.get(hue));
        let mut seen = SeenPoints {
            origin,
            traits: batch.traits,
            offsets: Vec::new(),
            covariances: Vec::new(),
            weights: Vec::new(),
            values: Vec::new(),
            attributes: hues.map(|_| Vec::new()),
            misfits: Vec::new(),
            reach: view::Extent { bounds: Bounds::EMPTY, margin: 0.0 },
        };
        let mut widest = 0.0_f64;
        for (index, value) in batch.values[0].iter().enumerate() {
            let number = self.axis.place(*value);
            // Of no value the number is 0.
            if number <= self.least {
                continue;
            }
            let world = origin + Vec3::from_array(batch.offsets[index]).as_dvec3();
            if clips && !self.view.cut.keeps(world) {
                continue;
            }
            let faded = if fades { self.view.fade(world) } else { 1.0 };
            let covariance = Covariance(batch.covariances[index].0.map(|moment| self.spread * moment));
            seen.offsets.push(batch.offsets[index]);
            seen.covariances.push(covariance);
            seen.weights.push((f64::from(batch.volumes[index]) * self.thickness * faded) as f32 * number);
            seen.values.push(number);
            seen.misfits.push(batch.misfits[index]);
            if let (Some(own), Some(hues)) = (&mut seen.attributes, hues) {
                own.push(hues[index]);
            }
            seen.reach.bounds = seen.reach.bounds.with(world);
            // No variance exceeds the sum of all.
            widest = widest.max(covariance.trace());
        }
        seen.reach.margin = (widest / self.kernel.variance()).sqrt();
        seen
    }
}

impl SeenPoints {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// The points as splats with values, whose weights are such that each is as much matter of its value as what it stands for.
    ///
    /// # Errors
    /// [`SplatError`] never: all columns are of one length.
    pub fn splats(&self) -> Result<Splats<'_>, SplatError> {
        let positions = Positions::Relative { origin: self.origin, scale: 1.0, offsets: &self.offsets };
        let extent = Extent::Ellipsoids(&self.covariances);
        let splats = Splats::new(positions, extent, &self.weights, self.attributes.as_deref())?;
        let splats = splats.with_values(&self.values)?.with_misfits(&self.misfits)?;
        Ok(splats.with_reach(Some(self.reach)).with_traits(Some(self.traits)))
    }
}
