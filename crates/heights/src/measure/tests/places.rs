//! Places and profiles against T cell by cell.

use super::rays::{noisy, random};
use super::truth::{assert_near, height, of, sines};
use crate::measure::{Disc, Part, Profile, nearest, probe, probe_sample, profile, window_of};
use crate::model::{HeightField, Heights, Lengths, Window};
use deepfield_data::model::Unit;
use proptest::prelude::*;

/// Checks a profile against T: at its points, between them, and its gaps.
fn check(field: &HeightField, line: &[[f64; 2]], found: &Profile, seed: u64) {
    let grid = &field.grid;
    let range = 1.0;
    let mut starts = vec![0.0];
    for leg in line.windows(2) {
        starts.push(starts[starts.len() - 1] + (leg[1][0] - leg[0][0]).hypot(leg[1][1] - leg[0][1]));
    }
    let length = starts[starts.len() - 1];
    assert_near(found.length, length, 1e-12, "length");
    assert!(found.points.windows(2).all(|pair| pair[0].distance < pair[1].distance), "{:?}", found.points);
    assert_eq!(found.points[0].distance, 0.0);
    assert_near(found.points[found.points.len() - 1].distance, length, 1e-14, "end");
    let on = |x: f64, y: f64| {
        let [row, column] = grid.row_column([x, y]);
        height(field, row, column)
    };
    for point in found.points.iter().filter(|point| !point.height.is_nan()) {
        let wanted = on(point.x, point.y).unwrap_or(f64::NAN);
        assert!((point.height - wanted).abs() <= 1e-12 * range, "{point:?}: {wanted}");
    }
    let valid: f64 = found
        .points
        .windows(2)
        .filter(|pair| !(pair[0].height + pair[1].height).is_nan())
        .map(|pair| pair[1].distance - pair[0].distance)
        .sum();
    assert_near(found.valid_length, valid, 1e-12, "valid length");
    let mut next = random(seed);
    for _ in 0..300 {
        let at = next() * length;
        let leg = starts.partition_point(|start| *start <= at).clamp(1, line.len() - 1) - 1;
        let part = (at - starts[leg]) / (starts[leg + 1] - starts[leg]);
        let place: [f64; 2] =
            std::array::from_fn(|axis| line[leg][axis] + part * (line[leg + 1][axis] - line[leg][axis]));
        let after = found.points.partition_point(|point| point.distance <= at).clamp(1, found.points.len() - 1);
        let (a, b) = (found.points[after - 1], found.points[after]);
        let mine = a.height + (at - a.distance) / (b.distance - a.distance) * (b.height - a.height);
        let wanted = on(place[0], place[1]);
        if (at - a.distance).min(b.distance - at) > 1e-8 {
            assert_eq!(wanted.is_some(), !mine.is_nan(), "{place:?} between {a:?} and {b:?}");
        }
        if let (Some(wanted), false) = (wanted, mine.is_nan()) {
            assert!((mine - wanted).abs() <= 1e-11, "{place:?}: {mine}, not {wanted}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn profiles_are_exact(columns in 2_u64..24, rows in 2_u64..24, holes in prop_oneof![Just(0.0), Just(0.2), Just(0.6)], seed in any::<u64>(),
                          steps in prop_oneof![Just([1.0, 1.0]), Just([0.7, -0.7]), Just([2.0, 5.0])]) {
        let mut field = noisy(columns, rows, holes, seed);
        (field.grid.step, field.grid.origin) = (steps, [3.25, -2.0]);
        let mut next = random(seed ^ 1);
        let count = 2 + (next() * 4.0) as usize;
        let line: Vec<[f64; 2]> = (0..count).map(|number| {
            let mut place = [next() * 1.4 - 0.2, next() * 1.4 - 0.2].map(|part| part * 20.0);
            if seed.wrapping_add(number as u64).is_multiple_of(3) {
                place = place.map(f64::round);
            }
            field.grid.place(place[0], place[1])
        }).collect();
        prop_assume!(line.windows(2).all(|leg| leg[0] != leg[1]));
        check(&field, &line, &profile(&field, &line).unwrap(), seed);
    }
}

#[test]
fn a_profile_of_a_plane_has_one_point_an_edge() {
    let field = of(6, 6, |row, column| row + 10.0 * column);
    let found = profile(&field, &[[0.25, 2.5], [4.75, 2.5]]).unwrap();
    // Four grid lines, five diagonals, two ends.
    assert_eq!(found.points.len(), 4 + 5 + 2);
    assert_eq!((found.length, found.valid_length), (4.5, 4.5));
    let beside = profile(&field, &[[-5.0, 9.0], [20.0, 9.0]]).unwrap();
    assert_eq!((beside.points.len(), beside.valid_length), (3, 0.0));
    assert!(profile(&field, &[[1.0, f64::NAN], [2.0, 2.0]]).unwrap().points.is_empty());
    let bent = profile(&field, &[[4.5, 2.5], [7.0, 2.5], [7.0, 4.5], [4.5, 4.5]]).unwrap();
    let gap = bent.points.iter().find(|point| point.height.is_nan()).unwrap();
    assert_eq!((gap.x, gap.y, gap.distance), (7.0, 3.5, 3.5));
}

#[test]
fn a_profile_of_sines_is_on_t() {
    let field = sines(150, 150, 64.0, 0.5);
    let line = [[10.3, 20.7], [139.2, 83.3], [133.0, 33.3], [5.5, 101.25]];
    check(&field, &line, &profile(&field, &line).unwrap(), 3);
}

#[test]
fn places_tell_height_slope_and_what_is_nearest() {
    let mut field = of(300, 200, |row, column| 3.0 * column - 4.0 * row);
    (field.grid.step, field.grid.xy_unit, field.grid.height_unit) = ([1.0, -1.0], Unit::new("mm"), Unit::new("um"));
    let found = probe(&field, [10.25, -3.5]).unwrap();
    assert_near(found.height.unwrap(), 30.75 - 14.0, 1e-12, "height");
    assert_near(found.slope.unwrap(), 5e-3, 1e-12, "slope");
    // Up is towards +x and +y (rows go down), so downhill is to the left and below: between 180 and 270 degrees.
    assert_near(found.aspect.unwrap(), 180.0 + 3.0_f64.atan2(4.0).to_degrees(), 1e-12, "aspect");
    assert_eq!(found.nearest, None);
    for row in 20..150_u64 {
        for column in 30..280 {
            field.stored[(row * 300 + column) as usize] = f64::NAN;
        }
    }
    let inside = probe_sample(&field, &Lengths::of(&field.grid), 40.2, 150.0).unwrap();
    assert_eq!((inside.height, inside.nearest.unwrap().row, inside.nearest.unwrap().column), (None, 19, 150));
    assert_near(inside.nearest.unwrap().distance, 21.2, 1e-12, "distance");
    let beside = probe(&field, [400.0, 50.0]).unwrap();
    assert_eq!((beside.nearest.unwrap().row, beside.nearest.unwrap().column), (0, 299));
    let corner = probe_sample(&field, &Lengths::of(&field.grid), 199.0, 299.0).unwrap();
    assert_eq!(corner.height, Some(field.stored[200 * 300 - 1]));
    let alone = HeightField::of(3, 3, (0..9).map(|n| if n == 4 { 7.0 } else { f64::NAN }).collect());
    assert_eq!(probe_sample(&alone, &Lengths::of(&alone.grid), 1.0, 1.0).unwrap().height, Some(7.0));
    let none = HeightField::of(3, 3, vec![f64::NAN; 9]);
    assert_eq!(nearest(&none, &Lengths::of(&none.grid), 1e30, -5.0).unwrap(), None);
    assert_eq!(nearest(&alone, &Lengths::of(&alone.grid), f64::INFINITY, 0.0).unwrap(), None);
}

#[test]
fn parts_are_windows_and_discs() {
    let mut field = of(10, 8, |row, column| 100.0 * row + column);
    (field.grid.step, field.grid.origin) = ([0.1, -0.1], [5.0, 2.0]);
    assert_eq!(
        window_of(&field.grid, [[5.3, 1.8], [5.1, 1.4]]),
        Some(Window { row: 2, column: 1, rows: 5, columns: 3 })
    );
    assert_eq!(window_of(&field.grid, [[6.3, 1.8], [7.1, 1.4]]), None);
    let part = Part::of_rectangle(&field, [[5.3, 1.8], [5.1, 1.4]]).unwrap();
    let mut out = [0.0; 4];
    part.heights(Window { row: 1, column: 1, rows: 2, columns: 2 }, &mut out).unwrap();
    assert_eq!(out, [302.0, 303.0, 402.0, 403.0]);
    let disc = Part::of_disc(&field, Disc { center: [5.4, 1.7], radius: 0.25 }).unwrap();
    let mut all = vec![0.0; 25];
    disc.heights(Window::all(disc.grid()), &mut all).unwrap();
    // 21 of 25: the four corners are 2.83 steps away.
    assert_eq!(all.iter().filter(|height| !height.is_nan()).count(), 21);
    assert!(Part::of_disc(&field, Disc { center: [5.4, 1.7], radius: f64::NAN }).is_none());
}
