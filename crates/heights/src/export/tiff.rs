//! GeoTIFF: classic TIFF in strips, compressed with Deflate, whole numbers as differences along rows. Samples are
//! points, so that places come back without rounding.

use super::new_file::NewFile;
use super::numbers::{encode, written_type};
use super::{Export, ExportError, Exported};
use crate::model::units::{is_degrees, metres};
use crate::model::{HeightGrid, Window};
use deepfield_data::model::{SampleType, Scale};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use std::io::{Seek, SeekFrom, Write};

/// Bytes of samples that a strip has, about.
const STRIP: u64 = 1 << 18;

/// Bytes of samples that are read and compressed at once, about.
const AT_ONCE: u64 = 16 << 20;

/// Bytes that are left for all that is no samples.
const REST: u64 = 64 << 20;

/// Whole numbers of EPSG's: metre, degree, and "what the user says".
const METRE: u16 = 9001;
const DEGREE: u16 = 9102;
const USER_DEFINED: u16 = 32767;

pub(super) fn write(export: &Export) -> Result<Exported, ExportError> {
    let grid = export.grid();
    let window = export.window;
    let sample_type = type_of(grid, written_type(grid, || export.all_valid())?);
    let is_whole = !sample_type.is_float();
    let row_bytes = window.columns.saturating_mul(sample_type.size() as u64);
    let bytes = row_bytes.saturating_mul(window.rows);
    if bytes > u64::from(u32::MAX) - REST {
        let found = format!("{} x {} of {sample_type}, {} MiB", window.columns, window.rows, bytes >> 20);
        return Err(export.refused("size", found, "at most 4032 MiB of samples in a TIFF; .npy has no limit"));
    }
    let strip_rows = (STRIP / row_bytes.max(1)).clamp(1, window.rows);
    let band_rows = (AT_ONCE / row_bytes.max(1)).max(1).next_multiple_of(strip_rows);
    let mut file = NewFile::create(export.output, 0)?;
    // The directory follows the samples; its place is filled in at the end.
    file.write(b"II*\0\0\0\0\0")?;
    let mut at = 8_u64;
    let (mut offsets, mut counts) = (Vec::new(), Vec::new());
    let windows = (0..window.rows.div_ceil(band_rows)).map(|band| {
        let above = band * band_rows;
        Window { row: window.row + above, rows: band_rows.min(window.rows - above), ..window }
    });
    let mut encoded = Vec::new();
    let valid = export.each_band_of(windows, is_whole, false, |_, values| {
        encode(sample_type, values, &mut encoded);
        let strips: Vec<std::io::Result<Vec<u8>>> = encoded
            .par_chunks_mut((strip_rows * row_bytes) as usize)
            .map(|strip| {
                if is_whole {
                    strip.chunks_mut(row_bytes as usize).for_each(|row| differences(row, sample_type.size()));
                }
                let mut packer = ZlibEncoder::new(Vec::new(), Compression::new(6));
                packer.write_all(strip)?;
                packer.finish()
            })
            .collect();
        for strip in strips {
            let strip = strip.map_err(|source| file.failed(source))?;
            offsets.push(at);
            counts.push(strip.len() as u64);
            at += strip.len() as u64;
            file.write(&strip)?;
        }
        Ok(())
    })?;
    let mut tags = Tags::default();
    tags.longs(256, &[window.columns]);
    tags.longs(257, &[window.rows]);
    tags.shorts(258, &[sample_type.size() as u16 * 8]);
    tags.shorts(259, &[8]);
    tags.shorts(262, &[1]);
    tags.longs(273, &offsets);
    tags.shorts(277, &[1]);
    tags.longs(278, &[strip_rows]);
    tags.longs(279, &counts);
    tags.shorts(284, &[1]);
    tags.shorts(317, &[if is_whole { 2 } else { 1 }]);
    tags.shorts(339, &[sample_format(sample_type)]);
    place(export, &mut tags);
    if !grid.height_unit.is_unknown() {
        let unit = &grid.height_unit.0;
        tags.text(
            42112,
            &format!(
                "<GDALMetadata><Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">{unit}</Item></GDALMetadata>"
            ),
        );
    }
    if valid < window.samples() {
        tags.text(42113, "nan");
    }
    let start = at.next_multiple_of(2);
    if start > at {
        file.write(&[0])?;
    }
    let directory = tags.directory(start);
    if start + directory.len() as u64 > u64::from(u32::MAX) {
        return Err(export.refused(
            "size",
            format!("{} MiB", start >> 20),
            "less than 4 GiB in a TIFF; .npy has no limit",
        ));
    }
    file.write(&directory)?;
    let back = file.inner().seek(SeekFrom::Start(4));
    back.map_err(|source| file.failed(source))?;
    file.write(&(start as u32).to_le_bytes())?;
    file.finish()?;
    let mut done = export.done(valid);
    if !grid.planes.is_empty() {
        done.notes.push("colour planes are left out".into());
    }
    Ok(done)
}

/// Floats of 32 bits hold whole numbers of up to 16 bits as they are.
fn type_of(grid: &HeightGrid, written: SampleType) -> SampleType {
    let is_small = !grid.sample_type.is_float() && grid.sample_type.size() <= 2 && grid.scale == Scale::NONE;
    if is_small && written.is_float() { SampleType::F32 } else { written }
}

/// 1: whole numbers without a sign, 2: with one, 3: floats.
fn sample_format(sample_type: SampleType) -> u16 {
    match sample_type {
        SampleType::U8 | SampleType::U16 | SampleType::U32 | SampleType::U64 => 1,
        SampleType::I8 | SampleType::I16 | SampleType::I32 | SampleType::I64 => 2,
        SampleType::F32 | SampleType::F64 => 3,
    }
}

/// Replaces all numbers of a row but the first by what they add to the one before.
fn differences(row: &mut [u8], size: usize) {
    macro_rules! each {
        ($kind:ty, $size:literal) => {{
            let mut before: $kind = 0;
            for bytes in row.as_chunks_mut::<$size>().0 {
                let value = <$kind>::from_le_bytes(*bytes);
                *bytes = value.wrapping_sub(before).to_le_bytes();
                before = value;
            }
        }};
    }
    match size {
        1 => each!(u8, 1),
        2 => each!(u16, 2),
        4 => each!(u32, 4),
        _ => each!(u64, 8),
    }
}

/// Where samples are: a scale and a tie where rows go from north to south, else a transformation.
fn place(export: &Export, tags: &mut Tags) {
    let grid = export.grid();
    let ([dx, dy], [x, y]) = (grid.step, export.origin());
    if dx > 0.0 && dy < 0.0 {
        tags.doubles(33550, &[dx, -dy, 0.0]);
        tags.doubles(33922, &[0.0, 0.0, 0.0, x, y, 0.0]);
    } else {
        let rows = [[dx, 0.0, 0.0, x], [0.0, dy, 0.0, y], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        tags.doubles(34264, rows.as_flattened());
    }
    let epsg = grid.crs.as_deref().and_then(|crs| crs.strip_prefix("EPSG:")).and_then(|code| code.parse::<u16>().ok());
    let is_degrees = is_degrees(&grid.xy_unit);
    let length = metres(&grid.xy_unit);
    // Keys of a number each, in order; the size of a unit of the user's is in a table of its own.
    let mut keys: Vec<[u16; 4]> = Vec::new();
    let mut key = |key: u16, value: u16| keys.push([key, 0, 1, value]);
    if is_degrees || length.is_some() || epsg.is_some() {
        key(1024, if is_degrees { 2 } else { 1 });
    }
    key(1025, 2);
    if is_degrees {
        epsg.into_iter().for_each(|code| key(2048, code));
        key(2054, DEGREE);
    } else {
        epsg.into_iter().for_each(|code| key(3072, code));
        if let Some(length) = length {
            key(3076, if length == 1.0 { METRE } else { USER_DEFINED });
            if length != 1.0 {
                keys.push([3077, 34736, 1, 0]);
                tags.doubles(34736, &[length]);
            }
        }
    }
    let head = [1, 1, 0, keys.len() as u16];
    let all: Vec<u16> = head.into_iter().chain(keys.into_iter().flatten()).collect();
    tags.shorts(34735, &all);
}

/// The entries of a directory.
#[derive(Default)]
struct Tags(Vec<Tag>);

/// One of them: what it is, the type of its values, how many there are, and their bytes.
struct Tag {
    number: u16,
    kind: u16,
    count: u32,
    bytes: Vec<u8>,
}

impl Tags {
    fn put(&mut self, number: u16, kind: u16, count: usize, bytes: Vec<u8>) {
        self.0.push(Tag { number, kind, count: count as u32, bytes });
    }

    fn shorts(&mut self, number: u16, values: &[u16]) {
        self.put(number, 3, values.len(), values.iter().flat_map(|value| value.to_le_bytes()).collect());
    }

    /// Values that are below 2^32, which the caller makes sure of.
    fn longs(&mut self, number: u16, values: &[u64]) {
        self.put(number, 4, values.len(), values.iter().flat_map(|value| (*value as u32).to_le_bytes()).collect());
    }

    fn doubles(&mut self, number: u16, values: &[f64]) {
        self.put(number, 12, values.len(), values.iter().flat_map(|value| value.to_le_bytes()).collect());
    }

    fn text(&mut self, number: u16, text: &str) {
        let bytes = [text.as_bytes(), b"\0"].concat();
        self.put(number, 2, bytes.len(), bytes);
    }

    /// The bytes of a directory that begins at `start`, and of all values that do not fit in its entries.
    fn directory(mut self, start: u64) -> Vec<u8> {
        self.0.sort_by_key(|tag| tag.number);
        let mut directory = (self.0.len() as u16).to_le_bytes().to_vec();
        let after = start + 2 + 12 * self.0.len() as u64 + 4;
        let mut rest = Vec::new();
        for tag in &mut self.0 {
            directory.extend([tag.number.to_le_bytes(), tag.kind.to_le_bytes()].concat());
            directory.extend(tag.count.to_le_bytes());
            if tag.bytes.len() <= 4 {
                tag.bytes.resize(4, 0);
                directory.append(&mut tag.bytes);
            } else {
                directory.extend(((after + rest.len() as u64) as u32).to_le_bytes());
                rest.append(&mut tag.bytes);
                if rest.len() % 2 == 1 {
                    rest.push(0);
                }
            }
        }
        directory.extend([0; 4]);
        directory.append(&mut rest);
        directory
    }
}
