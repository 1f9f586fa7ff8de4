//! Where heights may stand: where lines cross rows and columns of the field.

use super::super::look::Contours;
use super::APART;
use super::relief::Relief;
use rayon::prelude::*;
use std::cmp::Reverse;

/// Rows and columns whose crossings are looked at are about so far apart in the picture, in ems.
const LADDER: f64 = 3.0;
/// Lines are crossed at no smaller angle: its sine.
const CROSSED: f64 = 0.35;
/// Most lines of a cell that are looked at: more are too close to each other.
const MOST: f64 = 4.0;

/// A place of a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// Which line.
    pub number: i64,
    /// Where in the picture, pixels.
    pub at: [f64; 2],
    /// What comes first: stronger lines, then crossings with multiples of higher powers of two.
    order: (bool, Reverse<i32>),
    /// Rows or columns, which one in steps, and where along it: the same in every picture.
    crossed: (usize, i64, f64),
}

/// The places where heights may stand, the best first.
pub(super) fn of(relief: &Relief<'_, '_>, contours: &Contours, em: f64) -> Vec<Candidate> {
    let [columns, rows] = relief.nodes;
    let row = |y: usize| {
        let mut found = Vec::new();
        (0..columns).for_each(|x| in_cell(relief, contours, em, [x, y], &mut found));
        found
    };
    let found: Vec<Vec<Candidate>> = (0..rows).into_par_iter().map(row).collect();
    let mut found = found.concat();
    found.sort_by(|a, b| {
        let along = |candidate: &Candidate| candidate.crossed.2;
        (a.order, a.crossed.0, a.crossed.1, a.number)
            .cmp(&(b.order, b.crossed.0, b.crossed.1, b.number))
            .then_with(|| along(a).total_cmp(&along(b)))
    });
    found
}

fn in_cell(relief: &Relief<'_, '_>, contours: &Contours, em: f64, cell: [usize; 2], found: &mut Vec<Candidate>) {
    let Some(corners) = relief.corners(cell) else { return };
    let (height, middle) = (relief.plane(&corners, 0), relief.middle(cell));
    let ends = corners.map(|[height, ..]| (height - contours.base) / contours.interval);
    let [low, high] =
        [ends.into_iter().fold(f64::MAX, f64::min).ceil(), ends.into_iter().fold(f64::MIN, f64::max).floor()];
    // Numbers beyond which lines cannot be told apart have none.
    if !(high >= low && high - low < MOST && low.abs().max(high.abs()) < 1e15) {
        return;
    }
    let steep = height.steepness();
    for number in low as i64..=high as i64 {
        let is_major = contours.is_major(number);
        let apart = contours.interval * if is_major { f64::from(contours.major.max(1)) } else { 1.0 } / steep;
        if apart < em * APART[usize::from(!is_major)] {
            continue;
        }
        let rise = (number as f64).mul_add(contours.interval, contours.base) - height.middle;
        for axis in 0..2 {
            let line = relief.plane(&corners, 1 + axis);
            let power = (LADDER * em * line.steepness()).log2().ceil();
            let (spacing, ends) = (power.exp2(), corners.map(|corner| corner[1 + axis]));
            let numbers = [
                (ends.into_iter().fold(f64::MAX, f64::min) / spacing).ceil(),
                (ends.into_iter().fold(f64::MIN, f64::max) / spacing).floor(),
            ];
            let cross = height.rise[0] * line.rise[1] - height.rise[1] * line.rise[0];
            let is_crossed = cross.abs() > CROSSED * steep * line.steepness();
            if !(is_crossed && numbers[1] >= numbers[0] && numbers[1] - numbers[0] < MOST) {
                continue;
            }
            for step in numbers[0] as i64..=numbers[1] as i64 {
                let across = step as f64 * spacing - line.middle;
                let away = [
                    (rise * line.rise[1] - across * height.rise[1]) / cross,
                    (across * height.rise[0] - rise * line.rise[0]) / cross,
                ];
                let half = 0.5 * relief.step as f64;
                if !away.iter().all(|away| (-half..half).contains(away)) {
                    continue;
                }
                let twos = if step == 0 { 60 } else { step.trailing_zeros() as i32 };
                let other = relief.plane(&corners, 2 - axis);
                found.push(Candidate {
                    number,
                    at: [middle[0] + away[0], middle[1] + away[1]],
                    order: (!is_major, Reverse(power as i32 + twos)),
                    crossed: (axis, step, other.middle + other.rise[0] * away[0] + other.rise[1] * away[1]),
                });
            }
        }
    }
}
