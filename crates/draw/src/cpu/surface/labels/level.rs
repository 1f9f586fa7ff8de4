//! Levels of lines as text, exactly: sums of decimal fractions are decimal fractions.

/// A decimal fraction: a whole number and how many of its digits are behind the point.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Decimal {
    digits: i128,
    places: u32,
}

impl Decimal {
    /// The shortest fraction that is read as this number; `None` where it has too many digits.
    fn of(number: f64) -> Option<Decimal> {
        let text = number.to_string();
        let (whole, part) = text.split_once('.').unwrap_or((&text, ""));
        let digits = format!("{whole}{part}").parse().ok()?;
        Some(Decimal { digits, places: u32::try_from(part.len()).ok()? })
    }

    /// The same with so many digits behind the point, which are not fewer than it has.
    fn with_places(self, places: u32) -> Option<i128> {
        self.digits.checked_mul(10_i128.checked_pow(places - self.places)?)
    }
}

/// The level of line number `number`, and its text with all of its digits, which are those of `base + number interval` as these are written:
/// 0.1, 0.2, 0.3 and not 0.30000000000000004.
pub fn level(base: f64, interval: f64, number: i64) -> (f64, String) {
    let exact = || {
        let (base, interval) = (Decimal::of(base)?, Decimal::of(interval)?);
        let places = base.places.max(interval.places);
        let steps = interval.with_places(places)?.checked_mul(i128::from(number))?;
        let digits = base.with_places(places)?.checked_add(steps)?;
        let (sign, digits) = (if digits < 0 { "-" } else { "" }, digits.unsigned_abs().to_string());
        let padded = format!("{digits:0>width$}", width = places as usize + 1);
        let (whole, part) = padded.split_at(padded.len() - places as usize);
        let part = part.trim_end_matches('0');
        let point = if part.is_empty() { "" } else { "." };
        let text = format!("{sign}{whole}{point}{part}");
        Some((text.parse().ok()?, text))
    };
    exact().unwrap_or_else(|| {
        let level = (number as f64).mul_add(interval, base);
        (level, level.to_string())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn levels_have_the_digits_of_what_they_are_made_of() {
        for (base, interval, number, text) in [
            (0.37, 10.0, 3, "30.37"),
            (0.0, 0.1, 3, "0.3"),
            (0.0, 0.1, -30, "-3"),
            (-0.5, 0.25, 1, "-0.25"),
            (0.0, 20.0, 0, "0"),
            (0.0, 5e-10, 3, "0.0000000015"),
            (1e6, 2e5, 7, "2400000"),
            (0.0, 1e30, 2, "2000000000000000000000000000000"),
        ] {
            assert_eq!(level(base, interval, number), (text.parse().unwrap(), text.to_owned()));
        }
        // What has too many digits is told as it is counted.
        let (found, text) = level(1e300, 1e-300, 4);
        assert_eq!((found, text.parse::<f64>().unwrap()), (1e300, 1e300));
    }

    proptest! {
        #[test]
        fn texts_are_their_levels(base in -1e6..1e6f64, interval in 1e-6..1e6f64, number in -100_000..100_000i64) {
            let (found, text) = level(base, interval, number);
            prop_assert_eq!(text.parse::<f64>().unwrap(), found);
            let exact = (number as f64).mul_add(interval, base);
            prop_assert!((found - exact).abs() <= 1e-12 * exact.abs().max(interval));
        }
    }
}
