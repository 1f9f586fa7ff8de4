use super::*;
use crate::cases::cases;
use crate::hierarchy::RootCell;
use proptest::prelude::*;

const STEPS: usize = 5;

/// Places and velocities of particles on ellipses, some of which stay together for a while, at a time.
fn states(particles: &[([f64; 6], f64)], time: f64) -> Vec<(DVec3, DVec3)> {
    let state = |(axes, phase): &([f64; 6], f64)| {
        let [a, b] = [0, 3].map(|k| DVec3::new(axes[k], axes[k + 1], axes[k + 2]));
        let (sin, cos) = (phase + time).sin_cos();
        (a * cos + b * sin, b * cos - a * sin)
    };
    particles.iter().map(state).collect()
}

fn lattice() -> Lattice {
    Lattice { root: RootCell { min: DVec3::splat(-4.0), size: 8.0 } }
}

proptest! {
    #![proptest_config(cases(24))]

    /// Over steps of different lengths no particle leaves its cluster's track by more than the error, on each level; clusters of a
    /// level are parts of those of the coarser one, and are where their particles' centre of mass is.
    #[test]
    fn no_particle_leaves_its_cluster(
        particles in prop::collection::vec((prop::array::uniform6(-1.0..1.0f64), 0.0..0.4f64), 1..150),
        lengths in prop::collection::vec(0.05..0.4f64, STEPS),
        finest in 0.02..0.3f64,
    ) {
        let lattice = lattice();
        let errors = [finest, 2.0 * finest, 4.0 * finest];
        let clock: Vec<f64> = std::iter::once(0.0)
            .chain(lengths.iter().scan(0.0, |at, length| { *at += length; Some(*at) }))
            .collect();
        let span = |step: usize| {
            let own = lengths.get(step).copied().unwrap_or(0.0);
            own.max(step.checked_sub(1).map_or(0.0, |before| lengths[before]))
        };
        let at = |step: usize| -> Vec<([i64; 3], [i64; 3])> {
            let state = |(place, velocity): (DVec3, DVec3)| {
                (lattice.place(place.to_array()), lattice.movement(velocity.to_array(), span(step), 0))
            };
            states(&particles, clock[step]).into_iter().map(state).collect()
        };
        let tangent = |movement: [i64; 3], rate: f64| DVec3::from(movement.map(|v| v as f64)) * (lattice.unit() * rate);
        let mut before = Before::default();
        let mut last: Option<Gathered> = None;
        for step in 0..=STEPS {
            let now = at(step);
            let rate = lengths[step.max(1) - 1] / span(step);
            let next_rate = lengths.get(step).map(|length| length / span(step));
            let earlier = step.checked_sub(1).map(&at);
            let traveller = |i: usize| {
                let before = last.as_ref().zip(earlier.as_ref()).map(|(last, earlier)| {
                    let (place, movement) = earlier[i];
                    let rate = lengths[step - 1] / span(step - 1);
                    (last.clusters[i], DVec3::from(lattice.position(place)), tangent(movement, rate))
                });
                Traveller { place: now[i].0, movement: now[i].1, mass: 1.0 + i as f64, before }
            };
            let travellers: Vec<Traveller> = (0..particles.len()).map(traveller).collect();
            let flow = Flow { lattice: &lattice, errors: &errors, rate, next_rate, is_joining: true, is_reversed: false };
            let gathered = flow.gather(&travellers, &before);
            let here = Before::new(&lattice, &gathered.levels, rate);
            for (level, error) in errors.iter().enumerate() {
                for (i, traveller) in travellers.iter().enumerate() {
                    let own = here.ancestor(level, gathered.clusters[i]) as usize;
                    let (position, own_tangent) = here.states[level][own];
                    let end = (
                        DVec3::from(lattice.position(traveller.place)) - position,
                        tangent(traveller.movement, rate) - own_tangent,
                    );
                    let begin = traveller.before.map_or((DVec3::ZERO, DVec3::ZERO), |(cluster, place, tangent)| {
                        let (position, own) = before.states[level][before.ancestor(level, cluster) as usize];
                        (place - position, tangent - own)
                    });
                    let off = HermiteSpline { positions: [begin.0, end.0], tangents: [begin.1, end.1] };
                    for k in 0..=32 {
                        let distance = off.position(f64::from(k) / 32.0).length();
                        prop_assert!(distance <= *error, "step {step}, level {level}: {distance} of {error}");
                    }
                }
                let mut sums = vec![(0.0, DVec3::ZERO); gathered.levels[level].len()];
                for (i, traveller) in travellers.iter().enumerate() {
                    let sum = &mut sums[here.ancestor(level, gathered.clusters[i]) as usize];
                    *sum = (sum.0 + traveller.mass, sum.1 + traveller.mass * DVec3::from(lattice.position(traveller.place)));
                }
                for ((mass, sum), (position, _)) in sums.into_iter().zip(&here.states[level]) {
                    prop_assert!(mass > 0.0 && (sum / mass - position).length() <= error / 512.0);
                }
            }
            prop_assert!(gathered.levels.windows(2).all(|pair| pair[0].len() >= pair[1].len()));
            before = Before::new(&lattice, &gathered.levels, next_rate.unwrap_or(rate));
            last = Some(gathered);
        }
    }
}

#[test]
fn what_moves_together_stays_one_cluster_and_errors_are_halved() {
    let lattice = lattice();
    let traveller = |i: i64| Traveller { place: [i << 10; 3], movement: [5 << 20; 3], mass: 1.0, before: None };
    let travellers: Vec<Traveller> = (0..100).map(traveller).collect();
    let errors = flow_errors(&lattice, &travellers, 1.0, 1.0, Some(3), Some(1.0));
    assert_eq!(errors, [0.25, 0.5, 1.0]);
    let flow =
        Flow { lattice: &lattice, errors: &errors, rate: 1.0, next_rate: None, is_joining: true, is_reversed: false };
    let gathered = flow.gather(&travellers, &Before::default());
    assert!(gathered.levels.iter().all(|level| level.len() == 1));
    // As many levels as keep the finest small.
    let spread =
        |i: i64| Traveller { place: [(i * 7919 % 4096) << 20, (i * 104_729 % 4096) << 20, i << 18], ..traveller(i) };
    let spread: Vec<Traveller> = (0..4096).map(spread).collect();
    let errors = flow_errors(&lattice, &spread, 1.0, 1.0, None, None);
    let flow = Flow {
        lattice: &lattice,
        errors: &errors,
        rate: 1.0,
        next_rate: Some(1.0),
        is_joining: true,
        is_reversed: false,
    };
    let finest = flow.gather(&spread, &Before::default()).levels[0].len();
    assert!((16..=256).contains(&finest), "{finest} clusters with {errors:?}");
}
