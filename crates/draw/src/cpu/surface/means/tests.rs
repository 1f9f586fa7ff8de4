//! The pyramid, its rule and its pictures, against brute force.

use super::super::look::Light;
use super::super::memory::MemorySurface;
use super::super::placed::Map;
use super::super::select::Coarse;
use super::super::tests::{Random, hills, placed};
use super::*;
use crate::color::TransferFunction;
use crate::view::Projection;
use deepfield_heights::model::HeightField;
use proptest::prelude::*;

/// Samples of full resolution with random heights, normals, a plane and changes, of which a share was not measured.
fn samples(rows: usize, columns: usize, open: f64, random: &mut Random) -> NodeSamples {
    let count = rows * columns;
    let heights = (0..count).map(|_| match random.between(0.0, 1.0) < open {
        true => f64::NAN,
        false => random.between(-90.0, 90.0),
    });
    let heights = SampleHeights::of(heights.collect());
    let normal = |random: &mut Random| MeanNormal::new([random.between(-0.6, 0.6) as f32, 0.3, 0.7]);
    let normals = SampleNormals::Parts((0..count).map(|_| normal(random)).collect());
    let mut singles = || (0..count).map(|_| random.between(0.0, 1.0) as f32).collect::<Vec<f32>>();
    let (planes, changes) = (vec![singles()], singles());
    NodeSamples { rows, columns, heights, normals, planes, changes, ..NodeSamples::default() }
}

proptest! {
    #![proptest_config(crate::cases::cases(64))]

    /// A sample of level k is the mean of the 4^k samples about it, in their middle, and none where one of them is none; `d` is as long as the
    /// longest edge between neighbours would be that has the diagonal's length in plan.
    #[test]
    fn levels_are_means_of_what_they_stand_for(
        rows in 2_usize..40,
        columns in 2_usize..40,
        open in prop::sample::select(vec![0.0, 0.02, 0.3, 1.0]),
        seed in any::<u64>(),
    ) {
        let mut random = Random::new(seed);
        let finest = Arc::new(samples(rows, columns, open, &mut random));
        let mut field = HeightField::of(columns as u64, rows as u64, finest.heights.iter().collect());
        (field.grid.origin, field.grid.step) = ([3.0, -7.0], [0.5, -2.0]);
        let placed = Placed::new(&field.grid, Map::Plate, 3.0, 1.0);
        let levels: Vec<Arc<NodeSamples>> = pyramid(Arc::clone(&finest)).collect();
        prop_assert_eq!(levels.len(), rows.min(columns).ilog2() as usize);
        for (level, own) in levels.iter().enumerate() {
            let side = 1_usize << level;
            prop_assert_eq!([own.rows, own.columns], [rows / side, columns / side]);
            let thinned = placed.thinned([0.5 * (side as f64 - 1.0); 2], side as f64, [own.rows, own.columns]);
            let mut longest = 0.0_f64;
            for (row, column) in (0..own.rows).flat_map(|r| (0..own.columns).map(move |c| (r, c))) {
                let about: Vec<[usize; 2]> =
                    (0..side * side).map(|k| [row * side + k / side, column * side + k % side]).collect();
                let count = about.len() as f64;
                let mean = |value: &dyn Fn(usize) -> f64| {
                    about.iter().map(|[r, c]| value(r * columns + c)).sum::<f64>() / count
                };
                let index = row * own.columns + column;
                let (height, expected) = (own.heights.at(index), mean(&|at| finest.heights.at(at)));
                prop_assert_eq!(height.is_nan(), expected.is_nan());
                prop_assert!(height.is_nan() || (height - expected).abs() < 1e-9);
                prop_assert_eq!(own.coverage_at(index) == u8::MAX, !height.is_nan() || level == 0);
                let normal = own.normals.at(index);
                for (k, part) in normal.into_iter().enumerate() {
                    // Each level rounds.
                    let expected = mean(&|at| f64::from(finest.normals.at(at)[k]));
                    prop_assert!((f64::from(part) - expected).abs() < 2e-5 * (level + 1) as f64);
                }
                prop_assert!((f64::from(own.planes[0][index]) - mean(&|at| finest.planes[0][at].into())).abs() < 1e-5);
                prop_assert!((f64::from(own.changes[index]) - mean(&|at| finest.changes[at].into())).abs() < 1e-5);
                // In the middle of their places.
                let middle = [0, 1].map(|axis| about.iter().map(|at| at[axis] as f64).sum::<f64>() / count);
                let place = placed.world(middle[0], middle[1], 5.0);
                prop_assert!((thinned.world(row as f64, column as f64, 5.0) - place).length() < 1e-9);
                let [x, y] = thinned.file_place(row as f64, column as f64);
                let in_file = placed.file_place(middle[0], middle[1]);
                prop_assert!((x - in_file[0]).abs().max((y - in_file[1]).abs()) < 1e-9);
                let beside = column.max(1) - 1..own.columns.min(column + 2);
                for (r, c) in (row..own.rows.min(row + 2)).flat_map(|r| beside.clone().map(move |c| (r, c))) {
                    longest = longest.max((own.heights.at(r * own.columns + c) - height).abs());
                }
            }
            let diagonal = (thinned.world(0.0, 0.0, 0.0) - thinned.world(1.0, 1.0, 0.0)).length();
            let expected = diagonal.hypot(3.0 * longest);
            let found = placed.apart(level as u8, largest_step(own));
            prop_assert!((found - expected).abs() < 1e-9 * expected, "{} {}", found, expected);
        }
    }
}

#[test]
fn the_coarsest_level_just_below_the_point_size_is_drawn() {
    let finest = Arc::new(samples(65, 65, 0.0, &mut Random::new(4)));
    // Steps of random heights become smaller from level to level; at first they decide, then the diagonal does.
    let placed = placed(&HeightField::of(65, 65, vec![0.0; 65 * 65]));
    let all: Vec<f64> =
        pyramid(Arc::clone(&finest)).zip(0..).map(|(own, k)| placed.apart(k, largest_step(&own))).collect();
    assert!(all[1] < all[0] && all[all.len() - 2] < all[all.len() - 1], "{all:?}");
    for scale in [1e-4, 0.01, 0.02, 0.03, 0.05, 0.1, 1.0] {
        let expected = (1..all.len()).rev().find(|level| scale * all[*level] <= 1.0);
        let found = coarsest(&finest, |level, step| scale * placed.apart(level, step), 1.0);
        assert_eq!(found.map(|(level, _)| usize::from(level)), expected, "{scale}");
    }
    assert!(coarsest(&finest, |_, _| f64::INFINITY, 1e9).is_none());
}

fn options() -> SurfaceOptions {
    let (transfer, light) = (TransferFunction::default(), Light::Eye);
    let look =
        Look { attribute: Attribute::Height, transfer, range: [-80.0, 80.0], light, ambient: 0.5, contours: None };
    SurfaceOptions { coarse: Coarse::Means, look: Some(look), raw: true, ..SurfaceOptions::default() }
}

fn from_above(field: &HeightField, pixels: [u32; 2], high: f64) -> View {
    let target = DVec3::new(0.5 * (field.grid.columns - 1) as f64, 0.5 * (field.grid.rows - 1) as f64, 0.0);
    let projection = Projection::Orthographic { height: high };
    View::look_at(target + DVec3::Z * 500.0, target, DVec3::Y, projection, pixels[0], pixels[1]).unwrap()
}

/// Raw channels have the mean of what a point stands for, in its middle, of whatever level that is, beside rows that chunks share, too; the
/// picture is the same for one thread.
#[test]
fn pictures_show_means_in_their_middle() {
    let mut field = hills(300, 520, 0.0, 3);
    field.stored[90 * 520 + 101] = f64::NAN;
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let mut seen = [0; 8];
    for high in [100.0, 450.0, 900.0, 2000.0, 6000.0] {
        let view = from_above(&field, [110, 80], high);
        let options = SurfaceOptions { samples: 1, ..options() };
        let picture = draw(&source, &placed, &view, &options);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let alone = pool.install(|| draw(&source, &placed, &view, &options));
        assert!(picture.colors == alone.colors && picture.report == alone.report);
        assert!(picture.report.is_converged && picture.report.error_px.is_infinite());
        assert!(picture.colors.rgba.iter().any(|color| color[3] > 0.9));
        for [depth, x, y, height, row, column, coverage] in &picture.raw {
            if depth.is_nan() {
                continue;
            }
            assert!(*coverage == 1.0 && x == column && y == row);
            // Places of level k are halves of a step beside full resolution's, which tells the level of a mean from 1 on.
            let is_of = |level: &i32| {
                let side = f64::from(*level).exp2();
                ((row - 0.5 * (side - 1.0)) / side).fract() == 0.0
            };
            let level = (0..8).find(is_of);
            let is_point = picture.report.points > 0 && picture.report.triangles == 0;
            let Some(level) = level.filter(|_| is_point) else { continue };
            seen[level as usize] += 1;
            let side = 1_usize << level;
            let first = [row, column].map(|at| (at - 0.5 * (side as f64 - 1.0)) as usize);
            let about = (0..side * side).map(|k| field.stored[(first[0] + k / side) * 520 + first[1] + k % side]);
            let mean = about.sum::<f64>() / (side * side) as f64;
            assert!((mean - height).abs() < 1e-9, "level {level} at {row} {column}: {height}, not {mean}");
        }
    }
    assert!(seen.iter().filter(|count| **count > 20).count() >= 3, "{seen:?}");
}

/// Near by holes are those of T. Far away, where each mean would be of a column that was not measured, nothing is left.
#[test]
fn holes_grow_with_distance() {
    let mut field = hills(257, 257, 0.0, 5);
    (0..257 * 257).filter(|index| index % 257 % 16 == 5).for_each(|index| field.stored[index] = f64::NAN);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let covered = |coarse: Coarse, high: f64| {
        let view = from_above(&field, [64, 64], high);
        let options = SurfaceOptions { coarse, raw: false, ..options() };
        super::super::draw(&source, &placed, &Sight::Flat(view), &options).report.covered * (high / 64.0).powi(2)
    };
    let [near, far] = [200.0, 3850.0].map(|high| covered(Coarse::Means, high) / covered(Coarse::Nested, high));
    assert!((0.97..1.03).contains(&near) && far == 0.0, "{near} {far}");
}

/// Where the eye is within a chunk's sphere its triangles are drawn, at full resolution, and points far away.
#[test]
fn what_is_near_is_drawn_as_triangles() {
    let field = hills(257, 1100, 0.0, 6);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let perspective = Projection::Perspective { fov_y: 0.9 };
    let report = |eye: [f64; 3], target: [f64; 3], technique: Technique| {
        let view = View::look_at(eye.into(), target.into(), DVec3::Z, perspective, 60, 40).unwrap();
        let options = SurfaceOptions { technique, samples: 1, raw: false, ..options() };
        draw(&source, &placed, &view, &options).report
    };
    let (inside, far) = ([60.0, 128.0, 5.0], [9000.0, 128.0, 3000.0]);
    let both = report(inside, [1000.0, 128.0, -20.0], Technique::Hybrid);
    assert!(both.triangles > 0 && both.levels[0] == 0, "{both:?}");
    let points = report(far, [500.0, 128.0, 0.0], Technique::Hybrid);
    assert!(points.triangles == 0 && points.points > 0 && points.levels[0] > 0, "{points:?}");
    let triangles = report(far, [500.0, 128.0, 0.0], Technique::Triangles);
    assert!(triangles.points == 0 && triangles.triangles == 2 * 256 * 1099, "{triangles:?}");
    assert_eq!(report(inside, [1000.0, 128.0, -20.0], Technique::Points).triangles, 0);
}
