//! Rows and columns of a globe as shaders look them up: how far each is from an anchor near the eye, along axes that point away from the
//! globe's own, to the east and to the north. All are small near the anchor, and so exact in 32 bits where the eye is.

use super::constants::{COLUMN_WORDS, ROW_WORDS};
use crate::cpu::surface::placed::{Map, Placed};
use crate::cpu::surface::stitch::{Mesh, Scene};
use crate::heights::model::Globe;
use bevy::math::DVec3;
use std::collections::BTreeMap;

/// The place that distances count from: a sample at the reference height.
pub struct Anchor<'a> {
    placed: &'a Placed,
    globe: Globe,
    /// Column and row.
    pub sample: [u64; 2],
    /// Degrees.
    longitude: f64,
    /// Degrees.
    latitude: f64,
    /// What the reference height is above the globe.
    pub lifted: f64,
}

impl<'a> Anchor<'a> {
    /// The sample of what is drawn that is nearest to an eye; `None` where the field is flat.
    pub fn of(scene: &'a Scene, eye: DVec3, reference: f64) -> Option<Anchor<'a>> {
        let placed = &scene.placed;
        let Map::Globe(globe) = placed.map else { return None };
        let ends = drawn_ends(scene);
        let degrees = |axis: usize, at: f64| at.mul_add(placed.step[axis], placed.origin[axis]);
        let [mut longitude, latitude, _] = globe.geodetic(eye.to_array());
        longitude += 360.0 * ((degrees(0, 0.5 * (ends[0][0] + ends[0][1])) - longitude) / 360.0).round();
        let wanted = [longitude, latitude];
        let sample: [u64; 2] = std::array::from_fn(|axis| {
            let nearest = ((wanted[axis] - placed.origin[axis]) / placed.step[axis]).round();
            nearest.clamp(ends[axis][0], ends[axis][1]) as u64
        });
        let [longitude, latitude] = [0, 1].map(|axis| degrees(axis, sample[axis] as f64));
        Some(Anchor { placed, globe, sample, longitude, latitude, lifted: placed.lifted(reference) })
    }

    /// Away from the axis, to the east, to the north.
    pub fn axes(&self) -> [DVec3; 3] {
        [DVec3::from(Globe::up(self.longitude, 0.0)), DVec3::from(Globe::up(self.longitude + 90.0, 0.0)), DVec3::Z]
    }

    /// Where it is in the world.
    pub fn place(&self) -> DVec3 {
        DVec3::from(self.globe.place(self.longitude, self.latitude, self.lifted))
    }

    /// Radians.
    pub fn latitude(&self) -> f64 {
        self.latitude.to_radians()
    }

    /// Half the globe's width at the equator, and the square of its eccentricity, which is below 0 where it is longer from pole to pole.
    pub fn ellipse(&self) -> [f64; 2] {
        let Globe { equator, pole } = self.globe;
        [equator, 1.0 - (pole / equator) * (pole / equator)]
    }

    /// From the middle of the globe to the reference height.
    pub fn radius(&self) -> f64 {
        self.globe.curvature()[1] + self.lifted
    }

    /// How far from the axis and to the north of the equator the reference height is at a latitude.
    fn meridian(&self, latitude: f64) -> [f64; 2] {
        let [x, _, z] = self.globe.place(0.0, latitude, self.lifted);
        [x, z]
    }

    fn row(&self, latitude: f64) -> [f32; ROW_WORDS as usize] {
        let ([from_axis, north], [away, high]) = (self.meridian(latitude), self.meridian(self.latitude));
        // A pole is on the axis, at all longitudes to the last bit.
        let (from_axis, level) = match latitude.abs() == 90.0 {
            true => (0.0, 0.0),
            false => (from_axis, latitude.to_radians().cos()),
        };
        [from_axis - away, from_axis, level, north - high, latitude.to_radians().sin()].map(|part| part as f32)
    }

    /// Its words.
    fn column(&self, column: u64) -> [f32; COLUMN_WORDS as usize] {
        // The first column is itself again on the other side of the seam.
        let column = if self.placed.around == Some(column) { 0 } else { column };
        let longitude = (column as f64).mul_add(self.placed.step[0], self.placed.origin[0]);
        let angle = (longitude - self.longitude).to_radians();
        [angle.sin(), 2.0 * (0.5 * angle).sin().powi(2)].map(|part| part as f32)
    }
}

/// The first and the last column of the drawn chunks, and the first and the last row.
pub fn drawn_ends(scene: &Scene) -> [[f64; 2]; 2] {
    let ends = |places: fn(&Mesh) -> &[u64], samples: u64| {
        let ends = scene.meshes.iter().filter_map(|mesh| Some([*places(mesh).first()?, *places(mesh).last()?]));
        ends.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or([0, samples - 1]).map(|end| end as f64)
    };
    let [columns, rows] = scene.placed.samples;
    [ends(|mesh| &mesh.columns, columns), ends(|mesh| &mesh.rows, rows)]
}

/// The longest distances from a column and from a row of a globe to the next, between two heights.
pub fn longest(placed: &Placed, heights: [f64; 2]) -> [f64; 2] {
    let highest = heights.map(|height| placed.lifted(height).abs()).into_iter().fold(0.0, f64::max);
    let (spacing, angles) = (placed.spacing(), placed.step.map(|degrees| degrees.to_radians().abs()));
    [0, 1].map(|axis| highest.mul_add(angles[axis], spacing[axis]))
}

/// The corners of a box around the triangles of a globe's chunk, to poles too, whose heights are between two: around the line that stands in its
/// middle, as far as ways along rows and columns are long.
pub fn around(scene: &Scene, mesh: &Mesh, [mut low, mut high]: [f64; 2]) -> Option<[DVec3; 8]> {
    let placed = &scene.placed;
    // What is in the middle, and how far it is from there.
    let half = |places: &[u64]| {
        let middle = *places.get(places.len() / 2)?;
        Some([middle, (middle - places.first()?).max(places.last()? - middle)].map(|at| at as f64))
    };
    let ([row, mut rows], [column, columns]) = (half(&mesh.rows)?, half(&mesh.columns)?);
    for pole in [0, 1].into_iter().filter_map(|end| scene.pole_beside(mesh, end)) {
        (low, high) = (low.min(pole.height), high.max(pole.height));
        // It is a spacing beyond a row at most, and a little more.
        rows += 1.01;
    }
    let [per_column, per_row] = longest(placed, [low, high]);
    let reach = (rows * per_row).hypot(columns * per_column);
    let [a, b] = [low, high].map(|height| placed.world(row, column, height));
    let ends = [a.min(b) - reach, a.max(b) + reach];
    Some(std::array::from_fn(|k| DVec3::new(ends[k >> 2].x, ends[k >> 1 & 1].y, ends[k & 1].z)))
}

/// Where the lists of a picture have rows and columns.
pub struct Tables<'a> {
    anchor: Anchor<'a>,
    rows: BTreeMap<u64, u32>,
    columns: BTreeMap<u64, u32>,
    /// Those of chunks, by level and number.
    of_chunks: [BTreeMap<(u8, u32), u32>; 2],
}

fn listed(words: &[f32], lists: &mut Vec<u32>) -> u32 {
    let first = lists.len() as u32;
    lists.extend(words.iter().map(|word| word.to_bits()));
    first
}

impl<'a> Tables<'a> {
    /// With nothing in them.
    pub fn new(anchor: Anchor<'a>) -> Tables<'a> {
        Tables { anchor, rows: BTreeMap::new(), columns: BTreeMap::new(), of_chunks: Default::default() }
    }

    fn latitude(&self, row: u64) -> f64 {
        (row as f64).mul_add(self.anchor.placed.step[1], self.anchor.placed.origin[1])
    }

    /// Where the rows and the columns of a chunk are.
    pub fn of_chunk(&mut self, mesh: &Mesh, lists: &mut Vec<u32>) -> [u32; 2] {
        let key = mesh.node.key;
        let rows = match self.of_chunks[0].get(&(key.level, key.row)) {
            Some(first) => *first,
            None => {
                let words: Vec<f32> = mesh.rows.iter().flat_map(|row| self.anchor.row(self.latitude(*row))).collect();
                listed(&words, lists)
            }
        };
        let columns = match self.of_chunks[1].get(&(key.level, key.column)) {
            Some(first) => *first,
            None => {
                let words: Vec<f32> = mesh.columns.iter().flat_map(|column| self.anchor.column(*column)).collect();
                listed(&words, lists)
            }
        };
        self.of_chunks[0].insert((key.level, key.row), rows);
        self.of_chunks[1].insert((key.level, key.column), columns);
        [rows, columns]
    }

    /// Where a row and a column are.
    pub fn of_corner(&mut self, [row, column]: [u64; 2], lists: &mut Vec<u32>) -> [u32; 2] {
        let words = self.anchor.row(self.latitude(row));
        let row = *self.rows.entry(row).or_insert_with(|| listed(&words, lists));
        let words = self.anchor.column(column);
        let column = *self.columns.entry(column).or_insert_with(|| listed(&words, lists));
        [row, column]
    }

    /// Where the row is that a pole is.
    pub fn of_pole(&self, latitude: f64, lists: &mut Vec<u32>) -> u32 {
        listed(&self.anchor.row(latitude), lists)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::surface::paged::PagedSurface;
    use crate::cpu::surface::placed::Vantage;
    use crate::cpu::surface::select::{CutNode, Primitive, SurfaceCut};
    use crate::cpu::surface::source::SurfaceNodes as _;
    use crate::heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
    use crate::heights::hierarchy::chunks::ChunkKey;
    use crate::heights::model::{HeightField, HeightGrid};
    use crate::heights::store::HeightFile;
    use crate::model::{Bounds, ReadMethod, SampleType, Unit};
    use crate::view::Extent;
    use std::sync::Arc;

    /// What shaders make of a row, a column and what stands above the anchor's height, from the anchor along its axes.
    fn shaded([beyond, away, level, north, up]: [f32; 5], [sine, versine]: [f32; 2], lifted: f32) -> DVec3 {
        let from_axis = lifted.mul_add(level, away);
        let outward = (-from_axis).mul_add(versine, lifted.mul_add(level, beyond));
        DVec3::new(outward.into(), (from_axis * sine).into(), lifted.mul_add(up, north).into())
    }

    #[test]
    fn places_near_the_anchor_are_as_exact_as_they_are_near() {
        let plain = HeightGrid::new(43_200, 21_600, SampleType::F32);
        let step = [360.0 / 43_200.0, -180.0 / 21_600.0];
        let origin = [-180.0 + 0.5 * step[0], 90.0 + 0.5 * step[1]];
        let (xy_unit, height_unit) = (Unit::new("deg"), Unit::new("m"));
        let grid = HeightGrid { origin, step, xy_unit, height_unit, ..plain };
        for globe in [Globe::sphere(6.4e6), Globe { equator: 6_378_137.0, pole: 6_356_752.3 }] {
            let placed = Placed::new(&grid, Map::Globe(globe), 3.0, 0.0);
            for sample in [[100, 20_000], [0, 10_000], [43_199, 3], [21_000, 10_800]] {
                let [longitude, latitude] = [0, 1].map(|axis| (sample[axis] as f64).mul_add(step[axis], origin[axis]));
                let anchor =
                    Anchor { placed: &placed, globe, sample, longitude, latitude, lifted: placed.lifted(500.0) };
                let (axes, middle) = (anchor.axes(), anchor.place());
                for (column, row, height) in
                    [(0, 0, 0.0_f32), (1, -1, 30.0), (-40, 25, 0.5), (900, -2, -80.0), (5000, 3, 90.0)]
                {
                    let column = (sample[0] as i64 + column).rem_euclid(43_200) as u64;
                    let row = (sample[1] as i64 + row).clamp(0, 21_599) as u64;
                    let place = placed.world(row as f64, column as f64, 500.0 + f64::from(height)) - middle;
                    let latitude = (row as f64).mul_add(step[1], origin[1]);
                    let found = shaded(anchor.row(latitude), anchor.column(column), 3.0 * height);
                    let expected = DVec3::new(place.dot(axes[0]), place.dot(axes[1]), place.dot(axes[2]));
                    let off = found.distance(expected);
                    // World coordinates are themselves rounded.
                    assert!(off <= 3e-7 * expected.length() + 1e-8, "{column} {row}: {off} of {}", expected.length());
                }
            }
        }
    }

    /// A scene of chunks of several levels all around a globe.
    fn scene(placed_on: Globe) -> Scene {
        let (columns, rows) = (1441, 721);
        let height = |index: usize| {
            let (x, y) = ((index % columns % (columns - 1)) as f64, (index / columns) as f64);
            40.0 * (x / 90.0).sin() + 20.0 * (y / 13.0).cos()
        };
        let mut field = HeightField::of(columns as u64, rows as u64, (0..rows * columns).map(height).collect());
        (field.grid.step, field.grid.origin) = ([0.25, -0.25], [-180.0, 90.0]);
        (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("globe.df");
        build_heights(&field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
        let file = HeightFile::open(&path, ReadMethod::default()).unwrap();
        let nodes = PagedSurface::new(Arc::new(file), u64::MAX);
        let placed = Placed::new(&field.grid, Map::Globe(placed_on), 3.0, 0.0);
        let lattice = nodes.lattice();
        let (mut waiting, mut chosen) = (vec![lattice.root()], Vec::new());
        while let Some(key) = waiting.pop() {
            let is_fine = key.level > 0 && (key.level == lattice.top() || (key.row + key.column) % 2 == 0);
            if is_fine {
                waiting.extend([[0, 0], [0, 1], [1, 0], [1, 1]].map(|[row, column]| ChunkKey {
                    level: key.level - 1,
                    row: 2 * key.row + row,
                    column: 2 * key.column + column,
                }));
                waiting.retain(|key| lattice.has(*key));
                continue;
            }
            let facts = nodes.facts(key).unwrap();
            let extent = Extent { bounds: Bounds::of([[-3e4; 3], [3e4; 3]]), margin: 0.0 };
            let (primitive, added) = (Primitive::Triangles, facts.max - facts.min);
            chosen.push(CutNode { key, facts, extent, primitive, error_px: 0.0, added });
        }
        Scene::new(&nodes, &placed, SurfaceCut::new(chosen))
    }

    /// A chunk's corners are in its box, and those of blocks of its cells within the reach that shaders reckon of the place of their own height in the
    /// block's middle.
    fn assert_around(scene: &Scene, globe: Globe, mesh: &Mesh) {
        let placed = &scene.placed;
        let heights = [mesh.node.facts.min - 1.0, mesh.node.facts.max + 1.0];
        let corners = around(scene, mesh, heights).unwrap();
        let whole = f64::from(1_u32 << mesh.node.key.level);
        let row_length = whole * longest(placed, heights)[1];
        let place = |[row, column]: [usize; 2], height: f64| {
            placed.world(mesh.rows[row] as f64, mesh.columns[column] as f64, height)
        };
        let from_axis = |row: usize| {
            let latitude = (mesh.rows[row] as f64).mul_add(placed.step[1], placed.origin[1]);
            let away = |height: f64| globe.place(0.0, latitude, placed.lifted(height))[0].abs();
            away(heights[0]).max(away(heights[1]))
        };
        let cells = [mesh.rows.len() - 1, mesh.columns.len() - 1];
        for size in [4, 32, 256] {
            for (row, column) in
                (0..cells[0]).step_by(3 * size).flat_map(|r| (0..cells[1]).step_by(5 * size).map(move |c| (r, c)))
            {
                let (first, last) = ([row, column], [(row + size).min(cells[0]), (column + size).min(cells[1])]);
                let middle = [0, 1].map(|axis| (first[axis] + last[axis]) / 2);
                let half = [0, 1].map(|axis| (last[axis] - middle[axis]) as f64);
                let down = half[0] * row_length;
                let radius = from_axis(first[0]).max(from_axis(last[0])) + down;
                let right = half[1] * whole * placed.step[0].to_radians() * radius;
                let reach = down.hypot(right) * (1.0 + 1e-9);
                let steps = |axis: usize| [first[axis], (first[axis] + middle[axis]) / 2, middle[axis], last[axis]];
                for corner in steps(0).into_iter().flat_map(|r| steps(1).map(|c| [r, c])) {
                    for height in heights {
                        let found = place(corner, height);
                        let away = found.distance(place(middle, height));
                        assert!(away <= reach, "{first:?} to {last:?} at {corner:?}: {away} of {reach}");
                        assert!(
                            found.cmpge(corners[0]).all() && found.cmple(corners[7]).all(),
                            "{found} in {corners:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn all_corners_of_a_scene_are_where_the_processor_has_them() {
        let globe = Globe { equator: 20_000.0, pole: 19_900.0 };
        let scene = scene(globe);
        assert!(scene.meshes.iter().any(|mesh| mesh.extras.iter().any(|side| !side.is_empty())));
        scene.meshes.iter().for_each(|mesh| assert_around(&scene, globe, mesh));
        for (longitude, latitude) in [(129.6, 89.9), (-20.0, -89.9), (179.9, 10.0), (0.0, -60.0)] {
            let eye = 22_900.0 * DVec3::from(Globe::up(longitude, latitude));
            let anchor = Anchor::of(&scene, eye, 5.0).unwrap();
            let (axes, middle) = (anchor.axes(), anchor.place());
            let vantage = Vantage::new(&scene.placed, eye);
            let mut tables = Tables::new(anchor);
            let mut lists = Vec::new();
            let word = |lists: &[u32], at: u32, k: usize| f32::from_bits(lists[at as usize + k]);
            let check = |lists: &[u32], [row, column]: [u32; 2], [r, c]: [u64; 2], height: f64| {
                let lifted = 3.0 * (height - 5.0) as f32;
                let found = shaded(
                    std::array::from_fn(|k| word(lists, row, k)),
                    std::array::from_fn(|k| word(lists, column, k)),
                    lifted,
                );
                let place = vantage.relative(r, c, height) + eye - middle;
                let expected = DVec3::new(place.dot(axes[0]), place.dot(axes[1]), place.dot(axes[2]));
                let off = found.distance(expected);
                assert!(off <= 3e-7 * expected.length() + 1e-5, "{r} {c}: {found} in place of {expected}");
            };
            for mesh in &scene.meshes {
                let [rows, columns] = tables.of_chunk(mesh, &mut lists);
                for (row, r) in mesh.rows.iter().enumerate() {
                    for (column, c) in mesh.columns.iter().enumerate() {
                        let at = [rows + ROW_WORDS * row as u32, columns + COLUMN_WORDS * column as u32];
                        check(&lists, at, [*r, *c], mesh.height(row * mesh.samples.columns + column));
                    }
                }
                for (row, column, height) in mesh.extras.iter().flatten().flatten() {
                    let at = tables.of_corner([*row, *column], &mut lists);
                    check(&lists, at, [*row, *column], *height);
                }
            }
        }
    }
}
