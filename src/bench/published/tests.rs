//! Promises of the method: conservation, what is drawn once and only once, and how exact places are.

use super::levels::{Level, LevelOptions, levels};
use super::pictures::choose;
use super::relative::Relative;
use super::traversal::{Depth, Sink, traverse};
use super::{all, view};
use crate::hierarchy::pca::Members;
use crate::hierarchy::pca::members::DiameterRule;
use crate::model::{Bounds, Kernel};
use crate::view::{Projection, View};
use glam::DVec3;
use proptest::prelude::*;
use std::ops::Range;

/// Particles with unlike sizes and masses, some of which coincide, far away from the origin.
fn particles(count: usize, seed: u64) -> Members {
    let mut members = Members::default();
    let mut random = crate::synth::random::Random::new(seed, 0);
    for i in 0..count {
        let width = if i % 2 == 0 { 1.0 } else { 0.05 };
        let place: [f64; 3] = std::array::from_fn(|_| 1000.0 + width * random.normal());
        let h = 0.002 + 0.05 * random.uniform();
        for _ in 0..if i % 50 == 0 { 8 } else { 1 } {
            members.push_particle(place, 0.5 + random.uniform(), 1.0, (h, h * h));
        }
    }
    members
}

fn some(count: usize, seed: u64) -> Vec<Level> {
    levels(particles(count, seed), &LevelOptions::default())
}

/// What is drawn and culled, as level and index of clusters.
#[derive(Default)]
struct Told {
    drawn: Vec<(usize, usize)>,
    culled: Vec<(usize, usize)>,
}

impl Sink for Told {
    fn draw(&mut self, level: usize, index: usize) {
        self.drawn.push((level, index));
    }

    fn cull(&mut self, level: usize, index: usize) {
        self.culled.push((level, index));
    }
}

fn told(structure: &Relative, view: &View, threshold: f64, level: usize) -> Told {
    let parts = traverse(structure, view, Depth { threshold, level }, Told::default);
    parts.into_iter().fold(Told::default(), |mut all, part| {
        all.drawn.extend(part.drawn);
        all.culled.extend(part.culled);
        all
    })
}

/// The particles below a cluster.
fn particles_of(structure: &Relative, (level, index): (usize, usize)) -> Range<usize> {
    (level..structure.finest()).fold(index..index + 1, |range, level| {
        structure.children(level, range.start).start..structure.children(level, range.end - 1).end
    })
}

fn drawn_mass(structure: &Relative, (level, index): (usize, usize)) -> f64 {
    let points = &structure.points(level + structure.delta())[structure.run(level, index)];
    points.iter().map(|point| f64::from(point.mass)).sum()
}

/// A camera anywhere in the particles or away from them.
fn camera(place: [f64; 3], toward: [f64; 3], perspective: bool) -> View {
    let eye = DVec3::splat(1000.0) + DVec3::from_array(place);
    let projection = match perspective {
        true => Projection::Perspective { fov_y: 0.7 },
        false => Projection::Orthographic { height: 1.5 },
    };
    let target = eye + DVec3::from_array(toward).normalize_or(DVec3::Z);
    View::look_at(eye, target, DVec3::new(0.1, 0.9, 0.3), projection, 160, 120).unwrap()
}

#[test]
fn equations_1_and_2_hold_for_each_cluster() {
    for rule in [DiameterRule::Averaged, DiameterRule::Printed] {
        let all = levels(particles(3000, 5), &LevelOptions { rule, ..LevelOptions::default() });
        assert_eq!(all.len(), 5);
        assert_eq!(all[4].len(), 3420);
        for pair in all.windows(2) {
            let [coarse, fine] = pair else { continue };
            assert_eq!((coarse.starts.len(), coarse.starts[coarse.len()] as usize), (coarse.len() + 1, fine.len()));
            let ratio = fine.len() as f64 / coarse.len() as f64;
            assert!((4.5..6.0).contains(&ratio), "{ratio}");
            for j in 0..coarse.len() {
                let own = coarse.starts[j] as usize..coarse.starts[j + 1] as usize;
                let count = own.len() as f64;
                let flux = |level: &Level, i: usize| level.mass[i];
                let sum: f64 = own.clone().map(|i| flux(fine, i)).sum();
                assert!((flux(coarse, j) / sum - 1.0).abs() < 1e-6);
                let centre = own.clone().map(|i| fine.mass[i] * DVec3::from_array(fine.places[i])).sum::<DVec3>() / sum;
                let place = DVec3::from_array(coarse.places[j]);
                assert!(place.distance(centre) < 1e-9);
                let largest = own.clone().max_by(|&a, &b| fine.diameters[a].total_cmp(&fine.diameters[b])).unwrap();
                let away = |i: usize| fine.diameters[i] * DVec3::from_array(fine.places[i]).distance(place);
                let others: f64 = own.clone().filter(|&i| i != largest).map(away).sum();
                let grown = match rule {
                    _ if own.len() == 1 => 0.0,
                    DiameterRule::Averaged => 0.5 * (others / (count - 1.0)).sqrt(),
                    DiameterRule::Printed => 0.5 / (count - 1.0) * others.sqrt(),
                };
                let expected = fine.diameters[largest] + grown;
                assert!((coarse.diameters[j] / expected - 1.0).abs() < 1e-6, "{} {expected}", coarse.diameters[j]);
            }
        }
    }
}

#[test]
fn places_and_diameters_are_within_half_a_step() {
    let levels = some(2000, 2);
    for structure in [1, 2].map(|delta| Relative::new(&levels, delta)) {
        let delta = structure.delta();
        // Singles from the structure's origin, whose own rounding is far below a pixel.
        let single = f64::from(f32::EPSILON) * 8.0;
        for level in 0..=structure.finest() - delta {
            let clusters = if level == 0 { 1 } else { levels[level - 1].len() };
            for index in 0..clusters {
                let node = structure.node(level, index);
                let finer = &levels[level + delta - 1];
                for i in structure.run(level, index) {
                    let point = &structure.points(level + delta)[i];
                    let place = structure.origin() + glam::Vec3::from_array(node.place(point)).as_dvec3();
                    let off = (place - DVec3::from_array(finer.places[i])).abs().max_element();
                    assert!(off <= 0.5 * f64::from(node.step) + single, "{off} {}", node.step);
                    let off = (f64::from(node.diameter_of(point)) - finer.diameters[i]).abs();
                    assert!(off <= f64::from(node.diameter) * (0.5 / 65535.0 + 1e-6));
                    assert!((f64::from(point.mass) / finer.mass[i] - 1.0).abs() < 1e-7);
                    assert!(finer.diameters[i] <= f64::from(node.diameter));
                }
            }
        }
    }
}

#[test]
fn without_a_threshold_the_cap_alone_decides() {
    let levels = some(2000, 3);
    let bounds = Bounds::of(levels[levels.len() - 1].places.iter().copied());
    let view = view(bounds, 200).unwrap();
    for structure in [1, 2].map(|delta| Relative::new(&levels, delta)) {
        for level in structure.delta()..=structure.finest() {
            let told = told(&structure, &view, 0.0, level);
            assert!(told.culled.is_empty());
            let runs: Vec<usize> = told.drawn.iter().flat_map(|&(of, index)| structure.run(of, index)).collect();
            assert!(told.drawn.iter().all(|&(of, _)| of + structure.delta() == level));
            assert_eq!(runs, (0..levels[level - 1].len()).collect::<Vec<_>>());
        }
    }
    let pictures = [1, 2].map(|delta| {
        let structure = Relative::new(&levels, delta);
        let chosen = choose(&structure, &view, Depth { threshold: 0.0, level: structure.finest() });
        assert_eq!(chosen.points.iter().sum::<u64>(), levels[levels.len() - 1].len() as u64);
        chosen.sums(&view, Kernel::CubicSpline).unwrap()
    });
    let exact = all(&view, &levels[levels.len() - 1], Kernel::CubicSpline).unwrap();
    for picture in pictures {
        assert!(picture.error_against(&exact).1 < 2e-3, "{:?}", picture.error_against(&exact));
    }
}

#[test]
fn what_is_culled_would_not_be_seen() {
    let levels = some(3000, 4);
    let structure = Relative::new(&levels, 1);
    for (place, toward) in
        [([0.2, 0.1, 1.5], [0.1, 0.2, -1.0]), ([0.0; 3], [1.0, 0.3, 0.2]), ([0.0, 3.0, 0.0], [0.3, -1.0, 0.0])]
    {
        for perspective in [true, false] {
            let view = camera(place, toward, perspective);
            let told = told(&structure, &view, 0.0, structure.finest());
            assert!(!told.culled.is_empty());
            let chosen = choose(&structure, &view, Depth { threshold: 0.0, level: structure.finest() });
            let picture = chosen.sums(&view, Kernel::CubicSpline).unwrap();
            let exact = all(&view, &levels[levels.len() - 1], Kernel::CubicSpline).unwrap();
            assert!(exact.sum() > 0.0 && picture.error_against(&exact).1 < 5e-3, "{:?}", picture.error_against(&exact));
        }
    }
}

#[test]
fn little_data_has_few_levels() {
    for count in [1, 3, 30] {
        let mut members = Members::default();
        (0..count).for_each(|i| members.push_particle([f64::from(i), 0.0, 0.0], 1.0, 1.0, (0.1, 0.001)));
        let levels = levels(members, &LevelOptions::default());
        assert_eq!(levels.len(), if count == 30 { 2 } else { 1 });
        let structure = Relative::new(&levels, 2);
        let told = told(&structure, &camera([0.0; 3], [0.0, 0.0, -1.0], true), 0.0, 6);
        let mass: f64 = told.drawn.iter().map(|&cluster| drawn_mass(&structure, cluster)).sum();
        assert_eq!(mass, f64::from(count));
    }
    let mut members = Members::default();
    (0..100).for_each(|_| members.push_particle([1.0; 3], 1.0, 1.0, (0.1, 0.001)));
    let levels = levels(members, &LevelOptions::default());
    assert_eq!((levels[0].len(), levels[0].mass[0]), (1, 100.0));
}

proptest! {
    #![proptest_config(crate::cases::cases(48))]

    /// Whatever the view, the threshold and the cap: every particle is below exactly one cluster that is drawn or culled, and the mass of
    /// both together is that of all.
    #[test]
    fn nothing_is_drawn_twice_or_left_out(
        count in 30..1500_usize,
        seed: u64,
        delta in 1..4_usize,
        threshold in 0.0..40.0_f64,
        level in 1..7_usize,
        place: [f64; 3],
        toward: [f64; 3],
        perspective: bool,
    ) {
        let levels = some(count, seed);
        let structure = Relative::new(&levels, delta);
        let view = camera(place.map(|x| x % 2.0), toward.map(|x| x % 1.0), perspective);
        let told = told(&structure, &view, threshold, level);
        let mut ranges: Vec<Range<usize>> =
            told.drawn.iter().chain(&told.culled).map(|&cluster| particles_of(&structure, cluster)).collect();
        ranges.sort_by_key(|range| range.start);
        let end = ranges.iter().fold(0, |end, range| {
            assert_eq!(end, range.start);
            range.end
        });
        let finest = &levels[levels.len() - 1];
        prop_assert_eq!(end, finest.len());
        let drawn: f64 = told.drawn.iter().map(|&cluster| drawn_mass(&structure, cluster)).sum();
        let culled: f64 = told.culled.iter().map(|&(level, index)| levels[level - 1].mass[index]).sum();
        let total: f64 = finest.mass.iter().sum();
        prop_assert!(((drawn + culled) / total - 1.0).abs() < 1e-5);
        for &(of, _) in &told.drawn {
            prop_assert!(of == 0 || of + structure.delta() <= level.min(structure.finest()));
        }
    }
}
