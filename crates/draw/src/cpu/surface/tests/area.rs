//! From above, what is covered is as much as T, whatever holes look like and however far away they are, and no more than the error into a hole.

use super::super::look::{Attribute, Light, Look};
use super::super::paged::PagedSurface;
use super::super::picture::{SurfaceOptions, draw, scene, visible};
use super::super::resolve::Resolver;
use super::super::select::Technique;
use super::*;
use crate::color::transfer::TransferFunction;
use crate::model::Unit;
use deepfield_data::model::ReadMethod;
use deepfield_heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use deepfield_heights::model::Globe;
use deepfield_heights::store::HeightFile;
use std::iter;
use std::sync::Arc;

const SIDE: usize = 601;
/// What the large hole has of rows and columns.
const HOLE: [usize; 2] = [223, 391];

/// Whether a sample was measured.
fn is_measured(pattern: &str, [row, column]: [usize; 2], chance: impl Fn(usize) -> f64) -> bool {
    let of_block = |side: usize| chance(row / side * SIDE + column / side);
    match pattern {
        "random" => of_block(1) > 0.3,
        "squares" => of_block(5) > 0.3,
        "stripes" => column % 10 > 2,
        // Two by two, so that each is a cell, and a twentieth of what a coarse sample stands for.
        "specks" => row % 9 < 2 && column % 9 < 2,
        "hole" => !(HOLE[0]..=HOLE[1]).contains(&row) || !(HOLE[0]..=HOLE[1]).contains(&column),
        _ => true,
    }
}

/// The samples at the corners of each of T's triangles, of a field that may go on with its first column behind the last one.
fn triangles(field: &HeightField, goes_round: bool) -> Vec<[usize; 3]> {
    let [rows, columns] = [field.grid.rows, field.grid.columns].map(|count| count as usize);
    let cells = columns - usize::from(!goes_round);
    let cells = (0..rows - 1).flat_map(|row| (0..cells).map(move |column| (row * columns, column)));
    cells
        .flat_map(|(first, column)| {
            let ends = [first + column, first + (column + 1) % columns];
            let corners = [ends[0], ends[1], ends[0] + columns, ends[1] + columns];
            let found = Cell(corners.map(|corner| field.stored[corner]));
            found.triangles().map(|triangle| triangle.corners.map(|corner| corners[corner])).collect::<Vec<_>>()
        })
        .collect()
}

/// A field with holes without samples in no triangle, which fill a pixel and have no area.
fn broken(pattern: &str, [rows, columns]: [usize; 2]) -> HeightField {
    let chance = |index: usize| Random::new(index as u64).next();
    let height = |index: usize| {
        let [row, column] = [index / columns, index % columns];
        let height = 0.2 * ((row as f64 / 31.0).sin() + (column as f64 / 23.0).cos());
        if is_measured(pattern, [row, column], chance) { height } else { f64::NAN }
    };
    let mut field = HeightField::of(columns as u64, rows as u64, (0..rows * columns).map(height).collect());
    let mut is_used = vec![false; rows * columns];
    triangles(&field, false).into_iter().flatten().for_each(|corner| is_used[corner] = true);
    let unused = field.stored.iter_mut().zip(is_used).filter(|(_, is_used)| !is_used);
    unused.for_each(|(height, _)| *height = f64::NAN);
    field
}

fn built(field: &HeightField) -> (tempfile::TempDir, PagedSurface) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.df");
    build_heights(field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
    let file = Arc::new(HeightFile::open(&path, ReadMethod::default()).unwrap());
    (folder, PagedSurface::new(file, 1 << 30))
}

/// From above and turned, so that the field's border is on no row of pixels, with so many samples a pixel.
fn above(samples: f64) -> Sight {
    let (high, middle) = (1.45 * SIDE as f64, 0.5 * SIDE as f64);
    let pixels = (high / samples.sqrt()) as u32;
    let target = DVec3::new(middle + 0.123, middle + 0.377, 0.0);
    let up = DVec3::new(0.35_f64.sin(), 0.35_f64.cos(), 0.0);
    let projection = Projection::Orthographic { height: f64::from(pixels) * samples.sqrt() };
    Sight::Flat(View::look_at(target + DVec3::Z * 900.0, target, up, projection, pixels, pixels).unwrap())
}

/// The area that raw channels of so many samples a pixel say is covered, and the most pixels that a covered one's centre is within the large hole.
fn covered(source: &PagedSurface, placed: &Placed, samples: f64, technique: Technique, tau: f64) -> (f64, f64) {
    let sight = above(samples);
    let options = SurfaceOptions { technique, tau, raw: true, ..SurfaceOptions::default() };
    let picture = draw(source, placed, &sight, &options);
    let (mut sum, mut deepest) = (0.0, 0.0_f64);
    for (index, channels) in picture.raw.iter().enumerate().filter(|(_, channels)| channels[6] > 0.0) {
        sum += channels[6];
        let width = sight.size()[0] as usize;
        let (origin, _) = sight.ray([(index % width) as f64 + 0.5, (index / width) as f64 + 0.5]).unwrap();
        let inside = [origin.x, origin.y].map(|at| (at - (HOLE[0] - 1) as f64).min((HOLE[1] + 1) as f64 - at));
        deepest = deepest.max(inside[0].min(inside[1]) / samples.sqrt());
    }
    (sum * samples, deepest)
}

/// Each place is told by what is at a pixel's centre where triangles are drawn, so that pixels have to be smaller than samples for their sum to be
/// as exact as this; points tell the mean over their pixels. There the field's border is in pixels that are told in part, as it is without holes.
#[test]
fn holes_of_any_form_keep_their_area() {
    let area = |field: &HeightField| 0.5 * triangles(field, false).len() as f64;
    let whole = broken("whole", [SIDE; 2]);
    let all = area(&whole);
    let (_folder, source) = built(&whole);
    let points = [10.0, 39.0, 156.0];
    let shares = points.map(|samples| covered(&source, &placed(&whole), samples, Technique::Hybrid, 0.8).0 / all);
    for pattern in ["random", "squares", "stripes", "specks", "hole"] {
        let field = broken(pattern, [SIDE; 2]);
        let area = area(&field);
        let (_folder, source) = built(&field);
        let placed = placed(&field);
        for (technique, samples, tau) in
            [(Technique::Triangles, 4.0, 5.9), (Technique::Hybrid, 2.0, 2.1), (Technique::Rays, 9.0, 2.9)]
        {
            let (found, deepest) = covered(&source, &placed, samples, technique, tau);
            // Places are fewer where pixels are larger, and specks are few.
            let bar = match pattern {
                "specks" => 4e-3,
                _ if samples > 4.0 => 2e-3,
                _ => 1e-3,
            };
            let what = format!("{pattern}, {technique:?}, {samples} samples a pixel, tau {tau}");
            assert!((found / area - 1.0).abs() < bar, "{what}: {found} of {area}");
            assert!(pattern != "hole" || deepest <= tau, "{what}: {deepest} pixels within the hole");
        }
        for (samples, share) in points.into_iter().zip(shares) {
            let (found, deepest) = covered(&source, &placed, samples, Technique::Hybrid, 0.8);
            let what = format!("{pattern}, points, {samples} samples a pixel");
            // Specks are few, and a pixel has now one more of them and now one less.
            let bar = if pattern == "specks" { 6e-3 } else { 1.5e-3 };
            assert!((found / area / share - 1.0).abs() < bar, "{what}: {found} of {area}, whole {share}");
            let most = 0.8 + 0.5_f64.sqrt();
            assert!(pattern != "hole" || deepest <= most, "{what}: {deepest} pixels within the hole");
        }
    }
}

/// A globe all around which columns go, from pole to pole, with holes.
fn broken_globe(pattern: &str) -> HeightField {
    let mut field = broken(pattern, GLOBE_SIZE);
    let step = 360.0 / GLOBE_SIZE[1] as f64;
    (field.grid.step, field.grid.origin) = ([step, -step], [-180.0 + 0.5 * step, 90.0 - 0.5 * step]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

/// The areas of T on the sides of a globe that are seen along directions, as they are seen, in squares of the samples' distance.
fn areas_seen(field: &HeightField, placed: &Placed, directions: &[DVec3]) -> Vec<f64> {
    let columns = field.grid.columns as usize;
    let place = |(index, height): (usize, &f64)| {
        let [row, column] = [index / columns, index % columns].map(|at| at as f64);
        placed.world(row, column, *height)
    };
    let places: Vec<DVec3> = field.stored.iter().enumerate().map(place).collect();
    let triangles = triangles(field, true);
    let seen = |forward: &DVec3| {
        let areas = triangles.iter().filter_map(|corners| {
            let [a, b, c] = corners.map(|corner| places[corner]);
            (a.dot(*forward) < 0.0).then(|| 0.5 * (b - a).cross(c - a).dot(*forward).abs())
        });
        areas.sum::<f64>() / spacing().powi(2)
    };
    directions.iter().map(seen).collect()
}

/// Rows and columns of samples on a globe.
const GLOBE_SIZE: [usize; 2] = [150, 300];
const GLOBE: Globe = Globe { equator: 20_000.0, pole: 19_500.0 };

fn spacing() -> f64 {
    GLOBE.equator * std::f64::consts::TAU / GLOBE_SIZE[1] as f64
}

/// All of a globe, from far away, with so many samples a pixel.
fn of_globe(toward: DVec3, samples: f64) -> Sight {
    let pixel = spacing() * samples.sqrt();
    let pixels = (2.1 * GLOBE.equator / pixel).ceil();
    let projection = Projection::Orthographic { height: pixels * pixel };
    let aside = DVec3::new(0.3, 0.1, 1.0);
    let eye = 3.0 * GLOBE.equator * toward;
    Sight::Flat(View::look_at(eye, DVec3::ZERO, aside, projection, pixels as u32, pixels as u32).unwrap())
}

/// The area of the near side that raw channels of so many samples a pixel say is covered, squares of the samples' distance, and how many pixels show
/// the far side.
fn covered_of_globe(
    (source, placed): (&PagedSurface, &Placed),
    toward: DVec3,
    (technique, samples, tau): (Technique, f64, f64),
) -> (f64, usize) {
    let options = SurfaceOptions { technique, tau, raw: true, ..SurfaceOptions::default() };
    let picture = draw(source, placed, &of_globe(toward, samples), &options);
    let (mut near, mut beyond) = (0.0, 0);
    for [_, longitude, latitude, _, _, _, coverage] in picture.raw.into_iter().filter(|raw| raw[6] > 0.0) {
        match DVec3::from(Globe::up(longitude, latitude)).dot(toward) > 0.0 {
            true => near += coverage,
            false => beyond += 1,
        }
    }
    (near * samples, beyond)
}

/// Directions along which a globe is seen: the first one has the seam and a pole in the picture, others are spread over all but the poles.
fn directions() -> impl Iterator<Item = DVec3> {
    const COUNT: u32 = 8;
    let golden = 180.0 * (3.0 - 5.0_f64.sqrt());
    let of = move |k: u32| {
        let height: f64 = 1.8 * (f64::from(k) + 0.5) / f64::from(COUNT) - 0.9;
        (170.0 + golden * f64::from(k), height.asin().to_degrees())
    };
    let others = (1..COUNT).map(of);
    iter::once((170.0, 40.0)).chain(others).map(|(longitude, latitude)| -DVec3::from(Globe::up(longitude, latitude)))
}

/// Triangles of both levels, rays and points; at the limb pixels are in the picture or not as they are of a globe without holes, and through holes
/// the far side is seen. Pixels are few, so that told at their middles stripes are 1.3 % off; beside the triangles of the coarse level is 8 to 33 % of
/// the area. As points, of which each tells the mean over its pixel, what is left is how samples fall into pixels: up to 2 % from one side, now more
/// and now less.
#[test]
fn holes_of_globes_keep_their_area() {
    let cases = [
        (Technique::Triangles, 0.1, 2.0),
        (Technique::Triangles, 1.0, 5.9),
        (Technique::Rays, 1.0, 5.9),
        (Technique::Hybrid, 10.0, 0.95),
    ];
    let directions: Vec<DVec3> = directions().collect();
    let shares_of = |pattern: &str, cases: &[(Technique, f64, f64)]| {
        let field = broken_globe(pattern);
        let (_folder, source) = built(&field);
        let placed = Placed::new(&field.grid, Map::Globe(GLOBE), 1.0, 0.0);
        let areas = areas_seen(&field, &placed, &directions);
        let count = |technique: Technique| if technique == Technique::Hybrid { directions.len() } else { 1 };
        let shares = |case: &(Technique, f64, f64)| -> Vec<(f64, usize)> {
            let share = |(forward, area): (&DVec3, &f64)| {
                let (near, beyond) = covered_of_globe((&source, &placed), -*forward, *case);
                (near / area, beyond)
            };
            directions.iter().zip(&areas).take(count(case.0)).map(share).collect()
        };
        cases.iter().map(shares).collect::<Vec<_>>()
    };
    let wholes = shares_of("whole", &cases);
    for pattern in ["squares", "stripes", "random"] {
        // Near by all is drawn as it is, and one pattern is enough.
        let first = usize::from(pattern != "squares");
        let found = shares_of(pattern, &cases[first..]);
        for (((technique, samples, _), shares), wholes) in cases[first..].iter().zip(found).zip(&wholes[first..]) {
            let bar = if *samples < 1.0 { 0.01 } else { 0.03 };
            let what = format!("{pattern}, {technique:?}, {samples} samples a pixel");
            let mut mean = 0.0;
            for ((share, beyond), (whole, hidden)) in shares.iter().zip(wholes) {
                let off = share / whole - 1.0;
                assert!(off.abs() < bar, "{what}: {share} of the area, whole {whole}");
                assert!(
                    beyond > hidden || pattern == "random",
                    "{what}: {beyond} pixels of the far side, whole {hidden}"
                );
                mean += off / shares.len() as f64;
            }
            assert!(shares.len() == 1 || mean.abs() < 0.01, "{what}: {mean} too much from all sides");
        }
    }
}

/// In colours levels tell about the middle of each sample of the picture, and not about the samples that are seen there, what is covered: of stripes
/// 6 parts of 10, but for what of the far side is seen through holes.
#[test]
fn holes_of_globes_far_away_do_not_fill_in_colours() {
    let look = Look {
        attribute: Attribute::Height,
        transfer: TransferFunction::default(),
        range: [-1.0, 1.0],
        light: Light::Eye,
        ambient: 0.5,
        contours: None,
    };
    let options = SurfaceOptions { look: Some(look), ..SurfaceOptions::default() };
    let sight = of_globe(DVec3::from(Globe::up(170.0, 40.0)), 40.0);
    let covered = |pattern: &str| {
        let field = broken_globe(pattern);
        let source = MemorySurface::new(&field, 1.0).unwrap();
        let placed = Placed::new(&field.grid, Map::Globe(GLOBE), 1.0, 0.0);
        draw(&source, &placed, &sight, &options).report.covered
    };
    let share = covered("stripes") / covered("whole");
    assert!((0.58..0.75).contains(&share), "{share} of what is covered without holes");
}

/// Where the middle of one of the picture's samples is beside a globe, colours tell what channels do: the mean over the sample, whatever is seen in it.
#[test]
fn limbs_of_globes_are_covered_in_colours_as_in_channels() {
    let field = broken_globe("stripes");
    let source = MemorySurface::new(&field, 1.0).unwrap();
    let placed = Placed::new(&field.grid, Map::Globe(GLOBE), 1.0, 0.0);
    let (sight, options) = (of_globe(DVec3::from(Globe::up(170.0, 40.0)), 10.0), SurfaceOptions::default());
    let scene = scene(&source, &placed, &sight, &options);
    let (seen, _) = visible(&scene, &sight, &options, 1);
    let resolver = Resolver::new(&scene, &sight);
    let (mut beside, mut open) = (0, 0);
    for index in 0..seen.width * seen.height {
        let pixel = [(index % seen.width) as f64 + 0.5, (index / seen.width) as f64 + 0.5];
        let Some(shown) = seen.at(index) else { continue };
        // In a world in which the globe is a ball.
        let ball = DVec3::new(1.0, 1.0, GLOBE.equator / GLOBE.pole);
        let (origin, direction) =
            sight.ray(pixel).map(|(origin, direction)| (origin * ball, direction * ball)).unwrap();
        let nearest = origin - origin.dot(direction) / direction.length_squared() * direction;
        if nearest.length() > 1.005 * GLOBE.equator {
            let hits = [resolver.look(shown, pixel), resolver.hit(shown, pixel)];
            let [colors, channels] = hits.map(|hit| hit.map(|hit| hit.coverage));
            assert_eq!(colors, channels, "{pixel:?}");
            beside += 1;
            open += usize::from(colors.is_some_and(|coverage| coverage < 1.0));
        }
    }
    assert!(beside > 0 && open > 0, "{open} of {beside}");
}
