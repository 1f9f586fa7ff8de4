//! A height field in the world: where its samples stand, and rays in its own coordinates.

use deepfield_heights::measure::{Rise, Spread, Stands};
use deepfield_heights::model::{Globe, HeightGrid, units};
use glam::DVec3;

/// How rows and columns become places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Map {
    /// `x` and `y` as the file has them.
    #[default]
    Plate,
    /// Lengths about the middle of a field in degrees, on a sphere of this radius in the unit of heights.
    Local {
        /// Radius of the body, in the unit of heights.
        radius: f64,
    },
    /// On a body about the world's origin, with lengths in the unit of heights: `x` is towards longitude 0, `y` 90 degrees east, `z` north.
    Globe(Globe),
}

/// Poles that are nearer to a row than this part of a spacing are in it.
const POLE: f64 = 1e-6;
/// And spacings are the same whose difference is such a part of them.
const SAME: f64 = 1e-3;

/// A field in the world: `z = base + exaggeration (height - base)`, in the unit of `x` and `y` where both are lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Samples along rows (columns) and along columns (rows). On a globe there is one column more where a spacing is left between the last and
    /// the first: the first column again.
    pub samples: [u64; 2],
    /// On a globe: the number of the column that is the first one again.
    pub around: Option<u64>,
    /// On a globe that the field goes round: the latitudes of poles that are beyond the first and the last row by no more than a spacing, and
    /// are closed in pictures.
    pub poles: [Option<f64>; 2],
    /// On a globe: whether the field goes round it and from pole to pole.
    pub is_whole: bool,
    /// Where sample (0, 0) is in the file's coordinates.
    pub file_origin: [f64; 2],
    /// From a column and from a row to the next in the file's coordinates.
    pub file_step: [f64; 2],
    /// Where sample (0, 0) is in the world (a globe: longitude and latitude).
    pub origin: [f64; 2],
    /// From a column and from a row to the next in the world (a globe: degrees).
    pub step: [f64; 2],
    /// World `z` (a globe: above its radius) of height 0.
    pub zero: f64,
    /// World `z` of a unit of height.
    pub lift: f64,
    /// The same without exaggeration.
    pub true_lift: f64,
    /// How rows and columns become places.
    pub map: Map,
}

/// A ray in a flat field's coordinates: column, row, height. Its parameter is that of the ray in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridRay {
    /// Where the parameter is 0.
    pub origin: [f64; 3],
    /// What a unit of the parameter adds.
    pub direction: [f64; 3],
}

impl GridRay {
    /// Column, row and height at a parameter.
    #[inline]
    pub fn at(&self, t: f64) -> [f64; 3] {
        std::array::from_fn(|axis| t * self.direction[axis] + self.origin[axis])
    }

    /// Where it meets a plane that has a height at a row and a column, and to which a column and a row add the two of `slope`: column, row and
    /// height; `None` where it does not, or behind its origin.
    pub fn on_plane(&self, [row, column]: [f64; 2], height: f64, slope: [f64; 2]) -> Option<[f64; 3]> {
        let plane = height + slope[0] * (self.origin[0] - column) + slope[1] * (self.origin[1] - row);
        let [right, down, up] = self.direction;
        let t = (plane - self.origin[2]) / (up - slope[0] * right - slope[1] * down);
        (t > 0.0 && t.is_finite()).then(|| self.at(t))
    }
}

impl Placed {
    /// A grid in the world. Heights are converted where both units are lengths; a field in degrees takes its heights as lengths of the body
    /// that the map names.
    pub fn new(grid: &HeightGrid, map: Map, exaggeration: f64, base: f64) -> Placed {
        let mut ratio = match (units::metres(&grid.height_unit), units::metres(&grid.xy_unit)) {
            (Some(height), Some(place)) => height / place,
            _ => 1.0,
        };
        let (mut origin, mut step) = (grid.origin, grid.step);
        if units::is_degrees(&grid.xy_unit) {
            match map {
                Map::Local { radius } => {
                    let last = [grid.columns - 1, grid.rows - 1].map(|last| last as f64);
                    let middle: [f64; 2] = std::array::from_fn(|k| (0.5 * last[k]).mul_add(step[k], origin[k]));
                    let length = [radius.to_radians() * middle[1].to_radians().cos(), radius.to_radians()];
                    origin = std::array::from_fn(|k| (origin[k] - middle[k]) * length[k]);
                    step = std::array::from_fn(|k| step[k] * length[k]);
                }
                Map::Globe(_) | Map::Plate => ratio = 1.0,
            }
        }
        let around = grid.around().filter(|_| matches!(map, Map::Globe(_)));
        let closing = around.filter(|around| *around == grid.columns);
        // How many spacings the poles are beyond the first and the last row.
        let ways = [(0, -grid.step[1]), (grid.rows - 1, grid.step[1])];
        let beyond = ways.map(|(row, way)| (90.0_f64.copysign(way) - grid.place(row as f64, 0.0)[1]) / way);
        let is_near = |beyond: f64| around.is_some() && beyond.abs() < 1.0 + SAME;
        let pole = |end: usize| (is_near(beyond[end]) && beyond[end] > POLE).then_some(90.0_f64.copysign(ways[end].1));
        Placed {
            samples: [grid.columns + u64::from(closing.is_some()), grid.rows],
            around,
            poles: [pole(0), pole(1)],
            is_whole: beyond.into_iter().all(is_near),
            file_origin: grid.origin,
            file_step: grid.step,
            origin,
            step,
            zero: ratio * base * (1.0 - exaggeration),
            lift: ratio * exaggeration,
            true_lift: ratio,
            map,
        }
    }

    /// Whether rows, columns and heights are straight axes of the world.
    #[inline]
    pub fn is_flat(&self) -> bool {
        !matches!(self.map, Map::Globe(_))
    }

    /// World `z` of a height, or what stands above a globe's radius.
    #[inline]
    pub fn lifted(&self, height: f64) -> f64 {
        self.lift * height + self.zero
    }

    /// A place of the surface in the world, with fractions of rows and columns.
    #[inline]
    pub fn world(&self, row: f64, column: f64, height: f64) -> DVec3 {
        let [x, y] = [column * self.step[0] + self.origin[0], row * self.step[1] + self.origin[1]];
        match self.map {
            Map::Globe(globe) => DVec3::from(globe.place(x, y, self.lifted(height))),
            _ => DVec3::new(x, y, self.lifted(height)),
        }
    }

    /// The places of the first and of the last sample of a flat field at height 0.
    pub fn corners(&self) -> [DVec3; 2] {
        let [columns, rows] = self.samples.map(|count| (count - 1) as f64);
        [self.world(0.0, 0.0, 0.0), self.world(rows, columns, 0.0)]
    }

    /// Where a height stands at a pole of a globe.
    pub fn pole(&self, latitude: f64, height: f64) -> DVec3 {
        match self.map {
            Map::Globe(globe) => DVec3::from(globe.place(0.0, latitude, self.lifted(height))),
            _ => DVec3::ZERO,
        }
    }

    /// A globe's field, for rays.
    pub fn spread(&self) -> Option<Spread> {
        let Map::Globe(globe) = self.map else { return None };
        let last = self.samples.map(|count| (count - 1) as f64);
        Some(Spread { globe, origin: self.origin, step: self.step, last, lift: [self.zero, self.lift] })
    }

    /// `x` and `y` of a place in the file's coordinates.
    pub fn file_place(&self, row: f64, column: f64) -> [f64; 2] {
        [column.mul_add(self.file_step[0], self.file_origin[0]), row.mul_add(self.file_step[1], self.file_origin[1])]
    }

    /// The same ray in the field's coordinates; `None` for a globe.
    #[inline]
    pub fn ray(&self, origin: DVec3, direction: DVec3) -> Option<GridRay> {
        self.is_flat().then(|| GridRay {
            origin: [
                (origin.x - self.origin[0]) / self.step[0],
                (origin.y - self.origin[1]) / self.step[1],
                (origin.z - self.zero) / self.lift,
            ],
            direction: [direction.x / self.step[0], direction.y / self.step[1], direction.z / self.lift],
        })
    }

    /// How the field stands for rays as [`Placed::in_file`] gives them.
    pub fn stands(&self) -> Stands {
        self.spread().map_or(Stands::Flat(Rise { zero: self.zero, lift: self.lift }), Stands::Globe)
    }

    /// A ray of a flat world with x and y as the file has them, of the same parameter and z; that of a globe as it is.
    pub fn in_file(&self, origin: DVec3, direction: DVec3) -> (DVec3, DVec3) {
        match self.map {
            Map::Plate | Map::Globe(_) => (origin, direction),
            Map::Local { .. } => {
                let [x, y] = [0, 1].map(|k| self.file_step[k] / self.step[k]);
                let away = [0, 1].map(|k| origin[k] - self.origin[k]);
                let place = DVec3::new(
                    x.mul_add(away[0], self.file_origin[0]),
                    y.mul_add(away[1], self.file_origin[1]),
                    origin.z,
                );
                (place, DVec3::new(direction.x * x, direction.y * y, direction.z))
            }
        }
    }

    /// The longest distance between neighbours along rows and along columns, world units.
    #[inline]
    pub fn spacing(&self) -> [f64; 2] {
        match self.map {
            Map::Globe(globe) => self.step.map(|degrees| degrees.abs().to_radians() * globe.curvature()[1]),
            _ => self.step.map(f64::abs),
        }
    }

    /// How far neighbours among a level's samples, none of which is more than `step` higher than another, are apart at most in the world.
    pub fn apart(&self, level: u8, step: f64) -> f64 {
        let [across, along] = self.spacing().map(|spacing| spacing * (1_u64 << level) as f64);
        across.hypot(along).hypot(step * self.lift)
    }

    /// A part of the field with other samples: so many rows and columns from a row and a column on, which may lie between the field's, each so many
    /// times as far from the next.
    pub(super) fn thinned(&self, [row, column]: [f64; 2], times: f64, [rows, columns]: [usize; 2]) -> Placed {
        Placed {
            samples: [columns as u64, rows as u64],
            around: None,
            poles: [None; 2],
            is_whole: false,
            file_origin: self.file_place(row, column),
            file_step: self.file_step.map(|step| step * times),
            origin: [column.mul_add(self.step[0], self.origin[0]), row.mul_add(self.step[1], self.origin[1])],
            step: self.step.map(|step| step * times),
            ..*self
        }
    }

    /// The world lengths of a column and of a row that normals are made with. Degrees of a globe are those in the middle of the field, as they
    /// are in page files.
    pub fn lengths(&self) -> [f64; 2] {
        let Map::Globe(globe) = self.map else { return self.step };
        let latitude = (0.5 * (self.samples[1] - 1) as f64).mul_add(self.step[1], self.origin[1]);
        let narrow = latitude.to_radians().cos().abs().max(0.01);
        let radius = (2.0 * globe.equator + globe.pole) / 3.0;
        [self.step[0].to_radians() * radius * narrow, self.step[1].to_radians() * radius]
    }

    /// What a column and a row add to the height where the surface has a normal at true height.
    pub fn slope(&self, normal: [f32; 3]) -> [f64; 2] {
        let [x, y, z] = normal.map(f64::from);
        let ([across, along], z) = (self.lengths(), z.max(1e-6) * self.true_lift);
        [-x / z * across, -y / z * along]
    }

    /// How far a chord between places that are so many columns and rows apart sinks below a globe, at most: `s^2 / 8 R`; 0 for a flat field.
    pub fn sag(&self, columns: f64, rows: f64) -> f64 {
        match self.map {
            Map::Globe(globe) => {
                let [x, y] = self.spacing();
                let length = (x * columns).hypot(y * rows);
                (length * length / (8.0 * globe.curvature()[0])).min(2.0 * globe.reach())
            }
            _ => 0.0,
        }
    }
}

/// Samples as an eye has them: relative to it, by the same operations whoever asks, so that a sample that several nodes share is the same to
/// the last bit. Columns and rows count from an anchor near the eye, which keeps their products exact where it matters.
#[derive(Clone, Copy, Debug)]
pub struct Vantage {
    placed: Placed,
    eye: DVec3,
    /// Column and row of the anchor.
    anchor: [f64; 2],
    /// Where the anchor is from the eye.
    away: [f64; 2],
}

impl Vantage {
    /// The field as seen from an eye.
    pub fn new(placed: &Placed, eye: DVec3) -> Vantage {
        let at = [eye.x, eye.y];
        let anchor = std::array::from_fn(|k| {
            let nearest = ((at[k] - placed.origin[k]) / placed.step[k]).round();
            nearest.clamp(0.0, (placed.samples[k] - 1) as f64)
        });
        let away = std::array::from_fn(|k| anchor[k].mul_add(placed.step[k], placed.origin[k]) - at[k]);
        Vantage { placed: *placed, eye, anchor, away }
    }

    /// Where a sample is from the eye.
    #[inline]
    pub fn relative(&self, row: u64, column: u64, height: f64) -> DVec3 {
        if !self.placed.is_flat() {
            // The same place to the last bit on both sides of the seam.
            let column = if self.placed.around == Some(column) { 0 } else { column };
            return self.placed.world(row as f64, column as f64, height) - self.eye;
        }
        DVec3::new(self.x(column), self.y(row), self.z(height))
    }

    /// Whether a sample's place is one of its column, one of its row and one of its height.
    #[inline]
    pub fn is_flat(&self) -> bool {
        self.placed.is_flat()
    }

    /// Where a column of a flat field is from the eye.
    #[inline]
    pub fn x(&self, column: u64) -> f64 {
        (column as f64 - self.anchor[0]) * self.placed.step[0] + self.away[0]
    }

    /// Where a row of a flat field is from the eye.
    #[inline]
    pub fn y(&self, row: u64) -> f64 {
        (row as f64 - self.anchor[1]) * self.placed.step[1] + self.away[1]
    }

    /// Where a height of a flat field is from the eye.
    #[inline]
    pub fn z(&self, height: f64) -> f64 {
        self.placed.lifted(height) - self.eye.z
    }

    /// Where a sample is in the world.
    pub fn world(&self, row: u64, column: u64, height: f64) -> DVec3 {
        self.placed.world(row as f64, column as f64, height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deepfield_data::model::{SampleType, Unit};
    use deepfield_heights::model::lengths::EARTH;

    #[test]
    fn rays_in_the_file_s_own_degrees_meet_the_same_places() {
        let plain = HeightGrid::new(101, 201, SampleType::F32);
        let grid = HeightGrid {
            origin: [6.0, 50.5],
            step: [0.01, -0.005],
            xy_unit: Unit::new("deg"),
            height_unit: Unit::new("m"),
            ..plain
        };
        let placed = Placed::new(&grid, Map::Local { radius: EARTH }, 3.0, 100.0);
        let eye = DVec3::new(2000.0, -70_000.0, 30_000.0);
        for (row, column, height) in [(0.0, 0.0, 250.0), (200.0, 100.0, -3.0), (77.25, 31.5, 1000.0)] {
            let (from, way) = placed.in_file(eye, placed.world(row, column, height) - eye);
            let [x, y] = grid.place(row, column);
            let met = from + way;
            assert!((met.x - x).abs() < 1e-12 && (met.y - y).abs() < 1e-12, "{met}");
            assert!((met.z - placed.lifted(height)).abs() < 1e-9);
        }
        let flat = Placed::new(&grid, Map::Plate, 1.0, 0.0);
        assert_eq!(flat.in_file(eye, DVec3::X), (eye, DVec3::X));
    }
}
