//! A run in the window: keys and the dock go from step to step, time plays, and the camera and settings stay as they are.

use super::desktop::{Desktop, Program, choose, click, columns, keep, middle, repeat};
use crate::support::run;
use serde_json::Value;
use std::path::Path;

/// A run of three steps: a ball that moves to the right.
fn series(folder: &Path) {
    for step in 0..3 {
        let mut text = String::from("x,y,z,mass,h\n");
        for i in 0..400 {
            let part = f64::from(i) / 400.0;
            let (x, y, z) = ((40.0 * part).cos(), (40.0 * part).sin(), 2.0 * part - 1.0);
            text += &format!("{},{},{z},1,0.3\n", 0.4 * f64::from(step) + part * x, part * y);
        }
        std::fs::write(folder.join(format!("ball_{step}.csv")), text).unwrap();
    }
    let built = run(folder, &["build", "ball_*.csv", "-o", "run.df", "--times", "0,1,4", "--match", "order"]);
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
}

#[test]
fn a_run_is_stepped_played_and_saved() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    series(folder);
    let desktop = Desktop::with_screen([960, 600]);
    let more = ["--backend", "cpu", "--mode", "column-density"];
    let mut program = Program::open(&desktop, folder, &folder.join("run.df"), [960, 600], &more);
    let is_at = |step: u64| {
        move |status: &Value| {
            // Ranges glide to where they come to rest.
            let is_settled = status["converged"] == true && status["ranges"][1] == true;
            is_settled && status["time"]["step"] == step && status["time"]["there"] == true
        }
    };
    let begin = program.wait("the first step", is_at(0));
    assert_eq!((&begin["time"]["time"], &begin["time"]["playing"]), (&0.0.into(), &false.into()));
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    let press = |key: char| desktop.press(u32::from(key));
    let pixels = |status: &Value| {
        std::thread::sleep(std::time::Duration::from_millis(300));
        let screen = desktop.wait("the picture", |_| true);
        let rows = 80..500;
        columns(status)
            .flat_map(|x| rows.clone().map(move |y| (x, y)))
            .map(|(x, y)| screen.at(x, y))
            .collect::<Vec<_>>()
    };
    let first = pixels(&begin);
    press('.');
    let second = program.wait("the second step", is_at(1));
    assert_eq!(second["time"]["time"], 1.0);
    // The camera stays, and what is undone is not time.
    for key in ["eye", "target", "history", "settings"] {
        assert_eq!(begin[key], second[key], "{key}");
    }
    keep(&desktop, "series.png");
    assert!(pixels(&second) != first, "another step is another picture");
    press(',');
    let back = program.wait("the first step again", is_at(0));
    assert!(pixels(&back) == first, "and the first step is what it was");
    // Played, it comes to the end and stands.
    for speed in [2.0, 4.0, 8.0, 16.0] {
        press(']');
        let faster = program.wait("a higher speed", |status| status["time"]["speed"] == speed);
        assert_eq!(faster["time"]["step"], 0);
    }
    press('t');
    let end = program.wait("the end", is_at(2));
    assert_eq!((&end["time"]["time"], &end["time"]["playing"]), (&4.0.into(), &false.into()));
    // The dock.
    let line = &end["controls"]["time:line"];
    let at = |i: usize| line[i].as_f64().unwrap() as i16;
    desktop.click([at(0) + 8, (at(1) + at(3)) / 2]);
    program.wait("the beginning of the line", is_at(0));
}

#[test]
fn what_moves_is_drawn_between_the_steps() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    series(folder);
    let desktop = Desktop::with_screen([960, 600]);
    for backend in ["cpu", "compute"] {
        let more = ["--backend", backend, "--mode", "column-density"];
        let mut program = Program::open(&desktop, folder, &folder.join("run.df"), [960, 600], &more);
        let is_settled = |status: &Value| {
            let rests = status["converged"] == true && status["ranges"][1] == true;
            rests && status["time"]["there"] == true
        };
        let begin = program.wait("the first step", is_settled);
        assert_eq!(begin["time"]["moves"], false);
        desktop.focus(desktop.window().expect("a window of the size that was asked for"));
        // The column around which the picture is bright.
        let middle = |status: &Value| {
            std::thread::sleep(std::time::Duration::from_millis(300));
            let screen = desktop.wait("the picture", |_| true);
            let (mut sum, mut all) = (0.0, 0.0);
            for x in columns(status) {
                let light: f64 = (80..500).map(|y| screen.at(x, y).iter().map(|c| f64::from(*c)).sum::<f64>()).sum();
                (sum, all) = (sum + light * x as f64, all + light);
            }
            sum / all
        };
        let first = middle(&begin);
        let line = begin["controls"]["time:line"].clone();
        let at = |i: usize| line[i].as_f64().unwrap();
        let go_to = |share: f64| {
            let x = at(0) + 6.0 + share * (at(2) - at(0) - 12.0);
            desktop.click([x as i16, (0.5 * (at(1) + at(3))) as i16]);
        };
        // Within the second interval, from 1 to 4.
        go_to(0.6);
        let between =
            program.wait("a moment between two steps", |status| is_settled(status) && status["time"]["moves"] == true);
        let time = between["time"]["time"].as_f64().unwrap();
        assert!((time - 2.4).abs() < 0.03 && between["time"]["step"] == 1, "{time}");
        keep(&desktop, &format!("series-between-{backend}.png"));
        let there = middle(&between);
        let click = |status: &Value, control: &str| {
            let corner = |i: usize| status["controls"][control][i].as_f64().unwrap();
            desktop.click([(0.5 * (corner(0) + corner(2))) as i16, (0.5 * (corner(1) + corner(3))) as i16]);
        };
        click(&between, "time:last");
        let end = program.wait("the last step", |status| is_settled(status) && status["time"]["moves"] == false);
        assert_eq!(end["time"]["step"], 2);
        keep(&desktop, &format!("series-end-{backend}.png"));
        let share = (there - first) / (middle(&end) - first);
        // Without velocities, tangents are those of the parabola through all three steps.
        let expected = (7.0 * time - time * time) / 12.0;
        assert!((share - expected).abs() < 0.04, "{share} of the way at {time}, {expected} expected");
        // Stored steps alone, where somebody asks for them.
        repeat(&program, "stored steps", || click(&end, "time:steps"), |status| status["time"]["holds"] == true);
        go_to(0.6);
        let held = program.wait("the step before", |status| is_settled(status) && status["time"]["step"] == 1);
        assert_eq!((&held["time"]["moves"], held["time"]["time"].as_f64().unwrap() > 2.0), (&false.into(), true));
    }
}

#[test]
fn paths_are_drawn_read_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    series(folder);
    let scene = |mode: &str| {
        let closed = ["data", "mode", "transfer", "view", "annotations"].map(|name| format!("{name:?}")).join(", ");
        let text = format!(
            "(version: 2, datasets: [(path: \"run.df\")], mode: {mode:?}, time: 2.0, annotations: (legend: false), \
             paths: (of: all, level: 0, color: \"#00ff00\", tail: 1.0, width: 5.0, halo: 0.0), \
             panels: (shown: true, closed: [{closed}]))"
        );
        let path = folder.join(format!("{mode}.scene.ron"));
        std::fs::write(&path, text).unwrap();
        path
    };
    let desktop = Desktop::with_screen([960, 600]);
    let is_green = |[r, g, b]: [u8; 3]| g > 150 && r < 60 && b < 60;
    for (mode, backend) in
        [("column-density", "cpu"), ("column-density", "compute"), ("volume", "compute"), ("paths", "cpu")]
    {
        let mut program = Program::open(&desktop, folder, &scene(mode), [960, 600], &["--backend", backend]);
        let is_settled = |status: &Value| status["converged"] == true && status["time"]["there"] == true;
        let status = program.wait("the paths", is_settled);
        let is_among = mode != "column-density";
        assert_eq!((&status["paths"]["among"], status["paths"]["tracks"].is_null()), (&is_among.into(), is_among));
        assert!(is_among || status["paths"]["tracks"] == 400, "{}", status["paths"]);
        std::thread::sleep(std::time::Duration::from_millis(300));
        let screen = desktop.wait("the picture", |_| true);
        let green: Vec<[i16; 2]> = columns(&status)
            .flat_map(|x| (80..500).map(move |y| (x, y)))
            .filter(|(x, y)| is_green(screen.at(*x, *y)))
            .map(|(x, y)| [x as i16, y as i16])
            .collect();
        keep(&desktop, &format!("paths-{mode}-{backend}.png"));
        assert!(green.len() > 300, "{mode} by {backend}: {} pixels of paths", green.len());
        desktop.focus(desktop.window().expect("a window of the size that was asked for"));
        desktop.click(green[green.len() / 2]);
        let read = program.wait("the path that was clicked", |status| !status["paths"]["picked"].is_null());
        assert_eq!((&read["paths"]["picked"][0], &read["paths"]["picked"][1]), (&0.into(), &1.into()), "{mode}");
        let button = program.wait("its button", |status| status["controls"]["paths:keep"][4] == 1.0);
        let corner = |i: usize| button["controls"]["paths:keep"][i].as_f64().unwrap();
        desktop.click([(0.5 * (corner(0) + corner(2))) as i16, (0.5 * (corner(1) + corner(3))) as i16]);
        let kept = program.wait("a selection", |status| {
            status["settings"]["selections"].as_array().is_some_and(|all| all.len() == 1)
        });
        assert_eq!(kept["settings"]["selections"][0]["name"], "path 1");
    }
}

#[test]
fn colours_are_for_the_whole_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // What is seen becomes a hundred times as heavy.
    for (step, mass) in [1, 10, 100].into_iter().enumerate() {
        let mut text = String::from("x,y,z,mass,h\n");
        for i in 0..400 {
            let part = f64::from(i) / 400.0;
            let (x, y) = ((40.0 * part).cos(), (40.0 * part).sin());
            text += &format!("{},{},{},{mass},0.3\n", part * x, part * y, 2.0 * part - 1.0);
        }
        std::fs::write(folder.join(format!("ball_{step}.csv")), text).unwrap();
    }
    let built = run(folder, &["build", "ball_*.csv", "-o", "run.df", "--times", "0,1,4", "--match", "order"]);
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let desktop = Desktop::with_screen([960, 600]);
    let more = ["--backend", "cpu", "--mode", "column-density"];
    let mut program = Program::open(&desktop, folder, &folder.join("run.df"), [960, 600], &more);
    let is_settled =
        |status: &Value| status["converged"] == true && status["ranges"][1] == true && status["time"]["there"] == true;
    let begin = program.wait("the first step", is_settled);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    desktop.press(u32::from('.'));
    let second = program.wait("the second step", |status| is_settled(status) && status["time"]["step"] == 1);
    assert_eq!(begin["ranges"], second["ranges"]);
    // To and fro, it never stands; colours stay as they are.
    choose(&program, &desktop, "time:more", "time:to-and-fro", |status| status["time"]["repeat"] == "to-and-fro");
    for speed in [2.0, 4.0, 8.0, 16.0, 32.0] {
        desktop.press(u32::from(']'));
        program.wait("a higher speed", |status| status["time"]["speed"] == speed);
    }
    desktop.press(u32::from('t'));
    let before = std::cell::Cell::new(1.0);
    for _ in 0..3 {
        let back = program.wait("a way back", |status| {
            let time = status["time"]["time"].as_f64().unwrap();
            before.replace(time) > time
        });
        assert_eq!((&back["ranges"], &back["time"]["playing"]), (&begin["ranges"], &true.into()));
    }
}

/// Who is in a sphere at the first step is kept, counted where they have gone, and plotted over the run.
#[test]
fn particles_are_kept_wherever_they_go_and_plotted_over_time() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    series(folder);
    let desktop = Desktop::with_screen([1280, 720]);
    let more = ["--backend", "cpu", "--mode", "column-density"];
    let mut program = Program::open(&desktop, folder, &folder.join("run.df"), [1280, 720], &more);
    let is_settled = |status: &Value| status["converged"] == true && status["time"]["there"] == true;
    let begin = program.wait("the first step", is_settled);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    click(&program, &desktop, "tool:Sphere", |status| status["looking"]["tool"] == "Sphere");
    let at = middle(&begin);
    let draw = || desktop.drag(at, [at[0] + 200, at[1]]);
    let probed = repeat(&program, "a probe", draw, |status| status["looking"]["probe"].is_object());
    let count = probed["looking"]["probe"]["count"].as_f64().unwrap();
    assert!(count > 10.0 && count < 400.0, "{count}");
    let kept = click(&program, &desktop, "keep-particles", |status| {
        status["settings"]["selections"].as_array().is_some_and(|all| all.len() == 1)
    });
    assert!(kept["settings"]["selections"][0]["members"].to_string().contains("Tracked"), "{}", kept["settings"]);
    // Two steps on the ball has moved by 0.8, and they with it.
    (0..2).for_each(|_| {
        desktop.press(u32::from('.'));
        std::thread::sleep(std::time::Duration::from_millis(400));
    });
    let end = program.wait("the last step", |status| is_settled(status) && status["time"]["step"] == 2);
    let found = program.wait("who was kept", |status| status["looking"]["found"][0]["count"].is_number());
    assert_eq!(found["looking"]["found"][0]["count"].as_f64(), Some(count), "{}", found["looking"]);
    assert_eq!(end["eye"], begin["eye"]);
    click(&program, &desktop, "selection:0:over-time", |status| {
        status["controls"].as_object().is_some_and(|all| all.keys().any(|name| name.starts_with("over-time:")))
    });
    program.reveal(&desktop, "over-time:Way of its centre");
    keep(&desktop, "series-over-time.png");
}
