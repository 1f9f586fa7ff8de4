//! What a table is: rows of named columns of numbers, which are read in ranges.

use super::STANDARD;
use crate::import::{FieldKind, ImportError};
use std::ops::Range;

/// The most numbers that a row may have in one column.
pub(super) const MOST_COMPONENTS: usize = 64;

/// One column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    /// The name as the file has it, without a unit.
    pub name: String,
    /// The unit that the file states, or that the name carried in brackets; empty without.
    pub unit: String,
    /// Numbers per row, at least 1.
    pub components: usize,
}

impl Column {
    /// A column of one number per row; `header` is a name such as `x`, `x [kpc]` or `x (kpc)`, or `x(6)` where columns are numbered.
    pub(super) fn new(header: &str) -> Column {
        let header = header.trim().trim_matches('"').trim();
        let numbered = header.strip_suffix(')').and_then(|header| header.rsplit_once('('));
        let numbered =
            numbered.filter(|(name, number)| !name.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit()));
        let header = numbered.map_or(header, |(name, _)| name.trim_end());
        let bracket = header.find(['[', '(']).filter(|at| *at > 0 && header.ends_with([']', ')']));
        let (name, unit) = match bracket {
            Some(at) => (header[..at].trim(), header[at..].trim_matches(['[', ']', '(', ')']).trim()),
            None => (header, ""),
        };
        Column { name: printable(name), unit: printable(unit), components: 1 }
    }

    /// A column whose unit is stated apart from its name; where that is empty, the name may carry one.
    pub(super) fn with_unit(name: &str, unit: &str, components: usize) -> Column {
        match unit.trim() {
            "" => Column { components, ..Column::new(name) },
            unit => Column { name: printable(name.trim()), unit: printable(unit), components },
        }
    }

    /// The name in the form in which names are compared.
    pub(super) fn key(&self) -> String {
        self.name.to_lowercase().replace([' ', '-'], "_")
    }

    /// Whether its numbers are ids, by its name.
    pub(super) fn is_id(&self) -> bool {
        let key = self.key();
        let is_named =
            STANDARD.iter().any(|(names, _, kind, _)| *kind == FieldKind::Id && names.contains(&key.as_str()));
        is_named && self.components == 1
    }

    /// Numbers that stand for it in a row where ids are to be exact: behind one that is an id what it lacks ([`super::ids`]).
    pub(super) fn width(&self) -> usize {
        self.components + usize::from(self.is_id())
    }
}

/// A table that has been opened. Several threads may read at once.
pub(super) trait Table: Send + Sync {
    /// Its columns of numbers; those of anything else are left out.
    fn columns(&self) -> &[Column];

    /// How many rows it has.
    fn rows(&self) -> u64;

    /// Reads the rows `rows` of a column into `out`, row by row; NaN where there is no number. `out` holds exactly that many numbers.
    ///
    /// # Errors
    /// When the file cannot be read there.
    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError>;

    /// Reads whole numbers exactly, `None` where one is missing or below 0; false where the column does not hold them as such, and
    /// `out`, which is all `None`, stays as it is.
    ///
    /// # Errors
    /// As [`Table::read`].
    fn read_whole(&self, _column: usize, _rows: Range<u64>, _out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        Ok(false)
    }

    /// Whether it is known that some row has no whole number from 0 in a column of ids.
    fn lacks_ids(&self, _column: usize) -> bool {
        false
    }

    /// Whether it is known that no row has a number in the column.
    fn is_blank(&self, _column: usize) -> bool {
        false
    }

    /// Says which columns are about to be read as [`crate::import::Source::announce`] does of fields.
    fn announce(&self, _columns: &[usize]) {}

    /// As [`crate::import::Source::at_hand_until`].
    fn at_hand_until(&self, _row: u64) -> Option<u64> {
        None
    }
}

/// A table with what a format says of it.
pub(super) struct Opened {
    /// The table.
    pub table: Box<dyn Table>,
    /// The format's name in descriptions.
    pub format: &'static str,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// What was assumed or left out, one sentence each.
    pub notes: Vec<String>,
}

/// What tables write in place of a missing number, in lower case.
const MISSING: [&str; 10] = ["", "na", "n/a", "#n/a", "<na>", "null", "\\n", "none", "-", "--"];

/// The number that a field of text holds; NaN for what tables write in place of a missing one, `None` for other text.
pub(super) fn number(text: &str) -> Option<f64> {
    stated_number(text).or_else(|| MISSING.contains(&&*text.trim().to_lowercase()).then_some(f64::NAN))
}

/// The number that a text is, also with the exponent of Fortran's double precision (`1.5D+03`); `None` for other text.
pub(super) fn stated_number(text: &str) -> Option<f64> {
    let text = text.trim();
    let of_fortran = || {
        let (digits, exponent) = text.split_once(['D', 'd']).filter(|(digits, _)| !digits.is_empty())?;
        format!("{digits}e{exponent}").parse().ok()
    };
    text.parse().ok().or_else(of_fortran)
}

/// A note about columns that are no numbers which a row has a fixed number of; none where there are none.
pub(super) fn left_out_note(names: &[String]) -> Option<String> {
    const LISTED: usize = 8;
    let shown: Vec<String> = names.iter().take(LISTED).map(|name| shown(name)).collect();
    let more = if names.len() > LISTED { format!(" and {} more", names.len() - LISTED) } else { String::new() };
    (!names.is_empty()).then(|| format!("columns without numbers are left out: {}{more}", shown.join(", ")))
}

/// A name as it stands in a message of one line.
pub(super) fn shown(name: &str) -> String {
    printable(name).chars().take(60).collect()
}

/// A text that fits in one line.
fn printable(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { '?' } else { letter }).collect()
}
