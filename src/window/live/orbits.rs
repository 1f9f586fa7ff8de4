//! A small simulation that another system could be: particles on orbits in the field of their mean density, spherical about
//! their centre of mass and fixed, as test particles.

use super::LiveParticles;
use crate::model::{Dataset, Family};
use bevy::prelude::*;
use rayon::prelude::*;
use std::sync::Arc;

/// Seconds that an orbit takes at the radius that holds half of the mass.
const PERIOD_SECS: f64 = 20.0;
/// Share of the speed of a circular orbit at the beginning.
const BEGIN: f64 = 0.8;
/// Radii at which the mass within is known.
const RADII: usize = 512;
/// No step is longer, seconds: a frame that took long must not throw particles out.
const LONGEST_STEP_SECS: f64 = 0.05;

/// The mass within each radius.
#[derive(Clone, Debug)]
struct Field {
    center: [f64; 3],
    /// Radii, ascending.
    radius: Vec<f64>,
    /// `G M(<r)` at each, length cubed over seconds squared.
    pull: Vec<f64>,
    /// Softening length.
    soft: f64,
}

impl Field {
    fn new(families: &[Family]) -> Field {
        let masses = || families.iter().flat_map(|family| family.positions.iter().zip(&family.mass));
        let total: f64 = masses().map(|(_, &mass)| f64::from(mass)).sum();
        let mean = |axis: usize| masses().map(|(at, &mass)| at[axis] * f64::from(mass)).sum::<f64>() / total;
        let center = [mean(0), mean(1), mean(2)];
        let mut by_radius: Vec<(f64, f64)> =
            masses().map(|(at, &mass)| (distance(*at, center), f64::from(mass))).collect();
        by_radius.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut within = 0.0;
        let mut half = 0.0;
        let (mut radius, mut pull) = (vec![0.0], vec![0.0]);
        let each = by_radius.len().div_ceil(RADII).max(1);
        for (index, (r, mass)) in by_radius.iter().enumerate() {
            within += mass;
            if within <= 0.5 * total {
                half = *r;
            }
            if (index + 1) % each == 0 || index + 1 == by_radius.len() {
                radius.push(*r);
                pull.push(within);
            }
        }
        let half = if half > 0.0 { half } else { 1.0 };
        // Kepler's third law at the radius of half the mass gives the constant of gravity.
        let gravity =
            (std::f64::consts::TAU / PERIOD_SECS).powi(2) * half.powi(3) / (0.5 * total).max(f64::MIN_POSITIVE);
        pull.iter_mut().for_each(|mass| *mass *= gravity);
        Field { center, radius, pull, soft: 0.02 * half }
    }

    /// The acceleration towards the centre over the distance from it.
    fn strength(&self, r: f64) -> f64 {
        let next = self.radius.partition_point(|&radius| radius <= r).clamp(1, self.radius.len().max(2) - 1);
        let (Some([r0, r1]), Some([p0, p1])) = (
            self.radius.get(next - 1..=next).and_then(|pair| <[f64; 2]>::try_from(pair).ok()),
            self.pull.get(next - 1..=next).and_then(|pair| <[f64; 2]>::try_from(pair).ok()),
        ) else {
            return 0.0;
        };
        let share = if r1 > r0 { ((r - r0) / (r1 - r0)).clamp(0.0, 1.0) } else { 1.0 };
        (p0 + share * (p1 - p0)) / (r * r + self.soft * self.soft).powf(1.5)
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

/// The simulation.
#[derive(Resource, Clone, Debug)]
pub struct Orbits {
    state: Arc<Dataset>,
    /// Velocities of each family's particles, length unit over seconds.
    velocities: Vec<Vec<[f64; 3]>>,
    field: Field,
}

impl Orbits {
    /// Begins with these particles, all turning about the z axis.
    pub fn new(dataset: Dataset) -> Orbits {
        let field = Field::new(&dataset.families);
        let velocity = |at: &[f64; 3]| {
            let [x, y] = [at[0] - field.center[0], at[1] - field.center[1]];
            let around = x.hypot(y).max(f64::MIN_POSITIVE);
            let r = distance(*at, field.center);
            let speed = BEGIN * r * field.strength(r).sqrt();
            [-speed * y / around, speed * x / around, 0.0]
        };
        let velocities = dataset.families.iter().map(|family| family.positions.par_iter().map(velocity).collect());
        Orbits { velocities: velocities.collect(), field, state: Arc::new(dataset) }
    }

    /// Goes on by so many seconds (leapfrog: kick, drift, kick), in steps that are short enough.
    pub fn advance(&mut self, seconds: f64) {
        let steps = (seconds / LONGEST_STEP_SECS).ceil().clamp(1.0, 10.0);
        let step = (seconds / steps).min(LONGEST_STEP_SECS);
        let Orbits { state, velocities, field } = self;
        // Whoever still draws the state before keeps it.
        let state = Arc::make_mut(state);
        for (family, velocities) in state.families.iter_mut().zip(velocities) {
            family.positions.par_iter_mut().zip(velocities.par_iter_mut()).for_each(|(at, velocity)| {
                let kick = |at: &[f64; 3], velocity: &mut [f64; 3]| {
                    let strength = 0.5 * step * field.strength(distance(*at, field.center));
                    (0..3).for_each(|axis| velocity[axis] -= strength * (at[axis] - field.center[axis]));
                };
                for _ in 0..steps as u32 {
                    kick(at, velocity);
                    (0..3).for_each(|axis| at[axis] += step * velocity[axis]);
                    kick(at, velocity);
                }
            });
        }
    }

    /// The particles as they are now.
    pub fn state(&self) -> &Arc<Dataset> {
        &self.state
    }
}

/// Runs the simulation, a frame's time every frame, and shows it.
pub struct OrbitsPlugin(pub Orbits);

impl Plugin for OrbitsPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.0.clone()).add_systems(Update, run);
    }
}

fn run(mut orbits: ResMut<Orbits>, mut live: ResMut<LiveParticles>, time: Res<Time>) {
    orbits.advance(time.delta_secs_f64());
    live.show(Arc::clone(orbits.state()));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::merger::Merger;

    #[test]
    fn orbits_keep_their_angular_momentum_and_stay_bound() {
        let mut orbits = Orbits::new(crate::synth::dataset(&Merger::new(5, 2000)));
        let momentum = |orbits: &Orbits| -> Vec<f64> {
            let center = orbits.field.center;
            let places = &orbits.state.families[0].positions;
            let pairs = places.iter().zip(&orbits.velocities[0]);
            pairs.map(|(p, v)| (p[0] - center[0]) * v[1] - (p[1] - center[1]) * v[0]).collect()
        };
        let radii = |orbits: &Orbits| -> Vec<f64> {
            orbits.state.families[0].positions.iter().map(|at| distance(*at, orbits.field.center)).collect()
        };
        let (before, began) = (momentum(&orbits), radii(&orbits));
        let first = Arc::clone(orbits.state());
        for _ in 0..600 {
            orbits.advance(1.0 / 30.0);
        }
        for (a, b) in before.iter().zip(momentum(&orbits)) {
            assert!((a - b).abs() <= 1e-9 * a.abs(), "{a} {b}");
        }
        // Slower than a circle at the beginning: none gets farther out than it began, but for the error of the steps.
        let out = began.iter().zip(radii(&orbits)).filter(|(a, b)| *b > 1.05 * **a).count();
        assert!(out < began.len() / 50, "{out} of {}", began.len());
        // The state that somebody holds is left as it was.
        assert_eq!(
            first.families[0].positions[7],
            crate::synth::dataset(&Merger::new(5, 2000)).families[0].positions[7]
        );
        assert_ne!(first.families[0].positions, orbits.state().families[0].positions);
    }

    #[test]
    fn particles_in_one_place_do_not_break_it() {
        let mut dataset = crate::synth::dataset(&Merger::new(5, 10));
        dataset.families[0].positions.iter_mut().for_each(|at| *at = [1.0; 3]);
        let mut orbits = Orbits::new(dataset);
        orbits.advance(1e9);
        assert!(orbits.state().families[0].positions.as_flattened().iter().all(|x| x.is_finite()));
        dataset = (**orbits.state()).clone();
        dataset.families.clear();
        Orbits::new(dataset).advance(0.1);
    }
}
