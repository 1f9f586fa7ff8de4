//! From above, what is covered is as much as T, whatever holes look like and however far away they are, and no more than the error into a hole.

use super::super::paged::PagedSurface;
use super::super::picture::{SurfaceOptions, draw};
use super::super::select::Technique;
use super::*;
use deepfield_data::model::ReadMethod;
use deepfield_heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use deepfield_heights::store::HeightFile;
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

/// A field with holes without samples in no triangle, which fill a pixel and have no area, and T's area.
fn broken(pattern: &str) -> (HeightField, f64) {
    let chance = |index: usize| Random::new(index as u64).next();
    let all = || (0..SIDE * SIDE).map(|index| [index / SIDE, index % SIDE]);
    let measured: Vec<bool> = all().map(|at| is_measured(pattern, at, chance)).collect();
    let corners = |row: usize, column: usize| {
        let first = row * SIDE + column;
        [first, first + 1, first + SIDE, first + SIDE + 1]
    };
    let (mut used, mut area) = (vec![false; SIDE * SIDE], 0.0);
    for (row, column) in (0..SIDE - 1).flat_map(|row| (0..SIDE - 1).map(move |column| (row, column))) {
        let found: Vec<usize> = corners(row, column).into_iter().filter(|corner| measured[*corner]).collect();
        if found.len() > 2 {
            area += if found.len() == 4 { 1.0 } else { 0.5 };
            found.into_iter().for_each(|corner| used[corner] = true);
        }
    }
    let height = |[row, column]: [usize; 2]| 0.2 * ((row as f64 / 31.0).sin() + (column as f64 / 23.0).cos());
    let heights = all().zip(used).map(|(at, is_used)| if is_used { height(at) } else { f64::NAN }).collect();
    (HeightField::of(SIDE as u64, SIDE as u64, heights), area)
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
    let (whole, all) = broken("whole");
    let (_folder, source) = built(&whole);
    let points = [10.0, 39.0, 156.0];
    let shares = points.map(|samples| covered(&source, &placed(&whole), samples, Technique::Hybrid, 0.8).0 / all);
    for pattern in ["random", "squares", "stripes", "specks", "hole"] {
        let (field, area) = broken(pattern);
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
