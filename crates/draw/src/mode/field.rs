//! What modes of images and volumes are handed: a sampled field in place of particles.

use super::Settings;
use crate::color::transfer::{Scale, TransferFunction};
use crate::cpu::field::{Field, FieldPoints, ValueAxis};
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::Lighting;
use crate::cpu::volume::{Scenery, VolumeLevels, VolumeOptions};
use crate::view::{PerspectiveGrid, View};

/// A field that is to be drawn, and how.
pub struct FieldJob<'a> {
    /// The camera.
    pub view: &'a View,
    /// The samples, or what stands for them.
    pub field: &'a Field,
    /// The points that show it, for techniques that draw those.
    pub points: Option<&'a FieldPoints>,
    /// The channel that colours what the first one shows.
    pub hue: Option<usize>,
    /// What the samples' values are.
    pub values: FieldValues<'a>,
    /// The mode's settings.
    pub settings: &'a Settings,
    /// Colours and opacities; the usual ones for such values where it is `None`.
    pub transfer: Option<&'a TransferFunction>,
    /// The field's diameter, world units.
    pub diameter: f64,
    /// Paths that are drawn among it, by techniques that take them.
    pub paths: Option<&'a PathFragments>,
    /// What lamps go with, and what else hides light, by techniques with opaque surfaces.
    pub lighting: Lighting<'a>,
}

/// What an adapter's passes draw of a field.
#[derive(Clone, Debug)]
pub enum FieldPasses {
    /// Rays through a perspective grid that the field fills.
    March(Box<FieldMarch>),
    /// Integrals of the first channel's values along each pixel's ray.
    Integrals,
}

/// What rays through a perspective grid meet that a field fills.
#[derive(Clone, Debug)]
pub struct FieldMarch {
    /// Where cells lie.
    pub grid: PerspectiveGrid,
    /// The numbers in them.
    pub axis: ValueAxis,
    /// What these show.
    pub scenery: Scenery,
    /// How the grid is held, and what is left out.
    pub options: VolumeOptions,
    /// The ranges of the colours.
    pub levels: VolumeLevels,
    /// The isosurfaces' values.
    pub isovalues: Vec<f64>,
}

/// What is known of the values of a field before any of it is chosen.
#[derive(Clone, Copy, Debug)]
pub struct FieldValues<'a> {
    /// Of what is shown.
    pub shown: &'a ValueStatistics,
    /// Of what colours it.
    pub hue: Option<&'a ValueStatistics>,
    /// Whether it is a volume.
    pub is_volume: bool,
}

/// How the values of a channel are distributed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ValueStatistics {
    /// An even sample of them, ascending; empty where none is a number.
    sample: Vec<f32>,
    /// The smallest and the largest of all.
    range: [f32; 2],
}

/// Values in the sample, about.
const SAMPLE: usize = 1 << 16;

impl ValueStatistics {
    /// Those of values.
    pub fn of(values: &[f32]) -> ValueStatistics {
        // An odd step, so that rows of an even length do not repeat.
        let step = (values.len() / SAMPLE) | 1;
        let mut sample: Vec<f32> = values.iter().step_by(step).copied().filter(|value| value.is_finite()).collect();
        sample.sort_unstable_by(f32::total_cmp);
        let finite = values.iter().copied().filter(|value| value.is_finite());
        let range =
            finite.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]);
        ValueStatistics { sample, range }
    }

    /// The smallest and the largest value; 0 and 1 where there is none.
    pub fn range(&self) -> [f64; 2] {
        if self.range[0] <= self.range[1] { self.range.map(f64::from) } else { [0.0, 1.0] }
    }

    /// The value that a share of all lie below.
    pub fn percentile(&self, share: f64) -> f64 {
        let last = self.sample.len().saturating_sub(1) as f64;
        self.sample.get((share * last).round() as usize).map_or(0.0, |value| f64::from(*value))
    }

    /// The scale that spreads them: logarithmic for positive ones of which few are far above the others.
    pub fn scale(&self) -> Scale {
        let [low, middle, high] = [0.02, 0.5, 0.999].map(|share| self.percentile(share));
        if low > 0.0 && high > 50.0 * middle { Scale::Log } else { Scale::Linear }
    }

    /// The range of values that is matter, not the air around it: between the two parts that differ most from each other (Otsu's
    /// threshold), and up to all but a thousandth.
    pub fn matter(&self, scale: Scale) -> [f64; 2] {
        let place = |value: f32| if scale == Scale::Log { f64::from(value).max(1e-30).ln() } else { f64::from(value) };
        let count = self.sample.len() as f64;
        let total: f64 = self.sample.iter().map(|value| place(*value)).sum();
        let (mut sum, mut best, mut low) = (0.0, 0.0, self.range()[0]);
        for (index, pair) in self.sample.windows(2).enumerate() {
            sum += place(pair[0]);
            let below = index as f64 + 1.0;
            let apart = sum / below - (total - sum) / (count - below);
            let between = below * (count - below) * apart * apart;
            if between > best && pair[0] < pair[1] {
                best = between;
                // Half the way from what is typical of the air to the threshold.
                low = 0.5 * (f64::from(pair[1]) + self.percentile(0.5 * below / count));
            }
        }
        let high = self.percentile(0.999);
        scale.usable(if low < high { [low, high] } else { self.range() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matter_is_parted_from_air() {
        let value = |i: usize| (if i % 5 < 4 { i % 9 } else { 150 + i % 60 }) as f32;
        let values: Vec<f32> = (0..100_000).map(value).chain([f32::NAN]).collect();
        let statistics = ValueStatistics::of(&values);
        assert_eq!((statistics.range(), statistics.scale()), ([0.0, 209.0], Scale::Linear));
        let [low, high] = statistics.matter(Scale::Linear);
        assert!(low > 9.0 && low < 150.0 && high > 200.0, "{low} {high}");
        assert_eq!(ValueStatistics::of(&[3.0; 10]).matter(Scale::Linear), Scale::Linear.usable([3.0, 3.0]));
        assert_eq!(ValueStatistics::of(&[]).range(), [0.0, 1.0]);
    }

    #[test]
    fn decades_are_spread_by_their_logarithm() {
        let values: Vec<f32> = (0..10_000).map(|i| 10f32.powf(-2.0 + 6.0 * (i as f32 / 1e4).powi(3))).collect();
        assert_eq!(ValueStatistics::of(&values).scale(), Scale::Log);
    }
}
