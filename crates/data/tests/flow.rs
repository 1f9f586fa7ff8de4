//! Flow levels of generated runs: every particle stays within the error of its cluster at any time, sums add up, tracks go on from step
//! to step, and nothing depends on threads or memory.

#![allow(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use deepfield_data::build::{BuildOptions, FlowOptions, RunBuild, TrackOptions};
use deepfield_data::hierarchy::spacetime::{HermiteSpline, Tracks};
use deepfield_data::import::{LoadOptions, RunOptions, open_run};
use deepfield_data::model::ReadMethod;
use deepfield_data::store::RunFile;
use deepfield_data::store::run::{FlowTracks, verify_run};
use deepfield_data::synth::moving::{self, Births, Moving, Orbits, Pancake};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;

const STEPS: usize = 6;

fn built(kind: &dyn Moving, flow: FlowOptions, options: &BuildOptions, out: &Path) -> RunFile {
    let times = moving::times(kind, STEPS, 3.0, 5);
    // Beside the run, since the run names its sources.
    let files = moving::write(kind, &times, 5, &out.with_file_name("snap"), &()).unwrap();
    let run = open_run(&files, &RunOptions::default(), ReadMethod::default()).unwrap();
    let tracks = TrackOptions { flow, ..TrackOptions::default() };
    let load = LoadOptions::default();
    let build = RunBuild { load: &load, options, tracks: Some(&tracks), skip_damaged: false, still_of: None };
    build.build(run, out, &()).unwrap();
    RunFile::open(out, ReadMethod::default()).unwrap()
}

/// `by` without whole edges of the box.
fn nearest(by: DVec3, edge: Option<f64>) -> DVec3 {
    edge.map_or(by, |edge| by - edge * (by / edge).round())
}

/// The tracks of particles and, of each, its track of level 1.
fn particles(run: &RunFile, interval: usize, family: usize) -> Vec<(Tracks, Vec<u32>)> {
    let index = run.track_index(interval, family).unwrap();
    let leaf = |leaf| {
        let tracks = run.node_tracks(interval, family, leaf, true).unwrap();
        (tracks, run.leaf_flow(interval, family, leaf).unwrap())
    };
    index.leaves().map(leaf).collect()
}

/// Checks the flow of a family over an interval; returns the tracks of each level.
fn check(run: &RunFile, interval: usize, family: usize) -> Vec<FlowTracks> {
    let space = run.interval(interval).unwrap();
    let errors = run.flow_errors();
    let levels: Vec<FlowTracks> =
        (1..=errors.len()).map(|level| run.flow_tracks(interval, family, level).unwrap()).collect();
    let leaves = particles(run, interval, family);
    // Where each track of level 1 is on the coarser ones.
    let mut place: Vec<u32> = (0..levels[0].len() as u32).collect();
    for (level, flow) in levels.iter().enumerate() {
        if level > 0 {
            let mut parent = vec![u32::MAX; levels[level - 1].len()];
            (0..flow.len()).for_each(|i| flow.children_of(i).for_each(|child| parent[child as usize] = i as u32));
            assert!(!parent.contains(&u32::MAX));
            place.iter_mut().for_each(|own| *own = parent[*own as usize]);
        }
        let (mut masses, mut counts) = (vec![[0.0; 2]; flow.len()], vec![0; flow.len()]);
        for (tracks, members) in &leaves {
            for (i, member) in members.iter().enumerate() {
                let track = place[*member as usize] as usize;
                let (own, cluster) = (space.spline(tracks, i), space.spline(&flow.tracks, track));
                // Images of both in the box.
                let shift = own.positions[0] - cluster.positions[0];
                let shift = nearest(shift, space.box_size) - shift;
                let off = HermiteSpline { positions: own.positions.map(|at| at + shift), ..own }.minus(&cluster);
                for k in 0..=16 {
                    let distance = off.position(f64::from(k) / 16.0).length();
                    assert!(
                        distance <= errors[level],
                        "interval {interval}, level {level}: {distance} of {}",
                        errors[level]
                    );
                }
                for ((sum, end), weight) in masses[track].iter_mut().zip(&tracks.ends).zip(tracks.flags[i].weights()) {
                    *sum += weight * f64::from(end.mass[i]);
                }
                counts[track] += 1;
            }
        }
        assert_eq!(counts, flow.counts);
        for (i, sums) in masses.iter().enumerate() {
            for ((sum, end), weight) in sums.iter().zip(&flow.tracks.ends).zip(flow.tracks.flags[i].weights()) {
                assert!((sum - weight * f64::from(end.mass[i])).abs() <= 1e-6 * sum.max(1e-30), "{sum}");
            }
        }
    }
    levels
}

#[test]
fn particles_stay_with_their_clusters_and_tracks_go_on_to_the_bit() {
    let flow = FlowOptions { levels: Some(3), error: None };
    let kinds: [(&str, Box<dyn Moving>); 3] = [
        ("orbits", Box::new(Orbits::new(5, 1500))),
        ("pancake", Box::new(Pancake::new(5, 1500))),
        ("births", Box::new(Births::new(5, 1500, STEPS))),
    ];
    for (name, kind) in kinds {
        let folder = tempfile::tempdir().unwrap();
        let run = built(&*kind, flow, &BuildOptions::default(), &folder.path().join("run.df"));
        verify_run(run.path(), &()).unwrap();
        let edge = run.interval(0).unwrap().box_size;
        let unit = run.interval(0).unwrap().lattice.unit();
        for family in 0..run.tracks().unwrap().families.len() {
            let mut ends: Option<Vec<HashMap<u32, ([i64; 3], [i64; 3])>>> = None;
            for interval in 0..STEPS - 1 {
                let levels = check(&run, interval, family);
                let sides = |end: usize| -> Vec<HashMap<u32, ([i64; 3], [i64; 3])>> {
                    let of = |flow: &FlowTracks| {
                        let own = &flow.tracks.ends[end];
                        let state = |(i, cluster): (usize, &u32)| {
                            let wrapped = own.places[i].map(|x| match edge {
                                Some(edge) => x.rem_euclid((edge / unit).round() as i64),
                                None => x,
                            });
                            (*cluster, (wrapped, own.movements[i]))
                        };
                        flow.clusters[end].iter().enumerate().map(state).collect()
                    };
                    levels.iter().map(of).collect()
                };
                // A cluster has one number and one state on both sides of a step; what comes or goes has its own.
                for (level, begins) in sides(0).iter().enumerate() {
                    let Some(before) = &ends else { break };
                    let mut shared = 0;
                    for (cluster, state) in begins {
                        if let Some(other) = before[level].get(cluster) {
                            assert_eq!(state, other, "{name}, interval {interval}, level {level}");
                            shared += 1;
                        }
                    }
                    assert!(shared > 0 || begins.is_empty(), "{name}, interval {interval}");
                }
                ends = Some(sides(1));
            }
        }
        // Coarser levels have fewer tracks.
        for interval in &run.directory().intervals {
            for own in interval.families.iter().filter(|own| own.tracks > 0) {
                assert!(own.flow.levels.windows(2).all(|pair| pair[0].0 >= pair[1].0));
                assert!(u64::from(own.flow.levels[0].0) <= own.tracks);
            }
        }
    }
}

#[test]
fn flow_levels_do_not_depend_on_threads_or_memory_and_are_left_out_on_request() {
    let orbits = Orbits::new(5, 3000);
    let folder = tempfile::tempdir().unwrap();
    let bytes = |name: &str, options: &BuildOptions| {
        let out = folder.path().join(name);
        built(&orbits, FlowOptions::default(), options, &out);
        std::fs::read(out).unwrap()
    };
    let usual = bytes("usual.df", &BuildOptions::default());
    for threads in [1, 5] {
        assert!(usual == bytes("other.df", &BuildOptions { threads: Some(threads), ..BuildOptions::default() }));
    }
    assert!(usual == bytes("small.df", &BuildOptions { memory: Some(256 << 20), ..BuildOptions::default() }));
    let without = FlowOptions { levels: Some(0), error: None };
    let run = built(&orbits, without, &BuildOptions::default(), &folder.path().join("without.df"));
    verify_run(run.path(), &()).unwrap();
    assert!(run.flow_errors().is_empty() && run.flow_tracks(0, 0, 1).is_err());
}
