//! TIFF and BigTIFF of one value a pixel, with what GeoTIFF and GDAL say of their place. Strips and tiles are unpacked
//! when they are read, so that a large file is read in bands.

mod chunks;
mod coding;
mod directory;
mod geo;
mod lerc;
mod metadata;
#[cfg(test)]
mod tests;

use super::content::Content;
use super::dimensions::dimensions;
use super::raw::{Layout, RawSamples};
use super::source::Samples;
use super::unpack::expanded;
use super::{HeightDescription, HeightFormat, HeightSource};
use crate::model::HeightGrid;
use chunks::Chunks;
use coding::Coding;
use deepfield_data::import::ImportError;
use deepfield_data::model::SampleType;
use directory::Directory;
use geo::Geo;

/// Grey TIFF; such without a place may be images.
pub(super) const GEOTIFF: HeightFormat = HeightFormat {
    name: "geotiff",
    extensions: &["tif", "tiff"],
    is_sure,
    detect: |content| [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|start| content.head.starts_with(*start)),
    open,
};

/// Numbers of entries, as the format has them.
mod tag {
    pub(super) const SUBFILE: u16 = 254;
    pub(super) const WIDTH: u16 = 256;
    pub(super) const LENGTH: u16 = 257;
    pub(super) const BITS: u16 = 258;
    pub(super) const COMPRESSION: u16 = 259;
    pub(super) const PHOTOMETRIC: u16 = 262;
    pub(super) const STRIP_OFFSETS: u16 = 273;
    pub(super) const SAMPLES: u16 = 277;
    pub(super) const STRIP_ROWS: u16 = 278;
    pub(super) const STRIP_BYTES: u16 = 279;
    pub(super) const PREDICTOR: u16 = 317;
    pub(super) const TILE_WIDTH: u16 = 322;
    pub(super) const TILE_LENGTH: u16 = 323;
    pub(super) const TILE_OFFSETS: u16 = 324;
    pub(super) const TILE_BYTES: u16 = 325;
    pub(super) const FORMAT: u16 = 339;
    pub(super) const SCALE: u16 = 33550;
    pub(super) const TIE: u16 = 33922;
    pub(super) const TRANSFORMATION: u16 = 34264;
    pub(super) const KEYS: u16 = 34735;
    pub(super) const KEY_NUMBERS: u16 = 34736;
    pub(super) const METADATA: u16 = 42112;
    pub(super) const NO_DATA: u16 = 42113;
    pub(super) const LERC: u16 = 50674;
}

/// One value of more than 8 bits a pixel, with a place or a value for no data.
fn is_sure(content: &Content) -> bool {
    let says = |directory: &Directory| {
        let has_place =
            [tag::SCALE, tag::TRANSFORMATION, tag::KEYS, tag::NO_DATA].iter().any(|tag| directory.has(*tag));
        has_place && sample_type(directory).is_ok_and(|kind| kind.size() > 1)
    };
    Directory::first(content).is_ok_and(|directory| says(&directory))
}

/// Where the pixels of a picture are, as its entries say: its size, place, unit and reference system. `None` where they say no place.
///
/// # Errors
/// Where entries are damaged, or pixels are turned.
pub(super) fn place_of(content: &Content) -> Result<Option<HeightGrid>, ImportError> {
    let directory = Directory::first(content)?;
    let size = |tag: u16, name: &str| directory.needed(tag, name);
    let (width, length) = (size(tag::WIDTH, "ImageWidth")?, size(tag::LENGTH, "ImageLength")?);
    let mut grid = HeightGrid::new(width, length, SampleType::U8);
    let is_placed = Geo::read(&directory, SampleType::U8)?.apply(&mut grid, &mut Vec::new());
    Ok(is_placed.then_some(grid))
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let directory = Directory::first(content)?;
    let kind = sample_type(&directory)?;
    let count = |tag: u16, name: &str| directory.needed(tag, name);
    let (width, length) = (count(tag::WIDTH, "ImageWidth")?, count(tag::LENGTH, "ImageLength")?);
    let size = dimensions(content, ("ImageWidth", width.into()), ("ImageLength", length.into()), kind)?;
    let mut grid = HeightGrid::new(size[0], size[1], kind);
    let mut notes = Vec::new();
    let geo = Geo::read(&directory, kind)?;
    let has_spacing = geo.apply(&mut grid, &mut notes);
    metadata::apply(&directory, &mut grid)?;

    let coding = Coding::read(&directory, kind)?;
    let chunks = Chunks::read(&directory, size, kind, coding)?;
    let bytes = grid.samples() * kind.size() as u64;
    // Chunks may lie over each other, and one that is left out takes no bytes.
    let [there, left_out] = chunks.all_bytes();
    if coding.expanded(content.length).saturating_add(1 << 20) < there || 2 * expanded(content.length) < left_out {
        let found = format!("{} bytes in the file", content.length);
        return Err(content.malformed(
            "samples",
            found,
            format!("{bytes} ({}), or what can be unpacked to so many", grid.described()),
        ));
    }
    let samples: Box<dyn Samples> = match chunks.in_place() {
        Some(offset) => {
            Box::new(RawSamples::new(content, "strips", Layout::packed(size, offset, kind, directory.order))?)
        }
        None => Box::new(chunks.samples(geo.no_data_value())),
    };
    if directory.has_another_image() {
        notes.push("further images of the file are left out".into());
    }
    let mut about = HeightDescription::new(content, GEOTIFF.name, grid);
    (about.has_spacing, about.notes) = (has_spacing, notes);
    Ok(HeightSource::new(about, samples, geo.no_data))
}

/// What pixels are stored in.
///
/// # Errors
/// Where they are no single numbers of whole bytes.
fn sample_type(directory: &Directory) -> Result<SampleType, ImportError> {
    let content = directory.content;
    let number = |tag: u16, usual: u64| Ok::<u64, ImportError>(directory.number(tag)?.unwrap_or(usual));
    let (samples, photometric) = (number(tag::SAMPLES, 1)?, number(tag::PHOTOMETRIC, 1)?);
    let expected = "one value a pixel: heights";
    if samples != 1 {
        let what = if photometric == 2 { ": RGB" } else { "" };
        return Err(content.malformed("SamplesPerPixel", format!("{samples}{what}"), expected));
    }
    match photometric {
        0 | 1 => {}
        2 => return Err(content.malformed("PhotometricInterpretation", "RGB", expected)),
        3 => return Err(content.malformed("PhotometricInterpretation", "a palette of colours", expected)),
        other => return Err(content.malformed("PhotometricInterpretation", other, expected)),
    }
    let (bits, format) = (number(tag::BITS, 1)?, number(tag::FORMAT, 1)?);
    let bytes = if bits.is_multiple_of(8) { (bits / 8) as usize } else { 0 };
    let (kind, name) = match format {
        1 => (SampleType::whole(bytes, false), "whole numbers"),
        2 => (SampleType::whole(bytes, true), "whole numbers with a sign"),
        3 => (SampleType::float(bytes), "floats"),
        5 | 6 => (None, "complex numbers"),
        _ => (None, "values without a type"),
    };
    kind.ok_or_else(|| {
        let expected = "whole numbers of 8, 16, 32 or 64 bits, or floats of 32 or 64";
        content.malformed("BitsPerSample", format!("{name} of {bits} bits"), expected)
    })
}
