//! Settings that describe themselves: one record gives a setting's name, unit, range, default and help to the command
//! line, to RON checks, to the panel and to the manual.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use thiserror::Error;

/// One setting of a mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Its name in RON.
    pub name: &'static str,
    /// Its unit; empty for none.
    pub unit: &'static str,
    /// What values it takes.
    pub kind: SettingKind,
    /// What it does, a sentence.
    pub help: &'static str,
}

/// What values a setting takes, and its default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SettingKind {
    /// A number within a range, both ends included.
    Number {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
        /// Value unless set.
        default: f64,
    },
    /// On or off.
    Flag {
        /// Value unless set.
        default: bool,
    },
    /// One of some names.
    Choice {
        /// The names; the first is the value unless set.
        options: &'static [&'static str],
    },
    /// The name of a column of the particles: an attribute's, or one that all have (`density`, `mass`, `smoothing-length`).
    Column {
        /// The name unless set.
        default: &'static str,
    },
    /// The name of a vector, whose components are columns of the particles, or channels, of their own: its name with `-x`, `-y` and `-z`.
    Vector {
        /// The name unless set.
        default: &'static str,
    },
    /// A list of numbers, each within a range, both ends included; empty unless set.
    Numbers {
        /// Smallest value of each.
        min: f64,
        /// Largest value of each.
        max: f64,
        /// Most numbers.
        most: usize,
    },
    /// A list of colours, written as `#rrggbb`; empty unless set.
    Colors {
        /// Most colours.
        most: usize,
    },
}

/// A value as RON gives it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SettingValue {
    /// On or off.
    Flag(bool),
    /// A number.
    Number(f64),
    /// A name.
    Name(String),
    /// A list of numbers; an empty list of anything.
    Numbers(Vec<f64>),
    /// A list of names.
    Names(Vec<String>),
}

impl std::fmt::Display for SettingValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            SettingValue::Flag(flag) => flag.fmt(f),
            SettingValue::Number(number) => number.fmt(f),
            SettingValue::Name(name) => name.fmt(f),
            SettingValue::Numbers(numbers) => {
                let texts: Vec<String> = numbers.iter().map(f64::to_string).collect();
                write!(f, "[{}]", texts.join(", "))
            }
            SettingValue::Names(names) => write!(f, "[{}]", names.join(", ")),
        }
    }
}

/// A number that may have many digits.
fn brief(number: f64) -> String {
    if number.abs() >= 1e6 { format!("{number:e}") } else { number.to_string() }
}

/// The components of a colour written as `#rrggbb`, gamma-encoded sRGB.
pub fn parse_color(text: &str) -> Option<[f32; 3]> {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii())?;
    let byte = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).ok();
    Some([byte(0)?, byte(2)?, byte(4)?].map(|byte| f32::from(byte) / 255.0))
}

/// A setting that does not exist or a value that it does not take.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SettingError {
    /// The mode has no such setting.
    #[error("{mode} has no setting {name}, expected {expected}")]
    Unknown {
        /// The mode.
        mode: &'static str,
        /// The name that was given.
        name: String,
        /// The names that there are.
        expected: String,
    },
    /// The value is of the wrong kind or outside its range.
    #[error("{name} is {found}, expected {expected}")]
    Value {
        /// The setting.
        name: &'static str,
        /// What was given.
        found: String,
        /// What it takes.
        expected: String,
    },
}

impl Setting {
    /// The value unless set.
    pub fn default(&self) -> SettingValue {
        match self.kind {
            SettingKind::Number { default, .. } => SettingValue::Number(default),
            SettingKind::Flag { default } => SettingValue::Flag(default),
            SettingKind::Choice { options } => SettingValue::Name(options.first().copied().unwrap_or_default().into()),
            SettingKind::Column { default } | SettingKind::Vector { default } => SettingValue::Name(default.into()),
            SettingKind::Numbers { .. } | SettingKind::Colors { .. } => SettingValue::Numbers(Vec::new()),
        }
    }

    /// What values it takes, in words.
    pub fn range(&self) -> String {
        match self.kind {
            SettingKind::Number { min, max, .. } => format!("a number from {} to {}", brief(min), brief(max)),
            SettingKind::Flag { .. } => "true or false".into(),
            SettingKind::Choice { options } => format!("one of {}", options.join(", ")),
            SettingKind::Column { .. } => "the name of an attribute, density, mass or smoothing-length".into(),
            SettingKind::Vector { .. } => "the name of a vector, without -x, -y and -z".into(),
            SettingKind::Numbers { min, max, most } => {
                format!("a list of up to {most} numbers from {} to {}", brief(min), brief(max))
            }
            SettingKind::Colors { most } => format!("a list of up to {most} colours like \"#ff8000\""),
        }
    }

    /// Whether the setting takes this value.
    ///
    /// # Errors
    /// [`SettingError::Value`] if it does not.
    pub fn check(&self, value: &SettingValue) -> Result<(), SettingError> {
        let takes = match (self.kind, value) {
            (SettingKind::Number { min, max, .. }, SettingValue::Number(number)) => (min..=max).contains(number),
            (SettingKind::Flag { .. }, SettingValue::Flag(_)) => true,
            (SettingKind::Choice { options }, SettingValue::Name(name)) => options.contains(&name.as_str()),
            (SettingKind::Column { .. } | SettingKind::Vector { .. }, SettingValue::Name(name)) => !name.is_empty(),
            (SettingKind::Numbers { min, max, most }, SettingValue::Numbers(numbers)) => {
                numbers.len() <= most && numbers.iter().all(|number| (min..=max).contains(number))
            }
            (SettingKind::Colors { .. }, SettingValue::Numbers(none)) => none.is_empty(),
            (SettingKind::Colors { most }, SettingValue::Names(names)) => {
                names.len() <= most && names.iter().all(|name| parse_color(name).is_some())
            }
            _ => false,
        };
        match takes {
            true => Ok(()),
            false => Err(SettingError::Value { name: self.name, found: value.to_string(), expected: self.range() }),
        }
    }
}

/// The settings of one mode that differ from their defaults.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Settings(pub BTreeMap<String, SettingValue>);

impl Settings {
    /// Whether nothing is set.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether `mode` has all these settings and takes their values.
    ///
    /// # Errors
    /// [`SettingError`] for the first that it has not or does not take.
    pub fn check(&self, mode: &super::Mode) -> Result<(), SettingError> {
        self.check_against(mode.name, mode.own_settings())
    }

    /// The same for the settings `known` of whatever is called `mode`.
    pub(super) fn check_against(
        &self,
        mode: &'static str,
        known: impl Iterator<Item = &'static Setting> + Clone,
    ) -> Result<(), SettingError> {
        for (name, value) in &self.0 {
            match known.clone().find(|setting| setting.name == name) {
                Some(setting) => setting.check(value)?,
                None => {
                    let names: Vec<&str> = known.map(|setting| setting.name).collect();
                    let expected = if names.is_empty() { "none".into() } else { names.join(", ") };
                    return Err(SettingError::Unknown { mode, name: name.clone(), expected });
                }
            }
        }
        Ok(())
    }

    /// Those with such names.
    pub fn filtered(&self, is_wanted: impl Fn(&str) -> bool) -> Settings {
        let wanted = self.0.iter().filter(|(name, _)| is_wanted(name));
        Settings(wanted.map(|(name, value)| (name.clone(), value.clone())).collect())
    }

    /// Those that a mode has.
    pub fn of_mode(&self, mode: &super::Mode) -> Settings {
        self.filtered(|name| mode.own_settings().any(|setting| setting.name == name))
    }

    /// The number that `setting` has here, or its default.
    pub fn number(&self, setting: &Setting) -> f64 {
        match (self.0.get(setting.name), setting.kind) {
            (Some(SettingValue::Number(number)), SettingKind::Number { min, max, .. }) => number.clamp(min, max),
            (Some(SettingValue::Flag(flag)), SettingKind::Flag { .. }) => f64::from(u8::from(*flag)),
            (_, SettingKind::Number { default, .. }) => default,
            (_, SettingKind::Flag { default }) => f64::from(u8::from(default)),
            _ => 0.0,
        }
    }

    /// Whether `setting` is on here.
    pub fn flag(&self, setting: &Setting) -> bool {
        self.number(setting) != 0.0
    }

    /// The name that `setting` has here, or its default.
    pub fn name(&self, setting: &Setting) -> String {
        match self.0.get(setting.name).filter(|value| setting.check(value).is_ok()) {
            Some(SettingValue::Name(name)) => name.clone(),
            _ => match setting.default() {
                SettingValue::Name(name) => name,
                _ => String::new(),
            },
        }
    }

    /// The numbers that `setting` has here; none unless set.
    pub fn numbers(&self, setting: &Setting) -> &[f64] {
        match self.0.get(setting.name).filter(|value| setting.check(value).is_ok()) {
            Some(SettingValue::Numbers(numbers)) => numbers,
            _ => &[],
        }
    }

    /// The colours that `setting` has here, gamma-encoded; none unless set.
    pub fn colors(&self, setting: &Setting) -> Vec<[f32; 3]> {
        match self.0.get(setting.name).filter(|value| setting.check(value).is_ok()) {
            Some(SettingValue::Names(names)) => names.iter().filter_map(|name| parse_color(name)).collect(),
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modes::points;

    #[test]
    fn values_are_checked_against_the_description() {
        let settings: Settings = ron::from_str(r#"{"radius": 3.5}"#).unwrap();
        settings.check(&points::MODE).unwrap();
        assert_eq!(settings.number(&points::RADIUS), 3.5);
        for (wrong, part) in [
            (r#"{"radius": 1e9}"#, "radius is 1000000000, expected a number from"),
            (r#"{"radius": true}"#, "radius is true, expected a number from"),
            (r#"{"radios": 1.0}"#, "points has no setting radios, expected radius"),
        ] {
            let settings: Settings = ron::from_str(wrong).unwrap();
            let message = settings.check(&points::MODE).unwrap_err().to_string();
            assert!(message.starts_with(part), "{message}");
        }
    }

    #[test]
    fn lists_and_names_are_checked_too() {
        use crate::modes::isosurface;
        let check = |text: &str| {
            let settings: Settings = ron::from_str(text).unwrap();
            settings.check(&isosurface::MODE).map_err(|error| error.to_string())
        };
        check(r##"{"isovalues": [0.1, 3.0], "iso-colors": ["#ff8000", "#00Ff00"], "kernel": "poly6"}"##).unwrap();
        check(r#"{"isovalues": [], "iso-colors": []}"#).unwrap();
        check(r#"{"surface-field": "temperature"}"#).unwrap();
        for (wrong, part) in [
            (r#"{"isovalues": [-1e39]}"#, "isovalues is [-1000"),
            (r#"{"isovalues": 3.0}"#, "isovalues is 3, expected a list"),
            (r##"{"iso-colors": ["red"]}"##, "iso-colors is [red], expected a list of up to 8 colours"),
            (r#"{"surface-field": ""}"#, "surface-field is , expected the name of an attribute, density, mass or"),
            (r#"{"surface-field": 1.0}"#, "surface-field is 1, expected the name of an attribute"),
            (r#"{"kernel": "gauss"}"#, "kernel is gauss, expected one of data, cubic-spline, poly6, quartic-spline, "),
            (r#"{"presence": 2.0}"#, "isosurface has no setting presence"),
        ] {
            let message = check(wrong).unwrap_err();
            assert!(message.starts_with(part), "{message}");
        }
        assert_eq!(parse_color("#ff0080"), Some([1.0, 0.0, 128.0 / 255.0]));
        assert_eq!(parse_color("#ff008"), None);
    }
}
