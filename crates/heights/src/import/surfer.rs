//! Golden Software's Surfer grids (`.grd`): text (DSAA), single precision (DSBB), and tagged blocks in double precision (DSRB). Rows go from the
//! least y on. Units are not stated.

use super::content::{Content, word};
use super::dimensions::{dimensions, distance};
use super::in_memory::InMemory;
use super::raw::{Layout, RawSamples};
use super::source::Samples;
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::SampleType;
use std::io::{BufRead, BufReader};

/// Grids of all three kinds.
pub(super) const SURFER: HeightFormat = HeightFormat {
    name: "surfer",
    extensions: &["grd"],
    is_sure: always,
    detect: |content| [TEXT, SINGLE, TAGGED].iter().any(|magic| content.head.starts_with(magic)),
    open,
};

const TEXT: &[u8] = b"DSAA";
const SINGLE: &[u8] = b"DSBB";
const TAGGED: &[u8] = b"DSRB";

/// Heights from here on are blank: what the maker's programs write is 1.70141e38, and the nearest number of single precision.
const BLANK: f64 = 1.701_41e38;

/// The longest word of a text.
const LONGEST_WORD: usize = 64;

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    match content.head.get(..4) {
        Some(TEXT) => text(content),
        Some(SINGLE) => single(content),
        _ => tagged(content),
    }
}

/// A field whose first and last columns and rows are at these places.
fn between(content: &Content, grid: &mut HeightGrid, x: [f64; 2], y: [f64; 2]) -> Result<(), ImportError> {
    grid.origin = [x[0], y[0]];
    if content.options.spacing.is_none() {
        grid.step[0] = distance(content, "x from first to last", x[1] - x[0])? / (grid.columns - 1) as f64;
        grid.step[1] = distance(content, "y from first to last", y[1] - y[0])? / (grid.rows - 1) as f64;
    }
    Ok(())
}

/// The field that these samples are.
fn source(content: &Content, grid: HeightGrid, samples: Box<dyn Samples>, blank: f64) -> HeightSource {
    let mut about = HeightDescription::new(content, SURFER.name, grid);
    about.has_spacing = true;
    HeightSource::new(about, samples, NoData::Range(blank, f64::INFINITY))
}

/// A grid in single precision behind a header of 56 bytes.
fn single(content: &Content) -> Result<HeightSource, ImportError> {
    let head = content.bytes("header", 0, 56)?;
    let count = |at: usize| i16::from_le_bytes(word(&head, at)).into();
    let size = dimensions(content, ("columns", count(4)), ("rows", count(6)), SampleType::F32)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F32);
    let number = |at: usize| f64::from_le_bytes(word(&head, at));
    between(content, &mut grid, [number(8), number(16)], [number(24), number(32)])?;
    let layout = Layout::packed(size, 56, SampleType::F32, ByteOrder::Little);
    let samples = RawSamples::new(content, "heights", layout)?;
    Ok(source(content, grid, Box::new(samples), f64::from(BLANK as f32)))
}

/// Blocks of a name, a size and as many bytes.
fn tagged(content: &Content) -> Result<HeightSource, ImportError> {
    let mut grid = None;
    let mut at = 0_u64;
    while at + 8 <= content.length {
        let head = content.bytes("block", at, 8)?;
        let size = u64::from(u32::from_le_bytes(word(&head, 4)));
        let start = at + 8;
        match head.get(..4) {
            Some(b"GRID") => grid = Some(tagged_grid(content, start, size)?),
            Some(b"DATA") => {
                let (grid, blank) = grid.ok_or_else(|| content.missing("GRID", "a block before DATA"))?;
                let layout = Layout::packed([grid.columns, grid.rows], start, SampleType::F64, ByteOrder::Little);
                let asked = layout.row_stride.saturating_mul(grid.rows);
                if size != asked {
                    let expected = format!("{asked} ({})", grid.described());
                    return Err(content.malformed("DATA", format!("{size} bytes"), expected));
                }
                let samples = RawSamples::new(content, "DATA", layout)?;
                return Ok(source(content, grid, Box::new(samples), blank));
            }
            _ => {}
        }
        at = start + size;
    }
    Err(content.missing("DATA", "a block of heights"))
}

/// The description of a tagged grid, and from where on heights are blank.
fn tagged_grid(content: &Content, start: u64, size: u64) -> Result<(HeightGrid, f64), ImportError> {
    if size < 72 {
        return Err(content.malformed("GRID", format!("{size} bytes"), "72"));
    }
    let block = content.bytes("GRID", start, 72)?;
    let count = |at: usize| i32::from_le_bytes(word(&block, at)).into();
    let number = |at: usize| f64::from_le_bytes(word(&block, at));
    let size = dimensions(content, ("columns", count(4)), ("rows", count(0)), SampleType::F64)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F64);
    grid.origin = [number(8), number(16)];
    if content.options.spacing.is_none() {
        grid.step = [distance(content, "xSize", number(24))?, distance(content, "ySize", number(32))?];
    }
    if number(56) != 0.0 {
        return Err(content.malformed("Rotation", number(56), "0: rotated grids are not read"));
    }
    let blank = number(64);
    if !blank.is_finite() {
        return Err(content.malformed("BlankValue", blank, "a finite number"));
    }
    Ok((grid, blank))
}

/// A grid of words: `DSAA`, counts, ranges of x, y and heights, and the heights.
fn text(content: &Content) -> Result<HeightSource, ImportError> {
    let mut words = Words { content, reader: BufReader::new(content.reopened()?), line: Vec::new(), count: 0 };
    words.next()?;
    let [columns, rows] = [words.number::<i64>("columns")?, words.number::<i64>("rows")?];
    let size = dimensions(content, ("columns", columns.into()), ("rows", rows.into()), SampleType::F64)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F64);
    let [x0, x1, y0, y1] = ["least x", "largest x", "least y", "largest y"].map(|field| words.number::<f64>(field));
    between(content, &mut grid, [x0?, x1?], [y0?, y1?])?;
    words.number::<f64>("least height")?;
    words.number::<f64>("largest height")?;
    let asked = grid.samples();
    // Each takes a digit and a blank at least.
    if asked > content.length / 2 {
        let expected = format!("at least {} ({})", asked.saturating_mul(2), grid.described());
        return Err(content.malformed("heights", format!("{} bytes", content.length), expected));
    }
    let mut heights = Vec::with_capacity(asked as usize);
    while let Some(word) = words.next()? {
        if heights.len() as u64 == asked {
            return Err(content.malformed(
                "heights",
                format!("more than {asked}"),
                format!("{asked} ({})", grid.described()),
            ));
        }
        let height: f64 =
            word.parse().map_err(|_| content.malformed(&format!("height {}", heights.len()), word, "a number"))?;
        heights.push(height);
    }
    if heights.len() as u64 != asked {
        return Err(content.malformed("heights", heights.len(), format!("{asked} ({})", grid.described())));
    }
    let samples = InMemory::new(grid.columns, heights);
    Ok(source(content, grid, Box::new(samples), BLANK))
}

/// The words of a text, one after the other.
struct Words<'c, R> {
    content: &'c Content,
    reader: R,
    /// The letters of the word that is being read.
    line: Vec<u8>,
    count: u64,
}

impl<R: BufRead> Words<'_, R> {
    /// The next word; `None` behind the last.
    fn next(&mut self) -> Result<Option<&str>, ImportError> {
        self.line.clear();
        self.count += 1;
        loop {
            let piece = self.reader.fill_buf().map_err(|source| ImportError::io(&self.content.path, "text", source))?;
            if piece.is_empty() {
                break;
            }
            let start = if self.line.is_empty() {
                piece.iter().take_while(|byte| byte.is_ascii_whitespace()).count()
            } else {
                0
            };
            let rest = piece.get(start..).unwrap_or_default();
            let length = rest.iter().take_while(|byte| !byte.is_ascii_whitespace()).count();
            self.line.extend_from_slice(rest.get(..length.min(LONGEST_WORD + 1)).unwrap_or_default());
            let is_whole = length < rest.len() && !self.line.is_empty();
            self.reader.consume(start + length);
            if self.line.len() > LONGEST_WORD {
                let found = String::from_utf8_lossy(&self.line).into_owned();
                return Err(self.content.malformed(&format!("word {}", self.count), found, "a number"));
            }
            if is_whole {
                break;
            }
        }
        // What is no text is no number either.
        Ok((!self.line.is_empty()).then(|| std::str::from_utf8(&self.line).unwrap_or("?")))
    }

    fn number<T: std::str::FromStr>(&mut self, field: &str) -> Result<T, ImportError> {
        let content = self.content;
        let word = self.next()?.ok_or_else(|| content.missing(field, "a number"))?;
        word.parse().map_err(|_| content.malformed(field, word, "a number"))
    }
}
