//! Tables of comma, semicolon or tab separated values with a header line, plain or compressed. The header may be a comment
//! (`# x,y,z`). A file with as many lines after the header as the header has names, each with one and the same other
//! number of values, holds a column in every line.

use super::catalogue::Catalogue;
use super::columns::{Column, number};
use super::records::Delimiter;
use super::separated::{Heading, Separated, header_line, open};
use super::text;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use std::io::BufRead;
use std::path::Path;

/// The CSV format.
pub(in crate::import) struct Csv;

impl Format for Csv {
    fn name(&self) -> &'static str {
        "CSV table with a header"
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let text = text::head(head).unwrap_or_default();
        let header = text.lines().next().unwrap_or_default();
        let names = header.trim_start_matches('#').split(delimiter(header)).map(str::trim);
        let (mut fields, mut named) = (0, 0);
        for name in names {
            fields += 1;
            named += usize::from(number(name).is_none() && name.len() < 64);
        }
        fields >= 2 && 2 * named >= fields
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open::<Csv>(path, method)?)?))
    }
}

impl Separated for Csv {
    const NAME: &'static str = "csv";

    fn heading(path: &Path, reader: &mut dyn BufRead) -> Result<Heading, ImportError> {
        let header = header_line(path, reader)?;
        let delimiter = delimiter(&header);
        let names = header.trim_start_matches('\u{feff}').trim_start_matches('#').trim_end().split(delimiter);
        Ok(Heading::of_names(names.map(Column::new).collect(), Delimiter::Each(delimiter as u8)))
    }
}

/// What separates the names of a header line.
fn delimiter(header: &str) -> char {
    let candidates = [',', '\t', ';'];
    candidates.into_iter().max_by_key(|candidate| header.matches(*candidate).count()).unwrap_or(',')
}
