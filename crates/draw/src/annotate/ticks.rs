//! Round values along an axis.

use super::number;

/// A mark along an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Where it is: 0 at the beginning, 1 at the end.
    pub place: f64,
    /// The value there.
    pub value: f64,
    /// What is written beside it; minor ticks have nothing.
    pub label: Option<String>,
}

/// Ticks of an axis; none for a range that is not one.
pub fn ticks(range: [f64; 2], log: bool) -> Vec<Tick> {
    let [low, high] = range;
    if !(high > low && low.is_finite() && high.is_finite() && (high - low).is_finite()) || (log && low <= 0.0) {
        return Vec::new();
    }
    if log { log_ticks(low, high) } else { linear_ticks(low, high) }
}

/// A tick at each power of ten, labels as dense as is legible, minor ticks at 2 to 9 over a few decades.
fn log_ticks(low: f64, high: f64) -> Vec<Tick> {
    let (a, b) = (low.log10(), high.log10());
    let decades = b - a;
    if decades < 1.2 {
        // Powers of ten alone would leave an axis of one decade bare.
        let place = |value: f64| (value.log10() - a) / decades;
        return linear_ticks(low, high).into_iter().map(|tick| Tick { place: place(tick.value), ..tick }).collect();
    }
    let every = (decades / 6.0).ceil().max(1.0) as i32;
    let mut ticks = Vec::new();
    for exponent in a.floor() as i32..=b.ceil() as i32 {
        let value = 10f64.powi(exponent);
        let place = (f64::from(exponent) - a) / decades;
        if (-1e-9..=1.0 + 1e-9).contains(&place) {
            let label = (exponent.rem_euclid(every) == 0).then(|| number::power_of_ten(exponent));
            ticks.push(Tick { place, value, label });
        }
        if decades <= 5.0 {
            for factor in 2..10 {
                let place = (f64::from(exponent) + f64::from(factor).log10() - a) / decades;
                if (0.0..=1.0).contains(&place) {
                    // One power of ten alone would not say where the others are.
                    let labelled = decades < 2.2 && (factor == 2 || factor == 5);
                    let value = f64::from(factor) * value;
                    ticks.push(Tick { place, value, label: labelled.then(|| number::quantity(value)) });
                }
            }
        }
    }
    ticks
}

/// Round values between `low` and `high`, about five.
fn linear_ticks(low: f64, high: f64) -> Vec<Tick> {
    let raw = (high - low) / 5.0;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|f| f * power).into_iter().find(|s| *s >= raw * 0.999).unwrap_or(10.0 * power);
    let first = (low / step - 1e-9).ceil();
    let last = (high / step + 1e-9).floor();
    let largest = low.abs().max(high.abs());
    // Steps that a number of 53 bits cannot tell apart have no labels that could.
    if step.is_nan() || step <= 1e-13 * largest {
        return Vec::new();
    }
    (0..=20)
        .map(|i| first + f64::from(i))
        .take_while(|index| *index <= last)
        .map(|index| {
            let value = index * step;
            let label = Some(number::stepped(value, step, largest));
            Tick { place: (value - low) / (high - low), value, label }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn log_ticks_are_labelled_powers_of_ten() {
        let ticks = ticks([1e-5, 1e2], true);
        let labels: Vec<&str> = ticks.iter().filter_map(|tick| tick.label.as_deref()).collect();
        assert!(labels.contains(&"10¯⁴") && labels.contains(&"1"), "{labels:?}");
        assert!((2..=8).contains(&labels.len()));
        assert!(ticks.iter().all(|tick| (-1e-6..=1.0 + 1e-6).contains(&tick.place)));
    }

    #[test]
    fn every_range_gets_a_few_labels() {
        for (range, log) in [
            ([0.0, 1.0], false),
            ([-250.0, 1200.0], false),
            ([3.1, 3.2], false),
            ([1.0, 3.0], true),
            ([1e-20, 1e20], true),
            ([0.02, 0.9], true),
        ] {
            let labels = ticks(range, log).into_iter().filter(|tick| tick.label.is_some()).count();
            assert!((2..=9).contains(&labels), "{range:?} {log}: {labels}");
        }
    }

    #[test]
    fn a_senseless_range_has_no_ticks() {
        for range in [[1.0, 1.0], [2.0, 1.0], [f64::NAN, 1.0], [0.0, f64::INFINITY], [-f64::MAX, f64::MAX]] {
            assert!(ticks(range, false).is_empty());
        }
        assert!(ticks([-1.0, 1.0], true).is_empty());
    }

    proptest! {
        #[test]
        fn ticks_are_round_ascending_and_told_apart(
            low in -1e6..1e6f64, exponent in -6.0..8.0f64, log in any::<bool>()
        ) {
            let span = 10f64.powf(exponent);
            let range = if log { [low.abs() + 1e-3, low.abs() + 1e-3 + span] } else { [low, low + span] };
            let ticks = ticks(range, log);
            let labels: Vec<&String> = ticks.iter().filter_map(|tick| tick.label.as_ref()).collect();
            prop_assert!((1..=12).contains(&labels.len()), "{range:?} {labels:?}");
            prop_assert!(labels.windows(2).all(|pair| pair[0] != pair[1]), "{range:?} {labels:?}");
            let values: Vec<f64> = ticks.iter().filter(|tick| tick.label.is_some()).map(|tick| tick.value).collect();
            prop_assert!(values.windows(2).all(|pair| pair[0] < pair[1]));
            for tick in &ticks {
                prop_assert!((-1e-6..=1.0 + 1e-6).contains(&tick.place));
                let back = if log { range[0] * (range[1] / range[0]).powf(tick.place) } else { range[0] + span * tick.place };
                prop_assert!((back - tick.value).abs() <= 1e-6 * span.max(1e-6 * range[1].abs()), "{back} {tick:?}");
            }
            // Round: differences are 1, 2 or 5 times a power of ten (or powers of ten and their halves and fifths).
            if !log && values.len() > 1 {
                // Values of 53 bits leave their difference the digits that `linear_ticks` asks for, no more.
                let step = values[1] - values[0];
                let mantissa = step / 10f64.powf((step * 1.02).log10().floor());
                prop_assert!([1.0, 2.0, 5.0].iter().any(|round| (mantissa - round).abs() < 1e-2), "{step}");
            }
        }
    }
}
