//! Modes in files: by their names.

use crate::mode::Mode;
use crate::modes;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

impl PartialEq for Mode {
    fn eq(&self, other: &Mode) -> bool {
        self.name == other.name
    }
}

impl Serialize for Mode {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

impl<'de> Deserialize<'de> for &'static Mode {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<&'static Mode, D::Error> {
        let name = String::deserialize(deserializer)?;
        modes::find(&name).ok_or_else(|| de::Error::custom(format!("found {name}, expected one of {}", modes::names())))
    }
}
