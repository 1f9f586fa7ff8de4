//! NRRD: a header of text and samples, in one file or two (<https://teem.sourceforge.net/nrrd/format.html>).

use super::content::{Content, filled};
use super::fields::{Entry, TypeNames, sample_type};
use super::layout::Layout;
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource, ascii};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, SampleType, Unit};
use flate2::read::MultiGzDecoder;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// NRRD, and NHDR with its samples in another file.
pub(super) const NRRD: GridFormat = GridFormat {
    name: "nrrd",
    extensions: &["nrrd", "nhdr"],
    has_parts: false,
    detect: |content| content.head.starts_with(b"NRRD000"),
    open,
};

const TYPES: TypeNames = &[
    ("signed char", SampleType::I8),
    ("int8", SampleType::I8),
    ("int8_t", SampleType::I8),
    ("uchar", SampleType::U8),
    ("unsigned char", SampleType::U8),
    ("uint8", SampleType::U8),
    ("uint8_t", SampleType::U8),
    ("short", SampleType::I16),
    ("short int", SampleType::I16),
    ("signed short", SampleType::I16),
    ("signed short int", SampleType::I16),
    ("int16", SampleType::I16),
    ("int16_t", SampleType::I16),
    ("ushort", SampleType::U16),
    ("unsigned short", SampleType::U16),
    ("unsigned short int", SampleType::U16),
    ("uint16", SampleType::U16),
    ("uint16_t", SampleType::U16),
    ("int", SampleType::I32),
    ("signed int", SampleType::I32),
    ("int32", SampleType::I32),
    ("int32_t", SampleType::I32),
    ("uint", SampleType::U32),
    ("unsigned int", SampleType::U32),
    ("uint32", SampleType::U32),
    ("uint32_t", SampleType::U32),
    ("longlong", SampleType::I64),
    ("long long", SampleType::I64),
    ("long long int", SampleType::I64),
    ("signed long long", SampleType::I64),
    ("signed long long int", SampleType::I64),
    ("int64", SampleType::I64),
    ("int64_t", SampleType::I64),
    ("ulonglong", SampleType::U64),
    ("unsigned long long", SampleType::U64),
    ("unsigned long long int", SampleType::U64),
    ("uint64", SampleType::U64),
    ("uint64_t", SampleType::U64),
    ("float", SampleType::F32),
    ("double", SampleType::F64),
];

/// The entries of a header, and the byte behind it.
struct Header<'a> {
    path: &'a Path,
    entries: HashMap<String, String>,
    end: u64,
}

impl Header<'_> {
    /// Reads `field: value` up to an empty line or the end of the file.
    fn read(content: &Content) -> Result<Header<'_>, ImportError> {
        let mut entries = HashMap::new();
        let mut at = 0;
        for line in content.head.split_inclusive(|&byte| byte == b'\n') {
            at += line.len();
            let text = String::from_utf8_lossy(line);
            let text = text.trim_end_matches(['\n', '\r']);
            if text.is_empty() {
                return Ok(Header { path: &content.path, entries, end: at as u64 });
            }
            // Comments begin with #; key:=value pairs are anybody's.
            if let Some((name, value)) = text.split_once(": ").filter(|_| !text.starts_with('#')) {
                entries.insert(name.to_lowercase().replace(' ', ""), value.trim().to_owned());
            }
        }
        // A header whose samples are elsewhere may end with its file.
        if entries.contains_key("datafile") && at < super::content::LONGEST_HEADER {
            return Ok(Header { path: &content.path, entries, end: at as u64 });
        }
        Err(ImportError::missing(&content.path, "header", "an empty line behind it"))
    }

    /// An entry, by its name as the format has it.
    fn entry<'e>(&'e self, name: &'e str) -> Option<Entry<'e>> {
        let text = self.entries.get(&name.replace(' ', ""))?;
        Some(Entry { path: self.path, name, text })
    }

    fn needed<'e>(&'e self, name: &'e str, expected: &str) -> Result<Entry<'e>, ImportError> {
        self.entry(name).ok_or_else(|| ImportError::missing(self.path, name, expected))
    }
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let header = Header::read(content)?;
    let path = &*content.path;
    let sizes: Vec<u64> = header.needed("sizes", "samples along each axis")?.values("whole numbers")?;
    let dimension: usize = header.needed("dimension", "the number of axes")?.value("a number of axes")?;
    if dimension != sizes.len() {
        return Err(ImportError::malformed(path, "sizes", format!("{} numbers", sizes.len()), format!("{dimension}")));
    }
    let kind = sample_type(header.needed("type", "the type of samples")?, TYPES)?;
    let directions = directions(&header, dimension)?;
    // Axes that lead to other values of the same place.
    let is_channel: Vec<bool> = match header.entry("kinds") {
        Some(kinds) if kinds.text.split_whitespace().count() == dimension => {
            kinds.text.split_whitespace().zip(&directions).map(|(kind, row)| row.is_none() || is_range(kind)).collect()
        }
        _ => directions.iter().map(Option::is_none).collect(),
    };
    let axes: Vec<usize> = (0..dimension).filter(|&axis| !is_channel[axis]).collect();
    if !(2..=3).contains(&axes.len()) || dimension > axes.len() + 1 {
        let found = format!("{} axes in space and {} of values", axes.len(), dimension - axes.len());
        return Err(ImportError::malformed(path, "dimension", found, "2 or 3 in space and at most one of values"));
    }
    let channel_axis = is_channel.iter().position(|is_channel| *is_channel);
    let channels = channel_axis.map_or(1, |axis| sizes[axis]);
    let mut named =
        if axes.len() == 2 { Channel::of_picture(channels.min(4097)) } else { Channel::numbered(channels.min(4097)) };
    let unit = header.entry("sample units").map(|units| Unit::new(units.text.trim_matches('"')));
    named.iter_mut().for_each(|channel| channel.unit = unit.clone().unwrap_or_default());
    let shape: Vec<u64> = axes.iter().map(|&axis| sizes[axis]).collect();
    let mut grid = match shape[..] {
        [x, y, z] => Grid::volume([x, y, z], kind, named),
        _ => Grid::image([shape[0], shape[1]], kind, named),
    };
    place(&mut grid, &header, &axes, &directions)?;
    let bytes = checked(path, &grid, "sizes", "space directions")?;
    // Axes in the order of the file, where 0 is that of values.
    let mut order = [0; 4];
    let stored = (0..dimension).map(|axis| axes.iter().position(|&space| space == axis).map_or(0, |at| at + 1));
    let missing = (0..4).filter(|axis| match axis {
        0 => channel_axis.is_none(),
        axis => *axis > axes.len(),
    });
    order.iter_mut().zip(stored.chain(missing)).for_each(|(place, axis)| *place = axis);
    let endian = header.entry("endian");
    let byte_order = match endian.map(|endian| endian.text.to_lowercase()).as_deref() {
        Some("big") => Order::Big,
        Some("little") => Order::Little,
        None if kind.size() == 1 => Order::Little,
        _ if header.entry("encoding").is_some_and(|encoding| is_ascii(encoding.text)) => Order::Little,
        Some(_) | None => {
            let missing = || ImportError::missing(path, "endian", "little or big");
            return Err(endian.map_or_else(missing, |endian| endian.wrong("little or big")));
        }
    };
    let mut about = GridDescription::new(path, NRRD.name, content.length, grid);
    if let Some(space) = header.entry("space") {
        about.notes.push(format!("directions are those of the file, whose space is {}", space.text));
    }
    let (storage, offset, order_of_bytes) = match header.entry("data file").or_else(|| header.entry("datafile")) {
        None => samples(&header, content, header.end, bytes, &about.grid)?,
        Some(name) => {
            if name.text.starts_with("LIST") || name.text.contains('%') {
                return Err(name.wrong("one file"));
            }
            let data = content.beside("data file", name.text)?;
            // The compression of the file is the encoding itself.
            let is_encoded = header.entry("encoding").is_some_and(|encoding| is_gzip(encoding.text));
            let data = if is_encoded { data.stored() } else { data };
            about.files = 2;
            about.bytes += data.length;
            samples(&header, &data, 0, bytes, &about.grid)?
        }
    };
    let layout = Layout::packed(&about.grid, order, offset, order_of_bytes.unwrap_or(byte_order));
    Ok(GridSource::new(about, storage, layout))
}

fn is_gzip(encoding: &str) -> bool {
    matches!(encoding.to_lowercase().as_str(), "gzip" | "gz")
}

fn is_ascii(encoding: &str) -> bool {
    matches!(encoding.to_lowercase().as_str(), "ascii" | "text" | "txt")
}

/// Whether an axis of this kind leads to other values of the same place.
fn is_range(kind: &str) -> bool {
    !matches!(kind.to_lowercase().as_str(), "domain" | "space" | "???" | "none")
}

/// The rows of `space directions`, or of `spacings`; `None` for an axis that leads nowhere.
fn directions(header: &Header, dimension: usize) -> Result<Vec<Option<DVec3>>, ImportError> {
    if let Some(entry) = header.entry("space directions") {
        let mut rows = Vec::new();
        let mut rest = entry.text.trim();
        while !rest.is_empty() {
            let (row, after) = if let Some(after) = rest.strip_prefix("none") {
                (None, after)
            } else {
                let inner = rest.strip_prefix('(').and_then(|rest| rest.split_once(')'));
                let (inner, after) = inner.ok_or_else(|| entry.wrong("vectors in brackets"))?;
                (Some(vector(Entry { text: inner, ..entry })?), after)
            };
            rows.push(row);
            rest = after.trim_start();
        }
        let expected = format!("{dimension} vectors");
        return if rows.len() == dimension { Ok(rows) } else { Err(entry.wrong(expected)) };
    }
    let mut steps = vec![1.0; dimension];
    if let Some(entry) = header.entry("spacings") {
        steps = entry.exactly::<f64>(dimension)?;
    }
    // Axes that are no space have the spacing NaN; the others follow x, y, z.
    let mut axis = 0;
    let has_spacings = header.entry("spacings").is_some();
    let kinds: Vec<&str> =
        header.entry("kinds").map(|kinds| kinds.text.split_whitespace().collect()).unwrap_or_default();
    Ok(steps
        .into_iter()
        .enumerate()
        .map(|(number, step)| {
            if (step.is_nan() && has_spacings) || kinds.get(number).is_some_and(|kind| is_range(kind)) {
                return None;
            }
            axis += 1;
            Some(DVec3::AXES.get(axis - 1).copied().unwrap_or(DVec3::X) * if step.is_nan() { 1.0 } else { step })
        })
        .collect())
}

/// Two or three numbers.
fn vector(entry: Entry) -> Result<DVec3, ImportError> {
    match entry.values::<f64>("two or three numbers")?[..] {
        [x, y] => Ok(DVec3::new(x, y, 0.0)),
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(entry.wrong("two or three numbers")),
    }
}

/// Puts the samples to where the header says they are.
fn place(grid: &mut Grid, header: &Header, axes: &[usize], rows: &[Option<DVec3>]) -> Result<(), ImportError> {
    let row = |axis: usize| axes.get(axis).and_then(|&axis| rows[axis]).unwrap_or(DVec3::Z);
    let is_placed = header.entry("space directions").is_some() || header.entry("spacings").is_some();
    if is_placed || axes.len() == 3 {
        let [x, y] = [row(0), row(1)];
        let across = x.cross(y);
        // The third axis of an image; one of no length says that the first two are not two.
        let z = if axes.len() == 3 { row(2) } else { across.normalize_or_zero() };
        grid.to_world = DAffine3::from_mat3(DMat3::from_cols(x, y, z));
    }
    if let Some(entry) = header.entry("space origin") {
        let inner = entry.text.trim().trim_start_matches('(').trim_end_matches(')');
        grid.to_world.translation = vector(Entry { text: inner, ..entry })?;
    }
    if let Some(entry) = header.entry("space units") {
        let first = entry.text.split('"').nth(1).unwrap_or(entry.text);
        grid.length_unit = Unit::new(first.trim());
    }
    Ok(())
}

/// The samples, the byte at which they begin in what is read, and their byte order where it is not the header's.
fn samples(
    header: &Header,
    content: &Content,
    start: u64,
    bytes: u64,
    grid: &Grid,
) -> Result<(super::scratch::Storage, u64, Option<Order>), ImportError> {
    let encoding = header.needed("encoding", "raw, ascii or gzip")?;
    let lines: u64 = header.entry("line skip").map_or(Ok(0), |entry| entry.value("a number of lines"))?;
    let skip = header.entry("byte skip");
    let skipped: i64 = skip.map_or(Ok(0), |entry| entry.value("a number of bytes"))?;
    let bad_skip = || match skip {
        Some(entry) => entry.wrong("a number of bytes within the file, or -1 with encoding raw"),
        None => ImportError::malformed(content.path.as_path(), "byte skip", skipped, "a number of bytes"),
    };
    let start = start + line_bytes(content, start, lines)?;
    match encoding.text.to_lowercase().as_str() {
        "raw" => {
            let offset = match u64::try_from(skipped) {
                Ok(skipped) => start.checked_add(skipped).ok_or_else(bad_skip)?,
                // From the file's end.
                Err(_) if skipped == -1 && !content.is_packed => content.length.saturating_sub(bytes).max(start),
                Err(_) => return Err(bad_skip()),
            };
            let storage = content.samples(offset, bytes, grid)?;
            Ok((storage, if content.is_packed { 0 } else { offset }, None))
        }
        other if is_gzip(other) => {
            let skipped = u64::try_from(skipped).map_err(|_| bad_skip())?;
            content.check_packed(content.most().saturating_sub(start), bytes, grid)?;
            let mut reader = MultiGzDecoder::new(BufReader::new(content.reader(start)?));
            let _ = std::io::copy(&mut (&mut reader).take(skipped), &mut std::io::sink());
            Ok((filled(reader, &content.path, bytes, grid)?, 0, None))
        }
        other if is_ascii(other) => {
            let skipped = u64::try_from(skipped).map_err(|_| bad_skip())?;
            let start = start.checked_add(skipped).ok_or_else(bad_skip)?;
            let most = content.most().saturating_sub(start);
            let storage = ascii::parsed(content.reader(start)?, &content.path, most, bytes, grid)?;
            Ok((storage, 0, Some(super::layout::NATIVE)))
        }
        _ => Err(encoding.wrong("raw, ascii or gzip")),
    }
}

/// The bytes of so many lines from byte `start` on.
fn line_bytes(content: &Content, start: u64, lines: u64) -> Result<u64, ImportError> {
    if lines == 0 {
        return Ok(0);
    }
    let mut reader = BufReader::new(content.reader(start)?);
    let mut bytes = 0;
    for _ in 0..lines {
        let read = reader.skip_until(b'\n').map_err(|error| ImportError::io(&content.path, "data", error))?;
        if read == 0 {
            break;
        }
        bytes += read as u64;
    }
    Ok(bytes)
}
