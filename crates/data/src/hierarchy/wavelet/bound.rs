//! The cut in which no sample is further off than a bound, and that of a single level.
//!
//! Measured largest differences choose it from the top: a node is drawn as soon as its large point, or else its directed set, is near
//! enough. They were measured among neighbours of the same level. Among others what blends may be further off, so the grid is compared
//! with the samples and the nodes that are off are refined, until none is.

use super::cut::{Cut, Drawn};
use super::grid::{Samples, Shape, for_each_place, index};
use super::kinds::SPARES;
use super::tree::Hierarchy;

impl Hierarchy {
    /// The cut by measured largest differences alone.
    pub fn cut_by_maximum(&self, most: f32) -> Cut {
        self.cut(|at, node| {
            let level = &self.levels[at];
            if level.large_max[node] <= most {
                Drawn::Large
            } else if level.set_max[node] <= most {
                Drawn::Directed
            } else {
                Drawn::Refined
            }
        })
    }

    /// The cut whose grid has no sample further off than `most`, in any channel, with that grid.
    pub fn cut_within(&self, samples: &Samples, most: f32) -> (Cut, Vec<Vec<f32>>) {
        let mut cut = self.cut_by_maximum(most);
        let all: f64 = self.levels.first().map_or(0.0, |l| l.samples.iter().map(|&n| f64::from(n)).sum());
        if all - (cut.points as f64) < SPARES * all && cut.leaves > 0 {
            // What a cut spares of noise is chance.
            cut = self.exact();
        }
        loop {
            let grid = self.reconstruct(samples, &cut);
            if !self.refine_where_off(samples, &grid, &mut cut, most) {
                return (cut, grid);
            }
            self.count(&mut cut);
        }
    }

    /// The cut of all samples, but for nodes that are constant: they are one point.
    pub fn exact(&self) -> Cut {
        self.cut(|at, node| if self.levels[at].large_max[node] == 0.0 { Drawn::Large } else { Drawn::Refined })
    }

    /// The cut of all nodes of a level (0: the samples), as their directed sets where they have any. What is constant in a node above is one
    /// point there.
    pub fn cut_of_level(&self, level: usize) -> Cut {
        self.cut(|at, node| {
            if self.levels[at].large_max[node] == 0.0 {
                Drawn::Large
            } else if at < level {
                Drawn::Directed
            } else {
                Drawn::Refined
            }
        })
    }

    /// Refines drawn nodes in which a sample is further off than `most`; whether there were any.
    fn refine_where_off(&self, samples: &Samples, grid: &[Vec<f32>], cut: &mut Cut, most: f32) -> bool {
        let mut any = false;
        for at in 0..self.levels.len() {
            let shape = self.levels[at].shape;
            let finer = at.checked_sub(1).map(|below| &self.levels[below]);
            let drawn = &cut.drawn[at];
            let off: Vec<bool> = for_each_place(shape, |place| {
                matches!(drawn[index(shape, place)], Drawn::Large | Drawn::Directed)
                    && self.is_off(samples, grid, at + 1, place, most)
            });
            if !off.contains(&true) {
                continue;
            }
            any = true;
            for (node, _) in off.iter().enumerate().filter(|(_, off)| **off) {
                cut.drawn[at][node] = Drawn::Refined;
                let Some(finer) = finer else { continue };
                let place = super::grid::place(shape, node);
                for child in super::grid::children(self.dimensions, finer.shape, place) {
                    // A child is drawn as near as it can be; what is not near enough is found the next time.
                    cut.drawn[at - 1][child] = match finer.samples[child] {
                        0 => Drawn::Not,
                        _ if finer.large_max[child] > finer.set_max[child] => Drawn::Directed,
                        _ => Drawn::Large,
                    };
                }
            }
        }
        any
    }

    fn is_off(&self, samples: &Samples, grid: &[Vec<f32>], level: usize, place: Shape, most: f32) -> bool {
        let first: Shape = std::array::from_fn(|k| if k < self.dimensions { place[k] << level } else { 0 });
        let end: Shape = std::array::from_fn(|k| {
            let side = if k < self.dimensions { 1 << level } else { 1 };
            (first[k] + side).min(self.shape[k])
        });
        (first[2]..end[2]).any(|z| {
            (first[1]..end[1]).any(|y| {
                let row = index(self.shape, [0, y, z]);
                let (from, to) = (row + first[0], row + end[0]);
                samples.channels.iter().zip(grid).any(|(channel, grid)| {
                    channel[from..to].iter().zip(&grid[from..to]).any(|(s, v)| s.is_finite() && (s - v).abs() > most)
                })
            })
        })
    }
}
