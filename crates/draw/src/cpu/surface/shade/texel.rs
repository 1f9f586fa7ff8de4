//! What a place of the surface looks like at a distance, between the levels and the samples that are next to it.

use super::super::look::Attribute;
use super::super::resolve::{Between, Hit};
use super::Shader;

/// Most colour planes that a place is read with.
const PLANES: usize = 4;

/// How much finer than a pixel a level is taken: what is read between its samples is a mean over about twice their distance, and pixels of a
/// small picture are nearest to the means of a large one with this.
pub const FINER: f64 = 0.65;

/// What a place looks like.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Texel {
    /// Mean normal: world directions of x and y, z up, at true height.
    pub normal: [f32; 3],
    /// Least and largest height.
    pub range: [f64; 2],
    pub curvature: f32,
    pub planes: [f32; PLANES],
    /// How much higher it is than an earlier field; NaN where that is not known.
    pub change: f32,
}

impl Shader<'_> {
    /// What a hit looks like at the distance of its pixels.
    pub(super) fn texel(&self, hit: &Hit) -> Texel {
        let wanted = self.resolver.level_at(hit.depth) - FINER;
        let (first, share) = self.resolver.levels(hit.shown.node, wanted);
        let nothing = Texel { normal: [0.0, 0.0, 1.0], range: [hit.under[2]; 2], change: f32::NAN, ..Texel::default() };
        let mut texel = self.texel_at(hit, first).unwrap_or(nothing);
        if share > 0.0
            && let Some(coarse) = self.texel_at(hit, first + 1)
        {
            let mix = |a: f32, b: f32| a + share as f32 * (b - a);
            texel.normal = std::array::from_fn(|k| mix(texel.normal[k], coarse.normal[k]));
            texel.curvature = mix(texel.curvature, coarse.curvature);
            // What is known of finer samples alone is theirs.
            if !coarse.change.is_nan() {
                texel.change = mix(texel.change, coarse.change);
            }
            texel.planes = std::array::from_fn(|k| mix(texel.planes[k], coarse.planes[k]));
            texel.range = std::array::from_fn(|k| texel.range[k] + share * (coarse.range[k] - texel.range[k]));
        }
        let level = f64::from(first) + share;
        if wanted < level {
            // A sample stands for more than the pixel does.
            let shrunk = (wanted - level).exp2();
            texel.range.iter_mut().for_each(|end| *end = hit.under[2] + shrunk * (*end - hit.under[2]));
        }
        texel
    }

    /// What a hit looks like in a level: between four samples, of which only those count that stand for something.
    fn texel_at(&self, hit: &Hit, level: u8) -> Option<Texel> {
        let between = self.resolver.between(hit.shown.node, level, [hit.under[0], hit.under[1]])?;
        let samples = between.samples;
        let mut texel = Texel::default();
        let mut sum = 0.0_f64;
        let mut normal = [0.0_f64; 3];
        let mut planes = [0.0_f64; PLANES];
        let (mut change, mut known) = (0.0_f64, 0.0_f64);
        let has_range = level > 0 && matches!(self.look.attribute, Attribute::Height | Attribute::Residual);
        for corner in 0..4 {
            let (index, mut weight) = (between.indices[corner], between.weights[corner]);
            if !samples.coverage.is_empty() {
                weight = weight * f64::from(samples.coverage_at(index)) / 255.0;
            }
            if weight <= 0.0 {
                continue;
            }
            let found = samples.normals.at(index);
            sum += weight;
            (0..3).for_each(|k| normal[k] += weight * f64::from(found[k]));
            if has_range {
                let range = samples.range_at(index);
                (0..2).for_each(|k| texel.range[k] += weight * f64::from(range[k]));
            }
            for (value, plane) in planes.iter_mut().zip(&self.planes) {
                *value += weight * samples.planes.get(*plane).map_or(0.0, |plane| f64::from(plane[index]));
            }
            if let Some(own) = samples.changes.get(index).filter(|own| !own.is_nan()) {
                known += weight;
                change += weight * f64::from(*own);
            }
        }
        if sum <= 0.0 {
            return None;
        }
        (0..3).for_each(|k| texel.normal[k] = (normal[k] / sum) as f32);
        (0..self.planes.len().min(PLANES)).for_each(|k| texel.planes[k] = (planes[k] / sum) as f32);
        texel.change = if 2.0 * known >= sum { (change / known) as f32 } else { f32::NAN };
        match has_range {
            true => texel.range.iter_mut().for_each(|end| *end /= sum),
            false => texel.range = [hit.under[2]; 2],
        }
        if self.look.attribute == Attribute::Curvature {
            texel.curvature = self.curvature(&between);
        }
        Some(texel)
    }

    /// The mean curvature per world unit of the slopes between four samples.
    fn curvature(&self, between: &Between<'_>) -> f32 {
        let step = self.resolver.scene.placed.lengths();
        let leans = between.indices.map(|index| {
            let [x, y, z] = between.samples.normals.at(index).map(f64::from);
            [x / z.max(1e-6), y / z.max(1e-6)]
        });
        let across = 0.5 * (leans[1][0] + leans[3][0] - leans[0][0] - leans[2][0]) / (step[0] * between.apart[1]);
        let along = 0.5 * (leans[2][1] + leans[3][1] - leans[0][1] - leans[1][1]) / (step[1] * between.apart[0]);
        (0.5 * (across + along)) as f32
    }
}
