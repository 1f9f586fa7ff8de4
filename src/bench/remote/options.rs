//! What the link of `bench remote` is like.

use crate::command_line::arguments::positive;
use std::time::Duration;

/// Slowest and fastest links, bits per second, and the longest round trip, seconds.
const RATES: [f64; 2] = [1e4, 1e12];
const LONGEST: f64 = 10.0;

/// What the link is like, and how long it is flown over.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "remote")]
#[command(next_help_heading = "Options of `bench remote`")]
pub struct Options {
    /// What the link takes, all connections together: kbit, Mbit or Gbit a second.
    #[arg(long, value_name = "RATE", default_value = "100Mbit", value_parser = bits)]
    pub rate: f64,
    /// Time of a round trip, ms or s. A request takes one, a new connection another one.
    #[arg(long, value_name = "TIME", default_value = "50ms", value_parser = time)]
    pub latency: Duration,
    /// Also fly at random over such a link that spoils one answer in eight (429, 503, nothing for 12 s, cut connections, short bodies),
    /// with nothing kept, and compare where it stops with pictures of the file as it lies here.
    #[arg(long)]
    pub faults: bool,
    /// How long to fly at random, minutes.
    #[arg(long, value_name = "M", default_value_t = 1.0, value_parser = positive, requires = "faults")]
    pub minutes: f64,
}

/// A number and its unit.
fn amount(text: &str, units: &[(&str, f64)]) -> Option<f64> {
    let digits = text.find(|c: char| c.is_ascii_alphabetic())?;
    let (number, unit) = text.split_at(digits);
    let (_, factor) = units.iter().find(|(name, _)| *name == unit)?;
    Some(number.trim().parse::<f64>().ok()? * factor)
}

/// Bits per second: `100Mbit`.
fn bits(text: &str) -> Result<f64, String> {
    amount(text, &[("kbit", 1e3), ("Mbit", 1e6), ("Gbit", 1e9)])
        .filter(|bits| (RATES[0]..=RATES[1]).contains(bits))
        .ok_or_else(|| "expected from 10kbit to 1000Gbit, such as 100Mbit".into())
}

/// A time: `50ms`, `0.2s`.
fn time(text: &str) -> Result<Duration, String> {
    amount(text, &[("ms", 1e-3), ("s", 1.0)])
        .filter(|seconds| (0.0..=LONGEST).contains(seconds))
        .map(Duration::from_secs_f64)
        .ok_or_else(|| "expected at most 10s, such as 50ms".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_and_times_have_units_and_bounds() {
        assert_eq!([bits("100Mbit"), bits("1.5 Gbit"), bits("20kbit")], [Ok(1e8), Ok(1.5e9), Ok(2e4)]);
        assert_eq!([time("50ms"), time("0s")], [Ok(Duration::from_millis(50)), Ok(Duration::ZERO)]);
        for wrong in ["", "100", "Mbit", "-1Mbit", "1kbit", "1e3Gbit", "100MB", "nanMbit", "2000Gbit"] {
            assert!(bits(wrong).is_err(), "{wrong}");
        }
        for wrong in ["", "50", "ms", "-1ms", "11s", "50 min"] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
    }
}
