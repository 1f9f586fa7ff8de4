//! Contour lines as GeoJSON: a collection of line strings in the field's own x and y, each with its level.

use super::contours::Contour;
use crate::model::HeightGrid;
use std::io::{self, Write};

/// Writes lines one after the other.
pub struct GeoJson<W: Write> {
    out: W,
    is_first: bool,
}

impl<W: Write> GeoJson<W> {
    /// Begins a collection; units and reference system are those of a grid.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn new(mut out: W, grid: &HeightGrid) -> io::Result<GeoJson<W>> {
        let text = |text: &str| serde_json::Value::from(text).to_string();
        write!(out, "{{\"type\":\"FeatureCollection\"")?;
        for (name, unit) in [("xy_unit", &grid.xy_unit), ("height_unit", &grid.height_unit)] {
            if !unit.is_unknown() {
                write!(out, ",\"{name}\":{}", text(&unit.0))?;
            }
        }
        if let Some(crs) = &grid.crs {
            write!(out, ",\"crs\":{{\"type\":\"name\",\"properties\":{{\"name\":{}}}}}", text(crs))?;
        }
        write!(out, ",\"features\":[")?;
        Ok(GeoJson { out, is_first: true })
    }

    /// Adds a line. Numbers are the shortest that read back the same.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn line(&mut self, line: &Contour) -> io::Result<()> {
        let between = if std::mem::take(&mut self.is_first) { "" } else { "," };
        let level = line.level;
        write!(self.out, "{between}\n{{\"type\":\"Feature\",\"properties\":{{\"level\":{level:?}}},")?;
        write!(self.out, "\"geometry\":{{\"type\":\"LineString\",\"coordinates\":[")?;
        for (number, [x, y]) in line.points.iter().enumerate() {
            write!(self.out, "{}[{x:?},{y:?}]", if number == 0 { "" } else { "," })?;
        }
        write!(self.out, "]}}}}")
    }

    /// Ends the collection and gives back what was written to.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn finish(mut self) -> io::Result<W> {
        writeln!(self.out, "\n]}}")?;
        self.out.flush()?;
        Ok(self.out)
    }
}
