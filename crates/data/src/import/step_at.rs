//! Which step of a file of several a moment names.

use super::{ImportError, open_with, step_name, steps_in};
use crate::model::{ReadMethod, When, redshift_of};
use std::path::{Path, PathBuf};

/// Times that differ by no more than this share of themselves are the same.
const SAME_TIME: f64 = 1e-9;

/// The name of the step that a moment names in the file at `path`; `None` where the file holds one snapshot.
///
/// # Errors
/// [`ImportError`] where the file cannot be read, or none of its steps is at that moment: what lies between two steps needs a run.
pub fn step_at(path: &Path, when: When, method: ReadMethod) -> Result<Option<PathBuf>, ImportError> {
    let steps = steps_in(path)?;
    if steps <= 1 {
        return Ok(None);
    }
    let wrong = |expected: String| ImportError::malformed(path, "--time", when, expected);
    match when {
        When::Last => return Ok(Some(step_name(path, steps - 1))),
        When::Step(step) if u64::from(step) < steps => return Ok(Some(step_name(path, step.into()))),
        When::Step(_) => return Err(wrong(format!("a step from 0 to {}", steps - 1))),
        When::Time(_) | When::Redshift(_) | When::ScaleFactor(_) => {}
    }
    let mut span: Option<[f64; 2]> = None;
    for step in 0..steps {
        let name = step_name(path, step);
        // A damaged step is not meant.
        let Ok(source) = open_with(&name, method) else { continue };
        let about = source.description();
        let (own, wanted) = match when {
            When::Redshift(redshift) => (about.redshift.or(about.scale_factor.and_then(redshift_of)), redshift),
            When::ScaleFactor(factor) => (about.scale_factor, factor),
            When::Time(time) => (about.scale_factor.or(about.time), time),
            When::Step(_) | When::Last => (None, 0.0),
        };
        let Some(own) = own else { continue };
        if (own - wanted).abs() <= SAME_TIME * wanted.abs() {
            return Ok(Some(name));
        }
        span = Some(span.map_or([own; 2], |[least, most]| [least.min(own), most.max(own)]));
    }
    let span = span.map_or_else(String::new, |[least, most]| format!(", from {least} to {most}"));
    Err(wrong(format!("the time of a step{span}; a run built of the file has what is between")))
}
