//! `deepfield plot`: histograms, phase diagrams, scatter plots and radial profiles of a selection, as tables, pictures and SVG.

use super::arguments::{PictureSize, not_negative, vector};
use super::derive_options::DeriveOptions;
use super::heights;
use super::members_options::{MembersOptions, OpenRun};
use super::region_options::{At, RegionOptions};
use super::statistics::write_json;
use super::{CommandResult, print_line, progress_bar::TerminalProgress, usage};
use crate::color::output::{write_atomically, write_png};
use crate::explore::plot::INNER;
use crate::explore::plot::settings::DENSITY;
use crate::explore::{
    BinnedAxis, ChartScales, Data, Effort, ExploreError, Members, Opened, Plot, PlotOptions, PlotScale, ProfileOptions,
    Region, Weight, Work, members_about,
};
use crate::model::ReadMethod;
use glam::DVec3;
use serde::Serialize;
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Plots a selection or all: a histogram of a field, a phase diagram or scatter plot of two, or a radial profile.
///
/// Every particle counts. Of a source the answer is exact. Of a page file it comes from its leaves, whose places are rounded and whose
/// values are coded, and what is written says which share of the weight may be in other bins; --exact asks the source that it was built
/// from. With --error a part of the page file is read, and what is written says how far off the plot may be for it.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield plot galaxy.df --histogram temperature -o temperature.svg
  deepfield plot galaxy.df --phase density,temperature --family gas -o phase.png -o phase.csv
  deepfield plot galaxy.df --histogram temperature --weight count --bins 40 --scale log --sphere 21.9,39.0,33.1,1.5 -o halo.csv
  deepfield plot snapshot_099.hdf5 --scatter density,temperature --points 5000 --log -o scatter.png
  deepfield plot box.df --radial density --at groups.hdf5#0 --bins 40 -o halo.svg
  deepfield plot galaxy.df --radial temperature --about 21.9,39.0,33.1 --radius 1.5 --family gas --exact --json -
  deepfield plot huge.df --phase density,temperature --error 0.01 -o phase.png    reads what that takes, and says how much
  deepfield plot huge.df --radial temperature --at groups.hdf5#0 --error 0.05 -o halo.csv    shells with their errors
  deepfield plot run.df --time last --histogram density -o last.png")]
pub struct Arguments {
    /// The source, page file or run, or the URL of a built file.
    pub path: PathBuf,
    /// Histogram of a field: the weight in each of its bins.
    #[arg(long, value_name = "NAME", required_unless_present_any = ["phase", "scatter", "radial"],
        conflicts_with_all = ["phase", "scatter", "radial"])]
    pub histogram: Option<String>,
    /// Histogram of two fields together, the first one to the right: the weight in each cell as a colour.
    #[arg(long, value_name = "NAME,NAME", value_parser = pair, conflicts_with_all = ["scatter", "radial"])]
    pub phase: Option<[String; 2]>,
    /// Points at the values of two fields, of particles drawn at random: each as likely as any other, the same every time.
    #[arg(long, value_name = "NAME,NAME", value_parser = pair, conflicts_with_all = ["radial", "weight", "bins"])]
    pub scatter: Option<[String; 2]>,
    /// Profile in shells around the centre of the sphere: `density` is their mass over their volume, another name the mean of that
    /// field and its dispersion.
    #[arg(long, value_name = "NAME")]
    pub radial: Option<String>,
    /// Centre of a radial profile; its sphere has --radius [default: up to the farthest particle, in a periodic box half its edge].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, requires = "radial",
        conflicts_with_all = ["at", "object"])]
    pub about: Option<DVec3>,
    /// What particles count for: mass, count (each one), or their value of a field. Means of profiles are weighted with mass or count.
    #[arg(long, value_name = "WHAT", default_value_t)]
    pub weight: Weight,
    /// Bins of a histogram, cells to the right and upwards of a phase diagram, shells of a profile [default: 100, 256,256 or 50].
    #[arg(long, value_name = "N[,N]", value_parser = bins)]
    pub bins: Option<[usize; 2]>,
    /// From where to where the axis of a histogram goes, or those of a phase diagram: the first one given is of the first field [default:
    /// over all values].
    #[arg(long, value_name = "MIN,MAX", value_parser = range, allow_hyphen_values = true, conflicts_with_all = ["scatter", "radial"])]
    pub range: Vec<[f64; 2]>,
    /// Axes of fields and of the radius; auto: logarithmic where all values are positive and span more than a decade, and radii.
    #[arg(long, value_name = "SCALE", value_enum, default_value_t)]
    pub scale: PlotScale,
    /// As --scale log.
    #[arg(long, conflicts_with = "scale")]
    pub log: bool,
    /// The axis of weights, or their colours; auto: linear of a histogram, logarithmic of a phase diagram.
    #[arg(long, value_name = "SCALE", value_enum, default_value_t)]
    pub weight_scale: PlotScale,
    /// Most points of a scatter plot.
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub points: u32,
    /// Relative error that is enough, such as 0.01: of a page file as many pages are read as keep bins, shells with their means, or the shares
    /// of points in 16 by 16 cells to it, three standard errors, of those with less than a hundredth of the weight to as much of that
    /// hundredth; 0: all are read.
    #[arg(long, value_name = "E", value_parser = not_negative, conflicts_with = "exact")]
    pub error: Option<f64>,
    /// When it is asked.
    #[command(flatten)]
    pub when: At,
    /// Which particles [default: all].
    #[command(flatten)]
    pub region: RegionOptions,
    /// Which particles, wherever they are.
    #[command(flatten)]
    pub who: MembersOptions,
    /// Ask the source that the page file was built from.
    #[arg(long)]
    pub exact: bool,
    /// What is derived.
    #[command(flatten)]
    pub derive: DeriveOptions,
    /// Width and height of the picture, pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "900x600")]
    pub size: PictureSize,
    /// The table, .csv, or the plot, .png or .svg. May be given several times.
    #[arg(short, long, value_name = "OUT", required_unless_present = "json")]
    pub out: Vec<PathBuf>,
    /// Write the numbers as JSON to a file, or to standard output for `-`.
    #[arg(long, value_name = "FILE.json")]
    pub json: Option<PathBuf>,
    /// How the source or page file is read.
    #[arg(long, value_name = "HOW", value_enum, default_value_t)]
    pub read: ReadMethod,
}

/// Bins of a histogram, cells of each axis of a phase diagram, and shells of a profile, unless they are set.
const BINS: usize = 100;
const CELLS: usize = 256;
const SHELLS: usize = 50;

fn pair(text: &str) -> Result<[String; 2], String> {
    let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
    let pair = <[String; 2]>::try_from(names).ok().filter(|names| names.iter().all(|name| !name.is_empty()));
    pair.ok_or_else(|| "expected two fields with a comma between them, such as density,temperature".into())
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let ends: Option<Vec<f64>> = text.split(',').map(|end| end.trim().parse().ok()).collect();
    match ends.as_deref() {
        Some([min, max]) if min < max && (max - min).is_finite() => Ok([*min, *max]),
        _ => Err("expected two finite numbers in ascending order, such as 1e2,1e8".into()),
    }
}

fn bins(text: &str) -> Result<[usize; 2], String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some([both]) if *both > 0 => Ok([*both; 2]),
        Some([across, up]) if *across > 0 && *up > 0 => Ok([*across, *up]),
        _ => Err("expected a whole number from 1 on, or two such as 256,128".into()),
    }
}

/// Asks, and writes the plot.
///
/// # Errors
/// When the data cannot be read or has no such field, family or object, no particle has a place in the plot, or a file cannot be
/// written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, when, who, exact, derive, size, out, json, read, .. } = arguments;
    heights::refuse(path, "particles")?;
    let axes = if arguments.phase.is_some() { 2 } else { 1 };
    if arguments.range.len() > axes {
        let found = arguments.range.len();
        return Err(usage(format!("{}: --range: found {found}, expected one for each axis", path.display())));
    }
    if let Some(error) = arguments.error.filter(|error| *error >= 1.0) {
        eprintln!("deepfield: {}: --error: found {error}: what is plotted may be off by all of it", path.display());
    }
    let formats = out.iter().map(|out| Format::of(out)).collect::<Result<Vec<_>, _>>()?;
    let region = &arguments.region_options();
    let progress = TerminalProgress::new();
    let work = Work::told(&progress);
    let run = OpenRun::open(path, who, region, *read)?;
    let followed = run.as_ref().map(|run| run.snapshot(*when, work)).transpose()?.flatten();
    let is_followed = followed.is_some();
    let opened = match followed {
        Some(snapshot) => Opened::Source(Box::new(snapshot)),
        // Page files hold no ids.
        None if *exact || !who.is_region() => {
            derive.refuse(path, if *exact { "--exact" } else { "a selection by ids" })?;
            when.source(path, *read)?
        }
        None => derive.open(path, *when, *read, &progress)?,
    };
    let data = opened.data();
    let wanted = match &run {
        Some(run) => run.members.clone(),
        None => who.members(region, data)?,
    };
    // What is followed is nothing else.
    let members = if is_followed { Members::Region(Region::whole()) } else { wanted };
    let following = run.as_ref().and_then(|run| run.following.as_ref()).filter(|_| is_followed);
    let periodic = match following {
        Some(following) => following.periodic().filter(|_| !region.no_wrap),
        None => region.periodic(data)?,
    };
    let plot = arguments.plot(data, members, periodic, work)?;
    drop(progress);
    let notes = plot.notes();
    let (size, scales) = ([size.width, size.height], arguments.chart_scales());
    // What is derived is in a file of the cache, which nobody has named.
    let shown = if derive.is_empty() { data.path() } else { path.as_path() };
    for (out, format) in out.iter().zip(formats) {
        match format {
            Format::Csv => write_atomically(out, plot.csv().as_bytes())?,
            Format::Png => plot.chart(shown, &notes, scales, |chart| write_png(out, &chart.picture(size)))?,
            Format::Svg => {
                plot.chart(shown, &notes, scales, |chart| write_atomically(out, chart.svg(size).as_bytes()))?;
            }
        }
    }
    if let Some(out) = json {
        write_json(out, &Answer { path: shown, plot: &plot })?;
    }
    if json.as_deref() != Some(Path::new("-")) {
        for out in out {
            print_line(format_args!("{} in {}", plot.title(), out.display()))?;
        }
        notes.iter().try_for_each(|note| print_line(format_args!("{note}")))?;
    }
    Ok(())
}

impl Arguments {
    /// What names the region; the radius around `--about` is no object's.
    fn region_options(&self) -> RegionOptions {
        let radius = self.region.radius.filter(|_| self.about.is_none());
        RegionOptions { radius, ..self.region.clone() }
    }

    /// Whether axes of fields are logarithmic; `None` where that is left open.
    fn is_logarithmic(&self) -> Option<bool> {
        if self.log { Some(true) } else { self.scale.is_logarithmic() }
    }

    /// How the axes of its chart count.
    fn chart_scales(&self) -> ChartScales {
        ChartScales {
            fields: self.is_logarithmic(),
            weights: self.weight_scale.is_logarithmic(),
            by_count: self.weight == Weight::Count,
        }
    }

    /// What is to be found.
    fn options(&self) -> Result<PlotOptions, Failure> {
        let Arguments { weight, bins, .. } = self;
        let axis = |number: usize, field: &str, bins: usize| BinnedAxis {
            field: field.to_owned(),
            bins,
            logarithmic: self.is_logarithmic(),
            range: self.range.get(number).copied(),
        };
        if let Some(field) = &self.histogram {
            let axes = vec![axis(0, field, bins.map_or(BINS, |[bins, _]| bins))];
            return Ok(PlotOptions::Binned { axes, weight: weight.clone() });
        }
        if let Some([x, y]) = &self.phase {
            let [across, up] = bins.unwrap_or([CELLS; 2]);
            let axes = vec![axis(0, x, across), axis(1, y, up)];
            return Ok(PlotOptions::Binned { axes, weight: weight.clone() });
        }
        if let Some(fields) = &self.scatter {
            return Ok(PlotOptions::Scatter { fields: fields.clone(), points: self.points as usize });
        }
        if matches!(weight, Weight::Field(_)) {
            return Err(usage(format!("--weight: found {weight}, expected mass or count for a profile")));
        }
        Ok(PlotOptions::Radial(ProfileOptions {
            shells: bins.map_or(SHELLS, |[shells, _]| shells),
            inner: (self.is_logarithmic() != Some(false)).then_some(INNER),
            field: self.radial.clone().filter(|field| field != DENSITY),
        }))
    }

    /// Asks for what is plotted.
    fn plot(&self, data: Data, members: Members, periodic: Option<f64>, work: Work) -> Result<Plot, Failure> {
        let options = self.options()?;
        let members = match self.about {
            Some(center) => members_about(data, members, (center, self.region.radius), periodic, work)?,
            None => members,
        };
        let is_radial = matches!(options, PlotOptions::Radial(_));
        if is_radial && members.region().is_some_and(|region| region.first_sphere().is_none()) {
            let expected = "--about X,Y,Z, or a sphere: --sphere, --at or --object";
            return Err(usage(format!("--radial: found no centre, expected {expected}")));
        }
        let effort = Effort::within(self.error.unwrap_or_default());
        Plot::find(data, &members, &options, effort, periodic, work).map_err(|error| match &error {
            ExploreError::Value { field, .. } if ["bins", "profile.shells", "range"].contains(&field.as_str()) => {
                usage(error.to_string())
            }
            _ => error.into(),
        })
    }
}

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Csv,
    Png,
    Svg,
}

impl Format {
    fn of(path: &Path) -> Result<Format, Failure> {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        match extension.to_ascii_lowercase().as_str() {
            "csv" => Ok(Format::Csv),
            "png" => Ok(Format::Png),
            "svg" => Ok(Format::Svg),
            _ => Err(format!("{}: expected a name that ends in .csv, .png or .svg", path.display()).into()),
        }
    }
}

/// What `--json` writes.
#[derive(Serialize)]
struct Answer<'a> {
    path: &'a Path,
    #[serde(flatten)]
    plot: &'a Plot,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_bins_and_ranges_are_read() {
        assert_eq!(pair("density, temperature"), Ok(["density".into(), "temperature".into()]));
        for wrong in ["", "density", "density,", "a,b,c"] {
            assert!(pair(wrong).is_err(), "{wrong}");
        }
        assert_eq!((bins("30"), bins("30,40")), (Ok([30, 30]), Ok([30, 40])));
        for wrong in ["", "0", "3,0", "1,2,3", "-1", "x"] {
            assert!(bins(wrong).is_err(), "{wrong}");
        }
        assert_eq!(range("-1e2, 3"), Ok([-100.0, 3.0]));
        for wrong in ["", "1", "2,1", "1,1", "nan,1", "1,inf", "1,2,3"] {
            assert!(range(wrong).is_err(), "{wrong}");
        }
    }
}
