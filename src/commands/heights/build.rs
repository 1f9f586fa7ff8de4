//! `deepfield build` of a height field.

use super::refusal::refuse_options;
use crate::commands::CommandResult;
use crate::commands::arguments::Given;
use crate::commands::build::Arguments;
use crate::commands::progress_bar::TerminalProgress;
use crate::heights::OpenHeights;
use crate::heights::build::HeightBuildOptions;
use crate::hierarchy::Matter;
use crate::import::Smoothing;
use std::path::Path;

/// Builds the page file of the heights at `path`.
///
/// # Errors
/// When the source cannot be read, its heights not be rounded as is asked, or the page file not be written.
pub fn run(arguments: &Arguments, path: &Path) -> CommandResult {
    refuse_options(path, &of_particles(arguments), "")?;
    for matter in [Matter::Particles, Matter::Grids] {
        if let Some(kinds) = arguments.hierarchy.of(matter) {
            let expected = "expected another kind of data (heights are built as chunks)";
            return Err(format!("{}: hierarchy {kinds}: found heights, {expected}", path.display()).into());
        }
    }
    let said = arguments.texture.with(arguments.heights.said(&arguments.raw.spacing)).options(arguments.read);
    let open = OpenHeights::open(path, &said)?;
    let options = HeightBuildOptions {
        memory: arguments.memory,
        threads: arguments.threads.map(usize::from),
        height_error: arguments.height_error,
        ..HeightBuildOptions::default()
    };
    let built = open.build(&options, &arguments.output, &TerminalProgress::new())?;
    let kept = options.not_rounded(&built);
    built.notes.iter().chain(&kept).for_each(|note| eprintln!("note: {note}"));
    Ok(())
}

/// Options that particles and runs of them alone have.
fn of_particles(arguments: &Arguments) -> [Given; 10] {
    [
        ("--times", arguments.times.is_some()),
        ("--every", arguments.every.is_some()),
        ("--skip-damaged", arguments.skip_damaged),
        ("--family", !arguments.family.is_empty()),
        ("--attributes", arguments.attributes.is_some()),
        ("--smoothing", !matches!(arguments.smoothing, Smoothing::Auto)),
        ("--vq-bits", arguments.vq_bits.is_some()),
        ("--plain-codes", arguments.plain_codes),
        ("--exact-positions", arguments.exact_positions),
        ("--volume-levels", arguments.volume_levels),
    ]
}
