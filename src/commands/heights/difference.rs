//! The difference of two height fields.

use super::options;
use crate::commands::difference::Arguments;
use crate::commands::probe::short;
use crate::commands::progress_bar::TerminalProgress;
use crate::commands::statistics::write_json;
use crate::commands::{CommandResult, print_line};
use crate::heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use crate::heights::export::{ExportOptions, export_heights};
use crate::heights::measure::{Difference, Volumes, volumes_on};
use crate::heights::model::{Heights, Lengths, Window};

/// Subtracts, writes and tells.
///
/// # Errors
/// When the heights cannot be read or do not fit together, or the file cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { before, after, heights, map, output, json } = arguments;
    let open = |path| heights.open(path);
    let names = [before, after].map(|path| path.display().to_string());
    let (earlier, later) = (open(before)?, open(after)?);
    let difference = Difference::new([&names[0], &names[1]], &earlier, &later)?;
    let lengths = options::lengths(before, map.as_deref(), difference.grid())?;
    let progress = TerminalProgress::new();
    if let Some(output) = output {
        match output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("df")) {
            true => {
                let note = format!("{} minus {}", names[1], names[0]);
                let origin = HeightOrigin {
                    path: after.clone(),
                    format: "difference".into(),
                    bytes: 0,
                    has_spacing: true,
                    notes: vec![note],
                    ..HeightOrigin::default()
                };
                build_heights(&difference, &origin, &HeightBuildOptions::default(), output, &progress)?;
            }
            false => {
                let all = Window::all(difference.grid());
                export_heights(&difference, all, output, &ExportOptions::default(), &progress)?;
            }
        }
    }
    let found = volumes_on(&difference, &lengths)?;
    drop(progress);
    if let Some(json) = json {
        return write_json(json, &found);
    }
    let Volumes { samples, valid, valid_share, area, volume_above, volume_below } = found;
    let length = Lengths::unit(difference.grid());
    let unit = |power: u32| if length.is_unknown() { String::new() } else { format!(" {length}^{power}") };
    let share = short(100.0 * valid_share);
    print_line(format_args!(
        "{valid} of {samples} samples are known of both ({share} %), over {}{}",
        short(area),
        unit(2)
    ))?;
    print_line(format_args!("above: {}{}, below: {}{}", short(volume_above), unit(3), short(volume_below), unit(3)))?;
    Ok(())
}
