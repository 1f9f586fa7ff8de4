//! Plots as a user makes them: sums that come out even, profiles of a ball of known density, stated errors that hold, and files that
//! other programs read.

use crate::support::{Random, error, run, text};
use deepfield::explore::plot::Part;
use deepfield::explore::{
    Data, Effort, Fields, Members, Plot, PlotKind, PlotScale, PlotSettings, ProbeOptions, Region, Work, edges, probe,
};
use deepfield::store::PageFile;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Particles in the ball.
const COUNT: usize = 6000;
/// Particles whose temperature has no logarithm.
const COLD: usize = 150;

/// What is in the ball: the mass and temperature of each particle.
struct Ball {
    masses: Vec<f64>,
    temperatures: Vec<f64>,
}

/// A ball of radius 2 kpc (whose surface rounding does not reach) about (10, 0, -3) with even density, as a table `ball.csv`, built without loss as `ball.df` and with codes of
/// 8 bits as `coded.df`.
fn folder() -> (tempfile::TempDir, Ball) {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(7);
    let mut table = "id,x [kpc],y [kpc],z [kpc],mass [Msun],h,density [Msun/kpc^3],temperature [K]\n".to_owned();
    let mut ball = Ball { masses: Vec::new(), temperatures: Vec::new() };
    while ball.masses.len() < COUNT {
        let [x, y, z] = [(); 3].map(|()| 4.0 * random.next() - 2.0);
        let (mass, density) = (1.0 + random.next(), 10f64.powf(3.0 * random.next()));
        let hot = 10f64.powf(2.0 + 4.0 * random.next());
        if x * x + y * y + z * z > 3.99 {
            continue;
        }
        let index = ball.masses.len();
        let temperature =
            if index.is_multiple_of(COUNT / COLD) { -hot * (index / (COUNT / COLD) % 2) as f64 } else { hot };
        let _ = writeln!(table, "{index},{},{y},{},{mass},0.1,{density},{temperature}", x + 10.0, z - 3.0);
        ball.masses.push(mass);
        ball.temperatures.push(temperature);
    }
    std::fs::write(folder.path().join("ball.csv"), table).unwrap();
    text(folder.path(), &["build", "ball.csv", "-o", "ball.df"]);
    text(folder.path(), &["build", "ball.csv", "--vq-bits", "8", "-o", "coded.df"]);
    (folder, ball)
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_str(&text(folder, &[arguments, &["--json", "-"]].concat())).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

/// The header and the rows of a table.
fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let rows = reader.records().map(|row| row.unwrap().iter().map(|cell| cell.parse().unwrap()).collect());
    (header, rows.collect())
}

/// Width and height of a picture.
fn size(path: &Path) -> [u32; 2] {
    let reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    [reader.info().width, reader.info().height]
}

#[track_caller]
fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * a.abs().max(b.abs()), "{a} {b}");
}

#[test]
fn histograms_and_phase_diagrams_hold_all_mass_and_agree() {
    let (folder, ball) = folder();
    let folder = folder.path();
    let mass: f64 = ball.masses.iter().sum();
    let is_hot = |index: &usize| ball.temperatures[*index] > 0.0;
    let hot: f64 = (0..COUNT).filter(is_hot).map(|index| ball.masses[index]).sum();

    let named = ["plot", "ball.df", "--histogram", "temperature", "-o", "t.csv", "-o", "t.png", "-o", "t.svg"];
    let told = text(folder, &named);
    assert!(told.contains("mass by temperature in t.csv") && told.contains("leaves of the page file"), "{told}");
    let (header, rows) = table(&folder.join("t.csv"));
    assert_eq!(header, ["temperature from [K]", "temperature to [K]", "mass [Msun]", "count"]);
    assert_eq!(rows.len(), 100);
    assert!(rows.windows(2).all(|pair| pair[0][1] == pair[1][0] && pair[0][0] < pair[0][1]));
    close(rows.iter().map(|row| row[2]).sum(), mass, 1e-6);
    assert_eq!(rows.iter().map(|row| row[3]).sum::<f64>(), COUNT as f64);
    assert_eq!(size(&folder.join("t.png")), [900, 600]);
    let svg = std::fs::read_to_string(folder.join("t.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains(r#"width="900" height="600""#), "{svg}");
    assert!(svg.contains(">temperature [K]</text>") && svg.contains(">mass per bin [Msun]</text>"), "{svg}");

    // A logarithm leaves out who has none, and says how many.
    let log = ["plot", "ball.csv", "--histogram", "temperature", "--log", "--bins", "30"];
    let told = text(folder, &[&log[..], &["-o", "log.csv"]].concat());
    let message = format!("{COLD} particles left out: temperature is not positive");
    assert!(told.contains("every particle of the source") && told.contains(&message), "{told}");
    let found = json(folder, &log);
    assert_eq!((found["not_positive"].as_u64(), found["exact"].as_bool()), (Some(COLD as u64), Some(true)));
    assert!(found["error"].is_null() && found["axes"][0]["logarithmic"].as_bool().unwrap());
    close(found["total"].as_f64().unwrap(), hot, 1e-9);

    // The sums of a phase diagram along one axis are the histogram over the other.
    let only_hot = ["--where", "temperature:1..", "--log"];
    for weight in ["mass", "count", "density"] {
        let of =
            |kind: &[&str]| json(folder, &[&["plot", "ball.df"][..], kind, &only_hot, &["--weight", weight]].concat());
        let phase = of(&["--phase", "density,temperature", "--bins", "20,30"]);
        let cells = numbers(&phase["weights"]);
        assert_eq!(cells.len(), 600);
        let density = numbers(&of(&["--histogram", "density", "--bins", "20"])["weights"]);
        let temperature = numbers(&of(&["--histogram", "temperature", "--bins", "30"])["weights"]);
        for (column, expected) in density.iter().enumerate() {
            close((0..30).map(|row| cells[20 * row + column]).sum(), *expected, 1e-9);
        }
        for (row, expected) in temperature.iter().enumerate() {
            close(cells[20 * row..][..20].iter().sum(), *expected, 1e-9);
        }
    }

    let phase = ["plot", "ball.df", "--phase", "density,temperature", "--bins", "40,30"];
    text(
        folder,
        &[&phase[..], &only_hot, &["-o", "p.csv", "-o", "p.png", "-o", "p.svg", "--size", "640x480"]].concat(),
    );
    let (header, rows) = table(&folder.join("p.csv"));
    assert_eq!((header.len(), header[2].as_str(), header[5].as_str()), (6, "temperature from [K]", "count"));
    assert!(rows.iter().all(|row| row[5] > 0.0));
    close(rows.iter().map(|row| row[4]).sum(), hot, 1e-6);
    assert_eq!(size(&folder.join("p.png")), [640, 480]);
    let svg = std::fs::read_to_string(folder.join("p.svg")).unwrap();
    assert!(svg.contains(r#"width="640" height="480""#) && svg.contains(">mass per bin [Msun]</text>"), "{svg}");
}

/// No bin of a file with coarse codes is further from the source's than it says.
#[test]
fn stated_errors_hold() {
    let (folder, _) = folder();
    let folder = folder.path();
    for weight in ["mass", "count"] {
        let asked = ["--histogram", "density", "--log", "--range", "0.1,1e4", "--bins", "12", "--weight", weight];
        let of = |file: &str| json(folder, &[&["plot", file][..], &asked].concat());
        let (exact, coded) = (of("ball.csv"), of("coded.df"));
        let [truth, found] = [&exact, &coded].map(|of| numbers(&of["weights"]));
        let total = coded["total"].as_f64().unwrap();
        close(exact["total"].as_f64().unwrap(), total, 1e-6);
        let share = |name: &str| coded["error"][name].as_f64().unwrap();
        let difference: f64 = truth.iter().zip(&found).map(|(truth, found)| (truth - found).abs()).sum();
        // What is in another bin is missing in one and too much in the other. A share without bound is no number.
        let off = coded["error"]["weights"].as_f64().unwrap_or(f64::INFINITY);
        assert!(difference <= total * (2.0 * share("other_bins") + off + 1e-6), "{difference} {coded}");
        assert!(share("other_bins") >= share("other_bins_by_mean") && share("other_bins_by_mean") > 0.0, "{coded}");
        assert_eq!(share("weights_by_mean") > 0.0, weight == "mass");
        assert!(difference > 0.0 && coded["outside"] == 0, "{difference}");
    }
    let narrow = ["plot", "ball.csv", "--histogram", "density", "--range", "10,100", "--bins", "9"];
    let found = json(folder, &narrow);
    let inside = numbers(&found["counts"]).iter().sum::<f64>() as u64;
    assert!(inside > 1000 && inside + found["outside"].as_u64().unwrap() == COUNT as u64, "{inside}");
    assert!(text(folder, &[&narrow[..], &["-o", "n.csv"]].concat()).contains("left out: beyond the range"));
    // --exact is the source's answer.
    let asked = ["--histogram", "temperature", "--bins", "50"];
    let [direct, behind] = [&["plot", "ball.csv"][..], &["plot", "coded.df", "--exact"]]
        .map(|file| numbers(&json(folder, &[file, &asked].concat())["weights"]));
    assert_eq!(direct, behind);
}

#[test]
fn a_ball_of_even_density_has_an_even_profile() {
    let (folder, ball) = folder();
    let folder = folder.path();
    let volume = |radius: f64| 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    let expected = ball.masses.iter().sum::<f64>() / volume(2.0);
    let asked = ["plot", "ball.df", "--radial", "density", "--about=10,0,-3", "--radius", "2", "--scale", "linear"];
    text(folder, &[&asked[..], &["--bins", "8", "-o", "r.csv", "-o", "r.png", "-o", "r.svg"]].concat());
    let (header, rows) = table(&folder.join("r.csv"));
    assert_eq!(header, ["radius from [kpc]", "radius to [kpc]", "mass [Msun]", "density [Msun/kpc^3]", "count"]);
    assert_eq!(rows.len(), 8);
    for row in &rows {
        // Five standard deviations of the count, and of masses from 1 to 2.
        let deviation = 5.0 * 1.03 / row[4].max(1.0).sqrt();
        close(row[3], expected, deviation.min(1.0));
        close(row[3], row[2] / (volume(row[1]) - volume(row[0])), 1e-9);
    }
    close(rows.iter().map(|row| row[2]).sum(), ball.masses.iter().sum(), 1e-6);
    assert_eq!(size(&folder.join("r.png")), [900, 600]);
    assert!(std::fs::read_to_string(folder.join("r.svg")).unwrap().contains(">radius [kpc]</text>"));

    // Without a radius up to the farthest particle; means of a field with their dispersion.
    let found = json(folder, &["plot", "ball.csv", "--radial", "density", "--about=10,0,-3", "--bins", "5"]);
    assert_eq!(found["count"].as_u64(), Some(COUNT as u64));
    let found = json(folder, &["plot", "ball.csv", "--radial", "temperature", "--sphere=10,0,-3,1", "--bins", "5"]);
    let shell = &found["shells"][4];
    assert!(shell["mean"].is_f64() && shell["mass_weighted_dispersion"].is_f64(), "{shell}");
}

#[test]
fn scatter_plots_draw_as_many_points_as_are_asked_for() {
    let (folder, _) = folder();
    let folder = folder.path();
    let asked =
        ["plot", "ball.csv", "--scatter", "density,temperature", "--points", "500", "-o", "s.csv", "-o", "s.svg"];
    let told = text(folder, &asked);
    assert!(told.contains("500 of 6000 particles"), "{told}");
    let (header, rows) = table(&folder.join("s.csv"));
    assert_eq!((header[0].as_str(), rows.len()), ("density [Msun/kpc^3]", 500));
    text(folder, &["plot", "ball.df", "--scatter", "density,temperature", "--log", "-o", "s.png"]);
    assert_eq!(size(&folder.join("s.png")), [900, 600]);
}

#[test]
fn what_cannot_be_plotted_is_told_in_one_line() {
    let (folder, _) = folder();
    let folder = folder.path();
    let out = ["-o", "x.csv"];
    for (arguments, expected) in [
        (&["plot", "ball.df", "--histogram", "entropy"][..], "entropy: not there, expected one of mass, density"),
        (&["plot", "ball.df", "--phase", "density,entropy"], "field entropy"),
        (&["plot", "ball.df", "--histogram", "density", "--weight", "entropy"], "field entropy"),
        (&["plot", "ball.df", "--histogram", "density", "--family", "stars"], "family stars"),
        (&["plot", "ball.df", "--histogram", "density", "--where", "density:1e9.."], "any value of density"),
        (&["plot", "ball.df", "--histogram", "temperature", "--where", "temperature:..0", "--log"], "a positive value"),
        (&["plot", "none.df", "--histogram", "density"], "none.df"),
    ] {
        let message = error(folder, &[arguments, &out].concat());
        assert!(message.contains(expected), "{arguments:?}: {message}");
        assert!(!folder.join("x.csv").exists());
    }
    let message = error(folder, &["plot", "ball.df", "--histogram", "density", "-o", "x.pdf"]);
    assert!(message.contains("x.pdf: expected a name that ends in .csv, .png or .svg"), "{message}");
    for (arguments, expected) in [
        (&["--phase", "density,temperature", "--bins", "4000"][..], "bins is 16000000"),
        (&["--histogram", "density", "--bins", "5000"], "bins is 5000"),
        (&["--radial", "density", "--about", "0,0,0", "--bins", "5000"], "shells is 5000"),
        (&["--radial", "density"], "--about"),
        (&["--radial", "density", "--about", "0,0,0", "--weight", "density"], "--weight"),
    ] {
        let output = run(folder, &[&["plot", "ball.df"][..], arguments, &out].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(expected) && !folder.join("x.csv").exists(), "{arguments:?}: {message}");
    }
    for wrong in [
        &["plot", "ball.df", "-o", "x.csv"][..],
        &["plot", "ball.df", "--histogram", "density"],
        &["plot", "ball.df", "--histogram", "density", "--phase", "a,b", "-o", "x.csv"],
        &["plot", "ball.df", "--phase", "density", "-o", "x.csv"],
        &["plot", "ball.df", "--histogram", "density", "--range", "1,2", "--range", "1,2", "-o", "x.csv"],
    ] {
        assert_eq!(run(folder, wrong).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn what_is_brushed_from_edge_to_edge_is_what_the_cells_between_hold() {
    let (folder, _) = folder();
    let mut random = Random(33);
    for name in ["ball.df", "coded.df"] {
        let file = PageFile::open(&folder.path().join(name)).unwrap();
        let (data, whole) = (Data::Pages(&file), Region::whole());
        let settings = PlotSettings {
            kind: PlotKind::Phase,
            x: "density".into(),
            y: "temperature".into(),
            scale: PlotScale::Log,
            ..PlotSettings::default()
        };
        let members = Members::Region(whole.clone());
        let plot = Plot::find(data, &members, &settings.options(), Effort::ALL, None, Work::quiet()).unwrap();
        let Plot::Binned(found) = &plot else { panic!("a phase diagram") };
        let [across, up] = [&found.axes[0], &found.axes[1]].map(edges);
        let columns = across.len() - 1;
        for _ in 0..20 {
            let mut ends = |edges: &[f64]| {
                let first = (random.next() * (edges.len() - 1) as f64) as usize;
                (first, first + 1 + (random.next() * (edges.len() - 1 - first) as f64) as usize)
            };
            let ((left, right), (low, high)) = (ends(&across), ends(&up));
            let row = |row: usize| found.counts[row * columns + left..row * columns + right].iter().sum::<u64>();
            let expected: u64 = (low..high).map(row).sum();
            let part = Part { across: [across[left], across[right]], up: Some([up[low], up[high]]) };
            let region = plot.brushed(&whole, &part);
            let options = ProbeOptions { fields: Fields::None, ..ProbeOptions::default() };
            let brushed = probe(data, &region, &options, Work::quiet()).unwrap().count;
            assert_eq!(brushed, expected, "{name} {part:?}");
        }
    }
}
