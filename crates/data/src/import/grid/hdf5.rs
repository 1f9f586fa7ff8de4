//! Data sets of HDF5 files, those of NetCDF 4 among them. The last axis is x.

use super::content::{Content, too_few};
use super::conventions::{self, About, Coordinates};
use super::layout::{Layout, NATIVE, PLANAR};
use super::scratch::Scratch;
use super::source::checked;
use super::{GridArray, GridDescription, GridFormat, GridSource, choice};
use crate::import::ImportError;
use crate::import::hdf5::{Array, Attributes, H5, is_hdf5, is_of_particles};
use crate::import::table::are_columns;
use crate::model::{Channel, Grid};

/// HDF5: the data set that is named behind the file, else the only one that is a grid. Files of particles, and tables, are left to their
/// formats, unless a data set is named.
pub(super) const HDF5: GridFormat =
    GridFormat { name: "hdf5", extensions: &["h5", "hdf5", "nc4"], has_parts: true, detect, open };

/// The name of NetCDF 4 in `info`.
const NETCDF: &str = "netcdf";

impl About for Attributes {
    fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        Attributes::numbers(self, name)
    }

    fn text(&self, name: &str) -> Option<String> {
        Attributes::text(self, name)
    }
}

/// What the numbers of a data set mean: their unit and scale, and which of them stands for none.
pub(in crate::import) fn variable(name: &str, about: &Attributes) -> Channel {
    conventions::channel(name, about)
}

fn detect(content: &Content) -> bool {
    is_hdf5(&content.head) && holds_grids(content).unwrap_or(false)
}

/// Whether there is a grid in a file that is none of particles, or one is named.
fn holds_grids(content: &Content) -> Result<bool, ImportError> {
    let file = file(content)?;
    match &content.part {
        // Of particles a number names a step.
        Some(part) => Ok(!is_of_particles(&file)? || !part.bytes().all(|byte| byte.is_ascii_digit())),
        None => Ok(!own_grids(&file)?.is_empty()),
    }
}

/// The file, unpacked where it is compressed as a whole.
fn file(content: &Content) -> Result<H5, ImportError> {
    H5::of(&content.path, content.file()?, content.method())
}

/// The data sets that may be meant where none is named: numbers with two or three axes that say nothing about another data set.
fn grids(file: &H5) -> Result<Vec<Array<'_>>, ImportError> {
    let arrays = file.arrays()?;
    let attributes: Vec<Option<Attributes>> = arrays.iter().map(|array| array.attributes().ok()).collect();
    let helpers: Vec<String> = attributes.iter().flatten().flat_map(|about| conventions::helpers(about)).collect();
    let is_grid = |array: &Array, about: &Option<Attributes>| {
        let name = array.label.rsplit('/').next().unwrap_or_default();
        let is_scale =
            about.as_ref().and_then(|about| about.text("CLASS")).is_some_and(|class| class == "DIMENSION_SCALE");
        let axes = axes(&array.shape);
        (2..=3).contains(&axes.len())
            && array.sample_type.is_some()
            && axes.iter().all(|&count| count > 0)
            && !is_scale
            && !is_of_index(&array.label)
            && !helpers.iter().any(|helper| helper == name)
    };
    Ok(arrays
        .into_iter()
        .zip(attributes)
        .filter(|(array, about)| is_grid(array, about))
        .map(|(array, _)| array)
        .collect())
}

/// Whether a data set is of an index, as PyTables keeps those of a table `NAME` in a group `_i_NAME` beside it.
fn is_of_index(label: &str) -> bool {
    label.split('/').any(|group| group.starts_with("_i_"))
}

/// The data sets that are images or volumes: none of a file of particles, nor of a table whose columns they are.
fn own_grids(file: &H5) -> Result<Vec<Array<'_>>, ImportError> {
    let found = if is_of_particles(file)? { Vec::new() } else { grids(file)? };
    Ok(if are_columns(file, &found) { Vec::new() } else { found })
}

/// What is known of these.
pub(super) fn arrays(content: &Content) -> Result<Vec<GridArray>, ImportError> {
    let file = file(content)?;
    let about = |array: Array| {
        let unit = array.attributes().ok().and_then(|about| about.text("units")).unwrap_or_default();
        GridArray { shape: axes(&array.shape).to_vec(), name: array.label, unit }
    };
    Ok(own_grids(&file)?.into_iter().map(about).collect())
}

/// The axes of a grid: those of one sample in front of three others say nothing.
fn axes(shape: &[u64]) -> &[u64] {
    let mut axes = shape;
    while let [1, rest @ ..] = axes
        && axes.len() > 3
    {
        axes = rest;
    }
    axes
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let file = file(content)?;
    let path = &*content.path;
    let array = match &content.part {
        Some(name) => match file.array(name)? {
            Some(array) => array,
            None => return Err(choice::missing(content, name, &listed(&grids(&file)?))),
        },
        None => {
            let mut found = grids(&file)?;
            if found.len() != 1 {
                return Err(choice::several(content, "data sets", &listed(&found)));
            }
            found.remove(0)
        }
    };
    let Some(kind) = array.sample_type else {
        let expected = "whole numbers of 8 to 64 bits, or floats of 32 or 64";
        return Err(ImportError::malformed(path, &*array.label, array.type_in_words(), expected));
    };
    let about = array.attributes()?;
    let is_netcdf = file.root()?.attributes()?.has("_NCProperties") || is_of_dimensions(&array);
    let mut axes = axes(&array.shape);
    // A field at one time.
    while let [1, rest @ ..] = axes
        && is_netcdf
        && axes.len() > 2
    {
        axes = rest;
    }
    let name = array.label.rsplit('/').next().unwrap_or_default();
    let channels = vec![conventions::channel(&choice::shown(name), &about)];
    let mut grid = match *axes {
        [y, x] => Grid::image([x, y], kind, channels),
        [z, y, x] => Grid::volume([x, y, z], kind, channels),
        _ => return Err(choice::axes(content, &array.label, &array.shape)),
    };
    let mut notes = vec![format!("data set {}", choice::shown(&array.label))];
    conventions::place(&mut grid, &coordinates(&array), &mut notes);
    let bytes = checked(path, &grid, &array.label, &array.label)?;
    let most = array.most_bytes()?;
    if bytes > most {
        return Err(too_few(path, &format!("at most {most} bytes"), bytes, &grid));
    }
    let mut scratch = Scratch::new(path);
    array.each(&mut |values| scratch.write(values))?;
    let layout = Layout::packed(&grid, PLANAR, 0, NATIVE);
    let format = if is_netcdf { NETCDF } else { HDF5.name };
    let mut about = GridDescription::new(&content.named, format, content.length, grid);
    about.notes = notes;
    Ok(GridSource::new(about, scratch.into_storage()?, layout))
}

/// Whether a data set has dimensions as NetCDF 4 writes them.
fn is_of_dimensions(array: &Array) -> bool {
    let scales = array.scales().into_iter().flatten();
    scales.filter_map(|scale| scale.attributes().ok()).any(|about| about.has("_Netcdf4Dimid"))
}

/// Data sets as a message lists them.
fn listed(arrays: &[Array]) -> Vec<String> {
    let described = |array: &Array| choice::described(&array.label, axes(&array.shape), &array.type_in_words());
    arrays.iter().map(described).collect()
}

/// The coordinates of the samples along x, y and z, where the data set has scales.
fn coordinates(array: &Array) -> Vec<Option<Coordinates>> {
    let along = |scale: Option<Array>| {
        let scale = scale?;
        let about = scale.attributes().ok()?;
        // A dimension without coordinates.
        let is_bare = About::text(&about, "NAME").is_some_and(|name| name.starts_with("This is a netCDF dimension"));
        let values = if is_bare { None } else { scale.coordinates() }?;
        let name = choice::shown(scale.label.rsplit('/').next().unwrap_or_default());
        Some(Coordinates { name, unit: About::text(&about, "units").unwrap_or_default(), values })
    };
    array.scales().into_iter().rev().take(3).map(along).collect()
}
