//! Units as files have them, and steps that state one each.

use super::content::Content;
use crate::model::units;
use deepfield_data::import::ImportError;
use deepfield_data::model::Unit;

/// A length that a file states under the name `field`; unknown where it states none. What the user says (`told`) needs no unit of the file.
///
/// # Errors
/// Where it is no length: the message names it, what there is beside it, and the option that says otherwise.
pub(super) fn length(
    content: &Content,
    field: &str,
    stated: &str,
    beside: &str,
    told: Option<&Unit>,
    option: &str,
) -> Result<Unit, ImportError> {
    if let Some(told) = told {
        return Ok(told.clone());
    }
    if stated.trim().is_empty() {
        return Ok(Unit::default());
    }
    let found = units::known(stated).filter(|unit| units::metres(unit).is_some());
    found.ok_or_else(|| {
        let found = format!("\"{stated}\" (beside \"{beside}\")");
        content.malformed(field, found, format!("a length: km, m, mm, um or nm, or {option} that says it"))
    })
}

/// Steps along columns and rows in one unit: the first one's, where both are known.
pub(super) fn in_one_unit(step: [f64; 2], units_of: &[Unit; 2]) -> ([f64; 2], Unit) {
    let [along, across] = units_of;
    match (units::metres(along), units::metres(across)) {
        (Some(own), Some(other)) if own != other => ([step[0], step[1] * (other / own)], along.clone()),
        (None, Some(_)) => (step, across.clone()),
        _ => (step, along.clone()),
    }
}
