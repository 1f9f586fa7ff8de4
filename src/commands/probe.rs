//! `deepfield probe`: sums over everything in a region, as tables for people or as JSON for programs.

use super::arguments::Given;
use super::derive_options::DeriveOptions;
use super::frame_option::{FrameName, unknown};
use super::heights::probe::HeightsProbe;
use super::heights::{self, StatedOptions};
use super::members_options::{MembersOptions, OpenRun};
use super::region_options::{At, RegionOptions};
use super::statistics::write_json;
use super::{CommandResult, progress_bar::TerminalProgress, text_of};
pub(super) use crate::annotate::number::short;
use crate::color::output::write_atomically;
use crate::explore::probe::{FamilyProbe, FieldStatistics, Probe, Profile};
use crate::explore::{
    AxisOptions, Data, FieldHistogram, Fields, Members, Opened, OverTime, ProbeOptions, ProfileOptions, Region, Shape,
    Work, histogram, over_time, probe,
};
use crate::look::is_field;
use crate::model::{ReadMethod, When};
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Sums up what is in a region: count, mass, means and dispersions of each field, a radial profile; over the whole data; of heights their
/// roughness, a profile, or what is at a place.
///
/// Of an image or a volume: what its samples hold, and a histogram of their values.
///
/// Of heights: numbers of roughness (ISO 25178-2) of a region, a profile, the height at a place, or the samples under pixels of a picture.
///
/// Of a source every particle is looked at, and the answer is exact. Of a page file the answer comes from its leaves, and says how far
/// off it may be; --exact asks the source that it was built from.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield probe snapshot_099.hdf5 --sphere 21.9,39.0,33.1,1.5 --profile 20
  deepfield probe box.df --at groups.hdf5#0 --profile 12 --profile-field velocity-dispersion
  deepfield probe box.df --object \"Subhalo 12\" --catalogue groups.hdf5 --radius 0.5 --exact
  deepfield probe galaxy.df --family gas --where temperature:1e4..1e6 --where density:10.. --json -
  deepfield probe run.df --tracked-at 9.6 --sphere 0.3,0,0,0.5 --over-time -o halo.csv
  deepfield probe galaxy.df --family gas --histogram temperature --bins 20
  deepfield probe surface.sur --form plane --l-filter 0.08    heights: Sa, Sq and the others, without form and waviness
  deepfield probe dem.df --line 0,0,900,600 -o profile.csv    or profile.png, a plot
  deepfield probe surface.sur --form plane -o ratio.png       the material ratio curve
  deepfield probe dem.df --pixel 640,400 --eye 0,-900,700 --target 450,300,0
  deepfield probe head.nrrd --sphere 120,110,60,20          a volume: mean, dispersion and histogram, the value in the middle")]
pub struct Arguments {
    /// The source, page file or run; or an image, a volume or heights, built or not; or the URL of a built file.
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
    /// At every step of the run, one row each: time, count, mass, centre, velocities, and the mean of each field.
    #[arg(long, conflicts_with_all = ["time", "interpolation", "profile", "histograms", "exact", "derive"])]
    pub over_time: bool,
    /// The frame of places, distances and velocities over time of a comoving run; means of fields are as they are stored.
    #[arg(long, value_name = "FRAME", value_enum, default_value_t, requires = "over_time")]
    pub frame: FrameName,
    /// Write the table over time, the profile along a line of heights, or the material ratio curve of a region of them, to a file; of the last two a
    /// plot, where its name ends in .png.
    #[arg(short, long, value_name = "FILE.csv")]
    pub out: Option<PathBuf>,
    /// Shells of a radial profile in the sphere.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub profile: Option<u32>,
    /// Radius of the innermost shell as a share of the sphere's, for shells of equal width in the logarithm; 0: shells of equal width.
    #[arg(long, value_name = "SHARE", default_value_t = 0.01, value_parser = share, requires = "profile")]
    pub profile_inner: f64,
    /// The field whose mean and dispersion are taken in each shell.
    #[arg(long, value_name = "NAME", requires = "profile")]
    pub profile_field: Option<String>,
    /// Only these fields, by name; several separated by commas; `none` for count and mass alone [default: all].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub fields: Vec<String>,
    /// Histogram of a field, or of two together: NAME or NAME,NAME. May be given several times.
    #[arg(long = "histogram", value_name = "NAMES", value_parser = fields)]
    pub histograms: Vec<Vec<String>>,
    /// Bins along each axis of a histogram [default: 32].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub bins: Option<u32>,
    /// Ask the source that the page file was built from.
    #[arg(long)]
    pub exact: bool,
    /// What is derived.
    #[command(flatten)]
    pub derive: DeriveOptions,
    /// Write JSON to a file, or to standard output for `-`, instead of tables.
    #[arg(long, value_name = "FILE.json")]
    pub json: Option<PathBuf>,
    /// How the source or page file is read.
    #[arg(long, value_name = "HOW", value_enum, default_value_t)]
    pub read: ReadMethod,
    /// What is said of heights.
    #[command(flatten)]
    pub said: StatedOptions,
    /// What is asked of heights.
    #[command(flatten)]
    pub heights: HeightsProbe,
}

/// Bins of a histogram unless they are set.
const BINS: u32 = 32;

fn share(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| (0.0..1.0).contains(value));
    value.ok_or_else(|| "expected a share of the radius from 0 to below 1".into())
}

fn fields(text: &str) -> Result<Vec<String>, String> {
    let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
    let sound = names.len() <= 2 && names.iter().all(|name| !name.is_empty());
    if sound { Ok(names) } else { Err("expected a field, or two with a comma between them".into()) }
}

/// What `--json` writes.
#[derive(Serialize)]
struct Answer<'a> {
    path: &'a Path,
    region: &'a Region,
    /// Of those that are followed, when they are in the region.
    #[serde(skip_serializing_if = "Option::is_none")]
    tracked_at: Option<When>,
    #[serde(flatten)]
    probe: &'a Probe,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    histograms: Vec<FieldHistogram>,
}

/// Asks and prints.
///
/// # Errors
/// When the data cannot be read, or has no such field, family or object.
pub fn run(arguments: &Arguments) -> CommandResult {
    if arguments.said.takes(&arguments.path) {
        let Arguments { path, said, heights: asked, out, json, .. } = arguments;
        let own = "; heights take --point, --line, --rectangle, --disc and --pixel";
        heights::refuse_options(path, &arguments.of_particles(), own)?;
        return heights::probe::run(path, said, asked, out.as_deref(), json.as_deref());
    }
    let of_heights = [&arguments.said.given()[..], &arguments.heights.given()].concat();
    heights::refuse_without(&arguments.path, &of_heights)?;
    if arguments.out.is_some() && !arguments.over_time {
        return Err("-o: expected --over-time beside it, or heights".into());
    }
    if is_field(&arguments.path) {
        if !arguments.derive.is_empty() {
            let path = arguments.path.display();
            return Err(
                format!("{path}: --derive: found an image or a volume, expected particles with velocities").into()
            );
        }
        return super::field_probe::run(arguments);
    }
    let progress = TerminalProgress::new();
    let work = Work::told(&progress);
    let run = OpenRun::open(&arguments.path, &arguments.who, &arguments.region, arguments.read)?;
    if arguments.over_time {
        let path = arguments.path.display();
        let run = run.ok_or_else(|| format!("{path}: --over-time: expected a run: deepfield build makes one"))?;
        let wraps = !arguments.region.no_wrap;
        let mut found = over_time(&run.run, run.following.as_ref(), &run.members, &arguments.fields(), wraps, work)?;
        drop(progress);
        if arguments.frame == FrameName::Physical {
            found.to_physical(&run.run).ok_or_else(|| unknown(&arguments.path))?;
        }
        return arguments.write_over_time(&found, &run.members);
    }
    let followed = run.as_ref().map(|run| run.snapshot(arguments.when, work)).transpose()?.flatten();
    let (is_followed, is_region) = (followed.is_some(), arguments.who.is_region());
    let opened = match followed {
        Some(snapshot) => Opened::Source(Box::new(snapshot)),
        // Page files hold no ids.
        None if arguments.exact || !is_region => {
            arguments.derive.refuse(&arguments.path, if arguments.exact { "--exact" } else { "a selection by ids" })?;
            arguments.when.source(&arguments.path, arguments.read)?
        }
        None => arguments.derive.open(&arguments.path, arguments.when, arguments.read, &progress)?,
    };
    let data = opened.data();
    let wanted = match &run {
        Some(run) => run.members.clone(),
        None => arguments.who.members(&arguments.region, data)?,
    };
    let region = wanted.region().cloned().unwrap_or_default();
    let whom = in_words(&wanted, data);
    let tracked_at = match &wanted {
        Members::Tracked { at, .. } => Some(*at),
        _ => None,
    };
    // What is followed is nothing else.
    let members = if is_followed { Members::Region(Region::whole()) } else { wanted };
    let following = run.as_ref().and_then(|run| run.following.as_ref()).filter(|_| is_followed);
    let periodic = match following {
        Some(following) => following.periodic().filter(|_| !arguments.region.no_wrap),
        None => arguments.region.periodic(data)?,
    };
    let options = ProbeOptions {
        fields: arguments.fields(),
        profile: arguments.profile.map(|shells| ProfileOptions {
            shells: shells as usize,
            inner: (arguments.profile_inner > 0.0).then_some(arguments.profile_inner),
            field: arguments.profile_field.clone(),
        }),
        periodic,
    };
    let found = probe(data, &members, &options, work)?;
    let bins = arguments.bins();
    let histograms = arguments.histograms.iter().map(|names| {
        let axes: Vec<AxisOptions> = names.iter().map(|name| AxisOptions::new(name, bins)).collect();
        histogram(data, &members, &axes, options.periodic, work)
    });
    let histograms = histograms.collect::<Result<Vec<_>, _>>()?;
    drop(progress);
    if let Some(out) = &arguments.json {
        // What is derived is in a file of the cache, which nobody has named.
        let path = if arguments.derive.is_empty() { data.path() } else { &arguments.path };
        return write_json(out, &Answer { path, region: &region, tracked_at, probe: &found, histograms });
    }
    let text = text_of(|text| {
        write_tables(text, data, &whom, &found)?;
        histograms.iter().try_for_each(|histogram| write_histogram(text, histogram))
    });
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}

impl Arguments {
    /// The options of particles alone, and which of them are given. Heights are always asked as --exact says.
    fn of_particles(&self) -> Vec<Given> {
        let own = [
            ("--over-time", self.over_time),
            ("--profile", self.profile.is_some()),
            ("--fields", !self.fields.is_empty()),
            ("--histogram", !self.histograms.is_empty()),
            ("--bins", self.bins.is_some()),
            ("--derive", !self.derive.is_empty()),
        ];
        [&self.when.given()[..], &self.region.given(), &self.who.given(), &own].concat()
    }

    /// Bins along each axis of a histogram.
    pub(super) fn bins(&self) -> usize {
        self.bins.unwrap_or(BINS) as usize
    }

    /// Whose statistics.
    fn fields(&self) -> Fields {
        match self.fields.as_slice() {
            [] => Fields::All,
            [none] if none == "none" => Fields::None,
            names => Fields::Named(names.to_vec()),
        }
    }

    /// Writes what was found at every step: where it is asked for, else as a table for people.
    fn write_over_time(&self, found: &OverTime, members: &Members) -> CommandResult {
        if let Some(out) = &self.out {
            write_atomically(out, found.csv().as_bytes())?;
        }
        if let Some(out) = &self.json {
            return write_json(out, &AnswerOverTime { path: &self.path, members, over_time: found });
        }
        let text = match &self.out {
            Some(out) => format!("{} steps in {}\n", found.steps.len(), out.display()),
            None => found.csv(),
        };
        Ok(std::io::stdout().write_all(text.as_bytes())?)
    }
}

/// What `--over-time --json` writes.
#[derive(Serialize)]
struct AnswerOverTime<'a> {
    path: &'a Path,
    members: &'a Members,
    #[serde(flatten)]
    over_time: &'a OverTime,
}

/// The tables for people.
fn write_tables(text: &mut String, data: Data, whom: &str, probe: &Probe) -> std::fmt::Result {
    let length = &probe.length_unit;
    writeln!(text, "{}: {} particles {whom}", data.path().display(), probe.count)?;
    writeln!(text, "mass: {} {}", short(probe.mass), probe.mass_unit)?;
    if let Some([x, y, z]) = probe.center_of_mass {
        writeln!(text, "centre of mass: {}, {}, {} {length}", short(x), short(y), short(z))?;
    }
    if let Some(edge) = probe.periodic_edge {
        writeln!(text, "distances go round the periodic box of {} {length}", short(edge))?;
    }
    let source = if probe.exact { "every particle of the source" } else { "the page file; --exact asks its source" };
    writeln!(text, "from {source}")?;
    for family in &probe.families {
        write_family(text, family, probe)?;
    }
    probe.profile.iter().try_for_each(|profile| write_profile(text, profile, probe))
}

/// Who is asked for.
fn in_words(members: &Members, data: Data) -> String {
    match members {
        Members::Region(region) => described(region, data),
        // Where these differ, the data lacks some of the ids, or has others several times.
        Members::Ids(ids) => format!("with one of {} ids", ids.len()),
        Members::Tracked { at, region } => format!("that are {} at {at}", described(region, data)),
    }
}

/// The region in words.
fn described(region: &Region, data: Data) -> String {
    let unit = data.length_unit();
    let point = |at: &glam::DVec3| format!("({}, {}, {})", short(at.x), short(at.y), short(at.z));
    let shapes = region.shapes.iter().map(|shape| match shape {
        Shape::Sphere { center, radius } => format!("within {} {unit} of {}", short(*radius), point(center)),
        Shape::Box { min, max } => format!("in the box from {} to {} {unit}", point(min), point(max)),
        Shape::Lasso(lasso) => format!("in a lasso of {} corners", lasso.polygon.len()),
    });
    let ranges = region.ranges.iter().map(|range| {
        let end = |end: Option<f64>| end.map_or(String::new(), short);
        format!("with {} {}..{}", range.field, end(range.min), end(range.max))
    });
    let families: Vec<&str> = region.families.iter().map(|family| family.as_str()).collect();
    let families = (!families.is_empty()).then(|| format!("of {}", families.join(" and ")));
    let all: Vec<String> = shapes.chain(ranges).chain(families).collect();
    if all.is_empty() { "in all".into() } else { all.join(", ") }
}

fn write_family(text: &mut String, family: &FamilyProbe, probe: &Probe) -> std::fmt::Result {
    let (length, mass) = (&probe.length_unit, &probe.mass_unit);
    writeln!(text, "\n{}: {} particles, mass {}", family.name, family.count, short(family.mass))?;
    if let Some(uncertain) = family.uncertain.filter(|uncertain| uncertain.position > 0.0) {
        let (count, heavy, position) = (uncertain.count, short(uncertain.mass), short(uncertain.position));
        writeln!(
            text,
            "  coordinates are rounded by up to {position} {length}: {count} particles (mass {heavy} {mass}) may be in or out"
        )?;
    }
    if let Some(velocity) = &family.velocity {
        let vector = |v: [f64; 3]| v.map(short).join(", ");
        writeln!(text, "  mean velocity: {}", vector(velocity.mean))?;
        let one = short(velocity.dispersion_1d);
        writeln!(
            text,
            "  velocity dispersion: {one} along a line of sight; {} along x, y, z",
            vector(velocity.dispersion)
        )?;
    }
    if family.fields.is_empty() {
        return Ok(());
    }
    let head = ["mean", "dispersion", "by mass: mean", "dispersion", "min", "max"];
    write!(text, "  {:<24} {:<20}", "field", "unit")?;
    head.iter().try_for_each(|name| write!(text, " {name:>14}"))?;
    writeln!(text, "{}", if probe.exact { "" } else { "  coded within (mean, most)" })?;
    family.fields.iter().try_for_each(|field| write_field(text, field))
}

fn write_field(text: &mut String, field: &FieldStatistics) -> std::fmt::Result {
    write!(text, "  {:<24} {:<20}", field.name, field.unit.to_string())?;
    let values =
        [field.mean, field.dispersion, field.mass_weighted_mean, field.mass_weighted_dispersion, field.min, field.max];
    values.iter().try_for_each(|value| write!(text, " {:>14}", value.map_or("-".into(), short)))?;
    if let Some(error) = field.error {
        let of = error.of_range.map_or("", |_| " of the range");
        write!(text, "  {:.2} %, {:.2} %{of}", 100.0 * error.mean, 100.0 * error.max)?;
        if error.missing > 0 {
            write!(text, "; {} of the family have none and count as its mean", error.missing)?;
        }
    }
    writeln!(text)
}

fn write_profile(text: &mut String, profile: &Profile, probe: &Probe) -> std::fmt::Result {
    let (length, mass) = (&probe.length_unit, &probe.mass_unit);
    let field = profile.field.as_deref().map_or(String::new(), |field| format!("; mean and dispersion of {field}"));
    writeln!(text, "\nprofile: radii in {length}, masses in {mass}{field}")?;
    let mut head = vec!["from", "to", "particles", "mass", "density"];
    head.extend(profile.field.iter().flat_map(|_| ["mean", "dispersion"]));
    head.iter().try_for_each(|name| write!(text, " {name:>14}"))?;
    writeln!(text)?;
    for shell in &profile.shells {
        write!(text, " {:>14} {:>14} {:>14}", short(shell.from), short(shell.to), shell.count)?;
        write!(text, " {:>14} {:>14}", short(shell.mass), short(shell.density))?;
        if profile.field.is_some() {
            let cell = |value: Option<f64>| value.map_or("-".into(), short);
            write!(text, " {:>14} {:>14}", cell(shell.mean), cell(shell.dispersion))?;
        }
        writeln!(text)?;
    }
    Ok(())
}

fn write_histogram(text: &mut String, histogram: &FieldHistogram) -> std::fmt::Result {
    let names: Vec<String> = histogram.axes.iter().map(|axis| format!("{} in {}", axis.field, axis.unit)).collect();
    writeln!(text, "\nhistogram of {}", names.join(" and "))?;
    let most = histogram.counts.iter().copied().max().unwrap_or(0).max(1);
    let [axis] = histogram.axes.as_slice() else {
        let filled = histogram.counts.iter().filter(|count| **count > 0).count();
        return writeln!(
            text,
            " {filled} of {} bins hold particles, {most} at most; --json writes them",
            histogram.counts.len()
        );
    };
    writeln!(text, " {:>14} {:>14} {:>14} {:>14}", "from", "to", "particles", "mass")?;
    for (bin, (count, mass)) in histogram.counts.iter().zip(&histogram.masses).enumerate() {
        let bar = "#".repeat((40 * count).div_ceil(most) as usize);
        let (from, to) = (short(axis.edge(bin)), short(axis.edge(bin + 1)));
        writeln!(text, " {from:>14} {to:>14} {count:>14} {:>14} {bar}", short(*mass))?;
    }
    Ok(())
}
