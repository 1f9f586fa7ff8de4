//! `deepfield select`: the particles of a region, or those with certain ids, as a table or as a list of ids; heights as they are stored.

use super::derive_options::DeriveOptions;
use super::frame_option::{FrameName, unknown};
use super::heights::select::{Corners, rectangle};
use super::heights::{self, StatedOptions};
use super::members_options::{MembersOptions, OpenRun};
use super::region_options::{At, RegionOptions};
use super::{CommandResult, print_line, progress_bar::TerminalProgress};
use crate::explore::{Data, Format, Frame, Members, Opened, Region, Work, export, ids_of};
use crate::model::ReadMethod;
use std::path::PathBuf;

/// Writes the particles of a region, or those with certain ids: as a table with every field, or as a list of ids; of heights the samples
/// of a rectangle.
///
/// Rows are read from the source at its own precision, also where a page file is named whose source is still there; else from the
/// page file, which has no ids. Ids find their particles again in another snapshot of the same run.
///
/// Samples of heights, of a rectangle or all of them, are written bit for bit.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield select snapshot_099.hdf5 --sphere 21.9,39.0,33.1,1.5 -o halo.csv
  deepfield select box.df --at groups.hdf5#0 -o halo.ids             which particles they are
  deepfield select snapshot_010.hdf5 --ids halo.ids -o past.parquet  where they were
  deepfield select snapshot_099.hdf5 --at rockstar/out_99.list#0 -o cluster.hdf5  a snapshot of a halo alone
  deepfield select run.df --tracked-at 9.6 --sphere 21.9,39.0,33.1,1.5 --time last -o now.csv
  deepfield select dem.df --rectangle 1000,2000,1500,2500 -o part.tif
  deepfield select galaxy.hdf5 --family gas --where temperature:..1e4 -o cold.parquet")]
pub struct Arguments {
    /// The source, page file or run; or heights, built or not; or the URL of a built file.
    pub path: PathBuf,
    /// When it is asked.
    #[command(flatten)]
    pub when: At,
    /// Which particles [default: all].
    #[command(flatten)]
    pub region: RegionOptions,
    /// Which particles, wherever they are.
    #[command(flatten)]
    pub who: MembersOptions,
    /// What is derived.
    #[command(flatten)]
    pub derive: DeriveOptions,
    /// The frame of lengths, densities and velocities of comoving data; regions are always in the data's own.
    #[arg(long, value_name = "FRAME", value_enum, default_value_t)]
    pub frame: FrameName,
    /// The table, .csv, .parquet, .ply, .fits, .vtp (VTK) or .hdf5 (a snapshot as Gadget's), or the list of ids, .ids; of heights .npy, .tif,
    /// .asc, .x3p, .png or .csv.
    #[arg(short, long, value_name = "OUT")]
    pub out: PathBuf,
    /// Of heights: the samples between two corners, and on the edge.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = rectangle, allow_hyphen_values = true)]
    pub rectangle: Option<Corners>,
    /// What is said of heights.
    #[command(flatten)]
    pub heights: StatedOptions,
}

/// Selects and writes.
///
/// # Errors
/// When the data cannot be read, or the file not be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, when, region, who, derive, frame, rectangle, heights: said, out } = arguments;
    if said.takes(path) {
        let own = [("--frame", *frame == FrameName::Physical), ("--derive", !derive.is_empty())];
        let of_particles = [&when.given()[..], &region.given(), &who.given(), &own].concat();
        heights::refuse_options(path, &of_particles, "; heights take --rectangle")?;
        return heights::select::run(path, said, *rectangle, out);
    }
    heights::refuse_without(path, &[&said.given()[..], &[("--rectangle", rectangle.is_some())]].concat())?;
    let extension = out.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_ascii_lowercase();
    let format = Format::of(out);
    if format.is_none() && extension != "ids" {
        let expected = format!("expected a name that ends in {}, or .ids", Format::ENDINGS);
        return Err(format!("{}: {expected}", out.display()).into());
    }
    let progress = TerminalProgress::new();
    let work = Work::told(&progress);
    let run = OpenRun::open(path, who, region, ReadMethod::default())?;
    let followed = run.as_ref().map(|run| run.snapshot(*when, work)).transpose()?.flatten();
    let is_followed = followed.is_some();
    let opened = match followed {
        Some(snapshot) => Opened::Source(Box::new(snapshot)),
        // Values are those of the page file, without ids.
        None if !derive.is_empty() => {
            if format.is_none() || !who.is_region() {
                derive.refuse(path, "a selection of ids")?;
            }
            derive.open(path, *when, ReadMethod::default(), &progress)?
        }
        None => match when.source(path, ReadMethod::default()) {
            Ok(source) => source,
            Err(reason) => match when.open(path, ReadMethod::default())? {
                // Ids are in the source alone.
                Opened::Pages(file) if format.is_some() && who.is_region() => {
                    eprintln!("deepfield: {reason}: values are those of the page file, without ids");
                    Opened::Pages(file)
                }
                _ => return Err(reason),
            },
        },
    };
    let data = opened.data();
    let wanted = match run {
        Some(run) => run.members,
        None => who.members(region, data)?,
    };
    // What is followed is nothing else.
    let members = if is_followed { Members::Region(Region::whole()) } else { wanted.clone() };
    let periodic = if is_followed { None } else { region.periodic(data)? };
    let frame = match (frame, data) {
        (FrameName::Comoving, _) => Frame::Stored,
        (FrameName::Physical, Data::Source(source)) => Frame::physical(source).ok_or_else(|| unknown(path))?,
        (FrameName::Physical, Data::Pages(_)) => return Err(unknown(path).into()),
    };
    let rows = match (format, &opened) {
        (Some(format), _) => export(data, &members, format, &frame, out, periodic, work)?.rows,
        (None, Opened::Source(source)) => {
            let found = ids_of(source.as_ref(), &members, periodic, work)?;
            found.write(out, &format!(" of {}", path.display()))?;
            found.len()
        }
        (None, Opened::Pages(_)) => return Err(format!("{}: a page file has no ids", path.display()).into()),
    };
    drop(progress);
    print_line(format_args!("{rows} particles in {}", out.display()))?;
    if let Members::Ids(wanted) = &wanted
        && rows < wanted.len()
    {
        print_line(format_args!("{} of {} ids are not there", wanted.len() - rows, wanted.len()))?;
    }
    Ok(())
}
