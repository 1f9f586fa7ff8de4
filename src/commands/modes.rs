//! `deepfield modes`: the registered visualization modes and their settings.

use super::CommandResult;
use crate::mode::{Setting, SettingValue, paths};
use crate::modes;
use std::io::Write;

/// Lists the visualization modes and their settings.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  deepfield modes")]
pub struct Arguments {}

/// Prints the list.
///
/// # Errors
/// When standard output cannot be written.
pub fn run(_: &Arguments) -> CommandResult {
    let mut out = std::io::stdout().lock();
    for mode in modes::all() {
        writeln!(out, "{}\n    {}", mode.name, mode.help)?;
        if !mode.usual_attributes.is_empty() {
            writeln!(out, "    coloured by the first there is of: {}", mode.usual_attributes.join(", "))?;
        }
        let own = mode.all_settings();
        let layer: &[&Setting] = if mode.is_of_paths() { &paths::SETTINGS } else { &[] };
        if mode.is_of_paths() {
            writeln!(out, "    settings of paths, over any mode and here, as paths: (of: all, tail: 3) in RON:")?;
            for (name, help) in paths::WORDS {
                writeln!(out, "    {name:16} {help}")?;
            }
        }
        for setting in own.chain(layer.iter().copied()) {
            let unit = if setting.unit.is_empty() { String::new() } else { format!(" {}", setting.unit) };
            let default = match setting.default() {
                SettingValue::Numbers(_) => "automatic".to_owned(),
                value => value.to_string(),
            };
            writeln!(out, "    {:16} {} ({}{unit}, default {default})", setting.name, setting.help, setting.range())?;
        }
    }
    Ok(())
}
