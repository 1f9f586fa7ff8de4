//! FITS images and cubes (<https://fits.gsfc.nasa.gov/fits_standard.html>): the first array of two or three axes. The second axis
//! goes upwards.

mod columns;
mod dither;
mod rice;
mod tiles;

use super::content::{Content, filled};
use super::fields::Entry;
use super::layout::{Layout, PLANAR};
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, SampleType, Scale, Unit};
use std::collections::HashMap;
use std::io::Read;

/// Arrays of FITS files, those compressed by tiles among them.
pub(super) const FITS: GridFormat = GridFormat {
    name: "fits",
    extensions: &["fits", "fit", "fts"],
    has_parts: false,
    detect: |content| content.head.starts_with(b"SIMPLE  =") && !holds_tables_alone(content),
    open,
};

/// Headers and data are in blocks of so many bytes.
const BLOCK: u64 = 2880;

/// The most blocks of a header that are read.
const LONGEST: usize = 1000;

/// The most parts of a file that are looked at.
const MOST_PARTS: usize = 1000;

/// The header of one part of a file.
struct Header<'a> {
    content: &'a Content,
    entries: HashMap<String, String>,
    /// The byte behind it.
    end: u64,
}

impl Header<'_> {
    /// Reads the header at byte `start`; `None` at the file's end.
    fn read(content: &Content, start: u64) -> Result<Option<Header<'_>>, ImportError> {
        let mut reader = content.reader(start)?;
        let mut entries = HashMap::new();
        let mut block = Vec::with_capacity(BLOCK as usize);
        for number in 0..LONGEST {
            block.clear();
            let read = (&mut reader).take(BLOCK).read_to_end(&mut block);
            read.map_err(|error| ImportError::io(&content.path, "header", error))?;
            if block.is_empty() && number == 0 {
                return Ok(None);
            }
            if (block.len() as u64) < BLOCK {
                let found = format!("the file's end at byte {}", content.length);
                return Err(ImportError::malformed(&content.path, "header", found, "END"));
            }
            for card in block.chunks_exact(80) {
                let card = String::from_utf8_lossy(card);
                let name = card.get(..8).unwrap_or_default().trim().to_owned();
                if name == "END" {
                    return Ok(Some(Header { content, entries, end: start + (number as u64 + 1) * BLOCK }));
                }
                if let Some(value) = card.get(8..).and_then(|rest| rest.strip_prefix("= ")) {
                    entries.entry(name).or_insert_with(|| plain(value).to_owned());
                }
            }
        }
        Err(ImportError::malformed(&content.path, "header", format!("{LONGEST} blocks"), "END before"))
    }

    fn entry<'e>(&'e self, name: &'e str) -> Option<Entry<'e>> {
        Some(Entry { path: &self.content.path, name, text: self.entries.get(name)? })
    }

    fn needed<'e>(&'e self, name: &'e str, expected: &str) -> Result<Entry<'e>, ImportError> {
        self.entry(name).ok_or_else(|| ImportError::missing(&self.content.path, name, expected))
    }

    fn whole(&self, name: &str, missing: i64) -> Result<i64, ImportError> {
        self.entry(name).map_or(Ok(missing), |entry| entry.value("a whole number"))
    }

    fn float(&self, name: &str) -> Result<Option<f64>, ImportError> {
        // Exponents may be those of double precision in Fortran.
        let value = |entry: Entry| entry.text.replace(['D', 'd'], "E").parse().map_err(|_| entry.wrong("a number"));
        self.entry(name).map(value).transpose()
    }

    /// The sizes of all axes; of an array of tiles, `ZNAXIS`, those of the array.
    fn sizes(&self, key: &str) -> Result<Vec<u64>, ImportError> {
        let count = self.needed(key, "the number of axes")?;
        let number: usize = count.value("a number of axes up to 999")?;
        if number > 999 {
            return Err(count.wrong("a number of axes up to 999"));
        }
        (1..=number)
            .map(|axis| {
                let name = format!("{key}{axis}");
                self.needed(&name, "a size")?.value("a size")
            })
            .collect()
    }

    /// Bytes of the data behind the header, blocks filled up.
    fn data_bytes(&self, sizes: &[u64]) -> Option<u64> {
        if sizes.is_empty() {
            return Some(0);
        }
        let size = self.whole("BITPIX", 8).ok()?.unsigned_abs() / 8;
        let parameters = u64::try_from(self.whole("PCOUNT", 0).ok()?).ok()?;
        let groups = u64::try_from(self.whole("GCOUNT", 1).ok()?).ok()?;
        let samples = sizes.iter().try_fold(1_u64, |all, &size| all.checked_mul(size))?;
        samples.checked_add(parameters)?.checked_mul(groups)?.checked_mul(size)?.checked_next_multiple_of(BLOCK)
    }
}

/// A value without its quotes or its comment.
fn plain(value: &str) -> &str {
    let value = value.trim();
    match value.strip_prefix('\'') {
        Some(text) => text.split('\'').next().unwrap_or_default().trim(),
        None => value.split('/').next().unwrap_or_default().trim(),
    }
}

/// Whether there are tables of rows and no image in the file, which is then one of particles.
fn holds_tables_alone(content: &Content) -> bool {
    let (mut has_table, mut start) = (false, 0);
    for part in 0..MOST_PARTS {
        // What is behind a table of a compressed file is not unpacked for this.
        if start > content.most() || has_table && content.is_packed {
            break;
        }
        let Ok(Some(header)) = Header::read(content, start) else { break };
        let Ok(sizes) = header.sizes("NAXIS") else { break };
        let is = |name: &str, text: &str| header.entry(name).is_some_and(|entry| entry.text == text);
        let is_image = part == 0 || is("XTENSION", "IMAGE");
        if is("ZIMAGE", "T") || is_image && sizes.len() >= 2 {
            return false;
        }
        has_table |= is("XTENSION", "BINTABLE");
        let Some(next) = header.data_bytes(&sizes).and_then(|bytes| bytes.checked_add(header.end)) else { break };
        start = next;
    }
    has_table
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    // A file that was cut would else show only where samples are missing.
    if !content.is_packed && !content.length.is_multiple_of(BLOCK) {
        let found = format!("{} bytes", content.length);
        return Err(ImportError::malformed(path, "length", found, format!("whole blocks of {BLOCK}")));
    }
    let (mut start, mut has_text) = (0, false);
    for part in 0..MOST_PARTS {
        let Some(header) = Header::read(content, start)? else { break };
        has_text |= header.entry("XTENSION").is_some_and(|entry| entry.text == "TABLE");
        let sizes = header.sizes("NAXIS")?;
        let is_tiled = header.entry("ZIMAGE").is_some_and(|entry| entry.text == "T");
        let is_image = is_tiled || part == 0 || header.entry("XTENSION").is_some_and(|entry| entry.text == "IMAGE");
        // Axes of one sample beyond those of a volume say nothing.
        let own = if is_tiled { header.sizes("ZNAXIS")? } else { sizes.clone() };
        let mut axes = own.clone();
        while axes.len() > 2 && axes.last() == Some(&1) {
            axes.pop();
        }
        if is_image && (2..=3).contains(&axes.len()) {
            return if is_tiled { tiles::open(&header, &axes) } else { array(&header, &axes) };
        }
        if is_image && !own.is_empty() && axes.len() != 1 {
            let found = format!("{} axes", own.len());
            return Err(ImportError::malformed(
                path,
                format!("part {part}: NAXIS"),
                found,
                "2 (an image) or 3 (a volume)",
            ));
        }
        let wrong =
            || ImportError::malformed(path, format!("part {part}: NAXIS"), format!("{sizes:?}"), "fewer samples");
        start = header.data_bytes(&sizes).and_then(|bytes| bytes.checked_add(header.end)).ok_or_else(wrong)?;
        if start >= content.most() {
            break;
        }
    }
    let expected = "an array of 2 or 3 axes, or a BINTABLE";
    Err(match has_text {
        true => ImportError::malformed(path, "XTENSION", "TABLE, rows of text", expected),
        false => ImportError::missing(path, "image", expected),
    })
}

/// The grid of a header, whose entry `bits` tells the type of samples.
fn described(header: &Header, bits: &str, axes: &[u64]) -> Result<Grid, ImportError> {
    let path = &*header.content.path;
    let kind = match header.whole(bits, 0)? {
        8 => SampleType::U8,
        16 => SampleType::I16,
        32 => SampleType::I32,
        64 => SampleType::I64,
        -32 => SampleType::F32,
        -64 => SampleType::F64,
        other => return Err(ImportError::malformed(path, bits, other, "8, 16, 32, 64, -32 or -64")),
    };
    let mut channel = Channel::new("value");
    channel.unit = Unit::new(header.entry("BUNIT").map_or("", |entry| entry.text));
    channel.scale = Scale {
        slope: header.float("BSCALE")?.unwrap_or(Scale::NONE.slope),
        intercept: header.float("BZERO")?.unwrap_or(Scale::NONE.intercept),
    };
    let blank = if bits == "BITPIX" { None } else { header.float("ZBLANK")? };
    channel.no_data = header.float("BLANK")?.or(blank).filter(|_| !kind.is_float());
    let mut grid = Grid::volume([axes[0], axes[1], axes.get(2).copied().unwrap_or(1)], kind, vec![channel]);
    grid.dimensions = axes.len();
    Ok(grid)
}

/// What FITS adds to whole numbers of 64 bits that have no sign: 2^63.
const MIDDLE: f64 = 9_223_372_036_854_775_808.0;

/// Whether samples are whole numbers of 64 bits without a sign. Double precision does not hold what is stored of them.
fn is_unsigned(grid: &Grid) -> bool {
    grid.sample_type == SampleType::I64 && grid.channels[0].scale == Scale { intercept: MIDDLE, ..Scale::NONE }
}

/// Whole numbers of 64 bits, the most significant byte first, that are stored with [`MIDDLE`] taken off: as they are.
struct Unsigned<R> {
    signed: R,
    at: u64,
}

impl<R: Read> Read for Unsigned<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let read = self.signed.read(out)?;
        let first = (self.at.next_multiple_of(8) - self.at) as usize;
        out[..read].iter_mut().skip(first).step_by(8).for_each(|byte| *byte ^= 0x80);
        self.at += read as u64;
        Ok(read)
    }
}

/// The array behind a header.
fn array(header: &Header, axes: &[u64]) -> Result<GridSource, ImportError> {
    let content = header.content;
    let path = &*content.path;
    let mut grid = described(header, "BITPIX", axes)?;
    let bytes = checked(path, &grid, "NAXIS", "NAXIS")?;
    let (storage, offset) = if is_unsigned(&grid) {
        let channel = &mut grid.channels[0];
        channel.scale = Scale::NONE;
        channel.no_data = channel.no_data.map(|stored| stored + MIDDLE);
        grid.sample_type = SampleType::U64;
        let samples = Unsigned { signed: content.reader(header.end)?, at: 0 };
        (filled(samples, path, bytes, &grid)?, 0)
    } else {
        (content.samples(header.end, bytes, &grid)?, if content.is_packed { 0 } else { header.end })
    };
    let layout = Layout::packed(&grid, PLANAR, offset, Order::Big);
    let mut about = GridDescription::new(path, FITS.name, content.length, grid);
    if let Some(axis) = header.entry("CTYPE1") {
        about.notes.push(format!("places are pixels: the header's own coordinates ({} ...) are left out", axis.text));
    }
    Ok(GridSource::new(about, storage, layout))
}
