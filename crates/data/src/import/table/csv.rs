//! Tables of comma, semicolon or tab separated values with a header line, plain or compressed. Comments may be before the header, which may be
//! one itself (`# x,y,z`). A file with as many lines after the header as the header has names, each with one and the same other
//! number of values, holds a column in every line.

use super::catalogue::Catalogue;
use super::columns::{Column, number};
use super::records::Delimiter;
use super::separated::{Heading, Separated, header_line, open};
use super::text;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use csv::{ReaderBuilder, StringRecord};
use std::io::BufRead;
use std::path::Path;

/// The CSV format.
pub(in crate::import) struct Csv;

/// The longest text before the names, bytes.
const LONGEST: usize = 1 << 20;

impl Format for Csv {
    fn name(&self) -> &'static str {
        "CSV table with a header"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["csv", "tsv"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let text = text::head(head).unwrap_or_default();
        Beginning::read(Path::new("head"), &mut text.as_bytes()).is_ok_and(|beginning| are_names(&beginning.names))
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open::<Csv>(path, method)?)?))
    }
}

impl Separated for Csv {
    const NAME: &'static str = "csv";

    fn heading(path: &Path, reader: &mut dyn BufRead) -> Result<Heading, ImportError> {
        let Beginning { names, lines, row } = Beginning::read(path, reader)?;
        let delimiter = delimiter(&names);
        let names = split(&names, delimiter);
        let columns = names.iter().enumerate().map(|(index, name)| match Column::new(name) {
            // As pandas writes the column that numbers rows.
            column if column.name.is_empty() => Column { name: format!("column-{}", index + 1), ..column },
            column => column,
        });
        let heading = Heading::of_names(columns.collect(), Delimiter::Each(delimiter as u8));
        Ok(Heading { lines, begun: row.into_bytes(), ..heading })
    }
}

/// What such a file begins with.
struct Beginning {
    /// The line of names, without a mark of comments; empty without any.
    names: String,
    /// How many lines there are before the first row.
    lines: u64,
    /// The first row, where the names are a comment: only what comes behind them tells that.
    row: String,
}

impl Beginning {
    fn read(path: &Path, reader: &mut dyn BufRead) -> Result<Beginning, ImportError> {
        let (mut comments, mut lines, mut bytes) = (Vec::new(), 0, 0);
        let row = loop {
            let line = header_line(path, reader)?;
            let text = line.trim_start_matches('\u{feff}').trim_end();
            if !line.is_empty() && text.is_empty() {
                lines += 1;
            } else if let Some(comment) = text.strip_prefix('#') {
                lines += 1;
                comments.push(comment.trim_start_matches('#').to_owned());
            } else {
                break line;
            }
            bytes += line.len();
            if bytes > LONGEST {
                let found = format!("more than {LONGEST} bytes before the names of columns");
                return Err(ImportError::malformed(path, "header", found, "a shorter one"));
            }
        };
        let first = row.trim_start_matches('\u{feff}').trim_end();
        let has_number =
            first.split(delimiter(first)).any(|value| number(value).is_some_and(|number| !number.is_nan()));
        let values = |line: &str| line.split(delimiter(line)).count();
        let mut named = comments.iter().rev().filter(|comment| are_names(comment));
        let named = if has_number || first.is_empty() {
            let as_many = named.clone().find(|comment| values(comment) == values(first));
            as_many.or_else(|| named.next().filter(|_| !are_names(first)))
        } else {
            // A row in which all is missing has neither numbers nor names.
            named.find(|comment| values(first) > 1 && values(comment) == values(first)).filter(|_| !are_names(first))
        };
        Ok(match named {
            Some(names) => Beginning { names: names.clone(), lines, row },
            None => Beginning { names: first.to_owned(), lines: lines + 1, row: String::new() },
        })
    }
}

/// Whether the values of a line may be names: two at least, of which half are no numbers.
fn are_names(line: &str) -> bool {
    let (mut fields, mut named) = (0, 0);
    for name in line.split(delimiter(line)).map(str::trim) {
        fields += 1;
        named += usize::from(!name.is_empty() && number(name).is_none() && name.len() < 64);
    }
    fields >= 2 && 2 * named >= fields
}

/// The names of a header line; one in quotes may hold what separates them.
fn split(header: &str, delimiter: char) -> StringRecord {
    let mut reader = ReaderBuilder::new().has_headers(false).delimiter(delimiter as u8).from_reader(header.as_bytes());
    let mut names = StringRecord::new();
    match reader.read_record(&mut names) {
        Ok(_) => names,
        Err(_) => header.split(delimiter).collect(),
    }
}

/// What separates the names of a header line.
fn delimiter(header: &str) -> char {
    let candidates = [',', '\t', ';'];
    candidates.into_iter().max_by_key(|candidate| header.matches(*candidate).count()).unwrap_or(',')
}
