//! Where the camera of a picture of heights stands, unless a shot says otherwise: above and in front of them, with z up, and of a part of a globe
//! straight above its middle.

use crate::cpu::surface::placed::{Map, Placed};
use crate::look::Shot;
use crate::model::Bounds;
use crate::picture::PictureError;
use crate::view::{Surround, View};
use glam::DVec3;

/// The box around a surface whose heights are between these.
pub(super) fn bounds_of(placed: &Placed, heights: [f64; 2]) -> Bounds {
    let ends = heights.map(|height| placed.lifted(height));
    let top = ends[0].max(ends[1]);
    if let Map::Globe(globe) = placed.map {
        let reach = DVec3::splat(globe.reach() + top);
        return Bounds { min: -reach, max: reach };
    }
    let [columns, rows] = placed.samples.map(|count| (count - 1) as f64);
    let corners = [(0.0, 0.0), (rows, columns)].map(|(row, column)| placed.world(row, column, heights[0]));
    let (low, high) = (corners[0].min(corners[1]), corners[0].max(corners[1]));
    Bounds { min: DVec3::new(low.x, low.y, ends[0].min(ends[1])), max: DVec3::new(high.x, high.y, top) }
}

/// Places on a globe, which lie all around it, that have to be in the picture.
const PLACES: usize = 512;
/// Those along rows, and along columns, of a part of a globe.
const ALONG: usize = 9;

/// Whether a box is that of a globe alone.
fn is_globe(bounds: Bounds, placed: &Placed) -> bool {
    !placed.is_flat() && bounds.min == -bounds.max && bounds.max == DVec3::splat(bounds.max.x)
}

/// The middle of a field that is a part of a globe, which it does not go round, and places all over it, as high as its box reaches.
fn part_of_globe(bounds: Bounds, placed: &Placed) -> Option<(DVec3, Vec<DVec3>)> {
    let Map::Globe(globe) = placed.map else { return None };
    if placed.around.is_some() || !is_globe(bounds, placed) {
        return None;
    }
    let place = |shares: [f64; 2]| {
        let at =
            |axis: usize| shares[axis] * (placed.samples[axis] - 1) as f64 * placed.step[axis] + placed.origin[axis];
        DVec3::from(globe.place(at(0), at(1), 0.0))
    };
    let share = |number: usize| number as f64 / (ALONG - 1) as f64;
    let above = |number: usize| bounds.max.x * place([share(number % ALONG), share(number / ALONG)]).normalize();
    Some((place([0.5; 2]), (0..ALONG * ALONG).map(above).collect()))
}

/// Places between which all lies that is to be in the picture: on a globe that is alone in its box, else the box's corners.
fn outermost(bounds: Bounds, placed: &Placed) -> Vec<DVec3> {
    let Bounds { min, max } = bounds;
    if is_globe(bounds, placed) {
        // A spiral from pole to pole, whose turns are as far apart as its places.
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let place = |number: usize| {
            let z = 1.0 - (2 * number + 1) as f64 / PLACES as f64;
            let (sin, cos) = (golden * number as f64).sin_cos();
            let around = (1.0 - z * z).sqrt();
            max.x * DVec3::new(around * cos, around * sin, z)
        };
        return (0..PLACES).map(place).collect();
    }
    let corner = |number: usize| DVec3::from_array([0, 1, 2].map(|axis| [min, max][number >> axis & 1][axis]));
    (0..8).map(corner).collect()
}

/// The least distance from a target, of those up to twice `away`, at which these places are in the picture with a little room around them.
fn nearest(
    shot: &Shot,
    bounds: Bounds,
    places: &[DVec3],
    target: DVec3,
    from: DVec3,
    away: f64,
) -> Result<f64, PictureError> {
    let fits = |distance: f64| -> Result<bool, PictureError> {
        let mut shot = shot.clone();
        (shot.camera.eye, shot.camera.target) = (Some((target + distance * from).to_array()), Some(target.to_array()));
        let view = shot.view(bounds, None)?;
        let [width, height] = [view.width, view.height].map(f64::from);
        let is_in = |at: [f64; 2]| {
            (ROOM..=1.0 - ROOM).contains(&(at[0] / width)) && (ROOM..=1.0 - ROOM).contains(&(at[1] / height))
        };
        Ok(places.iter().all(|place| view.to_pixels(view.to_camera(*place)).is_some_and(is_in)))
    };
    let (mut near, mut far) = (0.1 * away, 2.0 * away);
    if !fits(far)? {
        return Ok(0.72 * away);
    }
    for _ in 0..12 {
        let middle = 0.5 * (near + far);
        if fits(middle)? { far = middle } else { near = middle }
    }
    Ok(far)
}

/// The share of a picture that is left free at each of its sides around a surface.
const ROOM: f64 = 0.04;

/// From where a shot is seen, and what it looks at.
pub(in crate::picture) fn view_of(shot: &Shot, bounds: Bounds, placed: &Placed) -> Result<(View, DVec3), PictureError> {
    let shot = standing(shot, bounds, placed)?;
    Ok((shot.view(bounds, None)?, shot.camera.target.map_or(bounds.center(), DVec3::from)))
}

/// How far from a target a flat picture is taken that has all of a box in it.
fn distance(shot: &Shot, bounds: Bounds, target: DVec3) -> Result<f64, PictureError> {
    let mut free = shot.clone();
    (free.camera.up, free.surround) = (None, Surround::Flat);
    Ok((free.view(bounds, None)?.eye - target).length())
}

/// A shot with a camera that stands, unless it says otherwise, above and in front of the surface, with z up; of a part of a globe straight above its
/// middle, where one in front of the globe may see its inner side.
pub(in crate::picture) fn standing(shot: &Shot, bounds: Bounds, placed: &Placed) -> Result<Shot, PictureError> {
    let mut shot = shot.clone();
    let said_up = shot.camera.up;
    shot.camera.up = Some(said_up.unwrap_or([0.0, 0.0, 1.0]));
    let is_free = shot.camera.eye.is_none() && shot.camera.target.is_none() && shot.surround.is_flat();
    if let Some((middle, places)) = part_of_globe(bounds, placed).filter(|_| is_free) {
        let own = Bounds::of(places.iter().map(|place| place.to_array()));
        let (away, from) = (distance(&shot, own, own.center())?, middle.normalize());
        let eye = middle + nearest(&shot, bounds, &places, middle, from, away)? * from;
        (shot.camera.eye, shot.camera.target) = (Some(eye.to_array()), Some(middle.to_array()));
    }
    if shot.camera.eye.is_none() {
        let target = shot.camera.target.map_or(bounds.center(), DVec3::from);
        let away = distance(&shot, bounds, target)?;
        let from = if placed.is_flat() { DVec3::new(0.0, -1.0, 0.9) } else { DVec3::new(1.0, -0.4, 0.5) };
        let from = from.normalize();
        let before_it = || -> Result<DVec3, PictureError> {
            Ok(target + nearest(&shot, bounds, &outermost(bounds, placed), target, from, away)? * from)
        };
        let (eye, front, up) = match shot.surround {
            Surround::Flat => (before_it()?, None, None),
            // A dome is over its front, and over what lies below the eye there is nothing of it.
            Surround::Dome { .. } => {
                let eye = before_it()?;
                let (sin, cos) = shot.surround.screen().0.sin_cos();
                let upright = DVec3::Z.reject_from_normalized(from).normalize();
                (eye, Some(-cos * from - sin * upright), Some(cos * upright - sin * from))
            }
            // Around the eye there is nothing to see from within the surface.
            _ => (DVec3::new(target.x, target.y, bounds.max.z + 0.05 * bounds.size().length()), Some(DVec3::Y), None),
        };
        shot.camera.eye = Some(eye.to_array());
        if let Some(front) = front.filter(|_| shot.camera.target.is_none()) {
            shot.camera.target = Some((eye + front * bounds.size().length().max(1e-30)).to_array());
            shot.camera.up = said_up.or(up.map(|up| up.to_array())).or(shot.camera.up);
        }
    }
    if shot.camera.target.is_none() {
        let center = bounds.center();
        // Around an eye in the middle there is no other way to look than ahead.
        let is_there = shot.camera.eye.is_some_and(|eye| DVec3::from(eye) == center);
        let ahead = if is_there { DVec3::Z * bounds.size().length().max(1e-30) } else { DVec3::ZERO };
        shot.camera.target = Some((center - ahead).to_array());
    }
    if let (Some(eye), Some(target), None) = (shot.camera.eye, shot.camera.target, said_up) {
        let along = DVec3::from(target) - DVec3::from(eye);
        // Straight from above y points up, as on a map.
        if shot.camera.up == Some([0.0, 0.0, 1.0]) && along.cross(DVec3::Z).length() <= 1e-6 * along.length() {
            shot.camera.up = Some([0.0, 1.0, 0.0]);
        }
    }
    Ok(shot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heights::model::{Globe, HeightField};
    use crate::model::Unit;

    #[test]
    fn a_globe_fills_its_picture() {
        let mut field = HeightField::of(36, 19, vec![0.0; 36 * 19]);
        (field.grid.origin, field.grid.step, field.grid.xy_unit) = ([-180.0, -90.0], [10.0, 10.0], Unit::new("deg"));
        let placed = Placed::new(&field.grid, Map::Globe(Globe::sphere(1000.0)), 1.0, 0.0);
        let bounds = bounds_of(&placed, [0.0, 10.0]);
        for size in [(400, 300), (300, 400)] {
            let shot = Shot { size: Some(size), ..Shot::default() };
            let view = view_of(&shot, bounds, &placed).unwrap().0;
            // The rim that is seen, in pixels from the middle.
            let rim = view.focal_pixels() * (1010.0 / view.eye.length()).asin().tan();
            let half = 0.5 * f64::from(size.0.min(size.1));
            assert!((0.88 * half..0.95 * half).contains(&rim), "{size:?}: {rim} of {half}");
        }
    }

    #[test]
    fn a_part_of_a_globe_is_seen_from_above_its_middle() {
        // On the far side from where whole globes are seen, and as small as a town.
        for step in [1.0, 0.01] {
            let mut field = HeightField::of(26, 21, vec![0.0; 26 * 21]);
            (field.grid.origin, field.grid.step, field.grid.xy_unit) = ([190.0, -30.0], [step, step], Unit::new("deg"));
            let placed = Placed::new(&field.grid, Map::Globe(Globe::sphere(1000.0)), 1.0, 0.0);
            let bounds = bounds_of(&placed, [0.0, 0.1]);
            for size in [(400, 300), (300, 400)] {
                let shot = Shot { size: Some(size), ..Shot::default() };
                let (view, target) = view_of(&shot, bounds, &placed).unwrap();
                assert!(target.distance(placed.world(10.0, 12.5, 0.0)) < 1e-9);
                let half = [0.5 * f64::from(size.0), 0.5 * f64::from(size.1)];
                // To the right and up, from -1 to 1.
                let seen = |row: f64, column: f64| {
                    let [x, y] = view.to_pixels(view.to_camera(placed.world(row, column, 0.0))).unwrap();
                    [x / half[0] - 1.0, 1.0 - y / half[1]]
                };
                assert!(seen(10.0, 12.5).into_iter().all(|part| part.abs() < 1e-6));
                assert!(seen(20.0, 12.5)[1] > 0.3 && seen(10.0, 25.0)[0] > 0.3, "north is up, and east right");
                let corners = [seen(0.0, 0.0), seen(0.0, 25.0), seen(20.0, 0.0), seen(20.0, 25.0)];
                let most = corners.into_iter().flatten().map(f64::abs).fold(0.0, f64::max);
                assert!((0.8..0.93).contains(&most), "{size:?}, steps of {step}: {most}");
            }
            // Who says what to look at looks at that.
            let mut told = Shot::default();
            told.camera.target = Some([0.0; 3]);
            assert_eq!(view_of(&told, bounds, &placed).unwrap().1, DVec3::ZERO);
        }
    }

    #[test]
    fn a_dome_has_the_surface_above_its_front() {
        let mut field = HeightField::of(36, 19, vec![0.0; 36 * 19]);
        (field.grid.origin, field.grid.step, field.grid.xy_unit) = ([-180.0, -90.0], [10.0, 10.0], Unit::new("deg"));
        for map in [Map::Globe(Globe::sphere(1000.0)), Map::Plate] {
            let placed = Placed::new(&field.grid, map, 1.0, 0.0);
            let bounds = bounds_of(&placed, [0.0, 10.0]);
            for tilt in [0.0, 25.0, 90.0] {
                let surround = Surround::Dome { aperture: 180.0, tilt };
                let shot = Shot { surround, ..Shot::default() };
                let view = view_of(&shot, bounds, &placed).unwrap().0;
                let toward = (bounds.center() - view.eye).normalize();
                let elevation = toward.dot(view.up).asin();
                assert!((elevation - surround.screen().0).abs() < 1e-9, "{tilt}: {}", elevation.to_degrees());
                assert!(toward.dot(view.right).abs() < 1e-9 && toward.dot(view.forward) > 0.0);
                // Who says where the front is has it there.
                let mut told = shot.clone();
                told.camera.target = Some(bounds.center().to_array());
                let view = view_of(&told, bounds, &placed).unwrap().0;
                assert!((bounds.center() - view.eye).normalize().dot(view.forward) > 1.0 - 1e-12);
            }
        }
    }

    #[test]
    fn straight_from_above_y_points_up() {
        let field = HeightField::of(36, 19, vec![0.0; 36 * 19]);
        let placed = Placed::new(&field.grid, Map::Plate, 1.0, 0.0);
        let bounds = bounds_of(&placed, [0.0, 10.0]);
        let mut shot = Shot::default();
        shot.camera.eye = Some((bounds.center() + 100.0 * DVec3::Z).to_array());
        let view = view_of(&shot, bounds, &placed).unwrap().0;
        assert!(view.right.distance(DVec3::X) < 1e-12 && view.up.distance(DVec3::Y) < 1e-12, "{view:?}");
    }
}
