//! Rays on globes against steps along them.

use super::rays::random;
use crate::measure::{Pick, Pyramid, Ray, Spread, pick_on_globe};
use crate::model::{Cell, Globe, HeightField, HeightGrid};
use deepfield_data::model::{SampleType, Unit};
use proptest::prelude::*;

/// A field on a globe whose heights are a few hundredths of the radius; `holes` of its samples were not measured.
fn field(columns: u64, rows: u64, origin: [f64; 2], step: [f64; 2], holes: f64, seed: u64) -> HeightField {
    let mut next = random(seed);
    let heights = (0..columns * rows).map(|_| if next() < holes { f64::NAN } else { 0.05 * next() - 0.01 }).collect();
    let grid = HeightGrid {
        origin,
        step,
        xy_unit: Unit::new("deg"),
        height_unit: Unit::new("m"),
        ..HeightGrid::new(columns, rows, SampleType::F64)
    };
    HeightField { grid, ..HeightField::of(columns, rows, heights) }
}

/// The field's height at a place with the cells between its last and its first column; NaN where there is none.
fn height(field: &HeightField, is_closed: bool, row: f64, column: f64) -> f64 {
    let (columns, rows) = (field.grid.columns as usize, field.grid.rows as usize);
    let last = columns - 1 + usize::from(is_closed);
    if !(0.0..=(rows - 1) as f64).contains(&row) || !(0.0..=last as f64).contains(&column) {
        return f64::NAN;
    }
    let (r, c) = ((row as usize).min(rows - 2), (column as usize).min(last - 1));
    let at = |row: usize, column: usize| field.stored[row * columns + column % columns];
    Cell([at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)]).height(column - c as f64, row - r as f64)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn picks_are_what_steps_find(
        kind in 0..4,
        pole in prop::sample::select(vec![1.0, 1.0 / 1.003, 0.9]),
        holes in prop::sample::select(vec![0.0, 0.0, 0.2]),
        seed in 1..1_000_000_u64,
    ) {
        // A part, and all around with and without the first column again, in either direction.
        let (columns, rows, origin, step) = match kind {
            0 => (31, 21, [-170.0, 60.0], [2.0, -3.0]),
            1 => (37, 19, [20.0, -90.0], [10.0, 10.0]),
            2 => (36, 18, [-175.0, 85.0], [10.0, -10.0]),
            _ => (24, 12, [180.0, -82.5], [-15.0, 15.0]),
        };
        let mut field = field(columns, rows, origin, step, holes, seed);
        if kind == 1 {
            field.stored.chunks_mut(columns as usize).for_each(|row| row[columns as usize - 1] = row[0]);
        }
        let is_closed = kind >= 2;
        prop_assert_eq!(field.grid.around().is_some(), kind > 0);
        let globe = Globe { equator: 1.0, pole };
        let lift = [0.002, 1.5];
        let last = [(columns - 1 + u64::from(is_closed)) as f64, (rows - 1) as f64];
        let spread = Spread { last, ..Spread::new(globe, &field.grid, lift) };
        let pyramid = Pyramid::read(&field).unwrap();
        let mut next = random(seed ^ 77);
        for _ in 0..40 {
            let direction = |next: &mut dyn FnMut() -> f64| {
                let z = 2.0 * next() - 1.0;
                let (sin, cos) = (std::f64::consts::TAU * next()).sin_cos();
                let level = (1.0 - z * z).sqrt();
                [level * cos, level * sin, z]
            };
            // From far away, from near by, and from inside.
            let away = [0.8, 1.1, 1.3, 4.0][(4.0 * next()) as usize % 4];
            let eye = direction(&mut next).map(|part| away * part);
            let to = direction(&mut next).map(|part| part * (0.2 + 0.9 * next()));
            let way: [f64; 3] = std::array::from_fn(|axis| to[axis] - eye[axis]);
            let found = pick_on_globe(&mut &pyramid, &spread, &Ray::new(eye, way)).unwrap();
            let above = |t: f64| {
                let [x, y, h] = globe.geodetic(std::array::from_fn(|axis| eye[axis] + t * way[axis]));
                let row = (y - origin[1]) / step[1];
                let turned = (x - origin[0]).rem_euclid(360.0 * step[0].signum());
                let turned = if step[0] < 0.0 && turned > 0.0 { turned - 360.0 } else { turned };
                h - (lift[1] * height(&field, is_closed, row, turned / step[0]) + lift[0])
            };
            // Until it is behind the globe.
            let length = way.iter().map(|part| part * part).sum::<f64>().sqrt();
            let end = (away + 1.2) / length;
            const STEPS: u32 = 6000;
            let at = |k: u32| end * f64::from(k) / f64::from(STEPS);
            let values: Vec<f64> = (0..=STEPS).map(|k| above(at(k))).collect();
            let wanted = values.windows(2).position(|pair| pair[0] * pair[1] <= 0.0).map(|k| {
                let (mut low, mut high) = (at(k as u32), at(k as u32 + 1));
                let sign = values[k];
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if above(middle) * sign > 0.0 { low = middle } else { high = middle }
                }
                low
            });
            match (found, wanted) {
                (Pick::Hit(hit), wanted) => {
                    // It is on the ray and on T, whatever steps find.
                    let place = globe.place(hit.x, hit.y, lift[1] * hit.height + lift[0]);
                    let off = (0..3).map(|axis| (eye[axis] + hit.t * way[axis] - place[axis]).abs()).fold(0.0, f64::max);
                    prop_assert!(off < 1e-9, "{off} {hit:?}");
                    let own = height(&field, is_closed, hit.row, hit.column);
                    prop_assert!(own.is_nan() || (own - hit.height).abs() < 1e-9, "{own} {hit:?}");
                    let is_row = hit.samples.iter().all(|(row, column, height)| {
                        *row < rows && *column < columns && field.stored[(row * columns + column) as usize] == *height
                    });
                    prop_assert!(is_row);
                    if let Some(t) = wanted {
                        prop_assert!(hit.t <= t + 1e-8, "{} behind {t}", hit.t);
                    }
                }
                (other, Some(t)) => prop_assert!(false, "{other:?}, and steps find {t}"),
                (_, None) => {}
            }
        }
    }
}

/// From aside as from above, also where the field is far from level.
#[test]
fn picks_through_a_hole_of_a_globe_are_in_it() {
    let (columns, rows, origin, step) = (81, 61, [-20.0, 15.0], [0.5, -0.5]);
    let height = |column: f64| 0.01 + 0.002 * column;
    let is_open = |row: u64, column: u64| (20..30).contains(&row) && (50..64).contains(&column);
    let mut field = field(columns, rows, origin, step, 0.0, 1);
    for (n, stored) in (0_u64..).zip(&mut field.stored) {
        let (row, column) = (n / columns, n % columns);
        *stored = if is_open(row, column) { f64::NAN } else { height(column as f64) };
    }
    let globe = Globe::sphere(1.0);
    let spread = Spread::new(globe, &field.grid, [0.0, 1.0]);
    let pyramid = Pyramid::read(&field).unwrap();
    for [longitude, latitude, up] in [[-20.0, 0.0, 1.0], [0.0, 10.0, 3.0], [30.0, 5.0, 1.5], [5.0, -35.0, 1.2]] {
        let eye = globe.place(longitude, latitude, up);
        for (row, column) in (21..29).flat_map(|row| (51..63).map(move |column| (f64::from(row), f64::from(column)))) {
            let to = globe.place(origin[0] + column * step[0], origin[1] + row * step[1], height(column));
            let way: [f64; 3] = std::array::from_fn(|axis| to[axis] - eye[axis]);
            let found = pick_on_globe(&mut &pyramid, &spread, &Ray::new(eye, way)).unwrap();
            let Pick::NotMeasured { row: down, column: right, .. } = found else {
                panic!("{found:?} from {eye:?} at {row}, {column}")
            };
            let is_in = (19.0..=30.0).contains(&down) && (49.0..=64.0).contains(&right);
            assert!(is_in, "{down}, {right} from {eye:?} at {row}, {column}");
        }
    }
}
