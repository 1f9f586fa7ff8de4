//! What is hidden is never seen, by brute force.

use super::super::tests::Random;
use super::*;
use crate::view::Projection;
use deepfield_data::model::{SampleType, Unit};
use deepfield_heights::model::HeightGrid;

/// Whether a line from a place towards the eye keeps above what is so high everywhere.
fn is_seen(globe: &Globe, place: DVec3, to_eye: DVec3, lowest: f64) -> bool {
    // The height along a line is convex: by thirds to where it is lowest.
    let height = |t: f64| globe.above((place + t * to_eye).to_array()).0;
    let is_above = |height: f64| height > lowest + 1e-9;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let thirds = [low + (high - low) / 3.0, high - (high - low) / 3.0];
        let heights = thirds.map(height);
        if !heights.into_iter().all(is_above) {
            return false;
        }
        if heights[0] < heights[1] { high = thirds[1] } else { low = thirds[0] }
    }
    [low, 0.0, 1.0].map(height).into_iter().all(is_above)
}

#[test]
fn nothing_that_is_seen_is_hidden() {
    let mut random = Random::new(5);
    let (mut hidden, mut seen) = (0, 0);
    for round in 0..3000 {
        let grid = HeightGrid {
            origin: [20.25, if round % 2 == 0 { -89.75 } else { 89.75 }],
            step: [0.5, if round % 2 == 0 { 0.5 } else { -0.5 }],
            xy_unit: Unit::new("deg"),
            height_unit: Unit::new("m"),
            ..HeightGrid::new(720, 360, SampleType::F32)
        };
        let globe = Globe { equator: 1.0, pole: [1.0, 0.9966, 0.93][round % 3] };
        let placed = Placed::new(&grid, Map::Globe(globe), 1.0, 0.0);
        assert!(
            placed.is_whole
                && placed.poles
                    == [Some(-90.0), Some(90.0)].map(|pole| pole.map(|pole: f64| pole * grid.step[1].signum()))
        );
        let lowest = random.between(-0.02, 0.005);
        let highest = lowest + random.between(0.0, 0.06);
        let away = 1.03 + 4.0 * random.between(0.0, 1.0).powi(3);
        let (longitude, latitude) = (random.between(-180.0, 180.0), random.between(-90.0, 90.0));
        let eye = away * DVec3::from(Globe::up(longitude, latitude));
        let projection = match round % 5 {
            0 => Projection::Orthographic { height: 3.0 },
            _ => Projection::Perspective { fov_y: 0.8 },
        };
        let view = View::look_at(eye, DVec3::ZERO, DVec3::new(0.1, 0.2, 0.9), projection, 64, 64).unwrap();
        let Some(horizon) = Horizon::new(&placed, &Sight::Flat(view), lowest) else { continue };
        let size = [1.0, 8.0, 100.0][round % 3];
        let part = |random: &mut Random, last: f64| {
            let first = random.between(0.0, last - 1.0).floor();
            [first as u64, (first + 1.0 + random.between(0.0, size).floor()).min(last) as u64]
        };
        let (rows, columns) = (part(&mut random, 359.0), part(&mut random, 720.0));
        if !horizon.hides([rows, columns], highest) {
            seen += 1;
            continue;
        }
        hidden += 1;
        for _ in 0..60 {
            let at = |random: &mut Random, ends: [u64; 2]| random.between(ends[0] as f64, ends[1] as f64);
            let place = placed.world(at(&mut random, rows), at(&mut random, columns), random.between(lowest, highest));
            let to_eye = if round % 5 == 0 { -10.0 * view.forward } else { eye - place };
            assert!(!is_seen(&globe, place, to_eye, lowest), "round {round}: {rows:?} {columns:?} from {eye}");
        }
    }
    assert!(hidden > 600 && seen > 600, "{hidden} {seen}");
}

/// Of two places of a globe on a line of sight the limb is between them.
#[test]
fn the_limb_parts_near_from_far() {
    let mut random = Random::new(6);
    let mut passed = 0;
    for round in 0..2000 {
        let globe = Globe { equator: 20.0, pole: random.between(17.0, 21.0) };
        let lowest = random.between(-1.0, 1.0);
        let axes = DVec3::new(globe.equator, globe.equator, globe.pole) + lowest;
        let mut place = || DVec3::from_array([(); 3].map(|()| random.between(-1.0, 1.0)));
        let (eye, target, up) = (60.0 * place(), 12.0 * place(), place());
        let projection = match round % 2 {
            0 => Projection::Perspective { fov_y: 0.5 },
            _ => Projection::Orthographic { height: 20.0 },
        };
        let Ok(view) = View::look_at(eye, target, up, projection, 40, 30) else { continue };
        let sight = Sight::Flat(view);
        let limb = Limb::new(&globe, lowest, &sight).unwrap();
        let (start, direction) = sight.ray([random.between(0.0, 40.0), random.between(0.0, 30.0)]).unwrap();
        // Where the line is in the globe, as a ball of 1.
        let (from, way) = (start / axes, direction / axes);
        let (square, half) = (way.length_squared(), from.dot(way));
        let root = half * half - square * (from.length_squared() - 1.0);
        let [near, far] = [-1.0, 1.0].map(|sign| (-half + sign * root.sqrt()) / square);
        // A line that touches the globe is on the limb.
        if root < 1e-6 || near < 0.0 || eye.length() < 22.0 {
            continue;
        }
        passed += 1;
        let t = limb.passed(start - eye, direction).unwrap();
        assert!(near < t && t < far, "{near} {t} {far}: {view:?}");
        let [near, far] = [near, far].map(|t| limb.is_beyond(start + t * direction - eye));
        assert!(near && !far, "{view:?}");
    }
    assert!(passed > 300, "{passed}");
}
