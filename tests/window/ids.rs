//! Selections by id in the window, driven as a user would under a virtual X server: the inspector asks the source, a region is kept
//! by its ids, followed, shown alone, written, and found again in another snapshot of the same run.

use super::desktop::{Desktop, Program, choose, click, distance, keep, middle, point, repeat};
use deepfield::import::{FieldKind, open};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

/// Where the clump is in either snapshot.
const CLUMPS: [[f64; 3]; 2] = [[25.0, 25.0, 25.0], [32.0, 29.0, 22.0]];
/// Particles of the clump; their ids are every second number from 1000 on.
const CLUMP: u64 = 400;
const SIZE: [u16; 2] = [960, 540];

/// A snapshot as a table: a clump at `center` in a thin background, its rows in another order each time.
fn snapshot(path: &Path, center: [f64; 3], reversed: bool) {
    let mut state = 7_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1_u32 << 31)
    };
    let mut rows: Vec<(u64, [f64; 3])> =
        (0..CLUMP).map(|i| (1000 + 2 * i, center.map(|at| at + 0.6 * (random() - 0.5) * (1.0 + random())))).collect();
    rows.extend((0..3000).map(|i| (100_001 + i, [random() * 50.0, random() * 50.0, random() * 50.0])));
    if reversed {
        rows.reverse();
    }
    let mut table = "id,x [Mpc],y [Mpc],z [Mpc],mass [Msun]\n".to_owned();
    for (id, [x, y, z]) in rows {
        writeln!(table, "{id},{x},{y},{z},{}", 1.0 + (id % 7) as f64).unwrap();
    }
    std::fs::write(path, table).unwrap();
}

fn selections(status: &Value) -> usize {
    status["settings"]["selections"].as_array().map_or(0, Vec::len)
}

fn following(status: &Value) -> Option<[f64; 3]> {
    status["looking"]["following"].is_array().then(|| point(&status["looking"], "following"))
}

#[test]
fn particles_are_identified_kept_by_id_followed_and_found_in_another_snapshot() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let [first, second] = ["first.csv", "second.csv"].map(|name| folder.path().join(name));
    snapshot(&first, CLUMPS[0], false);
    snapshot(&second, CLUMPS[1], true);
    let mut program = Program::open(&desktop, folder.path(), &first, SIZE, &["--backend", "cpu"]);
    let start = program.wait("a converged picture", |status| status["converged"] == true);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    let middle = middle(&start);

    // A click reads the page file, and of a small source the row at once: id and exact values.
    let seen = |s: &Value| s["looking"]["inspected"]["row"].is_object();
    let inspected = repeat(&program, "a row of the source", || desktop.click(middle), seen);
    let (inspected, row) = (&inspected["looking"]["inspected"], &inspected["looking"]["inspected"]["row"]);
    let source = open(&first).unwrap();
    let info = &source.description().families[0];
    let read = |kind: FieldKind, components: usize| {
        let mut out = vec![0.0; components];
        let at = row["row"].as_u64().unwrap();
        source.read(0, info.find(kind).unwrap(), at..at + 1, &mut out).unwrap();
        out
    };
    assert_eq!(row["id"].as_u64().unwrap() as f64, read(FieldKind::Id, 1)[0], "{row:#}");
    let position = point(row, "position");
    // JSON's digits are exact; the test's reader of them is not, in the last one.
    let exact: [f64; 3] = read(FieldKind::Position, 3).try_into().unwrap();
    assert!(distance(position, exact) < 1e-13, "{row:#} for {exact:?}");
    let rounding = inspected["rounding"].as_f64().unwrap();
    assert!(distance(position, point(inspected, "position")) <= 1.8 * rounding + 1e-9, "{inspected:#}");
    keep(&desktop, "identified.png");

    // A sphere around the clump becomes a selection, by its particles' ids.
    click(&program, &desktop, "tool:Sphere", |s| s["looking"]["tool"] == "Sphere");
    let draw = || desktop.drag(middle, [middle[0] + 22, middle[1]]);
    repeat(&program, "a probe", draw, |s| s["looking"]["probe"].is_object());
    click(&program, &desktop, "keep", |s| selections(s) == 1);
    let found = |s: &Value| s["looking"]["found"][0]["count"].as_u64();
    let known = click(&program, &desktop, "selection:0:by-id", |s| found(s).is_some());
    let count = found(&known).unwrap();
    assert!((CLUMP / 2..CLUMP + 60).contains(&count), "{count}");
    assert!(known["settings"]["selections"][0]["members"]["Ids"].is_string(), "{known:#}");

    // It is summed up, written and plotted from the source.
    let is_exact = |probe: &Value| probe["count"].as_u64() == Some(count) && probe["exact"] == true;
    click(&program, &desktop, "selection:0:probe", |s| is_exact(&s["looking"]["probe"]));
    // The table has no densities; the page file's are estimates.
    let plotted = |s: &Value| s["looking"]["plot"]["particles"].as_u64() == Some(count);
    choose(&program, &desktop, "plots:x", "plots:x:mass", plotted);
    let written = click(&program, &desktop, "selection:0:Parquet", |s| s["looking"]["table"].is_object());
    assert_eq!(written["looking"]["table"]["rows"].as_u64(), Some(count));
    let table = std::fs::read(written["looking"]["table"]["path"].as_str().unwrap()).unwrap();
    assert!(table.starts_with(b"PAR1") && table.ends_with(b"PAR1"));

    // It is followed: flown to, and shown alone.
    let toward = |s: &Value, center: [f64; 3]| {
        following(s).is_some_and(|at| distance(at, center) < 0.5 && distance(point(s, "target"), at) < 1e-3)
    };
    let follow = || {
        desktop.click(program.reveal(&desktop, "selection:0:follow"));
        std::thread::sleep(Duration::from_secs(5));
    };
    repeat(&program, "following", follow, |s| toward(s, CLUMPS[0]));
    keep(&desktop, "following.png");
    let alone = |s: &Value| s["settings"]["selections"][0]["show"] == "alone";
    choose(&program, &desktop, "selection:0:show", "selection:0:show:alone", alone);
    keep(&desktop, "by-id-alone.png");

    // The wheel goes on zooming while it is followed.
    let before = program.status();
    let far = |s: &Value| distance(point(s, "eye"), point(s, "target"));
    let zoom = || {
        desktop.fake_input(6, 0, middle);
        (0..3).for_each(|_| [4, 5].into_iter().for_each(|event| desktop.fake_input(event, 4, [0; 2])));
    };
    repeat(&program, "a zoom", zoom, |s| far(s) < 0.8 * far(&before) && toward(s, CLUMPS[0]));

    // The second snapshot in the light of the scene: the same particles, where they are now.
    click(&program, &desktop, "save", |s| s["scene"].is_string());
    let scene = folder.path().join("first.scene.ron");
    let text = std::fs::read_to_string(&scene).unwrap();
    assert!(text.contains("follow: true") && text.contains("Ids("), "{text}");
    drop(program);
    let arguments = ["--backend", "cpu", "--scene", scene.to_str().unwrap()];
    let mut program = Program::open(&desktop, folder.path(), &second, SIZE, &arguments);
    let found_again = program.wait("the set in the second snapshot", |s| {
        found(s) == Some(count)
            && following(s).is_some()
            && s["open"].as_str().is_some_and(|open| open.ends_with("second.csv"))
    });
    assert!(distance(following(&found_again).unwrap(), CLUMPS[1]) < 0.5, "{found_again:#}");
    keep(&desktop, "second-snapshot.png");
    let out = folder.path().join("second.png");
    let mut command = crate::support::program();
    command.args(["render", second.to_str().unwrap(), "--backend", "cpu", "--size", "400x300", "--ortho", "50"]);
    command.args(["--target", "25,25,25", "--eye", "25,25,200", "--scene", scene.to_str().unwrap(), "-o"]).arg(&out);
    for exact in [&[][..], &["--exact"]] {
        let output = command.args(exact).env("XDG_CACHE_HOME", folder.path()).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        let mut reader =
            png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&out).unwrap())).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let channels = info.line_size / 400;
        // Alone, and where the clump is now: right of the middle and above it.
        let [x, y] = [200.0 + 6.0 * (CLUMPS[1][0] - 25.0), 150.0 - 6.0 * (CLUMPS[1][1] - 25.0)];
        let is_blue = |at: usize| {
            let [r, g, b] = [0, 1, 2].map(|k| f64::from(pixels[at * channels + k]));
            b > 100.0 && (g - 0.77 * b).abs() < 25.0 && (r - 0.37 * b).abs() < 25.0
        };
        let blue: Vec<usize> = (0..400 * 300).filter(|&at| is_blue(at)).collect();
        let around = |[x, y]: [f64; 2]| {
            blue.iter().filter(|at| ((**at % 400) as f64 - x).hypot((**at / 400) as f64 - y) < 12.0).count()
        };
        // Some of the background was in the sphere, too, and has stayed where it was.
        let (now, before) = (around([x, y]), around([200.0, 150.0]));
        assert!(now > 20 && now > 2 * before, "{exact:?}: {now} pixels where it is, {before} where it was");
    }
}
