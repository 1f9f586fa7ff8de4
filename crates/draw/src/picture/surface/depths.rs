//! How far surfaces are away in a picture: what of lines and marks that are drawn over it lies behind them.

use crate::cpu::paths::PathFragments;
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// What is farther behind a surface than this is hidden, pixels as long as they are there: what is drawn may be beside the surface by its error
/// bound, and lies on it by a rounding.
const SLACK: f64 = 2.0;
/// Fragments that cover a pixel by this much hide what is behind them.
const COVERS: f32 = 0.5;

/// How far the surfaces of a picture are from the plane of its eye.
#[derive(Clone, Debug)]
pub struct SurfaceDepths {
    view: View,
    /// Pixel by pixel, row by row; infinite where there is nothing.
    depths: Vec<f32>,
}

/// A part of a line, and whether it is hidden.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Whether a surface is in front of it.
    pub is_hidden: bool,
    /// Its places, two at least.
    pub places: Vec<DVec3>,
}

impl SurfaceDepths {
    /// Of a picture of a view, with a depth for each of its pixels; `None` where there are not as many.
    pub fn new(view: View, depths: Vec<f32>) -> Option<SurfaceDepths> {
        (depths.len() == view.width as usize * view.height as usize).then_some(SurfaceDepths { view, depths })
    }

    /// Of what covers the pixels of a view.
    pub fn of_fragments(view: &View, fragments: &PathFragments) -> Option<SurfaceDepths> {
        let depth = |x: usize, y: usize| {
            let mut through = 1.0;
            let covering = fragments.of(x, y).iter().find(|fragment| {
                through *= 1.0 - fragment.alpha;
                through <= 1.0 - COVERS
            });
            covering.map_or(f32::INFINITY, |fragment| fragment.depth)
        };
        let [width, height] = fragments.size;
        let row = |y: usize| (0..width).map(move |x| depth(x, y));
        let depths = (0..height).into_par_iter().flat_map_iter(row).collect();
        SurfaceDepths::new(*view, depths)
    }

    /// Whether a place is behind what the picture shows: behind all of the pixels around it, so that a line along a ridge is seen. Beside the
    /// picture nothing is.
    pub fn hides(&self, place: DVec3) -> bool {
        let camera = self.view.to_camera(place);
        let Some([x, y]) = self.view.to_pixels(camera).filter(|_| camera.z > 0.0) else { return false };
        let size = [self.view.width, self.view.height].map(|size| size as i64);
        let [column, row] = [x, y].map(|at| at.floor().clamp(-2.0, 1e9) as i64);
        if !(0..size[0]).contains(&column) || !(0..size[1]).contains(&row) {
            return false;
        }
        let focal = self.view.focal_pixels();
        let pixel = match self.view.projection {
            Projection::Perspective { .. } => camera.z / focal,
            Projection::Orthographic { .. } => 1.0 / focal,
        };
        let near = (row - 1..=row + 1).flat_map(|y| (column - 1..=column + 1).map(move |x| [x, y]));
        let inside = near.filter(|[x, y]| (0..size[0]).contains(x) && (0..size[1]).contains(y));
        let depths = inside.map(|[x, y]| self.depths.get((y * size[0] + x) as usize).copied().unwrap_or(f32::INFINITY));
        camera.z > f64::from(depths.fold(0.0, f32::max)) + SLACK * pixel
    }
}

/// A line through places in parts that are seen and parts that are hidden: of a stretch both ends have to be seen.
pub fn pieces(places: &[DVec3], hides: impl Fn(DVec3) -> bool) -> Vec<Piece> {
    let hidden: Vec<bool> = places.iter().map(|place| hides(*place)).collect();
    let mut pieces: Vec<Piece> = Vec::new();
    for (ends, hidden) in places.windows(2).zip(hidden.windows(2)) {
        let is_hidden = hidden[0] || hidden[1];
        match pieces.last_mut().filter(|piece| piece.is_hidden == is_hidden) {
            Some(piece) => piece.places.push(ends[1]),
            None => pieces.push(Piece { is_hidden, places: ends.to_vec() }),
        }
    }
    pieces
}

#[cfg(test)]
mod tests;
