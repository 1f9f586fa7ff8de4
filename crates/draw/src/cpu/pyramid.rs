//! The image pyramid: a splat's cost does not grow with its size.
//!
//! A splat of radius `R` pixels is drawn into the level `l` whose cells are `2^l` pixels wide and where its radius is
//! between [`SMALLEST_RADIUS`] and twice that many cells. Levels hold samples at cell centres. The finished levels are
//! added up from coarse to fine: each is interpolated at the centres of the next finer cells by [`UPSAMPLE`], separable,
//! eight taps. At level 0, [`super::AREA_FILTER`] turns samples into means over the pixels.
//!
//! Nothing of the sum is lost: samples of a kernel that is smooth on the grid add up to its integral (1e-6 at radius 6
//! cells), and both filters have unit gain. For a single splat the worst relative error, at radius 6 cells on a coarse
//! level, is 1.4e-3 (L1) and 8e-4 (L2); it falls with the sixth power of the radius, to 4e-4 and 3e-4 at 8 cells. Of other kernels it is
//! as large, but of Wendland's C6, the narrowest for its support, 3e-3 and 2e-3 at 6 cells and 4e-4 and 2e-4 at 8.
//!
//! [`UPSAMPLE`] is the least-squares solution for the spectra of the cubic spline with radii of 6 to 12 cells, under
//! the conditions that constants and linear ramps are reproduced exactly.

use rayon::prelude::*;

/// Radius `r0`, in cells, from which on splats are sampled: a splat belongs to the level where its radius lies in
/// `[r0, 2 r0)`. Smaller ones are drawn into level 0 as exact area means.
pub const SMALLEST_RADIUS: f64 = 6.0;

/// Weights of the eight coarse cells around a fine cell's centre, for the finer cell on the left (or upper) side of its
/// parent: the parent is tap 4. For the other side in reverse order, the parent being tap 3.
pub const UPSAMPLE: [f32; 8] =
    [-0.003_667_78, 0.023_050_22, -0.082_693_71, 0.284_485_5, 0.877_222_3, -0.125_266_55, 0.031_765_91, -0.004_895_88];

/// Cells beyond the picture's edge on each side of each level, so that the filters have their support there too.
pub const PADDING: usize = 12;

/// Level of a splat of `radius` pixels, at least [`SMALLEST_RADIUS`]; not above `coarsest`.
pub fn level_of(radius: f64, coarsest: usize) -> usize {
    let ratio = (radius / SMALLEST_RADIUS) as f32;
    // The exponent is the logarithm's floor.
    let exponent = (ratio.to_bits() >> 23) as usize;
    exponent.saturating_sub(127).min(coarsest)
}

/// The coarsest level of a picture: where the larger side is a few cells long.
pub fn coarsest_level(width: u32, height: u32) -> usize {
    level_of(f64::from(width.max(height)).max(SMALLEST_RADIUS), 31)
}

/// Cells along a side of `pixels` at a level, without padding.
pub fn cells_of(pixels: u32, level: usize) -> usize {
    (pixels as usize).div_ceil(1 << level)
}

/// One channel of one level: rows of samples, with [`PADDING`] on every side.
#[derive(Clone, Debug)]
pub struct LevelImage {
    /// Cells in a row, padding included.
    pub stride: usize,
    /// Samples, row by row.
    pub samples: Vec<f32>,
}

/// Adds the coarse level, interpolated, to the next finer one.
pub fn add_upsampled(coarse: &LevelImage, fine: &mut LevelImage) {
    // Along x first: the coarse rows at the fine columns.
    let stride = fine.stride;
    let mut wide = vec![0.0f32; coarse.samples.len() / coarse.stride * stride];
    wide.par_chunks_mut(stride).zip(coarse.samples.par_chunks(coarse.stride)).for_each(|(wide, row)| widen(row, wide));
    fine.samples.par_chunks_mut(stride).enumerate().for_each(|(j, out)| {
        let (first, taps) = support(j);
        let inputs: [&[f32]; 8] = std::array::from_fn(|k| {
            let row = first + k;
            &wide[row * stride..(row + 1) * stride]
        });
        for i in 0..stride {
            let mut sum = 0.0;
            for k in 0..8 {
                sum += taps[k] * inputs[k][i];
            }
            out[i] += sum;
        }
    });
}

/// First coarse index (padding included) and taps for a fine index (padding included).
fn support(fine: usize) -> (usize, [f32; 8]) {
    // Fine cell `fine - PADDING` has the parent `floor((fine - PADDING) / 2)`, at `+ PADDING` in the coarse row.
    const { assert!(PADDING.is_multiple_of(2) && PADDING >= 8) };
    let parent = fine / 2 + PADDING / 2;
    if fine.is_multiple_of(2) {
        (parent - 4, UPSAMPLE)
    } else {
        let mut taps = UPSAMPLE;
        taps.reverse();
        (parent - 3, taps)
    }
}

/// Interpolates a coarse row at the fine columns.
fn widen(coarse: &[f32], fine: &mut [f32]) {
    let mut mirrored = UPSAMPLE;
    mirrored.reverse();
    let convolve = |taps: &[f32; 8], window: &[f32]| taps.iter().zip(window).map(|(t, v)| t * v).sum::<f32>();
    for (half, pair) in fine.chunks_mut(2).enumerate() {
        let parent = half + PADDING / 2;
        let Some(window) = coarse.get(parent - 4..parent + 5) else { break };
        pair[0] = convolve(&UPSAMPLE, &window[..8]);
        if let Some(odd) = pair.get_mut(1) {
            *odd = convolve(&mirrored, &window[1..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_keep_radii_within_an_octave() {
        for i in 0..2000 {
            let radius = SMALLEST_RADIUS * 1.01f64.powi(i).min(1e6);
            let scaled = radius / f64::from(1u32 << level_of(radius, 31));
            assert!((SMALLEST_RADIUS * 0.999_999..2.0 * SMALLEST_RADIUS).contains(&scaled), "{radius}: {scaled}");
        }
        assert_eq!(level_of(1e30, 7), 7);
        assert_eq!(level_of(f64::INFINITY, 7), 7);
    }

    #[test]
    fn upsampling_reproduces_ramps_and_conserves() {
        let (coarse_cells, fine_cells) = (23, 45);
        let stride = coarse_cells + 2 * PADDING;
        let ramp = |i: usize| (i as f32 - PADDING as f32 + 0.5) * 2.0;
        let samples = (0..stride * stride).map(|k| 3.0 + ramp(k % stride) - 0.5 * ramp(k / stride)).collect();
        let coarse = LevelImage { stride, samples };
        let fine_stride = fine_cells + 2 * PADDING;
        let mut fine = LevelImage { stride: fine_stride, samples: vec![0.0; fine_stride * fine_stride] };
        add_upsampled(&coarse, &mut fine);
        let center = |i: usize| i as f32 - PADDING as f32 + 0.5;
        for j in 4..fine_stride - 4 {
            for i in 4..fine_stride - 4 {
                let expected = 3.0 + center(i) - 0.5 * center(j);
                assert!((fine.samples[j * fine_stride + i] - expected).abs() < 1e-3, "{i} {j}");
            }
        }
        let mut peak = LevelImage { stride, samples: vec![0.0; stride * stride] };
        peak.samples[stride * (stride / 2) + stride / 2] = 1.0;
        let mut spread = LevelImage { stride: fine_stride, samples: vec![0.0; fine_stride * fine_stride] };
        add_upsampled(&peak, &mut spread);
        assert!((spread.samples.iter().sum::<f32>() - 4.0).abs() < 1e-5);
    }
}
