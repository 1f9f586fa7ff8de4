//! Flow levels of generated runs: every particle stays within the error of its cluster at any time, sums add up, tracks go on from step
//! to step, and nothing depends on threads or memory.

#![allow(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

#[path = "support/run_checksums.rs"]
mod run_checksums;

use deepfield_data::build::{BuildOptions, FlowOptions, RunBuild, TrackOptions};
use deepfield_data::hierarchy::spacetime::{HermiteSpline, Interval, LongTrack, Stretch, Tracks, recorded_error};
use deepfield_data::import::{LoadOptions, RunOptions, open_run};
use deepfield_data::model::ReadMethod;
use deepfield_data::store::RunFile;
use deepfield_data::store::run::{FlowTracks, verify_run};
use deepfield_data::synth::moving::{self, Births, Moving, Orbits, Pancake};
use glam::DVec3;
use std::collections::{HashMap, HashSet};
use std::path::Path;

const STEPS: usize = 6;

fn built(kind: &dyn Moving, flow: FlowOptions, options: &BuildOptions, out: &Path) -> RunFile {
    built_of(kind, STEPS, flow, options, out)
}

fn built_of(kind: &dyn Moving, steps: usize, flow: FlowOptions, options: &BuildOptions, out: &Path) -> RunFile {
    let times = moving::times(kind, steps, 3.0, 5);
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

/// The tracks over single intervals that a long track stands for, in their order.
fn chain(run: &RunFile, stretch: Stretch, family: usize, level: usize, number: u32, out: &mut Vec<u32>) {
    match stretch.halves() {
        None => out.push(number),
        Some(halves) => {
            let own = run.long_tracks(stretch, family, level).unwrap()[number as usize];
            halves.into_iter().zip(own.halves).for_each(|(half, number)| chain(run, half, family, level, number, out));
        }
    }
}

/// The spline of a long track, whose chain is known.
fn long_spline(space: &Interval, long: &LongTrack, chain: &[u32], flows: &[&FlowTracks]) -> HermiteSpline {
    let (first, last) = (&flows[0].tracks.ends[0], &flows[flows.len() - 1].tracks.ends[1]);
    let (begin, end) = (chain[0] as usize, *chain.last().unwrap() as usize);
    let edge = space.box_size.map_or(0, |edge| (edge / space.lattice.unit()).round() as i64);
    let image = std::array::from_fn(|axis| last.places[end][axis] + edge * long.image[axis]);
    space.spline_of([first.places[begin], image], [first.movements[begin], last.movements[end]])
}

/// Steps of runs with long tracks: more than a power of two.
const MANY: usize = 20;

/// Every long track is as near to the chain of tracks that it stands for as it says, at any time, and stands for the same particles all
/// the way. Up to whatever scale long tracks are taken in the place of shorter ones, every track of an interval is drawn once.
#[test]
fn long_tracks_are_near_their_chains_and_take_their_place_once() {
    let flow = FlowOptions { levels: Some(3), error: None };
    let kinds: [(&str, Box<dyn Moving>); 3] = [
        ("orbits", Box::new(Orbits::new(3, 1200))),
        ("pancake", Box::new(Pancake::new(3, 1200))),
        ("births", Box::new(Births::new(3, 1200, MANY))),
    ];
    for (name, kind) in kinds {
        let folder = tempfile::tempdir().unwrap();
        let run = built_of(&*kind, MANY, flow, &BuildOptions::default(), &folder.path().join("run.df"));
        verify_run(run.path(), &()).unwrap();
        let (mut of_scales, mut flow_bytes, mut long_bytes) = ([0; 5], 0, 0);
        for own in run.directory().intervals.iter().flat_map(|interval| &interval.families) {
            flow_bytes += own.flow.levels.iter().map(|(_, part)| u64::from(part.len)).sum::<u64>();
            long_bytes += own.flow.long.iter().flatten().map(|(_, part)| u64::from(part.len)).sum::<u64>();
        }
        for (family, level) in (0..run.tracks().unwrap().families.len()).flat_map(|f| (1..=3).map(move |l| (f, l))) {
            let error = run.flow_errors()[level - 1];
            let flows: Vec<FlowTracks> =
                (0..MANY - 1).map(|interval| run.flow_tracks(interval, family, level).unwrap()).collect();
            let of_stretch = |stretch: Stretch| (stretch, run.long_tracks(stretch, family, level).unwrap());
            let all: Vec<(Stretch, Vec<LongTrack>)> =
                (0..MANY - 1).flat_map(Stretch::ending_with).map(of_stretch).collect();
            let parts_of = |(stretch, long): &(Stretch, Vec<LongTrack>)| -> Vec<(Stretch, u32)> {
                let halves = stretch.halves().unwrap();
                long.iter().flat_map(|own| [0, 1].map(|half| (halves[half], own.halves[half]))).collect()
            };
            let parts: HashSet<(Stretch, u32)> = all.iter().flat_map(parts_of).collect();
            // By the largest scale that is allowed: how often each track of each interval is drawn.
            let is_drawn = |stretch: Stretch, number: u32, most: usize| {
                let scale = stretch.scale.ilog2() as usize;
                scale <= most && (scale == most || !parts.contains(&(stretch, number)))
            };
            let single = |(interval, flow): (usize, &FlowTracks)| -> Vec<[u32; 5]> {
                let drawn = |i| std::array::from_fn(|most| u32::from(is_drawn(Stretch::interval(interval), i, most)));
                (0..flow.len() as u32).map(drawn).collect()
            };
            let mut drawn: Vec<Vec<[u32; 5]>> = flows.iter().enumerate().map(single).collect();
            for (stretch, long) in &all {
                let (space, first) = (run.stretch(*stretch).unwrap(), stretch.intervals().start);
                of_scales[stretch.scale.ilog2() as usize] += long.len();
                let here: Vec<&FlowTracks> = flows[stretch.intervals()].iter().collect();
                let clock = &run.tracks().unwrap().clock[first..];
                for (own, number) in long.iter().zip(0..) {
                    let mut parts = Vec::new();
                    chain(&run, *stretch, family, level, number, &mut parts);
                    let spline = long_spline(&space, own, &parts, &here);
                    let limit = recorded_error(error, own.error);
                    assert!(limit <= error);
                    for (i, (part, flow)) in parts.iter().zip(&here).enumerate() {
                        let (interval, part) = (run.interval(first + i).unwrap(), *part as usize);
                        let short = interval.spline(&flow.tracks, part);
                        assert_eq!(flow.counts[part], here[0].counts[parts[0] as usize]);
                        for k in 0..=16 {
                            let u = f64::from(k) / 16.0;
                            let tau = clock[i] + u * (clock[i + 1] - clock[i]);
                            let at = spline.position((tau - clock[0]) / (clock[stretch.scale] - clock[0]));
                            let off = nearest(at - short.position(u), space.box_size).length();
                            assert!(off <= limit * (1.0 + 1e-9) + 1e-12, "{name}, level {level}: {off} of {limit}");
                            // It begins and ends where they do, but for images and sums of floats.
                            if (i, k) == (0, 0) || (i + 1, k) == (stretch.scale, 16) {
                                assert!(off <= 1e-12 * interval.lattice.root.size, "{off}");
                            }
                        }
                        for (most, times) in drawn[first + i][part].iter_mut().enumerate() {
                            *times += u32::from(is_drawn(*stretch, number, most));
                        }
                    }
                }
            }
            assert!(drawn.iter().flatten().all(|times| *times == [1; 5]), "{name}, level {level}");
        }
        println!("{name}: {of_scales:?} long tracks, {long_bytes} of {flow_bytes} bytes");
        assert!(of_scales[1] > 0 && of_scales[1..].is_sorted_by(|a, b| a >= b), "{name}: {of_scales:?}");
        assert!(10 * long_bytes <= flow_bytes, "{name}: {long_bytes} of {flow_bytes}");
    }
}

/// Long tracks whose bytes are changed with their checksums are refused, or are long tracks all the same.
#[test]
fn forged_long_tracks_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let flow = FlowOptions { levels: Some(2), error: None };
    let path = folder.path().join("run.df");
    let run = built_of(&Pancake::new(3, 400), 9, flow, &BuildOptions::default(), &path);
    let own = &run.directory().intervals[3].families[0].flow;
    let before: u64 = own.levels.iter().map(|(_, part)| u64::from(part.len)).sum();
    let (count, part) = own.long[0][0];
    assert!(count > 4 && part.len > 8, "{count}");
    let bytes = std::fs::read(&path).unwrap();
    let at = (own.section.offset + before) as usize;
    let crc = |bytes: &[u8]| crc32c::crc32c(&bytes[at..at + part.len as usize]).to_le_bytes();
    let place = bytes.windows(4).rposition(|word| word == part.crc.to_le_bytes()).unwrap();
    assert_eq!(crc(&bytes), part.crc.to_le_bytes());
    let mut refused = Vec::new();
    for byte in at..at + part.len as usize {
        let mut forged = bytes.clone();
        // A low or a high bit.
        forged[byte] ^= [1, 16][byte / 3 % 2];
        let crc = crc(&forged);
        forged[place..place + 4].copy_from_slice(&crc);
        run_checksums::correct(&mut forged);
        std::fs::write(&path, &forged).unwrap();
        refused.extend(verify_run(&path, &()).err().map(|error| error.to_string()));
    }
    for expected in ["long tracks of one matter, within their errors", "tracks of the"] {
        assert!(refused.iter().any(|told| told.contains(expected)), "{expected}: {refused:?}");
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
