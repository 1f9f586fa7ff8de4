//! `deepfield probe` of a height field: places, profiles, what is under pixels, and numbers of regions.

use super::StatedOptions;
use super::info::within;
use super::select::{Corners, numbers, rectangle, window_in};
use super::{options, pixels, profile, ratio};
use crate::commands::CommandResult;
use crate::commands::arguments::{Given, PictureSize, positive, vector};
use crate::commands::probe::short;
use crate::commands::projection_options::ProjectionOptions;
use crate::commands::statistics::write_json;
use crate::heights::OpenHeights;
use crate::heights::measure::{
    Disc, Filter, Filtered, FormKind, FormNumbers, Iso, Part, Probe, Residual, Roughness, fit, material_ratio,
    probe_on, roughness_on,
};
use crate::heights::model::{HeightGrid, Heights, Lengths, Window};
use crate::model::Unit;
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// What is asked of heights.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Height fields")]
pub struct HeightsProbe {
    /// The height and the slope at a place.
    #[arg(long, value_name = "X,Y", value_parser = place, allow_hyphen_values = true)]
    pub point: Option<[f64; 2]>,
    /// A profile along a line: the height at every crossing with an edge of the surface; -o writes it, as a table (.csv) or a plot (.png).
    #[arg(long, value_name = "X0,Y0,X1,Y1,...", value_parser = polyline, allow_hyphen_values = true)]
    pub line: Option<Polyline>,
    /// The samples between two corners, and on the edge.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = rectangle, allow_hyphen_values = true)]
    pub rectangle: Option<Corners>,
    /// The samples within a distance of a place.
    #[arg(long, value_name = "X,Y,R", value_parser = disc, allow_hyphen_values = true)]
    pub disc: Option<Disc>,
    /// Take this form off, fitted to the region after the S-filter and before the L-filter: plane, quadric, sphere, cylinder or polynomial-N.
    #[arg(long, value_name = "FORM", value_parser = form)]
    pub form: Option<FormKind>,
    /// Leave out waves shorter than this, in the unit of x and y, of degrees in metres (Gaussian, ISO 16610-61).
    #[arg(long, value_name = "LENGTH", value_parser = positive, allow_hyphen_values = true)]
    pub s_filter: Option<f64>,
    /// Leave out waves longer than this.
    #[arg(long, value_name = "LENGTH", value_parser = positive, allow_hyphen_values = true)]
    pub l_filter: Option<f64>,
    /// The samples under a pixel of the picture that `render` draws with the same camera; several times for several.
    #[arg(long, value_name = "X,Y", value_parser = pixel, allow_hyphen_values = true)]
    pub pixel: Vec<[u32; 2]>,
    /// The samples under many pixels: a CSV file with the columns x and y.
    #[arg(long, value_name = "LIST.csv")]
    pub pixels: Option<PathBuf>,
    /// Camera position of --pixel.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub eye: Option<DVec3>,
    /// The point looked at.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub target: Option<DVec3>,
    /// The direction that points up in the picture [default: 0,0,1; for who looks straight along that y].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub up: Option<DVec3>,
    /// Vertical field of view, degrees [default: 45].
    #[arg(long, value_name = "DEG", value_parser = positive, allow_hyphen_values = true)]
    pub fov: Option<f64>,
    /// Height of an orthographic picture, world units.
    #[arg(long, value_name = "HEIGHT", value_parser = positive, allow_hyphen_values = true, conflicts_with = "fov")]
    pub ortho: Option<f64>,
    /// Picture size in pixels [default: 1200x800, of a plot 1200x480].
    #[arg(long, value_name = "WxH")]
    pub size: Option<PictureSize>,
    /// How degrees become places of --pixel, and on which body they are lengths: plate, local, globe or globe:BODY such as globe:moon
    /// [default: globe from 20 degrees on; the Earth].
    #[arg(long, value_name = "MAP")]
    pub map: Option<String>,
    /// Settings in RON, as `render` takes them: exaggeration and base count.
    #[arg(long, value_name = "FILE.ron")]
    pub config: Option<PathBuf>,
    /// How directions become a picture.
    #[command(flatten)]
    pub projection: ProjectionOptions,
}

impl HeightsProbe {
    /// What nothing else is asked, and what of it is given. A camera is that of pixels.
    pub fn given(&self) -> [Given; 9] {
        [
            ("--point", self.point.is_some()),
            ("--line", self.line.is_some()),
            ("--rectangle", self.rectangle.is_some()),
            ("--disc", self.disc.is_some()),
            ("--form", self.form.is_some()),
            ("--s-filter", self.s_filter.is_some()),
            ("--l-filter", self.l_filter.is_some()),
            ("--pixel", !self.pixel.is_empty() || self.pixels.is_some()),
            ("--map", self.map.is_some()),
        ]
    }
}

/// Corners of a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyline(pub Vec<[f64; 2]>);

fn place(text: &str) -> Result<[f64; 2], String> {
    numbers(text).and_then(|parts| parts.try_into().ok()).ok_or_else(|| "expected a place x,y such as 10,5".into())
}

fn pixel(text: &str) -> Result<[u32; 2], String> {
    let parts: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    parts.and_then(|parts| parts.try_into().ok()).ok_or_else(|| "expected a pixel x,y such as 640,400".into())
}

fn polyline(text: &str) -> Result<Polyline, String> {
    let parts = numbers(text).filter(|parts| parts.len() >= 4 && parts.len() % 2 == 0);
    let parts = parts.ok_or("expected two or more places x0,y0,x1,y1,... such as 0,0,10,5")?;
    Ok(Polyline(parts.as_chunks::<2>().0.to_vec()))
}

fn disc(text: &str) -> Result<Disc, String> {
    match numbers(text).as_deref() {
        Some(&[x, y, radius]) if radius > 0.0 => Ok(Disc { center: [x, y], radius }),
        _ => Err("expected a middle and a radius x,y,r such as 10,5,2.5".into()),
    }
}

fn form(text: &str) -> Result<FormKind, String> {
    let most = FormKind::LARGEST_DEGREE;
    FormKind::named(text)
        .ok_or_else(|| format!("expected plane, quadric, sphere, cylinder or polynomial-N with N from 1 to {most}"))
}

/// Asks and prints.
///
/// # Errors
/// When the file cannot be read, or what is asked does not fit it.
pub fn run(
    path: &Path,
    options: &StatedOptions,
    asked: &HeightsProbe,
    out: Option<&Path>,
    json: Option<&Path>,
) -> CommandResult {
    let open = options.open(path)?;
    let is_of_pixels = !asked.pixel.is_empty() || asked.pixels.is_some();
    if out.is_some() && (asked.point.is_some() || is_of_pixels && asked.line.is_none()) {
        return Err("-o: found --point or --pixel beside it, expected --line or a region".into());
    }
    if let Some(place) = asked.point {
        let lengths = options::lengths(path, asked.map.as_deref(), open.grid())?;
        let found = PointAnswer { probe: probe_on(&open, &lengths, place)?, height_error: open.height_error() };
        return answer(json, &found, |text, found| {
            write_point(text, path, open.grid(), &found.probe)?;
            within(&open).iter().try_for_each(|within| writeln!(text, "{within}"))
        });
    }
    if let Some(Polyline(corners)) = &asked.line {
        return profile::run(path, &open, corners, asked.map.as_deref(), (out, asked.size), json);
    }
    if is_of_pixels {
        let (seen, note) = options.open_for_pictures(path)?;
        note.into_iter().for_each(|note| eprintln!("deepfield: {}: {note}", path.display()));
        return pixels::run(path, &seen, asked, json);
    }
    if let (Some(short), Some(long)) = (asked.s_filter, asked.l_filter)
        && short >= long
    {
        return Err(format!("--s-filter: found {short}, expected less than --l-filter {long}").into());
    }
    let is_asked = out.map(profile::is_plot).transpose()?.is_some();
    let (region, curve) = numbers_of(path, &open, asked, is_asked)?;
    if let Roughness { mean: Some(mean), iso: Iso { sp: Some(peak), sv: Some(pit), .. }, .. } = region.roughness {
        let doubts = open.doubts([mean - pit, mean + peak]);
        doubts.iter().for_each(|note| eprintln!("note: {note}"));
    }
    if let Some(out) = out {
        ratio::write(out, path, open.grid(), &curve, asked.size)?;
    }
    answer(json, &region, |text, found| write_region(text, path, open.grid(), found))
}

/// Prints an answer, or writes it as JSON.
pub(super) fn answer<T: Serialize>(
    json: Option<&Path>,
    found: &T,
    write: impl FnOnce(&mut String, &T) -> std::fmt::Result,
) -> CommandResult {
    if let Some(json) = json {
        return write_json(json, found);
    }
    let mut text = String::new();
    write(&mut text, found)?;
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}

/// A unit after a number.
pub(super) fn after(unit: &Unit) -> String {
    if unit.is_unknown() { String::new() } else { format!(" {unit}") }
}

fn write_point(text: &mut String, path: &Path, grid: &HeightGrid, found: &Probe) -> std::fmt::Result {
    let (places, heights) = (after(&grid.xy_unit), after(&grid.height_unit));
    let (row, column) = (short(found.row), short(found.column));
    writeln!(text, "{}: {}, {}{places} (row {row}, column {column})", path.display(), found.x, found.y)?;
    match found.height {
        Some(height) => writeln!(text, "height: {height}{heights}")?,
        None => writeln!(text, "not measured")?,
    }
    if let Some(slope) = found.slope {
        writeln!(text, "slope: {}, {} degrees", short(slope), short(slope.atan().to_degrees()))?;
    }
    if let Some(aspect) = found.aspect {
        writeln!(text, "downhill: {} degrees clockwise from y", short(aspect))?;
    }
    if let Some(near) = &found.nearest {
        let (x, y, away, lengths) = (near.x, near.y, short(near.distance), after(&Lengths::unit(grid)));
        writeln!(text, "nearest sample that was measured: {}{heights} at {x}, {y}, {away}{lengths} away", near.height)?;
    }
    Ok(())
}

/// What `--json` writes of a place.
#[derive(Serialize)]
struct PointAnswer {
    #[serde(flatten)]
    probe: Probe,
    /// How far heights are from the source's at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    height_error: Option<f64>,
}

/// What `--json` writes of a region.
#[derive(Serialize)]
struct RegionAnswer {
    #[serde(flatten)]
    roughness: Roughness,
    #[serde(skip_serializing_if = "Option::is_none")]
    form: Option<FormAnswer>,
}

/// What is told of the form that is taken off.
#[derive(Serialize)]
struct FormAnswer {
    #[serde(flatten)]
    numbers: FormNumbers,
    /// Of polynomials: what each coefficient is a factor of.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    terms: Vec<String>,
    /// Of polynomials: each coefficient's unit; empty where that is not known.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    units: Vec<String>,
}

impl FormAnswer {
    fn of(numbers: FormNumbers, grid: &HeightGrid) -> FormAnswer {
        let (terms, units) = numbers.terms(grid).into_iter().unzip();
        FormAnswer { numbers, terms, units }
    }
}

/// The numbers of a region, of which a form and waves are taken off where that is asked for, and where `has_curve` its material ratio curve. Filters
/// see the whole field.
fn numbers_of(
    path: &Path,
    open: &OpenHeights,
    asked: &HeightsProbe,
    has_curve: bool,
) -> Result<(RegionAnswer, Vec<[f64; 2]>), Failure> {
    let grid = open.grid();
    let told = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let window = match (asked.rectangle, asked.disc) {
        (Some(corners), _) => window_in(path, grid, corners)?,
        (None, Some(Disc { center: [x, y], radius: r })) => window_in(path, grid, [[x - r, y - r], [x + r, y + r]])?,
        (None, None) => Window::all(grid),
    };
    let turned = Part::turned(open, window);
    let (field, window) = turned.as_ref().map_or((open as &dyn Heights, window), |(part, window)| (part, *window));
    let grid = field.grid();
    let few = || {
        let (columns, rows) = (window.columns, window.rows);
        format!("{}: region: found {columns} x {rows} samples, expected at least 2 x 2", path.display())
    };
    let disc = asked.disc.filter(|_| asked.rectangle.is_none());
    let region = |heights| {
        disc.map_or_else(|| Part::of_window(heights, window), |disc| Part::of_disc(heights, disc)).ok_or_else(few)
    };
    // ISO 25178-3: first the S-filter, then the form is taken off, then the L-filter. Filters see the whole field.
    let all = Window::all(grid);
    let on = options::lengths(path, asked.map.as_deref(), grid)?;
    let smooth = asked.s_filter.map(|length| Filtered::on(field, on, Filter::Short(length), all)).transpose()?;
    let first: &dyn Heights = smooth.as_ref().map_or(field, |filtered| filtered);
    let form = asked.form.map(|kind| fit(&region(first)?, kind).map_err(|error| told(&error))).transpose()?;
    let numbers = form.as_ref().map(|form| FormAnswer::of(form.numbers(), grid));
    let rest = form.map(|form| Residual::new(first, form));
    let second: &dyn Heights = rest.as_ref().map_or(first, |rest| rest);
    let rough = asked.l_filter.map(|length| Filtered::on(second, on, Filter::Long(length), all)).transpose()?;
    let third: &dyn Heights = rough.as_ref().map_or(second, |filtered| filtered);
    let region = region(third)?;
    let lengths = options::lengths(path, asked.map.as_deref(), region.grid())?;
    let found = roughness_on(&region, &lengths)?;
    let curve = if has_curve { material_ratio(&region, &found)? } else { Vec::new() };
    Ok((RegionAnswer { roughness: found, form: numbers }, curve))
}

fn write_form(text: &mut String, grid: &HeightGrid, form: &FormAnswer) -> std::fmt::Result {
    let (places, heights) = (after(&grid.xy_unit), after(&grid.height_unit));
    let FormNumbers { kind, coefficients, about, center, radius, axis } = &form.numbers;
    write!(text, "without a form: {kind}")?;
    if let Some(factors) = coefficients {
        write!(text, ", the sum of these times powers of x and y")?;
        match about {
            Some([x, y]) => writeln!(text, ", which count from {x}, {y}{places}")?,
            None => writeln!(text)?,
        }
        for ((factor, term), unit) in factors.iter().zip(&form.terms).zip(&form.units) {
            let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
            writeln!(text, "  {term:<9} {factor:?}{unit}")?;
        }
        return Ok(());
    }
    if let Some(radius) = radius {
        write!(text, " of radius {}{places}", short(*radius))?;
    }
    if let Some([x, y, height]) = center.map(|center| center.map(short)) {
        let what = if axis.is_some() { "with an axis through" } else { "about" };
        write!(text, ", {what} {x}, {y}{places} at height {height}{heights}")?;
    }
    if let Some([x, y, z]) = axis.map(|axis| axis.map(short)) {
        write!(text, " in the direction {x}, {y}, {z}")?;
    }
    writeln!(text)
}

fn write_region(text: &mut String, path: &Path, grid: &HeightGrid, found: &RegionAnswer) -> std::fmt::Result {
    let lengths = Lengths::unit(grid);
    let (places, heights) = (after(&lengths), after(&grid.height_unit));
    let Roughness { samples, valid, valid_share, mean, area, iso } = &found.roughness;
    let share = short(100.0 * valid_share);
    writeln!(text, "{}: {valid} of {samples} samples were measured ({share} %)", path.display())?;
    let square = if lengths.is_unknown() { String::new() } else { format!(" {lengths}^2") };
    writeln!(text, "surface in plan: {}{square}", short(*area))?;
    if let Some(form) = &found.form {
        write_form(text, grid, form)?;
    }
    if let Some(mean) = mean {
        writeln!(text, "mean height: {}{heights}", short(*mean))?;
    }
    let Iso { sa, sq, ssk, sku, sp, sv, sz, sdq, sdr, sk, spk, svk, smr1, smr2, sal, str } = iso;
    let rows = [
        ("Sa", sa, heights.as_str(), "mean distance from the mean height"),
        ("Sq", sq, &heights, "root of the mean square"),
        ("Ssk", ssk, "", "skewness"),
        ("Sku", sku, "", "kurtosis"),
        ("Sp", sp, &heights, "highest peak"),
        ("Sv", sv, &heights, "deepest pit"),
        ("Sz", sz, &heights, "both"),
        ("Sdq", sdq, "", "root of the mean square slope"),
        ("Sdr", sdr, " %", "what the surface has more than its plan"),
        ("Sk", sk, &heights, "height of the core"),
        ("Spk", spk, &heights, "peaks above it"),
        ("Svk", svk, &heights, "valleys below it"),
        ("Smr1", smr1, " %", "share of the peaks"),
        ("Smr2", smr2, " %", "share above the valleys"),
        ("Sal", sal, &places, "shortest length at which the autocorrelation falls to 0.2"),
        ("Str", str, "", "that over the longest one"),
    ];
    for (name, value, unit, what) in rows {
        let value = value.map_or_else(|| "-".to_owned(), |value| format!("{}{unit}", short(value)));
        writeln!(text, "  {name:<5} {value:<24} {what}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SampleType;

    fn written(numbers: FormNumbers, units: [&str; 2]) -> String {
        let [places, heights] = units.map(Unit::new);
        let grid = HeightGrid { xy_unit: places, height_unit: heights, ..HeightGrid::new(4, 4, SampleType::F32) };
        let mut text = String::new();
        write_form(&mut text, &grid, &FormAnswer::of(numbers, &grid)).unwrap();
        text
    }

    #[test]
    fn numbers_of_forms_have_names_and_units() {
        let none = || FormNumbers {
            kind: "plane".into(),
            coefficients: None,
            about: None,
            center: None,
            radius: None,
            axis: None,
        };
        let plane = FormNumbers { coefficients: Some(vec![2.5, -0.25, 1e-9]), ..none() };
        let lines = [
            "without a form: plane, the sum of these times powers of x and y",
            "  1         2.5 um",
            "  x         -0.25 um/mm",
            "  y         1e-9 um/mm",
            "",
        ];
        assert_eq!(written(plane.clone(), ["mm", "um"]), lines.join("\n"));
        assert!(written(plane, ["", "um"]).ends_with("  x         -0.25\n  y         1e-9\n"));
        let cubic = FormNumbers { coefficients: Some(vec![1.0; 10]), about: Some([5.0, 3.0]), ..none() };
        let found = written(cubic, ["m", "m"]);
        assert!(found.contains("which count from 5, 3 m\n"), "{found}");
        assert!(found.contains("\n  x^2 y     1.0 m/m^3\n") && found.ends_with("\n  y^3       1.0 m/m^3\n"), "{found}");
        let sphere = FormNumbers { kind: "sphere".into(), center: Some([1.0, 2.0, -3.0]), radius: Some(4.0), ..none() };
        let found = written(sphere, ["mm", "um"]);
        assert!(found.contains("sphere of radius 4") && found.contains(" mm at height -3") && found.ends_with(" um\n"));
    }
}
