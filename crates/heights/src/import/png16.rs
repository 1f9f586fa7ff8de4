//! Grey PNG pictures as heights: of 16 bits, and of fewer where heights are asked for.

#[cfg(test)]
mod tests;

use super::content::{Content, in_one_line};
use super::dimensions::dimensions;
use super::raw::Layout;
use super::unpack::{expanded, unpacked};
use super::{HeightDescription, HeightFormat, HeightSource, NoData};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::SampleType;
use png::{BitDepth, ColorType, Transformations};
use std::io::{BufRead, BufReader, Error, Read, Seek};

/// Pictures: they are heights where these are asked for.
pub(super) const PNG16: HeightFormat = HeightFormat {
    name: "png",
    extensions: &["png"],
    is_sure: |_| false,
    detect: |content| content.head.starts_with(b"\x89PNG\r\n\x1a\n"),
    open,
};

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let wrong = |error: png::DecodingError| content.malformed("data", in_one_line(&error), "a PNG picture");
    let mut decoder = png::Decoder::new(BufReader::new(content.reopened()?));
    // Text in it says nothing about the picture.
    decoder.set_ignore_text_chunk(true);
    let info = decoder.read_header_info().map_err(wrong)?;
    let (color, depth) = (info.color_type, info.bit_depth);
    if color != ColorType::Grayscale {
        return Err(content.malformed(
            "IHDR",
            format!("{color:?} of {} bits", depth as u8),
            "grey values, without colours and alpha",
        ));
    }
    let is_small = !matches!(depth, BitDepth::Eight | BitDepth::Sixteen);
    decoder.set_transformations(if is_small { Transformations::EXPAND } else { Transformations::IDENTITY });
    let sample_type = if depth == BitDepth::Sixteen { SampleType::U16 } else { SampleType::U8 };
    let mut reader = decoder.read_info().map_err(wrong)?;
    let (width, height) = reader.info().size();
    let size = dimensions(content, ("width", width.into()), ("height", height.into()), sample_type)?;
    let grid = HeightGrid::new(size[0], size[1], sample_type);
    let layout = Layout::packed(size, 0, sample_type, ByteOrder::Big);
    let bytes = layout.row_stride * size[1];
    if expanded(content.length) < bytes {
        let found = format!("at most {} bytes", expanded(content.length));
        return Err(content.malformed("data", found, format!("{bytes} ({})", grid.described())));
    }
    let samples = if reader.info().interlaced {
        let mut pixels = vec![0; bytes as usize];
        reader.next_frame(&mut pixels).map_err(wrong)?;
        unpacked(content, "data", &pixels[..], bytes, &grid.described(), |_| ())?
    } else {
        unpacked(content, "data", Rows { reader, row: Vec::new(), given: 0 }, bytes, &grid.described(), |_| ())?
    };
    let samples = samples.samples(content, "data", layout)?;
    let mut about = HeightDescription::new(content, PNG16.name, grid);
    if is_small {
        about.notes.push(format!("{} bits a sample, expanded to 8", depth as u8));
    }
    Ok(HeightSource::new(about, Box::new(samples), NoData::Nothing))
}

/// The bytes of a picture's rows.
struct Rows<R: BufRead + Seek> {
    reader: png::Reader<R>,
    row: Vec<u8>,
    given: usize,
}

impl<R: BufRead + Seek> Read for Rows<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        if self.given == self.row.len() {
            self.row.clear();
            self.given = 0;
            if let Some(row) = self.reader.next_row().map_err(|error| Error::other(in_one_line(&error)))? {
                self.row.extend_from_slice(row.data());
            }
        }
        let count = out.len().min(self.row.len() - self.given);
        out[..count].copy_from_slice(&self.row[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}
