//! Footprints other than the kernel: what point primitives of graphics hardware draw (HE03, section 5: points, antialiased points, point
//! sprites), for pictures to compare with.
//!
//! All of them have the splat's flux, and but for single pixels its second moments in the picture: those of its kernel, seen from far away.
//! A picture's area means are approximate: a disc is cut into strips that follow its rows, a Gaussian is blurred by a pixel and
//! sampled at pixels' centres.

use super::ellipse::Ellipse;
use super::exact::{BAND, Band, Canvas, cells};
use super::footprint::{Footprint, Lens, Shape};
use super::{Counts, SplatOptions, Splats};
use crate::color::Accumulation;
use crate::view::View;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// What a splat looks like in the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Sprite {
    /// The line-of-sight integral of its kernel: what all else in this program draws.
    #[default]
    Kernel,
    /// A Gaussian that ends at [`SIGMAS`].
    Gaussian,
    /// An ellipse of one brightness.
    Disc,
    /// The pixel that holds its centre.
    Pixel,
}

impl Sprite {
    /// All of them.
    pub const ALL: [Sprite; 4] = [Sprite::Kernel, Sprite::Gaussian, Sprite::Disc, Sprite::Pixel];

    /// Its name in files and statistics.
    pub fn name(self) -> &'static str {
        match self {
            Sprite::Kernel => "kernel",
            Sprite::Gaussian => "gaussian",
            Sprite::Disc => "disc",
            Sprite::Pixel => "pixel",
        }
    }
}

/// Where a Gaussian ends, standard deviations: as in viewers of Gaussian splats.
pub const SIGMAS: f64 = 3.0;
/// By what Gaussians are blurred, square pixels: as in viewers of Gaussian splats. Of less, samples at pixels' centres would not keep places.
const PIXEL: f64 = 0.3;
/// Strips that a row of pixels, and the height of a disc, are divided into at least.
const STRIPS: [f64; 2] = [8.0, 32.0];
/// Gaussians that reach less far are scaled so that their samples add up to the flux; others do by themselves.
const SUMMED: f64 = 32.0;
/// Splats that are drawn at a time.
const BATCH: usize = 1 << 16;

/// A splat in the picture.
#[derive(Clone, Copy)]
struct Sprited {
    /// Amplitudes are its fluxes: sums over pixels.
    flux: Footprint,
    /// The ellipse in which the kernel ends.
    support: Ellipse,
}

/// A picture that batches are added to. The method counts for nothing.
pub struct Drawing {
    view: View,
    options: SplatOptions,
    attribute: bool,
    counts: Counts,
    canvas: Canvas,
}

impl Drawing {
    /// Nothing is in it yet.
    pub fn new(view: &View, options: &SplatOptions) -> Drawing {
        let canvas = Canvas::new(view.width as usize, view.height as usize, false);
        Drawing { view: *view, options: *options, attribute: false, counts: Counts::default(), canvas }
    }

    /// Adds batches, one after the other.
    pub fn add(&mut self, batches: &[Splats<'_>]) {
        self.attribute |= batches.iter().any(|batch| batch.attribute().is_some());
        self.canvas.prepare(self.attribute);
        let Drawing { view, options, counts, canvas, .. } = self;
        let (options, lens, height) = (&*options, Lens::new(view), view.height as usize);
        for batch in batches {
            for start in (0..batch.len()).step_by(BATCH) {
                let end = batch.len().min(start + BATCH);
                let footprints =
                    (start..end).into_par_iter().filter_map(|at| lens.footprint(batch, at, options.kernel));
                let mut splats: Vec<Sprited> =
                    footprints.filter_map(|footprint| sprited(&lens, footprint, options)).collect();
                let all = splats.len();
                splats.retain(|splat| lens.sees(&splat.flux, 0.0));
                let seen = splats.len();
                splats.retain(|splat| {
                    options.faintest <= 0.0 || brightest(splat, options) >= f64::from(options.faintest)
                });
                *counts += Counts {
                    drawn: splats.len() as u64,
                    outside: (all - seen) as u64,
                    faint: (seen - splats.len()) as u64,
                };
                let mut of_bands: Vec<Vec<u32>> = vec![Vec::new(); height.div_ceil(BAND)];
                for (number, splat) in (0..).zip(&splats) {
                    let rows = cells(splat.flux.min[1], splat.flux.max[1], 0, height);
                    let bands = rows.start / BAND..rows.end.div_ceil(BAND).min(of_bands.len());
                    of_bands[bands].iter_mut().for_each(|band| band.push(number));
                }
                canvas.bands(|mut band| {
                    for splat in of_bands[band.first / BAND].iter().map(|&number| &splats[number as usize]) {
                        match options.sprite {
                            Sprite::Disc => disc(splat, options.kernel.variance(), &mut band),
                            Sprite::Pixel => pixel(splat, &mut band),
                            Sprite::Gaussian | Sprite::Kernel => gaussian(splat, options.kernel.variance(), &mut band),
                        }
                    }
                });
            }
        }
    }

    /// The picture.
    pub fn finish(self) -> (Accumulation, Counts) {
        let Drawing { view, attribute, counts, canvas, .. } = self;
        let mut picture = Accumulation::new(view.width, view.height, attribute);
        let singles = |channel: Vec<f64>| channel.into_par_iter().map(|value| value as f32).collect();
        (picture.p, picture.ps) = (singles(canvas.p), singles(canvas.ps));
        (picture, counts)
    }
}

/// What a footprint is drawn as: its box is that of the sprite.
fn sprited(lens: &Lens, footprint: Footprint, options: &SplatOptions) -> Option<Sprited> {
    let far = lens.seen_from_far(footprint, options.kernel, f64::INFINITY);
    let support = match far.shape {
        Shape::Circle { center } => Ellipse { center, shear: 0.0, half: [far.radius; 2] },
        Shape::Ellipse(ellipse) => ellipse,
        // Longer by the secant of the angle off the axis, along the picture's radius.
        Shape::Sphere { camera, h } => {
            let center = lens.center(camera)?;
            let slope = glam::DVec2::from(lens.slope(center));
            let radius = h * lens.focal() / camera.z;
            let stretch = (1.0 + slope.length_squared()).sqrt() - 1.0;
            let along = slope.normalize_or_zero();
            let row = |k: usize| {
                let unit = if k == 0 { glam::DVec2::X } else { glam::DVec2::Y };
                (radius * (unit + stretch * along[k] * along)).extend(0.0)
            };
            Ellipse::of(center, row(0), row(1))?
        }
        Shape::Ellipsoid(_) => return None,
    };
    let area = support.area();
    let reach = match options.sprite {
        Sprite::Pixel => [0.5; 2],
        Sprite::Disc => support.extent().map(|half| half * 2.0 * options.kernel.variance().sqrt()),
        Sprite::Gaussian | Sprite::Kernel => {
            support.extent().map(|half| SIGMAS * (half * half * options.kernel.variance() + PIXEL).sqrt())
        }
    };
    let flux = Footprint {
        min: [0, 1].map(|k| support.center[k] - reach[k]),
        max: [0, 1].map(|k| support.center[k] + reach[k]),
        amplitude: far.amplitude * area,
        amplitude_s: far.amplitude_s * area,
        ..far
    };
    (area.is_finite() && flux.amplitude.is_finite()).then_some(Sprited { flux, support })
}

/// The most that a splat adds to a pixel.
fn brightest(splat: &Sprited, options: &SplatOptions) -> f64 {
    let variances = options.kernel.variance() * splat.support.area();
    let peak = match options.sprite {
        Sprite::Pixel => 1.0,
        Sprite::Disc => (2.0 * TAU * variances).recip(),
        Sprite::Gaussian | Sprite::Kernel => (TAU * variances).recip(),
    };
    splat.flux.amplitude * peak.min(1.0)
}

/// All of it in one pixel.
fn pixel(splat: &Sprited, band: &mut Band<'_>) {
    let [x, y] = splat.support.center.map(f64::floor);
    let row = y - band.first as f64;
    if (0.0..band.rows() as f64).contains(&row) && (0.0..band.stride as f64).contains(&x) {
        band.add(row as usize, x as usize, &splat.flux, 1.0);
    }
}

/// An ellipse of one brightness: strips along the rows, each with the share of its chord.
fn disc(splat: &Sprited, variance: f64, band: &mut Band<'_>) {
    let Ellipse { center, shear, half } = splat.support;
    // A disc's variance is a quarter of its radius squared.
    let half = half.map(|half| half * 2.0 * variance.sqrt());
    let strips = (2.0 * half[1] * STRIPS[0]).clamp(STRIPS[1], 1e6).ceil();
    let height = 2.0 * half[1] / strips;
    // The chords of midpoints have a little more than the disc's area.
    let chord = |strip: f64| (1.0 - ((2.0 * strip + 1.0) / strips - 1.0).powi(2)).max(0.0).sqrt();
    let whole = TAU / 8.0 * strips * (1.0 + 0.31 * strips.powf(-1.5));
    let of = |y: f64| ((y - center[1] + half[1]) / height).floor().clamp(0.0, strips);
    let rows = [band.first, band.first + band.rows()].map(|row| of(row as f64));
    for strip in rows[0] as u64..(rows[1] + 1.0).min(strips) as u64 {
        let (strip, across) = (strip as f64, chord(strip as f64));
        let top = center[1] - half[1] + strip * height;
        let reach = half[0] * across;
        if reach <= 0.0 {
            continue;
        }
        let middle = center[0] + shear * (top + 0.5 * height - center[1]);
        let density = across / whole / (2.0 * reach);
        // A strip is lower than a pixel: it lies in one row, or in two.
        let [first, last] = [top, top + height].map(f64::floor);
        let lower = if last > first { (top + height - last) / height } else { 0.0 };
        for (row, part) in [(first, 1.0 - lower), (last, lower)] {
            let row = row - band.first as f64;
            if part <= 0.0 || !(0.0..band.rows() as f64).contains(&row) {
                continue;
            }
            for i in cells(middle - reach, middle + reach, 0, band.stride) {
                let covered = (middle + reach).min(i as f64 + 1.0) - (middle - reach).max(i as f64);
                band.add(row as usize, i, &splat.flux, part * density * covered.max(0.0));
            }
        }
    }
}

/// A Gaussian, blurred by a pixel, at the pixels' centres.
fn gaussian(splat: &Sprited, variance: f64, band: &mut Band<'_>) {
    let Ellipse { center, shear, half } = splat.support;
    // The second moments of the support's form, times the kernel's variance.
    let yy = half[1] * half[1] * variance;
    let (xx, xy) = (half[0] * half[0] * variance + shear * shear * yy + PIXEL, shear * yy);
    let yy = yy + PIXEL;
    // `q^2` is that along x around a row's middle, and that of the row.
    let (lean, own) = (xy / yy, xx - xy * xy / yy);
    let value = |dx: f64, dy: f64| {
        let along = dx - lean * dy;
        let square = along * along / own + dy * dy / yy;
        if square < SIGMAS * SIGMAS { (-0.5 * square).exp() } else { 0.0 }
    };
    let reach = splat.flux.max[0] - center[0];
    let whole = match reach.max(splat.flux.max[1] - center[1]) < SUMMED {
        true => {
            let around = |k: usize| {
                (splat.flux.min[k].floor() as i64..=splat.flux.max[k].floor() as i64)
                    .map(move |at| at as f64 + 0.5 - center[k])
            };
            around(1).map(|dy| around(0).map(|dx| value(dx, dy)).sum::<f64>()).sum::<f64>()
        }
        false => TAU * (own * yy).sqrt() * (1.0 - (-0.5 * SIGMAS * SIGMAS).exp()),
    };
    for j in cells(splat.flux.min[1], splat.flux.max[1], band.first as i64, band.rows()) {
        let dy = (band.first + j) as f64 + 0.5 - center[1];
        for i in cells(splat.flux.min[0], splat.flux.max[0], 0, band.stride) {
            let share = value(i as f64 + 0.5 - center[0], dy) / whole;
            if share > 0.0 {
                band.add(j, i, &splat.flux, share);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::cpu::{Extent, Positions, draw_counted};
    use crate::model::{Covariance, Kernel};
    use crate::view::Projection;
    use glam::DVec3;
    use proptest::prelude::*;

    /// The flux, the centre and the second moments (xx, yy, xy) of a picture, pixels.
    fn moments(picture: &Accumulation) -> [f64; 6] {
        let mut sums = [0.0; 6];
        for (at, &value) in picture.p.iter().enumerate() {
            let (x, y) = ((at % picture.width as usize) as f64 + 0.5, (at / picture.width as usize) as f64 + 0.5);
            for (sum, of) in sums.iter_mut().zip([1.0, x, y, x * x, y * y, x * y]) {
                *sum += f64::from(value) * of;
            }
        }
        let [flux, x, y, xx, yy, xy] = sums;
        let [x, y] = [x / flux, y / flux];
        [flux, x, y, xx / flux - x * x, yy / flux - y * y, xy / flux - x * y]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Whatever the footprint, a splat's light is where it was, and as wide, whether it is smaller than a pixel or large, round or not.
        #[test]
        fn footprints_keep_flux_place_and_spread(
            place in prop::array::uniform2(-0.1..0.1f64), size in 0.001..0.3f64, thin in 0.05..1.0f64, turn in 0.0..3.2f64,
            kernel in prop::sample::select(Kernel::ALL.to_vec()), orthographic in any::<bool>(),
        ) {
            let projection = match orthographic {
                true => Projection::Orthographic { height: 2.0 },
                false => Projection::Perspective { fov_y: 0.2 },
            };
            let view = View::look_at(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y, projection, 128, 128).unwrap();
            let (sin, cos) = turn.sin_cos();
            let (long, short) = (size * size * kernel.variance(), (thin * size).powi(2) * kernel.variance());
            let covariance = Covariance([
                cos * cos * long + sin * sin * short, sin * sin * long + cos * cos * short, short, sin * cos * (long - short), 0.0, 0.0,
            ].map(|value| value as f32));
            let (places, weight) = ([[place[0], place[1], 0.0]], [2.5_f32]);
            let splats = Splats::new(Positions::World(&places), Extent::Ellipsoids(std::slice::from_ref(&covariance)), &weight, None).unwrap();
            let picture = |sprite| draw_counted(&view, &[splats], &SplatOptions { kernel, sprite, ..SplatOptions::default() }).0;
            let reference = super::super::draw(&view, &[splats], &SplatOptions {
                kernel, method: super::super::Method::Exact, ..SplatOptions::default()
            });
            let expected = moments(&reference);
            let place = Lens::new(&view).center(view.to_camera(DVec3::from(places[0]))).unwrap();
            for sprite in [Sprite::Gaussian, Sprite::Disc, Sprite::Pixel] {
                let found = moments(&picture(sprite));
                prop_assert!((found[0] / expected[0] - 1.0).abs() < 2e-3, "{sprite:?}: flux {} of {}", found[0], expected[0]);
                // Area means of what is smaller than a pixel are in the middle of that, as the reference's.
                let [x, y] = if sprite == Sprite::Disc { [expected[1], expected[2]] } else { place };
                let apart = (found[1] - x).hypot(found[2] - y);
                prop_assert!(apart < if sprite == Sprite::Pixel { 0.72 } else { 0.08 }, "{sprite:?}: {apart} pixels away");
                if sprite == Sprite::Pixel {
                    prop_assert!(found[3].abs() < 1e-6 && found[4].abs() < 1e-6, "in one pixel");
                    continue;
                }
                for k in 3..6 {
                    // What ends at three standard deviations has 3 % less variance; a pixel's own is in all of them, or the blur in its place,
                    // but for discs that end where pixels do: what a kernel has beyond is in further ones.
                    let slack = 0.06 * (expected[3] + expected[4]) + if sprite == Sprite::Gaussian { PIXEL } else { 0.03 + 1.0 / 12.0 };
                    prop_assert!((found[k] - expected[k]).abs() < slack, "{sprite:?}: {k}: {} of {}", found[k], expected[k]);
                }
            }
        }
    }

    #[test]
    fn a_disc_has_one_brightness_and_an_edge() {
        let view =
            View::look_at(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y, Projection::Orthographic { height: 2.0 }, 200, 200)
                .unwrap();
        let kernel = Kernel::CubicSpline;
        let (places, weight, h) = ([[0.0; 3]], [1.0_f32], [0.5_f32]);
        let splats = Splats::new(Positions::World(&places), Extent::World(&h), &weight, None).unwrap();
        let (picture, counts) =
            draw_counted(&view, &[splats], &SplatOptions { kernel, sprite: Sprite::Disc, ..SplatOptions::default() });
        assert_eq!(counts.drawn, 1);
        let radius = 2.0 * kernel.variance().sqrt() * 0.5;
        let expected = 1.0 / (TAU / 2.0 * radius * radius);
        for (at, &value) in picture.p.iter().enumerate() {
            let away = ((at % 200) as f64 - 99.5).hypot((at / 200) as f64 - 99.5) / 100.0;
            match away / radius {
                inside if inside < 0.96 => {
                    assert!((f64::from(value) / expected - 1.0).abs() < 0.02, "{value} of {expected}")
                }
                outside if outside > 1.04 => assert_eq!(value, 0.0),
                _ => assert!(f64::from(value) < 1.05 * expected),
            }
        }
    }
}
