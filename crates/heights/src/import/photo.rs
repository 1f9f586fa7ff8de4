//! Photos that are laid over a field: any picture of 8 or 16 bits, read as images are.

mod orientation;

use super::content::Content;
use super::{HeightOptions, geotiff};
use crate::model::light;
use crate::model::photo::{PhotoAbout, PhotoPlace, PhotoRows};
use crate::model::{HeightError, HeightGrid, units};
use deepfield_data::import::{GridOptions, GridSource, ImportError, open_grid};
use deepfield_data::model::{ReadMethod, SampleType};
use orientation::Orientation;
use std::path::{Path, PathBuf};

/// The most pixels of a photo: sums over all of them stay exact enough for its means.
const MOST_PIXELS: u64 = 1 << 36;

/// A photo, and where it is to lie.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoChoice {
    /// The picture.
    pub path: PathBuf,
    /// x and y of two opposite corners of its outer edges, in the field's units; nothing: those of the field's first and last sample.
    pub rectangle: Option<[f64; 4]>,
}

/// A photo that is open.
#[derive(Debug)]
pub struct Photo {
    about: PhotoAbout,
    source: GridSource,
    /// Whether its rows are stored as columns.
    is_transposed: bool,
    /// Whether its rows, and its columns, are read from the last to the first.
    is_turned: [bool; 2],
    has_alpha: bool,
}

impl Photo {
    /// Opens a picture and lays it over a field. Its rows and columns run as the field's do, as in a photo that the instrument took. On a map,
    /// that is where places are degrees or there is a reference system, its top is north and its right side east, or it lies where a GeoTIFF says
    /// by itself. A JPEG is turned as its camera was held.
    ///
    /// # Errors
    /// [`ImportError`] where it cannot be read, is no picture, or would lie beside the field.
    pub fn open(choice: &PhotoChoice, grid: &HeightGrid, read: ReadMethod) -> Result<Photo, ImportError> {
        let is_map = units::is_degrees(&grid.xy_unit) || grid.crs.is_some();
        let own = if is_map && choice.rectangle.is_none() { place_of_tags(&choice.path, grid, read)? } else { None };
        let rectangle = choice.rectangle.or(own.as_ref().map(edges));
        let place = place(&PhotoChoice { rectangle, ..choice.clone() }, grid)?;
        let source = open_grid(&choice.path, &GridOptions { read, ..GridOptions::default() })?;
        let (about, picture) = (source.description(), source.grid());
        let is_picture = picture.dimensions == 2
            && matches!(picture.sample_type, SampleType::U8 | SampleType::U16)
            && (1..=4).contains(&picture.channels.len());
        let expected = "a picture of 8 or 16 bits, grey or in colours";
        if !is_picture {
            let found = format!("{}, {}", picture.kind(), picture.described());
            return Err(ImportError::malformed(&choice.path, "--texture", found, expected));
        }
        let [columns, rows, _] = picture.shape;
        if columns.checked_mul(rows).is_none_or(|pixels| pixels > MOST_PIXELS) {
            let expected = format!("at most {MOST_PIXELS} pixels");
            return Err(ImportError::malformed(&choice.path, "--texture", picture.described(), expected));
        }
        let channels = picture.channels.len();
        let held = if about.format == "jpeg" { Orientation::of_file(&choice.path) } else { Orientation::default() };
        let size = if held.is_transposed { [columns, rows] } else { [rows, columns] };
        // On a map rows go down from the north, and columns from the west on, unless the photo says otherwise.
        let [across, down] = own.map_or([1.0, -1.0], |own| own.step);
        let turns = [is_map && grid.step[1] * down < 0.0, is_map && grid.step[0] * across < 0.0];
        Ok(Photo {
            about: PhotoAbout {
                path: about.path.clone(),
                format: about.format.clone(),
                bytes: about.bytes,
                size,
                is_grey: channels < 3,
                place,
            },
            is_transposed: held.is_transposed,
            is_turned: [0, 1].map(|axis| turns[axis] != held.is_turned[axis]),
            has_alpha: channels % 2 == 0,
            source,
        })
    }
}

/// Where a GeoTIFF's pixels are, in the unit of a field on a map; `None` of other pictures, and where it does not say.
fn place_of_tags(path: &Path, grid: &HeightGrid, read: ReadMethod) -> Result<Option<HeightGrid>, ImportError> {
    let content = Content::open(path, &HeightOptions { read, ..HeightOptions::default() })?;
    if ![b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|start| content.head.starts_with(*start)) {
        return Ok(None);
    }
    let Some(mut own) = geotiff::place_of(&content)? else { return Ok(None) };
    let told = |grid: &HeightGrid| grid.crs.clone().unwrap_or_else(|| format!("places in {}", grid.xy_unit));
    let same_system = own.crs.as_ref().zip(grid.crs.as_ref()).is_none_or(|(own, other)| own == other);
    let [is_degrees, in_degrees] = [&own, grid].map(|grid| units::is_degrees(&grid.xy_unit));
    if !same_system || is_degrees != in_degrees {
        let expected = format!("{}, or the photo's edges: PHOTO@X0,Y0,X1,Y1", told(grid));
        return Err(ImportError::malformed(path, "--texture", told(&own), expected));
    }
    if let Some((own_metres, metres)) = units::metres(&own.xy_unit).zip(units::metres(&grid.xy_unit)) {
        let ratio = own_metres / metres;
        (own.origin, own.step) = (own.origin.map(|axis| ratio * axis), own.step.map(|step| ratio * step));
    }
    Ok(Some(own))
}

/// The outer edges of pixels whose middles are samples of a grid.
fn edges(grid: &HeightGrid) -> [f64; 4] {
    let [x0, y0] = grid.place(-0.5, -0.5);
    let [x1, y1] = grid.place(grid.rows as f64 - 0.5, grid.columns as f64 - 0.5);
    [x0, y0, x1, y1]
}

/// Where a photo's edges are.
fn place(choice: &PhotoChoice, grid: &HeightGrid) -> Result<PhotoPlace, ImportError> {
    let Some([x0, y0, x1, y1]) = choice.rectangle else { return Ok(PhotoPlace::whole(grid)) };
    let [one, other] = [[x0, y0], [x1, y1]].map(|corner| grid.row_column(corner));
    let ends = |axis: usize| [one[axis].min(other[axis]), one[axis].max(other[axis])];
    let place = PhotoPlace { rows: ends(0), columns: ends(1) };
    let [last_row, last_column] = [grid.rows - 1, grid.columns - 1].map(|last| last as f64);
    let meets = |[from, to]: [f64; 2], last: f64| from < last && to > 0.0;
    // A photo that repeats is where one of its copies is.
    let is_across = match place.period(grid) {
        None => meets(place.columns, last_column),
        Some(period) => {
            let ahead = (-place.columns[1] / period).floor() + 1.0;
            meets(place.columns.map(|end| ahead.mul_add(period, end)), last_column)
        }
    };
    if place.is_sound() && is_across && meets(place.rows, last_row) {
        return Ok(place);
    }
    let found = format!("a rectangle from {x0}, {y0} to {x1}, {y1}");
    let ([x0, y0], [x1, y1]) = (grid.origin, grid.place(last_row, last_column));
    let expected = format!("one with an area and a part in the field from {x0}, {y0} to {x1}, {y1}");
    Err(ImportError::malformed(&choice.path, "--texture", found, expected))
}

/// A value of 16 bits in 8.
fn of_16_bits(bytes: &[u8]) -> u8 {
    let value = u32::from(u16::from_ne_bytes([bytes[0], bytes[1]]));
    ((value * 255 + 32767) / 65535) as u8
}

/// A value of which `alpha` covers what stands where there is no photo.
fn covering(value: u8, alpha: u8) -> u8 {
    let [own, below] = [value, light::NO_PHOTO].map(|value| f64::from(light::table()[usize::from(value)]));
    light::value(below + f64::from(alpha) / 255.0 * (own - below))
}

impl PhotoRows for Photo {
    fn about(&self) -> &PhotoAbout {
        &self.about
    }

    fn memory_bytes(&self) -> u64 {
        self.source.memory_bytes()
    }

    fn rows(&self, first: u64, count: u64, out: &mut [u8]) -> Result<(), HeightError> {
        let grid = self.source.grid();
        let [rows, columns] = self.about.size;
        let from = if self.is_turned[0] { rows.saturating_sub(first + count) } else { first };
        let region = grid.region().with(usize::from(!self.is_transposed), from..from + count);
        let (width, planes, channels) = (columns as usize, self.about.planes(), grid.channels.len());
        let mut read = vec![0; count as usize * width * grid.sample_bytes() as usize];
        self.source.read(&region, &mut read)?;
        if grid.sample_type == SampleType::U16 {
            read = read.chunks_exact(2).map(of_16_bits).collect();
        }
        let high = count.max(1) as usize;
        for (index, from) in read.chunks_exact(channels).enumerate() {
            let at = if self.is_transposed { index % high * width + index / high } else { index };
            let Some(to) = out.get_mut(at * planes..(at + 1) * planes) else { continue };
            to.copy_from_slice(&from[..planes]);
            if self.has_alpha && from[planes] != u8::MAX {
                to.iter_mut().for_each(|value| *value = covering(*value, from[planes]));
            }
        }
        if self.is_turned[0] {
            turn(out, width * planes);
        }
        if self.is_turned[1] {
            out.chunks_exact_mut(width * planes).for_each(|row| turn(row, planes));
        }
        Ok(())
    }
}

/// Turns the order of pieces of a length round.
fn turn(values: &mut [u8], length: usize) {
    let count = values.len() / length.max(1);
    for piece in 0..count / 2 {
        let (head, tail) = values.split_at_mut((count - 1 - piece) * length);
        head[piece * length..(piece + 1) * length].swap_with_slice(&mut tail[..length]);
    }
}

impl PhotoChoice {
    /// Of what is written as `FILE` or `FILE@X0,Y0,X1,Y1`.
    pub fn parse(text: &str) -> Result<PhotoChoice, String> {
        if let Some((path, rectangle)) = text.rsplit_once('@') {
            let numbers: Vec<f64> = rectangle.split(',').map_while(|number| number.trim().parse().ok()).collect();
            if let (Ok(corners), 4) = (<[f64; 4]>::try_from(numbers), rectangle.split(',').count())
                && !path.is_empty()
            {
                return Ok(PhotoChoice { path: path.into(), rectangle: Some(corners) });
            }
            // A file may have the sign in its name.
            if !Path::new(text).exists() {
                return Err(format!("found {rectangle} after @, expected X0,Y0,X1,Y1"));
            }
        }
        Ok(PhotoChoice { path: text.into(), rectangle: None })
    }
}

#[cfg(test)]
mod tests;
