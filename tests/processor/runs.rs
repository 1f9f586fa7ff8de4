//! Runs of snapshots from the command line: each step is what the snapshot alone is, to the byte, moments are found and refused in
//! words, tours go through them, and no damage goes unnoticed or panics.

use crate::support::hdf5::{Hdf5, Values};
use crate::support::{json, ok, run};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Times of the steps: intervals differ.
const TIMES: [f64; 4] = [0.0, 0.5, 0.75, 2.0];

/// Tables of particles that turn about the z axis, named so that numbers have to be read as numbers.
fn snapshots(folder: &Path) -> Vec<PathBuf> {
    let tables = TIMES.iter().zip([8, 9, 10, 11]).map(|(time, number)| {
        let mut text = String::from("id,x [kpc],y [kpc],z [kpc],mass,h,temp\n");
        for i in 0..500 {
            let part = f64::from(i) / 500.0;
            let (radius, angle) = (0.2 + part, 40.0 * part + time / (0.2 + part));
            let (x, y, z) = (radius * angle.cos(), radius * angle.sin(), 0.1 * (31.0 * part).sin());
            writeln!(text, "{},{x},{y},{z},{},0.1,{}", 1000 - i, 1.0 + part, 10.0 + f64::from(i)).unwrap();
        }
        let path = folder.join(format!("turn_{number}.csv"));
        std::fs::write(&path, text).unwrap();
        path
    });
    tables.collect()
}

/// The run of these tables, and its folder.
fn built() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    snapshots(folder.path());
    ok(folder.path(), &["build", "turn_*.csv", "-o", "run.df", "--times", "0,0.5,0.75,2"]);
    folder
}

/// The last line of what a command says that fails.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {told}");
    told.lines().last().unwrap_or_default().to_owned()
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

/// Places by id, of a table of particles.
fn places(folder: &Path, name: &str) -> BTreeMap<u64, [f64; 3]> {
    let text = String::from_utf8(read(folder, name)).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').map(|name| name.split(' ').next().unwrap()).collect();
    let at = |name: &str| header.iter().position(|own| *own == name).unwrap();
    let (id, axes) = (at("id"), [at("x"), at("y"), at("z")]);
    let row = |line: &str| {
        let values: Vec<&str> = line.split(',').collect();
        (values[id].parse().unwrap(), axes.map(|axis| values[axis].parse().unwrap()))
    };
    lines.map(row).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_step_is_the_snapshot_alone_to_the_byte() {
    let folder = built();
    let folder = folder.path();
    let about = json(folder, &["info", "run.df", "--json"]);
    assert_eq!(about["kind"], "run");
    let times: Vec<f64> =
        about["steps"].as_array().unwrap().iter().map(|step| step["time"].as_f64().unwrap()).collect();
    assert_eq!(times, TIMES);
    assert!(about["steps"].as_array().unwrap().iter().all(|step| step["particles"] == 500));
    for (step, number) in [8, 9, 10, 11].into_iter().enumerate() {
        let (step, source) = (step.to_string(), format!("turn_{number}.csv"));
        ok(folder, &["extract", "run.df", "--step", &step, "-o", "one.df"]);
        ok(folder, &["build", &source, "-o", "alone.df"]);
        assert!(read(folder, "one.df") == read(folder, "alone.df"), "step {step}");
    }
    let small = ["--size", "96x72", "--backend", "cpu"];
    for mode in ["column-density", "volume", "spheres"] {
        let picture = |arguments: &[&str], name: &str| {
            let raw = format!("{name}.npy");
            ok(folder, &[&["render", "-o", name, "--raw", &raw, "--mode", mode], arguments, &small].concat());
            (read(folder, name), read(folder, &raw))
        };
        let step = picture(&["run.df", "--time", "step:2"], "a.png");
        assert!(step == picture(&["turn_10.csv"], "b.png"), "{mode}");
        assert!(step != picture(&["run.df"], "c.png"), "{mode}: the first step is another picture");
    }
    // The particles that a region holds, with their ids, whether the source is there or not.
    let rows = |arguments: &[&str], name: &str| {
        ok(folder, &[&["select", "-o", name, "--sphere", "0,0,0,0.6"], arguments].concat());
        places(folder, name)
    };
    let truth = rows(&["turn_10.csv"], "b.csv");
    std::fs::rename(folder.join("turn_10.csv"), folder.join("gone.csv")).unwrap();
    let found = rows(&["run.df", "--time", "0.75"], "a.csv");
    assert!(truth.len() > 100 && found.keys().eq(truth.keys()));
    for (id, place) in &truth {
        // Within 1/512 of the smoothing length.
        assert!(distance(found[id], *place) < 0.1 / 512.0, "{id}: {:?} {place:?}", found[id]);
    }
    let probed = json(folder, &["probe", "run.df", "--time", "last", "--json", "-"]);
    assert_eq!(probed["count"], 500);
}

#[test]
fn runs_are_the_same_file_whatever_the_order_of_names_and_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let names: Vec<String> =
        snapshots(folder).iter().map(|path| path.file_name().unwrap().to_string_lossy().into()).collect();
    let times = ["--times", "0,0.5,0.75,2"];
    let build = |names: &[&str], more: &[&str], out: &str| {
        ok(folder, &[&["build", "-o", out], names, more].concat());
        read(folder, out)
    };
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let whole = build(&names, &times, "a.df");
    for threads in ["1", "7"] {
        assert!(whole == build(&names, &[&times[..], &["--threads", threads]].concat(), "b.df"), "{threads}");
    }
    let backwards = build(&names.iter().rev().copied().collect::<Vec<_>>(), &["--times", "2,0.75,0.5,0"], "c.df");
    // But for the note that they were sorted.
    let [a, c] = ["a.df", "c.df"].map(|name| {
        let mut about = json(folder, &["info", name, "--json"]);
        about.as_object_mut().unwrap().retain(|key, _| key == "steps" || key == "intervals");
        about
    });
    assert!(a == c && backwards.len() > 4096);
    std::fs::write(folder.join("steps.txt"), names.join("\n")).unwrap();
    assert!(whole == build(&["@steps.txt"], &times, "d.df"));
    // Without its sources a run is still what it was.
    let own = tempfile::tempdir().unwrap();
    std::fs::copy(folder.join("a.df"), own.path().join("moved.df")).unwrap();
    ok(own.path(), &["render", "moved.df", "--time", "last", "-o", "a.png", "--size", "64x64"]);
    ok(own.path(), &["verify", "moved.df"]);
}

#[test]
fn a_tour_around_a_run_plays_it() {
    let folder = built();
    let folder = folder.path();
    let around = ["tour", "--around", "run.df", "--seconds", "2", "--fps", "4", "--size", "64x36", "--record", "out"];
    ok(folder, &around);
    let time = |frame: usize| {
        let path = folder.join(format!("out/scenes/frame-{frame:05}.scene.ron"));
        let scene = deepfield::look::SceneFile::read(&path).unwrap();
        match scene.look.time {
            Some(deepfield::model::When::Time(time)) => time,
            other => panic!("{other:?}"),
        }
    };
    // From 0 to 2 in eight frames, evenly.
    for frame in 0..8 {
        assert!((time(frame) - 0.25 * frame as f64).abs() < 0.02, "{frame}: {}", time(frame));
    }
    ok(
        folder,
        &["tour", "--around", "turn_8.csv", "--seconds", "2", "--fps", "2", "--size", "64x36", "--record", "one"],
    );
}

#[test]
fn a_run_is_played_forward_backward_and_in_jumps() {
    let folder = built();
    let size = ["--size", "120x80", "--duration", "0.6", "--backends", "cpu", "--json", "-"];
    let told = json(folder.path(), &[&["bench", "play", "run.df"], &size[..]].concat());
    assert_eq!((&told[0]["particles"], &told[0]["steps"]), (&500.into(), &4.into()));
    for way in ["forward", "backward", "jumping"] {
        let played = &told[0][way];
        assert!(played["frames_per_second"].as_f64().unwrap() > 1.0, "{played}");
        // What has just been jumped to has to be read.
        let number = |key: &str| played[key].as_f64().unwrap();
        assert!((300.0..=500.0).contains(&number("tracks")) && number("worst_error_px") == 0.0, "{way}: {played}");
        assert!(number("late_frames") < 0.4 * number("frames"), "{way}: {played}");
    }
    let light = refused(folder.path(), &[&["bench", "play", "run.df", "--mode", "volume"], &size[..]].concat());
    assert!(light.ends_with("bench play: volume draws light; choose a mode of sums"), "{light}");
    let still = refused(folder.path(), &[&["bench", "play", "turn_8.csv"], &size[..]].concat());
    assert!(still.contains("turn_8.csv"), "{still}");
}

#[test]
fn moments_outside_are_refused_and_moments_between_steps_say_what_is_shown() {
    let folder = built();
    let folder = folder.path();
    let out = ["-o", "a.png", "--size", "64x64", "--backend", "cpu"];
    let at = |path: &str, time: &str| refused(folder, &[&["render", path, "--time", time], &out[..]].concat());
    assert!(at("run.df", "30").ends_with("run.df: --time 30: the run goes from 0 to 2"), "{}", at("run.df", "30"));
    assert!(at("run.df", "step:4").ends_with("the run has steps 0 to 3"));
    assert!(at("run.df", "z:1").ends_with("the run's steps have no redshifts"));
    assert!(at("turn_8.csv", "1").ends_with("turn_8.csv: --time: one snapshot, without a time"));
    let lines = refused(folder, &["select", "run.df", "--time", "-1", "-o", "a.csv"]);
    assert!(lines.ends_with("--time -1: the run goes from 0 to 2"), "{lines}");
    let words = run(folder, &["render", "run.df", "--time", "later", "-o", "a.png"]);
    assert_eq!(words.status.code(), Some(2));
    let told = json(folder, &[&["render", "run.df", "--time", "1", "--json", "-"], &out[..]].concat());
    let between = ["time", "step", "interval", "u", "interpolation"].map(|key| &told[key]);
    assert_eq!(between, [&1.0.into(), &2.into(), &2.into(), &0.2.into(), &Value::from("auto")]);
    assert_eq!((&told["tracks_drawn"], &told["faded_mass"]), (&500.into(), &0.0.into()));
    let held = [&["render", "run.df", "--time", "1", "--interpolation", "hold", "--json", "-"], &out[..]].concat();
    let told = json(folder, &held);
    assert_eq!((&told["interpolation"], &told["tracks_drawn"]), (&Value::from("hold"), &0.into()));
    let stored = json(folder, &[&["render", "run.df", "--time", "step:2", "--json", "-"], &out[..]].concat());
    assert_eq!((&stored["time"], &stored["interval"]), (&0.75.into(), &Value::Null));
    // A scene has its time, and says that it needs it.
    let scene = r#"(version: 2, datasets: [(path: "run.df")], time: step(3), mode: "column-density", size: (64, 64))"#;
    std::fs::write(folder.join("a.scene.ron"), scene).unwrap();
    let told = json(folder, &["render", "a.scene.ron", "-o", "b.png", "--json", "-", "--backend", "cpu"]);
    assert_eq!(told["step"], 3);
    // Of one snapshot the scene's time is left out, and that is told.
    let other = ok(folder, &["render", "turn_8.csv", "--scene", "a.scene.ron", "-o", "b.png", "--backend", "cpu"]);
    assert!(String::from_utf8_lossy(&other.stderr).contains("the scene's time is left out"));
}

#[test]
fn damaged_and_unlike_snapshots_are_refused_or_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    snapshots(folder);
    let text = String::from_utf8(read(folder, "turn_9.csv")).unwrap();
    std::fs::write(folder.join("turn_9.csv"), text.replace("500", "five")).unwrap();
    std::fs::write(folder.join("turn_10.csv"), "x,y\n1,2\n").unwrap();
    let build = ["build", "turn_*.csv", "-o", "run.df", "--times", "steps"];
    let told = refused(folder, &build);
    assert!(told.contains("turn_"), "{told}");
    let left = |folder: &Path| {
        let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.starts_with("run.df")).count()
    };
    assert_eq!(left(folder), 0, "nothing is left behind");
    let told = ok(folder, &[&build[..], &["--skip-damaged"]].concat());
    assert!(String::from_utf8_lossy(&told.stderr).contains("left out: turn_10.csv"));
    let about = json(folder, &["info", "run.df", "--json"]);
    let times: Vec<&Value> = about["steps"].as_array().unwrap().iter().map(|step| &step["time"]).collect();
    assert!(!times.contains(&&Value::from(2.0)) && times.contains(&&Value::from(3.0)), "{times:?}");
    assert!(about["notes"].to_string().contains("turn_10.csv"), "{}", about["notes"]);
    assert!(refused(folder, &["build", "turn_8.csv", "turn_88.csv", "-o", "b.df"]).contains("turn_88.csv"));
    assert!(refused(folder, &["build", "turn_8.csv", "turn_11.csv", "-o", "b.df"]).contains("--times"));
}

#[test]
fn a_tour_goes_through_the_steps_and_each_frame_can_be_made_again() {
    let folder = built();
    let folder = folder.path();
    let tour = r#"(version: 2, dataset: (path: "run.df"), size: (96, 64), rate: 8.0, keyframes: [
        (time: 0.0, mode: "column-density", paths: (of: all, run: 0.7, width: 1.5)), (after: 1.0, time: 0.5, orbit: 30.0), (after: 0.5, time: step(3))])"#;
    std::fs::write(folder.join("a.tour.ron"), tour).unwrap();
    ok(folder, &["tour", "a.tour.ron", "--record", "frames", "--backend", "cpu"]);
    let scene =
        |frame: usize| String::from_utf8(read(folder, &format!("frames/scenes/frame-{frame:05}.scene.ron"))).unwrap();
    // Evenly on the way: at the half of the second way the time is 1.25.
    for (frame, time) in [
        (0, "time: Some(0.0),"),
        (4, "time: Some(0.25),"),
        (8, "time: Some(0.5),"),
        (10, "time: Some(1.25),"),
        (12, "time: Some(2.0),"),
    ] {
        assert!(scene(frame).contains(time) && scene(frame).contains("version: 2"), "{frame}: {}", scene(frame));
    }
    // Highlights run on with the tour's time.
    assert!(scene(4).contains("phase: 0.35") && scene(8).contains("phase: 0.7"), "{}", scene(4));
    for frame in [0, 5, 8, 11, 12] {
        let path = format!("frames/scenes/frame-{frame:05}.scene.ron");
        ok(folder, &["render", &path, "-o", "again.png", "--backend", "cpu"]);
        assert!(read(folder, "again.png") == read(folder, &format!("frames/frame-{frame:05}.png")), "{frame}");
    }
    let outside = tour.replace("step(3)", "step(9)");
    std::fs::write(folder.join("b.tour.ron"), outside).unwrap();
    let told = refused(folder, &["tour", "b.tour.ron", "--check"]);
    assert!(told.contains("b.tour.ron") && told.contains("step:9") && told.contains("steps 0 to 3"), "{told}");
    // Data without times.
    ok(folder, &["tour", "a.tour.ron", "turn_8.csv", "--check"]);
}

#[test]
fn no_damage_goes_unnoticed_and_none_panics() {
    let folder = built();
    let folder = folder.path();
    let whole = read(folder, "run.df");
    let path = folder.join("bad.df");
    let quiet = |bytes: &[u8], what: &str| {
        std::fs::write(&path, bytes).unwrap();
        let found = deepfield::store::run::verify_run(&path, &());
        assert!(found.is_err(), "{what}");
        // Whatever is wrong with it, what opens it ends with an error or a still.
        if let Ok(run) = deepfield::store::RunFile::open(&path, Default::default()) {
            for step in 0..run.directory().steps.len() {
                drop(run.placed_still(step).map(|still| still.read_page(deepfield::store::PageId(0))));
            }
        }
    };
    assert!(deepfield::store::run::verify_run(&folder.join("run.df"), &()).is_ok());
    for cut in (0..whole.len()).step_by(4096) {
        quiet(&whole[..cut], &format!("cut to {cut}"));
    }
    let mut random: u64 = 7;
    let mut next = |below: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % below
    };
    for round in 0..300 {
        let mut bytes = whole.clone();
        // Half of them near the directory.
        let from = if round % 2 == 0 { whole.len() - whole.len().min(2048) } else { 0 };
        let at = from + next(whole.len() - from);
        bytes[at] ^= 1 << next(8);
        quiet(&bytes, &format!("a bit of byte {at}"));
    }
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let told = refused(folder, &["render", "bad.df", "-o", "a.png"]);
    assert!(told.contains("bad.df") && told.contains("truncated"), "{told}");
}

#[test]
fn particles_move_between_steps_in_pictures_selections_tables_and_tours() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ok(folder, &["synth", "orbits", "-n", "500", "--steps", "5", "-o", "run"]);
    let names: Vec<String> = (0..5).map(|step| format!("run_00{step}")).collect();
    let build = [&["build", "-o", "run.df"], &names.iter().map(String::as_str).collect::<Vec<_>>()[..]].concat();
    ok(folder, &build);
    let about = json(folder, &["info", "run.df", "--json"]);
    let family = &about["intervals"][0]["families"][0];
    assert_eq!((&family["matched"], &family["tangents"]), (&500.into(), &"velocity".into()));
    assert!((family["velocity_factor"].as_f64().unwrap() - 1.0).abs() < 0.05);
    assert_eq!(about["intervals"].as_array().unwrap().len(), 4);
    ok(folder, &["verify", "run.df", "--sources"]);
    let time = 0.5 * (about["steps"][1]["time"].as_f64().unwrap() + about["steps"][2]["time"].as_f64().unwrap());
    let time = time.to_string();
    // Snapshots are of steps alone.
    let output = run(folder, &["render", "run.df", "--time", &time, "--exact", "-o", "step.png", "--size", "24x18"]);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && told.contains("between steps: what is drawn is of step 1"), "{told}");
    names.iter().for_each(|name| std::fs::remove_file(folder.join(name)).unwrap());
    // A picture between steps is that of the particles that a selection has there.
    let camera =
        ["--size", "96x72", "--backend", "cpu", "--eye", "0,0,9", "--target", "0,0,0", "--mode", "column-density"];
    let picture = |arguments: &[&str], name: &str| {
        ok(folder, &[&["render", "-o", name], &camera[..], arguments].concat());
        read(folder, name)
    };
    ok(folder, &["select", "run.df", "--time", &time, "-o", "there.csv"]);
    let moved = picture(&["run.df", "--time", &time], "moved.png");
    assert!(moved == picture(&["there.csv", "--exact"], "there.png"));
    let others = ["hold", "linear", "fade"]
        .map(|way| picture(&["run.df", "--time", &time, "--interpolation", way], "other.png"));
    assert!(others.iter().all(|other| *other != moved));
    // The table of tracks has both ends of each, and the ends of the first interval are where the second one begins.
    let some: Vec<String> = places(folder, "there.csv").keys().take(7).map(u64::to_string).collect();
    std::fs::write(folder.join("some.ids"), some.join("\n")).unwrap();
    ok(folder, &["paths", "run.df", "--ids", "some.ids", "--to", "step:2", "-o", "some.csv"]);
    let text = String::from_utf8(read(folder, "some.csv")).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let at = |name: &str| header.iter().position(|own| own.split(' ').next() == Some(name)).unwrap();
    let ends = |interval: &str, u: &str| {
        let rows = text.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
        let own = rows.filter(|row| row[at("interval")] == interval && row[at("u")] == u);
        let columns = ["id", "x", "y", "z", "vx", "vy", "vz", "mass"].map(at);
        let mut ends: Vec<Vec<String>> = own.map(|row| columns.map(|column| row[column].to_owned()).to_vec()).collect();
        ends.sort();
        ends
    };
    assert_eq!(ends("0", "1").len(), 7);
    assert_eq!(ends("0", "1"), ends("1", "0"));
    assert!(refused(folder, &["paths", "run.df", "--from", "last", "-o", "none.csv"]).contains("--from"));
    // A tour goes through the interval, and its scenes make its frames again.
    let tour = r#"(version: 2, dataset: (path: "run.df"), size: (96, 72), rate: 4.0, keyframes: [
        (time: step(1), mode: "column-density", interpolation: linear, camera: (eye: (0.0, 0.0, 9.0), target: (0.0, 0.0, 0.0))),
        (after: 1.0, time: step(2))])"#;
    std::fs::write(folder.join("show.ron"), tour).unwrap();
    ok(folder, &["tour", "show.ron", "--record", "frames", "--backend", "cpu"]);
    let frames: Vec<Vec<u8>> = (0..4).map(|i| read(folder, &format!("frames/frame-0000{i}.png"))).collect();
    assert!(frames.windows(2).all(|pair| pair[0] != pair[1]));
    ok(folder, &["render", "frames/scenes/frame-00002.scene.ron", "-o", "again.png", "--backend", "cpu"]);
    assert!(read(folder, "again.png") == frames[2]);
}

#[test]
fn a_run_that_the_cache_has_no_room_for_is_told_before_it_is_begun() {
    let folder = tempfile::tempdir().unwrap();
    snapshots(folder.path());
    // What is built in a cache of so many bytes, which is empty to begin with: what is told, and the page files and runs there.
    let viewed = |budget: u64| {
        let cache = tempfile::tempdir().unwrap();
        let mut command = crate::support::program();
        command.args(["view", "turn_*.csv", "--size", "32x32", "--picture", "p.png"]).current_dir(folder.path());
        command.env("XDG_CACHE_HOME", cache.path()).env("DEEPFIELD_CACHE", format!("{budget}B"));
        command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
        let output = command.output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && folder.path().join("p.png").exists(), "{told}");
        std::fs::remove_file(folder.path().join("p.png")).unwrap();
        let files: Vec<PathBuf> = std::fs::read_dir(cache.path().join("deepfield/pages"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        let size = |path: &&PathBuf| std::fs::metadata(path).unwrap().len();
        let (runs, steps): (Vec<_>, Vec<_>) = files.iter().partition(|path| path.to_string_lossy().contains("-run-"));
        let tracks = runs.first().map(|run| {
            json(folder.path(), &["info", run.to_str().unwrap(), "--json"])["intervals"].as_array().map_or(0, Vec::len)
        });
        (told, steps.iter().map(size).max().unwrap_or(0), tracks)
    };
    let (told, step, intervals) = viewed(1_000_000_000);
    assert!(!told.contains("the run takes") && intervals == Some(3), "{told}");
    // Tracks are taken to have 20 bytes in each of three intervals.
    let (told, _, intervals) = viewed(4 * step + 29_000);
    assert!(told.contains("the run takes about") && told.contains("its steps are shown"), "{told}");
    assert_eq!(intervals, Some(0));
    let (told, _, intervals) = viewed(3 * step);
    assert!(told.contains("(DEEPFIELD_CACHE): one step is shown") && intervals.is_none(), "{told}");
}

/// A column of a table, by id.
fn column(folder: &Path, name: &str, column: &str) -> BTreeMap<u64, f64> {
    let mut table = csv::Reader::from_path(folder.join(name)).unwrap();
    let header = table.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|own| own.split(' ').next() == Some(name)).unwrap();
    let (id, column) = (at("id"), at(column));
    table
        .records()
        .map(|row| row.unwrap())
        .map(|row| (row[id].parse().unwrap(), row[column].parse().unwrap()))
        .collect()
}

#[test]
fn tables_of_comoving_runs_are_physical_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ok(folder, &["synth", "pancake", "-n", "200", "--steps", "4", "-o", "run"]);
    ok(folder, &["build", "run_000", "run_001", "run_002", "run_003", "-o", "run.df"]);
    let at = json(folder, &["info", "run.df", "--json"])["steps"][1]["scale_factor"].as_f64().unwrap();
    for (frame, name) in [("comoving", "there.csv"), ("physical", "physical.csv")] {
        ok(folder, &["select", "run.df", "--time", "step:1", "--frame", frame, "-o", name]);
    }
    // Gadget's velocities are peculiar ones by the root of the scale factor.
    let of = |name: &str, quantity: &str| column(folder, name, quantity);
    for (quantity, factor) in
        [("x", at), ("vy", at.sqrt()), ("smoothing-length", at), ("density", at.powi(-3)), ("mass", 1.0)]
    {
        let (stored, physical) = (of("there.csv", quantity), of("physical.csv", quantity));
        assert_eq!(stored.len(), physical.len());
        for (id, value) in &stored {
            assert!((physical[id] - factor * value).abs() <= 1e-12 * value.abs(), "{quantity} of {id}");
        }
    }
    // Tracks have the same where they begin.
    ok(folder, &["paths", "run.df", "--from", "step:1", "--to", "step:2", "--frame", "physical", "-o", "paths.csv"]);
    let text = String::from_utf8(read(folder, "paths.csv")).unwrap();
    let header = text.lines().next().unwrap();
    let u = header.split(',').position(|name| name == "u").unwrap();
    let begins = text.lines().skip(1).filter(|line| line.split(',').nth(u) == Some("0"));
    let begins = std::iter::once(header).chain(begins).collect::<Vec<_>>().join("\n");
    std::fs::write(folder.join("begins.csv"), begins).unwrap();
    for quantity in ["x", "z", "vx", "vz", "density"] {
        let (ours, theirs) = (of("begins.csv", quantity), of("physical.csv", quantity));
        let largest = theirs.values().fold(0.0f64, |largest, value| largest.max(value.abs()));
        // What is rounded to a face of the box is on either side of it.
        let edge = if ["x", "z"].contains(&quantity) { 100.0 * at } else { f64::INFINITY };
        let off = |(id, value): (&u64, &f64)| (value - theirs[id]).abs().min(((value - theirs[id]).abs() - edge).abs());
        assert!(ours.len() == 200 && ours.iter().map(off).all(|off| off < 1e-9 * largest), "{quantity}");
    }
    // Over time: of everybody the mean of both.
    ok(folder, &["probe", "run.df", "--sphere", "50,50,50,20", "--over-time", "-o", "over.csv"]);
    ok(
        folder,
        &[
            "probe",
            "run.df",
            "--sphere",
            "50,50,50,20",
            "--over-time",
            "--frame",
            "physical",
            "-o",
            "over-physical.csv",
        ],
    );
    let row = |name: &str| -> Vec<f64> {
        let text = String::from_utf8(read(folder, name)).unwrap();
        text.lines().nth(2).unwrap().split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect()
    };
    let (stored, physical) = (row("over.csv"), row("over-physical.csv"));
    assert!((physical[5] / stored[5] - at).abs() < 1e-12 && (physical[9] / stored[9] - at.sqrt()).abs() < 1e-12);
    // What does not expand is physical already.
    snapshots(folder);
    ok(folder, &["select", "turn_8.csv", "--frame", "physical", "-o", "same.csv"]);
    assert_eq!(of("turn_8.csv", "x"), of("same.csv", "x"));
}

/// A snapshot of gas that moves evenly along x, as Gadget's HDF5 files have it: its time, ids, box, and an attribute where it has one.
fn gas(path: &Path, time: f64, ids: Option<Vec<u64>>, edge: f64, attribute: Option<&str>) {
    let count = ids.as_ref().map_or(40, Vec::len);
    let column = |columns: usize, of: &dyn Fn(usize, usize) -> f64| {
        Values::F64((0..count).flat_map(|i| (0..columns).map(move |k| (i, k))).map(|(i, k)| of(i, k)).collect())
    };
    let mut file = Hdf5::default();
    file.attribute("Header", "NumPart_ThisFile", Values::U32(vec![count as u32, 0, 0, 0, 0, 0]));
    file.attribute("Header", "Time", Values::F64(vec![time]));
    file.attribute("Header", "BoxSize", Values::F64(vec![edge]));
    let place =
        |i: usize, k: usize| 1.0 + ((i * (3 + 2 * k)) % 41) as f64 / 6.0 + if k == 0 { 0.1 * time } else { 0.0 };
    file.dataset("PartType0", "Coordinates", 3, column(3, &place));
    file.dataset("PartType0", "Velocities", 3, column(3, &|_, k| if k == 0 { 0.1 } else { 0.0 }));
    file.dataset("PartType0", "Masses", 1, column(1, &|_, _| 1.0));
    file.dataset("PartType0", "SmoothingLength", 1, column(1, &|_, _| 0.5));
    file.dataset("PartType0", "Density", 1, column(1, &|_, _| 1.0));
    if let Some(name) = attribute {
        file.dataset("PartType0", name, 1, column(1, &|i, _| i as f64));
    }
    if let Some(ids) = ids {
        file.dataset("PartType0", "ParticleIDs", 1, Values::U64(ids));
    }
    file.write(path);
}

#[test]
fn input_that_makes_no_run_is_refused_in_one_line_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let ids = || Some((1..=40).collect::<Vec<u64>>());
    let write = |name: &str, time: f64, ids: Option<Vec<u64>>, edge: f64, attribute: Option<&str>| {
        gas(&folder.join(name), time, ids, edge, attribute);
    };
    for (name, time) in [("s_0.hdf5", 0.0), ("s_1.hdf5", 1.0), ("s_2.hdf5", 2.0), ("s_4.hdf5", 4.0)] {
        write(name, time, ids(), 10.0, None);
    }
    write("same.hdf5", 1.0, ids(), 10.0, None);
    write("wide.hdf5", 3.0, ids(), 10.1, None);
    write("none.hdf5", 3.0, None, 10.0, None);
    write("fewer.hdf5", 3.0, Some((1..=39).collect()), 10.0, None);
    write("shared.hdf5", 3.0, Some((0..40).map(|i| i % 30).collect()), 10.0, None);
    write("hot.hdf5", 3.0, ids(), 10.0, Some("Temperature"));
    let whole = read(folder, "s_1.hdf5");
    std::fs::write(folder.join("cut.hdf5"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(folder.join("pc.csv"), "id,x [pc],y [pc],z [pc]\n1,0,0,0\n2,1,1,1\n").unwrap();
    std::fs::write(folder.join("k.csv"), "id,x [code units],y [code units],z [code units]\n1,0,0,0\n2,1,1,1\n")
        .unwrap();
    let refused = |words: &[&str], parts: &[&str]| {
        let told = refused(folder, &[&["build", "-o", "out.df"], words].concat());
        assert!(parts.iter().all(|part| told.contains(part)), "{words:?}: {told}");
        let left = std::fs::read_dir(folder)
            .unwrap()
            .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().starts_with("out.df"));
        assert_eq!(left.count(), 0, "{words:?}");
    };
    refused(&["s_0.hdf5", "s_9.hdf5"], &["s_9.hdf5"]);
    refused(&["s_0.hdf5", "cut.hdf5"], &["cut.hdf5: "]);
    refused(&["s_1.hdf5", "same.hdf5"], &["time: found 1", "s_1.hdf5", "same.hdf5"]);
    refused(&["pc.csv", "k.csv"], &["time: missing", "--times"]);
    refused(&["pc.csv", "k.csv", "--times", "steps"], &["k.csv", "lengths"]);
    refused(&["s_0.hdf5", "wide.hdf5"], &["wide.hdf5", "10.1"]);
    refused(&["s_0.hdf5", "none.hdf5"], &["gas: ids: missing in none.hdf5", "--match order", "--stills-only"]);
    refused(&["s_0.hdf5", "shared.hdf5"], &["gas: ids: found 9 of 40 that others have too", "--match"]);
    refused(&["s_0.hdf5", "fewer.hdf5", "--match", "order"], &["40", "39"]);
    refused(&["s_0.hdf5", "hot.hdf5", "--attributes", "temperature"], &["s_0.hdf5", "attribute temperature"]);
    // What is only a note.
    let taken = |words: &[&str], note: &str| {
        let told = ok(folder, &[&["build", "-o", "out.df"], words].concat());
        let told = String::from_utf8_lossy(&told.stderr).into_owned();
        let about = json(folder, &["info", "out.df", "--json"]);
        assert!(told.contains(note) && about["notes"].to_string().contains(note), "{words:?}: {told}");
        about
    };
    taken(&["s_0.hdf5", "s_1.hdf5", "s_2.hdf5", "s_4.hdf5"], "no file between s_2.hdf5 and s_4.hdf5");
    taken(&["s_1.hdf5", "s_0.hdf5", "hot.hdf5"], "attribute temperature is left out");
    let about = taken(&["s_0.hdf5", "cut.hdf5", "s_2.hdf5", "--skip-damaged"], "cut.hdf5");
    assert_eq!(about["steps"].as_array().unwrap().len(), 2);
}
