//! From what a pixel shows to the exact place: where the ray through its centre meets the triangle that is drawn there; of a point the place of
//! its sample.

mod look;
mod triangle;

use super::horizon::Limb;
use super::placed::{GridRay, Vantage};
use super::raster::{POLE, Shown};
use super::rays::{Caster, CellFrame};
use super::sight::{Lens, Sight};
use super::source::NodeSamples;
use super::stitch::{Mesh, Scene};
use deepfield_heights::hierarchy::chunks::ChunkKey;
use deepfield_heights::hierarchy::chunks::lattice::SIDE_BITS;
use deepfield_heights::measure::Spread;
use deepfield_heights::model::Triangle;
use glam::DVec3;
use std::sync::{Arc, OnceLock};

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
    /// Whether it is of the membrane over a hole, and no data.
    pub is_membrane: bool,
    /// Whether it is between the field and a pole of its globe, and no data.
    pub is_pole: bool,
    /// What a column and a row add to the height there: on the triangle, or as a point's mean normal says.
    pub slope: [f64; 2],
    /// Row, column and height of what lies under the pixel's centre: of a point on the plane of its mean normal; else the same place.
    pub under: [f64; 3],
}

/// Channels of a raw picture.
pub const CHANNELS: usize = 7;

/// From triangle to triangle at most so many times.
const STEPS: u32 = 6;

/// Most steps to where a ray meets what a sample of a globe stands for.
pub const PLANE_STEPS: u32 = 16;

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
    lens: Lens,
    /// What is between the near side of a globe and the far one.
    pub(super) limb: Option<Limb>,
    /// A globe's field.
    spread: Option<Spread>,
    /// For each chunk its samples and those of the chunks that it lies in, from its level up.
    chains: Vec<Vec<Option<Tier<'a>>>>,
    /// For the few pixels of points whose centre is beside what their samples belong to.
    caster: OnceLock<Arc<Caster<'a>>>,
}

/// What of the field moves how far in the picture about a place, pixels of it.
#[derive(Clone, Copy, Debug)]
pub struct Moves {
    /// Where the place is.
    pub at: [f64; 2],
    /// What a column adds at the same height.
    pub column: [f64; 2],
    /// What a row adds at the same height.
    pub row: [f64; 2],
    /// What a unit of height adds.
    pub height: [f64; 2],
}

impl Moves {
    /// What a column and a row add on a surface that rises so much along them.
    pub fn along(&self, slope: [f64; 2]) -> [[f64; 2]; 2] {
        let on = |way: [f64; 2], slope: f64| [0, 1].map(|k| slope.mul_add(self.height[k], way[k]));
        [on(self.column, slope[0]), on(self.row, slope[1])]
    }

    /// What a pixel to the right and one down add to the height of such a surface; `None` where it is seen from its edge.
    pub fn rise(&self, slope: [f64; 2]) -> Option<[f64; 2]> {
        let [a, b] = self.along(slope);
        let area = a[0] * b[1] - a[1] * b[0];
        let rise = [(slope[0] * b[1] - slope[1] * a[1]) / area, (slope[1] * a[0] - slope[0] * b[0]) / area];
        rise.iter().all(|rise| rise.is_finite()).then_some(rise)
    }
}

/// A chunk's samples, and where they are among those of their level.
#[derive(Clone, Copy)]
struct Tier<'a> {
    samples: &'a NodeSamples,
    /// Row and column of the first one.
    first: [u64; 2],
}

/// Where a ray meets a triangle of a chunk.
#[derive(Clone, Copy)]
struct Met {
    shown: Shown,
    /// Row and column of its cell.
    at: [usize; 2],
    triangle: Triangle,
    frame: CellFrame,
    /// In the cell.
    place: [f64; 2],
    is_membrane: bool,
}

/// Four samples around a place in a level, and what each counts.
#[derive(Clone, Copy, Debug)]
pub struct Between<'a> {
    /// The chunk's samples.
    pub samples: &'a NodeSamples,
    /// Row by row.
    pub indices: [usize; 4],
    /// What each counts; their sum is 1.
    pub weights: [f64; 4],
    /// How many rows and columns of full resolution they are apart.
    pub apart: [f64; 2],
}

impl<'a> Resolver<'a> {
    /// For a scene and an eye.
    pub fn new(scene: &'a Scene, sight: &'a Sight) -> Resolver<'a> {
        let chain = |mesh: &'a Mesh| {
            let key = mesh.node.key;
            let tier = |key: ChunkKey| {
                let first = [0, 1].map(|axis| scene.lattice.span(key, axis).0);
                scene.samples(key).map(|samples| Tier { samples, first })
            };
            (key.level..=scene.lattice.top()).map(|level| tier(key.ancestor(level))).collect()
        };
        let chains = scene.meshes.iter().map(chain).collect();
        let vantage = Vantage::new(&scene.placed, sight.eye());
        let (limb, spread) = (Limb::of(scene, sight), scene.placed.spread());
        Resolver { scene, sight, vantage, lens: sight.lens(), limb, spread, chains, caster: OnceLock::new() }
    }

    /// With what casts rays through its scene where that is there already.
    pub(super) fn casting(self, caster: &Arc<Caster<'a>>) -> Resolver<'a> {
        Resolver { caster: OnceLock::from(Arc::clone(caster)), ..self }
    }

    /// The ray of a place in the picture.
    #[inline]
    pub fn ray(&self, place: [f64; 2]) -> Option<(DVec3, DVec3)> {
        self.sight.ray_through(&self.lens, place)
    }

    /// Pixels of a length of 1 at a depth.
    fn pixels_at(&self, depth: f64) -> f64 {
        self.sight.pixels_through(&self.lens, depth)
    }

    /// Where what is so far from the eye appears, and its depth.
    pub fn project(&self, relative: DVec3) -> Option<([f64; 2], f64)> {
        self.sight.project_through(&self.lens, relative)
    }

    /// The level, with a fraction, whose samples are as far apart as pixels at a depth, may it be finer than what there is.
    #[inline]
    pub fn level_at(&self, depth: f64) -> f64 {
        let [across, along] = self.scene.placed.spacing();
        -(self.pixels_at(depth.max(f64::MIN_POSITIVE)) * across.max(along)).log2()
    }

    /// The nearest level to this one that there is where a chunk is drawn, and the share of the next coarser one.
    #[inline]
    pub fn levels(&self, node: usize, level: f64) -> (u8, f64) {
        let own = self.scene.meshes[node].node.key.level;
        let level = level.clamp(f64::from(own), f64::from(own) + (self.chains[node].len() - 1) as f64);
        (level as u8, level.fract())
    }

    /// The samples of a level around a place that a chunk, which is not coarser, holds; places beyond the rim count as on it.
    #[inline]
    pub fn between(&self, node: usize, level: u8, [row, column]: [f64; 2]) -> Option<Between<'a>> {
        let (own, lattice) = (self.scene.meshes[node].node.key, self.scene.lattice);
        let tier = self.chains[node].get(usize::from(level.checked_sub(own.level)?)).copied().flatten()?;
        let Tier { samples, first } = tier;
        let place = |axis: usize, at: f64, count: usize| {
            let first = first[axis];
            let cell = lattice.cell_at(axis, level.into(), at);
            let index = (cell.saturating_sub(first) as usize).min(count.saturating_sub(2));
            let from = first + index as u64;
            let (from, to) = (lattice.place(axis, level.into(), from), lattice.place(axis, level.into(), from + 1));
            (index, ((at - from as f64) / (to - from) as f64).clamp(0.0, 1.0), (to - from) as f64)
        };
        let (row, down, height) = place(0, row, samples.rows);
        let (column, right, width) = place(1, column, samples.columns);
        let first = row * samples.columns + column;
        Some(Between {
            samples,
            indices: [first, first + 1, first + samples.columns, first + samples.columns + 1],
            weights: [(1.0 - down) * (1.0 - right), (1.0 - down) * right, down * (1.0 - right), down * right],
            apart: [height, width],
        })
    }

    /// What moves how far in the picture about what is under a pixel's centre; `None` where that is not before the eye.
    pub fn moves(&self, hit: &Hit) -> Option<Moves> {
        let placed = &self.scene.placed;
        let [row, column, height] = hit.under;
        let seen = |row: f64, column: f64, height: f64| {
            Some(self.project(placed.world(row, column, height) - self.sight.eye())?.0)
        };
        let at = seen(row, column, height)?;
        // Small enough for what is seen in perspective, and large enough for rounding.
        let step = (1_u64 << self.scene.meshes[hit.shown.node].node.key.level) as f64 / 64.0;
        let [across, along] = placed.spacing();
        let rise = step * across.max(along) / placed.lift.abs();
        let added = |to: [f64; 2], step: f64| [0, 1].map(|k| (to[k] - at[k]) / step);
        Some(Moves {
            at,
            column: added(seen(row, column + step, height)?, step),
            row: added(seen(row + step, column, height)?, step),
            height: added(seen(row, column, height + rise)?, rise),
        })
    }

    /// A point's hit. `counts` says whether its coverage is the mean of the samples in the pixel, or of what is about it in the levels.
    fn point(&self, shown: Shown, mesh: &Mesh, pixel: [f64; 2], counts: bool) -> Option<Hit> {
        let [row, column] = shown.at;
        let index = row * mesh.samples.columns + column;
        let height = mesh.height(index);
        let (seen, depth) = self.project(self.vantage.relative(mesh.rows[row], mesh.columns[column], height))?;
        let at = [mesh.rows[row] as f64, mesh.columns[column] as f64];
        let placed = &self.scene.placed;
        let slope = placed.slope(mesh.samples.normals.at(index));
        let ray = self.ray(pixel).and_then(|(origin, direction)| placed.ray(origin, direction));
        let found = ray.and_then(|GridRay { origin, direction }| {
            let plane = height + slope[0] * (origin[0] - at[1]) + slope[1] * (origin[1] - at[0]);
            let t = (plane - origin[2]) / (direction[2] - slope[0] * direction[0] - slope[1] * direction[1]);
            let place = [t.mul_add(direction[1], origin[1]), t.mul_add(direction[0], origin[0])];
            // A plane that is seen from its edge says nothing.
            let away = (0..2).map(|k| (seen[k] - pixel[k]).abs()).fold(1.0, f64::max);
            let most = 2.0 * away * self.level_at(depth).max(0.0).exp2();
            let is_near = (0..2).all(|k| (place[k] - at[k]).abs() <= most);
            is_near.then(|| [place[0], place[1], t.mul_add(direction[2], origin[2])])
        });
        let under = found.unwrap_or([at[0], at[1], height]);
        let (coverage, is_membrane, is_pole) = (0.0, false, false);
        let hit = Hit { shown, depth, row: at[0], column: at[1], height, coverage, is_membrane, is_pole, slope, under };
        Some(Hit { coverage: self.point_coverage(mesh, &hit, pixel, counts), ..hit })
    }

    /// The height that is seen at a place of the picture near a hit on a flat field's triangle: from triangle to triangle to where the ray
    /// meets one; `None` where that does not lead anywhere.
    pub fn height_near(&self, hit: &Hit, pixel: [f64; 2]) -> Option<f64> {
        let (origin, direction) = self.ray(pixel)?;
        let ray = self.scene.placed.ray(origin, direction)?;
        let mut mesh = self.scene.meshes.get(hit.shown.node)?;
        let mut at = hit.shown.at;
        let mut triangle = mesh.cell(at[0], at[1]).triangle(hit.shown.slot?)?;
        for _ in 0..STEPS {
            let frame = CellFrame::of(mesh, at);
            let local = frame.ray(&ray);
            let t = local.meets(&triangle).filter(|t| *t > 0.0)?;
            let [u, v, height] = local.0.at(t);
            if weights(triangle.corners, [u, v]).into_iter().all(|weight| weight >= -OUTSIDE) {
                return Some(height);
            }
            let place = [v.mul_add(frame.size[0], frame.first[0]), u.mul_add(frame.size[1], frame.first[1])];
            let is_in = |axis: usize| {
                let places = if axis == 0 { &mesh.rows } else { &mesh.columns };
                (places[0] as f64..places[places.len() - 1] as f64).contains(&place[axis])
            };
            let lattice = &self.scene.lattice;
            if (0..2).any(|axis| !(0.0..(lattice.samples[axis] - 1) as f64).contains(&place[axis])) {
                return None;
            }
            let cell = place.map(|place| place as u64);
            if !(is_in(0) && is_in(1)) {
                mesh = self.scene.meshes.get(self.scene.cut.at(cell[0], cell[1])?)?;
            }
            at = mesh.cell_at(cell);
            let frame = CellFrame::of(mesh, at);
            let [v, u] = [0, 1].map(|axis| (place[axis] - frame.first[axis]) / frame.size[axis]);
            let is_under =
                |triangle: &Triangle| weights(triangle.corners, [u, v]).into_iter().all(|weight| weight >= -1e-6);
            triangle = mesh.cell(at[0], at[1]).triangles().find(is_under)?;
        }
        None
    }

    /// Prepares rays by all threads, for many places: else the first that asks for one does it alone.
    pub(super) fn prepare_rays(&self) {
        self.caster.get_or_init(|| Arc::new(Caster::new(self.scene)));
    }

    /// What a ray finds at a place of the picture.
    pub fn cast(&self, pixel: [f64; 2]) -> Option<Hit> {
        let caster = self.caster.get_or_init(|| Arc::new(Caster::alone(self.scene)));
        self.hit(caster.cast_pixel(self.sight, &self.lens, pixel)?.shown, pixel)
    }

    /// Whether the whole field is less than two pixels across where a sample is.
    fn is_thin(&self, mesh: &Mesh, [row, column]: [usize; 2]) -> bool {
        let placed = &self.scene.placed;
        let [across, along] = placed.spacing();
        let size = [across * (placed.samples[0] - 1) as f64, along * (placed.samples[1] - 1) as f64];
        let height = mesh.height(row * mesh.samples.columns + column);
        let seen = self.project(self.vantage.relative(mesh.rows[row], mesh.columns[column], height));
        seen.is_some_and(|(_, depth)| size[0].min(size[1]) * self.pixels_at(depth) < 2.0)
    }

    /// The place of what is shown at a place of the picture.
    pub fn hit(&self, shown: Shown, pixel: [f64; 2]) -> Option<Hit> {
        let mesh = self.scene.meshes.get(shown.node)?;
        let [row, column] = shown.at;
        let Some(slot) = shown.slot else {
            // Where nothing else is.
            return match mesh.is_point(row, column) || mesh.is_lone(row, column) {
                true => self.point(shown, mesh, pixel, true),
                false => self.margin(shown, pixel),
            };
        };
        let (origin, direction) = self.ray(pixel)?;
        if slot >= POLE {
            return self.pole(shown, mesh, slot - POLE, origin, direction);
        }
        let (mut triangle, is_membrane) = mesh.triangle(row, column, slot)?;
        let (mut mesh, mut at) = (mesh, shown.at);
        let [u, v] = match self.scene.placed.ray(origin, direction) {
            Some(ray) => self.flat(mesh, at, &triangle, &CellFrame::of(mesh, at), &ray, pixel),
            None => self.exact(mesh, at, &triangle, origin, direction).unwrap_or_else(|| {
                let mut place = self.curved(mesh, at, &triangle, origin, direction);
                // The flat triangle that was drawn lies below the globe, so the ray may meet the surface beside it.
                for _ in 0..4 {
                    let Some(beside) = self.beside(mesh, at, &triangle, place) else { break };
                    (mesh, at, triangle) = beside;
                    place = self.curved(mesh, at, &triangle, origin, direction);
                }
                place
            }),
        };
        let met = Met { shown, at, triangle, frame: CellFrame::of(mesh, at), place: [u, v], is_membrane };
        Some(self.met(mesh, &met, origin))
    }

    /// What is at a place of a triangle.
    #[inline]
    fn met(&self, mesh: &Mesh, met: &Met, origin: DVec3) -> Hit {
        let Met { shown, at, triangle, frame, place: [u, v], is_membrane } = *met;
        let [p, q, s] = triangle.at;
        let height = p + q * u + s * v;
        let (row, column) = (v * frame.size[0] + frame.first[0], u * frame.size[1] + frame.first[1]);
        let relative = self.scene.placed.world(row, column, height) - origin;
        let depth = match self.sight {
            Sight::Flat(view) => relative.dot(view.forward),
            Sight::Around { .. } => relative.length(),
        };
        let coverage = if is_membrane { 1.0 } else { self.coverage(mesh, at, [u, v]) };
        let slope = [q / frame.size[1], s / frame.size[0]];
        let under = [row, column, height];
        Hit { shown, depth, row, column, height, coverage, is_membrane, is_pole: false, slope, under }
    }

    /// The place of a triangle between the first or last row and the pole: rows beyond the field, and heights between both.
    fn pole(&self, shown: Shown, mesh: &Mesh, end: usize, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let (placed, pole) = (&self.scene.placed, self.scene.pole_beside(mesh, end)?);
        let (at, column) = (if end == 0 { 0 } else { mesh.samples.rows - 1 }, shown.at[1]);
        let columns = [column, column + 1].map(|column| mesh.columns[column] as f64);
        let heights = [column, column + 1].map(|column| mesh.height(at * mesh.samples.columns + column));
        let row = mesh.rows[at] as f64;
        let [a, b] = [0, 1].map(|k| placed.world(row, columns[k], heights[k]) - origin);
        let top = placed.pole(pole.latitude, pole.height) - origin;
        // What each corner counts where the ray meets their plane, or passes by a hair.
        let shares = [direction.dot(a.cross(b)), direction.dot(b.cross(top)), direction.dot(top.cross(a))];
        let sum: f64 = shares.iter().sum();
        let [up, left, right] = shares.map(|share| if sum == 0.0 { 1.0 / 3.0 } else { (share / sum).clamp(0.0, 1.0) });
        let all = up + left + right;
        let along = if left + right > 0.0 { right / (left + right) } else { 0.5 };
        let rows = (pole.latitude - placed.origin[1]) / placed.step[1] - row;
        let rim = along.mul_add(heights[1] - heights[0], heights[0]);
        let height = rim + up / all * (pole.height - rim);
        let (column, row) = (along.mul_add(columns[1] - columns[0], columns[0]), (up / all).mul_add(rows, row));
        let relative = (up * top + left * a + right * b) / all;
        let depth = match self.sight {
            Sight::Flat(view) => relative.dot(view.forward),
            Sight::Around { .. } => relative.length(),
        };
        let slope = [(heights[1] - heights[0]) / (columns[1] - columns[0]), (pole.height - rim) / rows];
        let under = [row, column, height];
        let (is_membrane, is_pole) = (false, true);
        Some(Hit { shown, depth, row, column, height, coverage: 1.0, is_membrane, is_pole, slope, under })
    }
}

/// What each corner of a triangle counts at a place of its cell.
#[inline]
pub fn weights(corners: [usize; 3], [u, v]: [f64; 2]) -> [f64; 3] {
    match corners {
        [0, 1, 3] => [1.0 - u, u - v, v],
        [0, 2, 3] => [1.0 - v, v - u, u],
        [1, 2, 3] => [1.0 - v, 1.0 - u, u + v - 1.0],
        _ => [1.0 - u - v, u, v],
    }
}

const _: () = assert!(SIDE_BITS == 8, "what a pixel shows is packed for chunks of 256 cells");
