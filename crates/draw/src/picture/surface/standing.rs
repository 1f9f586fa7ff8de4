//! Where the camera of a picture of heights stands: above and in front of them, with z up, unless a shot says otherwise.

use crate::cpu::surface::placed::{Map, Placed};
use crate::look::Shot;
use crate::model::Bounds;
use crate::picture::PictureError;
use crate::view::View;
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

/// The least distance from a target, of those up to twice `away`, at which all of a box is in the picture with a little room around it.
fn nearest(shot: &Shot, bounds: Bounds, target: DVec3, from: DVec3, away: f64) -> Result<f64, PictureError> {
    let Bounds { min, max } = bounds;
    let corner = |number: usize| DVec3::from_array([0, 1, 2].map(|axis| [min, max][number >> axis & 1][axis]));
    let fits = |distance: f64| -> Result<bool, PictureError> {
        let mut shot = shot.clone();
        (shot.camera.eye, shot.camera.target) = (Some((target + distance * from).to_array()), Some(target.to_array()));
        let view = shot.view(bounds, None)?;
        let [width, height] = [view.width, view.height].map(f64::from);
        let is_in = |at: [f64; 2]| {
            (ROOM..=1.0 - ROOM).contains(&(at[0] / width)) && (ROOM..=1.0 - ROOM).contains(&(at[1] / height))
        };
        Ok((0..8).all(|number| view.to_pixels(view.to_camera(corner(number))).is_some_and(is_in)))
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

/// From where a shot is seen.
pub(super) fn view_of(shot: &Shot, bounds: Bounds, placed: &Placed) -> Result<View, PictureError> {
    Ok(standing(shot, bounds, placed)?.view(bounds, None)?)
}

/// A shot with a camera that stands, unless it says otherwise, above and in front of the surface, with z up.
pub(super) fn standing(shot: &Shot, bounds: Bounds, placed: &Placed) -> Result<Shot, PictureError> {
    let mut shot = shot.clone();
    let camera = &mut shot.camera;
    camera.up = Some(camera.up.unwrap_or([0.0, 0.0, 1.0]));
    if camera.eye.is_none() {
        let target = camera.target.map_or(bounds.center(), DVec3::from);
        let mut free = shot.clone();
        (free.camera.up, free.surround) = (None, crate::view::Surround::Flat);
        let away = (free.view(bounds, None)?.eye - target).length();
        let from = if placed.is_flat() { DVec3::new(0.0, -1.0, 0.9) } else { DVec3::new(1.0, -0.4, 0.5) };
        let eye = match shot.surround.is_flat() {
            true => target + nearest(&shot, bounds, target, from.normalize(), away)? * from.normalize(),
            // Around the eye there is nothing to see from within the surface.
            false => DVec3::new(target.x, target.y, bounds.max.z + 0.05 * bounds.size().length()),
        };
        shot.camera.eye = Some(eye.to_array());
        if !shot.surround.is_flat() && shot.camera.target.is_none() {
            shot.camera.target = Some((eye + DVec3::Y * bounds.size().length().max(1e-30)).to_array());
        }
    }
    if shot.camera.target.is_none() {
        let center = bounds.center();
        // Around an eye in the middle there is no other way to look than ahead.
        let is_there = shot.camera.eye.is_some_and(|eye| DVec3::from(eye) == center);
        let ahead = if is_there { DVec3::Z * bounds.size().length().max(1e-30) } else { DVec3::ZERO };
        shot.camera.target = Some((center - ahead).to_array());
    }
    Ok(shot)
}
