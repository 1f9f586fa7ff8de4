//! Runs of snapshots of particles whose places and velocities are known at any time: what paths and pictures between snapshots are
//! held against.
//!
//! Everything about a particle follows from the seed and its number; `docs/series.md` has the formulas.

mod births;
mod halo;
mod merger;
mod orbits;
mod pancake;
mod snapshot;

pub use births::Births;
pub use halo::Halo;
pub use merger::Merger;
pub use orbits::Orbits;
pub use pancake::Pancake;

use super::files::WriteError;
use super::random::{Random, cross};
use crate::model::{FamilyName, Progress};
use std::path::{Path, PathBuf};

/// A particle at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Its family.
    pub family: FamilyName,
    /// Its place; comoving in a universe that expands, and not wrapped into the box.
    pub position: [f64; 3],
    /// Its velocity as Gadget stores it.
    pub velocity: [f64; 3],
    /// Density there, which gas has.
    pub density: f64,
    /// Its smoothing length, which gas has.
    pub smoothing_length: f64,
}

/// Moving particles.
pub trait Moving: Sync {
    /// Number of particles that there are at some time.
    fn len(&self) -> u64;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The time of the first step, and the longest interval, of a run of so many steps.
    fn times(&self, steps: usize) -> (f64, f64);

    /// A particle at step `step`, which is at `time`; `None` while it is not there.
    fn at(&self, particle: u64, step: usize, time: f64) -> Option<State>;

    /// The particle's id.
    fn id(&self, particle: u64) -> u64 {
        wide_id(particle)
    }

    /// Edge of the periodic box in Mpc/h, in an Einstein and de Sitter universe whose scale factor is the time; `None` for what
    /// neither repeats nor expands.
    fn edge(&self) -> Option<f64> {
        None
    }

    /// Mass of each particle.
    fn mass(&self) -> f64;
}

/// A state of particles of one mass and one smoothing length.
fn even(family: FamilyName, position: [f64; 3], velocity: [f64; 3], mass: f64, smoothing_length: f64) -> State {
    let density = 8.0 * mass / (smoothing_length * smoothing_length * smoothing_length);
    State { family, position, velocity, density, smoothing_length }
}

/// From 1 on, and 2^60 more for every tenth.
fn wide_id(particle: u64) -> u64 {
    particle + 1 + if particle.is_multiple_of(10) { 1 << 60 } else { 0 }
}

/// The stream of numbers of which intervals are made.
const INTERVALS: u64 = 1 << 62;

/// The times of so many steps; `irregular`: how many times as long as the shortest interval the longest one may be, at least 1.
pub fn times(moving: &dyn Moving, steps: usize, irregular: f64, seed: u64) -> Vec<f64> {
    let (first, longest) = moving.times(steps);
    let mut random = Random::new(seed, INTERVALS);
    let shortest = irregular.max(1.0).recip();
    let mut times = Vec::with_capacity(steps);
    let mut time = first;
    for _ in 0..steps {
        times.push(time);
        time += longest * (shortest + (1.0 - shortest) * random.uniform());
    }
    times
}

/// Writes a snapshot for each time as `PATH_000`, `PATH_001`, ... (Gadget binary, format 2), and says which files they are. The rows of
/// each are in an order of their own. Nothing is left behind on failure.
///
/// # Errors
/// [`WriteError`] names the file and the cause.
pub fn write(
    moving: &dyn Moving,
    times: &[f64],
    seed: u64,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Vec<PathBuf>, WriteError> {
    progress.begin("writing snapshots", times.len() as u64);
    let digits = times.len().saturating_sub(1).to_string().len().max(3);
    let mut written: Vec<PathBuf> = Vec::with_capacity(times.len());
    for (step, time) in times.iter().enumerate() {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!("_{step:0digits$}"));
        let file = path.with_file_name(name);
        if let Err(source) = snapshot::write(moving, step, *time, seed, &file) {
            // Whoever sees them would take them for a whole run.
            written.iter().for_each(|file| drop(std::fs::remove_file(file)));
            return Err(WriteError { path: file, source });
        }
        written.push(file);
        progress.advance(1);
    }
    Ok(written)
}

/// The product of a vector and a number.
fn scaled(vector: [f64; 3], factor: f64) -> [f64; 3] {
    vector.map(|x| x * factor)
}

/// The sum of two vectors.
fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// A direction at a right angle to a unit vector.
fn across(direction: [f64; 3], random: &mut Random) -> [f64; 3] {
    loop {
        let cross = cross(direction, random.direction());
        let length = cross.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 0.1 {
            return scaled(cross, length.recip());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{FieldKind, open};
    use crate::model::Motion;
    use std::collections::{BTreeMap, BTreeSet};

    fn kinds(particles: u64) -> [Box<dyn Moving>; 5] {
        [
            Box::new(Orbits::new(3, particles)),
            Box::new(Pancake::new(3, particles)),
            Box::new(Halo::new(3, particles)),
            Box::new(Births::new(3, particles, 6)),
            Box::new(Merger::new(3, particles)),
        ]
    }

    #[test]
    fn velocities_are_those_of_the_places() {
        for moving in kinds(200) {
            let (first, interval) = moving.times(6);
            for particle in 0..200 {
                let time = first + 0.37 * interval;
                let state = |time| moving.at(particle, 1, time);
                let shift = 1e-5 * interval;
                let (Some(before), Some(now), Some(after)) = (state(time - shift), state(time), state(time + shift))
                else {
                    continue;
                };
                for axis in 0..3 {
                    let found = (after.position[axis] - before.position[axis]) / (2.0 * shift);
                    // Gadget's comoving velocity is sqrt(a) dx/dt = a^1.5 H dx/da, and a^1.5 H is H0 in this universe.
                    let stated = now.velocity[axis] / moving.edge().map_or(1.0, |_| 100.0);
                    let scale = now.velocity.iter().map(|v| v.abs()).fold(1e-3, f64::max);
                    assert!((found - stated).abs() < 1e-4 * scale, "{particle}: {found} {stated}");
                }
            }
        }
    }

    #[test]
    fn runs_are_read_as_they_were_made_and_the_same_for_any_number_of_threads() {
        for (kind, moving) in kinds(120).into_iter().enumerate() {
            let folder = tempfile::tempdir().unwrap();
            let times = times(&*moving, 6, 4.0, 3);
            let intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let [least, most] = [f64::min, f64::max].map(|choose| intervals.iter().copied().reduce(choose).unwrap());
            assert!(most / least > 1.0 && most / least <= 4.0 + 1e-9, "{intervals:?}");
            let files = write(&*moving, &times, 3, &folder.path().join("run"), &()).unwrap();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let again = pool.install(|| write(&*moving, &times, 3, &folder.path().join("again"), &())).unwrap();
            let mut orders = BTreeSet::new();
            for (step, (file, other)) in files.iter().zip(&again).enumerate() {
                assert!(file.ends_with(format!("run_{step:03}")));
                assert_eq!(std::fs::read(file).unwrap(), std::fs::read(other).unwrap());
                let source = open(file).unwrap();
                let about = source.description();
                let time = about.scale_factor.or(about.time).unwrap();
                assert!((time - times[step]).abs() < 1e-12);
                let is_comoving = moving.edge().is_some();
                assert_eq!((about.motion == Motion::Gadget, about.scale_factor.is_some()), (is_comoving, is_comoving));
                let mut found = BTreeMap::<(FamilyName, u64), Vec<[f64; 3]>>::new();
                for (index, family) in about.families.iter().enumerate() {
                    let count = family.count as usize;
                    let (mut ids, mut places) = (vec![0; count], vec![[0.0; 3]; count]);
                    source.read_ids(index, family.find(FieldKind::Id).unwrap(), 0..count as u64, &mut ids).unwrap();
                    let field = family.find(FieldKind::Position).unwrap();
                    source.read(index, field, 0..count as u64, places.as_flattened_mut()).unwrap();
                    if index == 0 {
                        orders.insert(ids.clone());
                    }
                    for (id, place) in ids.into_iter().zip(places) {
                        found.entry((family.name, id)).or_default().push(place);
                    }
                }
                let mut there = 0;
                for particle in 0..moving.len() {
                    let Some(state) = moving.at(particle, step, times[step]) else { continue };
                    there += 1;
                    let edge = moving.edge();
                    let near = |place: &[f64; 3]| {
                        (0..3).all(|axis| {
                            let mut off = place[axis] - state.position[axis];
                            off -= edge.map_or(0.0, |edge| edge * (off / edge).round());
                            off.abs() < 1e-4 && edge.is_none_or(|edge| (0.0..=edge).contains(&place[axis]))
                        })
                    };
                    let places = &found[&(state.family, moving.id(particle))];
                    assert!(places.iter().any(near), "kind {kind}, particle {particle}, step {step}");
                }
                assert_eq!(there, about.particles());
            }
            assert_eq!(orders.len(), 6, "rows are in another order in each step");
        }
    }

    #[test]
    fn every_tenth_id_is_wide_and_ids_are_repeated_in_births_alone() {
        for (kind, moving) in kinds(500).into_iter().enumerate() {
            let ids: Vec<u64> = (0..500).map(|particle| moving.id(particle)).collect();
            assert_eq!(ids.iter().filter(|id| **id > 1 << 53).count(), 50, "kind {kind}");
            let different: BTreeSet<&u64> = ids.iter().collect();
            assert_eq!(different.len(), if kind == 3 { 490 } else { 500 }, "kind {kind}");
        }
    }
}
