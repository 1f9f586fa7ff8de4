//! Digital Surf's surfaces (`.sur`): a header of 512 bytes in Latin-1, a comment, then whole numbers of 16 or 32 bits, as they are or compressed.
//!
//! Offsets are those of the maker's description of the format. Steps have a unit each; the "length" units beside them are how the maker's program
//! shows lengths, and say nothing about the steps.

use super::content::{Content, latin1, word};
use super::dimensions::{dimensions, distance};
use super::raw::{Layout, RawSamples};
use super::unpack::{expanded, unpacked};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always, units};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{SampleType, Scale};
use flate2::read::ZlibDecoder;
use std::io::Read;

/// Surfaces, plain and compressed.
pub(super) const SUR: HeightFormat = HeightFormat {
    name: "sur",
    extensions: &["sur"],
    is_sure: always,
    detect: |content| content.head.starts_with(PLAIN) || content.head.starts_with(PACKED),
    open,
};

const PLAIN: &[u8] = b"DIGITAL SURF";
const PACKED: &[u8] = b"DSCOMPRESSED";

/// Bytes of the header.
const HEADER: usize = 512;

/// The most streams that compressed samples are cut into.
const MOST_STREAMS: u32 = 4096;

/// What is in a file, by its number in the header. Those that begin with a surface are read.
fn object(kind: i16) -> (&'static str, bool) {
    match kind {
        1 => ("a profile", false),
        2 => ("a surface", true),
        3 => ("a binary image", false),
        4 => ("a series of profiles", false),
        5 => ("a series of surfaces", false),
        8 => ("a surface of several layers", true),
        10 => ("an intensity image", false),
        11 => ("a surface and an intensity image", true),
        12 => ("a colour image", false),
        13 => ("a surface and a colour image", true),
        16 => ("a surface, a colour image and an intensity image", true),
        _ => ("another object", false),
    }
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let Some(head) = content.head.get(..HEADER) else {
        return Err(content.malformed("header", format!("{} bytes", content.length), format!("{HEADER}")));
    };
    let i16_at = |at: usize| i16::from_le_bytes(word(head, at));
    let i32_at = |at: usize| i32::from_le_bytes(word(head, at));
    let f32_at = |at: usize| f64::from(f32::from_le_bytes(word(head, at)));
    let text_at = |at: usize| latin1(head.get(at..at + 16).unwrap_or_default());
    if i16_at(12) == 257 {
        return Err(content.malformed("byte order", "257 (Macintosh)", "0 (least significant byte first)"));
    }
    let sample_type = match i16_at(98) {
        16 => SampleType::I16,
        32 => SampleType::I32,
        other => return Err(content.malformed("bits of a sample", other, "16 or 32")),
    };
    let (columns, rows) = (i32_at(108), i32_at(112));
    let kind = i16_at(18);
    let (name, is_read) = object(kind);
    // Some programs write surfaces as profiles of several rows.
    if !(is_read || kind == 1 && rows > 1) {
        return Err(content.malformed(
            "object",
            format!("{kind} ({name})"),
            "2 (a surface), or one with colours or intensities",
        ));
    }
    let stated = (("samples of a row", columns.into()), ("rows", rows.into()));
    let size = dimensions(content, stated.0, stated.1, sample_type)?;
    let mut grid = HeightGrid::new(size[0], size[1], sample_type);

    let [x_unit, y_unit, z_unit] = [180, 196, 212].map(text_at);
    let told = &content.options;
    let places = [
        units::length(content, "unit of x steps", &x_unit, &y_unit, told.xy_unit.as_ref(), "--xy-unit")?,
        units::length(content, "unit of y steps", &y_unit, &x_unit, told.xy_unit.as_ref(), "--xy-unit")?,
    ];
    grid.height_unit =
        units::length(content, "unit of heights", &z_unit, &x_unit, told.height_unit.as_ref(), "--height-unit")?;
    let step = [f32_at(120), f32_at(124)];
    let (in_one, unit) = units::in_one_unit(step, &places);
    grid.xy_unit = unit;
    if told.spacing.is_none() {
        distance(content, "x step", step[0])?;
        distance(content, "y step", step[1])?;
        grid.step = in_one;
    }
    let begins = [f32_at(466), f32_at(470)];
    if begins.iter().all(|place| place.is_finite()) {
        let begins = units::in_one_unit(begins, &places).0;
        // What is far less than a step is what rounding has left of 0.
        grid.origin =
            [0, 1].map(|axis| if begins[axis].abs() < 1e-3 * grid.step[axis].abs() { 0.0 } else { begins[axis] });
    }
    grid.scale = Scale { slope: f32_at(128), intercept: f32_at(474) };

    let mut about = HeightDescription::new(content, SUR.name, grid);
    about.has_spacing = true;
    let samples = about.grid.samples();
    let counted = i64::from(i32_at(116));
    if u64::try_from(counted) != Ok(samples) {
        about.notes.push(format!("the header counts {counted} samples, {} x {} are {samples}", size[0], size[1]));
    }
    if kind > 2 {
        about.notes.push(format!("the file holds {name}: the surface is read"));
    }
    // What is below the least height is no height, whatever the flag says.
    let special = f64::from(i32_at(100)) - 2.0;
    if i16_at(86) == 0 {
        about.notes.push(format!(
            "the header says that every sample was measured: those of {special}, below its least one, are not, if any"
        ));
    }
    let (comment, private) = (i16_at(334), i16_at(336));
    let (Ok(comment), Ok(private)) = (u64::try_from(comment), u64::try_from(private)) else {
        return Err(content.malformed("size of the comment", format!("{comment} and {private}"), "0 or more"));
    };
    let start = HEADER as u64 + comment + private;
    let samples = if content.head.starts_with(PACKED) {
        packed_samples(content, start, size, sample_type)?
    } else {
        RawSamples::new(content, "samples", Layout::packed(size, start, sample_type, ByteOrder::Little))?
    };
    Ok(HeightSource::new(about, Box::new(samples), NoData::Value(special)))
}

/// Compressed samples: a number of streams, of each its size unpacked and packed, then the streams.
fn packed_samples(
    content: &Content,
    start: u64,
    size: [u64; 2],
    sample_type: SampleType,
) -> Result<RawSamples, ImportError> {
    let field = "compressed samples";
    let layout = Layout::packed(size, 0, sample_type, ByteOrder::Little);
    let bytes = layout.row_stride * size[1];
    let asked = format!("{} x {} of {sample_type}", size[0], size[1]);
    let streams = u32::from_le_bytes(word(&content.bytes("number of streams", start, 4)?, 0));
    if !(1..=MOST_STREAMS).contains(&streams) {
        return Err(content.malformed("number of streams", streams, format!("1 to {MOST_STREAMS}")));
    }
    let directory = content.bytes("sizes of streams", start + 4, u64::from(streams) * 8)?;
    let sizes: Vec<[u64; 2]> = directory
        .as_chunks::<8>()
        .0
        .iter()
        .map(|entry| [0, 4].map(|at| u64::from(u32::from_le_bytes(word(entry, at)))))
        .collect();
    let [total, packed] = [0, 1].map(|of| sizes.iter().map(|size| size[of]).sum::<u64>());
    if total != bytes {
        return Err(content.malformed(field, format!("{total} bytes"), format!("{bytes} ({asked})")));
    }
    let first = start + 4 + directory.len() as u64;
    content.check(field, first, packed)?;
    if expanded(packed) < bytes {
        return Err(content.malformed(
            field,
            format!("at most {} bytes", expanded(packed)),
            format!("{bytes} ({asked})"),
        ));
    }
    let reader = Streams { content, at: first, sizes: sizes.into_iter(), current: None };
    unpacked(content, field, reader, bytes, &asked, |_| ())?.samples(content, field, layout)
}

/// What streams that follow each other in a file hold, one after the other.
struct Streams<'c> {
    content: &'c Content,
    /// Where the next one begins.
    at: u64,
    /// Of those that are left: bytes unpacked and packed.
    sizes: std::vec::IntoIter<[u64; 2]>,
    current: Option<ZlibDecoder<Part<'c>>>,
}

impl Read for Streams<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        loop {
            if let Some(current) = &mut self.current {
                let count = current.read(out)?;
                if count > 0 || out.is_empty() {
                    return Ok(count);
                }
            }
            let Some([_, packed]) = self.sizes.next() else { return Ok(0) };
            self.current = Some(ZlibDecoder::new(Part { content: self.content, at: self.at, end: self.at + packed }));
            self.at += packed;
        }
    }
}

/// A part of a file, read from its start to its end.
struct Part<'c> {
    content: &'c Content,
    at: u64,
    end: u64,
}

impl Read for Part<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = out.len().min(usize::try_from(self.end - self.at).unwrap_or(usize::MAX));
        let out = out.get_mut(..count).unwrap_or_default();
        self.content.file().read_exact_at(out, self.at)?;
        self.at += count as u64;
        Ok(count)
    }
}
