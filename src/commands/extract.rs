//! `deepfield extract`: a step of a run as a page file of its own.

use super::{CommandResult, print_line};
use crate::model::{ReadMethod, When};
use crate::store::RunFile;
use crate::store::temporary::Temporary;
use std::path::PathBuf;

/// Writes a step of a run as a page file: the one that `build` of that snapshot alone writes, to the byte.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield extract run.df --step 12 -o one.df
  deepfield extract run.df --time z:1.5 -o one.df")]
pub struct Arguments {
    /// The run.
    pub path: PathBuf,
    /// The step, from 0.
    #[arg(long, value_name = "N", required_unless_present = "time", conflicts_with = "time")]
    pub step: Option<u32>,
    /// The step at or before a time: a time, z:1.5, a:0.4 or last.
    #[arg(long, value_name = "WHEN", allow_hyphen_values = true)]
    pub time: Option<When>,
    /// The page file to write.
    #[arg(short, long, value_name = "FILE.df")]
    pub output: PathBuf,
}

/// Copies the step's page file.
///
/// # Errors
/// When the run cannot be read or has no such step, or the file not be written; nothing is left behind then.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, step, time, output } = arguments;
    let run = RunFile::open(path, ReadMethod::default())?;
    let when = step.map(When::Step).or(*time).unwrap_or(When::Last);
    let moment = run.moment(when)?;
    let named = |error: std::io::Error| format!("{}: {error}", output.display());
    let file = Temporary::create(output, None).map_err(named)?;
    let bytes = run.copy_still(moment.step, &mut file.file(), output)?;
    file.file().sync_all().and_then(|()| file.persist(output)).map_err(named)?;
    let at = run.times().times[moment.step];
    print_line(format_args!("step {} at {at} in {}, {bytes} bytes", moment.step, output.display()))?;
    Ok(())
}
