//! Second moments of clusters of particles: symmetric 3 x 3 matrices.

use glam::{DMat3, DVec3};

/// A symmetric 3 x 3 matrix: the second moments of a cluster about its centre. In the order xx, yy, zz, xy, xz, yz, world
/// units squared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Covariance(pub [f32; 6]);

/// Rounds of rotations after which a matrix is diagonal to rounding: convergence is quadratic, five suffice.
const SWEEPS: usize = 12;

impl Covariance {
    /// The same variance along every axis.
    pub fn round(variance: f32) -> Covariance {
        Covariance([variance, variance, variance, 0.0, 0.0, 0.0])
    }

    /// The matrix.
    pub fn matrix(self) -> DMat3 {
        let [xx, yy, zz, xy, xz, yz] = self.0.map(f64::from);
        DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
    }

    /// The covariance nearest to a matrix: its symmetric part, rounded.
    pub fn of(matrix: DMat3) -> Covariance {
        let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
        let halves = [0.5 * (x.y + y.x), 0.5 * (x.z + z.x), 0.5 * (y.z + z.y)];
        let [xy, xz, yz] = halves;
        Covariance([x.x, y.y, z.z, xy, xz, yz].map(|value| value as f32))
    }

    /// Sum of the variances along three axes: the mean squared distance from the centre.
    pub fn trace(self) -> f64 {
        let [xx, yy, zz, ..] = self.0.map(f64::from);
        xx + yy + zz
    }

    /// Geometric mean of the standard deviations along the principal axes: that of a ball of equal volume.
    pub fn mean_radius(self) -> f64 {
        let trace = self.trace();
        let volume = (self.matrix() * trace.recip()).determinant().max(0.0);
        (trace * volume.cbrt()).sqrt()
    }

    /// Standard deviations along the principal axes, largest first; 0 for variances that rounding left negative.
    pub fn radii(self) -> DVec3 {
        self.principal().0.max(DVec3::ZERO).map(f64::sqrt)
    }

    /// Eigenvalues, largest first, and unit eigenvectors as columns: [`principal_axes`].
    pub fn principal(self) -> (DVec3, DMat3) {
        principal_axes(self.matrix())
    }
}

/// Eigenvalues of a symmetric matrix, largest first, and unit eigenvectors as columns.
///
/// Cyclic Jacobi rotations in double precision: eigenvalues to 1e-15 of the largest. The same matrix always gives the same
/// axes: of equal eigenvalues the earlier comes first, and the largest component of each axis (the first of equals) is
/// positive. Values that are not finite give values that are not finite.
pub fn principal_axes(matrix: DMat3) -> (DVec3, DMat3) {
    let mut matrix: [[f64; 3]; 3] = matrix.to_cols_array_2d();
    let mut axes = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..SWEEPS {
        let off = matrix[0][1].abs() + matrix[0][2].abs() + matrix[1][2].abs();
        if off == 0.0 {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut matrix, &mut axes, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| matrix[b][b].total_cmp(&matrix[a][a]));
    let axis = |k: usize| {
        let axis = DVec3::from_array(axes[order[k]]);
        let largest = (1..3).fold(0, |best, k| if axis[k].abs() > axis[best].abs() { k } else { best });
        if axis[largest] < 0.0 { -axis } else { axis }
    };
    (DVec3::from_array(order.map(|k| matrix[k][k])), DMat3::from_cols(axis(0), axis(1), axis(2)))
}

/// Makes the entry `(p, q)` of a symmetric matrix zero by a rotation, which the columns of `axes` take part in.
fn rotate(matrix: &mut [[f64; 3]; 3], axes: &mut [[f64; 3]; 3], p: usize, q: usize) {
    let entry = matrix[p][q];
    // Below this it is lost in the diagonal's own rounding.
    if entry.abs() <= 1e-300 {
        (matrix[p][q], matrix[q][p]) = (0.0, 0.0);
        return;
    }
    let theta = 0.5 * (matrix[q][q] - matrix[p][p]) / entry;
    let tangent = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let cosine = 1.0 / tangent.hypot(1.0);
    let sine = tangent * cosine;
    matrix[p][p] -= tangent * entry;
    matrix[q][q] += tangent * entry;
    (matrix[p][q], matrix[q][p]) = (0.0, 0.0);
    let other = 3 - p - q;
    let (a, b) = (matrix[other][p], matrix[other][q]);
    let (a, b) = (cosine * a - sine * b, sine * a + cosine * b);
    (matrix[other][p], matrix[p][other]) = (a, a);
    (matrix[other][q], matrix[q][other]) = (b, b);
    let (a, b) = (axes[p], axes[q]);
    axes[p] = std::array::from_fn(|k| cosine * a[k] - sine * b[k]);
    axes[q] = std::array::from_fn(|k| sine * a[k] + cosine * b[k]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    #[test]
    fn round_ones_have_the_axes_of_space() {
        let (values, axes) = Covariance::round(4.0).principal();
        assert_eq!((values, axes), (DVec3::splat(4.0), DMat3::IDENTITY));
        assert_eq!(Covariance::round(4.0).radii(), DVec3::splat(2.0));
        assert_eq!(Covariance::default().principal().0, DVec3::ZERO);
    }

    #[test]
    fn values_that_are_not_finite_end() {
        for bad in [f32::NAN, f32::INFINITY] {
            for k in 0..6 {
                let mut values = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3];
                values[k] = bad;
                let (found, axes) = Covariance(values).principal();
                assert!(!found.is_finite() || !axes.is_finite(), "{values:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn principal_axes_are_those_that_the_matrix_is_made_of(
            turn in prop::array::uniform4(-1.0..1.0f64), powers in prop::array::uniform2(-9.0..0.0f64), scale in -12.0..12.0f64,
        ) {
            let turn = DQuat::from_array(turn);
            prop_assume!(turn.length() > 0.01);
            let rotation = DMat3::from_quat(turn.normalize());
            let mut values = [1.0, 10f64.powf(powers[0]), 10f64.powf(powers[1])].map(|value| value * 10f64.powf(scale));
            values.sort_by(|a, b| b.total_cmp(a));
            let values = DVec3::from_array(values);
            let covariance = Covariance::of(rotation * DMat3::from_diagonal(values) * rotation.transpose());
            let (found, axes) = covariance.principal();
            // The entries are singles.
            prop_assert!((found - values).abs().max_element() < 3e-7 * values.x, "{found} for {values}");
            prop_assert!((covariance.trace() / values.element_sum() - 1.0).abs() < 1e-6);
            prop_assert!((axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-14));
            let rebuilt = axes * DMat3::from_diagonal(found) * axes.transpose();
            prop_assert!(rebuilt.abs_diff_eq(covariance.matrix(), 1e-14 * values.x));
            for k in 0..3 {
                let axis = axes.col(k);
                prop_assert!(axis[axis.abs().max_position()] > 0.0);
            }
            prop_assert!(found.x >= found.y && found.y >= found.z);
        }
    }
}
