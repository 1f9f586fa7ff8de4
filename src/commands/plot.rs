//! `deepfield plot`: histograms, phase diagrams, scatter plots and radial profiles of a selection, as tables, pictures and SVG.

use super::arguments::{PictureSize, vector};
use super::members_options::{MembersOptions, OpenRun};
use super::probe::short;
use super::region_options::{At, Opened, RegionOptions};
use super::statistics::write_json;
use super::{CommandResult, progress_bar::TerminalProgress};
use crate::annotate::{Chart, ChartAxis, Marks, roomy};
use crate::color::output::{write_atomically, write_png};
use crate::explore::{
    Axis, Binned, BinnedAxis, Data, Members, ProfileOptions, Radial, Region, Shape, Weight, Work, binned, edges,
    farthest, radial, scatter,
};
use crate::model::{ReadMethod, Unit};
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Plots a selection or all: a histogram of a field, a phase diagram or scatter plot of two, or a radial profile.
///
/// Every particle counts. Of a source the answer is exact. Of a page file it comes from its leaves, whose places are rounded and whose
/// values are coded, and what is written says which share of the weight may be in other bins; --exact asks the source that it was built
/// from.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield plot galaxy.df --histogram temperature -o temperature.svg
  deepfield plot galaxy.df --phase density,temperature --family gas -o phase.png -o phase.csv
  deepfield plot galaxy.df --histogram temperature --weight count --bins 40 --scale log --sphere 21.9,39.0,33.1,1.5 -o halo.csv
  deepfield plot snapshot_099.hdf5 --scatter density,temperature --points 5000 --log -o scatter.png
  deepfield plot box.df --radial density --at groups.hdf5#0 --bins 40 -o halo.svg
  deepfield plot galaxy.df --radial temperature --about 21.9,39.0,33.1 --radius 1.5 --family gas --exact --json -
  deepfield plot run.df --time last --histogram density -o last.png")]
pub struct Arguments {
    /// The source, page file or run.
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
    pub scale: Scale,
    /// As --scale log.
    #[arg(long, conflicts_with = "scale")]
    pub log: bool,
    /// The axis of weights, or their colours; auto: linear of a histogram, logarithmic of a phase diagram.
    #[arg(long, value_name = "SCALE", value_enum, default_value_t)]
    pub weight_scale: Scale,
    /// Most points of a scatter plot.
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub points: u32,
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

/// How an axis counts.
#[derive(clap::ValueEnum, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// As values ask for.
    #[default]
    Auto,
    /// Equal differences are equally long.
    Linear,
    /// Equal ratios are equally long; zero and negative values are left out.
    Log,
}

impl Scale {
    /// Whether it is logarithmic; `None` where that is left open.
    fn is_logarithmic(self) -> Option<bool> {
        match self {
            Scale::Auto => None,
            Scale::Linear => Some(false),
            Scale::Log => Some(true),
        }
    }
}

/// Bins of a histogram, cells of each axis of a phase diagram, and shells of a profile, unless they are set.
const BINS: usize = 100;
const CELLS: usize = 256;
const SHELLS: usize = 50;
/// Radius of the innermost shell as a share of the sphere's, of logarithmic ones.
const INNER: f64 = 0.01;

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
    let Arguments { path, when, who, exact, size, out, json, read, .. } = arguments;
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
        None if *exact || !who.is_region() => Opened::source(path, *when, *read)?,
        None => Opened::open(path, *when, *read)?,
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
    let size = [size.width, size.height];
    for (out, format) in out.iter().zip(formats) {
        match format {
            Format::Csv => write_atomically(out, plot.csv().as_bytes())?,
            Format::Png => plot.chart(data.path(), &notes, arguments, |chart| write_png(out, &chart.picture(size)))?,
            Format::Svg => {
                plot.chart(data.path(), &notes, arguments, |chart| write_atomically(out, chart.svg(size).as_bytes()))?;
            }
        }
    }
    if let Some(out) = json {
        write_json(out, &Answer { path: data.path(), plot: &plot })?;
    }
    if json.as_deref() != Some(Path::new("-")) {
        for out in out {
            println!("{} in {}", plot.title(), out.display());
        }
        notes.iter().for_each(|note| println!("{note}"));
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

    /// Asks for what is plotted.
    fn plot(&self, data: Data, members: Members, periodic: Option<f64>, work: Work) -> Result<Plot, Failure> {
        let Arguments { weight, bins, .. } = self;
        let axis = |number: usize, field: &str, bins: usize| BinnedAxis {
            field: field.to_owned(),
            bins,
            logarithmic: self.is_logarithmic(),
            range: self.range.get(number).copied(),
        };
        if let Some(field) = &self.histogram {
            let axis = axis(0, field, bins.map_or(BINS, |[bins, _]| bins));
            return Ok(Plot::Binned(binned(data, &members, &[axis], weight, periodic, work)?));
        }
        if let Some([x, y]) = &self.phase {
            let [across, up] = bins.unwrap_or([CELLS; 2]);
            return Ok(Plot::Binned(binned(
                data,
                &members,
                &[axis(0, x, across), axis(1, y, up)],
                weight,
                periodic,
                work,
            )?));
        }
        if let Some([x, y]) = &self.scatter {
            let found = scatter(data, &members, [x.as_str(), y.as_str()], self.points as usize, periodic, work)?;
            let unit = |field: &str| data.unit_of(field).unwrap_or_default();
            let fields = [x, y].map(|field| ScatterAxis { field: field.clone(), unit: unit(field) });
            return Ok(Plot::Scatter { fields, x: found.x, y: found.y, of: found.of, exact: data.is_exact() });
        }
        let field = self.radial.clone().filter(|field| field != "density");
        if matches!(weight, Weight::Field(_)) {
            return Err(format!("--weight is {weight}, expected mass or count for a profile").into());
        }
        let members = self.around(data, members, periodic, work)?;
        if members.region().is_some_and(|region| region.first_sphere().is_none()) {
            return Err("--radial: expected --about X,Y,Z, or a sphere: --sphere, --at or --object".into());
        }
        let options = ProfileOptions {
            shells: bins.map_or(SHELLS, |[shells, _]| shells),
            inner: (self.is_logarithmic() != Some(false)).then_some(INNER),
            field,
        };
        Ok(Plot::Radial(radial(data, &members, &options, periodic, work)?))
    }

    /// The members within the sphere about the centre of a profile, which is the first of their shapes.
    fn around(&self, data: Data, members: Members, periodic: Option<f64>, work: Work) -> Result<Members, Failure> {
        match (members, self.about) {
            (Members::Region(mut region), Some(center)) => {
                let radius = match (self.region.radius, periodic) {
                    (Some(radius), _) => radius,
                    (None, Some(edge)) => 0.5 * edge,
                    // What rounding puts a hair outside belongs to it.
                    (None, None) => (1.0 + 1e-9) * farthest(data, &region, center, work)?,
                };
                region.shapes.insert(0, Shape::Sphere { center, radius });
                Ok(Members::Region(region))
            }
            (members, _) => Ok(members),
        }
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

/// What was found.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Plot {
    /// A histogram or a phase diagram.
    Binned(Binned),
    Scatter {
        fields: [ScatterAxis; 2],
        x: Vec<f64>,
        y: Vec<f64>,
        of: u64,
        exact: bool,
    },
    Radial(Radial),
}

/// A field along an axis of a scatter plot.
#[derive(Debug, Serialize)]
struct ScatterAxis {
    field: String,
    unit: Unit,
}

/// A name with its unit, where that is known.
fn named(name: &str, unit: &Unit) -> String {
    if unit.is_unknown() { name.to_owned() } else { format!("{name} [{unit}]") }
}

/// A share in words.
fn percent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "none".into(),
        share if share.is_nan() || share >= 100.0 => "all".into(),
        share if share < 0.01 => "less than 0.01 %".into(),
        share => format!("{share:.2} %"),
    }
}

/// A share by the mean errors of codebooks, and by the largest ones, which none exceeds.
fn by_errors(mean: f64, most: f64) -> String {
    match percent(most).as_str() {
        "none" => "none".into(),
        most => format!("{} by mean errors, {most} by the largest", percent(mean)),
    }
}

/// The unit of a mass over a volume.
fn density_unit(mass: &Unit, length: &Unit) -> Unit {
    if mass.is_unknown() || length.is_unknown() {
        return Unit::default();
    }
    let volume = if length.0.contains(['/', ' ']) { format!("({length})^3") } else { format!("{length}^3") };
    Unit::new(format!("{mass}/{volume}"))
}

/// Rows of a table with a header.
struct Table {
    text: String,
}

impl Table {
    fn new(columns: &[String]) -> Table {
        let quoted = |name: &String| {
            let plain = !name.contains([',', '"', '\n', '\r']);
            if plain { name.clone() } else { format!("\"{}\"", name.replace('"', "\"\"").replace(['\n', '\r'], " ")) }
        };
        Table { text: columns.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n" }
    }

    /// Adds a row of numbers, each with as many digits as it takes to read the same one back; `None` is left empty.
    fn row(&mut self, values: &[Option<f64>], count: Option<u64>) {
        for (i, value) in values.iter().enumerate() {
            if i > 0 {
                self.text.push(',');
            }
            // Writing to a string cannot fail.
            let _ = value.iter().try_for_each(|value| write!(self.text, "{value:?}"));
        }
        let _ = count.iter().try_for_each(|count| write!(self.text, ",{count}"));
        self.text.push('\n');
    }
}

impl Plot {
    /// What it shows, without units.
    fn title(&self) -> String {
        match self {
            Plot::Binned(Binned { axes, weight, .. }) => {
                let names: Vec<&str> = axes.iter().rev().map(|axis| axis.field.as_str()).collect();
                format!("{weight} by {}", names.join(" over "))
            }
            Plot::Scatter { fields: [x, y], .. } => format!("{} over {}", y.field, x.field),
            Plot::Radial(Radial { field, .. }) => format!("{} over radius", field.as_deref().unwrap_or("density")),
        }
    }

    /// What is to be said of it: of how many particles it is, who was left out, and how exact it is.
    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let from = |exact: bool| if exact { "every particle of the source" } else { "leaves of the page file" };
        match self {
            Plot::Binned(found) => {
                let what = if found.weight == Weight::Count { "particles" } else { "weight" };
                let mut about = format!("{} particles, {}", found.count, from(found.exact));
                if let Some(error) = &found.error {
                    let _ = write!(
                        about,
                        "; {what} that may be in other bins: {}",
                        by_errors(error.other_bins_by_mean, error.other_bins)
                    );
                    if error.weights > 0.0 {
                        let _ = write!(about, ", off in weight: {}", by_errors(error.weights_by_mean, error.weights));
                    }
                    match error.region {
                        Some(0.0) => {}
                        Some(share) => {
                            let _ = write!(about, ", in or out of the region: {}", percent(share));
                        }
                        None => about.push_str(", some may be in or out of the region"),
                    }
                }
                notes.push(about);
                if found.not_positive > 0 {
                    let axes = found.axes.iter().filter(|axis| axis.logarithmic).map(|axis| axis.field.as_str());
                    let names = axes.collect::<Vec<_>>().join(" or ");
                    notes.push(format!("{} particles left out: {names} is not positive", found.not_positive));
                }
                if found.outside > 0 {
                    notes.push(format!("{} particles left out: beyond the range", found.outside));
                }
                if found.missing > 0 {
                    notes.push(format!("{} particles left out: without a value", found.missing));
                }
                let missing = found.error.map_or(0, |error| error.missing_values);
                notes.extend(stand_ins(missing));
            }
            Plot::Scatter { x, of, exact, .. } => {
                notes.push(format!("{} of {of} particles, {}", x.len(), from(*exact)));
            }
            Plot::Radial(found) => {
                let mut about = format!("{} particles, {}", found.count, from(found.exact));
                if let Some(error) = &found.error {
                    let _ = write!(about, "; mass that may be in other shells: {}", percent(error.other_shells));
                    if error.region > 0.0 {
                        let _ = write!(about, ", in or out of the sphere: {}", percent(error.region));
                    }
                    if error.masses > 0.0 {
                        let _ = write!(about, ", off in mass: {}", by_errors(error.masses_by_mean, error.masses));
                    }
                    if let (Some(mean), Some(most)) = (error.values_by_mean, error.values)
                        && most > 0.0
                    {
                        let [mean, most] = [mean, most].map(short);
                        let _ = write!(about, ", values off by {mean} by mean errors, {most} by the largest");
                    }
                }
                notes.push(about);
                notes.extend(stand_ins(found.error.map_or(0, |error| error.missing_values)));
            }
        }
        notes
    }

    /// The table, with a header that has names and units.
    fn csv(&self) -> String {
        match self {
            Plot::Binned(found) => {
                let ends = |axis: &Axis| ["from", "to"].map(|end| named(&format!("{} {end}", axis.field), &axis.unit));
                let mut columns: Vec<String> = found.axes.iter().flat_map(ends).collect();
                let is_count = found.weight == Weight::Count;
                // A count is there once.
                columns.extend((!is_count).then(|| named(&found.weight.to_string(), &found.weight_unit)));
                columns.push("count".into());
                let mut table = Table::new(&columns);
                let all: Vec<Vec<f64>> = found.axes.iter().map(edges).collect();
                for (cell, (&weight, &count)) in found.weights.iter().zip(&found.counts).enumerate() {
                    // Most pairs of bins hold nothing.
                    if count == 0 && all.len() > 1 {
                        continue;
                    }
                    let mut rest = cell;
                    let mut row = [None; 5];
                    let mut length = 0;
                    for edges in &all {
                        let bin = rest % (edges.len() - 1);
                        rest /= edges.len() - 1;
                        row[length..length + 2].copy_from_slice(&[Some(edges[bin]), Some(edges[bin + 1])]);
                        length += 2;
                    }
                    if !is_count {
                        row[length] = Some(weight);
                        length += 1;
                    }
                    table.row(&row[..length], Some(count));
                }
                table.text
            }
            Plot::Scatter { fields, x, y, .. } => {
                let mut table = Table::new(&fields.each_ref().map(|axis| named(&axis.field, &axis.unit)));
                x.iter().zip(y).for_each(|(&x, &y)| table.row(&[Some(x), Some(y)], None));
                table.text
            }
            Plot::Radial(found) => {
                let Radial { length_unit: length, mass_unit: mass, field_unit, .. } = found;
                let mut columns = vec![
                    named("radius from", length),
                    named("radius to", length),
                    named("mass", mass),
                    named("density", &density_unit(mass, length)),
                ];
                if let Some(field) = &found.field {
                    let of = ["mean", "dispersion", "mass-weighted mean", "mass-weighted dispersion"];
                    columns.extend(of.map(|what| named(&format!("{what} {field}"), field_unit)));
                }
                columns.push("count".into());
                let mut table = Table::new(&columns);
                for shell in &found.shells {
                    let mut row = vec![Some(shell.from), Some(shell.to), Some(shell.mass), Some(shell.density)];
                    if found.field.is_some() {
                        row.extend([shell.mean, shell.dispersion]);
                        row.extend([shell.mass_weighted_mean, shell.mass_weighted_dispersion]);
                    }
                    table.row(&row, Some(shell.count));
                }
                table.text
            }
        }
    }

    /// Hands over the plot of what is in the file `path`.
    fn chart<T>(&self, path: &Path, notes: &[String], arguments: &Arguments, write: impl FnOnce(&Chart) -> T) -> T {
        let file = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        let title = format!("{file}: {}", self.title());
        let note = notes.join("; ");
        match self {
            Plot::Binned(found) => {
                let weight = named(&format!("{} per bin", found.weight), &found.weight_unit);
                let all: Vec<Vec<f64>> = found.axes.iter().map(edges).collect();
                let titles: Vec<String> = found.axes.iter().map(|axis| named(&axis.field, &axis.unit)).collect();
                let place = |number: usize| ChartAxis {
                    title: &titles[number],
                    range: [found.axes[number].min, found.axes[number].max],
                    logarithmic: found.axes[number].logarithmic,
                };
                let is_phase = found.axes.len() > 1;
                let scale = arguments.weight_scale.is_logarithmic().unwrap_or(is_phase);
                let weights = weight_axis(&weight, &found.weights, scale, is_phase);
                let (up, marks) = if is_phase {
                    let edges = [all[0].as_slice(), all[1].as_slice()];
                    (place(1), Marks::Cells { edges, values: &found.weights, colors: weights })
                } else {
                    (weights, Marks::Bars { edges: &all[0], values: &found.weights })
                };
                write(&Chart { title: &title, note: &note, across: place(0), up, marks })
            }
            Plot::Scatter { fields, x, y, .. } => {
                let titles = fields.each_ref().map(|axis| named(&axis.field, &axis.unit));
                let axis = |number: usize, values: &[f64]| {
                    let ends = |[low, high]: [f64; 2], value: &f64| [low.min(*value), high.max(*value)];
                    let [low, high] = values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], ends);
                    let logarithmic = arguments.is_logarithmic().unwrap_or(low > 0.0 && high > 10.0 * low);
                    let range = roomy(values.iter().copied(), logarithmic).unwrap_or([1.0, 10.0]);
                    ChartAxis { title: &titles[number], range, logarithmic }
                };
                let marks = Marks::Points { x, y };
                write(&Chart { title: &title, note: &note, across: axis(0, x), up: axis(1, y), marks })
            }
            Plot::Radial(found) => {
                let is_logarithmic = arguments.is_logarithmic() != Some(false);
                let across = named("radius", &found.length_unit);
                let by_count = arguments.weight == Weight::Count;
                let mut points = Vec::with_capacity(found.shells.len());
                let mut spreads = Vec::new();
                for shell in found.shells.iter().filter(|shell| shell.count > 0) {
                    // The innermost shell has no middle in the logarithm.
                    let middle = match is_logarithmic && shell.from > 0.0 {
                        true => (shell.from * shell.to).sqrt(),
                        false => 0.5 * (shell.from + shell.to),
                    };
                    let (mean, dispersion) = match by_count {
                        true => (shell.mean, shell.dispersion),
                        false => (shell.mass_weighted_mean, shell.mass_weighted_dispersion),
                    };
                    match (&found.field, mean) {
                        (None, _) => points.push([middle, shell.density]),
                        (Some(_), None) => {}
                        (Some(_), Some(mean)) => {
                            let dispersion = dispersion.unwrap_or_default();
                            points.push([middle, mean]);
                            spreads.push([mean - dispersion, mean + dispersion]);
                        }
                    }
                }
                let values = || points.iter().map(|point| point[1]).chain(spreads.iter().flatten().copied());
                let (low, high) = values()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
                let up_logarithmic = arguments.weight_scale.is_logarithmic().unwrap_or(low > 0.0 && high > 10.0 * low);
                let up = match &found.field {
                    Some(field) => named(field, &found.field_unit),
                    None => named("density", &density_unit(&found.mass_unit, &found.length_unit)),
                };
                let radii = points.iter().map(|point| point[0]);
                let outermost = found.shells.last().map_or(1.0, |shell| shell.to);
                let across_range = match is_logarithmic {
                    true => {
                        roomy(radii, true).map_or([0.1, 1.0], |[low, high]| [low, high.min(outermost).max(1.1 * low)])
                    }
                    false => [0.0, outermost],
                };
                write(&Chart {
                    title: &title,
                    note: &note,
                    across: ChartAxis { title: &across, range: across_range, logarithmic: is_logarithmic },
                    up: ChartAxis {
                        title: &up,
                        range: roomy(values(), up_logarithmic).unwrap_or([1.0, 10.0]),
                        logarithmic: up_logarithmic,
                    },
                    marks: Marks::Line { points: &points, spreads: &spreads },
                })
            }
        }
    }
}

/// A note about values that a source does not have.
fn stand_ins(missing: u64) -> Option<String> {
    (missing > 0).then(|| format!("{missing} values that the source lacks count as the mean of their family"))
}

/// The axis of weights: from zero where bars stand on it, else over the weights.
fn weight_axis<'a>(title: &'a str, weights: &[f64], logarithmic: bool, is_phase: bool) -> ChartAxis<'a> {
    let placed = weights.iter().copied();
    let range = match logarithmic {
        true if is_phase => {
            let range = placed.filter(|weight| *weight > 0.0 && weight.is_finite());
            let ends = |[low, high]: [f64; 2], weight: f64| [low.min(weight), high.max(weight)];
            let [low, high] = range.fold([f64::INFINITY, f64::NEG_INFINITY], ends);
            if high > low { [low, high] } else { [0.5 * low.min(1e300), 2.0 * low.min(1e300)] }
        }
        true => roomy(placed, true).unwrap_or([1.0, 10.0]),
        false => {
            let (low, high) =
                placed.fold((0.0_f64, 0.0_f64), |(low, high), weight| (low.min(weight), high.max(weight)));
            let room = if is_phase { 1.0 } else { 1.05 };
            [if is_phase { 0.0 } else { room * low }, if high > 0.0 { room * high } else { 1.0 }]
        }
    };
    ChartAxis { title, range, logarithmic }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_bins_and_shares_are_read_and_told() {
        assert_eq!(pair("density, temperature"), Ok(["density".into(), "temperature".into()]));
        for wrong in ["", "density", "density,", "a,b,c"] {
            assert!(pair(wrong).is_err(), "{wrong}");
        }
        assert_eq!((bins("30"), bins("30,40")), (Ok([30, 30]), Ok([30, 40])));
        for wrong in ["", "0", "3,0", "1,2,3", "-1", "x"] {
            assert!(bins(wrong).is_err(), "{wrong}");
        }
        let told = [0.0, 1e-6, 0.0123, 1.0, f64::INFINITY].map(percent);
        assert_eq!(told, ["none", "less than 0.01 %", "1.23 %", "all", "all"]);
        assert_eq!(by_errors(0.0, 0.0), "none");
        assert_eq!(by_errors(0.25, 2.0), "25.00 % by mean errors, all by the largest");
        assert_eq!(range("-1e2, 3"), Ok([-100.0, 3.0]));
        for wrong in ["", "1", "2,1", "1,1", "nan,1", "1,inf", "1,2,3"] {
            assert!(range(wrong).is_err(), "{wrong}");
        }
        assert_eq!(density_unit(&Unit::new("Msun"), &Unit::new("kpc")).0, "Msun/kpc^3");
        assert_eq!(density_unit(&Unit::new("Msun"), &Unit::new("Mpc/h")).0, "Msun/(Mpc/h)^3");
        assert!(density_unit(&Unit::default(), &Unit::new("kpc")).is_unknown());
    }
}
