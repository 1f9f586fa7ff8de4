//! A mesh that bends a flat picture into an output's.

use super::{Cover, Projector};

/// Pixels of the output for a mesh's cell.
pub(super) const CELL: u32 = 12;
/// The most cells along a side.
const MOST: u32 = 256;

/// A grid of points of the output, evenly spaced from edge to edge, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Points in a row.
    pub columns: u32,
    /// Rows.
    pub rows: u32,
    /// Where in the picture each point's colour is: shares of its width from the left and of its height from the top; `None` where
    /// nothing is displayed.
    pub points: Vec<Option<[f32; 2]>>,
}

impl Mesh {
    /// The mesh of an output of `size` pixels whose picture is `cover`.
    pub fn of(projector: &Projector, cover: &Cover, size: [u32; 2], fov_y: f64) -> Mesh {
        let [columns, rows] = size.map(|side| side.div_ceil(CELL).clamp(1, MOST) + 1);
        let share = |i: u32, count: u32| f64::from(i) / f64::from(count - 1);
        let point = |i: u32| {
            let at = [share(i % columns, columns), share(i / columns, rows)];
            let place = cover.place(projector.direction(at, fov_y)?)?;
            Some(place.map(|x| x as f32))
        };
        Mesh { columns, rows, points: (0..columns * rows).map(point).collect() }
    }

    /// The corners of the cells that are displayed whole, as indices of points: upper left, upper right, lower left, lower right.
    pub fn cells(&self) -> impl Iterator<Item = [u32; 4]> + '_ {
        let corner = |i: u32| {
            let (x, y) = (i % (self.columns - 1), i / (self.columns - 1));
            let at = y * self.columns + x;
            [at, at + 1, at + self.columns, at + self.columns + 1]
        };
        let is_whole = |cell: &[u32; 4]| cell.iter().all(|&at| self.points[at as usize].is_some());
        (0..(self.columns - 1) * (self.rows - 1)).map(corner).filter(is_whole)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::show::rig::{Area, CoverError, Frustum, Output, Shows};
    use std::path::Path;

    fn projector(shows: Shows, size: [u32; 2]) -> Projector {
        let output =
            Output { name: "a".into(), monitor: None, window: None, shows, warp: None, blend: None, blend_gamma: 1.0 };
        Projector::open(&output, Path::new(""), size).unwrap()
    }

    const FOV: f64 = 0.8;

    /// What a bent picture shows differs from what the output is to show by less than a third of an output's pixel, and the picture's
    /// pixels are no larger than the output's.
    #[test]
    fn bent_pictures_show_what_they_should() {
        let frustum = Frustum { yaw: 35.0, pitch: 20.0, roll: 10.0, left: -40.0, right: 25.0, down: -10.0, up: 30.0 };
        let dome = |tilt, x: f64, y: f64| Shows::Dome { aperture: 180.0, tilt, part: Area(x, y, x + 0.5, y + 0.5) };
        for shows in [
            Shows::default(),
            Shows::Flat { aspect: Some(3.0), part: Area(0.6, 0.0, 1.0, 0.5) },
            Shows::Frustum(frustum),
            dome(0.0, 0.0, 0.0),
            dome(20.0, 0.5, 0.5),
            dome(90.0, 0.0, 0.5),
        ] {
            let size = [960, 720];
            let projector = projector(shows.clone(), size);
            let cover = Cover::of(&projector, size, FOV).unwrap();
            let [right, up, forward] = cover.axes;
            assert!(right.cross(up).distance(forward) < 1e-9, "{:?}", cover.axes);
            let mesh = Mesh::of(&projector, &cover, size, FOV);
            let mut seen = 0;
            for [a, b, c, d] in mesh.cells() {
                let corner = |at: u32| mesh.points[at as usize].unwrap().map(f64::from);
                let (x, y) = (a % mesh.columns, a / mesh.columns);
                // The corner of a triangle, and the middle of the diagonal that divides the cell.
                let middle = [0, 1].map(|k| 0.5 * (corner(b)[k] + corner(c)[k]));
                let at = [
                    (f64::from(x) + 0.5) / f64::from(mesh.columns - 1),
                    (f64::from(y) + 0.5) / f64::from(mesh.rows - 1),
                ];
                let expected = cover.place(projector.direction(at, FOV).unwrap()).unwrap();
                let pixels = [0, 1].map(|k| f64::from(cover.size[k]));
                let error = ((middle[0] - expected[0]) * pixels[0]).hypot((middle[1] - expected[1]) * pixels[1]);
                let step = |from: u32, to: u32, cells: f64| {
                    let [from, to] = [corner(from), corner(to)];
                    ((to[0] - from[0]) * pixels[0]).hypot((to[1] - from[1]) * pixels[1]) / cells
                };
                let cell =
                    [f64::from(size[0]) / f64::from(mesh.columns - 1), f64::from(size[1]) / f64::from(mesh.rows - 1)];
                let [along, down] = [step(a, b, cell[0]), step(c, d, cell[0]).min(step(a, c, cell[1]))];
                assert!(error / along.min(down).max(1.0) < 0.34, "{shows:?} at {at:?}: {error} {along} {down}");
                seen += 1;
            }
            assert!(seen as f64 > 0.7 * f64::from((mesh.columns - 1) * (mesh.rows - 1)), "{shows:?}: {seen}");
            assert!(mesh.points.iter().flatten().flatten().all(|share| (0.0..=1.0).contains(share)), "{shows:?}");
        }
    }

    #[test]
    fn what_no_flat_picture_covers_is_said() {
        let whole = projector(Shows::Dome { aperture: 180.0, tilt: 0.0, part: Area::default() }, [512, 512]);
        assert_eq!(Cover::of(&whole, [512, 512], FOV), Err(CoverError::Wide));
        let quarter = projector(Shows::Dome { aperture: 180.0, tilt: 0.0, part: Area(0.0, 0.0, 0.5, 0.5) }, [512, 512]);
        let cover = Cover::of(&quarter, [512, 512], FOV).unwrap();
        assert!(cover.size[0] < 2048 && cover.size[1] < 2048 && cover.fov_y.to_degrees() < 140.0, "{cover:?}");
    }
}
