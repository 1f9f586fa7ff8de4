//! Exposure and bloom on the command line, of pictures, tours and the window.

use crate::color::{Bloom, ExposureMode, bloom};
use crate::look::LookPatch;
use std::ops::RangeInclusive;

/// How light is exposed and spreads.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct LightOptions {
    /// How automatic ranges of colours follow what is seen from picture to picture: steady (so smoothly that one does not see it),
    /// fixed (as they are found first), auto (each picture has its own), or adaptive (as an eye: 63 % of the way to brighter light in
    /// 0.3 s, to darker in 1.5 s; adaptive:BRIGHT,DARK for other seconds) [default: steady].
    #[arg(long, value_name = "HOW")]
    pub exposure: Option<ExposureMode>,
    /// Share of bright light that spreads around where it comes from, 0 to 1 [default: 0].
    #[arg(long, value_name = "SHARE", value_parser = strength)]
    pub bloom: Option<f64>,
    /// Linear light that does not spread, 0 to 16; 1 is the brightest of a screen [default: 0.5].
    #[arg(long, value_name = "LIGHT", value_parser = threshold)]
    pub bloom_threshold: Option<f64>,
    /// How far light spreads, as a share of the picture's height, 0.001 to 1 [default: 0.1].
    #[arg(long, value_name = "SHARE", value_parser = radius)]
    pub bloom_radius: Option<f64>,
}

impl LightOptions {
    /// Says in a look what is said here.
    pub fn set(&self, look: &mut LookPatch) {
        look.exposure = self.exposure.or(look.exposure);
        if self.bloom.or(self.bloom_threshold).or(self.bloom_radius).is_some() {
            let own = look.bloom.unwrap_or_default();
            look.bloom = Some(Bloom {
                strength: self.bloom.unwrap_or(own.strength),
                threshold: self.bloom_threshold.unwrap_or(own.threshold),
                radius: self.bloom_radius.unwrap_or(own.radius),
            });
        }
    }

    /// What is said here, over nothing else.
    pub fn look(&self) -> LookPatch {
        let mut look = LookPatch::default();
        self.set(&mut look);
        look
    }
}

fn strength(text: &str) -> Result<f64, String> {
    within(text, bloom::STRENGTHS)
}

fn threshold(text: &str) -> Result<f64, String> {
    within(text, bloom::THRESHOLDS)
}

fn radius(text: &str) -> Result<f64, String> {
    within(text, bloom::RADII)
}

fn within(text: &str, range: RangeInclusive<f64>) -> Result<f64, String> {
    let expected = || format!("expected a number from {} to {}", range.start(), range.end());
    text.parse().ok().filter(|value| range.contains(value)).ok_or_else(expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_said_stays() {
        let options = LightOptions { bloom: Some(0.3), ..LightOptions::default() };
        let own = Bloom { strength: 0.1, threshold: 0.9, radius: 0.02 };
        assert_eq!(options.look().bloom, Some(Bloom { strength: 0.3, ..Bloom::default() }));
        let mut look = LookPatch { bloom: Some(own), ..LookPatch::default() };
        options.set(&mut look);
        assert_eq!(look.bloom, Some(Bloom { strength: 0.3, ..own }));
        assert_eq!(LightOptions::default().look(), LookPatch::default());
        assert!(strength("1.5").is_err() && radius("0").is_err() && threshold("nan").is_err());
    }
}
