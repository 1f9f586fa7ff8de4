//! Numbers as a reader likes them: grouped digits, few significant figures, powers of ten with superscripts.

/// A count with its digits in groups of three: `262 144`.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// A size in binary units with three significant figures: `1.50 GiB`.
pub fn bytes(value: u64) -> String {
    const UNITS: [&str; 6] = ["B", "KiB", "MiB", "GiB", "TiB", "PiB"];
    let mut scaled = value as f64;
    let mut unit = 0;
    while scaled >= 1000.0 && unit + 1 < UNITS.len() {
        scaled /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{value} B") } else { format!("{} {}", figures(scaled, 3), UNITS[unit]) }
}

/// `value` with `digits` significant figures, without an exponent.
fn figures(value: f64, digits: i32) -> String {
    let exponent = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    let decimals = (digits - 1 - exponent).max(0) as usize;
    format!("{value:.decimals$}")
}

/// The largest number that is 1, 2 or 5 times a power of ten and not above `limit`; `None` where that is not above 0.
pub fn round_below(limit: f64) -> Option<f64> {
    if !(limit > 0.0 && limit.is_finite()) {
        return None;
    }
    let power = 10f64.powf(limit.log10().floor());
    [5.0, 2.0, 1.0].map(|factor| factor * power).into_iter().find(|number| *number <= limit)
}

/// A quantity with three significant figures; a power of ten beyond four digits: `4.21`, `-0.013`, `1.99 × 10¯⁴`.
pub fn quantity(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let magnitude = value.abs();
    if magnitude == 0.0 {
        "0".to_owned()
    } else if (0.01..9999.5).contains(&magnitude) {
        trim(&figures(value, 3))
    } else {
        let mut exponent = magnitude.log10().floor() as i32;
        let mut mantissa = value / 10f64.powi(exponent);
        if mantissa.abs() >= 9.995 {
            mantissa /= 10.0;
            exponent += 1;
        }
        format!("{} × 10{}", trim(&format!("{mantissa:.2}")), superscript(exponent))
    }
}

/// A multiple of `step` with the digits that tell it from the next one, where the largest value of the axis is `largest`:
/// `0.25`, `41250.5`, `3.125 × 10⁷`.
pub fn stepped(value: f64, step: f64, largest: f64) -> String {
    let finest = (1.000_001 * step).log10().floor();
    let value = if value.abs() < 0.5 * step { 0.0 } else { value };
    if (1e-3..1e6).contains(&largest) && finest > -7.0 {
        return trim(&format!("{value:.*}", (-finest).max(0.0) as usize));
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let exponent = (1.000_000_000_1 * value.abs()).log10().floor();
    let digits = (exponent - finest).clamp(0.0, 15.0) as usize;
    // In two factors, since one alone may be beyond the range of numbers.
    let mantissa = value / 10f64.powf(0.5 * exponent) / 10f64.powf(0.5 * exponent);
    format!("{} × 10{}", trim(&format!("{mantissa:.digits$}")), superscript(exponent as i32))
}

/// A power of ten as a tick label: `10³`, and plain figures from 0.01 to 1000.
pub fn power_of_ten(exponent: i32) -> String {
    if (-2..=3).contains(&exponent) {
        trim(&figures(10f64.powi(exponent), 1))
    } else {
        format!("10{}", superscript(exponent))
    }
}

/// The raised minus that the program's font has (a macron; U+207B is in none of them).
pub const MINUS: char = '¯';

/// Seven digits in plain characters, as exponent where that is shorter: `0.01234568`, `1.000000e7`.
pub fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size @ 1e-3..1e7 => {
            let digits = (6.0 - size.log10().floor()).clamp(0.0, 9.0) as usize;
            let text = format!("{value:.digits$}");
            match text.contains('.') {
                true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
                false => text,
            }
        }
        _ => format!("{value:.6e}"),
    }
}

/// An integer in superscript digits.
fn superscript(value: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    value.to_string().chars().map(|c| c.to_digit(10).map_or(MINUS, |digit| DIGITS[digit as usize])).collect()
}

/// Without zeros behind the decimal point that say nothing, and with a true minus sign.
fn trim(text: &str) -> String {
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_seven_digits() {
        let cases = [(0.0, "0"), (1.5, "1.5"), (100.0, "100"), (1234567.0, "1234567"), (-0.0123456789, "-0.01234568")];
        for (value, text) in
            cases.into_iter().chain([(1e7, "1.000000e7"), (1e-4, "1.000000e-4"), (13415.43, "13415.43")])
        {
            assert_eq!(short(value), text);
        }
    }

    #[test]
    fn counts_are_grouped() {
        assert_eq!(count(0), "0");
        assert_eq!(count(999), "999");
        assert_eq!(count(262_144), "262 144");
        assert_eq!(count(10_077_696_000), "10 077 696 000");
    }

    #[test]
    fn sizes_have_three_figures() {
        assert_eq!(bytes(17), "17 B");
        assert_eq!(bytes(3 << 20), "3.00 MiB");
        assert_eq!(bytes(1_610_612_736), "1.50 GiB");
        assert_eq!(bytes(u64::MAX), "16384 PiB");
    }

    #[test]
    fn quantities_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (0.013, "0.013"),
            (-4.2112, "−4.21"),
            (1500.0, "1500"),
            (99_990.0, "1 × 10⁵"),
            (1.99e-4, "1.99 × 10¯⁴"),
            (f64::NAN, "–"),
        ] {
            assert_eq!(quantity(value), text, "{value}");
        }
        for (value, step, largest, text) in [
            (0.25, 0.05, 0.5, "0.25"),
            (41_250.5, 0.5, 41_252.0, "41250.5"),
            (-200.0, 50.0, 400.0, "−200"),
            (1e-17, 0.5, 2.0, "0"),
            (31_250_000.0, 50_000.0, 4e7, "3.125 × 10⁷"),
            (2e-5, 1e-5, 5e-5, "2 × 10¯⁵"),
        ] {
            assert_eq!(stepped(value, step, largest), text);
        }
        assert_eq!(power_of_ten(-7), "10¯⁷");
        assert_eq!(power_of_ten(0), "1");
        assert_eq!(power_of_ten(-1), "0.1");
    }
}
