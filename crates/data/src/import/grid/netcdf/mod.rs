//! Classic NetCDF of versions 1, 2 and 5 (<https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html>). NetCDF 4 is
//! HDF5.

mod header;

use super::content::Content;
use super::conventions::{self, Coordinates};
use super::layout::Layout;
use super::source::checked;
use super::{GridArray, GridDescription, GridFormat, GridSource, choice};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Grid, SampleType};
use header::{Header, Variable};
use std::io::Read;

/// NetCDF: the variable that is named behind the file, else the only one that is a grid.
pub(super) const NETCDF: GridFormat = GridFormat {
    name: "netcdf",
    extensions: &["nc", "cdf"],
    has_parts: true,
    detect: |content| [b"CDF\x01", b"CDF\x02", b"CDF\x05"].iter().any(|start| content.head.starts_with(*start)),
    open,
};

/// The most values of a coordinate.
const MOST_COORDINATES: u64 = 1 << 24;

/// A file whose header was read.
struct File<'a> {
    content: &'a Content,
    header: Header,
    /// Values along the dimension that grows, and bytes from one of them to the next.
    records: u64,
    record_bytes: u64,
}

impl<'a> File<'a> {
    fn open(content: &'a Content) -> Result<File<'a>, ImportError> {
        let header = Header::read(content)?;
        let mut file = File { content, header, records: 0, record_bytes: 0 };
        let growing: Vec<&Variable> = file.header.variables.iter().filter(|variable| file.grows(variable)).collect();
        let (is_alone, first) = (growing.len() == 1, growing.iter().map(|variable| variable.begin).min());
        // Each is filled up to a multiple of four bytes, unless it is the only one.
        let padded = |bytes: u64| if is_alone { bytes } else { bytes.saturating_add(3) & !3 };
        let bytes = |variable: &&Variable| padded(file.row_bytes(variable));
        let record_bytes = growing.iter().map(bytes).fold(0, u64::saturating_add);
        let behind = content.length.saturating_sub(first.unwrap_or(content.length));
        file.record_bytes = record_bytes;
        file.records = file.header.records.unwrap_or(behind / record_bytes.max(1));
        Ok(file)
    }

    /// Whether a variable's first dimension is the one that grows.
    fn grows(&self, variable: &Variable) -> bool {
        variable.dimensions.first().is_some_and(|&number| self.header.dimensions[number].length == 0)
    }

    /// Bytes of a variable, of one that grows those of a record.
    fn row_bytes(&self, variable: &Variable) -> u64 {
        let size = variable.sample_type.map_or(1, SampleType::size) as u64;
        let fixed = variable.dimensions.iter().skip(usize::from(self.grows(variable)));
        fixed.fold(size, |bytes, &number| bytes.saturating_mul(self.header.dimensions[number].length))
    }

    /// Length of each axis of a variable and the bytes between its values along it, the fastest last.
    fn axes(&self, variable: &Variable) -> Vec<(u64, u64)> {
        let mut stride = variable.sample_type.map_or(1, SampleType::size) as u64;
        let mut axes = Vec::new();
        for (place, &number) in variable.dimensions.iter().enumerate().rev() {
            let length = self.header.dimensions[number].length;
            if place == 0 && length == 0 {
                axes.push((self.records, self.record_bytes));
            } else {
                axes.push((length, stride));
                stride = stride.saturating_mul(length);
            }
        }
        axes.reverse();
        axes
    }

    /// Variables that may be meant where none is named: numbers along two or three axes that say nothing about another variable.
    fn grids(&self) -> Vec<&Variable> {
        let variables = &self.header.variables;
        let helpers: Vec<String> = variables.iter().flat_map(|about| conventions::helpers(&about.attributes)).collect();
        let is_grid = |variable: &&Variable| {
            let axes = without_ones(&self.axes(variable)).to_vec();
            variable.sample_type.is_some()
                && (2..=3).contains(&axes.len())
                && axes.iter().all(|(count, _)| *count > 0)
                && !helpers.contains(&variable.name)
        };
        variables.iter().filter(is_grid).collect()
    }

    /// Variables as a message lists them.
    fn listed(&self, variables: &[&Variable]) -> Vec<String> {
        let described = |variable: &&Variable| {
            let sizes: Vec<u64> = self.axes(variable).iter().map(|(count, _)| *count).collect();
            choice::described(&variable.name, &sizes, variable.sample_type.map_or("text", SampleType::name))
        };
        variables.iter().map(described).collect()
    }

    /// The coordinates along a dimension: the variable of its name, where that is one.
    fn coordinates(&self, number: usize) -> Option<Coordinates> {
        let dimension = &self.header.dimensions[number];
        let found = self.header.variables.iter().find(|variable| variable.name == dimension.name)?;
        let kind = found.sample_type.filter(|_| found.dimensions == [number])?;
        let count = dimension.length;
        if !(1..=MOST_COORDINATES).contains(&count) {
            return None;
        }
        let mut bytes = Vec::new();
        let wanted = count * kind.size() as u64;
        self.content.reader(found.begin).ok()?.take(wanted).read_to_end(&mut bytes).ok()?;
        if cfg!(target_endian = "little") {
            bytes.chunks_exact_mut(kind.size()).for_each(<[u8]>::reverse);
        }
        let mut values = Vec::new();
        kind.decode(&bytes, 1, &mut values);
        let unit = conventions::About::text(&found.attributes, "units").unwrap_or_default();
        Some(Coordinates { name: choice::shown(&found.name), unit, values })
    }
}

/// Axes of one value in front say nothing: a field at one time.
fn without_ones<T>(axes: &[(u64, T)]) -> &[(u64, T)] {
    let mut axes = axes;
    while let [(1, _), rest @ ..] = axes
        && axes.len() > 2
    {
        axes = rest;
    }
    axes
}

/// The variables of a file that are images or volumes.
pub(super) fn arrays(content: &Content) -> Result<Vec<GridArray>, ImportError> {
    let file = File::open(content)?;
    let about = |variable: &&Variable| GridArray {
        name: variable.name.clone(),
        shape: without_ones(&file.axes(variable)).iter().map(|(count, _)| *count).collect(),
        unit: conventions::About::text(&variable.attributes, "units").unwrap_or_default(),
    };
    Ok(file.grids().iter().map(about).collect())
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let file = File::open(content)?;
    let path = &*content.path;
    let grids = file.grids();
    let variable = match &content.part {
        Some(name) => {
            let found = file.header.variables.iter().find(|variable| variable.name == *name);
            found.ok_or_else(|| choice::missing(content, name, &file.listed(&grids)))?
        }
        None => match grids[..] {
            [only] => only,
            _ => return Err(choice::several(content, "variables", &file.listed(&grids))),
        },
    };
    let field = choice::shown(&variable.name);
    let kind = variable.sample_type;
    let kind = kind.ok_or_else(|| ImportError::malformed(path, &*field, "text", "a variable of numbers"))?;
    let all = file.axes(variable);
    let axes = without_ones(&all);
    let channels = vec![conventions::channel(&field, &variable.attributes)];
    let kind = conventions::unsigned(kind, &variable.attributes);
    let mut grid = match *axes {
        [(y, _), (x, _)] => Grid::image([x, y], kind, channels),
        [(z, _), (y, _), (x, _)] => Grid::volume([x, y, z], kind, channels),
        _ => {
            let sizes: Vec<u64> = all.iter().map(|(count, _)| *count).collect();
            return Err(choice::axes(content, &field, &sizes));
        }
    };
    let mut notes = vec![format!("variable {field}")];
    let along: Vec<Option<Coordinates>> =
        variable.dimensions.iter().rev().take(axes.len()).map(|&number| file.coordinates(number)).collect();
    conventions::place(&mut grid, &along, &mut notes);
    checked(path, &grid, &field, &field)?;
    // From the first byte of the first value to the last of the last one.
    let reach = axes
        .iter()
        .try_fold(kind.size() as u64, |reach, (count, stride)| reach.checked_add((count - 1).checked_mul(*stride)?));
    let reach = reach.filter(|reach| variable.begin.checked_add(*reach).is_some());
    let reach = reach.ok_or_else(|| ImportError::malformed(path, &*field, grid.described(), "fewer values"))?;
    let storage = content.samples(variable.begin, reach, &grid)?;
    let mut strides = [kind.size() as u64; 4];
    for (stride, (_, bytes)) in strides.iter_mut().skip(1).zip(axes.iter().rev()) {
        *stride = *bytes;
    }
    let offset = if content.is_packed { 0 } else { variable.begin };
    let layout = Layout { offset, strides, order: Order::Big };
    let mut about = GridDescription::new(&content.named, NETCDF.name, content.length, grid);
    about.notes = notes;
    Ok(GridSource::new(about, storage, layout))
}
