//! The header of one part of a FITS file.

use crate::import::ImportError;
use crate::import::table::columns::shown;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Headers and data are in blocks of so many bytes.
pub(super) const BLOCK: usize = 2880;

/// The most blocks of a header that are read.
const LONGEST: usize = 1000;

/// Entries by their names.
pub(super) struct Header {
    path: PathBuf,
    /// Which part of the file it is of, from 0.
    part: usize,
    entries: HashMap<String, String>,
}

impl Header {
    /// Reads a header block by block; `None` where there is none.
    ///
    /// # Errors
    /// When it cannot be read, or has no end.
    pub(super) fn read(
        path: &Path,
        part: usize,
        next: &mut dyn FnMut(&mut [u8; BLOCK]) -> Result<bool, ImportError>,
    ) -> Result<Option<Header>, ImportError> {
        let mut header = Header { path: path.into(), part, entries: HashMap::new() };
        let mut block = [0; BLOCK];
        for number in 0..LONGEST {
            if !next(&mut block)? {
                if number == 0 {
                    return Ok(None);
                }
                return Err(header.wrong("header", "the file's end".into(), "END"));
            }
            // What follows the last part may be anything.
            if number == 0 && part > 0 && !block.starts_with(b"XTENSION=") {
                return Ok(None);
            }
            for card in block.chunks_exact(80) {
                let card = String::from_utf8_lossy(card);
                let name = card.get(..8).unwrap_or_default().trim();
                if name == "END" {
                    return Ok(Some(header));
                }
                if let Some(value) = card.get(8..).and_then(|rest| rest.strip_prefix("= ")) {
                    header.entries.entry(name.to_owned()).or_insert_with(|| plain(value));
                }
            }
        }
        Err(header.wrong("header", format!("{LONGEST} blocks"), "END before"))
    }

    /// The message that something else was expected in an entry.
    pub(super) fn wrong(&self, name: &str, found: String, expected: impl Into<String>) -> ImportError {
        ImportError::malformed(&self.path, format!("part {}: {name}", self.part), shown(&found), expected)
    }

    /// An entry.
    pub(super) fn text(&self, name: &str) -> Option<&str> {
        self.entries.get(name).map(String::as_str)
    }

    /// An entry that must be there.
    ///
    /// # Errors
    /// When it is not.
    pub(super) fn needed(&self, name: &str, expected: &str) -> Result<&str, ImportError> {
        let missing = || ImportError::missing(&self.path, format!("part {}: {name}", self.part), expected);
        self.text(name).ok_or_else(missing)
    }

    /// A whole number from 0; `missing` where there is no entry.
    ///
    /// # Errors
    /// When it is something else.
    pub(super) fn count(&self, name: &str, missing: u64) -> Result<u64, ImportError> {
        let wrong = |text: &str| self.wrong(name, text.into(), "a whole number from 0");
        self.text(name).map_or(Ok(missing), |text| text.parse().map_err(|_| wrong(text)))
    }

    /// A number.
    ///
    /// # Errors
    /// When it is something else.
    pub(super) fn float(&self, name: &str) -> Result<Option<f64>, ImportError> {
        // Exponents may be those of double precision in Fortran.
        let number = |text: &str| text.replace(['D', 'd'], "E").parse().ok().filter(|number: &f64| number.is_finite());
        let wrong = |text: &str| self.wrong(name, text.into(), "a number");
        self.text(name).map(|text| number(text).ok_or_else(|| wrong(text))).transpose()
    }

    /// A whole number.
    ///
    /// # Errors
    /// When it is something else.
    pub(super) fn whole(&self, name: &str) -> Result<Option<i64>, ImportError> {
        let wrong = |text: &str| self.wrong(name, text.into(), "a whole number");
        self.text(name).map(|text| text.parse().map_err(|_| wrong(text))).transpose()
    }

    /// Bytes of the data behind the header, blocks filled up.
    ///
    /// # Errors
    /// When the header does not say, or they are more than can be.
    pub(super) fn data_bytes(&self) -> Result<u64, ImportError> {
        let axes = self.count("NAXIS", 0)?;
        if axes > 999 {
            return Err(self.wrong("NAXIS", axes.to_string(), "a number of axes up to 999"));
        }
        if axes == 0 {
            return Ok(0);
        }
        let bits = self.whole("BITPIX")?.unwrap_or(8).unsigned_abs();
        let mut samples: Option<u64> = Some(1);
        for axis in 1..=axes {
            let size = self.count(&format!("NAXIS{axis}"), 0)?;
            samples = samples.and_then(|samples| samples.checked_mul(size));
        }
        let (parameters, groups) = (self.count("PCOUNT", 0)?, self.count("GCOUNT", 1)?);
        let bytes =
            samples.and_then(|samples| samples.checked_add(parameters)?.checked_mul(groups)?.checked_mul(bits / 8));
        let bytes =
            bytes.and_then(|bytes| bytes.checked_next_multiple_of(BLOCK as u64)).filter(|bytes| *bytes < 1 << 62);
        bytes.ok_or_else(|| self.wrong("NAXIS", axes.to_string(), "axes of fewer samples"))
    }

    /// Bytes of a row of a table, and how many rows it has.
    ///
    /// # Errors
    /// When the part is no table.
    pub(super) fn row_bytes_and_rows(&self) -> Result<(usize, u64), ImportError> {
        let axes = (self.count("NAXIS", 0)?, self.whole("BITPIX")?.unwrap_or(8));
        if axes != (2, 8) {
            return Err(self.wrong(
                "NAXIS",
                format!("{} axes of {} bits", axes.0, axes.1),
                "2 axes of 8 bits, a table",
            ));
        }
        let row = self.count("NAXIS1", 0)?;
        let stride = usize::try_from(row).map_err(|_| self.wrong("NAXIS1", row.to_string(), "fewer bytes"))?;
        Ok((stride, self.count("NAXIS2", 0)?))
    }
}

/// A value without its quotes or its comment; an apostrophe in a text is written twice.
fn plain(value: &str) -> String {
    let value = value.trim();
    let Some(text) = value.strip_prefix('\'') else {
        return value.split('/').next().unwrap_or_default().trim().to_owned();
    };
    let mut plain = String::new();
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        if letter == '\'' && letters.next_if_eq(&'\'').is_none() {
            break;
        }
        plain.push(letter);
    }
    plain.trim().to_owned()
}
