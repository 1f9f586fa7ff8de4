//! A panorama put together from its faces, before any transfer function: sums of light are averaged, never colours that have
//! been mapped, so that one exposure fits the whole picture and no face shows.
//!
//! A pixel is the mean of its samples, and a sample is read from its face by bilinear interpolation between pixel means. What
//! a sample has no direction for (the corners of a dome master) counts as black, so a rim is as smooth as a pixel.

use crate::color::Accumulation;
use crate::color::Colors;
use crate::view::View;
use crate::view::sections::Sections;
use rayon::prelude::*;

/// A picture with `N` channels, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Texels<const N: usize> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width * height` pixels.
    pub values: Vec<[f32; N]>,
}

impl<const N: usize> Texels<N> {
    /// A black picture.
    pub fn black(width: u32, height: u32) -> Texels<N> {
        Texels { width, height, values: vec![[0.0; N]; width as usize * height as usize] }
    }

    /// Another picture of the same size at the right of this one, or below it.
    pub fn beside(mut self, other: &Texels<N>, below: bool) -> Texels<N> {
        if below {
            self.values.extend_from_slice(&other.values);
            return Texels { height: self.height + other.height, ..self };
        }
        let width = self.width as usize;
        let rows = self.values.chunks(width).zip(other.values.chunks(width));
        let values = rows.flat_map(|(left, right)| left.iter().chain(right).copied()).collect();
        Texels { width: self.width + other.width, values, ..self }
    }

    /// The value between the centres of four pixels.
    fn at(&self, [x, y]: [f64; 2]) -> [f32; N] {
        let locate = |place: f64, size: u32| {
            let place = (place - 0.5).clamp(0.0, f64::from(size.saturating_sub(1)));
            let index = (place as usize).min(size.saturating_sub(2) as usize);
            (index, (place - index as f64) as f32)
        };
        let ((i, u), (j, v)) = (locate(x, self.width), locate(y, self.height));
        let (width, right) = (self.width as usize, usize::from(self.width > 1));
        let below = if self.height > 1 { width } else { 0 };
        let at = j * width + i;
        let corners = [at, at + right, at + below, at + below + right].map(|index| self.values[index]);
        // Exactly a pixel where it lies on one, whatever its neighbours are.
        let mix = |a: f32, b: f32, share: f32| if share == 0.0 { a } else { a * (1.0 - share) + b * share };
        std::array::from_fn(|k| {
            let [a, b, c, d] = corners.map(|corner| corner[k]);
            mix(mix(a, b, u), mix(c, d, u), v)
        })
    }
}

impl From<Accumulation> for Texels<2> {
    fn from(picture: Accumulation) -> Texels<2> {
        let ps = |index: usize| picture.ps.get(index).copied().unwrap_or(0.0);
        let values = picture.p.iter().enumerate().map(|(index, &p)| [p, ps(index)]).collect();
        Texels { width: picture.width, height: picture.height, values }
    }
}

impl Texels<2> {
    /// As `P` and, with an attribute, `P S`.
    pub fn accumulation(&self, attribute: bool) -> Accumulation {
        let channel = |k: usize| self.values.iter().map(|value| value[k]).collect();
        let ps = if attribute { channel(1) } else { Vec::new() };
        Accumulation { width: self.width, height: self.height, p: channel(0), ps }
    }
}

impl From<Colors> for Texels<4> {
    fn from(Colors { width, height, rgba }: Colors) -> Texels<4> {
        Texels { width, height, values: rgba }
    }
}

impl From<Texels<4>> for Colors {
    fn from(Texels { width, height, values }: Texels<4>) -> Colors {
        Colors { width, height, rgba: values }
    }
}

/// Puts a panorama together from its faces, each drawn once by `draw`; `base` stands in the panorama's middle.
///
/// # Errors
/// The first of `draw`.
pub fn assemble<const N: usize, E>(
    sections: &Sections,
    base: &View,
    mut draw: impl FnMut(&View) -> Result<Texels<N>, E>,
) -> Result<Texels<N>, E> {
    let panorama = sections.panorama();
    let mut out = Texels::black(panorama.width, panorama.height);
    let width = panorama.width as usize;
    for section in 0..sections.count() {
        let mut sides = [const { None }; 6];
        for face in sections.faces(section, base) {
            sides[face.side as usize] = Some((face.corner.map(|at| at as f64), draw(&face.view)?));
        }
        let axes = sections.axes(section);
        out.values.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                if sections.owner(x, y) != section {
                    continue;
                }
                sections.samples([x, y], axes, |side, at, share| {
                    if let Some((corner, face)) = &sides[side as usize] {
                        let sample = face.at([at[0] - corner[0], at[1] - corner[1]]);
                        value.iter_mut().zip(sample).for_each(|(sum, sample)| *sum += share * sample);
                    }
                });
            }
        });
    }
    Ok(out)
}
