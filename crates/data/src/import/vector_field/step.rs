//! One step of the embedded pair of Runge-Kutta methods of orders 5 and 4 by Dormand and Prince (1980, A family of embedded
//! Runge-Kutta formulae, table 2).

/// When stages are, in steps.
const NODES: [f64; 5] = [1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0];
/// What each stage takes of those before it.
const STAGES: [[f64; 5]; 5] = [
    [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
];
/// What the step of order 5 takes.
const FIFTH: [f64; 6] = [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0];
/// By how much that differs from the one of order 4, whose last stage is at the end of the step.
const DIFFERENCE: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];

/// Where a step leads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stepped {
    /// The place at its end.
    pub to: [f64; 3],
    /// The velocity there.
    pub rate: [f64; 3],
    /// How far apart both orders end; NaN where rates are no numbers.
    pub error: f64,
}

/// The step from `from` at time `at` over `length`; `first` is the velocity `rate` there.
pub(super) fn step(
    rate: impl Fn([f64; 3], f64) -> [f64; 3],
    from: [f64; 3],
    first: [f64; 3],
    at: f64,
    length: f64,
) -> Stepped {
    let mut rates = [[0.0; 3]; 7];
    rates[0] = first;
    let moved = |shares: &[f64], rates: &[[f64; 3]; 7]| -> [f64; 3] {
        std::array::from_fn(|axis| {
            from[axis] + length * shares.iter().zip(rates).map(|(share, rate)| share * rate[axis]).sum::<f64>()
        })
    };
    for (number, (shares, node)) in STAGES.iter().zip(NODES).enumerate() {
        rates[number + 1] = rate(moved(&shares[..=number], &rates), at + node * length);
    }
    let to = moved(&FIFTH, &rates);
    rates[6] = rate(to, at + length);
    let apart =
        |axis: usize| length * DIFFERENCE.iter().zip(&rates).map(|(share, rate)| share * rate[axis]).sum::<f64>();
    let error = (0..3).map(|axis| apart(axis).powi(2)).sum::<f64>().sqrt();
    Stepped { to, rate: rates[6], error }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error at the end of an arc with steps of a length, and the largest that was told of one.
    fn error(length: f64) -> (f64, f64) {
        let rate = |[x, y, _]: [f64; 3], t: f64| [-y, x, t.cos()];
        let (mut at, mut now, mut told) = ([1.0, 0.0, 0.0], 0.0, 0.0_f64);
        while now < 1.0 - 1e-9 {
            let stepped = step(rate, at, rate(at, now), now, length);
            (at, told) = (stepped.to, told.max(stepped.error));
            now += length;
        }
        let truth = [1.0_f64.cos(), 1.0_f64.sin(), 1.0_f64.sin()];
        ((0..3).map(|axis| (at[axis] - truth[axis]).abs()).fold(0.0, f64::max), told)
    }

    #[test]
    fn errors_fall_with_the_fifth_power_of_steps() {
        let (coarse, fine) = (error(0.1), error(0.05));
        assert!((28.0..40.0).contains(&(coarse.0 / fine.0)), "{coarse:?} {fine:?}");
        // What is told of a step falls as that of order 4 does, which is a power more than that of all of them.
        assert!((28.0..40.0).contains(&(coarse.1 / fine.1)), "{coarse:?} {fine:?}");
        assert!(coarse.0 < coarse.1 * 10.0);
    }

    #[test]
    fn what_is_no_number_is_no_small_error() {
        let rate = |_: [f64; 3], t: f64| [0.0, if t > 0.05 { f64::NAN } else { 1.0 }, 0.0];
        assert!(step(rate, [0.0; 3], [0.0, 1.0, 0.0], 0.0, 0.1).error.is_nan());
    }
}
