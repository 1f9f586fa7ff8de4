//! From what a pixel shows to the exact place: where the ray through its centre meets the triangle that is drawn there; of a point the place of
//! its sample.

use super::lattice::CHUNK;
use super::placed::{GridRay, Vantage};
use super::raster::Shown;
use super::rays::CellFrame;
use super::sight::Sight;
use super::stitch::{Mesh, Scene};
use deepfield_heights::model::Triangle;
use glam::DVec3;

/// What a pixel shows, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Which triangle or point.
    pub shown: Shown,
    /// Along the middle line of sight; in pictures of all directions the distance.
    pub depth: f64,
    /// Row, with a fraction.
    pub row: f64,
    /// Column, with a fraction.
    pub column: f64,
    /// True height.
    pub height: f64,
    /// The share that is covered, from 0 to 1.
    pub coverage: f64,
    /// What a column and a row add to the height on the triangle; `None` for a point.
    pub slope: Option<[f64; 2]>,
}

/// Channels of a raw picture.
pub const CHANNELS: usize = 7;

/// Rounding may leave a pixel's centre so far outside of its triangle, in the triangle's own size.
const OUTSIDE: f64 = 1e-9;

impl Hit {
    /// Depth, x, y, height, row, column, coverage.
    pub fn raw(&self, scene: &Scene) -> [f64; CHANNELS] {
        let [x, y] = scene.placed.file_place(self.row, self.column);
        [self.depth, x, y, self.height, self.row, self.column, self.coverage]
    }
}

/// What a pixel without a hit has in a raw picture.
pub const NOTHING: [f64; CHANNELS] = [f64::NAN; CHANNELS];

/// Finds the places of what is shown.
pub struct Resolver<'a> {
    /// What is drawn.
    pub scene: &'a Scene,
    /// Who looks.
    pub sight: &'a Sight,
    /// Samples as the eye has them.
    pub vantage: Vantage,
}

impl<'a> Resolver<'a> {
    /// For a scene and an eye.
    pub fn new(scene: &'a Scene, sight: &'a Sight) -> Resolver<'a> {
        Resolver { scene, sight, vantage: Vantage::new(&scene.placed, sight.eye()) }
    }

    /// The place of what is shown at a place of the picture.
    pub fn hit(&self, shown: Shown, pixel: [f64; 2]) -> Option<Hit> {
        let mesh = self.scene.meshes.get(shown.node)?;
        let [row, column] = shown.at;
        let Some(slot) = shown.slot else {
            let index = row * mesh.samples.columns + column;
            let height = mesh.heights()[index];
            let relative = self.vantage.relative(mesh.rows[row], mesh.columns[column], height);
            let (_, depth) = self.sight.project(relative)?;
            let coverage = f64::from(mesh.opacity(row, column));
            let [row, column] = [mesh.rows[row], mesh.columns[column]].map(|place| place as f64);
            return Some(Hit { shown, depth, row, column, height, coverage, slope: None });
        };
        let triangle = mesh.cell(row, column).triangles().nth(slot)?;
        let (origin, direction) = self.sight.ray(pixel)?;
        let frame = CellFrame::of(mesh, shown.at);
        let [u, v] = match self.scene.placed.ray(origin, direction) {
            Some(ray) => self.flat(mesh, shown.at, &triangle, &frame, &ray, pixel),
            None => self.curved(mesh, shown.at, &triangle, origin, direction),
        };
        let [p, q, s] = triangle.at;
        let height = p + q * u + s * v;
        let (row, column) = (v.mul_add(frame.size[0], frame.first[0]), u.mul_add(frame.size[1], frame.first[1]));
        let relative = self.scene.placed.world(row, column, height) - origin;
        let depth = match self.sight {
            Sight::Flat(view) => relative.dot(view.forward),
            Sight::Around { .. } => relative.length(),
        };
        let coverage = self.coverage(mesh, shown.at, &triangle, [u, v]);
        let slope = Some([q / frame.size[1], s / frame.size[0]]);
        Some(Hit { shown, depth, row, column, height, coverage, slope })
    }

    fn flat(
        &self,
        mesh: &Mesh,
        at: [usize; 2],
        triangle: &Triangle,
        frame: &CellFrame,
        ray: &GridRay,
        pixel: [f64; 2],
    ) -> [f64; 2] {
        let local = frame.ray(ray);
        let found = local.meets(triangle).map(|t| local.0.at(t));
        match found {
            Some([u, v, _]) if weights(triangle.corners, [u, v]).into_iter().all(|weight| weight >= -OUTSIDE) => [u, v],
            // The centre is within rounding of an edge, or the triangle is seen from its edge: what it shows is on the edge.
            found => self.on_edge(mesh, at, triangle, pixel).unwrap_or_else(|| {
                let [u, v] = found.map_or([0.5, 0.5], |[u, v, _]| [u, v]);
                let weights = weights(triangle.corners, [u, v]).map(|weight| weight.max(0.0));
                let sum: f64 = weights.iter().sum();
                place(triangle.corners, weights.map(|weight| if sum > 0.0 { weight / sum } else { 1.0 / 3.0 }))
            }),
        }
    }

    /// The place on a triangle's edge that appears nearest to a pixel; `None` where a corner is not before the eye.
    fn on_edge(&self, mesh: &Mesh, at: [usize; 2], triangle: &Triangle, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let heights = mesh.cell(at[0], at[1]).0;
        let mut seen = [([0.0; 2], 0.0); 3];
        for (seen, corner) in seen.iter_mut().zip(triangle.corners) {
            let (row, column) = (mesh.rows[at[0] + corner / 2], mesh.columns[at[1] + corner % 2]);
            *seen = self.sight.project(self.vantage.relative(row, column, heights[corner]))?;
        }
        let is_perspective = !matches!(
            self.sight,
            Sight::Flat(crate::view::View { projection: crate::view::Projection::Orthographic { .. }, .. })
        );
        let mut best = (f64::INFINITY, [0.0; 3]);
        for k in 0..3 {
            let (next, (a, near), (b, far)) = ((k + 1) % 3, seen[k], seen[(k + 1) % 3]);
            let along = [b[0] - a[0], b[1] - a[1]];
            let square = along[0] * along[0] + along[1] * along[1];
            let share = if square > 0.0 { ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square } else { 0.0 };
            let share = share.clamp(0.0, 1.0);
            let away = (a[0] + share * along[0] - x).hypot(a[1] + share * along[1] - y);
            if away < best.0 {
                // Halves of an edge in the picture are not halves of it in space.
                let share = match is_perspective {
                    true if near > 0.0 && far > 0.0 => share / far / ((1.0 - share) / near + share / far),
                    _ => share,
                };
                let mut weights = [0.0; 3];
                (weights[k], weights[next]) = (1.0 - share, share);
                best = (away, weights);
            }
        }
        best.0.is_finite().then(|| place(triangle.corners, best.1))
    }

    /// On a globe: first where the ray meets the flat triangle, then, by Newton's steps, where heights above the sphere agree.
    fn curved(&self, mesh: &Mesh, at: [usize; 2], triangle: &Triangle, origin: DVec3, direction: DVec3) -> [f64; 2] {
        let (rows, columns) = ([at[0], at[0] + 1].map(|r| mesh.rows[r]), [at[1], at[1] + 1].map(|c| mesh.columns[c]));
        let heights = mesh.cell(at[0], at[1]).0;
        let corners = triangle.corners.map(|corner| {
            self.scene.placed.world(rows[corner / 2] as f64, columns[corner % 2] as f64, heights[corner])
        });
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let mut t = normal.dot(corners[0] - origin) / normal.dot(direction);
        let (origin_place, step) = (self.scene.placed.origin, self.scene.placed.step);
        let middle = origin_place[0] + step[0] * 0.5 * (columns[0] + columns[1]) as f64;
        let super::placed::Map::Globe { radius } = self.scene.placed.map else { return [0.5; 2] };
        let local = |t: f64| {
            let place = origin + t * direction;
            let length = place.length();
            let mut longitude = place.y.atan2(place.x).to_degrees();
            longitude += 360.0 * ((middle - longitude) / 360.0).round();
            let latitude = (place.z / length).clamp(-1.0, 1.0).asin().to_degrees();
            let column = (longitude - origin_place[0]) / step[0];
            let row = (latitude - origin_place[1]) / step[1];
            let u = (column - columns[0] as f64) / (columns[1] - columns[0]) as f64;
            let v = (row - rows[0] as f64) / (rows[1] - rows[0]) as f64;
            ([u, v], length - radius)
        };
        let [p, q, s] = triangle.at;
        let above = |t: f64| {
            let ([u, v], height) = local(t);
            height - self.scene.placed.lifted(p + q * u + s * v)
        };
        let scale = (corners[1] - corners[0]).length() / direction.length();
        let mut small = 1e-4 * scale;
        for _ in 0..12 {
            let (here, there) = (above(t), above(t + small));
            let change = small * here / (there - here);
            if !change.is_finite() || change.abs() > 4.0 * scale {
                break;
            }
            t -= change;
            if change.abs() < 1e-13 * t.abs() {
                break;
            }
            small = small.min(0.1 * change.abs()).max(1e-9 * t.abs());
        }
        local(t).0
    }

    fn coverage(&self, mesh: &Mesh, [row, column]: [usize; 2], triangle: &Triangle, place: [f64; 2]) -> f64 {
        if mesh.node.key.level == 0 || mesh.samples.coverage.is_empty() {
            return 1.0;
        }
        let weights = weights(triangle.corners, place);
        let share = |k: usize| {
            let corner = triangle.corners[k];
            let index = (row + corner / 2) * mesh.samples.columns + column + corner % 2;
            f64::from(mesh.samples.coverage_at(index)) / 255.0
        };
        (0..3).map(|k| weights[k].clamp(0.0, 1.0) * share(k)).sum::<f64>().min(1.0)
    }
}

/// What each corner of a triangle counts at a place of its cell.
pub fn weights(corners: [usize; 3], [u, v]: [f64; 2]) -> [f64; 3] {
    match corners {
        [0, 1, 3] => [1.0 - u, u - v, v],
        [0, 2, 3] => [1.0 - v, v - u, u],
        [1, 2, 3] => [1.0 - v, 1.0 - u, u + v - 1.0],
        _ => [1.0 - u - v, u, v],
    }
}

/// The place of a cell where its triangle's corners count so much.
fn place(corners: [usize; 3], weights: [f64; 3]) -> [f64; 2] {
    let sum = |bit: fn(usize) -> usize| (0..3).map(|k| weights[k] * bit(corners[k]) as f64).sum();
    [sum(|corner| corner % 2), sum(|corner| corner / 2)]
}

const _: () = assert!(CHUNK == 256, "what a pixel shows is packed for chunks of 256 cells");
