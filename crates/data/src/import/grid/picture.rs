//! Pictures: PNG and JPEG, as images whose channels are grey or colours.

use super::content::{Content, MOST_EXPANSION, in_one_line, too_few};
use super::layout::{INTERLEAVED, Layout, NATIVE};
use super::scratch::{Scratch, Storage};
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, SampleType};
use png::{BitDepth, ColorType, Transformations};
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// PNG of every kind; palettes and less than 8 bits are expanded.
pub(super) const PNG: GridFormat = GridFormat {
    name: "png",
    extensions: &["png"],
    has_parts: false,
    detect: |content| content.head.starts_with(b"\x89PNG\r\n\x1a\n"),
    open: open_png,
};

/// JPEG, baseline and progressive.
pub(super) const JPEG: GridFormat = GridFormat {
    name: "jpeg",
    extensions: &["jpg", "jpeg"],
    has_parts: false,
    detect: |content| content.head.starts_with(b"\xff\xd8\xff"),
    open: open_jpeg,
};

/// The most of a compressed picture that is read, bytes.
const MOST_BYTES: u64 = 1 << 32;

/// The most that a picture may take where it is decoded in one piece, bytes.
const MOST_DECODED: u64 = 1 << 32;

/// Whether a picture that is decoded in one piece is small enough for that, before anything is allocated.
fn check_one_piece(path: &Path, field: &str, grid: &Grid, bytes: u64, what: &str) -> Result<(), ImportError> {
    if bytes <= MOST_DECODED {
        return Ok(());
    }
    let (found, most) = (format!("{} ({} MiB)", grid.described(), bytes >> 20), MOST_DECODED >> 20);
    Err(ImportError::malformed(path, field, found, format!("at most {most} MiB: {what} is decoded in one piece")))
}

/// A reader that can be told to go back.
pub(super) trait SeekRead: Read + Seek {}
impl<T: Read + Seek> SeekRead for T {}

/// The bytes of a compressed file in memory, a plain file where it is.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn seekable(content: &Content) -> Result<Box<dyn SeekRead>, ImportError> {
    if content.is_packed {
        return Ok(Box::new(Cursor::new(content.whole(MOST_BYTES.min(content.most()))?)));
    }
    let io = |source| ImportError::io(&content.path, "file", source);
    let mut file = std::fs::File::open(&content.path).map_err(io)?;
    file.seek(SeekFrom::Start(0)).map_err(io)?;
    Ok(Box::new(file))
}

fn open_png(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    let wrong = |error: png::DecodingError| ImportError::malformed(path, "data", in_one_line(&error), "a PNG picture");
    let mut decoder = png::Decoder::new(BufReader::new(seekable(content)?));
    // Text in it says nothing about the picture.
    decoder.set_ignore_text_chunk(true);
    let info = decoder.read_header_info().map_err(wrong)?;
    let is_expanded =
        info.color_type == ColorType::Indexed || !matches!(info.bit_depth, BitDepth::Eight | BitDepth::Sixteen);
    decoder.set_transformations(if is_expanded { Transformations::EXPAND } else { Transformations::IDENTITY });
    let mut reader = decoder.read_info().map_err(wrong)?;
    let (color, depth) = reader.output_color_type();
    let kind = if depth == BitDepth::Sixteen { SampleType::U16 } else { SampleType::U8 };
    let (width, height) = reader.info().size();
    let is_interlaced = reader.info().interlaced;
    let grid = Grid::image([width.into(), height.into()], kind, Channel::of_picture(color.samples() as u64));
    let bytes = checked(path, &grid, "IHDR", "IHDR")?;
    content.check_packed(content.most(), bytes, &grid)?;
    let storage = if is_interlaced {
        check_one_piece(path, "IHDR", &grid, bytes, "an interlaced PNG")?;
        let size = reader.output_buffer_size().filter(|&size| size as u64 == bytes);
        let size = size.ok_or_else(|| ImportError::malformed(path, "IHDR", grid.described(), "less"))?;
        let mut pixels = vec![0; size];
        reader.next_frame(&mut pixels).map_err(wrong)?;
        Storage::Memory(pixels)
    } else {
        let mut scratch = Scratch::new(path);
        let mut written = 0;
        while let Some(row) = reader.next_row().map_err(wrong)? {
            scratch.write(row.data())?;
            written += row.data().len() as u64;
        }
        if written != bytes {
            return Err(too_few(path, &format!("{written} bytes"), bytes, &grid));
        }
        scratch.into_storage()?
    };
    let mut about = GridDescription::new(path, PNG.name, content.length, grid);
    if is_expanded {
        about.notes.push("a palette or less than 8 bits, expanded to 8 bits".into());
    }
    let layout = Layout::packed(&about.grid, INTERLEAVED, 0, Order::Big);
    Ok(GridSource::new(about, storage, layout))
}

fn open_jpeg(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    let file = content.whole(MOST_BYTES.min(content.most()))?;
    let wrong = |error: &dyn std::fmt::Debug| {
        let text: String = format!("{error:?}").chars().filter(|c| !c.is_control()).take(120).collect();
        ImportError::malformed(path, "data", text, "a JPEG picture")
    };
    let options = DecoderOptions::default().set_strict_mode(true).set_max_width(65535).set_max_height(65535);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(&file), options);
    decoder.decode_headers().map_err(|error| wrong(&error))?;
    let is_grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let out = if is_grey { ColorSpace::Luma } else { ColorSpace::RGB };
    decoder.set_options(options.jpeg_set_out_colorspace(out));
    let info = decoder.info().ok_or_else(|| ImportError::missing(path, "frame", "a header of one"))?;
    let channels = Channel::of_picture(if is_grey { 1 } else { 3 });
    let grid = Grid::image([info.width.into(), info.height.into()], SampleType::U8, channels);
    let bytes = checked(path, &grid, "frame", "frame")?;
    let most = (file.len() as u64).saturating_mul(MOST_EXPANSION);
    if most < bytes {
        return Err(too_few(path, &format!("at most {most} bytes"), bytes, &grid));
    }
    check_one_piece(path, "frame", &grid, bytes, "a JPEG")?;
    let size = decoder.output_buffer_size().filter(|&size| size as u64 == bytes);
    let mut pixels = vec![0; size.ok_or_else(|| ImportError::malformed(path, "frame", grid.described(), "a picture"))?];
    decoder.decode_into(&mut pixels).map_err(|error| wrong(&error))?;
    let layout = Layout::packed(&grid, INTERLEAVED, 0, NATIVE);
    let mut about = GridDescription::new(path, JPEG.name, content.length, grid);
    about.notes.push("decoded values may differ by a few units between decoders".into());
    Ok(GridSource::new(about, Storage::Memory(pixels), layout))
}
