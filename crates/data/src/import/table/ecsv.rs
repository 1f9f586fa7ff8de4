//! Enhanced CSV (<https://github.com/astropy/astropy-APEs/blob/main/APE6.rst>): values separated by commas or spaces, behind a header in
//! comments that says what each column holds and in which unit.

use super::catalogue::Catalogue;
use super::columns::Column;
use super::ecsv_header::{Described, Description, Kind, MARK, described};
use super::masked::names_mask;
use super::records::Delimiter;
use super::separated::{Heading, Separated, header_line, open};
use super::text;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use std::io::BufRead;
use std::path::Path;

/// The ECSV format.
pub(in crate::import) struct Ecsv;

/// The longest header, bytes.
const LONGEST: usize = 1 << 22;

impl Format for Ecsv {
    fn name(&self) -> &'static str {
        "ECSV table"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["ecsv"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        text::head(head).is_some_and(|text| text.starts_with(MARK))
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open::<Ecsv>(path, method)?)?))
    }
}

impl Separated for Ecsv {
    const NAME: &'static str = "ecsv";

    /// Reads the header, and the line of names behind it.
    fn heading(path: &Path, reader: &mut dyn BufRead) -> Result<Heading, ImportError> {
        let (mut header, mut bytes) = (Vec::new(), 0);
        let names = loop {
            let line = header_line(path, reader)?;
            let Some(comment) = line.trim_start_matches('\u{feff}').strip_prefix('#') else { break line };
            bytes += line.len();
            if bytes > LONGEST {
                return Err(ImportError::malformed(
                    path,
                    "header",
                    format!("more than {LONGEST} bytes"),
                    "a shorter one",
                ));
            }
            header.push(comment.strip_prefix(' ').unwrap_or(comment).trim_end().to_owned());
        };
        let Description { delimiter, columns } = described(path, &header)?;
        let mut names: Vec<&str> = names.trim_end_matches(['\r', '\n']).split(delimiter).collect();
        names.iter_mut().for_each(|name| *name = name.trim().trim_matches('"'));
        let stated: Vec<&str> = columns.iter().map(|column| column.name.trim()).collect();
        if names != stated {
            let shown = |names: &[&str]| {
                let shown: String = names.join(",").chars().filter(|letter| !letter.is_control()).take(60).collect();
                format!("{} ({shown})", names.len())
            };
            let expected = format!("those of the header, {}", shown(&stated));
            return Err(ImportError::malformed(path, "names of columns", shown(&names), expected));
        }
        Ok(Heading {
            is_text: columns.iter().map(|column| column.kind == Kind::Text).collect(),
            has_masks: header.iter().any(|line| names_mask(line)),
            columns: columns.iter().map(column).collect(),
            delimiter: Delimiter::Each(delimiter as u8),
            lines: header.len() as u64 + 1,
            begun: Vec::new(),
        })
    }
}

/// The column that a description is of.
fn column(described: &Described) -> Column {
    let components = match described.kind {
        Kind::Numbers(components) => components,
        Kind::Text => 1,
    };
    Column::with_unit(&described.name, &described.unit, components)
}
