//! `deepfield paths`: the tracks of a run's particles as a table.

use super::frame_option::{FrameName, unknown};
use super::members_options::{MembersOptions, OpenRun};
use super::region_options::RegionOptions;
use super::{CommandResult, print_line, progress_bar::TerminalProgress};
use crate::explore::{Data, Format, Frame, Members, Region, Work, export};
use crate::model::{ReadMethod, When};
use crate::store::run::{PathsOf, RunPaths};
use std::path::PathBuf;
use std::sync::Arc;

/// Writes the tracks of a run: for each particle and interval a row at each end, with its place, its velocity by the run's clock, and
/// everything else that is known of it. Between the two it is on the cubic Hermite spline.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  deepfield paths run.df --ids halo.ids -o halo.csv
  deepfield paths run.df --tracked-at 9.6 --sphere 0.3,0,0,0.5 -o halo.csv
  deepfield paths run.df --ids halo.ids --frame physical -o halo.ply
  deepfield paths run.df --from 9.6 --to last --family stars -o stars.parquet
  deepfield paths run.df --level 2 -o flow.parquet        clusters of a flow level
  deepfield paths run.df --level 2 --members --from step:3 --to step:4 -o members.csv
  deepfield paths run.df --sphere 0.3,0,0,0.5 --from step:3 --to step:4 -o through.csv    every end of a track that lies there")]
pub struct Arguments {
    /// The run.
    pub path: PathBuf,
    /// Which particles, wherever they are [default: all].
    #[command(flatten)]
    pub who: MembersOptions,
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
    /// The frame of lengths, densities and velocities of comoving data; regions are always in the data's own.
    #[arg(long, value_name = "FRAME", value_enum, default_value_t)]
    pub frame: FrameName,
    /// The table, .csv, .parquet, .ply, .fits, .vtp (VTK) or .hdf5 (in Gadget's layout).
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
    let format =
        format.ok_or_else(|| format!("{}: expected a name that ends in {}", out.display(), Format::ENDINGS))?;
    let opened = OpenRun::open(&arguments.path, &arguments.who, &arguments.region, ReadMethod::default())?;
    let path = arguments.path.display();
    let opened = opened.ok_or_else(|| format!("{path}: expected a run: deepfield build makes one of snapshots"))?;
    let run = &opened.run;
    let from = run.moment(arguments.from.unwrap_or(When::Step(0)))?;
    let to = run.moment(arguments.to.unwrap_or(When::Last))?;
    if run.time(from) >= run.time(to) {
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
    let progress = TerminalProgress::new();
    let work = Work::told(&progress);
    let followed = match &opened.following {
        Some(following) => following.of(&opened.members, work)?,
        None => None,
    };
    if let (PathsOf::Clusters(_), Some(_)) = (of, &followed) {
        return Err(conflict("--level: clusters are no particles that can be followed; --members has theirs"));
    }
    let paths = match &followed {
        Some(followed) => {
            let wanted = |family, id| followed.has(family, id);
            RunPaths::of_members(Arc::clone(run), of, from, to, &wanted)?
        }
        None => RunPaths::open(Arc::clone(run), of, from, to)?,
    };
    let members = if followed.is_some() { Members::Region(Region::whole()) } else { opened.members };
    let frame = match arguments.frame {
        FrameName::Comoving => Frame::Stored,
        FrameName::Physical => Frame::PhysicalAt(paths.physical().ok_or_else(|| unknown(&arguments.path))?),
    };
    let rows = export(Data::Source(&paths), &members, format, &frame, out, None, work)?.rows;
    drop(progress);
    print_line(format_args!("{}: {rows} rows", out.display()))?;
    Ok(())
}

/// Arguments that do not fit together.
fn conflict(message: &str) -> Box<dyn std::error::Error + Send + Sync> {
    Box::new(clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, format!("{message}\n")))
}
