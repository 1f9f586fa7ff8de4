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
}

/// A value as RON gives it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SettingValue {
    /// On or off.
    Flag(bool),
    /// A number.
    Number(f64),
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
        }
    }

    /// What values it takes, in words.
    pub fn range(&self) -> String {
        match self.kind {
            SettingKind::Number { min, max, .. } => format!("a number from {min} to {max}"),
            SettingKind::Flag { .. } => "true or false".into(),
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
            _ => false,
        };
        match takes {
            true => Ok(()),
            false => Err(SettingError::Value {
                name: self.name,
                found: match value {
                    SettingValue::Flag(flag) => flag.to_string(),
                    SettingValue::Number(number) => number.to_string(),
                },
                expected: self.range(),
            }),
        }
    }
}

/// The settings of one mode that differ from their defaults.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Settings(pub BTreeMap<String, SettingValue>);

impl Settings {
    /// Whether `mode` has all these settings and takes their values.
    ///
    /// # Errors
    /// [`SettingError`] for the first that it has not or does not take.
    pub fn check(&self, mode: &super::Mode) -> Result<(), SettingError> {
        for (name, value) in &self.0 {
            match mode.all_settings().find(|setting| setting.name == name) {
                Some(setting) => setting.check(value)?,
                None => {
                    let names: Vec<&str> = mode.all_settings().map(|setting| setting.name).collect();
                    let expected = names.join(", ");
                    return Err(SettingError::Unknown { mode: mode.name, name: name.clone(), expected });
                }
            }
        }
        Ok(())
    }

    /// The number that `setting` has here, or its default.
    pub fn number(&self, setting: &Setting) -> f64 {
        match (self.0.get(setting.name), setting.kind) {
            (Some(SettingValue::Number(number)), SettingKind::Number { min, max, .. }) => number.clamp(min, max),
            (Some(SettingValue::Flag(flag)), SettingKind::Flag { .. }) => f64::from(u8::from(*flag)),
            (_, SettingKind::Number { default, .. }) => default,
            (_, SettingKind::Flag { default }) => f64::from(u8::from(default)),
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
            (r#"{"radios": 1.0}"#, "points has no setting radios, expected radius, culling, "),
        ] {
            let settings: Settings = ron::from_str(wrong).unwrap();
            let message = settings.check(&points::MODE).unwrap_err().to_string();
            assert!(message.starts_with(part), "{message}");
        }
    }
}
