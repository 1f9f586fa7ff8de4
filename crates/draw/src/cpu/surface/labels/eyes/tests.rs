//! Heights in pictures for two eyes and of all directions.

use super::super::super::lettering::{found, over};
use super::super::super::look::Contours;
use super::super::super::memory::MemorySurface;
use super::super::super::picture::{SurfaceOptions, SurfacePicture, draw, scene};
use super::super::super::placed::{Map, Placed};
use super::super::super::source::SurfaceNodes;
use super::super::super::tests::{Random, camera_over, hills, placed};
use super::super::tests::{Boxes, CONTOURS, options, rolling};
use super::*;
use crate::color::Colors;
use crate::model::Unit;
use crate::view::{Cut, Eye, Eyes, Panorama, Projection, Stereo, StereoKind, Surround, View};
use deepfield_heights::model::{Globe, HeightField};

/// The same heights for all eyes, in each one's part of the picture, on a line of their level there, and over no other; how many each has.
fn check(
    (source, placed): (&dyn SurfaceNodes, &Placed),
    (middle, eyes): (&Sight, &[EyePart]),
    options: &SurfaceOptions,
    height: impl Fn(DVec3) -> f64,
) -> usize {
    let (scene, look) = (scene(source, placed, middle, options), options.look.as_ref().unwrap());
    let contours = look.contours.unwrap();
    let found = found((&scene, middle), (look, options), (&contours, contours.labels.unwrap()), &Boxes);
    let caster = Caster::new(&scene);
    let parts = for_each(eyes, &found, middle, &caster);
    assert_eq!(parts.len(), eyes.len());
    for seen in &parts {
        assert!(seen.iter().map(|own| &own.label.text).eq(parts[0].iter().map(|own| &own.label.text)));
        for (index, SeenLabel { label, sight }) in seen.iter().enumerate() {
            let ([left, top, right, bottom], [width, height_px]) = (label.area(), sight.size().map(f64::from));
            assert!(left >= 0.0 && top >= 0.0 && right <= width && bottom <= height_px);
            assert!(seen[..index].iter().all(|other| are_apart(label, &other.label, 0.0)));
            let steps = [-1.5, 0.0, 1.5];
            let around = steps.into_iter().flat_map(|y| steps.map(|x| [label.middle[0] + x, label.middle[1] + y]));
            let around = around.filter_map(|at| place(&caster, sight, at)).map(&height);
            let [low, high] = around.fold([f64::MAX, f64::MIN], |[low, high], at| [low.min(at), high.max(at)]);
            assert!((low..=high).contains(&label.level), "{} between {low} and {high}", label.level);
        }
    }
    parts[0].len()
}

/// Heights are written where they stand, and nothing else of a picture changes.
fn check_picture(
    field: (&dyn SurfaceNodes, &Placed),
    (middle, eyes): (&Sight, &[EyePart]),
    options: &SurfaceOptions,
    colors: Colors,
) -> usize {
    let mut picture = SurfacePicture { colors: colors.clone(), ..SurfacePicture::default() };
    over(&mut picture, field, (middle, eyes), options, &Boxes);
    let width = colors.width as usize;
    let mut written = 0;
    for (index, (before, after)) in colors.rgba.iter().zip(&picture.colors.rgba).enumerate() {
        let at = [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5];
        let is_near = picture.labels.iter().any(|label| label.holds(at, 3.0));
        assert!(is_near || before == after, "{at:?}");
        written += usize::from(before != after);
    }
    assert!(written >= 20 * picture.labels.len(), "{written} pixels of {} heights", picture.labels.len());
    picture.labels.len()
}

#[test]
fn two_eyes_have_heights_at_the_same_places() {
    let (mut random, mut count) = (Random::new(7), 0);
    for field in [rolling(1), hills(420, 500, 0.002, 3)] {
        let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
        let views = std::iter::repeat_with(|| camera_over(&field, &mut random, [240, 180]));
        let is_perspective = |view: &View| matches!(view.projection, Projection::Perspective { .. });
        for view in views.filter(is_perspective).take(3) {
            let away = -view.eye.z / view.forward.z;
            let (kind, eyes) = (StereoKind::OffAxis, Eyes::SideBySide);
            let stereo = Stereo { kind, separation: 0.03 * away.max(1.0), zero_parallax: away.max(1.0), eyes };
            let part = |(left, eye)| {
                let sight = Sight::Flat(stereo.off_axis(&view, eye).unwrap());
                EyePart { corner: [left, 0], sight, circle: None }
            };
            let eyes = [(0, Eye::Left), (240, Eye::Right)].map(part);
            let (middle, options) = (Sight::Flat(view), options(CONTOURS));
            let each = check((&source, &placed), (&middle, &eyes), &options, |place| place.z);
            let [left, right] = eyes.map(|eye| draw(&source, &placed, &eye.sight, &options).colors.rgba);
            let rows = left.chunks(240).zip(right.chunks(240));
            let rgba = rows.flat_map(|(left, right)| [left, right].concat()).collect();
            let colors = Colors { width: 480, height: 180, rgba };
            assert_eq!(check_picture((&source, &placed), (&middle, &eyes), &options, colors), 2 * each);
            count += each;
        }
    }
    assert!(count > 6, "{count} heights");
}

#[test]
fn globes_have_heights_in_all_directions() {
    let height = |index: i32| {
        let (x, y) = (f64::from(index % 180), f64::from(index / 180));
        20.0 * (89.0 - 2.0 * y) + 30.0 * (4.0 * x).to_radians().sin()
    };
    let mut field = HeightField::of(180, 90, (0..90 * 180).map(height).collect());
    (field.grid.step, field.grid.origin) = ([2.0, -2.0], [-179.0, 89.0]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    let globe = Globe::sphere(20_000.0);
    let placed = Placed::new(&field.grid, Map::Globe(globe), 1.0, 0.0);
    let source = MemorySurface::new(&field, 1.0).unwrap();
    let eye = 23_000.0 * DVec3::from(Globe::up(40.0, 10.0));
    let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, Projection::Perspective { fov_y: 0.7 }, 400, 200).unwrap();
    let panorama = Panorama::around(&view, Surround::Equirectangular).unwrap().unwrap();
    let middle = Sight::Around { panorama, eye, cut: Cut::NONE };
    let contours = Contours { interval: 80.0, ..CONTOURS };
    let options = SurfaceOptions { samples: 1, ..options(contours) };
    let above = |place: DVec3| globe.geodetic(place.to_array())[2];
    let one = [EyePart { corner: [0; 2], sight: middle, circle: None }];
    let count = check((&source, &placed), (&middle, &one), &options, above);
    assert!(count > 1, "{count} heights");
    let colors = draw(&source, &placed, &middle, &options).colors;
    assert_eq!(check_picture((&source, &placed), (&middle, &one), &options, colors), count);
    let turning = [(0, -100.0), (400, 100.0)].map(|(left, offset)| EyePart {
        corner: [left, 0],
        sight: middle,
        circle: Some(Omnidirectional { offset, slices: 90 }),
    });
    let of_two = check((&source, &placed), (&middle, &turning), &options, above);
    assert!(of_two > 0 && of_two <= count, "{of_two} of {count} heights");
}
