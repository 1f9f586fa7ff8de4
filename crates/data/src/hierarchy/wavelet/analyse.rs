//! How much of its octave's frequencies each node holds, by direction (WM03 section 4.1), and what that makes of it (section 4.3).
//!
//! A node of level m has the frequencies of octave m, from `2^-(m+1)` to `2^-m` cycles a sample: one large point cannot show them. They are found
//! at samples `2^(m-1)` apart of a Gaussian pyramid, in windows that overlap by [`HALO`] cells on each side: transformed, multiplied by each
//! filter of the [`super::bank`], transformed back. The magnitude of that, twice, is the amplitude of a wave; a node's is the largest of
//! its cells'.

use super::bank::Bank;
use super::bricks::Part;
use super::feed::Feed;
use super::fields::{Fields, Shelf};
use super::grid::{Shape, for_each_place, volume};
use super::sets::{NONE, Set};
use super::survey::{Fault, FaultOf, Survey};
use crate::model::fft::{BoxTransform, Direction};
use rayon::prelude::*;

/// Cells along an edge of a window.
const WINDOW: usize = 64;
/// Cells on each side of a window whose coefficients are not used: as far as filters reach.
const HALO: usize = 6;
/// Nodes along an edge of what a window finds.
const NODES: usize = (WINDOW - 2 * HALO) / 2;
/// From a level of the Gaussian pyramid to the next: a row of Pascal's triangle, whose middle is the node's.
const TAPS: [f32; 6] = [1.0 / 32.0, 5.0 / 32.0, 10.0 / 32.0, 10.0 / 32.0, 5.0 / 32.0, 1.0 / 32.0];
/// The least share of a frequency that the pyramid leaves of which what is missing is made up for.
const LEAST_GAIN: f64 = 0.25;
/// Below this, of a range of 255, no direction counts: t1.
const NO_FEATURE: f32 = 2.0;
/// From this on, of a range of 255, a direction apart from the largest one is too much: t2.
const TOO_MUCH: f32 = 10.0;
/// So much of the largest one is too much, too: t3. As printed, the largest one over the other must exceed 0.05, which it always does.
const TOO_NEAR: f32 = 0.5;
/// Octaves from here on have the filters of this one: the pyramid's gain does not change any more.
const MOST_OCTAVES: usize = 5;
/// Numbers that are kept of a node: [`Found`] without more.
pub(super) const WIDTH: usize = 3;

/// What the coefficients of a node are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Found {
    /// The largest coefficient: an amplitude, in the planes' values as their weights count them.
    pub largest: f32,
    /// The largest of a direction that is no neighbour of that.
    pub other: f32,
    /// The published set of the direction, where there is one that counts.
    pub set: u8,
}

/// A window: the nodes that it finds and the cells around them, which are reflected at the grid's ends.
struct Window {
    nodes: Part,
    /// The cells that are there.
    cells: Part,
    /// Of each axis and cell of the window where that is in the box of cells.
    places: [Vec<usize>; 3],
}

impl Window {
    fn new(dimensions: usize, nodes: Part, of: Shape) -> Window {
        let (mut cells, mut places) = (Part { min: [0; 3], shape: [1; 3] }, [vec![0], vec![0], vec![0]]);
        for k in 0..dimensions {
            let start = (2 * nodes.min[k]) as isize - HALO as isize;
            let first = start.max(0) as usize;
            let end = ((start + WINDOW as isize) as usize).min(of[k]);
            // As far as reflections reach into the grid.
            let first = first.min(end.saturating_sub(HALO + 1));
            (cells.min[k], cells.shape[k]) = (first, end - first);
            let place = |i: usize| {
                let (at, period) = (start + i as isize, 2 * of[k] as isize);
                let folded = at.rem_euclid(period);
                let folded = if folded >= of[k] as isize { period - 1 - folded } else { folded };
                // Beyond the halo it does not matter what there is.
                (folded as usize).clamp(first, end - 1) - first
            };
            places[k] = (0..WINDOW).map(place).collect();
        }
        Window { nodes, cells, places }
    }

    /// The window's values, from those of the cells that are there.
    fn fill(&self, values: &[f32], out: &mut [f32]) {
        let [x, y, z] = &self.places;
        let rows = z.iter().flat_map(|z| y.iter().map(move |y| (z * self.cells.shape[1] + y) * self.cells.shape[0]));
        for (out, row) in out.chunks_exact_mut(WINDOW).zip(rows) {
            out.iter_mut().zip(x).for_each(|(out, x)| *out = values[row + x]);
        }
    }
}

/// What the Gaussian pyramid leaves of each frequency of a window along an axis, down to the level of an octave.
fn gains_along_an_axis(octave: usize) -> [f64; WINDOW] {
    std::array::from_fn(|k| {
        let f = k.min(WINDOW - k) as f64 / WINDOW as f64;
        (1..octave).map(|j| libm::pow(libm::cos(std::f64::consts::PI * libm::ldexp(f, -(j as i32))), 5.0)).product()
    })
}

/// What windows of an octave need.
struct Octave {
    dimensions: usize,
    transform: BoxTransform,
    /// Of each filter the cells of the transform that it passes, and how much, for amplitudes after both transforms.
    tables: Vec<Vec<(u32, f32)>>,
    bank: Bank,
}

impl Octave {
    fn new(dimensions: usize, octave: usize) -> Octave {
        let bank = Bank::new(dimensions, octave - 1);
        let mut tables = bank.tables(dimensions, WINDOW);
        let scale = 2.0 / WINDOW.pow(dimensions as u32) as f64;
        let gains = gains_along_an_axis(octave);
        for (cell, response) in tables.iter_mut().flatten() {
            let cell = *cell as usize;
            let at = [cell % WINDOW, cell / WINDOW % WINDOW, cell / (WINDOW * WINDOW)];
            let gain: f64 = at[..dimensions].iter().map(|&k| gains[k]).product();
            *response = (f64::from(*response) * scale / gain.max(LEAST_GAIN)) as f32;
        }
        Octave { dimensions, transform: BoxTransform::new(WINDOW), tables, bank }
    }

    /// The coefficients of a window's nodes: for each direction those of all nodes, weighted over planes.
    fn coefficients(&self, window: &Window, planes: &[Vec<f32>], weights: &[f32]) -> Vec<Vec<f32>> {
        let cells = WINDOW.pow(self.dimensions as u32);
        let spectra: Vec<(Vec<f32>, Vec<f32>)> = planes
            .iter()
            .map(|values| {
                let (mut re, mut im) = (vec![0.0; cells], vec![0.0; cells]);
                window.fill(values, &mut re);
                self.transform.apply(Direction::Forward, &mut re, &mut im);
                (re, im)
            })
            .collect();
        let (mut re, mut im, mut squares) = (vec![0.0_f32; cells], vec![0.0_f32; cells], vec![0.0_f32; cells]);
        let of_direction = |table: &Vec<(u32, f32)>| {
            squares.fill(0.0);
            for ((from_re, from_im), weight) in spectra.iter().zip(weights) {
                re.fill(0.0);
                im.fill(0.0);
                for &(cell, response) in table {
                    let cell = cell as usize;
                    (re[cell], im[cell]) = (response * from_re[cell], response * from_im[cell]);
                }
                self.transform.apply(Direction::Inverse, &mut re, &mut im);
                let both = re.iter().zip(&im);
                squares.iter_mut().zip(both).for_each(|(sum, (re, im))| *sum += weight * (re * re + im * im));
            }
            self.of_nodes(window, |largest, cell| f32::max(largest, squares[cell]), f32::sqrt)
        };
        self.tables.iter().map(of_direction).collect()
    }

    /// Of each node what is gathered over its cells in the window.
    fn of_nodes(&self, window: &Window, gather: impl Fn(f32, usize) -> f32, finish: impl Fn(f32) -> f32) -> Vec<f32> {
        let shape = window.nodes.shape;
        let depth = if self.dimensions == 3 { 2 } else { 1 };
        let mut all = Vec::with_capacity(volume(shape));
        for node in 0..volume(shape) {
            let at = super::grid::place(shape, node);
            let first = [HALO + 2 * at[0], HALO + 2 * at[1], if depth == 2 { HALO + 2 * at[2] } else { 0 }];
            let mut value = 0.0;
            for z in first[2]..first[2] + depth {
                for y in first[1]..first[1] + 2 {
                    let row = (z * WINDOW + y) * WINDOW + first[0];
                    value = gather(gather(value, row), row + 1);
                }
            }
            all.push(finish(value));
        }
        all
    }

    /// The next level of the pyramid: of each of a window's nodes.
    fn coarser(&self, window: &Window, values: &[f32]) -> Vec<f32> {
        let mut cells = vec![0.0; WINDOW.pow(self.dimensions as u32)];
        window.fill(values, &mut cells);
        // The taps begin two cells before the node.
        let start = HALO - 2;
        for_each_place(window.nodes.shape, |at| {
            let over_slice = |slice: usize| -> f32 {
                let over_row = |(y, own): (usize, &f32)| {
                    let row = (slice * WINDOW + start + 2 * at[1] + y) * WINDOW + start + 2 * at[0];
                    own * cells[row..row + TAPS.len()].iter().zip(&TAPS).map(|(v, t)| v * t).sum::<f32>()
                };
                TAPS.iter().enumerate().map(over_row).sum()
            };
            if self.dimensions == 2 {
                return over_slice(0);
            }
            TAPS.iter().enumerate().map(|(z, own)| own * over_slice(start + 2 * at[2] + z)).sum()
        })
    }

    /// What a node is by its coefficients; `unit` is a 255th of the range.
    fn found(&self, coefficients: &[Vec<f32>], node: usize, unit: f32) -> Found {
        let of = |n: usize| coefficients[n][node];
        let largest = (0..coefficients.len()).fold(0, |best, n| if of(n) > of(best) { n } else { best });
        let apart = (0..coefficients.len()).filter(|&n| n != largest && !self.bank.are_neighbours(n, largest));
        let (own, other) = (of(largest), apart.map(of).fold(0.0, f32::max));
        let is_directed = own >= NO_FEATURE * unit && other < TOO_MUCH * unit && other < TOO_NEAR * own;
        Found { largest: own, other, set: if is_directed { Set::published(largest) } else { NONE } }
    }
}

/// Where the coefficients and the Gaussian pyramid of a build lie on its shelf.
#[derive(Clone, Debug)]
pub(super) struct Coefficients {
    found: Fields,
    pyramid: Fields,
}

impl Coefficients {
    /// Places after the number `start` for a grid of so many planes.
    pub fn new(bricks: super::bricks::Bricks, planes: usize, start: u64) -> Coefficients {
        let found = Fields::new(bricks, 1, WIDTH, start);
        Coefficients { pyramid: Fields::new(bricks, 1, planes, found.end), found }
    }

    /// The number after the last.
    pub fn end(&self) -> u64 {
        self.pyramid.end
    }
}

impl<F: Feed, S: Shelf> Survey<'_, F, S> {
    /// Finds the coefficients of all nodes, a level at a time, `at_once` windows at a time.
    pub(super) fn analyse(&self, own: &Coefficients, at_once: usize) -> Result<(), FaultOf<F, S>> {
        let d = self.bricks.dimensions;
        let spans = self.weights.iter().zip(&self.ranges).map(|(w, (low, high))| w.sqrt() * (high - low));
        let unit = spans.fold(0.0, f32::max) / 255.0;
        let mut octave = Octave::new(d, 1);
        for level in 1..=self.bricks.all_levels() {
            if level > 1 && level <= MOST_OCTAVES {
                octave = Octave::new(d, level);
            }
            let (of, cells_of) = (self.bricks.level_shape(level), self.bricks.level_shape(level - 1));
            let counts: Shape = std::array::from_fn(|k| if k < d { of[k].div_ceil(NODES) } else { 1 });
            let window = |i: usize| {
                let at = super::grid::place(counts, i);
                let min: Shape = std::array::from_fn(|k| at[k] * NODES);
                let shape = std::array::from_fn(|k| if k < d { (of[k] - min[k]).min(NODES) } else { 1 });
                Window::new(d, Part { min, shape }, cells_of)
            };
            let all: Vec<usize> = (0..volume(counts)).collect();
            for some in all.chunks(at_once.max(1)) {
                some.par_iter().try_for_each(|&i| self.of_window(own, &octave, level, &window(i), unit))?;
            }
        }
        Ok(())
    }

    fn of_window(
        &self,
        own: &Coefficients,
        octave: &Octave,
        level: usize,
        window: &Window,
        unit: f32,
    ) -> Result<(), FaultOf<F, S>> {
        let planes: Vec<Vec<f32>> = if level == 1 {
            self.rules.read(self.feed, &window.cells).map_err(Fault::Feed)?.0
        } else {
            let rows = own.pyramid.read(self.shelf, level - 1, &window.cells).map_err(Fault::Shelf)?;
            let width = own.pyramid.width;
            (0..width).map(|plane| rows.iter().skip(plane).step_by(width).copied().collect()).collect()
        };
        let coefficients = octave.coefficients(window, &planes, &self.weights);
        let mut found = Vec::with_capacity(WIDTH * window.nodes.len());
        for node in 0..window.nodes.len() {
            let Found { largest, other, set } = octave.found(&coefficients, node, unit);
            found.extend([largest, other, f32::from(set)]);
        }
        own.found.write(self.shelf, level, &window.nodes, &found).map_err(Fault::Shelf)?;
        let coarser: Vec<Vec<f32>> = planes.iter().map(|values| octave.coarser(window, values)).collect();
        let rows: Vec<f32> = (0..window.nodes.len()).flat_map(|i| coarser.iter().map(move |plane| plane[i])).collect();
        own.pyramid.write(self.shelf, level, &window.nodes, &rows).map_err(Fault::Shelf)
    }

    /// What the coefficients of the nodes in a box are.
    pub(super) fn found(&self, own: &Coefficients, level: usize, part: &Part) -> Result<Vec<Found>, FaultOf<F, S>> {
        let rows = own.found.read(self.shelf, level, part).map_err(Fault::Shelf)?;
        let node = |row: &[f32]| Found { largest: row[0], other: row[1], set: row[2] as u8 };
        Ok(rows.chunks_exact(WIDTH).map(node).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::error::{Metric, Options, Types};
    use super::super::fields::InMemory;
    use super::super::grid::{Samples, index, place};
    use super::super::sets::{direction, directions};
    use super::super::survey::shelf_len;
    use super::*;

    /// What is found of the nodes of a level of a grid.
    fn found_of(dimensions: usize, shape: Shape, value: impl Fn(Shape) -> f64, level: usize) -> (Shape, Vec<Found>) {
        let values: Vec<f32> = (0..volume(shape)).map(|i| value(place(shape, i)) as f32).collect();
        let samples = Samples { dimensions, shape, channels: vec![&values] };
        let options = Options { types: Types::Gabor, metric: Metric::Gabor, ..Options::default() };
        let bricks = super::super::bricks::Bricks { dimensions, shape };
        let shelf = InMemory::new(shelf_len(bricks, 1, &options));
        let found = Survey::new(&samples, &shelf, &options, 4).and_then(|survey| {
            let of = bricks.level_shape(level);
            let found = survey.coefficients.as_ref().map(|own| survey.found(own, level, &Part::whole(of)));
            Ok((of, found.transpose()?.unwrap_or_default()))
        });
        match found {
            Ok(found) => found,
            Err(Fault::Feed(never) | Fault::Shelf(never)) => match never {},
        }
    }

    #[test]
    fn waves_are_found_in_their_octave_and_direction() {
        // Of volumes a face, an edge and a corner of the cube.
        for (dimensions, cells, levels, step_by) in [(2, [19, 17], 1..=3, 1), (3, [12, 10], 1..=1, 6)] {
            for level in levels {
                // As many places in each level, no power of two across.
                let [x, y] = cells.map(|count: usize| (count << level) - 1);
                let shape = [x, y, if dimensions == 2 { 1 } else { x }];
                for n in (0..directions(dimensions)).step_by(step_by) {
                    let way = direction(dimensions, n).map(f64::from);
                    let step = 2.0 * std::f64::consts::PI * 0.75 * 0.5_f64.powi(level as i32);
                    let wave =
                        |at: Shape| 128.0 + 100.0 * (step * (0..3).map(|k| way[k] * at[k] as f64).sum::<f64>()).cos();
                    let (of, found) = found_of(dimensions, shape, wave, level);
                    // Where reflections at the grid's ends do not matter.
                    let inner = (0..volume(of)).filter(|&i| {
                        let at = place(of, i);
                        (0..dimensions).all(|k| at[k] >= 3 && at[k] + 3 < of[k])
                    });
                    let (mut all, mut hits) = (0, 0);
                    for i in inner {
                        all += 1;
                        let is_near = (45.0..110.0).contains(&found[i].largest);
                        hits += usize::from(is_near && found[i].set == Set::published(n));
                    }
                    assert!(all > 0 && hits == all, "{dimensions}, level {level}, direction {n}: {hits} of {all}");
                }
            }
        }
    }

    #[test]
    fn tables_make_up_for_what_the_pyramid_leaves() {
        // Of volumes some of the cells, which are hundreds of thousands.
        for (dimensions, step_by) in [(2, 1), (3, 97)] {
            for octave in 1..=MOST_OCTAVES {
                let Octave { tables, bank, .. } = Octave::new(dimensions, octave);
                let cells = tables.iter().enumerate().flat_map(|(n, table)| table.iter().map(move |cell| (n, *cell)));
                for (filter, (cell, found)) in cells.step_by(step_by) {
                    let at = place([WINDOW; 3], cell as usize);
                    let (mut frequency, mut gain) = ([0.0_f64; 3], 1.0_f64);
                    for k in 0..dimensions {
                        let of = at[k] as f64 / WINDOW as f64;
                        frequency[k] = if of < 0.5 { of } else { of - 1.0 };
                        for finer in 1..octave {
                            let angle = std::f64::consts::PI * frequency[k] / f64::from(1_u32 << finer);
                            // Pascal's row is five means of two neighbours, one after the other.
                            gain *= angle.cos().powi(5);
                        }
                    }
                    let scale = 2.0 / WINDOW.pow(dimensions as u32) as f64;
                    let defined = bank.responses(frequency)[filter] * scale / gain.max(LEAST_GAIN);
                    // To single precision, twice.
                    let off = (f64::from(found) / defined - 1.0).abs();
                    assert!(off < 1.5e-7, "{dimensions}, octave {octave}, filter {filter}, cell {cell}: {off}");
                }
            }
        }
    }

    #[test]
    fn what_has_no_direction_is_not_directed() {
        let (_, found) = found_of(2, [100, 90, 1], |_| 7.0, 1);
        assert!(found.iter().all(|found| *found == Found::default()));
        // As much of one direction as of that across it.
        let both = |at: Shape| {
            let wave = |k: usize| (0.75 * std::f64::consts::PI * at[k] as f64).cos();
            128.0 + 60.0 * (wave(0) + wave(1))
        };
        let (of, found) = found_of(2, [100, 90, 1], both, 1);
        let middle = found[index(of, [25, 22, 0])];
        assert!(middle.set == NONE && middle.largest > 25.0 && middle.other > 0.85 * middle.largest, "{middle:?}");
    }
}
