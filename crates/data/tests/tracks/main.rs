//! Tracks of runs whose truth is closed: who is matched, where everybody is between steps, and that both sides of a step agree.

#![allow(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

#[path = "../support/run_checksums.rs"]
mod run_checksums;
mod tree;

use deepfield_data::build::{BuildOptions, Matching, RunBuild, TrackOptions, compare_with_sources};
use deepfield_data::hierarchy::Purpose;
use deepfield_data::hierarchy::spacetime::{Interpolation, TrackFlags, Tracks};
use deepfield_data::import::{FieldKind, LoadOptions, RunOptions, Smoothing, Source, load_source, open, open_run};
use deepfield_data::model::{ClockVariable, DerivedQuantity, FamilyName, Moment, ReadMethod, When};
use deepfield_data::store::run::{Matches, RunSnapshot, RunTree, Tangents, verify_run};
use deepfield_data::store::{RunFile, Tree};
use deepfield_data::synth::moving::{self, Births, Halo, Moving, Orbits, Pancake};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A generated run, its snapshots and times.
struct Generated {
    folder: tempfile::TempDir,
    files: Vec<PathBuf>,
    times: Vec<f64>,
}

fn generated(kind: &dyn Moving, steps: usize, irregular: f64) -> Generated {
    generated_at(kind, moving::times(kind, steps, irregular, 3))
}

fn generated_at(kind: &dyn Moving, times: Vec<f64>) -> Generated {
    let folder = tempfile::tempdir().unwrap();
    let files = moving::write(kind, &times, 3, &folder.path().join("run"), &()).unwrap();
    Generated { folder, files, times }
}

impl Generated {
    fn built(&self, run: &RunOptions, tracks: TrackOptions, options: &BuildOptions) -> Result<Arc<RunFile>, String> {
        self.loaded(&LoadOptions::default(), run, tracks, options)
    }

    fn loaded(
        &self,
        load: &LoadOptions,
        run: &RunOptions,
        tracks: TrackOptions,
        options: &BuildOptions,
    ) -> Result<Arc<RunFile>, String> {
        let out = self.folder.path().join("run.df");
        let run = open_run(&self.files, run, ReadMethod::default()).map_err(|error| error.to_string())?;
        let build = RunBuild { load, options, tracks: Some(&tracks), skip_damaged: false, still_of: None };
        build.build(run, &out, &()).map_err(|error| error.to_string())?;
        Ok(Arc::new(RunFile::open(&out, ReadMethod::default()).unwrap()))
    }

    fn usual(&self) -> Arc<RunFile> {
        self.built(&RunOptions::default(), TrackOptions::default(), &BuildOptions::default()).unwrap()
    }
}

/// Rows of a moment by family and id: position, mass and smoothing length.
type Rows = BTreeMap<(String, u64), Vec<([f64; 3], f64, f64)>>;

fn rows(snapshot: &RunSnapshot) -> Rows {
    let mut rows = Rows::new();
    for (family, info) in snapshot.description().families.iter().enumerate() {
        let column = |kind: FieldKind| {
            let field = info.find(kind).unwrap();
            let mut values = vec![0.0; info.count as usize * info.fields[field].components];
            snapshot.read(family, field, 0..info.count, &mut values).unwrap();
            values
        };
        let (positions, mass, h) =
            (column(FieldKind::Position), column(FieldKind::Mass), column(FieldKind::SmoothingLength));
        for (i, id) in snapshot.ids(family).unwrap().iter().enumerate() {
            let position = [positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]];
            rows.entry((info.name.to_string(), *id)).or_default().push((position, mass[i], h[i]));
        }
    }
    rows
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

fn found(run: &RunFile, interval: usize, family: FamilyName) -> Matches {
    let layout = run.tracks().unwrap();
    let number = layout.families.iter().position(|known| known.name == family).unwrap();
    run.directory().intervals[interval].families[number].matches
}

fn all_tracks(run: &RunFile, interval: usize) -> Tracks {
    let mut all = Tracks::default();
    for family in 0..run.tracks().unwrap().families.len() {
        for leaf in run.track_index(interval, family).unwrap().leaves() {
            let tracks = run.node_tracks(interval, family, leaf, true).unwrap();
            all.ids.extend(tracks.ids);
            all.flags.extend(tracks.flags);
            for (all, own) in all.ends.iter_mut().zip(tracks.ends) {
                all.places.extend(own.places);
                all.movements.extend(own.movements);
            }
        }
    }
    all
}

#[test]
fn orbits_are_followed_between_irregular_steps() {
    let orbits = Orbits::new(3, 2000);
    let generated = generated(&orbits, 9, 4.0);
    let run = generated.usual();
    assert!(verify_run(run.path(), &()).unwrap().tracks >= 8 * 2000);
    assert_eq!(compare_with_sources(&run, &()).unwrap(), 9 * 2000);
    let by_id: HashMap<u64, u64> = (0..2000).map(|particle| (orbits.id(particle), particle)).collect();
    let bound = orbits.smoothing_length() / 512.0;
    for (k, pair) in generated.times.windows(2).enumerate() {
        let matches = found(&run, k, FamilyName::Gas);
        assert_eq!((matches.matched, matches.born + matches.vanished + matches.changed), (2000, 0));
        assert!(matches.position_error[1] <= bound && matches.position_error[0] > 0.0);
        for u in [0.25, 0.6] {
            let time = pair[0] + u * (pair[1] - pair[0]);
            let moment = run.moment(When::Time(time)).unwrap();
            assert!(moment.step == k && (moment.u - u).abs() < 1e-9);
            let rows = rows(&run.at(moment, Interpolation::Auto).unwrap());
            assert_eq!(rows.len(), 2000);
            for ((_, id), row) in &rows {
                let particle = by_id[id];
                // The first half has angular velocities of at most 1 and is within 1.5 of the middle.
                if particle < 1000 {
                    let spline = 1.05 * 1.5 * (pair[1] - pair[0]).powi(4) / 384.0;
                    let truth = orbits.at(particle, k, time).unwrap().position;
                    let off = distance(row[0].0, truth);
                    assert!(row.len() == 1 && off <= spline + 2.0 * bound, "{particle} at {time}: {off}");
                }
            }
        }
    }
}

#[test]
fn both_sides_of_a_step_have_the_same_bits() {
    let kinds: [Box<dyn Moving>; 3] =
        [Box::new(Orbits::new(1, 800)), Box::new(Pancake::new(1, 800)), Box::new(Halo::new(1, 800))];
    for kind in kinds {
        let generated = generated(&*kind, 6, 3.0);
        let run = generated.usual();
        let edge = run.tracks().unwrap().box_size.map(|edge| (edge / run.interval(0).unwrap().lattice.unit()) as i64);
        for interval in 1..5 {
            let (before, after) = (all_tracks(&run, interval - 1), all_tracks(&run, interval));
            let begins: HashMap<u64, usize> = after.ids.iter().enumerate().map(|(i, id)| (*id, i)).collect();
            assert_eq!(begins.len(), 800);
            for (i, id) in before.ids.iter().enumerate() {
                let next = begins[id];
                let wrapped = before.ends[1].places[i].map(|x| edge.map_or(x, |edge| x.rem_euclid(edge)));
                let begin = after.ends[0].places[next].map(|x| edge.map_or(x, |edge| x.rem_euclid(edge)));
                assert_eq!(wrapped, begin, "{id}");
                assert_eq!(before.ends[1].movements[i], after.ends[0].movements[next], "{id}");
            }
        }
    }
}

#[test]
fn what_crosses_a_face_takes_the_short_way_by_any_clock() {
    let pancake = Pancake::new(1, 1000);
    let generated = generated(&pancake, 6, 2.0);
    let edge = pancake.edge().unwrap();
    let near = |a: [f64; 3], b: [f64; 3]| {
        let off: [f64; 3] = std::array::from_fn(|axis| {
            let off = a[axis] - b[axis];
            off - edge * (off / edge).round()
        });
        distance(off, [0.0; 3])
    };
    for clock in [None, Some(ClockVariable::Time), Some(ClockVariable::LogScaleFactor)] {
        let options = RunOptions { clock, ..RunOptions::default() };
        let run = generated.built(&options, TrackOptions::default(), &BuildOptions::default()).unwrap();
        assert_eq!(run.directory().clock, clock.unwrap_or(ClockVariable::ScaleFactor));
        let mut crossings = 0;
        for (k, pair) in generated.times.windows(2).enumerate() {
            let matches = found(&run, k, FamilyName::Gas);
            crossings += matches.crossing;
            assert!((matches.velocity_factor.unwrap() - 1.0).abs() < 0.05, "{matches:?}");
            let a = 0.5 * (pair[0] + pair[1]);
            let moment = run.moment(When::ScaleFactor(a)).unwrap();
            assert!((run.time(moment) - a).abs() < 1e-9 && ((moment.u - 0.5).abs() < 1e-9) == clock.is_none());
            for ((_, id), row) in rows(&run.at(moment, Interpolation::Auto).unwrap()) {
                let particle = (0..1000).find(|particle| pancake.id(*particle) == id).unwrap();
                let truth = pancake.at(particle, k, a).unwrap().position;
                assert!(row[0].0.iter().all(|x| (0.0..=edge).contains(x)));
                // Straight in the scale factor; other clocks bend the way by less than the spline's error.
                let most = if clock.is_none() { pancake.smoothing_length() / 256.0 } else { 0.01 * edge };
                assert!(near(row[0].0, truth) <= most, "{id}: {:?} {truth:?}", row[0].0);
            }
        }
        assert!(crossings > 20, "{crossings}");
    }
}

#[test]
fn who_comes_goes_and_changes_is_counted_and_weighed() {
    let births = Births::new(3, 600, 5);
    let generated = generated(&births, 5, 1.0);
    let run = generated.usual();
    assert_eq!(
        compare_with_sources(&run, &()).unwrap(),
        run.directory().steps.iter().map(|step| step.particles).sum::<u64>()
    );
    let there = |particle: u64, step: usize| births.at(particle, step, generated.times[step]).map(|state| state.family);
    for k in 0..4 {
        for family in [FamilyName::Gas, FamilyName::Stars] {
            let count = |rule: &dyn Fn(Option<FamilyName>, Option<FamilyName>) -> bool| {
                (0..600).filter(|particle| rule(there(*particle, k), there(*particle, k + 1))).count() as u64
            };
            let (own, matches) = (Some(family), found(&run, k, family));
            assert_eq!(matches.matched, count(&|a, b| a == own && b == own), "{k} {family}");
            assert_eq!(matches.born, count(&|a, b| a.is_none() && b == own));
            assert_eq!(matches.vanished, count(&|a, b| a == own && b.is_none()));
            assert_eq!(matches.changed, count(&|a, b| a == own && b.is_some() && b != own));
        }
        let u = 0.3;
        let time = generated.times[k] + u * (generated.times[k + 1] - generated.times[k]);
        let rows = rows(&run.at(Moment { step: k, u }, Interpolation::Auto).unwrap());
        let mut expected: BTreeMap<(String, u64), f64> = BTreeMap::new();
        for particle in 0..600 {
            for (family, weight) in [(there(particle, k), 1.0 - u), (there(particle, k + 1), u)] {
                if let Some(family) = family {
                    *expected.entry((family.to_string(), births.id(particle))).or_default() += weight * births.mass();
                }
            }
        }
        assert!(rows.keys().eq(expected.keys()));
        for (who, mass) in expected {
            let found: f64 = rows[&who].iter().map(|row| row.1).sum();
            assert!((found / mass - 1.0).abs() < 1e-3, "{who:?}: {found} {mass}");
        }
        // Straight lines, whatever becomes of the particle.
        let truths: Vec<(u64, [f64; 3])> = (0..600)
            .flat_map(|particle| [k, k + 1].map(|step| (births.id(particle), births.at(particle, step, time))))
            .filter_map(|(id, state)| Some((id, state?.position)))
            .collect();
        for ((_, id), places) in &rows {
            for (place, _, h) in places {
                let off = truths.iter().filter(|(own, _)| own == id).map(|(_, truth)| distance(*place, *truth));
                let off = off.fold(f64::INFINITY, f64::min);
                assert!(off < h / 128.0 + 1e-5, "{id} {off} {h}");
            }
        }
    }
}

#[test]
fn steps_too_far_apart_fade_and_say_so() {
    let mut shares = Vec::new();
    for steps_apart in [1.0, 40.0] {
        let halo = Halo::new(2, 1500);
        let times: Vec<f64> = (0..4).map(|step| step_time(&halo, step, steps_apart)).collect();
        let folder = tempfile::tempdir().unwrap();
        let files = moving::write(&halo, &times, 2, &folder.path().join("run"), &()).unwrap();
        let run = Generated { folder, files, times }.usual();
        let matches = found(&run, 1, FamilyName::Dark);
        shares.push(matches.unresolved);
        let tracks = all_tracks(&run, 1);
        let fading = tracks.flags.iter().filter(|flags| flags.has(TrackFlags::FADES)).count();
        let snapshot = run.at(Moment { step: 1, u: 0.5 }, Interpolation::Auto).unwrap();
        assert_eq!(snapshot.description().particles(), 1500 + fading as u64);
        assert_eq!(fading > 0, matches.unresolved > 0.5, "{fading} {matches:?}");
        let hermite = run.at(Moment { step: 1, u: 0.5 }, Interpolation::Hermite).unwrap();
        assert_eq!((hermite.description().particles(), hermite.faded_mass()), (1500, 0.0));
    }
    assert!(shares[0] < 0.05 && shares[1] > 0.5, "{shares:?}");
}

/// Times of which the halo's truth can be asked: multiples of its own intervals.
fn step_time(halo: &Halo, step: usize, apart: f64) -> f64 {
    let (first, longest) = halo.times(4);
    first + step as f64 * longest * apart / 4.0
}

#[test]
fn threads_memory_and_order_change_nothing_and_rows_need_not_be_trusted() {
    let orbits = Orbits::new(5, 3000);
    let mut generated = generated(&orbits, 4, 1.0);
    let bytes = |generated: &Generated, options: &BuildOptions| {
        let run = generated.built(&RunOptions::default(), TrackOptions::default(), options).unwrap();
        std::fs::read(run.path()).unwrap()
    };
    let usual = bytes(&generated, &BuildOptions::default());
    let frugal = BuildOptions { threads: Some(1), memory: Some(8 << 20), ..BuildOptions::default() };
    assert!(bytes(&generated, &frugal) == usual);
    generated.files.reverse();
    assert!(bytes(&generated, &BuildOptions { threads: Some(5), ..BuildOptions::default() }) == usual);
    // Rows are shuffled in every step, which velocities give away.
    let by_order = TrackOptions { matching: Matching::Order, ..TrackOptions::default() };
    let refused = generated.built(&RunOptions::default(), by_order, &BuildOptions::default()).unwrap_err();
    assert!(refused.contains("--match order"), "{refused}");
    // Nobody is anybody: everything fades from step to step, and no mass is lost.
    let nobody = TrackOptions { matching: Matching::None, ..TrackOptions::default() };
    let run = generated.built(&RunOptions::default(), nobody, &BuildOptions::default()).unwrap();
    assert_eq!((found(&run, 1, FamilyName::Gas).matched, found(&run, 1, FamilyName::Gas).born), (0, 3000));
    let mass: f64 = rows(&run.at(Moment { step: 1, u: 0.3 }, Interpolation::Auto).unwrap())
        .values()
        .flatten()
        .map(|row| row.1)
        .sum();
    assert!((mass / (3000.0 * orbits.mass()) - 1.0).abs() < 1e-4);
}

#[test]
fn without_velocities_tracks_follow_positions() {
    let orbits = Orbits::new(7, 600);
    let generated = generated(&orbits, 8, 1.0);
    let off = |tangents: Option<Tangents>| {
        let tracks = TrackOptions { tangents, ..TrackOptions::default() };
        let run = generated.built(&RunOptions::default(), tracks, &BuildOptions::default()).unwrap();
        let (k, u) = (3, 0.5);
        let time = 0.5 * (generated.times[k] + generated.times[k + 1]);
        let rows = rows(&run.at(Moment { step: k, u }, Interpolation::Auto).unwrap());
        let squares: f64 = (0..300)
            .map(|particle| {
                let truth = orbits.at(particle, k, time).unwrap().position;
                distance(rows[&("gas".to_owned(), orbits.id(particle))][0].0, truth).powi(2)
            })
            .sum();
        (squares / 300.0).sqrt()
    };
    let [velocity, differences, none] = [None, Some(Tangents::Differences), Some(Tangents::None)].map(off);
    assert!(velocity < 0.2 * differences && differences < 0.2 * none, "{velocity} {differences} {none}");
}

#[test]
fn damaged_tracks_are_found_and_never_panic() {
    let generated = generated(&Births::new(1, 300, 3), 3, 1.0);
    let run = generated.usual();
    let (path, bytes) = (run.path().to_path_buf(), std::fs::read(run.path()).unwrap());
    let first = run.directory().intervals[0].families[0].nodes.offset as usize;
    let damaged = |at: usize, path: &Path| {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x55;
        std::fs::write(path, bytes).unwrap();
        assert!(verify_run(path, &()).is_err(), "{at}");
        if let Ok(run) = RunFile::open(path, ReadMethod::default()).map(Arc::new) {
            for step in 0..3 {
                if let Ok(snapshot) = run.at(Moment { step, u: 0.5 }, Interpolation::Auto) {
                    drop(load_source(&snapshot, &LoadOptions::default(), &()));
                }
            }
        }
    };
    for at in (first..bytes.len()).step_by(149) {
        damaged(at, &path);
    }
}

#[test]
fn directories_that_lie_are_refused_or_lead_to_errors() {
    let generated = generated(&Births::new(1, 300, 3), 3, 1.0);
    let run = generated.usual();
    let (path, bytes) = (run.path().to_path_buf(), std::fs::read(run.path()).unwrap());
    let directory = usize::try_from(u64::from_le_bytes(bytes[24..32].try_into().unwrap())).unwrap();
    let (mut opened, mut random) = (0, 1_u64);
    for _ in 0..1500 {
        // All that is read of one that opens takes long.
        if opened == 150 {
            break;
        }
        let mut bytes = bytes.clone();
        for _ in 0..3 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = directory + (random >> 33) as usize % (bytes.len() - directory);
            bytes[at] = [0, 1, 0x7f, 0xff, (random >> 24) as u8][(random >> 60) as usize % 5];
        }
        run_checksums::correct(&mut bytes);
        std::fs::write(&path, bytes).unwrap();
        let Ok(run) = RunFile::open(&path, ReadMethod::default()).map(Arc::new) else { continue };
        opened += 1;
        drop(verify_run(&path, &()));
        if let Ok(tree) = RunTree::new(Arc::clone(&run), Interpolation::Auto) {
            let families: Vec<u32> = (0..tree.metadata().families.len() as u32).collect();
            for time in [f64::NEG_INFINITY, 0.3, 1.0, f64::NAN] {
                let roots = tree.roots(&families, Purpose::Splats, time);
                for page in roots.iter().filter_map(|root| tree.read_page(root.page).ok()) {
                    let held = page.content(0).unwrap().particles(time);
                    assert_eq!(held.len(), page.nodes[0].particles as usize);
                }
            }
        }
        if let Ok(snapshot) = run.at(Moment { step: 1, u: 0.5 }, Interpolation::Auto) {
            drop(load_source(&snapshot, &LoadOptions::default(), &()));
        }
    }
    assert!(opened > 100, "{opened} of 1500 were opened");
}

/// Tracks have at each step what is derived of its snapshot alone, in a periodic box, whether smoothing lengths are the source's or
/// estimated.
#[test]
fn tracks_have_what_is_derived_at_each_step() {
    let generated = generated(&Pancake::new(4, 1200), 3, 2.0);
    let derive = vec![DerivedQuantity::Vorticity, DerivedQuantity::VelocityDispersion];
    for smoothing in [Smoothing::Auto, Smoothing::Knn(24)] {
        let load = LoadOptions { smoothing, derive: derive.clone(), ..LoadOptions::default() };
        let run = generated.loaded(&load, &RunOptions::default(), TrackOptions::default(), &BuildOptions::default());
        let run = run.unwrap();
        verify_run(run.path(), &()).unwrap();
        for (step, file) in generated.files.iter().enumerate() {
            let source = open(file).unwrap();
            let info = &source.description().families[0];
            let mut ids = vec![0; info.count as usize];
            source.read_ids(0, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut ids).unwrap();
            let row_of: HashMap<u64, usize> = ids.iter().enumerate().map(|(row, id)| (*id, row)).collect();
            let alone = load_source(source.as_ref(), &load, &()).unwrap();
            let snapshot = run.at(Moment { step, u: 0.0 }, Interpolation::Hermite).unwrap();
            let (info, ids) = (&snapshot.description().families[0], snapshot.ids(0).unwrap());
            assert_eq!(ids.len(), 1200);
            for name in ["vorticity", "velocity-dispersion", "internal-energy"] {
                let expected = &alone.families[0].attribute(name).unwrap().values;
                let mut found = vec![0.0; ids.len()];
                snapshot.read(0, info.named(name).unwrap(), 0..info.count, &mut found).unwrap();
                let largest = expected.iter().copied().fold(0.0, f32::max);
                let mut compared = 0;
                for (id, found) in ids.iter().zip(&found) {
                    let expected = f64::from(expected[row_of[id]]);
                    // For what nobody knows stands a mean.
                    if expected.is_nan() {
                        continue;
                    }
                    let bound = expected / 255.0 + 1e-6 * f64::from(largest);
                    assert!((found - expected).abs() <= bound, "{name} of {id} at {step}: {found} {expected}");
                    compared += 1;
                }
                assert!(compared > 1000, "{name} at {step}: {compared}");
            }
        }
    }
}
