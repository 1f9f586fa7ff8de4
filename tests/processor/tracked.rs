//! Selections of a run that follow their particles: the same ones at every step and in between, however they are found, in pictures,
//! tables and tours.

use crate::support::{json, ok, run};
use deepfield::explore::{Following, Members, Region, Work};
use deepfield::hierarchy::spacetime::Interpolation;
use deepfield::look::SceneFile;
use deepfield::model::{Moment, ReadMethod, When};
use deepfield::store::RunFile;
use glam::DVec3;
use proptest::prelude::*;
use std::path::Path;
use std::sync::{Arc, OnceLock};

fn text(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap()
}

/// A generated run, built as `run.df`.
fn built(kind: &str, count: &str, steps: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    ok(folder.path(), &["synth", kind, "-n", count, "--steps", steps, "--irregular", "3", "-o", "run"]);
    ok(folder.path(), &["build", "run_*", "-o", "run.df"]);
    folder
}

/// Runs of each kind: orbits in the open, a periodic box whose particles cross its faces, births, deaths and repeated ids.
fn runs() -> &'static [(tempfile::TempDir, Arc<RunFile>)] {
    static RUNS: OnceLock<Vec<(tempfile::TempDir, Arc<RunFile>)>> = OnceLock::new();
    RUNS.get_or_init(|| {
        let kinds = [("orbits", "4000"), ("pancake", "40000"), ("births", "3000")];
        let open = |(kind, count)| {
            let folder = built(kind, count, "6");
            let run = RunFile::open(&folder.path().join("run.df"), ReadMethod::default()).unwrap();
            (folder, Arc::new(run))
        };
        kinds.into_iter().map(open).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Tracks that are carried on from interval to interval are those that all ids are searched for.
    #[test]
    fn members_are_carried_to_the_tracks_that_a_search_finds(
        number in 0_usize..3, step in 0_u32..6, share in 0.02..0.5f64, place in prop::array::uniform3(0.0..1.0f64),
    ) {
        let run = &runs()[number].1;
        let bounds = run.placed_still(step as usize).unwrap().metadata().bounds();
        let center = bounds.min + DVec3::from(place) * bounds.size();
        let region = Region::sphere(center, share * bounds.size().max_element());
        let members = Members::Tracked { at: When::Step(step), region: region.clone() };
        let following = Following::new(Arc::clone(run)).unwrap();
        let followed = following.of(&members, Work::quiet()).unwrap().unwrap();
        let wanted = |family, id| followed.has(family, id);
        let mut before = run.find_members(0, &wanted).unwrap();
        for interval in 1..run.directory().intervals.len() {
            let carried = run.carry_members(&before, &wanted).unwrap();
            prop_assert_eq!(&carried, &run.find_members(interval, &wanted).unwrap(), "interval {}", interval);
            before = carried;
        }
        // At its own time it has who is in the region, and its centre.
        let moment = run.moment(When::Step(step)).unwrap();
        let (here, whole) = following.snapshot(&members, moment, Interpolation::Auto, Work::quiet()).unwrap();
        prop_assert!(whole.is_whole());
        let (there, region) = following.snapshot(&Members::Region(region), moment, Interpolation::Auto, Work::quiet()).unwrap();
        let ids = |source, of: &Region| deepfield::explore::ids_of(source, of, following.periodic(), Work::quiet()).unwrap();
        prop_assert_eq!(ids(&here, &whole), ids(&there, &region));
    }
}

#[test]
fn what_is_followed_is_who_was_there() {
    let folder = built("orbits", "3000", "5");
    let folder = folder.path();
    let sphere = ["--sphere", "0.3,0.1,0,0.4"];
    ok(folder, &[&["select", "run.df", "--time", "step:2", "-o", "there.ids"], &sphere[..]].concat());
    let ids = text(folder, "there.ids");
    assert!(ids.lines().count() > 20, "{ids}");
    let tracked = [&["--tracked-at", "step:2"], &sphere[..]].concat();
    let lines = |text: &str| text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect::<Vec<_>>();
    for time in ["step:0", "0.31", "step:2", "0.7", "step:3", "last"] {
        ok(folder, &[&["select", "run.df", "--time", time, "-o", "now.ids"], &tracked[..]].concat());
        assert_eq!(lines(&ids), lines(&text(folder, "now.ids")), "{time}");
        for (name, who) in [("a.csv", &tracked[..]), ("b.csv", &["--ids", "there.ids"])] {
            ok(folder, &[&["select", "run.df", "--time", time, "-o", name], who].concat());
        }
        assert_eq!(text(folder, "a.csv"), text(folder, "b.csv"), "{time}");
    }
    // Their paths, and what they are over time.
    ok(folder, &[&["paths", "run.df", "-o", "a.csv"], &tracked[..]].concat());
    ok(folder, &["paths", "run.df", "-o", "b.csv", "--ids", "there.ids"]);
    assert_eq!(text(folder, "a.csv"), text(folder, "b.csv"));
    let count = text(folder, "there.ids").lines().next().unwrap().split(' ').nth(1).unwrap().parse::<usize>().unwrap();
    assert_eq!(text(folder, "a.csv").lines().count(), 1 + 2 * 4 * count);
    let over = json(folder, &[&["probe", "run.df", "--over-time", "--json", "-"], &tracked[..]].concat());
    let steps = over["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 5);
    for (step, row) in steps.iter().enumerate() {
        assert_eq!(row["count"].as_u64(), Some(count as u64));
        let time = format!("step:{step}");
        let now = json(folder, &[&["probe", "run.df", "--time", &time, "--json", "-"], &tracked[..]].concat());
        assert_eq!(now["center_of_mass"], row["center"], "{step}");
        assert_eq!(now["tracked_at"]["step"], 2);
    }
    assert_eq!(steps[0]["distance"], 0.0);
    assert!(steps[4]["dispersion"].as_f64().unwrap() > 0.0);
    ok(folder, &[&["probe", "run.df", "--over-time", "-o", "over.csv"], &sphere[..]].concat());
    let table = text(folder, "over.csv");
    assert!(table.lines().count() == 6 && table.starts_with("step,time,redshift,count,mass"), "{table}");
    // A region is who is there now, unlike those who were.
    let now: Vec<&str> = table.lines().skip(1).map(|line| line.split(',').nth(3).unwrap()).collect();
    assert_eq!(now[2], count.to_string());
    // What is no run has nobody to follow; times that there are not are refused.
    for (path, time) in [("run_002", "step:0"), ("run.df", "step:9")] {
        let output = run(folder, &["select", path, "--tracked-at", time, "-o", "c.csv"]);
        assert_eq!(output.status.code(), Some(1), "{path}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn pictures_and_tours_follow_a_selection() {
    let folder = built("orbits", "3000", "5");
    let folder = folder.path();
    let region = "(shapes: [Sphere(center: (0.6, 0.1, 0.0), radius: 0.25)])";
    ok(folder, &["select", "run.df", "--time", "0.5", "--sphere", "0.6,0.1,0,0.25", "-o", "there.ids"]);
    let ids = text(folder, "there.ids").lines().skip(1).collect::<Vec<_>>().join(",");
    let sets = [
        ("tracked", format!("(name: \"clump\", show: alone, members: Tracked(at: 0.5, region: {region}))")),
        ("ids", format!("(name: \"clump\", show: alone, members: Ids(\"{ids}\"))")),
        ("region", format!("(name: \"clump\", show: alone, members: Region({region}))")),
        ("hidden", "(name: \"none\", show: hidden, members: Region(()))".to_owned()),
    ];
    for time in ["0.5", "step(3)", "0.71"] {
        let mut pictures = Vec::new();
        for (name, set) in &sets {
            let scene = format!(
                "(version: 2, datasets: [(path: \"run.df\")], time: {time}, selections: [{set}], size: (96, 72))"
            );
            std::fs::write(folder.join("a.scene.ron"), scene).unwrap();
            ok(folder, &["render", "a.scene.ron", "-o", &format!("{name}.png"), "--backend", "cpu"]);
            pictures.push(std::fs::read(folder.join(format!("{name}.png"))).unwrap());
        }
        assert!(pictures[0] == pictures[1], "{time}: by ids and by place");
        assert_eq!(pictures[0] == pictures[2], time == "0.5", "{time}: who was there and who is there");
        assert!(pictures[0] != pictures[3], "{time}");
    }
    let tracked = format!("(name: \"clump\", members: Tracked(at: 0.5, region: {region}), follow: true)");
    let tour = format!(
        "(version: 2, dataset: (path: \"run.df\"), size: (64, 48), rate: 4, keyframes: [
            (time: step(0), selections: [{tracked}], around: (what: selection(\"clump\"), distance: 4.0)),
            (after: 2.0, time: last, around: (what: selection(\"clump\"), distance: 4.0)),
        ])"
    );
    std::fs::write(folder.join("show.tour.ron"), tour).unwrap();
    ok(folder, &["tour", "show.tour.ron", "--record", "frames"]);
    // The camera goes where the centre goes.
    let scene = |frame: usize| {
        let name = format!("frames/scenes/frame-{frame:05}.scene.ron");
        (SceneFile::read(&folder.join(&name)).unwrap(), name)
    };
    let centre = |time: f64| -> DVec3 {
        let time = time.to_string();
        let who = ["--tracked-at", "0.5", "--sphere", "0.6,0.1,0,0.25"];
        let found = json(
            folder,
            &[&["probe", "run.df", "--fields", "none", "--time", &time, "--json", "-"], &who[..]].concat(),
        );
        DVec3::from([0, 1, 2].map(|axis| found["center_of_mass"][axis].as_f64().unwrap()))
    };
    let mut offsets = Vec::new();
    for frame in [0, 3, 5, 7] {
        let (scene, name) = scene(frame);
        let Some(When::Time(time)) = scene.look.time else { panic!("{frame}: no time") };
        let (camera, centre) = (scene.camera.unwrap(), centre(time));
        offsets.push((DVec3::from(camera.target) - centre, DVec3::from(camera.eye) - centre));
        ok(folder, &["render", &name, "-o", "again.png", "--backend", "cpu"]);
        let frame = std::fs::read(folder.join(format!("frames/frame-{frame:05}.png"))).unwrap();
        assert!(frame == std::fs::read(folder.join("again.png")).unwrap(), "{name}");
    }
    // The selection stays in the middle, seen from as far.
    let (_, eye) = offsets[0];
    for (target, own) in &offsets {
        assert!(target.length() < 1e-9 && own.distance(eye) < 1e-9, "{offsets:?}");
    }
    // As one that was interrupted.
    std::fs::remove_file(folder.join("frames/frame-00003.png")).unwrap();
    let before = std::fs::read(folder.join("frames/frame-00005.png")).unwrap();
    ok(folder, &["tour", "show.tour.ron", "--record", "frames"]);
    assert!(before == std::fs::read(folder.join("frames/frame-00005.png")).unwrap());
    assert!(folder.join("frames/frame-00003.png").exists());
}

#[test]
fn a_moment_that_is_shown_has_the_members_at_that_moment() {
    let (_, run) = &runs()[0];
    let following = Following::new(Arc::clone(run)).unwrap();
    let members = Members::Tracked { at: When::Step(1), region: Region::sphere(DVec3::ZERO, 0.7) };
    let followed = following.of(&members, Work::quiet()).unwrap().unwrap();
    for moment in [Moment { step: 0, u: 0.25 }, Moment { step: 4, u: 0.75 }, Moment { step: 5, u: 0.0 }] {
        let whole = run.at(moment, Interpolation::Auto).unwrap();
        let ids = deepfield::explore::Members::Ids(followed.ids().clone());
        let exact = deepfield::explore::center(deepfield::explore::Data::Source(&whole), &ids, None, Work::quiet());
        let (exact, found) = (exact.unwrap().unwrap(), followed.center(moment, Interpolation::Auto).unwrap().unwrap());
        assert!(exact.count == found.count && exact.position.distance(found.position) < 1e-9, "{exact:?} {found:?}");
    }
}
