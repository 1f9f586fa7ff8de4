//! Names of families: the layers that data comes in.

use serde::de::{EnumAccess, Error, VariantAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fmt;
use std::sync::{Mutex, PoisonError};

/// Longest name, bytes.
const LONGEST: usize = 48;
/// Names that a program may come to know: each is kept as long as it runs.
const MOST: usize = 4096;

/// The name of a family: lower-case letters, digits and hyphens, a letter first. Gadget's six are constants; other data has others.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct FamilyName(&'static str);

#[allow(non_upper_case_globals, reason = "they are used as the variants of an enumeration are, in patterns too")]
impl FamilyName {
    /// Gadget type 0.
    pub const Gas: FamilyName = FamilyName("gas");
    /// Gadget type 1.
    pub const Dark: FamilyName = FamilyName("dark");
    /// Gadget type 2 (disk stars in old initial conditions, low-resolution dark matter in zooms).
    pub const Type2: FamilyName = FamilyName("type2");
    /// Gadget type 3 (bulge, tracers, low-resolution dark matter).
    pub const Type3: FamilyName = FamilyName("type3");
    /// Gadget type 4, and the entries of star catalogues.
    pub const Stars: FamilyName = FamilyName("stars");
    /// Gadget type 5.
    pub const BlackHoles: FamilyName = FamilyName("black-holes");
}

impl FamilyName {
    /// Gadget's families, in the order of its types 0 to 5.
    pub const GADGET: [FamilyName; 6] = [
        FamilyName::Gas,
        FamilyName::Dark,
        FamilyName::Type2,
        FamilyName::Type3,
        FamilyName::Stars,
        FamilyName::BlackHoles,
    ];

    /// The name used on the command line, in RON and in JSON.
    pub const fn as_str(self) -> &'static str {
        self.0
    }

    /// The family of a name as in [`FamilyName::as_str`]; `None` for a text that names none.
    pub fn parse(name: &str) -> Option<FamilyName> {
        static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
        let is_part = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        let is_name = name.len() <= LONGEST
            && name.bytes().all(is_part)
            && name.starts_with(|first: char| first.is_ascii_lowercase());
        if let Some(known) = FamilyName::GADGET.into_iter().find(|family| family.0 == name) {
            return Some(known);
        }
        // A set is complete before its lock is given back.
        let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = names.get(name) {
            return Some(FamilyName(known));
        }
        if !is_name || names.len() >= MOST {
            return None;
        }
        let kept: &'static str = Box::leak(name.into());
        names.insert(kept);
        Some(FamilyName(kept))
    }

    /// Its Gadget type.
    pub fn gadget_type(self) -> Option<u8> {
        FamilyName::GADGET.iter().position(|family| *family == self).map(|number| number as u8)
    }
}

/// Gadget's in its order, then others by name.
impl Ord for FamilyName {
    fn cmp(&self, other: &FamilyName) -> Ordering {
        let place = |name: &FamilyName| (name.gadget_type().unwrap_or(u8::MAX), name.0);
        place(self).cmp(&place(other))
    }
}

impl PartialOrd for FamilyName {
    fn partial_cmp(&self, other: &FamilyName) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl fmt::Debug for FamilyName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl fmt::Display for FamilyName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

/// Files name families as the variants of an enumeration.
impl Serialize for FamilyName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_unit_variant("FamilyName", u32::from(self.gadget_type().unwrap_or(u8::MAX)), self.0)
    }
}

impl<'de> Deserialize<'de> for FamilyName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<FamilyName, D::Error> {
        struct Name;

        impl<'de> Visitor<'de> for Name {
            type Value = FamilyName;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a family: gas, dark, .. (lower-case letters, digits and hyphens)")
            }

            fn visit_enum<A: EnumAccess<'de>>(self, data: A) -> Result<FamilyName, A::Error> {
                let (Text(name), variant) = data.variant()?;
                variant.unit_variant()?;
                FamilyName::parse(&name)
                    .ok_or_else(|| A::Error::invalid_value(serde::de::Unexpected::Str(&name), &self))
            }
        }

        deserializer.deserialize_enum("FamilyName", &[], Name)
    }
}

/// An identifier or a string.
struct Text(String);

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Text, D::Error> {
        struct Any;

        impl Visitor<'_> for Any {
            type Value = Text;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a name")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Text, E> {
                Ok(Text(text.to_owned()))
            }
        }

        deserializer.deserialize_identifier(Any)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for name in FamilyName::GADGET.into_iter().chain(FamilyName::parse("light-curves-2")) {
            assert_eq!(FamilyName::parse(name.as_str()), Some(name));
            let ron = ron::to_string(&name).unwrap();
            assert_eq!(ron::from_str::<FamilyName>(&ron).unwrap(), name, "{ron}");
            let json = serde_json::to_string(&name).unwrap();
            assert_eq!(json, format!("\"{name}\""));
            assert_eq!(serde_json::from_str::<FamilyName>(&json).unwrap(), name);
        }
        assert_eq!(ron::from_str::<Vec<FamilyName>>("[gas, r#black-holes]").unwrap()[1], FamilyName::BlackHoles);
        for wrong in ["", "Gas", "2gas", "-gas", "gas mask", "gäs", &"g".repeat(LONGEST + 1)] {
            assert_eq!(FamilyName::parse(wrong), None, "{wrong}");
            assert!(serde_json::from_str::<FamilyName>(&format!("{wrong:?}")).is_err());
        }
    }

    #[test]
    fn gadgets_come_first() {
        let other = FamilyName::parse("a-family").unwrap();
        let mut names = [other, FamilyName::BlackHoles, FamilyName::Dark, FamilyName::Gas];
        names.sort_unstable();
        assert_eq!(names, [FamilyName::Gas, FamilyName::Dark, FamilyName::BlackHoles, other]);
        assert_eq!((other.gadget_type(), FamilyName::Stars.gadget_type()), (None, Some(4)));
    }
}
