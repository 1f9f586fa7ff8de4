//! How ranges that are left to be found follow what is seen.

use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;
use std::str::FromStr;

/// How automatic ranges follow what is seen, from picture to picture. Of a single picture all are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ExposureMode {
    /// So smoothly that one does not see it: for comparing what is near in time.
    #[default]
    Steady,
    /// Not at all: as they are found first, until something else is shown.
    Fixed,
    /// Each picture has its own.
    Auto,
    /// As an eye: fast where it gets brighter, slowly where it gets darker.
    Adaptive {
        /// Time in which the eye covers 63 % of the way to brighter light, seconds.
        #[serde(default = "usual_bright")]
        bright: f64,
        /// The same to darker light.
        #[serde(default = "usual_dark")]
        dark: f64,
    },
}

/// Time constants that an eye may have, seconds.
pub const TIME_CONSTANTS: RangeInclusive<f64> = 0.01..=10.0;

fn usual_bright() -> f64 {
    0.3
}

fn usual_dark() -> f64 {
    1.5
}

impl ExposureMode {
    /// An eye as it is by default.
    pub fn adaptive() -> ExposureMode {
        ExposureMode::Adaptive { bright: usual_bright(), dark: usual_dark() }
    }

    /// Whether ranges that were found in advance are kept or followed smoothly.
    pub fn is_found_ahead(&self) -> bool {
        matches!(self, ExposureMode::Steady | ExposureMode::Fixed)
    }

    /// A value out of its range, if there is one: its field, what was found and what is expected.
    pub fn mistake(&self) -> Option<(&'static str, String, String)> {
        let ExposureMode::Adaptive { bright, dark } = *self else { return None };
        let all = [("bright", bright), ("dark", dark)];
        let (field, found) = all.into_iter().find(|(_, value)| !TIME_CONSTANTS.contains(value))?;
        let (first, last) = (TIME_CONSTANTS.start(), TIME_CONSTANTS.end());
        Some((field, found.to_string(), format!("{first} to {last} seconds")))
    }
}

impl FromStr for ExposureMode {
    type Err = String;

    fn from_str(text: &str) -> Result<ExposureMode, String> {
        let expected = || "expected steady, fixed, auto, adaptive or adaptive:BRIGHT,DARK in seconds".to_owned();
        let mode = match text {
            "steady" => ExposureMode::Steady,
            "fixed" => ExposureMode::Fixed,
            "auto" => ExposureMode::Auto,
            "adaptive" => ExposureMode::adaptive(),
            _ => {
                let constants = text.strip_prefix("adaptive:").and_then(|constants| constants.split_once(','));
                let (bright, dark) = constants.ok_or_else(expected)?;
                let seconds = |text: &str| text.trim().parse::<f64>().map_err(|_| expected());
                ExposureMode::Adaptive { bright: seconds(bright)?, dark: seconds(dark)? }
            }
        };
        match mode.mistake() {
            None => Ok(mode),
            Some((field, found, expected)) => Err(format!("{field}: found {found}, expected {expected}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_are_optional_and_checked() {
        let parsed = |text: &str| text.parse::<ExposureMode>();
        assert_eq!(parsed("adaptive").unwrap(), ron::from_str("adaptive()").unwrap());
        assert_eq!(parsed("adaptive:0.2,2").unwrap(), ron::from_str("adaptive(bright: 0.2, dark: 2.0)").unwrap());
        assert_eq!(parsed("fixed").unwrap(), ron::from_str("fixed").unwrap());
        for wrong in ["", "fast", "adaptive:1", "adaptive:0,1", "adaptive:1,nan", "adaptive:1,60"] {
            assert!(parsed(wrong).is_err(), "{wrong}");
        }
    }
}
