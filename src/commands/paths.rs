//! `deepfield paths`: the tracks of a run's particles as a table.

use super::region_options::RegionOptions;
use super::{CommandResult, progress_bar::TerminalProgress};
use crate::explore::{Data, Format, IdSet, Members, Work, export};
use crate::look::data_file;
use crate::model::{ReadMethod, When};
use crate::store::RunFile;
use crate::store::run::{PathsOf, RunPaths};
use std::path::PathBuf;
use std::sync::Arc;

/// Writes the tracks of a run: for each particle and interval a row at each end, with its place, its velocity by the run's clock, and
/// everything else that is known of it. Between the two it is on the cubic Hermite spline.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  deepfield paths run.df --ids halo.ids -o halo.csv
  deepfield paths run.df --from 9.6 --to last --family stars -o stars.parquet
  deepfield paths run.df --level 2 -o flow.parquet        clusters of a flow level
  deepfield paths run.df --level 2 --members --from step:3 --to step:4 -o members.csv
  deepfield paths run.df --sphere 0.3,0,0,0.5 --from step:3 --to step:4 -o through.csv    every end of a track that lies there")]
pub struct Arguments {
    /// The run.
    pub path: PathBuf,
    /// The particles with the ids in this file [default: all].
    #[arg(long, value_name = "FILE", conflicts_with_all = ["sphere", "cuboid", "region", "ranges", "family", "at", "object"])]
    pub ids: Option<PathBuf>,
    /// From when on: a time, step:12, z:1.5, a:0.4 or last [default: the first step].
    #[arg(long, value_name = "WHEN", allow_hyphen_values = true)]
    pub from: Option<When>,
    /// Until when [default: the last step].
    #[arg(long, value_name = "WHEN", allow_hyphen_values = true)]
    pub to: Option<When>,
    /// Which tracks: 0, those of single particles, or those of the clusters of a flow level, 1 being the finest.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub level: u32,
    /// The tracks of particles with the track and the clusters of the level that hold them.
    #[arg(long, requires = "level")]
    pub members: bool,
    /// Which ends of tracks [default: all].
    #[command(flatten)]
    pub region: RegionOptions,
    /// The table, .csv or .parquet.
    #[arg(short, long, value_name = "OUT")]
    pub out: PathBuf,
}

/// Writes the table.
///
/// # Errors
/// When the run cannot be read or has no tracks, or the file not be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let out = &arguments.out;
    let format = Format::of(out);
    let format = format.ok_or_else(|| format!("{}: expected a name that ends in .csv or .parquet", out.display()))?;
    let run = Arc::new(RunFile::open(&data_file(&arguments.path)?, ReadMethod::default())?);
    let from = run.moment(arguments.from.unwrap_or(When::Step(0)))?;
    let to = run.moment(arguments.to.unwrap_or(When::Last))?;
    if run.time(from) >= run.time(to) {
        let path = arguments.path.display();
        return Err(
            format!("{path}: --from: found {}, expected a time before --to, {}", run.time(from), run.time(to)).into()
        );
    }
    let of = match (arguments.level as usize, arguments.members) {
        (0, false) => PathsOf::Particles,
        (0, true) => return Err(conflict("--members: expected a flow level, --level 1 or more")),
        (level, false) => PathsOf::Clusters(level),
        (level, true) => PathsOf::Members(level),
    };
    if let (PathsOf::Clusters(_), Some(_)) = (of, &arguments.ids) {
        return Err(conflict("--ids: clusters have none; --members has those of their particles"));
    }
    let paths = RunPaths::open(run, of, from, to)?;
    let data = Data::Source(&paths);
    let members = match &arguments.ids {
        Some(ids) => Members::Ids(IdSet::read(ids)?),
        None => Members::Region(arguments.region.region(data)?),
    };
    let progress = TerminalProgress::new();
    let rows = export(data, &members, format, out, None, Work::told(&progress))?.rows;
    drop(progress);
    println!("{}: {rows} rows", out.display());
    Ok(())
}

/// Arguments that do not fit together.
fn conflict(message: &str) -> Box<dyn std::error::Error + Send + Sync> {
    Box::new(clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, format!("{message}\n")))
}
