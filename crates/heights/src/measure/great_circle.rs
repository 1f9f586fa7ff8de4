//! The shortest way between two places of a globe, as lines that are straight in degrees.

use crate::model::HeightGrid;

/// Degrees that a line has at most: straight in degrees it is farther from the circle by less than a hundred-thousandth of its length, but next
/// to a pole.
const PIECE: f64 = 0.25;
/// Lines at most.
const MOST: f64 = 1024.0;

/// Polylines in longitude and latitude along the great circle between two places. They are in the degrees of a field, which begin where it does
/// and come round: where the circle crosses its seam one ends and the next begins. Of places opposite to each other every way is the shortest, and
/// the line that is straight in degrees is taken.
pub fn great_circle(grid: &HeightGrid, ends: [[f64; 2]; 2]) -> Vec<Vec<[f64; 2]>> {
    let [from, to] = ends.map(|[longitude, latitude]| direction(longitude, latitude));
    let across = cross(from, to);
    let (sin, cos) = (dot(across, across).sqrt(), dot(from, to));
    let angle = libm::atan2(sin, cos);
    if sin <= 1e-12 || angle.is_nan() {
        return vec![ends.to_vec()];
    }
    let count = (angle.to_degrees() / PIECE).ceil().clamp(1.0, MOST) as usize;
    let mut way = vec![ends[0]];
    for step in 1..=count {
        let part = step as f64 / count as f64;
        let [a, b] = [(1.0 - part) * angle, part * angle].map(|angle| libm::sin(angle) / sin);
        let place: [f64; 3] = std::array::from_fn(|axis| a * from[axis] + b * to[axis]);
        let before = way[step - 1][0];
        let (longitude, latitude) = match step == count {
            true => (ends[1][0], ends[1][1]),
            false => (
                libm::atan2(place[1], place[0]).to_degrees(),
                libm::atan2(place[2], place[0].hypot(place[1])).to_degrees(),
            ),
        };
        // On from where it was, without a jump.
        way.push([before + (longitude - before + 180.0).rem_euclid(360.0) - 180.0, latitude]);
    }
    in_turns(grid, &way)
}

/// A line cut where it leaves the turn of a field that begins with its least longitude.
pub(super) fn in_turns(grid: &HeightGrid, way: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
    // Where the first column comes again the turn ends, whatever the digits of a step have lost by there.
    let around = grid.around();
    let last = grid.place(0.0, around.unwrap_or(grid.columns - 1) as f64)[0];
    let low = grid.origin[0].min(last);
    let high = if around.is_some() { grid.origin[0].max(last) } else { low + 360.0 };
    // The last column may be the first one again.
    let is_in = |x: f64, turn: f64| (low..=low + 360.0).contains(&(x - 360.0 * turn));
    let turn_of = |x: f64| ((x - low) / 360.0).floor();
    let Some(first) = way.first() else { return Vec::new() };
    let mut turn = turn_of(first[0]);
    let mut pieces = vec![vec![[first[0] - 360.0 * turn, first[1]]]];
    for pair in way.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let end = if is_in(to[0], turn) { turn } else { turn_of(to[0]) };
        while turn != end {
            let next = turn + (end - turn).signum();
            let seam = low + 360.0 * turn.max(next);
            let latitude = from[1] + (seam - from[0]) / (to[0] - from[0]) * (to[1] - from[1]);
            let [ends, begins] = if next > turn { [high, low] } else { [low, high] };
            if let Some(piece) = pieces.last_mut() {
                piece.push([ends, latitude]);
            }
            pieces.push(vec![[begins, latitude]]);
            turn = next;
        }
        if let Some(piece) = pieces.last_mut() {
            piece.push([to[0] - 360.0 * turn, to[1]]);
        }
    }
    pieces
}

fn direction(longitude: f64, latitude: f64) -> [f64; 3] {
    let [longitude, latitude] = [longitude, latitude].map(f64::to_radians);
    let level = libm::cos(latitude);
    [level * libm::cos(longitude), level * libm::sin(longitude), libm::sin(latitude)]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Lengths;
    use deepfield_data::model::{SampleType, Unit};
    use proptest::prelude::*;

    /// A whole globe that begins at 20 degrees east and repeats its first column.
    fn globe(step: f64) -> HeightGrid {
        let plain = HeightGrid::new(361, 181, SampleType::F32);
        let origin = [if step > 0.0 { 20.0 } else { 380.0 }, 90.0];
        HeightGrid { origin, step: [step, -1.0], xy_unit: Unit::new("deg"), height_unit: Unit::new("m"), ..plain }
    }

    proptest! {
        /// It is as long as the angle between its ends, on the circle, in the field's degrees, and without jumps but from seam to seam.
        #[test]
        fn it_is_the_shortest_way(
            from in (20.0..380.0f64, -85.0..85.0f64),
            to in (20.0..380.0f64, -85.0..85.0f64),
            step in prop::sample::select(vec![1.0, -1.0]),
        ) {
            let (grid, ends) = (globe(step), [from, to].map(|(x, y)| [x, y]));
            let [a, b] = ends.map(|[x, y]| direction(x, y));
            let normal = cross(a, b);
            let angle = libm::atan2(dot(normal, normal).sqrt(), dot(a, b));
            prop_assume!((0.01..3.1).contains(&angle));
            let pieces = great_circle(&grid, ends);
            prop_assert!(pieces.len() <= 2);
            let lengths = Lengths::on(&grid, 1.0);
            let length: f64 =
                pieces.iter().flat_map(|piece| piece.windows(2).map(|leg| lengths.along(leg[0], leg[1]))).sum();
            prop_assert!((length / angle - 1.0).abs() < 1e-3, "{} {}", length, angle);
            prop_assert_eq!(pieces[0][0], ends[0]);
            let end = pieces.last().and_then(|piece| piece.last()).copied().unwrap();
            prop_assert!(dot(direction(end[0], end[1]), b) > 1.0 - 1e-12);
            for piece in &pieces {
                for [x, y] in piece {
                    prop_assert!((20.0 - 1e-9..=380.0 + 1e-9).contains(x), "{}", x);
                    prop_assert!(dot(direction(*x, *y), normal).abs() < 2e-4);
                }
                for leg in piece.windows(2) {
                    prop_assert!(dot(direction(leg[0][0], leg[0][1]), direction(leg[1][0], leg[1][1])) > 0.999);
                }
            }
            if let [before, after] = &pieces[..] {
                let (one, other) = (before[before.len() - 1], after[0]);
                prop_assert!((one[0] - other[0]).abs() == 360.0 && one[1] == other[1], "{:?} {:?}", one, other);
            }
        }
    }

    #[test]
    fn it_crosses_the_seam_and_the_pole() {
        let pieces = great_circle(&globe(1.0), [[370.0, 10.0], [30.0, 10.0]]);
        assert_eq!(pieces.len(), 2);
        assert!((pieces[0][pieces[0].len() - 1][0], pieces[1][0][0]) == (380.0, 20.0));
        // Higher than both ends between them.
        assert!(pieces[0].iter().all(|[_, y]| (10.0..11.0).contains(y)));
        let over = great_circle(&globe(1.0), [[100.0, 80.0], [280.0, 80.0]]);
        assert!(over.iter().flatten().any(|[_, y]| *y > 89.7));
        let opposite = [[100.0, 0.0], [280.0, 0.0]];
        assert_eq!(great_circle(&globe(1.0), opposite), [opposite.to_vec()]);
    }
}
