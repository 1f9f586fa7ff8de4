//! The fixed-column star catalogue of KStars: a line per star with right ascension `hhmmss.ss`, declination `+ddmmss.s`,
//! proper motions in mas/yr, parallax in mas, V magnitude and B-V; comment lines start with `#`. Plain or gzip.

use super::catalogue::Catalogue;
use super::columns::{Column, Opened};
use super::store::StoreWriter;
use super::text;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use std::io::BufRead;
use std::path::Path;

/// The KStars format.
pub(in crate::import) struct KStars;

/// Name, first and last character of the numeric columns after the coordinates.
const COLUMNS: [(&str, usize, usize); 5] = [
    ("pmra [mas/yr]", 20, 28),
    ("pmdec [mas/yr]", 29, 37),
    ("parallax [mas]", 38, 44),
    ("mag [mag]", 46, 50),
    ("bv [mag]", 51, 55),
];

impl Format for KStars {
    fn name(&self) -> &'static str {
        "KStars catalogue"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["dat"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let text = text::head(head).unwrap_or_default();
        let first = text.lines().find(|line| !line.starts_with('#')).unwrap_or_default();
        // The line may be cut off where the head ends.
        first.len() > 20 && coordinates(first).is_some()
    }

    fn open(&self, path: &Path, _: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let (reader, bytes) = text::open(path)?;
        let mut columns = vec![Column::new("ra [deg]"), Column::new("dec [deg]")];
        columns.extend(COLUMNS.iter().map(|(name, ..)| Column::new(name)));
        let mut rows = StoreWriter::new(path, columns);
        for (index, line) in reader.split(b'\n').enumerate() {
            let line = line.map_err(|source| ImportError::io(path, format!("line {}", index + 1), source))?;
            let line = String::from_utf8_lossy(&line);
            let line = line.trim_end();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let bad = |expected: &str| {
                let found = format!("{:?}", line.chars().take(56).collect::<String>());
                ImportError::malformed(path, format!("line {}", index + 1), found, expected)
            };
            let (ra, dec) = coordinates(line).ok_or_else(|| bad("hhmmss.ss and +ddmmss.s in columns 1 to 19"))?;
            let mut row = [ra, dec, 0.0, 0.0, 0.0, 0.0, 0.0];
            for (number, (name, first, last)) in row[2..].iter_mut().zip(COLUMNS) {
                let value = cut(line, first, last).and_then(|text| text.trim().parse().ok());
                *number = value.ok_or_else(|| bad(&format!("{name} in columns {} to {}", first + 1, last + 1)))?;
            }
            rows.push(&row)?;
        }
        let table = Box::new(rows.finish(|_| true)?);
        Ok(Box::new(Catalogue::new(path, Opened { table, format: "kstars", bytes, notes: Vec::new() })?))
    }
}

/// Characters `first` to `last` of an ASCII line.
fn cut(line: &str, first: usize, last: usize) -> Option<&str> {
    line.get(first..=last)
}

/// Right ascension and declination in degrees.
fn coordinates(line: &str) -> Option<(f64, f64)> {
    let sexagesimal = |text: &str| -> Option<f64> {
        let whole: f64 = text.get(..2)?.parse().ok()?;
        let minutes: f64 = text.get(2..4)?.parse().ok()?;
        let seconds: f64 = text.get(4..)?.parse().ok()?;
        Some(whole + minutes / 60.0 + seconds / 3600.0)
    };
    let ra = sexagesimal(cut(line, 0, 8)?)?;
    let dec = cut(line, 10, 18)?;
    let sign = match dec.get(..1)? {
        "+" => 1.0,
        "-" => -1.0,
        _ => return None,
    };
    Some((15.0 * ra, sign * sexagesimal(dec.get(1..)?)?))
}
