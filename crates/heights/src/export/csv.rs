//! A table of places and heights, of the samples that were measured.

use super::new_file::NewFile;
use super::{Export, ExportError, Exported};
use deepfield_data::model::Unit;
use std::fmt::Write as _;

pub(super) fn write(export: &Export) -> Result<Exported, ExportError> {
    let grid = export.grid();
    let mut file = NewFile::create(export.output, 0)?;
    let named =
        |name: &str, unit: &Unit| if unit.is_unknown() { name.to_owned() } else { format!("{name} [{}]", unit.0) };
    let head = [named("x", &grid.xy_unit), named("y", &grid.xy_unit), named("height", &grid.height_unit)];
    file.write(format!("{}\n", head.join(",")).as_bytes())?;
    let mut lines = String::new();
    let valid = export.each_band(false, |band, values| {
        for (row, line) in (band.row..).zip(values.chunks(band.columns as usize)) {
            lines.clear();
            for (column, height) in (band.column..).zip(line).filter(|(_, height)| !height.is_nan()) {
                let [x, y] = grid.place(row as f64, column as f64);
                // Writing to a string cannot fail.
                let _ = writeln!(lines, "{x:?},{y:?},{height:?}");
            }
            file.write(lines.as_bytes())?;
        }
        Ok(())
    })?;
    file.finish()?;
    Ok(export.done(valid))
}
