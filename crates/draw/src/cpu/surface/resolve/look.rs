//! The place of the surface at a pixel's centre, for looks, found from the point that the pixel shows.

use super::super::placed::GridRay;
use super::super::raster::Shown;
use super::super::rays::CellFrame;
use super::super::stitch::Mesh;
use super::{Hit, Met, OUTSIDE, Resolver, weights};

/// Between which rows and columns a ray is where it is as high as the samples about a point.
#[derive(Clone, Copy, Debug)]
struct Reach {
    rows: [f64; 2],
    columns: [f64; 2],
}

impl Reach {
    /// Of a ray and the eight samples around one. `None` where it is not much steeper than the surface there, as what is rounded counts for much
    /// then, and where heights may be others than the samples' own: along a chunk's sides, and where there is a membrane.
    fn of(mesh: &Mesh, [row, column]: [usize; 2], ray: &GridRay) -> Option<Reach> {
        let samples = &mesh.samples;
        let is_inside = |at: usize, count: usize| at >= 2 && at + 2 < count;
        if !is_inside(row, samples.rows) || !is_inside(column, samples.columns) || mesh.membrane().is_some() {
            return None;
        }
        let ([mut low, mut high], mut line) = ([f64::INFINITY, f64::NEG_INFINITY], [0.0_f64; 3]);
        for row in row - 1..=row + 1 {
            let first = row * samples.columns + column - 1;
            samples.heights.copy(first..first + 3, &mut line);
            line.iter().for_each(|height| (low, high) = (low.min(*height), high.max(*height)));
        }
        // All four cells are as large.
        let CellFrame { first, size } = CellFrame::of(mesh, [row, column]);
        let (GridRay { origin, direction }, rise) = (ray, high - low);
        let (across, along, down) = (direction[0].abs(), direction[1].abs(), direction[2].abs());
        let is_steep = 2.0 * rise * (across * size[0] + along * size[1]) < down * size[0] * size[1];
        if !is_steep {
            return None;
        }
        // By far more than what is rounded where the ray meets a triangle.
        let wider = 1e-6 * rise + 1e-9 * (low.abs().max(high.abs()) + origin[2].abs());
        let ends = [(low - wider - origin[2]) / direction[2], (high + wider - origin[2]) / direction[2]];
        let between = |axis: usize, first: f64, size: f64| {
            let (from, to) = (ends[0] * direction[axis] + origin[axis], ends[1] * direction[axis] + origin[axis]);
            let wider = 1e-6 * size + 1e-12 * (origin[axis].abs() + first);
            [from.min(to) - wider, from.max(to) + wider]
        };
        Some(Reach { rows: between(1, first[0], size[0]), columns: between(0, first[1], size[1]) })
    }

    /// Whether it passes by a cell.
    fn misses(&self, CellFrame { first, size }: &CellFrame) -> bool {
        let is_beside = |[from, to]: [f64; 2], axis: usize| to < first[axis] || from > first[axis] + size[axis];
        is_beside(self.rows, 0) || is_beside(self.columns, 1)
    }
}

/// The first place where a ray meets a triangle of a point's sample; cells that it passes by are not looked at.
fn nearest(mesh: &Mesh, shown: Shown, ray: &GridRay, reach: Option<Reach>) -> Option<Met> {
    let [row, column] = shown.at;
    let mut best: Option<(f64, Met)> = None;
    for (up, left) in [(1, 1), (1, 0), (0, 1), (0, 0)] {
        if row < up || column < left || row - up + 1 >= mesh.samples.rows || column - left + 1 >= mesh.samples.columns {
            continue;
        }
        let at = [row - up, column - left];
        let frame = CellFrame::of(mesh, at);
        if reach.is_some_and(|reach| reach.misses(&frame)) {
            continue;
        }
        let local = frame.ray(ray);
        for (slot, (triangle, is_membrane)) in mesh.triangles(at[0], at[1]).enumerate() {
            let Some(t) = local.meets(&triangle).filter(|t| *t >= 0.0 && best.is_none_or(|(nearest, _)| *t < nearest))
            else {
                continue;
            };
            let [u, v, _] = local.0.at(t);
            if weights(triangle.corners, [u, v]).into_iter().all(|weight| weight >= -OUTSIDE) {
                let shown = Shown { node: shown.node, at, slot: Some(slot) };
                best = Some((t, Met { shown, at, triangle, frame, place: [u, v], is_membrane }));
            }
        }
    }
    best.map(|(_, met)| met)
}

impl Resolver<'_> {
    /// The place of the surface at a pixel's centre, for looks: as [`Resolver::hit`], but where a point is shown it is where the centre's ray
    /// meets a triangle of its sample, as points are there to find those quickly; where it meets none, what a ray finds; where that passes by,
    /// the sample's margin, and nothing beside that. A sample in no triangle is a point, and so is one of a field that is thinner than a pixel.
    pub fn look(&self, shown: Shown, pixel: [f64; 2]) -> Option<Hit> {
        let mesh = self.scene.meshes.get(shown.node)?;
        let [row, column] = shown.at;
        let is_own = shown.slot.is_none() && mesh.is_point(row, column) && !mesh.is_lone(row, column);
        if !is_own || self.is_thin(mesh, [row, column]) {
            return self.hit(shown, pixel);
        }
        let Some((origin, direction)) = self.ray(pixel) else { return self.hit(shown, pixel) };
        // On globes as adapters have it.
        let Some(ray) = self.scene.placed.ray(origin, direction) else {
            return self.point(shown, mesh, pixel, false);
        };
        match nearest(mesh, shown, &ray, Reach::of(mesh, shown.at, &ray)) {
            Some(met) => Some(self.met(mesh, &met, origin)),
            None => self.cast(pixel).or_else(|| self.margin(shown, pixel)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::memory::MemorySurface;
    use super::super::super::picture::{SurfaceOptions, scene, visible};
    use super::super::super::sight::Sight;
    use super::super::super::tests::{hills, placed};
    use super::*;
    use crate::view::{Projection, View};
    use glam::DVec3;

    #[test]
    fn cells_are_passed_by_only_where_nothing_is_met() {
        let (mut known, mut met, mut beside) = (0, 0, 0);
        let flat = Projection::Orthographic { height: 1000.0 };
        let perspective = Projection::Perspective { fov_y: 0.8 };
        for (holes, seed) in [(0.0, 5), (0.2, 6)] {
            let field = hills(900, 700, holes, seed);
            let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
            let leaning = DVec3::new(0.3, -0.2, 1.0).normalize();
            for (back, projection) in [
                (DVec3::Z, flat),
                (DVec3::Z, perspective),
                (leaning, flat),
                (leaning, perspective),
                (DVec3::new(1.0, 0.5, 0.2).normalize(), flat),
            ] {
                let middle = DVec3::new(350.5, 450.5, 0.0);
                let view = View::look_at(middle + 1200.0 * back, middle, DVec3::Y, projection, 90, 90).unwrap();
                let (sight, options) = (Sight::Flat(view), SurfaceOptions::default());
                let scene = scene(&source, &placed, &sight, &options);
                let (seen, _) = visible(&scene, &sight, &options, 1);
                for index in 0..seen.width * seen.height {
                    let Some(shown) = seen.at(index).filter(|shown| shown.slot.is_none()) else { continue };
                    let pixel = [index % seen.width, index / seen.width].map(|at| at as f64 + 0.5);
                    let (origin, direction) = sight.ray(pixel).unwrap();
                    let ray = placed.ray(origin, direction).unwrap();
                    let mesh = &scene.meshes[shown.node];
                    let reach = Reach::of(mesh, shown.at, &ray);
                    let place = |met: Met| (met.shown, met.place);
                    let expected = nearest(mesh, shown, &ray, None).map(place);
                    assert_eq!(nearest(mesh, shown, &ray, reach).map(place), expected, "{pixel:?}");
                    known += usize::from(reach.is_some());
                    met += usize::from(expected.is_some());
                    beside += usize::from(expected.is_none());
                }
            }
        }
        assert!(known > 4000 && met > 1000 && beside > 1000, "{known} known, {met} met, {beside} beside");
    }
}
