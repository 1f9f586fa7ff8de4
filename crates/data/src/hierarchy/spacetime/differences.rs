//! Velocities of particles from their positions at neighbouring steps, for sources that have none or lie about them.

use glam::DVec3;

/// The velocity at step `at` (0, 1 or 2) of the parabola through three positions at the times `tau`: exact for motion that is at
/// most quadratic in time, whatever the steps' spacing. Central in the middle, one-sided at the ends. `tau` in the unit of the
/// clock, ascending; world units by that unit.
pub fn difference_at(tau: [f64; 3], positions: [DVec3; 3], at: usize) -> DVec3 {
    let (first, second) = (tau[1] - tau[0], tau[2] - tau[1]);
    let slopes = [(positions[1] - positions[0]) / first, (positions[2] - positions[1]) / second];
    // The slope of a chord is the parabola's velocity in the chord's middle, and velocities change evenly.
    let change = (slopes[1] - slopes[0]) / (first + second);
    match at {
        0 => slopes[0] - first * change,
        1 => slopes[0] + first * change,
        _ => slopes[1] + second * change,
    }
}

/// The velocity from one of two positions to the other: what is left where only two steps have a particle.
pub fn chord(tau: [f64; 2], positions: [DVec3; 2]) -> DVec3 {
    (positions[1] - positions[0]) / (tau[1] - tau[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(cases(256))]

        #[test]
        fn parabolas_are_exact_for_unequal_steps(
            start in -5.0..5.0f64,
            steps in prop::array::uniform2(0.01..10.0f64),
            coefficients in prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64)),
        ) {
            let tau = [start, start + steps[0], start + steps[0] + steps[1]];
            let [r, v, half] = coefficients.map(DVec3::from);
            let positions = tau.map(|t| r + v * t + half * t * t);
            for (at, t) in tau.into_iter().enumerate() {
                let expected = v + 2.0 * half * t;
                // Rounding of positions by the shorter step.
                let rounding = 1e-13 * (1.0 + tau[2] * tau[2] + 25.0) / steps[0].min(steps[1]);
                prop_assert!((difference_at(tau, positions, at) - expected).length() < rounding, "{at}");
            }
        }

        #[test]
        fn lines_are_exact_from_two_steps(start in -5.0..5.0f64, step in 0.01..10.0f64) {
            let (r, v) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-0.5, 0.25, 2.0));
            let tau = [start, start + step];
            prop_assert!((chord(tau, tau.map(|t| r + v * t)) - v).length() < 1e-12 / step * 10.0);
        }
    }
}
