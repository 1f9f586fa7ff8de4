//! Occlusion (F12 5.7.2): a pyramid of flags, each set where every pixel below it is opaque already. What lies behind
//! such pixels needs no resampling and no drawing; [`super::behind`] tells what needs no reading.

/// Which pixels are opaque, at ever coarser levels; level 0 is the picture, and each further one halves it, rounded up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpacityPyramid {
    levels: Vec<Level>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Level {
    width: usize,
    height: usize,
    opaque: Vec<bool>,
}

impl OpacityPyramid {
    /// The pyramid of `width * height` flags, row by row; missing ones count as not opaque.
    pub fn new(width: usize, height: usize, mut opaque: Vec<bool>) -> OpacityPyramid {
        opaque.resize(width * height, false);
        let mut levels = vec![Level { width, height, opaque }];
        while let Some(fine) = levels.last().filter(|level| level.width > 1 || level.height > 1) {
            let (width, height) = (fine.width.div_ceil(2), fine.height.div_ceil(2));
            // Pixels beyond the edge hide nothing and show nothing.
            let at = |x: usize, y: usize| x >= fine.width || y >= fine.height || fine.opaque[y * fine.width + x];
            let all = |x: usize, y: usize| (0..4).all(|k| at(2 * x + k % 2, 2 * y + k / 2));
            let opaque = (0..width * height).map(|index| all(index % width, index / width)).collect();
            levels.push(Level { width, height, opaque });
        }
        OpacityPyramid { levels }
    }

    /// Share of the pixels that are opaque.
    pub fn share(&self) -> f64 {
        let pixels = &self.levels[0].opaque;
        pixels.iter().filter(|opaque| **opaque).count() as f64 / pixels.len().max(1) as f64
    }

    /// Whether all pixels of columns `x[0]..=x[1]` and rows `y[0]..=y[1]` are opaque, as far as they are in the picture; looks
    /// at the level where these are four by four flags or fewer, so may be false where each pixel would say true.
    pub fn hides(&self, x: [i64; 2], y: [i64; 2]) -> bool {
        let size = [self.levels[0].width as i64, self.levels[0].height as i64];
        let clip = |[from, to]: [i64; 2], size: i64| [from.max(0), to.min(size - 1)];
        let ([left, right], [top, bottom]) = (clip(x, size[0]), clip(y, size[1]));
        if left > right || top > bottom {
            return true;
        }
        let shift = (0..self.levels.len() - 1)
            .find(|shift| (right >> shift) - (left >> shift) < 4 && (bottom >> shift) - (top >> shift) < 4);
        let shift = shift.unwrap_or(self.levels.len() - 1);
        let level = &self.levels[shift];
        let columns = (left >> shift) as usize..=(right >> shift) as usize;
        let mut rows = (top >> shift) as usize..=(bottom >> shift) as usize;
        rows.all(|y| columns.clone().all(|x| level.opaque[y * level.width + x]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Never hides a pixel that is not opaque, and sees an opaque quarter.
        #[test]
        fn hides_only_what_is_behind_opaque_pixels(
            width in 1usize..40, height in 1usize..40, seed in prop::collection::vec(0u8..9, 1600),
            x in -5i64..45, y in -5i64..45, w in 0i64..20, h in 0i64..20,
        ) {
            let flags: Vec<bool> = (0..width * height).map(|i| seed[i] > 0).collect();
            let pyramid = OpacityPyramid::new(width, height, flags.clone());
            let inside = |x: i64, y: i64| (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
            let all = (y..=y + h).all(|y| (x..=x + w).all(|x| !inside(x, y) || flags[y as usize * width + x as usize]));
            if pyramid.hides([x, x + w], [y, y + h]) {
                prop_assert!(all);
            }
            let opaque = OpacityPyramid::new(width, height, vec![true; width * height]);
            prop_assert!(opaque.hides([x, x + w], [y, y + h]) && opaque.share() == 1.0);
            if w == 0 && h == 0 {
                prop_assert_eq!(pyramid.hides([x, x], [y, y]), all);
            }
        }
    }
}
