//! TIFF and BigTIFF: an image, or a stack of equal pages as a volume. The library decodes a page at a time.

mod directory;
mod geo;
mod stack;

use super::content::{Content, MOST_EXPANSION, in_one_line, too_few};
use super::layout::{INTERLEAVED, Layout, NATIVE};
use super::picture::seekable;
use super::scratch::Scratch;
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::model::{Channel, Grid, SampleType};
use geo::Geo;
use stack::Stack;
use std::io::{BufReader, Seek, SeekFrom};
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

/// TIFF without compression, or with LZW, deflate or PackBits.
pub(super) const TIFF: GridFormat = GridFormat {
    name: "tiff",
    extensions: &["tif", "tiff"],
    has_parts: false,
    detect: |content| {
        let starts = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];
        starts.iter().any(|start| content.head.starts_with(*start))
    },
    open,
};

/// The most pages that are read.
const MOST_PAGES: u64 = 1 << 20;

/// What all pages have to have in common.
#[derive(Clone, Copy, PartialEq)]
struct Page {
    width: u32,
    height: u32,
    color: ColorType,
    is_planar: bool,
    kind: SampleType,
}

impl Page {
    fn described(&self) -> String {
        format!("{} x {}", self.width, self.height)
    }

    fn channels(&self) -> u64 {
        self.color.num_samples().into()
    }

    /// As a grid of its own.
    fn grid(&self) -> Grid {
        let channels = match self.color {
            ColorType::Multiband { num_samples, .. } => Channel::numbered(num_samples.into()),
            ColorType::CMYK(_) | ColorType::CMYKA(_) | ColorType::YCbCr(_) | ColorType::Lab(_) => {
                Channel::numbered(self.channels())
            }
            _ => Channel::of_picture(self.channels()),
        };
        Grid::image([self.width.into(), self.height.into()], self.kind, channels)
    }
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    let wrong = |page: u64, error: tiff::TiffError| {
        ImportError::malformed(path, format!("page {page}"), in_one_line(&error), "a page that can be read")
    };
    let mut reader = BufReader::new(seekable(content)?);
    if let Some(found) = directory::excess(&mut reader, content.most()) {
        let expected = format!("no more than a file of {} bytes can hold", content.length);
        return Err(ImportError::malformed(path, "page 1", found, expected));
    }
    let rewound = reader.seek(SeekFrom::Start(0));
    rewound.map_err(|source| ImportError::io(path, "file", source))?;
    let decoder = Decoder::new(reader).map_err(|error| wrong(1, error))?;
    let mut decoder = decoder.with_limits(limits(0, content.most()));
    let first = page(&mut decoder, content, 1)?;
    let (geo, stack) = (Geo::read(&mut decoder), Stack::read(&mut decoder));
    let one = first.grid();
    let bytes = checked(path, &one, "page 1", "page 1")?;
    let most = content.most().saturating_mul(MOST_EXPANSION);
    let mut scratch = Scratch::new(path);
    let mut decoded = DecodingResult::U8(Vec::new());
    let mut pages = 0;
    loop {
        pages += 1;
        let this = page(&mut decoder, content, pages)?;
        if this != first {
            let like = |page: &Page| {
                let sizes = page.described();
                let same = (page.width, page.height) == (first.width, first.height);
                if same && this.described() == first.described() {
                    format!("{sizes} of {} {}", page.channels(), page.kind)
                } else {
                    sizes
                }
            };
            let expected = format!("{} as page 1", like(&first));
            return Err(ImportError::malformed(path, format!("page {pages}"), like(&this), expected));
        }
        if is_plain(&mut decoder) && bytes > content.most() {
            return Err(too_few(path, &format!("{} bytes", content.most()), bytes, &one));
        }
        if bytes.saturating_mul(pages) > most || pages > MOST_PAGES {
            return Err(too_few(path, &format!("at most {most} bytes"), bytes.saturating_mul(pages), &one));
        }
        decoder = decoder.with_limits(limits(bytes, content.most()));
        decoder.read_image_to_buffer(&mut decoded).map_err(|error| wrong(pages, error))?;
        let mut buffer = decoded.as_buffer(0);
        let samples = buffer.as_bytes_mut();
        if samples.len() as u64 != bytes {
            return Err(too_few(path, &format!("{} bytes in page {pages}", samples.len()), bytes, &one));
        }
        scratch.write(samples)?;
        if !decoder.more_images() {
            break;
        }
        decoder.next_image().map_err(|error| wrong(pages + 1, error))?;
    }
    let arranged = stack.as_ref().and_then(|stack| stack.arranged(&one, pages));
    let unlike = stack.as_ref().filter(|_| arranged.is_none() && pages > 1).map(|stack| stack.unlike(pages));
    let (mut grid, apart) = arranged.unwrap_or_else(|| match pages {
        1 => (one, None),
        _ => (Grid::volume([first.width.into(), first.height.into(), pages], first.kind, one.channels), None),
    });
    if let Some(stack) = &stack {
        stack.scale(&mut grid);
    }
    geo.apply(&mut grid);
    checked(path, &grid, "pages", "ModelPixelScale")?;
    // Of a page whose values lie apart, all of the first come first.
    let axes = apart.unwrap_or(if first.is_planar { [1, 2, 0, 3] } else { INTERLEAVED });
    let layout = Layout::packed(&grid, axes, 0, NATIVE);
    let mut about = GridDescription::new(path, TIFF.name, content.length, grid);
    about.notes.extend(unlike);
    if matches!(first.color, ColorType::Palette(_)) {
        about.notes.push("values are places in a palette, which is left out".into());
    }
    Ok(GridSource::new(about, scratch.into_storage()?, layout))
}

/// What the library may allocate: the samples of a page, and its tables, which are no longer than the file.
fn limits(page: u64, file: u64) -> Limits {
    let mut limits = Limits::default();
    let size = |bytes: u64| usize::try_from(bytes).unwrap_or(usize::MAX);
    // A value that is listed takes 32 bytes, in the file 2 at least.
    limits.decoding_buffer_size = size(page.max(file.saturating_mul(16)).max(1 << 20));
    limits.intermediate_buffer_size = size(page.saturating_add(file).max(1 << 16));
    limits.ifd_value_size = size(file.clamp(1 << 12, 1 << 28));
    limits
}

/// Whether a page is not compressed.
fn is_plain<R: std::io::Read + std::io::Seek>(decoder: &mut Decoder<R>) -> bool {
    decoder.find_tag_unsigned::<u16>(Tag::Compression).is_ok_and(|coding| matches!(coding, None | Some(1)))
}

/// What the page at which the decoder is holds.
fn page<R: std::io::Read + std::io::Seek>(
    decoder: &mut Decoder<R>,
    content: &Content,
    number: u64,
) -> Result<Page, ImportError> {
    let field = format!("page {number}");
    let wrong = |error: tiff::TiffError| {
        ImportError::malformed(&content.path, &*field, in_one_line(&error), "a page that can be read")
    };
    let (width, height) = decoder.dimensions().map_err(wrong)?;
    let color = decoder.colortype().map_err(wrong)?;
    let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(wrong)?.unwrap_or_default();
    let is_planar = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(wrong)? == Some(2);
    let bits = usize::from(color.bit_depth());
    let kind = match format.first().copied().unwrap_or(1) {
        3 => SampleType::float(bits / 8),
        2 => SampleType::whole(bits / 8, true),
        _ => SampleType::whole(bits / 8, false),
    };
    let kind = kind.filter(|_| bits % 8 == 0).ok_or_else(|| {
        ImportError::malformed(
            &content.path,
            &*field,
            format!("{bits} bits a sample"),
            "whole numbers or floats of 8 to 64 bits",
        )
    })?;
    Ok(Page { width, height, color, is_planar, kind })
}
