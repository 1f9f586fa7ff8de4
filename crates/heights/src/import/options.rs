//! What the user says about a source that it does not say, or says wrongly.

use super::photo::PhotoChoice;
use crate::model::units;
use deepfield_data::import::ImportError;
use deepfield_data::model::{ReadMethod, Unit};
use std::path::Path;

/// How a source is opened.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeightOptions {
    /// Heights are asked for: files that could be images as well are opened as heights.
    pub is_asked: bool,
    /// The stored value that stands for no data, in place of what the source says.
    pub no_data: Option<f64>,
    /// From a column and a row to the next, in place of what the source says; both above 0, their signs are the source's.
    pub spacing: Option<[f64; 2]>,
    /// Unit of places, in place of the source's.
    pub xy_unit: Option<Unit>,
    /// Unit of heights, in place of the source's.
    pub height_unit: Option<Unit>,
    /// A photo that is laid over the field.
    pub texture: Option<PhotoChoice>,
    /// How files are read.
    pub read: ReadMethod,
}

impl HeightOptions {
    /// Whether these can be.
    ///
    /// # Errors
    /// What cannot, under the option's name.
    pub(super) fn check(&self, path: &Path) -> Result<(), ImportError> {
        let wrong =
            |option: &str, found: String, expected: &str| Err(ImportError::malformed(path, option, found, expected));
        if let Some([x, y]) = self.spacing.filter(|spacing| !spacing.iter().all(|step| step.is_finite() && *step > 0.0))
        {
            // Where more or fewer numbers are given there are none.
            let found = if x.is_nan() && y.is_nan() { "no two numbers".to_owned() } else { format!("{x},{y}") };
            return wrong("--spacing", found, "two numbers above 0, DX,DY");
        }
        let shown = |unit: &Unit| unit.0.chars().filter(|c| !c.is_control()).take(40).collect::<String>();
        if let Some(unit) =
            self.xy_unit.as_ref().filter(|unit| units::metres(unit).is_none() && !units::is_degrees(unit))
        {
            return wrong("--xy-unit", shown(unit), "km, m, mm, um, nm or deg");
        }
        if let Some(unit) = self.height_unit.as_ref().filter(|unit| units::metres(unit).is_none()) {
            return wrong("--height-unit", shown(unit), "km, m, mm, um or nm");
        }
        Ok(())
    }
}
