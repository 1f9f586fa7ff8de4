//! How many samples there are, before anything is allocated for them.

use super::content::Content;
use crate::model::HeightGrid;
use deepfield_data::import::ImportError;
use deepfield_data::model::SampleType;

/// A number of samples that a file states, under the name that it has there.
pub(super) type Stated<'n> = (&'n str, i128);

/// Columns and rows where a field can have so many: at least 2 x 2, and fewer than 2^63 bytes in all.
///
/// # Errors
/// The message that names what is wrong.
pub(super) fn dimensions(
    content: &Content,
    columns: Stated,
    rows: Stated,
    sample_type: SampleType,
) -> Result<[u64; 2], ImportError> {
    let shown = format!("{} x {}", columns.1, rows.1);
    for (field, count) in [columns, rows] {
        if count < 1 {
            return Err(content.malformed(field, count, "at least 2 (at least 2 x 2 samples)"));
        }
        if count < 2 {
            return Err(content.malformed(field, &shown, "at least 2 x 2 samples"));
        }
    }
    let bytes = columns.1.checked_mul(rows.1).and_then(|samples| samples.checked_mul(sample_type.size() as i128));
    match (u64::try_from(columns.1), u64::try_from(rows.1), bytes) {
        (Ok(wide), Ok(high), Some(bytes)) if i64::try_from(bytes).is_ok() => Ok([wide, high]),
        (.., bytes) => {
            let field =
                if columns.0 == rows.0 { columns.0.to_owned() } else { format!("{} and {}", columns.0, rows.0) };
            let bytes = bytes.map_or_else(|| "more than 2^127".to_owned(), |bytes| bytes.to_string());
            let expected = format!("{bytes} ({shown} of {sample_type}), of which fewer than 2^63 can be");
            Err(content.malformed(&field, format!("{} bytes in the file", content.length), expected))
        }
    }
}

/// A distance of samples as a file states it: finite and above 0.
///
/// # Errors
/// The message that names the field.
pub(super) fn distance(content: &Content, field: &str, value: f64) -> Result<f64, ImportError> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    Err(content.malformed(field, value, "a number above 0"))
}

/// What every field holds, whatever format it is of.
///
/// # Errors
/// The message that names what is wrong.
pub(super) fn check_grid(content: &Content, grid: &HeightGrid) -> Result<(), ImportError> {
    dimensions(content, ("columns", grid.columns.into()), ("rows", grid.rows.into()), grid.sample_type)?;
    let shown = |[x, y]: [f64; 2]| format!("{x}, {y}");
    if !grid.step.iter().all(|step| step.is_finite() && *step != 0.0) {
        return Err(content.malformed("spacing", shown(grid.step), "two numbers other than 0"));
    }
    let is_finite = |place: [f64; 2]| place.iter().all(|axis| axis.is_finite());
    if !(is_finite(grid.origin) && is_finite(grid.place(grid.rows as f64, grid.columns as f64))) {
        return Err(content.malformed("origin", shown(grid.origin), "finite numbers"));
    }
    if !(grid.scale.slope.is_finite() && grid.scale.slope != 0.0 && grid.scale.intercept.is_finite()) {
        let found = format!("{} and {}", grid.scale.slope, grid.scale.intercept);
        return Err(content.malformed("scale of heights", found, "finite numbers, the first not 0"));
    }
    Ok(())
}
