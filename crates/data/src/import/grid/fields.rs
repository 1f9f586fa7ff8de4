//! Entries of headers of text.

use super::super::ImportError;
use crate::model::SampleType;
use std::path::Path;
use std::str::FromStr;

/// An entry of a header, for messages about it.
#[derive(Clone, Copy)]
pub(in crate::import) struct Entry<'a> {
    /// The file.
    pub path: &'a Path,
    /// The entry's name.
    pub name: &'a str,
    /// What stands there.
    pub text: &'a str,
}

impl Entry<'_> {
    /// The message that something else was expected.
    pub(in crate::import) fn wrong(&self, expected: impl Into<String>) -> ImportError {
        let shown: String = self.text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(100).collect();
        let found = if shown.trim().is_empty() { "nothing".into() } else { shown };
        ImportError::malformed(self.path, self.name, found, expected)
    }

    /// One value.
    pub(in crate::import) fn value<T: FromStr>(&self, expected: &str) -> Result<T, ImportError> {
        self.text.trim().parse().map_err(|_| self.wrong(expected))
    }

    /// Values between spaces or commas.
    pub(in crate::import) fn values<T: FromStr>(&self, expected: &str) -> Result<Vec<T>, ImportError> {
        let words = self.text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
        words.map(|word| word.parse().map_err(|_| self.wrong(expected))).collect()
    }

    /// So many values.
    pub(in crate::import) fn exactly<T: FromStr>(&self, count: usize) -> Result<Vec<T>, ImportError> {
        let expected = format!("{count} numbers");
        let values = self.values(&expected)?;
        if values.len() == count { Ok(values) } else { Err(self.wrong(expected)) }
    }
}

/// The types of samples under the names that a format has for them.
pub(in crate::import) type TypeNames = &'static [(&'static str, SampleType)];

/// The type of a name.
pub(in crate::import) fn sample_type(entry: Entry, names: TypeNames) -> Result<SampleType, ImportError> {
    let found = names.iter().find(|(name, _)| *name == entry.text.trim());
    found.map(|(_, kind)| *kind).ok_or_else(|| entry.wrong("a type of numbers of 8 to 64 bits"))
}
