//! The ray caster against every triangle one by one.

use crate::measure::{Hit, Pick, Pyramid, Ray, Rise, cast, cast_all, pick};
use crate::model::{Cell, HeightField};
use proptest::prelude::*;

/// Random numbers from 0 to 1 of a seed.
pub fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A field of random heights, of which a share was not measured.
pub fn noisy(columns: u64, rows: u64, holes: f64, seed: u64) -> HeightField {
    let mut next = random(seed);
    let heights = (0..columns * rows).map(|_| if next() < holes { f64::NAN } else { next() - 0.5 }).collect();
    HeightField::of(columns, rows, heights)
}

type Triangles = Vec<([(u64, u64, f64); 3], [[f64; 3]; 3])>;

fn triangles(field: &HeightField, rise: Rise) -> Triangles {
    let grid = &field.grid;
    let mut found = Vec::new();
    for row in 0..grid.rows - 1 {
        for column in 0..grid.columns - 1 {
            let at = |corner: usize| {
                let (row, column) = (row + corner as u64 / 2, column + corner as u64 % 2);
                (row, column, field.stored[(row * grid.columns + column) as usize])
            };
            let cell = Cell([0, 1, 2, 3].map(|corner| at(corner).2));
            for triangle in cell.triangles() {
                let samples = triangle.corners.map(at);
                let places = samples.map(|(row, column, height)| {
                    let [x, y] = grid.place(row as f64, column as f64);
                    [x, y, rise.world(height)]
                });
                found.push((samples, places));
            }
        }
    }
    found
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The nearest triangle by Möller and Trumbore's test, and the least barycentric coordinate there.
fn brute(all: &Triangles, ray: &Ray) -> Option<(f64, f64, [(u64, u64, f64); 3])> {
    let mut best: Option<(f64, f64, [(u64, u64, f64); 3])> = None;
    for (samples, [p, q, r]) in all {
        let (u, v, s) = (minus(*q, *p), minus(*r, *p), minus(ray.origin, *p));
        let h = cross(ray.direction, v);
        let (k, g) = (dot(h, u), cross(s, u));
        let (a, b, t) = (dot(s, h) / k, dot(ray.direction, g) / k, dot(g, v) / k);
        let least = a.min(b).min(1.0 - a - b);
        if least >= 0.0 && t >= ray.part[0] && t <= ray.part[1] && best.is_none_or(|found| t < found.0) {
            best = Some((t, least, *samples));
        }
    }
    best
}

/// A ray is decided where no triangle's edge is near it: else a neighbour may be right as well.
fn same(found: Option<Hit>, wanted: Option<(f64, f64, [(u64, u64, f64); 3])>, reach: f64) -> bool {
    match (found, wanted) {
        (Some(hit), Some((t, _, samples))) => hit.samples == samples && (hit.t - t).abs() <= 1e-8 * reach,
        (None, None) => true,
        _ => false,
    }
}

/// Whether the ray, tilted a little in several ways, still meets the same: what is beside an edge by rounding alone is not decided.
fn is_decided(all: &Triangles, ray: &Ray, size: f64) -> bool {
    let first = brute(all, ray).map(|found| found.2);
    let length = dot(ray.direction, ray.direction).sqrt();
    (0..6).all(|way| {
        let mut other = *ray;
        let by = if way % 2 == 0 { 1e-7 } else { -1e-7 };
        other.origin[way / 2] += by * size;
        other.direction[(way / 2 + 1) % 3] += 1e-7 * by.signum() * length;
        brute(all, &other).map(|found| found.2) == first
    })
}

fn check(field: &HeightField, rays: &[Ray], rise: Rise, size: f64) -> (usize, usize) {
    let pyramid = Pyramid::read(field).unwrap();
    let all = triangles(field, rise);
    let (mut hits, mut open) = (0, 0);
    for ray in rays {
        let found = cast(&mut &pyramid, rise, ray).unwrap();
        let wanted = brute(&all, ray);
        let reach = wanted.map_or(1.0, |(t, ..)| t.abs().max(size / dot(ray.direction, ray.direction).sqrt()));
        hits += usize::from(found.is_some());
        if !same(found, wanted, reach) {
            open += 1;
            assert!(!is_decided(&all, ray, size), "{ray:?}: {found:?}, not {wanted:?}");
        }
        if let Some(hit) = found {
            let world = rise.world(hit.height);
            let [x, y, z] = ray.at(hit.t);
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (size + a.abs());
            assert!(near(x, hit.x) && near(y, hit.y), "{hit:?} at {x}, {y}");
            assert!((z - world).abs() <= 1e-7 * (size + z.abs()), "{hit:?} at {z}, not {world}");
        }
    }
    (hits, open)
}

/// Rays from all around: from far, from near, from below, upright, along lines and diagonals of the grid, and aimed at samples.
pub fn rays(field: &HeightField, rise: Rise, count: usize, seed: u64) -> Vec<Ray> {
    let mut next = random(seed);
    let grid = &field.grid;
    let (columns, rows) = ((grid.columns - 1) as f64, (grid.rows - 1) as f64);
    let heights: Vec<f64> =
        field.stored.iter().copied().filter(|height| !height.is_nan()).map(|height| rise.world(height)).collect();
    let (low, high) = heights
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), height| (low.min(*height), high.max(*height)));
    let span = high - low;
    (0..count)
        .map(|number| {
            let mut inside = |on_lines: bool| {
                let [mut row, mut column] = [next() * rows, next() * columns];
                if on_lines {
                    (row, column) = (row.round(), column.round());
                }
                let [x, y] = grid.place(row, column);
                [x, y, low + next() * span]
            };
            let target = inside(number % 3 == 0);
            let mut eye = inside(number % 5 == 0);
            match number % 8 {
                0 => eye[2] = high + 3.0 * span,
                1 => eye[2] = low - 2.0 * span,
                2 => eye[2] = high + 0.01 * span,
                3 => (eye[0], eye[1]) = (target[0], target[1]),
                4 => eye[0] = target[0],
                5 => eye[1] = target[1],
                6 => {
                    // Along the diagonals of the cells.
                    eye[0] = target[0] + 3.0 * grid.step[0];
                    eye[1] = target[1] + 3.0 * grid.step[1];
                }
                _ => {
                    eye[0] += 4.0 * columns * grid.step[0];
                    eye[2] += 2.0 * span;
                }
            }
            if number % 8 == 3 {
                eye[2] = if number % 16 == 3 { high + span } else { low - span };
            }
            Ray::new(eye, minus(target, eye))
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn rays_meet_the_triangle_that_brute_force_finds(
        columns in 2_u64..40, rows in 2_u64..40, holes in prop_oneof![Just(0.0), Just(0.3), Just(0.7)], seed in any::<u64>(),
        exaggeration in prop_oneof![Just(1.0), Just(10.0), Just(-2.0)],
        steps in prop_oneof![Just([1.0, 1.0]), Just([0.7, -0.7]), Just([-1.0, 100.0])],
    ) {
        let mut field = noisy(columns, rows, holes, seed);
        field.grid.step = steps;
        field.grid.origin = [3.25, -2.0];
        prop_assume!(field.stored.iter().any(|height| !height.is_nan()));
        let rise = Rise::new(&field.grid, exaggeration, 0.3);
        let size = columns.max(rows) as f64 * steps[0].abs().max(steps[1].abs());
        check(&field, &rays(&field, rise, 240, seed ^ 5), rise, size);
    }
}

#[test]
fn large_smooth_fields_steps_and_spikes() {
    let (columns, rows) = (150_u64, 110_u64);
    let make = |f: &dyn Fn(f64, f64) -> f64| {
        let heights = (0..columns * rows).map(|n| f((n / columns) as f64, (n % columns) as f64)).collect();
        HeightField::of(columns, rows, heights)
    };
    let fields = [
        make(&|r, c| 5.0 * (0.2 * r).sin() * (0.15 * c).sin()),
        make(&|_, c| if c < 50.0 { 0.0 } else { 1000.0 }),
        make(&|r, c| if (r, c) == (30.0, 77.0) { 1e6 } else { 0.0 }),
        make(&|r, c| 0.2 * r + 0.1 * c),
    ];
    let mut total = 0;
    for (number, field) in fields.iter().enumerate() {
        let rise = Rise::new(&field.grid, 1.0, 0.0);
        let (hits, open) = check(field, &rays(field, rise, 600, number as u64 + 1), rise, 150.0);
        assert!(open <= 60, "{open} of 600 rays on edges");
        total += hits;
    }
    assert!(total > 1200, "{total} hits");
}

#[test]
fn tiny_heights_far_out() {
    let (columns, rows) = (60_u64, 50_u64);
    let heights = (0..columns * rows)
        .map(|n| 1e-9 * (0.3 * (n / columns) as f64).sin() * (0.2 * (n % columns) as f64).cos())
        .collect();
    let mut field = HeightField::of(columns, rows, heights);
    (field.grid.origin, field.grid.step) = ([5e6, 5e6], [1.0, -1.0]);
    let pyramid = Pyramid::read(&field).unwrap();
    let rise = Rise::new(&field.grid, 1.0, 0.0);
    let mut next = random(4);
    for _ in 0..500 {
        let (row, column) = (next() * 49.0, next() * 59.0);
        let [x, y] = field.grid.place(row, column);
        let eye = [5e6 + 200.0 * (next() - 0.5), 5e6 + 200.0 * (next() - 0.5), 60.0];
        let hit = cast(&mut &pyramid, rise, &Ray::new(eye, minus([x, y, 0.0], eye))).unwrap().unwrap();
        assert!((hit.row - row).abs() < 1e-8 && (hit.column - column).abs() < 1e-8, "{hit:?}, not {row} {column}");
        let cell = pyramid_cell(&field, hit.row, hit.column);
        assert!((hit.height - cell).abs() < 1e-16, "{hit:?}, not {cell}");
    }
}

fn pyramid_cell(field: &HeightField, row: f64, column: f64) -> f64 {
    let first = (row.floor() as u64 * field.grid.columns + column.floor() as u64) as usize;
    let columns = field.grid.columns as usize;
    Cell([first, first + 1, first + columns, first + columns + 1].map(|n| field.stored[n]))
        .height(column.fract(), row.fract())
}

#[test]
fn nothing_slips_through_samples_edges_and_diagonals() {
    // Every ray aimed at a sample, an edge's middle or a diagonal's middle of a closed field from above meets it.
    let field = noisy(33, 29, 0.0, 9);
    let pyramid = Pyramid::read(&field).unwrap();
    let rise = Rise::new(&field.grid, 1.0, 0.0);
    let mut next = random(8);
    for twice_row in 0..=56_u64 {
        for twice_column in 0..=64_u64 {
            let target = [twice_column as f64 / 2.0, twice_row as f64 / 2.0, -5.0];
            let eye = [target[0].round(), target[1].round(), 9.0];
            for eye in [eye, [target[0], target[1], 9.0], [16.0 + next(), 14.0 + next(), 40.0]] {
                let mut direction = minus(target, eye);
                direction[2] = -9.0 - eye[2];
                let found = cast(&mut &pyramid, rise, &Ray::new(eye, direction)).unwrap();
                assert!(found.is_some(), "{eye:?} {direction:?}");
            }
        }
    }
}

#[test]
fn odd_rays_meet_nothing_and_end() {
    let field = noisy(9, 9, 0.2, 2);
    let pyramid = Pyramid::read(&field).unwrap();
    let odd = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        4.0,
        1e-320,
        -1e-210,
        1e300,
        -1e300,
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MIN_POSITIVE,
    ];
    let mut next = random(3);
    let mut any = || odd[(next() * odd.len() as f64) as usize];
    for _ in 0..20_000 {
        let ray = Ray { origin: [any(), any(), any()], direction: [any(), any(), any()], part: [any(), any()] };
        for rise in [Rise { zero: 0.0, lift: 1.0 }, Rise { zero: 0.3, lift: 0.0 }, Rise { zero: any(), lift: any() }] {
            let _ = pick(&mut &pyramid, rise, &ray).unwrap();
        }
    }
}

#[test]
fn picks_tell_holes_from_what_is_beside() {
    let mut field = noisy(8, 6, 0.0, 4);
    for n in [9, 10, 11, 17, 18, 19, 25, 26, 27] {
        field.stored[n] = f64::NAN;
    }
    let pyramid = Pyramid::read(&field).unwrap();
    let rise = Rise::new(&field.grid, 1.0, 0.0);
    let down = |x: f64, y: f64| pick(&mut &pyramid, rise, &Ray::new([x, y, 50.0], [0.0, 0.0, -1.0])).unwrap();
    assert_eq!(down(2.0, 2.5), Pick::NotMeasured { row: 2.5, column: 2.0, x: 2.0, y: 2.5 });
    assert_eq!(down(-1e-9, 2.5), Pick::Beside);
    assert_eq!(down(3.0, 5.000_000_1), Pick::Beside);
    let Pick::Hit(hit) = down(6.25, 4.5) else { panic!("no hit") };
    assert_eq!((hit.row, hit.column), (4.5, 6.25));
    let alone = HeightField::of(2, 2, vec![1.0, f64::NAN, f64::NAN, f64::NAN]);
    let alone = Pyramid::read(&alone).unwrap();
    let found = pick(&mut &alone, rise, &Ray::new([0.5, 0.5, 9.0], [0.0, 0.0, -1.0])).unwrap();
    assert!(matches!(found, Pick::NotMeasured { .. }));
}

/// From aside as from above, also where the field is far from level.
#[test]
fn picks_through_a_hole_are_in_it() {
    let (columns, rows) = (161, 121);
    let height = |x: f64, y: f64| 0.25 * x - 0.125 * y + 3.0;
    let is_open = |row: u64, column: u64| (30..50).contains(&row) && (100..120).contains(&column);
    let sample =
        |row: u64, column: u64| if is_open(row, column) { f64::NAN } else { height(column as f64, row as f64) };
    let heights = (0..rows).flat_map(|row| (0..columns).map(move |column| sample(row, column))).collect();
    let field = HeightField::of(columns, rows, heights);
    let pyramid = Pyramid::read(&field).unwrap();
    let rise = Rise::new(&field.grid, 1.0, 0.0);
    for eye in [[80.0, -90.0, 120.0], [110.0, -200.0, 150.0], [80.0, -60.0, 60.0], [80.0, 60.0, 200.0]] {
        for (x, y) in (32..48).flat_map(|y| (102..118).map(move |x| (f64::from(x), f64::from(y)))) {
            let ray = Ray::new(eye, minus([x, y, height(x, y)], eye));
            let Pick::NotMeasured { x: right, y: up, .. } = pick(&mut &pyramid, rise, &ray).unwrap() else {
                panic!("a hit from {eye:?} at {x}, {y}")
            };
            let is_in = (99.0..=120.0).contains(&right) && (29.0..=50.0).contains(&up);
            assert!(is_in, "{right}, {up} from {eye:?} at {x}, {y}");
        }
    }
}

#[test]
fn many_rays_are_those_cast_one_by_one() {
    let field = noisy(50, 40, 0.1, 7);
    let rise = Rise::new(&field.grid, 2.0, 0.0);
    let all = rays(&field, rise, 1500, 6);
    let pyramid = Pyramid::read(&field).unwrap();
    let mut out = vec![None; all.len()];
    cast_all(|| &pyramid, rise, |number| all[number], &mut out).unwrap();
    for (ray, hit) in all.iter().zip(&out) {
        assert_eq!(cast(&mut &pyramid, rise, ray).unwrap(), *hit);
    }
}
