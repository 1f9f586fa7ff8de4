//! `deepfield build` of a height field.

use crate::commands::CommandResult;
use crate::commands::build::Arguments;
use crate::commands::progress_bar::TerminalProgress;
use crate::heights::OpenHeights;
use crate::heights::build::HeightBuildOptions;
use crate::hierarchy::Matter;
use std::path::Path;

/// Builds the page file of the heights at `path`.
///
/// # Errors
/// When the source cannot be read or the page file not be written.
pub fn run(arguments: &Arguments, path: &Path) -> CommandResult {
    for matter in [Matter::Particles, Matter::Grids] {
        if let Some(kinds) = arguments.hierarchy.of(matter) {
            let expected = "expected another kind of data (heights are built as chunks)";
            return Err(format!("{}: hierarchy {kinds}: found heights, {expected}", path.display()).into());
        }
    }
    let said = arguments.texture.with(arguments.heights.said(&arguments.raw.spacing)).options(arguments.read);
    let open = OpenHeights::open(path, &said)?;
    let options = HeightBuildOptions { memory: arguments.memory, threads: arguments.threads.map(usize::from) };
    let built = open.build(&options, &arguments.output, &TerminalProgress::new())?;
    built.notes.iter().for_each(|note| eprintln!("note: {note}"));
    Ok(())
}
