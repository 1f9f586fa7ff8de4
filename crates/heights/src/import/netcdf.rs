//! NetCDF of any version, and data sets of HDF5: the array of two axes that is called as heights are, with places by its coordinates
//! (<https://cfconventions.org>).

use super::content::Content;
use super::dimensions::dimensions;
use super::raw::decode;
use super::source::Samples;
use super::{HeightDescription, HeightFormat, HeightSource, NoData};
use crate::model::units::known;
use crate::model::{HeightGrid, Window};
use deepfield_data::import::grid::{GridArray, grid_arrays};
use deepfield_data::import::{ByteOrder, GridOptions, GridSource, ImportError, open_grid};
use deepfield_data::model::Region;
use std::cell::RefCell;
use std::path::PathBuf;

/// Grids of heights; other arrays may be images.
pub(super) const NETCDF: HeightFormat =
    HeightFormat { name: "netcdf", extensions: &["nc", "grd", "nc4", "h5", "hdf5"], is_sure, detect, open };

/// What arrays of heights are called: by GEBCO, by GMT and its kin (ETOPO, SRTM15), by GDAL, and by others.
const NAMES: [&str; 13] = [
    "elevation",
    "z",
    "height",
    "heights",
    "altitude",
    "topo",
    "topography",
    "bathymetry",
    "relief",
    "dem",
    "surface_altitude",
    "bed",
    "Band1",
];

/// All arrays; the axis of a field at one time is left out.
fn all(content: &Content) -> Result<Vec<GridArray>, ImportError> {
    let mut found = grid_arrays(&content.path)?;
    for array in &mut found {
        let ones = array.shape.iter().take_while(|count| **count == 1).count();
        array.shape.drain(..ones.min(array.shape.len().saturating_sub(2)));
    }
    Ok(found)
}

/// The arrays of two axes: those that are called as heights are come first, and of several the largest.
fn arrays(content: &Content) -> Result<Vec<GridArray>, ImportError> {
    let mut found = all(content)?;
    found.retain(|array| array.shape.len() == 2);
    let samples = |array: &GridArray| array.shape.iter().copied().fold(1, u64::saturating_mul);
    found.sort_by_key(|array| (!is_named(array), std::cmp::Reverse(samples(array))));
    Ok(found)
}

/// Whether an array is called as heights are.
fn is_named(array: &GridArray) -> bool {
    let name = array.name.rsplit('/').next().unwrap_or_default();
    NAMES.iter().any(|known| known.eq_ignore_ascii_case(name))
}

/// Whether it begins as one of the formats does, and has an array of two axes.
fn detect(content: &Content) -> bool {
    let marks = [&b"CDF\x01"[..], b"CDF\x02", b"CDF\x05", b"\x89HDF\r\n\x1a\n"];
    // What is damaged says so when it is opened as what it claims to be.
    marks.iter().any(|mark| content.head.starts_with(mark)) && arrays(content).is_ok_and(|arrays| !arrays.is_empty())
}

/// There is no volume, and one array is called as heights are, the values of which are lengths or say nothing.
fn is_sure(content: &Content) -> bool {
    all(content).is_ok_and(|arrays| {
        let named: Vec<&GridArray> = arrays.iter().filter(|array| is_named(array)).collect();
        let is_length =
            |array: &GridArray| array.unit.trim().is_empty() || known(&array.unit).is_some_and(|unit| unit.0 != "deg");
        arrays.iter().all(|array| array.shape.len() == 2) && named.len() == 1 && is_length(named[0])
    })
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let arrays = arrays(content)?;
    let Some(array) = arrays.first() else {
        return Err(content.missing("arrays", "one of 2 axes: rows and columns of heights"));
    };
    let mut named = content.path.clone().into_os_string();
    named.push("#");
    named.push(&array.name);
    let options = GridOptions { read: content.options.read, ..GridOptions::default() };
    let source = open_grid(&PathBuf::from(named), &options)?;
    let about = source.description().clone();
    let (found, channel) = (&about.grid, about.grid.channels.first());
    let shown = format!("{} ({} axes)", array.name, found.dimensions);
    let ([columns, rows, _], true) = (found.shape, found.dimensions == 2) else {
        return Err(content.malformed("arrays", shown, "one of 2 axes: rows and columns of heights"));
    };
    let size = dimensions(content, (&array.name, columns.into()), (&array.name, rows.into()), found.sample_type)?;
    let mut grid = HeightGrid::new(size[0], size[1], found.sample_type);
    let matrix = found.to_world.matrix3;
    grid.step = [matrix.x_axis.x, matrix.y_axis.y];
    grid.origin = [found.to_world.translation.x, found.to_world.translation.y];
    let mut notes = about.notes;
    let mut no_data = NoData::Nothing;
    let mut unit_of = |unit: &str, what: &str| {
        let known = known(unit);
        if known.is_none() && !unit.trim().is_empty() {
            notes.push(format!("{what} are in {unit:?}, which is not known"));
        }
        known.unwrap_or_default()
    };
    grid.xy_unit = unit_of(&found.length_unit.0, "x and y");
    if let Some(channel) = channel {
        grid.height_unit = unit_of(&channel.unit.0, "heights");
        grid.scale = channel.scale;
        no_data = channel.no_data.map_or(NoData::Nothing, NoData::Value);
    }
    if grid.height_unit.0 == "deg" {
        return Err(content.malformed(&array.name, "degrees", "heights: lengths"));
    }
    let others: Vec<&str> = arrays.iter().skip(1).take(8).map(|array| array.name.as_str()).collect();
    if !others.is_empty() {
        notes.push(format!("other arrays are left out: {}", others.join(", ")));
    }
    // Without coordinates samples are 1 apart.
    let has_spacing = grid.step != [1.0; 2] || !found.length_unit.is_unknown();
    let mut description = HeightDescription::new(content, NETCDF.name, grid);
    (description.has_spacing, description.notes) = (has_spacing, notes);
    Ok(HeightSource::new(description, Box::new(GridSamples(source)), no_data))
}

thread_local! {
    /// Bytes on their way from a grid, one buffer a thread.
    static BYTES: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Rows that are read at once where a window has more: bytes.
const AT_ONCE: u64 = 4 << 20;

/// The samples of an image.
struct GridSamples(GridSource);

impl Samples for GridSamples {
    fn read(&self, window: Window, out: &mut [f64]) -> Result<(), ImportError> {
        let kind = self.0.grid().sample_type;
        let row_bytes = (window.columns * kind.size() as u64).max(1);
        let rows = (AT_ONCE / row_bytes).max(1);
        BYTES.with_borrow_mut(|bytes| {
            for (part, out) in out.chunks_mut((rows * window.columns).max(1) as usize).enumerate() {
                let first = window.row + part as u64 * rows;
                let count = out.len() as u64 / window.columns.max(1);
                bytes.resize((count * row_bytes) as usize, 0);
                let region =
                    Region { min: [window.column, first, 0], max: [window.column + window.columns, first + count, 1] };
                self.0.read(&region, bytes)?;
                decode(kind, ByteOrder::NATIVE, bytes, kind.size(), out, |value| value);
            }
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests;
