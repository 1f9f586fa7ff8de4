//! How often each pixel is drawn over (F12 figure 4.10): the number of splats whose bounding rectangle overlaps it, as many
//! fragments as quads would have there.
//!
//! What the renderers themselves evaluate is less, since large splats go into coarse levels of the pyramid; the number of
//! splats at a pixel is what the data asks of any renderer.

use super::footprint::{Footprint, Lens};
use super::{SplatOptions, Splats};
use crate::color::composite::Image;
use crate::view::View;
use rayon::prelude::*;

/// Splats over each pixel, row 0 at the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Overdraw {
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// `width * height` numbers.
    pub counts: Vec<u32>,
}

/// Overdraw that is magenta.
const MAGENTA: f64 = 500.0;
/// Overdraw that is red, and so is more.
const RED: f64 = 3000.0;

/// The numbers' differences along x and y, one more along either side than the picture has pixels: a rectangle changes four of them,
/// whatever its size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Differences {
    size: [u32; 2],
    values: Vec<i32>,
}

impl Differences {
    /// Those of a picture without splats.
    pub fn none(width: u32, height: u32) -> Differences {
        Differences { size: [width, height], values: vec![0; Differences::count(width, height)] }
    }

    /// Those that somebody else has found, row by row; what is missing at the end are zeros.
    pub fn found(width: u32, height: u32, mut values: Vec<i32>) -> Differences {
        values.resize(Differences::count(width, height), 0);
        Differences { size: [width, height], values }
    }

    /// How many there are of a picture.
    pub fn count(width: u32, height: u32) -> usize {
        (width as usize + 1) * (height as usize + 1)
    }

    /// Adds a splat that reaches into the picture.
    fn add(&mut self, footprint: &Footprint) {
        let [width, height] = self.size.map(|size| size as usize);
        // Casts saturate, so that infinite ends become those of the picture.
        let [x, y] = [(0, width), (1, height)].map(|(k, size)| {
            let first = footprint.min[k].floor() as usize;
            (first, (footprint.max[k].ceil() as usize).clamp(first, size))
        });
        let stride = width + 1;
        self.values[y.0 * stride + x.0] += 1;
        self.values[y.0 * stride + x.1] -= 1;
        self.values[y.1 * stride + x.0] -= 1;
        self.values[y.1 * stride + x.1] += 1;
    }

    /// Sums them up.
    pub fn sum(&self) -> Overdraw {
        let [width, height] = self.size;
        let mut counts = Vec::with_capacity(self.values.len());
        let mut above = vec![0i32; width as usize];
        for row in self.values.chunks_exact(width as usize + 1).take(height as usize) {
            let mut sum = 0;
            for (above, &difference) in above.iter_mut().zip(row) {
                sum += difference;
                *above += sum;
                counts.push(above.unsigned_abs());
            }
        }
        Overdraw { width, height, counts }
    }
}

/// Counts the splats of all batches that [`super::draw`] would draw, without those that weigh nothing.
pub fn overdraw(view: &View, batches: &[Splats<'_>], options: &SplatOptions) -> Overdraw {
    let lens = Lens::new(view);
    let empty = || Differences::none(view.width, view.height);
    let chunks = batches.iter().flat_map(|batch| (0..batch.len()).step_by(1 << 16).map(move |start| (batch, start)));
    let chunks: Vec<_> = chunks.collect();
    let differences = chunks
        .into_par_iter()
        .fold(empty, |mut differences, (batch, start)| {
            for index in start..batch.len().min(start + (1 << 16)) {
                let Some(footprint) =
                    lens.footprint(batch, index, options.kernel).filter(|footprint| lens.sees(footprint, 0.0))
                else {
                    continue;
                };
                if options.faintest > 0.0 && lens.presence(&footprint, options.kernel) < f64::from(options.faintest) {
                    continue;
                }
                if footprint.amplitude != 0.0 {
                    differences.add(&footprint);
                }
            }
            differences
        })
        .reduce(empty, |mut sum, other| {
            sum.values.iter_mut().zip(other.values).for_each(|(sum, value)| *sum += value);
            sum
        });
    differences.sum()
}

impl Overdraw {
    /// Mean over all pixels.
    pub fn mean(&self) -> f64 {
        self.counts.iter().map(|&count| f64::from(count)).sum::<f64>() / self.counts.len().max(1) as f64
    }

    /// The largest number.
    pub fn max(&self) -> u32 {
        self.counts.iter().copied().max().unwrap_or(0)
    }

    /// The figure's colours: black for none, brighter up to magenta at 500, then through all hues to red at 3000.
    pub fn image(&self) -> Image {
        Image { width: self.width, height: self.height, rgba: self.counts.iter().map(|&count| color(count)).collect() }
    }
}

fn color(count: u32) -> [u8; 4] {
    let count = f64::from(count);
    let value = (count / MAGENTA).min(1.0);
    // From magenta (five sixths of the circle) down to red (zero).
    let hue = 5.0 * (1.0 - ((count - MAGENTA) / (RED - MAGENTA)).clamp(0.0, 1.0));
    let channel = |shift: f64| {
        let distance = ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
        (255.0 * value * distance.clamp(0.0, 1.0)).round() as u8
    };
    [channel(0.0), channel(4.0), channel(2.0), 255]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::{Extent, Positions};
    use crate::model::Kernel;
    use crate::view::Projection;
    use glam::DVec3;

    #[test]
    fn counts_are_those_of_brute_force() {
        let positions: Vec<[f64; 3]> =
            (0..300).map(|i| [7, 11, 13].map(|step| f64::from(i * step % 101) / 50.0 - 1.0)).collect();
        let h: Vec<f32> = (0..300).map(|i| 0.002 * 1.02f32.powi(i)).collect();
        // Some weigh nothing: they are no splats.
        let weight: Vec<f32> = (0..300).map(|i| if i % 7 == 0 { 0.0 } else { 1.0 }).collect();
        let splats = Splats::new(Positions::World(&positions), Extent::World(&h), &weight, None).unwrap();
        for projection in [Projection::Orthographic { height: 1.7 }, Projection::Perspective { fov_y: 0.9 }] {
            let eye = DVec3::new(0.2, 0.1, 1.4);
            let view = View::look_at(eye, DVec3::ZERO, DVec3::Y, projection, 61, 47).unwrap();
            let found = overdraw(&view, &[splats, splats], &SplatOptions::default());
            let lens = Lens::new(&view);
            for (index, &count) in found.counts.iter().enumerate() {
                let [x, y] = [index % 61, index / 61].map(|pixel| pixel as f64);
                let over = (0..300)
                    .filter(|i| i % 7 != 0)
                    .filter_map(|i| lens.footprint(&splats, i, Kernel::default()))
                    .filter(|f| f.min[0] < x + 1.0 && f.max[0] > x && f.min[1] < y + 1.0 && f.max[1] > y);
                assert_eq!(count as usize, 2 * over.count(), "{x} {y}");
            }
            assert!(found.max() > 20 && found.mean() > 1.0);
        }
    }

    #[test]
    fn colors_are_those_of_the_figure() {
        assert_eq!(color(0), [0, 0, 0, 255]);
        assert_eq!(color(250), [128, 0, 128, 255]);
        assert_eq!(color(500), [255, 0, 255, 255]);
        assert_eq!(color(1000), [0, 0, 255, 255]);
        assert_eq!(color(2000), [0, 255, 0, 255]);
        assert_eq!(color(3000), [255, 0, 0, 255]);
        assert_eq!(color(9000), [255, 0, 0, 255]);
    }
}
