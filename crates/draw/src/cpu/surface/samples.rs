//! What is kept of a chunk's samples: heights in as few bytes as hold them exactly, and mean normals.

use std::ops::Range;

/// Heights, row by row; NaN where there is none.
#[derive(Clone, Debug, PartialEq)]
pub enum SampleHeights {
    /// All of them are whole numbers of 16 bits.
    Short(Vec<i16>),
    /// All of them are numbers of single precision.
    Single(Vec<f32>),
    /// Some need more.
    Double(Vec<f64>),
}

impl Default for SampleHeights {
    fn default() -> SampleHeights {
        SampleHeights::Single(Vec::new())
    }
}

impl SampleHeights {
    /// Keeps heights without loss.
    pub fn of(heights: Vec<f64>) -> SampleHeights {
        if are_all(&heights, |height| f64::from(height as i16).to_bits() == height.to_bits()) {
            return SampleHeights::Short(heights.iter().map(|height| *height as i16).collect());
        }
        match are_all(&heights, |height| (f64::from(height as f32) == height) | height.is_nan()) {
            true => SampleHeights::Single(heights.iter().map(|height| *height as f32).collect()),
            false => SampleHeights::Double(heights),
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            SampleHeights::Short(heights) => heights.len(),
            SampleHeights::Single(heights) => heights.len(),
            SampleHeights::Double(heights) => heights.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A height.
    #[inline(always)]
    pub fn at(&self, index: usize) -> f64 {
        match self {
            SampleHeights::Short(heights) => heights[index].into(),
            SampleHeights::Single(heights) => heights[index].into(),
            SampleHeights::Double(heights) => heights[index],
        }
    }

    /// The heights at the corners of a cell, of which the first in either row is told.
    #[inline(always)]
    pub fn corners(&self, first: usize, next: usize) -> [f64; 4] {
        match self {
            SampleHeights::Short(heights) => {
                [heights[first].into(), heights[first + 1].into(), heights[next].into(), heights[next + 1].into()]
            }
            SampleHeights::Single(heights) => {
                [heights[first].into(), heights[first + 1].into(), heights[next].into(), heights[next + 1].into()]
            }
            SampleHeights::Double(heights) => [heights[first], heights[first + 1], heights[next], heights[next + 1]],
        }
    }

    /// A height; `None` beyond the last.
    #[inline]
    pub fn get(&self, index: usize) -> Option<f64> {
        (index < self.len()).then(|| self.at(index))
    }

    /// Takes out a height.
    pub(super) fn open(&mut self, index: usize) {
        match self {
            SampleHeights::Short(heights) => {
                let mut singles: Vec<f32> = heights.iter().map(|height| f32::from(*height)).collect();
                singles[index] = f32::NAN;
                *self = SampleHeights::Single(singles);
            }
            SampleHeights::Single(heights) => heights[index] = f32::NAN,
            SampleHeights::Double(heights) => heights[index] = f64::NAN,
        }
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = f64> + Clone + '_ {
        (0..self.len()).map(|index| self.at(index))
    }

    /// Copies some.
    pub fn copy(&self, part: Range<usize>, out: &mut [f64]) {
        match self {
            SampleHeights::Short(heights) => {
                out.iter_mut().zip(&heights[part]).for_each(|(out, height)| *out = f64::from(*height));
            }
            SampleHeights::Single(heights) => {
                out.iter_mut().zip(&heights[part]).for_each(|(out, height)| *out = f64::from(*height));
            }
            SampleHeights::Double(heights) => out.copy_from_slice(&heights[part]),
        }
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        match self {
            SampleHeights::Short(heights) => size_of_val(heights.as_slice()),
            SampleHeights::Single(heights) => size_of_val(heights.as_slice()),
            SampleHeights::Double(heights) => size_of_val(heights.as_slice()),
        }
    }
}

/// Whether all heights are something. What is not is found out at once, mostly.
#[inline]
fn are_all(heights: &[f64], is_such: impl Fn(f64) -> bool) -> bool {
    heights.chunks(64).all(|some| some.iter().fold(true, |are_all, height| are_all & is_such(*height)))
}

/// Means of unit normals, row by row.
#[derive(Clone, Debug, PartialEq)]
pub enum SampleNormals {
    /// So many that point up.
    Up(usize),
    /// All of them.
    Parts(Vec<MeanNormal>),
}

impl Default for SampleNormals {
    fn default() -> SampleNormals {
        SampleNormals::Up(0)
    }
}

impl SampleNormals {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            SampleNormals::Up(count) => *count,
            SampleNormals::Parts(normals) => normals.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A mean normal.
    #[inline(always)]
    pub fn at(&self, index: usize) -> [f32; 3] {
        match self {
            SampleNormals::Up(_) => [0.0, 0.0, 1.0],
            SampleNormals::Parts(normals) => normals[index].vector(),
        }
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = [f32; 3]> + Clone + '_ {
        (0..self.len()).map(|index| self.at(index))
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        match self {
            SampleNormals::Up(_) => 0,
            SampleNormals::Parts(normals) => size_of_val(normals.as_slice()),
        }
    }
}

/// The mean of unit normals, of which `z` points up, in parts of 1/32767.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeanNormal([i16; 3]);

/// Parts of 1.
const PARTS: f32 = 32767.0;

impl MeanNormal {
    /// Of a vector that is at most a unit long.
    #[inline(always)]
    pub fn new(normal: [f32; 3]) -> MeanNormal {
        // Rounded to the nearest.
        let rounded = |part: f32| (part * PARTS + if part < 0.0 { -0.5 } else { 0.5 }) as i16;
        MeanNormal([rounded(normal[0]), rounded(normal[1]), rounded(normal[2])])
    }

    /// The vector.
    #[inline(always)]
    pub fn vector(self) -> [f32; 3] {
        let part = |part: i16| f32::from(part) * (1.0 / PARTS);
        [part(self.0[0]), part(self.0[1]), part(self.0[2])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_come_back_to_the_bit() {
        for heights in [
            vec![1.5, -0.0, f64::NAN, 65535.0],
            vec![0.1, f64::NAN, 1e300],
            vec![-32768.0, 0.0, 32767.0],
            vec![1.0, -0.0],
            Vec::new(),
        ] {
            let kept = SampleHeights::of(heights.clone());
            let mut copied = vec![0.0; heights.len()];
            kept.copy(0..heights.len(), &mut copied);
            for (index, height) in heights.iter().enumerate() {
                assert!(kept.at(index).to_bits() == height.to_bits() || height.is_nan() && kept.at(index).is_nan());
                assert!(copied[index].to_bits() == kept.at(index).to_bits());
            }
            if heights.len() == 4 {
                assert_eq!(kept.corners(0, 2).map(f64::to_bits), [0, 1, 2, 3].map(|index| kept.at(index).to_bits()));
            }
        }
    }

    #[test]
    fn normals_are_within_a_part() {
        for normal in [[0.0, 0.0, 1.0], [-1.0, 0.3, 0.0], [0.123_45, -0.77, 0.5]] {
            let found = MeanNormal::new(normal).vector();
            assert!((0..3).all(|k| (found[k] - normal[k]).abs() < 1.6e-5), "{normal:?} {found:?}");
        }
    }
}
