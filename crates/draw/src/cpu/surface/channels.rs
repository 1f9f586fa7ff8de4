//! Raw channels: where what is seen at the middle of each pixel is, whoever has found what that is.

use super::picture::{SurfacePicture, SurfaceReport};
use super::raster::Visibility;
use super::resolve::{CHANNELS, NOTHING, Resolver};
use super::sight::Sight;
use super::stitch::Scene;
use rayon::prelude::*;
use std::ops::Range;

/// The channels of pixels of which each shows one sample, row by row.
pub(crate) fn channels(scene: &Scene, sight: &Sight, seen: &Visibility) -> Vec<[f64; CHANNELS]> {
    channels_of(scene, sight, seen, &[0..seen.width, 0..seen.height])
}

/// The same of some columns and rows of pixels.
pub(super) fn channels_of(
    scene: &Scene,
    sight: &Sight,
    seen: &Visibility,
    [columns, rows]: &[Range<usize>; 2],
) -> Vec<[f64; CHANNELS]> {
    let resolver = Resolver::new(scene, sight);
    let channels = |index: usize| {
        let (x, y) = (columns.start + index % columns.len(), rows.start + index / columns.len());
        let shown = seen.at(y * seen.width + x);
        let hit = shown.and_then(|shown| resolver.hit(shown, [x as f64 + 0.5, y as f64 + 0.5]));
        hit.map_or(NOTHING, |hit| hit.raw(scene))
    };
    (0..columns.len() * rows.len()).into_par_iter().map(channels).collect()
}

impl SurfacePicture {
    /// Adds channels, and the depths that they tell, to a picture that has colours or nothing yet; `report` is of what they were found in.
    pub(crate) fn add_channels(&mut self, channels: Vec<[f64; CHANNELS]>, report: SurfaceReport) {
        match self.colors.rgba.is_empty() {
            false => self.report.bound(&report),
            true => {
                let covered = channels.iter().map(|channels| channels[6]).filter(|covered| !covered.is_nan()).sum();
                self.report = SurfaceReport { covered, ..report };
            }
        }
        let depth = |channels: &[f64; CHANNELS]| if channels[0].is_nan() { f32::INFINITY } else { channels[0] as f32 };
        self.depth = channels.iter().map(depth).collect();
        self.raw = channels;
    }
}
