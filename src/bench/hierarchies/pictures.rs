//! The pictures that are compared: from where, how far they are from the exact one, and sheets of them.

use super::report::Outcome;
use crate::bench::sheet::{Entry, sheet};
use crate::bench::splat::Failure;
use crate::color::composite::{Image, enlarged_difference};
use crate::color::{Accumulation, output};
use crate::model::Bounds;
use crate::view::{Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::path::Path;

/// A camera.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Camera {
    eye: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    ortho: f64,
}

/// Parallel views of a box: from above, then from other directions, the same for any data.
pub(super) fn views(bounds: Bounds, count: usize, (width, height): (u32, u32)) -> Result<Vec<(View, Camera)>, Failure> {
    let (middle, size) = (bounds.center(), bounds.size());
    let away = size.length().max(f64::MIN_POSITIVE);
    let view = |number: usize| {
        // Directions that spread evenly over a sphere, beginning at its pole.
        let turn = 2.399963 * number as f64;
        let z = 1.0 - 2.0 * (number as f64 / count.max(1) as f64).min(1.0);
        let across = (1.0 - z * z).max(0.0).sqrt();
        let toward = DVec3::new(across * turn.cos(), across * turn.sin(), z);
        let up = if across < 0.1 { DVec3::Y } else { DVec3::Z };
        let ortho = if number == 0 { size.x.max(size.y) } else { size.max_element() };
        let ortho = if ortho > 0.0 { ortho } else { 1.0 };
        let eye = middle + away * toward;
        let view = View::look_at(eye, middle, up, Projection::Orthographic { height: ortho }, width, height)?;
        let camera = Camera { eye: eye.to_array(), target: middle.to_array(), up: up.to_array(), ortho };
        Ok((view, camera))
    };
    (0..count).map(view).collect()
}

/// Relative L1 and L2 error of sums, and their peak signal-to-noise ratio in decibels, the brightest pixel being the peak.
pub(super) fn sum_errors(sums: &Accumulation, exact: &Accumulation) -> [f64; 3] {
    let pairs = || sums.p.iter().zip(&exact.p).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let total: f64 = pairs().map(|(_, b)| b.abs()).sum();
    let squares: f64 = pairs().map(|(_, b)| b * b).sum();
    let differ: f64 = pairs().map(|(a, b)| (a - b).abs()).sum();
    let square: f64 = pairs().map(|(a, b)| (a - b) * (a - b)).sum();
    let peak = pairs().map(|(_, b)| b).fold(0.0, f64::max);
    let pixels = exact.p.len().max(1) as f64;
    let psnr = 10.0 * (peak * peak * pixels / square.max(f64::MIN_POSITIVE)).log10();
    [differ / total, (square / squares).sqrt(), psnr]
}

/// Distances of colours, of 255.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ColorError {
    /// Mean over the pixels.
    pub mean: f64,
    /// What 99 % of them are below.
    pub p99: f64,
}

/// How far colours are from those of the exact picture.
pub fn color_errors(image: &Image, truth: &Image) -> ColorError {
    let distance = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|k| f64::from(a[k].abs_diff(b[k]))).sum::<f64>() / 3.0;
    let mut all: Vec<f64> = image.rgba.iter().zip(&truth.rgba).map(distance).collect();
    all.sort_by(f64::total_cmp);
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    ColorError { mean, p99: all.get(all.len() * 99 / 100).copied().unwrap_or(0.0) }
}

/// A picture for the sheet.
pub(super) struct Shown {
    pub(super) outcome: Outcome,
    pub(super) image: Image,
}

impl Shown {
    /// A sheet of the pictures and their differences from the exact one, four times enlarged; a row for each hierarchy.
    pub(super) fn write(folder: &Path, columns: u32, truth: &Image, shown: &[Shown]) -> Result<(), Failure> {
        let caption = |outcome: &Outcome| {
            let Outcome { hierarchy, splats, error_l2, error_color, .. } = outcome;
            vec![
                format!("{hierarchy}, {splats} splats"),
                format!("L2 {error_l2:.3}, colour {:.1} of 255", error_color.mean),
            ]
        };
        let differences: Vec<Image> = shown.iter().map(|shown| enlarged_difference(&shown.image, truth)).collect();
        let pictures: Vec<Entry<'_>> =
            shown.iter().map(|shown| Entry { image: &shown.image, caption: caption(&shown.outcome) }).collect();
        let differing: Vec<Entry<'_>> = shown
            .iter()
            .zip(&differences)
            .map(|(shown, image)| Entry { image, caption: caption(&shown.outcome) })
            .collect();
        output::write_png(&folder.join("exact.png"), truth)?;
        output::write_png(&folder.join("pictures.png"), &sheet(&pictures, columns))?;
        output::write_png(&folder.join("differences.png"), &sheet(&differing, columns))?;
        Ok(())
    }
}
