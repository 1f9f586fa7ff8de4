//! Shapes of clusters as codes: what is left of second moments without their size, by vector quantisation of the logarithm.
//!
//! The logarithm of a covariance matrix is a symmetric matrix whose trace is the logarithm of the volume; without the trace, five
//! coordinates are left, in which equal distances are equal ratios along some axes, whatever the size and the direction. Codes say nothing
//! of the size, so one codebook serves clusters of all depths.

use super::quantizer::{LbgLimits, Quantizer};
use crate::model::Covariance;
use glam::{DMat3, DVec3};

/// Coordinates of a shape.
pub const COORDINATES: usize = 5;
/// Coordinates are stored in these steps: ratios of variances of up to e^16, in steps of a twentieth of a percent.
const STEP: f64 = 1.0 / 2048.0;
/// A variance is at least this share of the largest: flat and thin clusters have a shape, too.
const FLATTEST: f64 = 1e-6;
/// Shapes that a codebook is trained on at most.
pub const SAMPLE: usize = 1 << 16;
/// Shapes for each entry of a codebook at least: an entry takes as much space as some codes.
const FOR_EACH: usize = 64;
const LIMITS: LbgLimits = LbgLimits { k_max: 8, epsilon: 0.01 };

/// The coordinates of a shape: what is left of the logarithm of the moments without its trace, so that squared distances are those of
/// the matrices (Frobenius).
pub type Shape = [f32; COORDINATES];

/// Separates moments (xx, yy, zz, xy, xz, yz) into size and shape: the geometric mean of the standard deviations along the principal axes,
/// and the coordinates. 0 and round where there is no positive variance.
pub fn analyse(moments: &[f64; 6]) -> (f64, Shape) {
    let scale = moments[..3].iter().copied().fold(0.0, f64::max);
    if !(scale > 0.0 && scale.is_finite()) {
        return (0.0, [0.0; COORDINATES]);
    }
    let (values, axes) = Covariance(moments.map(|value| (value / scale) as f32)).principal();
    let logarithms = values.max(DVec3::splat(FLATTEST * values.x)).map(f64::ln);
    let mean = logarithms.element_sum() / 3.0;
    let traceless = axes * DMat3::from_diagonal(logarithms - mean) * axes.transpose();
    let [xx, yy, zz] = [0, 1, 2].map(|k| traceless.col(k)[k]);
    let shape = [
        (xx - yy) * 0.5_f64.sqrt(),
        (2.0 * zz - xx - yy) / 6.0_f64.sqrt(),
        traceless.col(1).x * 2.0_f64.sqrt(),
        traceless.col(2).x * 2.0_f64.sqrt(),
        traceless.col(2).y * 2.0_f64.sqrt(),
    ];
    ((0.5 * mean).exp() * scale.sqrt(), shape.map(|value| value as f32))
}

/// The moments of a shape of size 1.
pub fn moments_of(shape: &Shape) -> [f64; 6] {
    let [a, b, xy, xz, yz] = shape.map(f64::from);
    let (a, b) = (a * 0.5_f64.sqrt(), b / 6.0_f64.sqrt());
    let half = |value: f64| (value * 0.5_f64.sqrt()) as f32;
    let logarithm = Covariance([(a - b) as f32, (-a - b) as f32, (2.0 * b) as f32, half(xy), half(xz), half(yz)]);
    let (values, axes) = logarithm.principal();
    let matrix = axes * DMat3::from_diagonal(values.map(f64::exp)) * axes.transpose();
    [matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z, matrix.y_axis.x, matrix.z_axis.x, matrix.z_axis.y]
}

/// The codebook of a family's shapes: coordinates in steps of 1/2048. Without entries all are round.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ShapeBook {
    /// Entry of each code.
    pub entries: Vec<[i16; COORDINATES]>,
}

impl ShapeBook {
    /// The coordinates of each entry.
    pub fn shapes(&self) -> impl Iterator<Item = Shape> {
        self.entries.iter().map(|entry| entry.map(|step| (f64::from(step) * STEP) as f32))
    }

    /// The moments that each code stands for at size 1; one round entry where there is no code.
    pub fn moments(&self) -> Vec<[f64; 6]> {
        if self.entries.is_empty() {
            return vec![[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]];
        }
        self.shapes().map(|shape| moments_of(&shape)).collect()
    }
}

/// What codes shapes.
pub struct ShapeCoder {
    quantizer: Quantizer<8>,
}

impl ShapeCoder {
    /// Trains codes of so many bits on some of `of` shapes.
    pub fn train(sample: &[Shape], of: u64, bits: u8) -> ShapeCoder {
        let most = (of as usize / FOR_EACH).clamp(16, 1 << bits);
        let mut sample: Vec<[f32; 8]> = sample.iter().map(widened).collect();
        ShapeCoder { quantizer: Quantizer::train(&mut sample, most, LIMITS, &|| ()) }
    }

    /// What the codes stand for.
    pub fn book(&self) -> ShapeBook {
        let step = |value: f32| (f64::from(value) / STEP).round() as i16;
        let entry = |word: &[f32; 8]| std::array::from_fn(|k| step(word[k]));
        ShapeBook { entries: self.quantizer.words().iter().map(entry).collect() }
    }

    /// The codes of shapes.
    pub fn codes(&self, shapes: &[Shape]) -> Vec<u16> {
        let vectors: Vec<[f32; 8]> = shapes.iter().map(widened).collect();
        let mut codes = vec![0; vectors.len()];
        self.quantizer.codes(&vectors, &mut codes);
        // At most 2^16 entries.
        codes.into_iter().map(|code| code as u16).collect()
    }
}

fn widened(shape: &Shape) -> [f32; 8] {
    std::array::from_fn(|k| shape.get(k).copied().unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    fn moments(turn: [f64; 4], powers: [f64; 3]) -> [f64; 6] {
        let rotation = DMat3::from_quat(DQuat::from_array(turn).normalize());
        let m = rotation * DMat3::from_diagonal(DVec3::from_array(powers).map(f64::exp)) * rotation.transpose();
        [m.x_axis.x, m.y_axis.y, m.z_axis.z, m.y_axis.x, m.z_axis.x, m.z_axis.y]
    }

    proptest! {
        #[test]
        fn size_and_shape_give_the_moments_back(
            turn in prop::array::uniform4(-1.0..1.0f64), powers in prop::array::uniform3(-8.0..0.0f64), scale in -40.0..40.0f64,
        ) {
            prop_assume!(turn.iter().map(|x| x * x).sum::<f64>() > 0.01);
            let before = moments(turn, powers.map(|power| power + scale));
            let (size, shape) = analyse(&before);
            let after = moments_of(&shape).map(|value| value * size * size);
            let largest = before[..3].iter().copied().fold(0.0, f64::max);
            for (a, b) in before.iter().zip(after) {
                prop_assert!((a - b).abs() < 2e-5 * largest, "{before:?} {after:?}");
            }
        }

        /// Codes come back within what so many of them can tell apart, and equal shapes as they were.
        #[test]
        fn codes_are_near_the_shapes(seed in prop::collection::vec(prop::array::uniform4(-1.0..1.0f64), 3)) {
            prop_assume!(seed.iter().all(|turn| turn.iter().map(|x| x * x).sum::<f64>() > 0.01));
            let shapes: Vec<Shape> =
                seed.iter().cycle().take(600).map(|turn| analyse(&moments(*turn, [0.0, -1.0, -4.0])).1).collect();
            let coder = ShapeCoder::train(&shapes, shapes.len() as u64, 8);
            let book: Vec<Shape> = coder.book().shapes().collect();
            prop_assert!(book.len() <= 3);
            for (shape, code) in shapes.iter().zip(coder.codes(&shapes)) {
                let coded = book[usize::from(code)];
                prop_assert!(shape.iter().zip(coded).all(|(a, b)| (a - b).abs() < 1e-3));
            }
        }
    }

    #[test]
    fn what_has_no_extent_is_round() {
        assert_eq!(analyse(&[0.0; 6]), (0.0, [0.0; COORDINATES]));
        let (size, shape) = analyse(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(size > 0.0 && shape.iter().all(|x| x.is_finite()));
        assert_eq!(ShapeBook::default().moments(), [[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]]);
    }
}
