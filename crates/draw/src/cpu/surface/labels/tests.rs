//! Heights along lines of random fields, seen by random cameras.

use super::super::look::{Attribute, Contours, Light, Look};
use super::super::memory::MemorySurface;
use super::super::picture::{SurfaceOptions, SurfacePicture, draw, draw_lettered};
use super::super::sight::Sight;
use super::super::tests::{Random, camera_over, hills, placed};
use super::*;
use crate::color::TransferFunction;
use deepfield_heights::model::HeightField;

/// Letters that are filled boxes.
pub(super) struct Boxes;

impl Letters for Boxes {
    fn width(&self, text: &str, size: f32) -> f32 {
        0.55 * size * text.chars().count() as f32
    }

    fn write(&self, text: &str, size: f32, middle: [f32; 2], angle: f32, pixel: &mut dyn FnMut(i64, i64, f32)) {
        let (half, (sin, cos)) = ([0.5 * self.width(text, size), 0.36 * size], angle.sin_cos());
        let reach = half[0].hypot(half[1]).ceil() as i64 + 1;
        for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
            let (x, y) = (middle[0] as i64 + dx, middle[1] as i64 + dy);
            let away = [x as f32 + 0.5 - middle[0], y as f32 + 0.5 - middle[1]];
            if (cos * away[0] + sin * away[1]).abs() <= half[0] && (cos * away[1] - sin * away[0]).abs() <= half[1] {
                pixel(x, y, 1.0);
            }
        }
    }
}

/// Smooth hills.
pub(super) fn rolling(seed: u64) -> HeightField {
    let mut random = Random::new(seed);
    let waves: Vec<[f64; 4]> = (0..5)
        .map(|k| {
            let (size, angle) = (70.0 / 1.6_f64.powi(k), random.between(0.0, 6.3));
            [angle.cos() / size, angle.sin() / size, random.between(0.0, 6.3), 0.3 * size]
        })
        .collect();
    let height = |index: i32| {
        let (x, y) = (f64::from(index % 500), f64::from(index / 500));
        waves.iter().map(|[a, b, phase, size]| size * (a * x + b * y + phase).sin()).sum()
    };
    HeightField::of(500, 420, (0..420 * 500).map(height).collect())
}

pub(super) const CONTOURS: Contours =
    Contours { interval: 4.0, base: 0.37, major: 5, width: 1.2, color: [0.0; 3], labels: Some(9.0) };

pub(super) fn options(contours: Contours) -> SurfaceOptions {
    let transfer = TransferFunction::default();
    let (attribute, light) = (Attribute::Height, Light::Eye);
    let look = Look { attribute, transfer, range: [-80.0, 80.0], light, ambient: 0.8, contours: Some(contours) };
    SurfaceOptions { look: Some(look), samples: 4, ..SurfaceOptions::default() }
}

fn lettered(field: &HeightField, source: &MemorySurface, sight: &Sight) -> SurfacePicture {
    draw_lettered(source, &placed(field), sight, &options(CONTOURS), Some(&Boxes))
}

/// Whatever the field and the camera: heights do not overlap, are in the picture and upright, say their level exactly, and stand on a line of
/// that height; where they stand there is no line, and elsewhere the picture is that without them.
#[test]
fn heights_stand_on_their_lines() {
    let mut random = Random::new(5);
    let mut count = 0;
    for field in [rolling(1), rolling(2), hills(420, 500, 0.002, 3)] {
        let source = MemorySurface::new(&field, 1.0).unwrap();
        for _ in 0..5 {
            let size = [240, 180];
            let view = camera_over(&field, &mut random, size);
            let sight = Sight::Flat(view);
            let picture = lettered(&field, &source, &sight);
            let plain = draw(&source, &placed(&field), &sight, &options(CONTOURS));
            let raw = SurfaceOptions { raw: true, look: None, tau: 0.0, ..SurfaceOptions::default() };
            let raw = draw(&source, &placed(&field), &sight, &raw).raw;
            let boxes: Vec<[f64; 4]> = picture.labels.iter().map(ContourLabel::area).collect();
            for (index, (label, area)) in picture.labels.iter().zip(&boxes).enumerate() {
                count += 1;
                let [left, top, right, bottom] = *area;
                assert!(left >= 0.0 && top >= 0.0 && right <= f64::from(size[0]) && bottom <= f64::from(size[1]));
                assert!(label.angle.abs() <= std::f64::consts::FRAC_PI_2 + 1e-12);
                assert_eq!(label.text.parse::<f64>().unwrap(), label.level);
                let is_apart =
                    |other: &[f64; 4]| left >= other[2] || right <= other[0] || top >= other[3] || bottom <= other[1];
                assert!(boxes[..index].iter().all(is_apart));
                // The level is between the least and the largest height of the pixels around.
                let [x, y] = label.middle.map(|at| at as usize);
                let near = (y.max(1) - 1..=y + 1).flat_map(|y| (x.max(1) - 1..=x + 1).map(move |x| (x, y)));
                let near: Vec<f64> = near.map(|(x, y)| raw[y * size[0] as usize + x][3]).collect();
                let [low, high] =
                    near.iter().fold([f64::MAX, f64::MIN], |[a, b], height| [a.min(*height), b.max(*height)]);
                assert!((low..=high).contains(&label.level), "{} between {low} and {high}", label.level);
            }
            let spared = spared(&picture.labels, size.map(|side| side as usize));
            for (index, (with, without)) in picture.colors.rgba.iter().zip(&plain.colors.rgba).enumerate() {
                let at = [(index % 240) as f64 + 0.5, (index / 240) as f64 + 0.5];
                let is_far = !picture.labels.iter().any(|label| label.holds(at, 3.0));
                assert!(!is_far || with == without);
                assert!(!is_far || spared.is_empty() || !spared[index]);
            }
        }
    }
    assert!(count > 40, "{count} heights");
}

/// A camera that moves a little finds most heights at the same places of the field.
#[test]
fn heights_stay_where_they_are() {
    let field = rolling(4);
    let source = MemorySurface::new(&field, 1.0).unwrap();
    let mut random = Random::new(11);
    let (mut kept, mut all) = (0, 0);
    for _ in 0..4 {
        let view = camera_over(&field, &mut random, [320, 240]);
        let reach = (view.eye.z - 20.0).abs().max(30.0);
        let mut moved = view;
        moved.eye += 0.004 * reach * (view.right + 0.5 * view.up);
        let [before, after] = [view, moved].map(|view| {
            let sight = Sight::Flat(view);
            let place = |label: &ContourLabel| {
                let (origin, direction) = sight.ray(label.middle).unwrap();
                let t = (label.level - origin.z) / direction.z;
                (label.level, (origin + t * direction).truncate(), sight.pixels_at(t))
            };
            lettered(&field, &source, &sight).labels.iter().map(place).collect::<Vec<_>>()
        });
        all += before.len();
        let stays = |(level, at, pixels): &&(f64, glam::DVec2, f64)| {
            after.iter().any(|(other, there, _)| level == other && (*at - *there).length() * pixels < 3.0)
        };
        kept += before.iter().filter(stays).count();
    }
    assert!(all >= 15 && kept * 10 >= all * 8, "{kept} of {all} stay");
}
