//! Numbers of ISO 25178-2 and forms against formulas and against sums over T one by one.

use super::rays::random;
use super::truth::{assert_near, cell, of, sines, with_holes};
use crate::measure::material::Curve;
use crate::measure::{
    FormError, FormKind, Iso, Material, Part, Residual, Roughness, correlation, fit, material_ratio, roughness,
};
use crate::model::{HeightField, Heights, Window};
use deepfield_data::model::Unit;
use std::f64::consts::PI;

fn is_near(found: Option<f64>, wanted: f64, relative: f64, what: &str) {
    assert_near(found.unwrap(), wanted, relative, what);
}

/// Means over measured samples and over triangles, in the simplest way.
fn plain(field: &HeightField, ratio: f64) -> [f64; 9] {
    let heights: Vec<f64> = field.stored.iter().copied().filter(|height| !height.is_nan()).collect();
    let count = heights.len() as f64;
    let mean = heights.iter().sum::<f64>() / count;
    let moment = |power: i32| heights.iter().map(|height| (height - mean).powi(power)).sum::<f64>() / count;
    let (low, high) =
        heights.iter().fold((f64::MAX, f64::MIN), |(low, high), height| (low.min(*height), high.max(*height)));
    let (mut triangles, mut slopes, mut areas) = (0.0, 0.0, 0.0);
    for row in 0..field.grid.rows - 1 {
        for column in 0..field.grid.columns - 1 {
            for triangle in cell(field, row, column).triangles() {
                let (p, q) = (ratio * triangle.at[1] / field.grid.step[0], ratio * triangle.at[2] / field.grid.step[1]);
                triangles += 1.0;
                slopes += p * p + q * q;
                areas += (1.0 + p * p + q * q).sqrt() - 1.0;
            }
        }
    }
    let sq = moment(2).sqrt();
    let sa = heights.iter().map(|height| (height - mean).abs()).sum::<f64>() / count;
    [
        sa,
        sq,
        moment(3) / sq.powi(3),
        moment(4) / sq.powi(4),
        high - mean,
        mean - low,
        high - low,
        (slopes / triangles).sqrt(),
        100.0 * areas / triangles,
    ]
}

fn told(iso: &Iso) -> [f64; 9] {
    [iso.sa, iso.sq, iso.ssk, iso.sku, iso.sp, iso.sv, iso.sz, iso.sdq, iso.sdr].map(Option::unwrap)
}

#[test]
fn numbers_of_sines_are_those_of_formulas() {
    let (amplitude, k) = (20.0, 2.0 * PI / 64.0);
    let found = roughness(&sines(512, 512, 64.0, amplitude)).unwrap();
    let iso = found.iso;
    is_near(iso.sq, amplitude / 2.0, 1e-12, "Sq");
    is_near(iso.sa, 4.0 * amplitude / (PI * PI), 2e-3, "Sa");
    is_near(iso.sku, 2.25, 1e-12, "Sku");
    is_near(iso.ssk, 0.0, 1e-12, "Ssk");
    is_near(iso.sz, 2.0 * amplitude, 1e-12, "Sz");
    is_near(iso.sdq, amplitude * k / 2.0_f64.sqrt(), 2e-3, "Sdq");
    is_near(iso.sal, 1.3694 / k, 0.02, "Sal");
    is_near(iso.str, 0.8747, 0.02, "Str");
    assert_eq!((found.samples, found.valid, found.valid_share), (512 * 512, 512 * 512, 1.0));
    assert_near(found.area, 511.0 * 511.0, 1e-14, "area");
}

#[test]
fn numbers_of_rough_fields_with_holes_are_those_of_plain_sums() {
    for (seed, share) in [(1, 0.0), (2, 0.3), (3, 0.8)] {
        let mut field = with_holes(sines(333, 1100, 41.0, 3.0), share, seed);
        let mut next = random(seed + 7);
        field.stored.iter_mut().for_each(|height| *height += 100.0 + next());
        (field.grid.step, field.grid.xy_unit, field.grid.height_unit) =
            ([0.25, -0.5], Unit::new("mm"), Unit::new("um"));
        let found = roughness(&field).unwrap();
        let names = ["Sa", "Sq", "Ssk", "Sku", "Sp", "Sv", "Sz", "Sdq", "Sdr"];
        for ((found, wanted), name) in told(&found.iso).into_iter().zip(plain(&field, 1e-3)).zip(names) {
            assert_near(found, wanted, 1e-9, name);
        }
        let valid = field.stored.iter().filter(|height| !height.is_nan()).count();
        assert_eq!(found.valid_share, valid as f64 / field.stored.len() as f64);
        // One and many threads add up the same.
        let one =
            rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| roughness(&field).unwrap());
        assert_eq!(one, found);
    }
}

#[test]
fn holes_at_random_change_little() {
    let found = roughness(&with_holes(sines(512, 512, 64.0, 20.0), 0.2, 5)).unwrap();
    is_near(found.iso.sq, 10.0, 1e-2, "Sq");
    is_near(found.iso.sal, 1.3694 * 64.0 / (2.0 * PI), 0.02, "Sal");
    is_near(found.iso.str, 0.8747, 0.02, "Str");
}

#[test]
fn correlation_is_that_of_pairs() {
    let field = with_holes(sines(37, 29, 11.0, 2.0), 0.3, 9);
    let mean = 0.1;
    let found = correlation(&field, mean, 2.0).unwrap().unwrap();
    let pairs = |columns: i64, rows: i64| {
        let (mut sum, mut count) = (0.0, 0.0);
        for row in 0..29_i64 {
            for column in 0..37_i64 {
                let (r, c) = (row + rows, column + columns);
                if (0..29).contains(&r) && (0..37).contains(&c) {
                    let product = (field.stored[(row * 37 + column) as usize] - mean)
                        * (field.stored[(r * 37 + c) as usize] - mean);
                    if !product.is_nan() {
                        (sum, count) = (sum + product, count + 1.0);
                    }
                }
            }
        }
        sum / count
    };
    for (columns, rows) in [(0, 0), (1, 0), (0, 1), (-18, 14), (18, 14), (5, -7), (-3, 9), (18, 0)] {
        let wanted = pairs(columns, rows) / pairs(0, 0);
        assert_near(found.at(columns as f64, rows as f64).unwrap(), wanted, 1e-5, "correlation");
    }
    assert_eq!(found.at(18.5, 0.0), None);
    assert_eq!(found.at(0.0, 14.1), None);
}

#[test]
fn the_core_of_a_curve_of_straight_parts() {
    // A tenth falls from 10 to 5, four fifths from 5 to 3, a tenth from 3 to 0.
    let curve = |share: f64| match share {
        share if share < 0.1 => 10.0 - 50.0 * share,
        share if share < 0.9 => 5.0 - 2.5 * (share - 0.1),
        share => 3.0 - 30.0 * (share - 0.9),
    };
    let wanted = |field: &HeightField, relative: f64| {
        let found = material(field);
        assert_near(found.sk, 2.5, relative, "Sk");
        assert_near(found.smr1, 9.5, relative, "Smr1");
        assert_near(found.smr2, 100.0 * (0.9 + 0.25 / 30.0), relative, "Smr2");
        assert_near(found.spk, 4.75, relative, "Spk");
        assert_near(found.svk, 2.75, relative, "Svk");
    };
    wanted(&of(200, 200, |row, column| curve(((row * 200.0 + column) * 7919.0 % 40000.0 + 0.5) / 40000.0)), 2e-4);
    // More than are sorted, and with one height far out.
    let count = 1100.0 * 1100.0;
    let mut large = of(1100, 1100, |row, column| curve(((row * 1100.0 + column) * 7919.0 % count + 0.5) / count));
    wanted(&large, 2e-4);
    large.stored[77] = 1e6;
    let spiked = material(&large);
    assert_near(spiked.sk, 2.5, 1e-3, "Sk");
    assert_near(spiked.svk, 2.75, 1e-3, "Svk");
    let ramp = material(&of(512, 512, |_, column| column / 512.0));
    assert_near(ramp.sk, 1.0, 2e-3, "Sk");
    assert_near(ramp.spk, 0.0, 1e-3, "Spk");
    assert_near(ramp.svk, 0.0, 1e-3, "Svk");
}

/// Above the height that is told for a share of the samples is that share of them, with as many as are sorted and with more.
#[test]
fn curves_part_samples_by_their_heights() {
    for (side, slack) in [(200, 1.0), (1250, 20.0)] {
        let even = |row: f64, column: f64| (0.618_033_988_749 * row + 0.324_717_957_245 * column).fract();
        let field = with_holes(of(side, side, even), 0.3, 4);
        let mut sorted: Vec<f64> = field.stored.iter().copied().filter(|height| !height.is_nan()).collect();
        sorted.sort_unstable_by(|a, b| b.total_cmp(a));
        let (samples, valid) = (field.grid.samples(), sorted.len() as u64);
        let iso = Iso { sp: sorted.first().copied(), sv: sorted.last().map(|lowest| -lowest), ..Iso::default() };
        let found = Roughness { samples, valid, valid_share: 0.7, mean: Some(0.0), area: 0.0, iso };
        let curve = material_ratio(&field, &found).unwrap();
        assert_eq!(curve.len(), 101);
        for [percent, height] in curve {
            let (above, wanted) =
                (sorted.partition_point(|other| *other > height), percent / 100.0 * found.valid as f64);
            assert!((above as f64 - wanted).abs() <= slack + 0.5, "{percent} % at {height}: {above} of {wanted}");
        }
    }
    let none = HeightField::of(3, 3, vec![f64::NAN; 9]);
    assert!(material_ratio(&none, &roughness(&none).unwrap()).unwrap().is_empty());
}

fn material(field: &HeightField) -> Material {
    let heights = field.stored.iter().copied();
    let range = heights.fold([f64::MAX, f64::MIN], |[low, high], height| [low.min(height), high.max(height)]);
    Curve::read(field, range, field.stored.len() as u64).unwrap().material().unwrap()
}

#[test]
fn fields_without_relief_or_samples_have_no_such_numbers() {
    let level = roughness(&of(9, 9, |_, _| 3.0)).unwrap();
    assert_eq!(
        (level.iso.sq, level.iso.sz, level.iso.ssk, level.iso.sk, level.iso.sal),
        (Some(0.0), Some(0.0), None, None, None)
    );
    let none = roughness(&of(9, 9, |_, _| f64::NAN)).unwrap();
    assert_eq!((none.valid, none.iso), (0, Iso::default()));
    assert!(matches!(fit(&of(9, 9, |_, _| f64::NAN), FormKind::Plane), Err(FormError::Undetermined { valid: 0, .. })));
    let line = of(9, 9, |row, _| if row == 2.0 { 1.0 } else { f64::NAN });
    for kind in [FormKind::Plane, FormKind::Quadric, FormKind::Sphere, FormKind::Cylinder, FormKind::Polynomial(4)] {
        assert!(fit(&line, kind).is_err(), "{kind}");
    }
    let far = roughness(&of(40, 40, |row, column| if (row + column) % 2.0 == 0.0 { 1e300 } else { -1e300 })).unwrap();
    is_near(far.iso.sku, 1.0, 1e-12, "Sku");
}

#[test]
fn planes_are_found_and_taken_off() {
    let waves = sines(512, 512, 64.0, 20.0);
    let own = roughness(&waves).unwrap();
    let mut tilted = waves.clone();
    tilted
        .stored
        .iter_mut()
        .enumerate()
        .for_each(|(n, height)| *height += 3.0 + 0.01 * (n % 512) as f64 - 0.02 * (n / 512) as f64);
    let form = fit(&tilted, FormKind::Plane).unwrap();
    let found = form.numbers().coefficients.unwrap();
    for (found, wanted) in found.iter().zip([3.0, 0.01, -0.02]) {
        assert!((found - wanted).abs() < 1e-12, "{found}, not {wanted}");
    }
    let flat = roughness(&Residual::new(&tilted, form)).unwrap();
    for (found, wanted) in told(&flat.iso).into_iter().zip(told(&own.iso)) {
        assert_near(found, wanted, 1e-9, "without the plane");
    }
    assert_near(flat.iso.sk.unwrap(), own.iso.sk.unwrap(), 1e-9, "Sk");
}

#[test]
fn polynomials_are_found_far_from_the_origin() {
    let mut field = with_holes(of(80, 60, |_, _| 0.0), 0.2, 3);
    (field.grid.origin, field.grid.step) = ([40.0, -7.0], [0.1, -0.3]);
    let grid = field.grid.clone();
    let formula = |x: f64, y: f64| 2.0 - 0.5 * x + 0.25 * y + 0.125 * x * x - 0.0625 * x * y + 0.5 * y * y;
    for (n, height) in field.stored.iter_mut().enumerate() {
        let [x, y] = grid.place((n / 80) as f64, (n % 80) as f64);
        *height += formula(x, y);
    }
    let quadric = fit(&field, FormKind::Quadric).unwrap();
    for (found, wanted) in quadric.numbers().coefficients.unwrap().iter().zip([2.0, -0.5, 0.25, 0.125, -0.0625, 0.5]) {
        assert_near(*found, wanted, 1e-9, "coefficient");
    }
    let cubic = |x: f64, y: f64| formula(x, y) + 1e-3 * x * x * x - 2e-3 * x * y * y;
    for (n, height) in field.stored.iter_mut().enumerate().filter(|(_, height)| !height.is_nan()) {
        let [x, y] = grid.place((n / 80) as f64, (n % 80) as f64);
        *height = cubic(x, y);
    }
    let form = fit(&field, FormKind::Polynomial(7)).unwrap();
    let numbers = form.numbers();
    assert_eq!(numbers.coefficients.as_ref().unwrap().len(), 36);
    let [x0, y0] = numbers.about.unwrap();
    for [x, y] in [[41.0, -9.5], [47.3, -20.0], [40.0, -7.0]] {
        assert_near(form.height([x, y]), cubic(x, y), 1e-11, "height");
        let powers = (0..=7).flat_map(|total| (0..=total).map(move |j| (total - j, j)));
        let sum: f64 = numbers
            .coefficients
            .as_ref()
            .unwrap()
            .iter()
            .zip(powers)
            .map(|(factor, (i, j))| factor * (x - x0).powi(i) * (y - y0).powi(j))
            .sum();
        assert_near(sum, cubic(x, y), 1e-9, "told");
    }
    let mut left = vec![0.0; 80 * 60];
    Residual::new(&field, form).heights(Window::all(&field.grid), &mut left).unwrap();
    assert!(left.iter().all(|height| height.is_nan() || height.abs() < 1e-9));
}

#[test]
fn spheres_and_cylinders_are_found() {
    let ball = of(256, 200, |row, column| (1e6 - (column - 250.0).powi(2) - (row - 260.0).powi(2)).sqrt() - 900.0);
    let form = fit(&ball, FormKind::Sphere).unwrap();
    let numbers = form.numbers();
    is_near(numbers.radius, 1000.0, 1e-9, "radius");
    for (found, wanted) in numbers.center.unwrap().into_iter().zip([250.0, 260.0, -900.0]) {
        assert_near(found, wanted, 1e-8, "center");
    }
    assert!(roughness(&Residual::new(&ball, form)).unwrap().iso.sz.unwrap() < 1e-9);
    // A hollow one, far from its bottom, noisy, in other units and with holes.
    let mut next = random(6);
    let mut bowl = with_holes(
        of(200, 160, |row, column| {
            let (x, y) = (0.5 * column + 30.0, 0.25 * row - 70.0);
            1000.0 * (60.0 - (150.0_f64.powi(2) - (x - 20.0).powi(2) - (y + 60.0).powi(2)).sqrt())
                + 0.1 * (next() - 0.5)
        }),
        0.2,
        4,
    );
    (bowl.grid.origin, bowl.grid.step) = ([30.0, -70.0], [0.5, 0.25]);
    (bowl.grid.xy_unit, bowl.grid.height_unit) = (Unit::new("mm"), Unit::new("um"));
    let numbers = fit(&bowl, FormKind::Sphere).unwrap().numbers();
    is_near(numbers.radius, 150.0, 1e-5, "radius");
    for (found, wanted) in numbers.center.unwrap().into_iter().zip([20.0, -60.0, 60e3]) {
        assert_near(found, wanted, 1e-4, "center");
    }
    // A cylinder whose axis rises, across the grid.
    let length = (1.0_f64 + 0.7 * 0.7 + 0.1 * 0.1).sqrt();
    let axis = [1.0, 0.7, 0.1].map(|part| part / length);
    let point = [100.0, 90.0, -280.0];
    let pipe = of(220, 180, |row, column| {
        // |q - (q.a) a| = 300 solved for height.
        let (x, y) = (column - point[0], row - point[1]);
        let (a, along) = (1.0 - axis[2] * axis[2], axis[0] * x + axis[1] * y);
        let (b, c) = (-axis[2] * along, x * x + y * y - along * along - 300.0 * 300.0);
        point[2] + (-b + (b * b - a * c).sqrt()) / a
    });
    let form = fit(&pipe, FormKind::Cylinder).unwrap();
    let numbers = form.numbers();
    is_near(numbers.radius, 300.0, 1e-8, "radius");
    let turned = numbers.axis.unwrap();
    let dot: f64 = turned.iter().zip(axis).map(|(a, b)| a * b).sum();
    assert_near(dot.abs(), 1.0, 1e-12, "axis");
    let off: Vec<f64> = (0..3).map(|k| numbers.center.unwrap()[k] - point[k]).collect();
    let along: f64 = off.iter().zip(axis).map(|(a, b)| a * b).sum();
    assert!((0..3).all(|k| (off[k] - along * axis[k]).abs() < 1e-6), "{off:?}");
    assert!(roughness(&Residual::new(&pipe, form)).unwrap().iso.sz.unwrap() < 1e-8);
    // A plane is a sphere of no bend.
    let plane = fit(&of(50, 50, |row, column| 0.2 * row - 0.1 * column), FormKind::Sphere).unwrap();
    assert_near(plane.height([10.0, 30.0]), 5.0, 1e-9, "plane");
}

#[test]
fn numbers_of_a_part_are_those_of_the_part_alone() {
    let field = with_holes(sines(200, 150, 32.0, 4.0), 0.1, 8);
    let part = Part::of_window(&field, Window { row: 20, column: 30, rows: 64, columns: 96 }).unwrap();
    let mut own = vec![0.0; 64 * 96];
    part.heights(Window::all(part.grid()), &mut own).unwrap();
    let found = roughness(&part).unwrap();
    assert_eq!(found, roughness(&HeightField::of(96, 64, own)).unwrap());
}
