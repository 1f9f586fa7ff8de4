//! Holes that are outlined, filled, and that grow.

use super::super::look::{Attribute, Light, Look};
use super::super::memory::MemorySurface;
use super::super::picture::{SurfaceOptions, SurfacePicture, draw};
use super::super::sight::Sight;
use super::super::tests::{Random, camera_over, hills, placed};
use super::*;
use crate::color::TransferFunction;
use crate::view::{Projection, View};
use deepfield_heights::model::{Cell, HeightField};
use glam::DVec3;

/// Hills with round holes: middles and radii in samples.
fn with_holes(holes: &[[f64; 3]]) -> HeightField {
    let mut field = hills(380, 420, 0.0, 3);
    for (index, height) in field.stored.iter_mut().enumerate() {
        let (x, y) = ((index % 420) as f64, (index / 420) as f64);
        if holes.iter().any(|[column, row, radius]| (x - column).hypot(y - row) < *radius) {
            *height = f64::NAN;
        }
    }
    field
}

const HOLES: [[f64; 3]; 5] =
    [[120.3, 90.2, 30.0], [300.0, 250.0, 61.0], [200.5, 190.5, 3.2], [60.0, 300.0, 12.0], [330.0, 60.0, 18.5]];

fn options(holes: Holes) -> SurfaceOptions {
    let (transfer, attribute, light) = (TransferFunction::default(), Attribute::Height, Light::Eye);
    let look = Look { attribute, transfer, range: [-80.0, 80.0], light, ambient: 0.8, contours: None };
    SurfaceOptions { look: Some(look), holes, ..SurfaceOptions::default() }
}

/// From above, a sample of full resolution being so many pixels.
fn above(pixels: f64, size: [u32; 2]) -> Sight {
    let target = DVec3::new(210.13, 190.21, 0.0);
    let projection = Projection::Orthographic { height: f64::from(size[1]) / pixels };
    Sight::Flat(View::look_at(target + DVec3::Z * 500.0, target, DVec3::Y, projection, size[0], size[1]).unwrap())
}

/// Edges of T with a triangle on one side only that are not on the field's border, as places.
fn rims(field: &HeightField) -> Vec<[DVec3; 2]> {
    let (rows, columns) = (field.grid.rows as usize, field.grid.columns as usize);
    let mut count = std::collections::BTreeMap::<[usize; 2], u32>::new();
    for (r, c) in (0..rows - 1).flat_map(|r| (0..columns - 1).map(move |c| (r, c))) {
        let corners = [0, 1, columns, columns + 1].map(|next| r * columns + c + next);
        for triangle in Cell(corners.map(|at| field.stored[at])).triangles() {
            for k in 0..3 {
                let ends = [triangle.corners[k], triangle.corners[(k + 1) % 3]].map(|corner| corners[corner]);
                *count.entry([ends[0].min(ends[1]), ends[0].max(ends[1])]).or_default() += 1;
            }
        }
    }
    let is_border = |at: usize| {
        [at / columns == 0, at / columns == rows - 1, at.is_multiple_of(columns), at % columns == columns - 1]
    };
    let is_rim = |ends: &[usize; 2]| !is_border(ends[0]).iter().zip(is_border(ends[1])).any(|(a, b)| *a && b);
    let place = |at: usize| DVec3::new((at % columns) as f64, (at / columns) as f64, field.stored[at]);
    count.into_iter().filter(|(ends, n)| *n == 1 && is_rim(ends)).map(|(ends, _)| ends.map(place)).collect()
}

fn changed(a: &SurfacePicture, b: &SurfacePicture) -> Vec<bool> {
    let differs = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).any(|k| (a[k] - b[k]).abs() > 0.02);
    a.colors.rgba.iter().zip(&b.colors.rgba).map(differs).collect()
}

/// Lines are where T ends within a pixel, from any distance and direction, and alpha is what it was. From above all of the rim has a line.
#[test]
fn lines_are_on_the_rims_of_holes() {
    let field = with_holes(&HOLES);
    let (source, placed, rims) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field), rims(&field));
    let width = 1.5;
    let mut random = Random::new(3);
    let mut sights: Vec<(Sight, bool)> = [4.0, 0.9, 0.35].map(|pixels| (above(pixels, [240, 200]), true)).to_vec();
    sights.extend((0..4).map(|_| (Sight::Flat(camera_over(&field, &mut random, [240, 180])), false)));
    for (sight, is_above) in sights {
        let [open, lined] =
            [Holes::Open, Holes::Outlined(width)].map(|holes| draw(&source, &placed, &sight, &options(holes)));
        assert!(open.colors.rgba.iter().zip(&lined.colors.rgba).all(|(a, b)| a[3] == b[3]));
        let size = sight.size().map(|side| side as usize);
        let (is_line, mut nearest) = (changed(&open, &lined), vec![f64::INFINITY; size[0] * size[1]]);
        for [from, to] in &rims {
            for share in [0.0, 0.25, 0.5, 0.75] {
                let Some((at, _)) = sight.project(*from + share * (*to - *from) - sight.eye()) else { continue };
                let reach = (width + 3.0) as i64;
                let mut has_line = false;
                for (x, y) in
                    (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (at[0] as i64 + x, at[1] as i64 + y)))
                {
                    if x < 0 || y < 0 || x >= size[0] as i64 || y >= size[1] as i64 {
                        has_line = true;
                        continue;
                    }
                    let (index, away) =
                        (y as usize * size[0] + x as usize, (x as f64 + 0.5 - at[0]).hypot(y as f64 + 0.5 - at[1]));
                    nearest[index] = nearest[index].min(away);
                    has_line |= is_line[index] && away < 2.0;
                }
                assert!(has_line || !is_above, "no line at {at:?}");
            }
        }
        // Between the places that were looked at there is at most a pixel.
        let stray = is_line.iter().zip(&nearest).filter(|(is_line, away)| **is_line && **away > width + 1.5).count();
        assert_eq!(stray, 0);
    }
}

/// A membrane is over every hole within the field, and not beside it; what was measured, and raw channels, are what they were.
#[test]
fn membranes_are_no_data() {
    // A field of which a corner was not measured: no hole.
    let mut field = with_holes(&HOLES);
    for index in 0..field.stored.len() {
        if index % 420 + index / 420 < 60 {
            field.stored[index] = f64::NAN;
        }
    }
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let filled = Holes::Filled(Gap::Any);
    for pixels in [3.0, 1.2, 0.4] {
        let sight = above(pixels, [200, 160]);
        let with_raw = |holes: Holes| draw(&source, &placed, &sight, &SurfaceOptions { raw: true, ..options(holes) });
        let (open, closed) = (with_raw(Holes::Open), with_raw(filled));
        let bits =
            |picture: &SurfacePicture| picture.raw.iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&open), bits(&closed));
        assert!((open.report.covered - closed.report.covered).abs() < 1e-6 * open.report.covered);
        for (index, (a, b)) in open.colors.rgba.iter().zip(&closed.colors.rgba).enumerate() {
            let (origin, _) = sight.ray([(index % 200) as f64 + 0.5, (index / 200) as f64 + 0.5]).unwrap();
            let [x, y] = [origin.x, origin.y];
            let room = 2.0 / pixels;
            let is_in = x > room && y > room && x < 419.0 - room && y < 379.0 - room;
            if is_in && x + y > 60.0 + 2.0 * room {
                assert!(b[3] > 0.999, "{x} {y}: {}", b[3]);
            }
            // What is nowhere between two measured samples is no hole.
            if is_in && x + y < 60.0 - 2.0 * room {
                assert_eq!(b[3], 0.0, "{x} {y}");
            }
            if a[3] == 1.0 {
                assert_eq!(a, b);
            }
        }
    }
}

/// Only what is narrow enough along a row or a column is spanned, in cells or in lengths.
#[test]
fn large_gaps_stay_open() {
    let mut field = with_holes(&HOLES);
    field.grid.step = [0.5, 0.5];
    let source = MemorySurface::new(&field, 2.0).unwrap();
    let placed = Placed::new(&field.grid, Default::default(), 0.5, 0.0);
    let target = DVec3::new(105.0, 95.0, 0.0);
    let projection = Projection::Orthographic { height: 200.0 };
    let view = View::look_at(target + DVec3::Z * 500.0, target, DVec3::Y, projection, 440, 400).unwrap();
    let sight = Sight::Flat(view);
    for gap in [Gap::Cells(50.0), Gap::Lengths(25.0)] {
        let picture = draw(&source, &placed, &sight, &options(Holes::Filled(gap)));
        for [column, row, radius] in HOLES {
            let place = DVec3::new(0.5 * column, 0.5 * row, 0.0);
            let (at, _) = sight.project(place - sight.eye()).unwrap();
            let alpha = picture.colors.rgba[at[1] as usize * 440 + at[0] as usize][3];
            assert_eq!(alpha > 0.5, 2.0 * radius < 50.0, "{radius}: {alpha}");
        }
    }
}

/// From afar a sample that was not measured is a small share of a pixel, and a hole of a pixel where holes grow.
#[test]
fn holes_grow_where_they_are_asked_to() {
    let mut field = hills(600, 600, 0.0, 5);
    field.stored[303 * 600 + 301] = f64::NAN;
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let target = DVec3::new(300.0, 300.0, 0.0);
    let projection = Projection::Orthographic { height: 400.0 };
    let view = View::look_at(target + DVec3::Z * 900.0, target, DVec3::Y, projection, 50, 50).unwrap();
    let least = |holes_grow: bool| {
        let options = SurfaceOptions { holes_grow, ..options(Holes::Open) };
        let picture = draw(&source, &placed, &Sight::Flat(view), &options);
        picture.colors.rgba.iter().map(|color| color[3]).fold(1.0, f32::min)
    };
    assert!(least(false) > 0.9 && least(true) < 0.8, "{} {}", least(false), least(true));
}
