//! How much of a place is covered, so that the area of T is kept from afar.
//!
//! A sample of a coarse level stands for a rectangle, half-way to its neighbours, and knows which share of it T is. Between four samples that all
//! stand for something shares go over into each other; where one of a cell's samples stands for nothing, the others have a quarter of the cell
//! each, and nothing of the rest. Either way the mean over a quarter of a cell is what its corner says, so that all together is the area of T;
//! and what is covered is in the same rectangle as some of T, not farther from it than the diagonal of a cell.
//!
//! A cell without one of its corners has one triangle at most, and rectangles reach beyond it. That part is a sample's margin. Where samples are
//! points that are no farther apart than they are wide, the margin's pixels are the point's own; elsewhere a square about the sample stands for it, behind
//! all else ([`draw_margins`]). Places in margins are on the plane of the sample's mean normal.
//!
//! On a globe rectangles are those of longitudes and latitudes, and that plane is as round as the globe. Through holes its far side is seen, so that
//! margins of the near side are before that, behind all else of the near side, and only in pixels whose centre is in them.

use super::raster::{Shown, Visibility, behind};
use super::rays::CellFrame;
use super::resolve::{Hit, Resolver};
use super::select::Primitive;
use super::sight::Sight;
use super::stitch::{Mesh, Scene};
use deepfield_heights::hierarchy::chunks::ChunkKey;
use deepfield_heights::hierarchy::chunks::lattice::SIDE_BITS;
use glam::DVec3;
use rayon::prelude::*;

/// The least share of what is drawn.
const LEAST: f64 = 1.0 / 255.0;
/// The widest square about a sample, pixels.
const MOST_SIDE: u32 = 7;
/// Samples of which some are not whole are at most so many pixels apart, so that their margins are in these squares.
pub(super) const MOST_APART: f64 = (MOST_SIDE - 1) as f64;
/// Rows and columns of samples of a pixel that are looked at: a surface that is seen from its edge has more.
pub const MOST_SAMPLES: f64 = 64.0;
/// How far from a pixel's centre, in pixels, what is said to be there may be.
const THERE: f64 = 0.01;
/// How far from a sample of a globe, in pixels' sizes, what is under the centre of its pixel is looked for: farther only at the limb.
pub const MIDDLE: f64 = 8.0;

/// Which of a cell's corners stands for a place of it. What the samples at the end of a field stand for ends where that of others does, though their
/// cells may be shorter.
#[inline]
fn corner_at(mesh: &Mesh, at: [usize; 2], [u, v]: [f64; 2]) -> usize {
    let half = 0.5 * (1_u64 << mesh.node.key.level) as f64;
    let size = CellFrame::of(mesh, at).size;
    2 * usize::from(v * size[0] >= half) + usize::from(u * size[1] >= half)
}

/// The share of a place of a coarse chunk's cell that is covered.
#[inline]
pub(super) fn share(mesh: &Mesh, at: [usize; 2], [u, v]: [f64; 2]) -> f64 {
    let first = at[0] * mesh.samples.columns + at[1];
    let next = first + mesh.samples.columns;
    let shares = [first, first + 1, next, next + 1].map(|index| f64::from(mesh.samples.coverage_at(index)) / 255.0);
    let [u, v] = [u, v].map(|place| place.clamp(0.0, 1.0));
    if shares.iter().any(|share| *share <= 0.0) {
        return shares[corner_at(mesh, at, [u, v])];
    }
    let upper = shares[0] + u * (shares[1] - shares[0]);
    let lower = shares[2] + u * (shares[3] - shares[2]);
    upper + v * (lower - upper)
}

impl Mesh {
    /// Whether a sample stands for places that are in none of its chunk's triangles: it is next to one that stands for nothing, or may be.
    pub(super) fn has_margin(&self, row: usize, column: usize) -> bool {
        let (rows, columns) = (self.samples.rows, self.samples.columns);
        let covered = |row: usize, column: usize| self.samples.coverage_at(row * columns + column) > 0;
        if self.node.key.level == 0 || self.samples.coverage.is_empty() || !covered(row, column) {
            return false;
        }
        // Of what is beyond a chunk's side its own samples say nothing.
        row == 0
            || column == 0
            || row + 1 == rows
            || column + 1 == columns
            || !(covered(row - 1, column)
                && covered(row + 1, column)
                && covered(row, column - 1)
                && covered(row, column + 1))
    }

    /// Whether a sample is drawn as a point of its chunk.
    pub(super) fn is_point(&self, row: usize, column: usize) -> bool {
        self.node.primitive == Primitive::Points && !self.is_on_laid(row, column)
    }

    /// The side of the square about a sample in which all is that it stands for, pixels; `error_pixels` are those of a length in the chunk. 0 where
    /// there are no margins.
    pub fn margin_side(&self, scene: &Scene, error_pixels: impl Fn(f64) -> f64) -> u32 {
        let level = self.node.key.level;
        if level == 0 || self.samples.coverage.is_empty() {
            return 0;
        }
        let apart = error_pixels(scene.placed.apart(level, self.node.facts.step));
        // A number that is no number, or without end, is the most.
        let reach = (0.5 * apart + 0.5).min(f64::from(MOST_SIDE / 2)) as u32;
        2 * reach + 1
    }
}

/// Puts the margins of samples that are not points where nothing else is shown.
pub(super) fn draw_margins(scene: &Scene, sight: &Sight, picture: &Visibility) {
    if scene.meshes.iter().all(|mesh| mesh.samples.coverage.is_empty()) {
        return;
    }
    let globe = (!scene.placed.is_flat()).then(|| Resolver::new(scene, sight));
    scene.meshes.par_iter().enumerate().for_each(|(number, mesh)| {
        let side = mesh.margin_side(scene, |length| sight.error_pixels(&mesh.node.extent, length));
        let has_points = mesh.node.primitive == Primitive::Points && mesh.is_laid == [false; 4];
        if side == 0 || has_points {
            return;
        }
        for (row, column) in (0..mesh.samples.rows).flat_map(|r| (0..mesh.samples.columns).map(move |c| (r, c))) {
            if !mesh.has_margin(row, column) || mesh.is_point(row, column) || mesh.is_lone(row, column) {
                continue;
            }
            let height = mesh.height(row * mesh.samples.columns + column);
            let place = scene.placed.world(mesh.rows[row] as f64, mesh.columns[column] as f64, height);
            let seen = sight.project(place - sight.eye()).filter(|_| sight.cut().keeps(place));
            let Some((at, depth)) = seen else { continue };
            let shown = Shown { node: number, at: [row, column], slot: None };
            let Some(resolver) = &globe else {
                picture.put_behind(at, side, depth, shown.pack());
                continue;
            };
            let limb = resolver.limb.filter(|limb| limb.is_beyond(place - sight.eye()));
            let passed = |pixel: [f64; 2]| {
                let (origin, direction) = resolver.ray(pixel)?;
                limb?.passed(origin - sight.eye(), direction)
            };
            let depth_at = |pixel: [f64; 2]| passed(pixel).unwrap_or_else(|| behind(depth));
            picture.put_where(at, side, shown.pack(), depth_at, |pixel| resolver.margin(shown, pixel).is_some());
        }
    });
}

impl Resolver<'_> {
    /// The share of a place of a triangle that is covered.
    #[inline]
    pub(super) fn coverage(&self, mesh: &Mesh, at: [usize; 2], place: [f64; 2]) -> f64 {
        if mesh.node.key.level == 0 || mesh.samples.coverage.is_empty() {
            return 1.0;
        }
        share(mesh, at, place).max(LEAST)
    }

    /// The share of a pixel that is covered where a point is drawn: as much as is valid in the pixel, and not as the point's own sample says, for of
    /// many samples in a pixel one is seen that was measured. Where it `counts`, and at the limb of a globe, it is the mean of the samples in the pixel,
    /// where these can be told.
    pub(super) fn point_coverage(&self, mesh: &Mesh, hit: &Hit, pixel: [f64; 2], counts: bool) -> f64 {
        let [row, column] = hit.shown.at;
        let own = f64::from(mesh.opacity(row, column));
        let level = self.level_at(hit.depth);
        if level <= 0.0 || mesh.is_lone(row, column) && mesh.node.key.level == 0 {
            return if mesh.node.key.level == 0 { 1.0 } else { own };
        }
        let middle = self.middle(mesh, hit, pixel);
        let place = middle.unwrap_or([hit.under[0], hit.under[1]]);
        let is_own = mesh.is_point(row, column) && !mesh.is_lone(row, column);
        let mean = ((counts || middle.is_none()) && is_own).then(|| self.mean_share(mesh, hit, pixel)).flatten();
        let share = mean.unwrap_or_else(|| {
            let (first, share) = self.levels(hit.shown.node, level);
            let covered = |level: u8| {
                let between = self.between(hit.shown.node, level, place)?;
                let share = |k: usize| f64::from(between.samples.coverage_at(between.indices[k])) / 255.0;
                Some((0..4).map(|k| between.weights[k] * share(k)).sum::<f64>())
            };
            let fine = covered(first).unwrap_or(own);
            let coarse = if share > 0.0 { covered(first + 1).unwrap_or(fine) } else { fine };
            fine + share * (coarse - fine)
        });
        // What of a pixel's size is in the field, which has no end where it goes round.
        let placed = &self.scene.placed;
        let [across, along] = placed.spacing();
        let size = level.exp2() * across.max(along);
        let inside = [(0, size / along), (1, size / across)].map(|(axis, side)| {
            if axis == 1 && self.goes_round() {
                return 1.0;
            }
            let last = (placed.samples[1 - axis] - 1) as f64;
            let (from, to) = (place[axis] - 0.5 * side, place[axis] + 0.5 * side);
            ((to.min(last) - from.max(0.0)) / side).clamp(0.0, 1.0)
        });
        (inside[0] * inside[1] * share).max(LEAST)
    }

    /// Whether a field's last column is the first one again.
    fn goes_round(&self) -> bool {
        self.scene.placed.around == Some(self.scene.lattice.samples[1] - 1)
    }

    /// The row and the column about which levels tell what of a pixel is covered: under its centre; `None` where that is beside a globe. A point of
    /// a globe has the place of its sample, but about samples that are seen more is covered than elsewhere, since none is seen that stands for
    /// nothing.
    fn middle(&self, mesh: &Mesh, hit: &Hit, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let (placed, [row, column, _]) = (&self.scene.placed, hit.under);
        if placed.is_flat() || mesh.samples.coverage.is_empty() {
            return Some([row, column]);
        }
        let [across, along] = placed.spacing();
        let most = MIDDLE * self.level_at(hit.depth).exp2() * across.max(along);
        let found = self.ray(pixel).and_then(|ray| self.on_plane(ray, [row, column], hit.height, hit.slope));
        let is_near =
            |[right, down, _]: &[f64; 3]| (right - column).abs() * across <= most && (down - row).abs() * along <= most;
        found.filter(is_near).map(|[right, down, _]| [down, right])
    }

    /// How many cells of full resolution a sample of a level stands for along an axis. Where the field goes round, the first column is the last
    /// one, too.
    fn cells(&self, level: u8, axis: usize, sample: u64) -> f64 {
        let lattice = &self.scene.lattice;
        let goes_round = axis == 1 && self.goes_round();
        if level == 0 {
            let is_end = sample == 0 || sample + 1 == lattice.samples[axis];
            return if is_end && !goes_round { 0.5 } else { 1.0 };
        }
        // Files tell nothing of the cells that close a globe, which belong to the samples on both sides of them.
        let closing = u64::from(axis == 1 && lattice.is_closed);
        let last = lattice.samples[axis] - 1 - closing;
        let of_file = |sample: u64| {
            let [first, end] = lattice.stands_for(axis, level.into(), sample).map(|cell| cell.min(last));
            (end - first) as f64
        };
        let is_beside = closing == 1 && (sample == 0 || lattice.place(axis, level.into(), sample) == last);
        let again = if goes_round && sample == 0 { of_file(lattice.samples_of(level.into())[axis] - 1) } else { 0.0 };
        of_file(sample) + again + if is_beside { 0.5 } else { 0.0 }
    }

    /// The mean share of the samples of a chunk's level that are in a pixel, which shows one of them. Pixels that show nothing have none that stands
    /// for anything, so that all together is the area. `None` where all are whole, or a flat surface is seen from its edge.
    fn mean_share(&self, mesh: &Mesh, hit: &Hit, pixel: [f64; 2]) -> Option<f64> {
        let (scene, key) = (self.scene, mesh.node.key);
        if mesh.samples.coverage.is_empty() {
            return None;
        }
        if !scene.placed.is_flat() {
            return self.mean_on_globe(mesh, hit, pixel);
        }
        let moves = self.moves(hit)?;
        if (0..2).any(|k| (moves.at[k] - pixel[k]).abs() > THERE) {
            return None;
        }
        let [by_column, by_row] = moves.along(hit.slope);
        let area = (by_column[0] * by_row[1] - by_column[1] * by_row[0]).abs();
        let reach = [by_column, by_row].map(|[x, y]| 0.5 * (x.abs() + y.abs()) / area);
        let (lattice, step) = (&scene.lattice, (1_u64 << key.level) as f64);
        if !reach.iter().all(|reach| *reach < MOST_SAMPLES * step) {
            return None;
        }
        let samples_of = lattice.samples_of(key.level.into());
        let range = |axis: usize| {
            let (at, reach) = (hit.under[axis], reach[axis]);
            let first = ((at - reach) / step).floor().max(0.0) as u64;
            first..(((at + reach) / step).ceil().max(0.0) as u64 + 1).min(samples_of[axis])
        };
        let (mut sum, mut all) = (0.0, 0.0);
        for row in range(0) {
            let down = lattice.place(0, key.level.into(), row) as f64 - hit.under[0];
            for column in range(1) {
                let right = lattice.place(1, key.level.into(), column) as f64 - hit.under[1];
                let is_in = (0..2).all(|k| (-0.5..0.5).contains(&(right * by_column[k] + down * by_row[k])));
                if is_in && let Some(share) = self.share_of(mesh, [row, column]) {
                    let weight = self.cells(key.level, 0, row) * self.cells(key.level, 1, column);
                    sum += weight * share;
                    all += weight;
                }
            }
        }
        (all > 0.0).then(|| sum / all)
    }

    /// The same of a globe, which is no plane in a pixel that shows much of it, and where a pixel's centre may be beside it: which samples are in the
    /// pixel is told by where each of them is seen, row by row from the one that is shown. Those of the other side do not count.
    fn mean_on_globe(&self, mesh: &Mesh, hit: &Hit, pixel: [f64; 2]) -> Option<f64> {
        let (scene, key) = (self.scene, mesh.node.key);
        let (placed, lattice) = (&scene.placed, &scene.lattice);
        let samples_of = lattice.samples_of(key.level.into()).map(|count| count as i64);
        let own = [0, 1].map(|axis| lattice.span(key, axis).0 as i64 + hit.shown.at[axis] as i64);
        let reach = MOST_SAMPLES as i64;
        let within = |axis: usize| (own[axis] - reach).max(0)..=(own[axis] + reach).min(samples_of[axis] - 1);
        // Columns from a first one to the same again; none of them is looked at twice.
        let turn = self.goes_round().then(|| samples_of[1] - 1);
        let (rows, columns) = match turn.map(|turn| reach.min((turn - 1) / 2)) {
            Some(reach) => (within(0), own[1] - reach..=own[1] + reach),
            None => (within(0), within(1)),
        };
        let relative = |row: f64, column: f64| {
            let height = hit.height + hit.slope[0] * (column - hit.column) + hit.slope[1] * (row - hit.row);
            placed.world(row, column, height) - self.sight.eye()
        };
        let side = |relative: DVec3| self.limb.map(|limb| limb.is_beyond(relative));
        let own_side = side(relative(hit.row, hit.column));
        let (mut sum, mut all) = (0.0, 0.0);
        let mut add = |row: i64, column: i64| {
            if !rows.contains(&row) || !columns.contains(&column) {
                return false;
            }
            let turns = turn.map_or(0, |turn| column.div_euclid(turn));
            let sample = [row, column - turns * turn.unwrap_or(0)].map(|index| index as u64);
            let [down, right] = [0, 1].map(|axis| lattice.place(axis, key.level.into(), sample[axis]) as f64);
            let relative = relative(down, right + turns as f64 * (lattice.samples[1] - 1) as f64);
            let is_in = self.project(relative).is_some_and(|(at, _)| {
                (0..2).all(|k| (-0.5..0.5).contains(&(at[k] - pixel[k]))) && side(relative) == own_side
            });
            if is_in && let Some(share) = self.share_of(mesh, sample) {
                let weight = self.cells(key.level, 0, sample[0]) * self.cells(key.level, 1, sample[1]);
                sum += weight * share;
                all += weight;
            }
            is_in
        };
        // The first and the last column of a row that are in the pixel, beside those of the row next to it.
        let mut scan = |row: i64, [from, to]: [i64; 2]| {
            let mut found: Option<[i64; 2]> = None;
            for column in from - 1..=to + 1 {
                if add(row, column) {
                    found = Some([found.map_or(column, |[first, _]| first), column]);
                }
            }
            let [mut first, mut last] = found?;
            while first < from && add(row, first - 1) {
                first -= 1;
            }
            while last > to && add(row, last + 1) {
                last += 1;
            }
            Some([first, last])
        };
        let shown = scan(own[0], [own[1]; 2])?;
        for way in [-1, 1] {
            let (mut row, mut span) = (own[0] + way, shown);
            while let Some(next) = scan(row, span) {
                (row, span) = (row + way, next);
            }
        }
        (all > 0.0).then(|| sum / all)
    }

    /// The share of a sample of a chunk's level, which may be in another chunk; `None` where only coarser ones are known.
    fn share_of(&self, mesh: &Mesh, sample: [u64; 2]) -> Option<f64> {
        let (lattice, level) = (&self.scene.lattice, mesh.node.key.level);
        let within = |key: ChunkKey, columns: usize| {
            let index = [0, 1].map(|axis| {
                let (first, count) = lattice.span(key, axis);
                sample[axis].checked_sub(first).filter(|index| *index < count as u64).map(|index| index as usize)
            });
            Some(index[0]? * columns + index[1]?)
        };
        let share = |share: u8| Some(f64::from(share) / 255.0);
        if let Some(index) = within(mesh.node.key, mesh.samples.columns) {
            return share(mesh.samples.coverage_at(index));
        }
        let chunks = lattice.chunks_of(level.into());
        let chunk = [0, 1].map(|axis| ((sample[axis] >> SIDE_BITS) as u32).min(chunks[axis] - 1));
        let key = ChunkKey { level, row: chunk[0], column: chunk[1] };
        if let Some(samples) = self.scene.samples(key) {
            return share(samples.coverage_at(within(key, samples.columns)?));
        }
        // Where no chunk is drawn nothing was measured.
        let cell = [0, 1].map(|axis| lattice.place(axis, level.into(), sample[axis]).min(lattice.samples[axis] - 2));
        if self.scene.cut.at(cell[0], cell[1]).is_none() { Some(0.0) } else { None }
    }

    /// What a pixel's centre shows of the margins about a sample; `None` where that is no place that a sample stands for. Its place is that of the
    /// sample which does.
    pub(super) fn margin(&self, shown: Shown, pixel: [f64; 2]) -> Option<Hit> {
        let (scene, mesh) = (self.scene, self.scene.meshes.get(shown.node)?);
        let level = mesh.node.key.level;
        if level == 0 || mesh.samples.coverage.is_empty() {
            return None;
        }
        let ray = self.ray(pixel)?;
        let [row, column] = shown.at;
        let index = row * mesh.samples.columns + column;
        let slope = scene.placed.slope(mesh.samples.normals.at(index));
        let own = [mesh.rows[row] as f64, mesh.columns[column] as f64];
        let (_, depth) =
            self.project(self.vantage.relative(mesh.rows[row], mesh.columns[column], mesh.height(index)))?;
        let [right, down, height] = self.on_plane(ray, own, mesh.height(index), slope)?;
        let place = [down, right];
        let size = self.level_at(depth).exp2();
        let [across, along] = scene.placed.spacing();
        let is_near = |axis: usize| {
            let pixel = size * across.max(along) / [along, across][axis];
            (place[axis] - own[axis]).abs() <= (2.0 * pixel).max(1.5 * (1_u64 << level) as f64)
        };
        let last = [0, 1].map(|axis| (scene.lattice.samples[axis] - 1) as f64);
        // What stands for a pixel's place is not farther away; on a plane that is seen from its edge all is.
        if (0..2).any(|axis| !is_near(axis) || !(0.0..last[axis]).contains(&place[axis])) {
            return None;
        }
        let cell = place.map(|place| place as u64);
        let beside = scene.cut.at(cell[0], cell[1]).filter(|node| !scene.meshes[*node].node.facts.is_empty());
        let (node, at, coverage) = match beside {
            Some(node) => {
                let mesh = &scene.meshes[node];
                if mesh.node.key.level == 0 {
                    return None;
                }
                let at = mesh.cell_at(cell);
                let frame = CellFrame::of(mesh, at);
                let [v, u] = [0, 1].map(|axis| (place[axis] - frame.first[axis]) / frame.size[axis]);
                let corner = corner_at(mesh, at, [u, v]);
                (node, [at[0] + corner / 2, at[1] + corner % 2], share(mesh, at, [u, v]))
            }
            // Beside the chunk nothing was measured, but for what its last samples stand for.
            None => {
                let nearest = |axis: usize| {
                    let (first, count) = scene.lattice.span(mesh.node.key, axis);
                    let sample = (cell[axis] + (1 << level) / 2) >> level;
                    sample.checked_sub(first).map(|index| index as usize).filter(|index| *index < count)
                };
                let at = [nearest(0)?, nearest(1)?];
                let coverage = mesh.samples.coverage_at(at[0] * mesh.samples.columns + at[1]);
                (shown.node, at, f64::from(coverage) / 255.0)
            }
        };
        let mesh = &scene.meshes[node];
        let [row, column] = at;
        let found = mesh.height(row * mesh.samples.columns + column);
        if coverage <= 0.0 || found.is_nan() {
            return None;
        }
        let (_, depth) = self.project(self.vantage.relative(mesh.rows[row], mesh.columns[column], found))?;
        Some(Hit {
            shown: Shown { node, at, slot: None },
            depth,
            row: mesh.rows[row] as f64,
            column: mesh.columns[column] as f64,
            height: found,
            coverage,
            is_membrane: false,
            is_pole: false,
            slope,
            under: [place[0], place[1], height],
        })
    }
}
