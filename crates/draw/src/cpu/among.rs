//! Sums of splats among surfaces: of each splat what is in front of them.
//!
//! `P` of a pixel that a surface covers is the integral along the line of sight from the eye to the surface; of one that it covers in part, the
//! mean over its area all the same. Most splats are in front of all that is in their pixels, or behind what covers all of these: a pyramid of the
//! surfaces' depths tells which, and they are drawn as ever, or not at all. The few that a surface cuts are summed sample by sample: of a kernel
//! counts what lies in front along each ray ([`super::half_line`]), so that nothing jumps where a particle comes through a surface.
//!
//! Volumes that are seen through are in front of a splat in part all over, and much the same in neighbouring pixels: what they let through of it is found at a few
//! places of its outline and taken to change evenly between them. A small splat is drawn as ever with the mean of that.
//!
//! A splat of a fixed size in pixels is the glare of a point: it is seen as a whole, as far as its middle is.

use super::about_eye::Stretched;
use super::exact::{BAND, Band, Canvas, cells};
use super::footprint::{Footprint, Lens};
use super::half_line::HalfLine;
use super::paths::fragments::visible;
use super::paths::{PathFragment, PathFragments};
use super::{Counts, Extent, SplatOptions, Splats, Sprite};
use crate::color::Accumulation;
use crate::view::{Projection, View};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Samples along the radius of a splat that is cut: the mean of samples in a pixel is that over its area to half a percent of the peak.
const SAMPLES: f64 = 8.0;
/// Most samples along a pixel's side; smaller splats grow.
const FINEST: f64 = 4096.0;
/// The shortest semi-axis of an ellipsoid that is cut, over the longest.
const FLATTEST: f64 = 0.05;
/// Radius up to which a splat among what is seen through is drawn as a whole, pixels.
const SMALL: f64 = 4.0;
/// Places along a side of a larger one at which it is found what is let through.
const PLACES: usize = 9;
/// Surfaces that let less through cover a pixel.
const CLOSED: f32 = 1e-5;

/// Draws batches into one picture of the view's size, as [`super::draw_counted`], but what is behind `surfaces`.
///
/// # Errors
/// [`super::SplatError`] as [`Splats::new`].
pub fn draw(
    view: &View,
    batches: &[Splats<'_>],
    options: &SplatOptions,
    surfaces: &PathFragments,
) -> Result<(Accumulation, Counts), super::SplatError> {
    let (lens, depths) = (Lens::new(view), Depths::new(surfaces));
    let sorted: Vec<Sorted> =
        batches.par_iter().map(|batch| sorted(&lens, view, batch, options, surfaces, &depths)).collect();
    let mut in_front = Vec::with_capacity(batches.len());
    for (batch, sorted) in batches.iter().zip(&sorted) {
        match &sorted.weight {
            None => in_front.push(*batch),
            Some(weight) => {
                let same = Splats::new(batch.positions(), batch.extent(), weight, batch.attribute())?;
                in_front.push(same.with_reach(batch.reach()));
            }
        }
    }
    let (mut picture, mut counts) = super::draw_counted(view, &in_front, options);
    let cut: Vec<(&Cut, &[f32])> =
        sorted.iter().flat_map(|sorted| sorted.cut.iter().map(|cut| (cut, &sorted.veils[cut.veil.clone()]))).collect();
    counts.drawn += cut.len() as u64;
    let table = HalfLine::of(options.kernel);
    let mut canvas = Canvas::new(view.width as usize, view.height as usize, picture.has_attribute());
    let mut of_bands: Vec<Vec<u32>> = vec![Vec::new(); (view.height as usize).div_ceil(BAND)];
    for (number, (splat, _)) in (0..).zip(&cut) {
        let rows = cells(splat.footprint.min[1], splat.footprint.max[1], 0, view.height as usize);
        let bands = rows.start / BAND..rows.end.div_ceil(BAND).min(of_bands.len());
        of_bands[bands].iter_mut().for_each(|band| band.push(number));
    }
    canvas.bands(|mut band| {
        for &number in &of_bands[band.first / BAND] {
            let (splat, veil) = cut[number as usize];
            splat.add(&lens, table, surfaces, veil, &mut band);
        }
    });
    let channels = [(&mut picture.p, canvas.p), (&mut picture.ps, canvas.ps)];
    channels.into_iter().for_each(|(to, from)| to.iter_mut().zip(from).for_each(|(to, from)| *to += from as f32));
    Ok((picture, counts))
}

/// The share of a splat's middle that surfaces let through, from 0 to 1; of one beside the picture at the nearest pixel.
pub(super) fn share_of(lens: &Lens, surfaces: &PathFragments, camera: DVec3) -> f32 {
    let Some(center) = lens.center(camera) else { return 1.0 };
    let [x, y] = [0, 1].map(|axis| (center[axis].max(0.0) as usize).min(surfaces.size[axis].saturating_sub(1)));
    visible(surfaces.of(x, y), camera.z as f32)
}

/// The share of a small splat, whose middle and reach in depth are these, that what is seen through lets through: the mean at its middle and around it.
fn haze(surfaces: &PathFragments, footprint: &Footprint, table: &HalfLine, [middle, reach]: [f64; 2]) -> f32 {
    let place = |axis: usize, share: f64| {
        let (min, max) = (footprint.min[axis], footprint.max[axis]);
        ((min + share * (max - min)).max(0.0) as usize).min(surfaces.size[axis].saturating_sub(1))
    };
    // Within a pixel all places are one.
    let shares: &[f64] = if footprint.radius <= 0.5 { &[0.5] } else { &[0.25, 0.5, 0.75] };
    let each = shares.iter().flat_map(|down| shares.iter().map(move |across| (place(0, *across), place(1, *down))));
    let sum: f64 = each.map(|(x, y)| let_through(surfaces.of(x, y), table, [middle, reach])).sum();
    (sum / (shares.len() * shares.len()) as f64) as f32
}

/// The share of a kernel, whose middle and reach in depth are these, that fragments let through.
fn let_through(fragments: &[PathFragment], table: &HalfLine, [middle, reach]: [f64; 2]) -> f64 {
    let (mut met, mut through) = (0.0, 1.0);
    for fragment in fragments {
        let alpha = f64::from(fragment.alpha);
        met += through * alpha * table.front((f64::from(fragment.depth) - middle) / reach.max(f64::MIN_POSITIVE));
        through *= 1.0 - alpha;
    }
    met + through
}

/// What is let through of a splat at [`PLACES`] by as many places, row by row, from the first to the last pixel that it covers.
fn veil(surfaces: &PathFragments, footprint: &Footprint, table: &HalfLine, depths: [f64; 2], shares: &mut Vec<f32>) {
    let place = |axis: usize, number: usize| {
        let [first, last] = ends(footprint, axis);
        let at = first + (last - first) * number as f64 / (PLACES - 1) as f64;
        (at.max(0.0) as usize).min(surfaces.size[axis].saturating_sub(1))
    };
    let columns: [usize; PLACES] = std::array::from_fn(|number| place(0, number));
    for down in 0..PLACES {
        let row = place(1, down);
        shares.extend(columns.iter().map(|x| let_through(surfaces.of(*x, row), table, depths) as f32));
    }
}

/// The outermost places of a splat along an axis at which it is found what is let through, pixels.
fn ends(footprint: &Footprint, axis: usize) -> [f64; 2] {
    [footprint.min[axis].floor() + 0.5, footprint.max[axis].floor() + 0.5]
}

/// What becomes of a batch.
struct Sorted {
    /// Weights of what is drawn as ever; what is hidden or cut has none that is a number. `None` where nothing is either.
    weight: Option<Vec<f32>>,
    cut: Vec<Cut>,
    /// What is let through of those that are behind what is seen through, one after the other.
    veils: Vec<f32>,
}

/// Sorts a batch.
fn sorted(
    lens: &Lens,
    view: &View,
    batch: &Splats<'_>,
    options: &SplatOptions,
    surfaces: &PathFragments,
    depths: &Depths,
) -> Sorted {
    let mut sorted = Sorted { weight: None, cut: Vec::new(), veils: Vec::new() };
    let is_glare = matches!(batch.extent(), Extent::Pixels(_)) || options.sprite != Sprite::Kernel;
    for index in 0..batch.len() {
        let camera = view.to_camera(batch.positions().world(index));
        let reach = if is_glare { 0.0 } else { batch.farthest(index).map_or(0.0, f64::from) };
        let may_be_hidden = camera.z + reach > depths.nearest;
        // What is not finite is not drawn anyway.
        if !may_be_hidden {
            continue;
        }
        let own = batch.weight()[index];
        let share = match is_glare {
            true => share_of(lens, surfaces, camera),
            false => {
                let Some(footprint) = lens.footprint(batch, index, options.kernel) else { continue };
                match depths.side([camera.z - reach, camera.z + reach], &footprint) {
                    Side::Front => 1.0,
                    Side::Behind => 0.0,
                    Side::Cut if surfaces.is_hazy && footprint.radius <= SMALL => {
                        haze(surfaces, &footprint, HalfLine::of(options.kernel), [camera.z, reach])
                    }
                    Side::Cut => {
                        if let Some(mut cut) = Cut::of(view, batch, index, footprint, options) {
                            let begin = sorted.veils.len();
                            if surfaces.is_hazy {
                                let (table, depths) = (HalfLine::of(options.kernel), [camera.z, reach]);
                                veil(surfaces, &cut.footprint, table, depths, &mut sorted.veils);
                            }
                            cut.veil = begin..sorted.veils.len();
                            sorted.cut.push(cut);
                        }
                        0.0
                    }
                }
            }
        };
        if share < 1.0 {
            let weight = sorted.weight.get_or_insert_with(|| batch.weight().to_vec());
            weight[index] = if share > 0.0 { own * share } else { f32::NAN };
        }
    }
    sorted
}

/// A splat that a surface may cut.
struct Cut {
    footprint: Footprint,
    /// From camera space to where its support is the unit ball.
    to_ball: DMat3,
    /// Its middle in camera space.
    place: DVec3,
    /// Weights over its volume.
    amplitudes: [f64; 2],
    /// Samples along a pixel's side.
    fine: usize,
    /// Where it stands what is let through of it; empty among surfaces.
    veil: Range<usize>,
}

impl Cut {
    fn of(view: &View, batch: &Splats<'_>, index: usize, footprint: Footprint, options: &SplatOptions) -> Option<Cut> {
        let Stretched { to_ball, volume } = Stretched::of(batch, index, options.kernel, [FLATTEST, 0.0])?;
        let to_ball = to_ball * DMat3::from_cols(view.right, view.up, view.forward);
        let place = view.to_camera(batch.positions().world(index));
        let weight = f64::from(batch.weight()[index]);
        let weights = [weight, batch.attribute().map_or(0.0, |values| weight * f64::from(values[index]))];
        let mut footprint = footprint;
        if let (Extent::Ellipsoids(_), Some(longest)) = (batch.extent(), batch.farthest(index)) {
            // What is thicker than it was covers more.
            let scale = match view.projection {
                Projection::Perspective { .. } => view.focal_pixels() / place.z,
                Projection::Orthographic { .. } => view.focal_pixels(),
            };
            let thick = FLATTEST * f64::from(longest) * scale;
            footprint.radius = footprint.radius.max(thick);
            (footprint.min, footprint.max) = (footprint.min.map(|at| at - thick), footprint.max.map(|at| at + thick));
        }
        let fine = (SAMPLES / footprint.radius).ceil().clamp(1.0, FINEST);
        // What is too small for that grows.
        let grown = (SAMPLES / (fine * footprint.radius)).max(1.0);
        if grown > 1.0 {
            for k in 0..2 {
                let (middle, half) =
                    (0.5 * (footprint.max[k] + footprint.min[k]), 0.5 * (footprint.max[k] - footprint.min[k]));
                (footprint.min[k], footprint.max[k]) = (middle - grown * half, middle + grown * half);
            }
        }
        let cut = Cut {
            footprint,
            to_ball: to_ball * grown.recip(),
            place,
            amplitudes: weights.map(|weight| weight / (volume * grown.powi(3))),
            fine: fine as usize,
            veil: 0..0,
        };
        (place.is_finite() && cut.amplitudes.iter().all(|amplitude| amplitude.is_finite())).then_some(cut)
    }

    /// Adds what of it is in front of surfaces to the pixels of a band, or what is let through of it.
    fn add(&self, lens: &Lens, table: &HalfLine, surfaces: &PathFragments, veil: &[f32], band: &mut Band<'_>) {
        let Footprint { min, max, .. } = self.footprint;
        let fine = self.fine as f64;
        let columns = cells(min[0], max[0], 0, band.stride);
        let samples = |axis: usize, pixel: usize| {
            let first = pixel * self.fine;
            let own = cells(min[axis] * fine, max[axis] * fine, first as i64, self.fine);
            own.map(move |sample| (first + sample) as f64 / fine + 0.5 / fine)
        };
        for row in cells(min[1], max[1], band.first as i64, band.rows()) {
            let y = band.first + row;
            for x in columns.clone() {
                let fragments = if veil.is_empty() { surfaces.of(x, y) } else { &[] };
                let mut sum = 0.0;
                for down in samples(1, y) {
                    for across in samples(0, x) {
                        let (start, direction) = lens.sight([across, down]);
                        let (away, ray) = (self.to_ball * (self.place - start), self.to_ball * direction);
                        let longer = ray.length();
                        let along = away.dot(ray) / longer;
                        let square = away.length_squared() - along * along;
                        // What is behind the eye as a whole is not seen.
                        let is_behind = along < 0.0 && away.length_squared() > 1.0;
                        if square.is_nan() || square >= 1.0 || is_behind {
                            continue;
                        }
                        let until = |depth: f64| table.at(square.max(0.0), depth * longer - along);
                        let (mut met, mut through) = (0.0, 1.0);
                        for fragment in fragments {
                            met += through * f64::from(fragment.alpha) * until(f64::from(fragment.depth));
                            through *= 1.0 - f64::from(fragment.alpha);
                        }
                        met += through * until(f64::INFINITY);
                        sum += met * direction.length() / longer;
                    }
                }
                if !veil.is_empty() {
                    sum *= self.let_through(veil, [x, y]);
                }
                if sum > 0.0 {
                    band.add_amplitudes(row, x, self.amplitudes, sum / (fine * fine));
                }
            }
        }
    }
}

impl Cut {
    /// What is let through of it in a pixel, between the places at which that is known.
    fn let_through(&self, veil: &[f32], pixel: [usize; 2]) -> f64 {
        let locate = |axis: usize| {
            let [first, last] = ends(&self.footprint, axis);
            let at = (pixel[axis] as f64 + 0.5 - first) / (last - first).max(1.0) * (PLACES - 1) as f64;
            let at = at.clamp(0.0, (PLACES - 1) as f64);
            let index = (at as usize).min(PLACES - 2);
            (index, at - index as f64)
        };
        let ((x, u), (y, v)) = (locate(0), locate(1));
        let row = |y: usize| {
            let [left, right] = [0, 1].map(|step| f64::from(veil[y * PLACES + x + step]));
            left + u * (right - left)
        };
        let (above, below) = (row(y), row(y + 1));
        above + v * (below - above)
    }
}

/// On which side of surfaces a splat is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    /// In front of all that is in its pixels.
    Front,
    /// Behind what covers all of them.
    Behind,
    /// Neither for sure.
    Cut,
}

/// Between which depths surfaces are in the pixels of a picture, and in squares of them.
struct Depths {
    /// From single pixels on, each level of half as many along each axis: pixels of a row, and of each the least depth of a surface and the
    /// largest at which something is still seen; infinite where there is none.
    levels: Vec<(usize, Vec<[f32; 2]>)>,
    /// The least depth of all.
    nearest: f64,
}

impl Depths {
    fn new(surfaces: &PathFragments) -> Depths {
        let [width, height] = surfaces.size;
        let pixel = |index: usize| {
            let fragments = surfaces.of(index % width, index / width);
            let nearest = fragments.first().map_or(f32::INFINITY, |fragment| fragment.depth);
            let mut through = 1.0;
            let covers = fragments.iter().find(|fragment| {
                through *= 1.0 - fragment.alpha;
                through < CLOSED
            });
            [nearest, covers.map_or(f32::INFINITY, |fragment| fragment.depth)]
        };
        let mut levels = vec![(width, (0..width * height).into_par_iter().map(pixel).collect::<Vec<_>>())];
        let both = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        while let Some((width, last)) = levels.last().filter(|(_, last)| last.len() > 1) {
            let (width, height) = (*width, last.len() / width);
            let (across, down) = (width.div_ceil(2), height.div_ceil(2));
            let square = |index: usize| {
                let (x, y) = (index % across * 2, index / across * 2);
                let at = |x: usize, y: usize| last[y.min(height - 1) * width + x.min(width - 1)];
                both(both(at(x, y), at(x + 1, y)), both(at(x, y + 1), at(x + 1, y + 1)))
            };
            let next = (across, (0..across * down).into_par_iter().map(square).collect());
            levels.push(next);
        }
        let nearest = levels.last().and_then(|(_, last)| last.first()).map_or(f32::INFINITY, |all| all[0]);
        Depths { levels, nearest: f64::from(nearest) }
    }

    /// The side of a splat that lies between two depths.
    fn side(&self, [near, far]: [f64; 2], footprint: &Footprint) -> Side {
        let Some((width, pixels)) = self.levels.first() else { return Side::Front };
        let size = [*width, pixels.len() / width.max(&1)];
        // Pixels that it may cover, and one around them; casts saturate.
        let ends: [[usize; 2]; 2] = std::array::from_fn(|axis| {
            let first = (footprint.min[axis] - 1.0).max(0.0) as usize;
            let last = ((footprint.max[axis] + 1.0).max(0.0) as usize).min(size[axis].saturating_sub(1));
            [first.min(last), last]
        });
        let longest = ends.iter().map(|[first, last]| last - first).max().unwrap_or(0);
        // Two or three squares along each axis.
        let level = (longest.max(1).ilog2() as usize).min(self.levels.len() - 1);
        let (across, squares) = &self.levels[level];
        let (mut nearest, mut covered) = (f32::INFINITY, f32::NEG_INFINITY);
        for y in ends[1][0] >> level..=ends[1][1] >> level {
            for x in ends[0][0] >> level..=ends[0][1] >> level {
                let [near, far] = squares[y * across + x];
                (nearest, covered) = (nearest.min(near), covered.max(far));
            }
        }
        if far <= f64::from(nearest) {
            Side::Front
        } else if near >= f64::from(covered) {
            Side::Behind
        } else {
            Side::Cut
        }
    }
}

#[cfg(test)]
mod tests;
