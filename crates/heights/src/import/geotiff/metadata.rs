//! GDAL's own entry: the unit of heights, and what stored values mean.

use super::directory::Directory;
use super::tag;
use crate::model::{HeightGrid, units};
use deepfield_data::import::ImportError;
use roxmltree::Document;

/// Tells a grid. What is no XML is as good as none.
///
/// # Errors
/// Where the entry is not in the file, or a scale is no number.
pub(super) fn apply(directory: &Directory, grid: &mut HeightGrid) -> Result<(), ImportError> {
    let Some(text) = directory.text(tag::METADATA)? else { return Ok(()) };
    let Ok(document) = Document::parse(&text) else { return Ok(()) };
    let item = |role: &str| {
        let is = |node: &roxmltree::Node| {
            node.tag_name().name() == "Item"
                && node.attribute("role") == Some(role)
                && node.attribute("sample") == Some("0")
        };
        document.descendants().find(is).and_then(|node| node.text())
    };
    if let Some(unit) = item("unittype").and_then(units::known).filter(|unit| units::metres(unit).is_some()) {
        grid.height_unit = unit;
    }
    for (role, number) in [("scale", &mut grid.scale.slope), ("offset", &mut grid.scale.intercept)] {
        if let Some(text) = item(role) {
            let read = text.trim().parse();
            *number =
                read.map_err(|_| directory.content.malformed(&format!("GDAL_METADATA {role}"), text, "a number"))?;
        }
    }
    Ok(())
}
