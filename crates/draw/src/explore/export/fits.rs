//! FITS binary tables (<https://fits.gsfc.nasa.gov/fits_standard.html>, section 7.3), in the first extension. Every number is a double
//! (`D`), but for the family, Gadget's number as a byte (255: another family), and ids, which are unsigned by the standard's convention
//! for these (`K` with `TZERO` 2^63). What a family does not have is not a number.

use super::stated::Stated;
use super::{Block, Layout, Out, Table};
use std::io::{self, Seek, SeekFrom, Write};

/// Headers and data are in blocks of so many bytes.
const BLOCK: usize = 2880;

/// Bytes of an entry of a header.
const CARD: usize = 80;

/// The most columns that a table may have.
const MOST_COLUMNS: usize = 999;

/// The longest text of an entry.
const LONGEST: usize = 68;

/// The bit that tells unsigned numbers from those that are stored for them.
const SIGN: u64 = 1 << 63;

pub(super) struct Fits<'a> {
    out: Out<'a>,
    row_bytes: usize,
    rows: u64,
}

impl<'a> Fits<'a> {
    /// `about`: names and texts of what is said of the whole table.
    pub(super) fn new(
        mut out: Out<'a>,
        layout: &Layout,
        stated: &Stated,
        about: &[(String, String)],
    ) -> io::Result<Fits<'a>> {
        let columns = 1 + usize::from(layout.has_ids) + layout.columns.len();
        if columns > MOST_COLUMNS {
            let message = format!("{columns} columns, expected at most {MOST_COLUMNS}, as many as FITS has");
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        let row_bytes = 1 + 8 * (columns - 1);
        let mut first = Cards::default();
        first.value("SIMPLE", "T", "FITS standard");
        first.value("BITPIX", 8, "");
        first.value("NAXIS", 0, "the table is in the first extension");
        first.value("EXTEND", "T", "");
        out.write_all(&first.finish())?;
        let mut cards = Cards::default();
        cards.text("XTENSION", "BINTABLE");
        cards.value("BITPIX", 8, "");
        cards.value("NAXIS", 2, "");
        cards.value("NAXIS1", row_bytes, "bytes of a row");
        debug_assert_eq!(cards.0.len() / CARD, ROWS_CARD);
        cards.rows(0);
        cards.value("PCOUNT", 0, "");
        cards.value("GCOUNT", 1, "");
        cards.value("TFIELDS", columns, "columns");
        cards.text("EXTNAME", "PARTICLES");
        let mut number = 1;
        cards.column(number, "family", "B", "");
        cards.text(&format!("TCOMM{number}"), "type of Gadget, 255: another family");
        if layout.has_ids {
            number += 1;
            cards.column(number, "id", "K", "");
            cards.value(&format!("TZERO{number}"), SIGN, "unsigned");
            if !layout.all_have_ids {
                cards.value(&format!("TNULL{number}"), i64::MAX, "no id");
            }
        }
        for column in &layout.columns {
            number += 1;
            let unit = &*column.unit.0;
            let has = |name: &str| unit.split(|c: char| !c.is_ascii_alphabetic()).any(|word| word == name);
            // To FITS a is a year and h an hour.
            let meaning = match (has("a"), has("h")) {
                (false, false) => {
                    cards.column(number, &column.name, "D", unit);
                    continue;
                }
                (true, false) => "a: scale factor",
                (false, true) => "h: H0 by 100 km/s/Mpc",
                (true, true) => "a: scale factor, h: H0 by 100 km/s/Mpc",
            };
            cards.column(number, &column.name, "D", "");
            if unit.len() < LONGEST / 2 {
                cards.text(&format!("TCOMM{number}"), &format!("unit: {unit}; {meaning}"));
            }
        }
        for (key, value) in [("TIME", stated.time), ("REDSHIFT", stated.redshift), ("BOXSIZE", stated.box_size)] {
            if let Some(value) = value.filter(|value| value.is_finite()) {
                cards.value(key, format_args!("{value:E}"), "");
            }
        }
        for (name, text) in about {
            cards.card(&format!("COMMENT {name}: {text}"));
        }
        out.write_all(&cards.finish())?;
        Ok(Fits { out, row_bytes, rows: 0 })
    }
}

/// Which entry of the table's header is the number of rows, which is known when all are written.
const ROWS_CARD: usize = 4;

/// Entries of a header.
#[derive(Default)]
struct Cards(Vec<u8>);

impl Cards {
    /// An entry as it stands; what is no letter of a header is a question mark, and what is too long is cut.
    fn card(&mut self, text: &str) {
        let letters = text.chars().map(|letter| if matches!(letter, ' '..='~') { letter as u8 } else { b'?' });
        let end = self.0.len() + CARD;
        self.0.extend(letters.take(CARD));
        self.0.resize(end, b' ');
    }

    /// A number, or whether something is so.
    fn value(&mut self, key: &str, value: impl ToString, comment: &str) {
        let comment = if comment.is_empty() { String::new() } else { format!(" / {comment}") };
        self.card(&format!("{key:<8}= {:>20}{comment}", value.to_string()));
    }

    /// A text, of which what is too long is cut.
    fn text(&mut self, key: &str, text: &str) {
        let mut quoted = String::new();
        for letter in text.chars() {
            let letter = if letter == '\'' { "''".to_owned() } else { letter.to_string() };
            if quoted.chars().count() + letter.len() > LONGEST {
                break;
            }
            quoted.push_str(&letter);
        }
        self.card(&format!("{key:<8}= '{quoted:<8}'"));
    }

    /// The number of rows.
    fn rows(&mut self, rows: u64) {
        self.value("NAXIS2", rows, "rows");
    }

    /// A column. A unit that is too long for an entry is left out: half of one would be another.
    fn column(&mut self, number: usize, name: &str, form: &str, unit: &str) {
        // The standard's names have letters, digits and these.
        let letter = |letter: char| if letter.is_ascii_alphanumeric() { letter } else { '_' };
        self.text(&format!("TTYPE{number}"), &name.chars().map(letter).collect::<String>());
        self.text(&format!("TFORM{number}"), form);
        if !unit.is_empty() && unit.replace('\'', "''").chars().count() <= LONGEST {
            self.text(&format!("TUNIT{number}"), unit);
        }
    }

    fn finish(mut self) -> Vec<u8> {
        self.card("END");
        self.0.resize(self.0.len().next_multiple_of(BLOCK), b' ');
        self.0
    }
}

impl Table for Fits<'_> {
    type Piece = (Vec<u8>, usize);

    fn prepare(block: Block) -> (Vec<u8>, usize) {
        block.packed(|id| (id ^ SIGN).to_be_bytes(), f64::to_be_bytes)
    }

    fn write(&mut self, (bytes, rows): (Vec<u8>, usize)) -> io::Result<()> {
        self.rows += rows as u64;
        self.out.write_all(&bytes)
    }

    fn finish(mut self) -> io::Result<u64> {
        let in_last = self.rows.wrapping_mul(self.row_bytes as u64) % BLOCK as u64;
        if in_last > 0 {
            self.out.write_all(&vec![0; BLOCK - in_last as usize])?;
        }
        self.out.flush()?;
        let mut card = Cards::default();
        card.rows(self.rows);
        let file = self.out.get_mut();
        file.seek(SeekFrom::Start((BLOCK + ROWS_CARD * CARD) as u64))?;
        file.write_all(&card.0)?;
        Ok(self.rows)
    }
}
