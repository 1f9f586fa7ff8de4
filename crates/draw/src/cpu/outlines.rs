//! Outlines of splats, near over far: for pictures of how a hierarchy sees the data.
//!
//! The outline of a splat is where lines of sight touch the surface on which its Mahalanobis distance from its middle is a given number of
//! standard deviations: an ellipse, in perspective too ([`Ellipsoid::outline`]). What reaches behind the eye's plane has none.

use super::ellipse::Ellipse;
use super::ellipsoid::Ellipsoid;
use super::volume::VolumeReport;
use super::volume::raycast::Ray;
use super::{Extent, Splats};
use crate::color::Colors;
use crate::model::Kernel;
use crate::view::{Projection, View};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::time::Instant;

/// Rows of pixels that one task draws.
const ROWS: usize = 16;
/// Opacity at which a pixel is done: what is behind cannot change a colour of 8 bits.
const OPAQUE: f32 = 0.998;

/// How outlines are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlineOptions {
    /// The kernel that smoothing lengths belong to.
    pub kernel: Kernel,
    /// Standard deviations from a splat's middle to its outline.
    pub deviations: f64,
    /// Width of the lines, pixels.
    pub width: f64,
    /// Opacity of what they enclose, 0 to 1.
    pub fill: f32,
    /// Light of what they enclose, of that of the line.
    pub dimmed: f32,
}

/// One splat's outline.
#[derive(Clone, Copy, Debug)]
struct Outline {
    ellipse: Ellipse,
    /// Half of its short axis, pixels.
    short: f64,
    distance: f64,
    color: [f32; 3],
}

/// Draws the outlines of batches, each in the colour (linear light) that `color` has for a splat of a batch. Particles of the report are the
/// outlines that reach into the picture.
pub fn draw(
    view: &View,
    batches: &[Splats<'_>],
    options: &OutlineOptions,
    color: impl Fn(&Splats<'_>, usize) -> [f32; 3] + Sync,
) -> (Colors, VolumeReport) {
    let start = Instant::now();
    let of_batch = |batch: &Splats<'_>| -> Vec<Outline> {
        let outline = |index| {
            let (ellipse, distance) = ellipse(view, batch, index, options)?;
            let outline = |color| Outline { ellipse, short: ellipse.radii()[0], distance, color };
            is_seen(view, &ellipse, options).then(|| outline(color(batch, index)))
        };
        (0..batch.len()).filter_map(outline).collect()
    };
    let mut outlines: Vec<Outline> = batches.par_iter().map(of_batch).flatten_iter().collect();
    // Stable: what is equally far away stays in the order of the batches.
    outlines.par_sort_by(|a, b| a.distance.total_cmp(&b.distance));
    let resampling = start.elapsed();
    let start = Instant::now();
    let (width, height) = (view.width as usize, view.height as usize);
    let mut rgba = vec![[0.0; 4]; width * height];
    rgba.par_chunks_mut(ROWS * width.max(1)).enumerate().for_each(|(band, pixels)| {
        let mut rays = vec![Ray::default(); pixels.len()];
        let rows = band * ROWS..band * ROWS + pixels.len() / width;
        outlines.iter().for_each(|outline| outline.draw(&mut rays, width, rows.clone(), options));
        let lit = |(pixel, ray): (&mut [f32; 4], &Ray)| *pixel = [ray.color[0], ray.color[1], ray.color[2], ray.alpha];
        pixels.iter_mut().zip(&rays).for_each(lit);
    });
    let planes = [outlines.first(), outlines.last()].map(|end| end.map_or(0.0, |outline| outline.distance));
    let (particles, grid) = (outlines.len() as u64, [view.width, view.height, 1]);
    let rendering = start.elapsed();
    let report = VolumeReport { particles, grid, planes, resampling, rendering, ..VolumeReport::default() };
    (Colors { width: view.width, height: view.height, rgba }, report)
}

/// The outline of a splat of a batch, and how far away its middle is. None for what has no extent, and what reaches behind the eye's plane.
pub fn ellipse(view: &View, batch: &Splats<'_>, index: usize, options: &OutlineOptions) -> Option<(Ellipse, f64)> {
    let OutlineOptions { kernel, deviations, .. } = *options;
    let camera = view.to_camera(batch.positions().world(index));
    let ball = |radius: f64| {
        let axes = DMat3::from_diagonal(DVec3::splat(radius));
        (radius > 0.0 && axes.is_finite()).then_some(Ellipsoid { camera, axes })
    };
    let distance = match view.projection {
        Projection::Perspective { .. } => camera.length(),
        Projection::Orthographic { .. } => camera.z,
    };
    if !(camera.z > 0.0 && camera.is_finite()) {
        return None;
    }
    let solid = match batch.extent() {
        Extent::World(lengths) => ball(deviations * kernel.variance().sqrt() * f64::from(lengths[index]))?,
        Extent::Ellipsoids(covariances) => Ellipsoid::of(covariances[index], deviations.powi(-2), camera, view)?,
        Extent::Pixels(radius) => {
            let radius = f64::from(radius);
            let ellipse = Ellipse::of(view.to_pixels(camera)?, radius * DVec3::X, radius * DVec3::Y)?;
            return Some((ellipse, distance));
        }
    };
    let focal = view.focal_pixels();
    let ellipse = match view.projection {
        Projection::Perspective { .. } => solid.outline(view.middle(), focal)?,
        Projection::Orthographic { .. } => solid.parallel_image(view.to_pixels(camera)?, focal)?,
    };
    Some((ellipse, distance))
}

/// Whether any pixel can show it.
fn is_seen(view: &View, ellipse: &Ellipse, options: &OutlineOptions) -> bool {
    let extent = ellipse.extent();
    let size = [view.width, view.height].map(f64::from);
    let reach = options.reach();
    (0..2).all(|k| ellipse.center[k] + extent[k] + reach > 0.0 && ellipse.center[k] - extent[k] - reach < size[k])
}

impl OutlineOptions {
    /// How far from an outline pixels may be that it covers in part.
    fn reach(&self) -> f64 {
        0.5 * self.width + 0.5
    }

    /// Opacities of the line and of what it encloses at a pixel whose middle is so far outside, pixels: shares of its area along the
    /// direction across.
    fn opacities(&self, distance: f64) -> [f32; 2] {
        let line = (self.reach() - distance.abs()).clamp(0.0, self.width.min(1.0)) as f32;
        let inside = (0.5 - distance).clamp(0.0, 1.0) as f32;
        [line, self.fill * inside]
    }
}

impl Outline {
    /// Draws what of it lies in some rows of the picture, which `rays` are of, behind what is there.
    fn draw(&self, rays: &mut [Ray], width: usize, rows: std::ops::Range<usize>, options: &OutlineOptions) {
        let Outline { ellipse, short, color, .. } = self;
        let (reach, height) = (options.reach(), ellipse.half[1]);
        let dimmed = color.map(|light| options.dimmed * light);
        // Casts saturate.
        let first = |edge: f64| (edge - 0.5).ceil().max(0.0) as usize;
        let after = |edge: f64| (edge + 0.5).floor().max(0.0) as usize;
        let (top, bottom) = (ellipse.center[1] - height - reach, ellipse.center[1] + height + reach);
        for row in first(top).max(rows.start)..after(bottom).min(rows.end) {
            let y = row as f64 + 0.5;
            let [left, right] = ellipse.between([y - reach, y + reach]);
            let columns = first(left - reach)..after(right + reach).min(width);
            let hollow = match self.hollow(y, reach) {
                Some([left, right]) if options.fill == 0.0 => first(left)..after(right).min(columns.end),
                _ => columns.end..columns.end,
            };
            let line = &mut rays[(row - rows.start) * width..][..width];
            for x in (columns.start..hollow.start.min(columns.end)).chain(hollow.end.max(columns.start)..columns.end) {
                let ray = &mut line[x];
                if ray.alpha < OPAQUE {
                    let [line, inside] = options.opacities(distance((ellipse, *short), [x as f64 + 0.5, y]));
                    ray.under(*color, line);
                    ray.under(dimmed, inside);
                }
            }
        }
    }

    /// Between which x no pixel at the height `y` is within `reach` of the outline, if between any.
    fn hollow(&self, y: f64, reach: f64) -> Option<[f64; 2]> {
        let Ellipse { center, shear, half } = self.ellipse;
        // Squares around pixels' middles whose corners all lie within: an ellipse is convex.
        let chord = |y: f64| {
            let down = (y - center[1]) / half[1];
            let across = half[0] * (1.0 - down * down).max(0.0).sqrt();
            let middle = center[0] + shear * (y - center[1]);
            (down.abs() < 1.0).then_some([middle - across, middle + across])
        };
        let (above, below) = (chord(y - reach)?, chord(y + reach)?);
        let hollow = [above[0].max(below[0]) + reach, above[1].min(below[1]) - reach];
        (hollow[0] < hollow[1]).then_some(hollow)
    }
}

/// How far outside of an ellipse with this half of its short axis a point lies, pixels, negative within: to first order, and within no
/// farther than along the short axis.
fn distance((ellipse, short): (&Ellipse, f64), [x, y]: [f64; 2]) -> f64 {
    let Ellipse { center, shear, half } = *ellipse;
    let down = y - center[1];
    let (u, v) = ((x - center[0] - shear * down) / half[0], down / half[1]);
    let square = u.hypot(v);
    let steepness = (u / half[0]).hypot(v / half[1] - shear * u / half[0]);
    let first_order = (square - 1.0) * square / steepness;
    match square {
        square if square >= 1.0 => first_order,
        square if square > 1e-9 => first_order.max(-short * (1.0 - square * square).sqrt()),
        _ => -short,
    }
}

#[cfg(test)]
mod tests;
