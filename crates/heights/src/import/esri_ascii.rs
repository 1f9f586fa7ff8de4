//! Esri ASCII grids: a header of names and numbers in any case, then values from north to south in rows of any length.
//! They are read once, piece by piece, into binary.

mod head;
#[cfg(test)]
mod tests;
mod values;

use super::content::Content;
use super::dimensions::{dimensions, distance};
use super::raw::Layout;
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::SampleType;
use head::Head;

/// Text that begins with one of the header's names.
pub(super) const ESRI_ASCII: HeightFormat = HeightFormat {
    name: "esri-ascii",
    extensions: &["asc"],
    is_sure: always,
    detect: |content| head::is_head(&content.head),
    open,
};

/// What stands for no data where the header does not say.
const NO_DATA: f64 = -9999.0;

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let head = Head::read(content)?;
    let columns = head.count(content, "ncols")?;
    let rows = head.count(content, "nrows")?;
    let [columns, rows] = dimensions(content, ("ncols", columns), ("nrows", rows), SampleType::F64)?;
    let mut grid = HeightGrid::new(columns, rows, SampleType::F64);
    let has_spacing = place(content, &head, &mut grid)?;
    let no_data = head.number(content, "nodata_value")?.unwrap_or(NO_DATA);

    let values = values::read(content, head.end, [columns, rows])?;
    grid.sample_type = values.sample_type;
    let layout = Layout::packed([columns, rows], 0, SampleType::F64, ByteOrder::NATIVE);
    let samples = values.unpacked.samples(content, "values", layout)?;
    let mut about = HeightDescription::new(content, ESRI_ASCII.name, grid);
    about.has_spacing = has_spacing;
    about.notes = head.notes();
    let no_data = if no_data.is_nan() { NoData::Nothing } else { NoData::Value(no_data) };
    Ok(HeightSource::new(about, Box::new(samples), no_data))
}

/// Where samples are: the lower left one's middle or its cell's corner is stated. Whether their distance is.
fn place(content: &Content, head: &Head, grid: &mut HeightGrid) -> Result<bool, ImportError> {
    let mut has_spacing = true;
    let mut steps = [1.0; 2];
    if content.options.spacing.is_none() {
        for (step, own) in steps.iter_mut().zip(["dx", "dy"]) {
            // One number for both, or one for each.
            let name = if head.has("cellsize") { "cellsize" } else { own };
            match head.number(content, name)? {
                Some(stated) => *step = distance(content, name, stated)?,
                None => has_spacing = false,
            }
        }
    } else if let Some(told) = content.options.spacing {
        steps = told;
    }
    let mut lowest = [0.0; 2];
    for (axis, letter) in ["x", "y"].into_iter().enumerate() {
        let center = head.number(content, &format!("{letter}llcenter"))?;
        let corner = head.number(content, &format!("{letter}llcorner"))?;
        lowest[axis] = center.unwrap_or_else(|| corner.unwrap_or(0.0) + steps[axis] / 2.0);
    }
    grid.step = [steps[0], -steps[1]];
    grid.origin = [lowest[0], lowest[1] + (grid.rows - 1) as f64 * steps[1]];
    Ok(has_spacing)
}
