//! Sums over a photo's pixels, which the texels of coarser levels are means of.
//!
//! Means are of light, over what of a texel lies on T: what nobody sees near by adds nothing from afar. Where nothing of it does, they are over
//! all of it.

use super::PhotoLattice;
use crate::hierarchy::chunks::light;

/// A texel: red, green, blue as pictures have them, and the share of it that lies on T, from 0 to 255.
pub type Texel = [u8; 4];

/// What a pixel on T weighs, where one beside it weighs 1.
const ON_T: f64 = 65536.0;

/// Sums over the pixels of a texel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightSum {
    /// Light of red, green and blue, weighted.
    light: [f64; 3],
    /// Shares of pixels that lie on T, in 255ths.
    share: f64,
}

impl LightSum {
    /// Of a texel that stands for so many pixels.
    pub fn of([red, green, blue, share]: Texel, pixels: u64) -> LightSum {
        let share = pixels as f64 * f64::from(share);
        let weight = weight(pixels as f64, share);
        let light = [red, green, blue].map(|value| weight * f64::from(light::table()[usize::from(value)]));
        LightSum { light, share }
    }

    fn add(&mut self, other: &LightSum) {
        self.light.iter_mut().zip(other.light).for_each(|(own, other)| *own += other);
        self.share += other.share;
    }

    /// The texel of so many pixels.
    pub fn texel(&self, pixels: u64) -> Texel {
        let pixels = pixels as f64;
        let weight = weight(pixels, self.share);
        let [red, green, blue] = self.light.map(|light| light::value(light / weight));
        [red, green, blue, self.coverage(pixels)]
    }

    /// 0 and 255 are nothing and all.
    fn coverage(&self, pixels: f64) -> u8 {
        let share = self.share / pixels;
        match share {
            0.0 => 0,
            255.0 => 255,
            some => some.round().clamp(1.0, 254.0) as u8,
        }
    }
}

fn weight(pixels: f64, share: f64) -> f64 {
    (ON_T / 255.0).mul_add(share, pixels)
}

/// Sums of a row of texels from those of the two rows below it, or from the last one alone.
pub fn joined(upper: &[LightSum], lower: Option<&[LightSum]>) -> Vec<LightSum> {
    let pair = |row: &[LightSum], out: &mut LightSum| row.iter().for_each(|sum| out.add(sum));
    let mut out = vec![LightSum::default(); upper.len().div_ceil(2)];
    for row in [Some(upper), lower].into_iter().flatten() {
        row.chunks(2).zip(&mut out).for_each(|(some, out)| pair(some, out));
    }
    out
}

/// The texels of a row of a level.
pub fn texels(lattice: &PhotoLattice, level: u32, row: u64, sums: &[LightSum]) -> Vec<Texel> {
    let texel = |(column, sum): (usize, &LightSum)| sum.texel(lattice.pixels_of(level, [row, column as u64]));
    sums.iter().enumerate().map(texel).collect()
}

/// The levels above one that is held whole, down to a single texel: each one's rows and columns, and its texels row by row.
pub fn above(lattice: &PhotoLattice, level: u32, texels: &[Texel]) -> Vec<([usize; 2], Vec<Texel>)> {
    let size_of = |level: u32| lattice.size_of(level).map(|count| count as usize);
    let row = |(row, texels): (usize, &[Texel])| -> Vec<LightSum> {
        let sum = |(column, texel): (usize, &Texel)| {
            LightSum::of(*texel, lattice.pixels_of(level, [row as u64, column as u64]))
        };
        texels.iter().enumerate().map(sum).collect()
    };
    let mut sums: Vec<Vec<LightSum>> = texels.chunks_exact(size_of(level)[1].max(1)).enumerate().map(row).collect();
    let mut out = Vec::new();
    for level in level + 1.. {
        if sums.len() <= 1 && sums.first().is_none_or(|row| row.len() <= 1) {
            break;
        }
        sums = sums.chunks(2).map(|pair| joined(&pair[0], pair.get(1).map(Vec::as_slice))).collect();
        let rows = sums.iter().enumerate();
        out.push((
            size_of(level),
            rows.flat_map(|(row, sums)| self::texels(lattice, level, row as u64, sums)).collect(),
        ));
    }
    out
}
