//! What is refused where heights are named: commands that have no use for them, and options of particles; and options of heights elsewhere.

use crate::commands::arguments::Given;
use crate::commands::{CommandResult, usage};
use crate::heights::is_heights;
use crate::look::data_file;
use std::path::Path;

/// Refuses heights where something else is expected, and says what reads them.
///
/// # Errors
/// Where the file that `path` names is taken for heights.
pub fn refuse(path: &Path, expected: &str) -> CommandResult {
    // What is wrong with a folder is told where it is opened.
    let named = data_file(path).unwrap_or_else(|_| path.to_owned());
    if !is_heights(&named) {
        return Ok(());
    }
    let instead = "deepfield select FILE -o OUT.tif writes the samples of heights";
    Err(format!("{}: content: found heights, expected {expected}; {instead}", named.display()).into())
}

/// Refuses options of particles where heights are named; `instead` says what heights take, if anything.
///
/// # Errors
/// Wrong usage, where one of them is given.
pub fn refuse_options(path: &Path, options: &[Given], instead: &str) -> CommandResult {
    match options.iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some((name, _)) => {
            Err(usage(format!("{}: {name}: found heights, expected particles{instead}", path.display())))
        }
    }
}

/// Refuses options of heights where something else is named. What is not there is told where it is opened.
///
/// # Errors
/// Wrong usage, where one of them is given.
pub fn refuse_without(path: &Path, options: &[Given]) -> CommandResult {
    match options.iter().find(|(_, is_given)| *is_given && path.exists()) {
        None => Ok(()),
        Some((name, _)) => {
            let instead = "an array or a grey picture is taken for such by --kind heights";
            Err(usage(format!("{}: {name}: found no heights, expected some; {instead}", path.display())))
        }
    }
}
