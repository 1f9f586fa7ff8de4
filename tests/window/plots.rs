//! Plots in the window, driven as a user would under a virtual X server: a histogram and a phase diagram are brushed, and what is selected are
//! the particles with those values; a plot is written as a table that holds all of them.

use super::desktop::{Desktop, Program, click, keep, repeat};
use crate::support::{Random, run};
use serde_json::Value;
use std::fmt::Write as _;

const COUNT: usize = 3000;
const ESCAPE: u32 = 0xff1b;
const FRAME: &str = "plots:frame";
/// Wide enough for both docks, and high enough for a plot.
const SIZE: [u16; 2] = [960, 720];

/// Drags over the frame of the plot, from one of its places to another: shares to the right and upwards.
fn drag(program: &Program, desktop: &Desktop, places: [[f64; 2]; 2]) {
    program.reveal(desktop, FRAME);
    let status = program.status();
    let side = |i: usize| status["controls"][FRAME][i].as_f64().unwrap();
    let [from, to] =
        places.map(|[x, y]| [(side(0) + x * (side(2) - side(0))) as i16, (side(3) - y * (side(3) - side(1))) as i16]);
    desktop.drag(from, to);
}

fn selections(status: &Value) -> &[Value] {
    status["settings"]["selections"].as_array().map_or(&[], Vec::as_slice)
}

fn is_brushed(status: &Value) -> bool {
    selections(status).len() == 1 && status["looking"]["plot"]["brushed"].is_number()
}

#[test]
fn what_is_brushed_in_a_plot_is_selected() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(21);
    let mut table = "id,x [kpc],y [kpc],z [kpc],mass [Msun],h,density [Msun/kpc^3],temperature [K]\n".to_owned();
    // Density and temperature as page files hold them.
    let mut particles: Vec<[f64; 2]> = Vec::new();
    for index in 0..COUNT {
        let [x, y, z, d, t] = [(); 5].map(|()| random.next());
        let (density, temperature) = (10f64.powf(3.0 * d), 10f64.powf(2.0 + 4.0 * t));
        let _ = writeln!(table, "{index},{x},{y},{z},1,0.1,{density},{temperature}");
        particles.push([density, temperature].map(|value| f64::from(value as f32)));
    }
    std::fs::write(folder.path().join("box.csv"), table).unwrap();
    assert!(run(folder.path(), &["build", "box.csv", "-o", "box.df"]).status.success());
    let counted = |status: &Value| {
        let ranges = selections(status)[0]["members"]["Region"]["ranges"].as_array().unwrap();
        let is_in = |particle: &&[f64; 2]| {
            ranges.iter().all(|range| {
                let value = particle[usize::from(range["field"] == "temperature")];
                (range["min"].as_f64().unwrap()..=range["max"].as_f64().unwrap()).contains(&value)
            })
        };
        (ranges.len(), particles.iter().filter(is_in).count())
    };

    let desktop = Desktop::with_screen(SIZE);
    let data = folder.path().join("box.df");
    let mut program = Program::open(&desktop, folder.path(), &data, SIZE, &["--backend", "cpu"]);
    program.wait("a converged picture", |status| status["converged"] == true);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    // The button makes room for the plot.
    let draw = || {
        if program.control("plots:draw").is_some() {
            desktop.click(program.reveal(&desktop, "plots:draw"));
        }
    };
    let plotted = repeat(&program, "a plot", draw, |s| s["looking"]["plot"].is_object());
    assert_eq!(plotted["looking"]["plot"]["particles"], COUNT);

    // A range of the histogram; Esc lets go of it, and not of the program.
    let range = || drag(&program, &desktop, [[0.25, 0.5], [0.6, 0.4]]);
    let brushed = repeat(&program, "a range", range, is_brushed);
    let (ranges, expected) = counted(&brushed);
    assert!(ranges == 1 && expected > 0 && expected < COUNT, "{ranges} {expected}");
    assert_eq!(brushed["looking"]["plot"]["brushed"], expected);
    keep(&desktop, "plots-histogram.png");
    desktop.press(ESCAPE);
    program.wait("nothing is brushed", |s| selections(s).is_empty());

    // A rectangle of the phase diagram; a click lets go of it.
    let before = program.status()["looking"]["plot"]["revision"].as_u64();
    click(&program, &desktop, "plots:kind:phase", |s| s["looking"]["plot"]["revision"].as_u64() > before);
    let rectangle = || drag(&program, &desktop, [[0.2, 0.3], [0.7, 0.8]]);
    let brushed = repeat(&program, "a rectangle", rectangle, is_brushed);
    let (ranges, expected) = counted(&brushed);
    assert!(ranges == 2 && expected > 0 && expected < COUNT, "{ranges} {expected}");
    assert_eq!(brushed["looking"]["plot"]["brushed"], expected);
    keep(&desktop, "plots-phase.png");
    click(&program, &desktop, FRAME, |s| selections(s).is_empty());

    // The plot as a table.
    let table = folder.path().join("mass by temperature over density.csv");
    click(&program, &desktop, "plots:csv", |_| table.is_file());
    let mut rows = csv::Reader::from_path(&table).unwrap();
    assert_eq!(rows.headers().unwrap().get(0), Some("density from [(Msun)/(kpc)^3]"));
    let count = |row: csv::StringRecord| row.get(5).unwrap().parse::<usize>().unwrap();
    assert_eq!(rows.records().map(|row| count(row.unwrap())).sum::<usize>(), COUNT);
}
