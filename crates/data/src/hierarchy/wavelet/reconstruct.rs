//! A grid back from a cut.
//!
//! Points of one node share its samples by [`Set::shares`]. A large point that is soft blends with its neighbours: along each axis its
//! weight falls linearly from its own middle to the middle of what lies across the nearer border, whatever level that has, so weights sum
//! to one and a footprint ends half of a neighbour's extent beyond its own border. A large point that is not soft, and a directed set, end
//! at the node's border. Samples are themselves, and nothing reaches into them.

use super::cut::{Cut, Drawn};
use super::error::Errors;
use super::grid::{Samples, Shape, children, for_each_place, index};
use super::sets::{MOST, Set};
use super::tables::middle;
use super::tree::Hierarchy;
use rayon::prelude::*;

/// What covers a sample that is none.
const HOLE: u8 = u8::MAX;
/// Cells along an axis of a node with which shares of points in the whole node are found.
const SIDE: usize = 8;

/// A cut, ready to be asked for values.
struct Drawing<'a> {
    hierarchy: &'a Hierarchy,
    cut: &'a Cut,
    sets: Vec<Option<Set>>,
    /// The level of what covers each sample: 0 is the sample itself.
    cover: Vec<u8>,
    /// Of each plane, level and node: what its neighbours blend with, the large point's value or the mean of what its points show.
    shown: Vec<Vec<Vec<f32>>>,
}

impl Hierarchy {
    /// The level of what covers each sample: 0 is the sample itself.
    fn cover(&self, cut: &Cut) -> Vec<u8> {
        let mut cover = vec![0_u8; self.shape.iter().product()];
        let (d, shape) = (self.dimensions, self.shape);
        cover.par_chunks_mut(shape[0]).enumerate().for_each(|(row, cover)| {
            let (y, z) = (row % shape[1], row / shape[1]);
            let mut x = 0;
            while x < shape[0] {
                let mut level = 0;
                for (l, nodes) in self.levels.iter().enumerate().rev() {
                    let at = [x >> (l + 1), y >> (l + 1), if d == 3 { z >> (l + 1) } else { 0 }];
                    match cut.drawn[l][index(nodes.shape, at)] {
                        Drawn::Refined => {}
                        Drawn::Not => {
                            level = HOLE;
                            break;
                        }
                        _ => {
                            level = l as u8 + 1;
                            break;
                        }
                    }
                }
                let end = if level == HOLE || level == 0 { x + 1 } else { ((x >> level) + 1) << level }.min(shape[0]);
                cover[x..end].fill(level);
                x = end;
            }
        });
        cover
    }

    /// Of each plane, level and node: what its neighbours blend with.
    fn shown(&self, cut: &Cut) -> Vec<Vec<Vec<f32>>> {
        let d = self.dimensions;
        // Shares of points in a node as a whole.
        let parts: Vec<[f32; MOST]> = (0..=u8::MAX)
            .map(|code| {
                let Some(set) = Set::of(d, code) else { return [0.0; MOST] };
                let cells = SIDE.pow(d as u32);
                let mut sum = [0.0; MOST];
                for cell in 0..cells {
                    let shares = set.shares(middle(d, SIDE, cell));
                    (0..MOST).for_each(|k| sum[k] += shares[k] / cells as f32);
                }
                sum
            })
            .collect();
        (0..self.planes.values.len())
            .map(|p| {
                let mut levels: Vec<Vec<f32>> = Vec::with_capacity(self.levels.len());
                for (at, level) in self.levels.iter().enumerate() {
                    let finer = if at == 0 { self.shape } else { self.levels[at - 1].shape };
                    let below = levels.last();
                    let values = for_each_place(level.shape, |place| {
                        let node = index(level.shape, place);
                        match cut.drawn[at][node] {
                            Drawn::Not => 0.0,
                            Drawn::Directed if !level.laid[node] => {
                                let (parts, values) = (parts[usize::from(level.set[node])], level.points[p][node]);
                                (0..MOST).map(|k| parts[k] * values[k]).sum()
                            }
                            Drawn::Large | Drawn::Directed => level.large[p][node],
                            Drawn::Refined => {
                                let (sum, number) =
                                    children(d, finer, place).fold((0.0, 0.0), |(sum, number), child| {
                                        let (value, n) = match below {
                                            Some(below) => (below[child], self.levels[at - 1].samples[child] as f32),
                                            None if self.planes.holes.get(child) == Some(&true) => (0.0, 0.0),
                                            None => (self.planes.values[p][child], 1.0),
                                        };
                                        (sum + n * value, number + n)
                                    });
                                sum / number
                            }
                        }
                    });
                    levels.push(values);
                }
                levels
            })
            .collect()
    }

    /// The grid that a cut shows, channel by channel; samples that are drawn themselves are exact, and those that are no numbers stay so.
    pub fn reconstruct(&self, samples: &Samples, cut: &Cut) -> Vec<Vec<f32>> {
        let sets = (0..=u8::MAX).map(|code| Set::of(self.dimensions, code)).collect();
        let drawing = Drawing { hierarchy: self, cut, sets, cover: self.cover(cut), shown: self.shown(cut) };
        let number = self.planes.values.len();
        let mut mixed = vec![0.0_f32; self.shape.iter().product::<usize>() * number];
        let row = self.shape[0];
        mixed.par_chunks_mut(row * number).enumerate().for_each(|(at, out)| {
            let (y, z) = (at % self.shape[1], at / self.shape[1]);
            for (x, out) in out.chunks_exact_mut(number).enumerate() {
                let i = at * row + x;
                let is_hole = self.planes.holes.get(i) == Some(&true);
                if drawing.cover[i] == 0 || drawing.cover[i] == HOLE || is_hole {
                    out.iter_mut().zip(&samples.channels).for_each(|(v, channel)| *v = channel[i]);
                } else {
                    drawing.value([x, y, z], out);
                    self.planes.back(out);
                }
            }
        });
        (0..number).map(|c| mixed.par_iter().skip(c).step_by(number).copied().collect()).collect()
    }
}

impl Drawing<'_> {
    /// The planes' values at a sample that a point covers.
    fn value(&self, at: Shape, out: &mut [f32]) {
        let h = self.hierarchy;
        let d = h.dimensions;
        let level = self.cover[index(h.shape, at)];
        let own = usize::from(level) - 1;
        let nodes = &h.levels[own];
        let place: Shape = std::array::from_fn(|k| if k < d { at[k] >> level } else { 0 });
        let node = index(nodes.shape, place);
        let extent = 1_usize << level;
        // From the node's middle, in samples.
        let off: [f32; 3] = std::array::from_fn(|k| {
            if k < d { at[k] as f32 + 0.5 - (place[k] << level) as f32 - 0.5 * extent as f32 } else { 0.0 }
        });
        let set = match self.cut.drawn[own][node] {
            Drawn::Directed => self.sets[usize::from(nodes.set[node])],
            _ => None,
        };
        out.fill(0.0);
        if let Some(set) = set {
            let shares = set.shares(off.map(|off| off / extent as f32));
            for (out, points) in out.iter_mut().zip(&nodes.points) {
                let v = &points[node];
                *out = shares[0] * v[0] + shares[1] * v[1] + shares[2] * v[2];
            }
            if !nodes.laid[node] {
                return;
            }
        } else if !nodes.soft[node] {
            out.iter_mut().zip(&nodes.large).for_each(|(out, large)| *out = large[node]);
            return;
        }
        // Across the nearer border of each axis: a sample of what is there, and how much it counts.
        let mut across: [(usize, f32); 3] = [(0, 0.0); 3];
        for k in 0..d {
            let next = if off[k] < 0.0 { (place[k] << level).checked_sub(1) } else { Some((place[k] + 1) << level) };
            let Some(next) = next.filter(|&next| next < h.shape[k]) else { continue };
            let mut there = at;
            there[k] = next;
            let Some(other) = self.size(there, level) else { continue };
            across[k] = (next, off[k].abs() / (0.5 * (extent + (1 << other)) as f32));
        }
        for corner in 0..1_usize << d {
            let (mut there, mut weight) = (at, 1.0_f32);
            for (k, (next, share)) in across.iter().enumerate().take(d) {
                if corner >> k & 1 == 1 {
                    there[k] = *next;
                    weight *= share;
                } else {
                    weight *= 1.0 - share;
                }
            }
            if weight > 0.0 {
                // In place of a hole its neighbour.
                let (there, level) = self.size(there, level).map_or((at, level), |level| (there, level));
                let place: Shape = std::array::from_fn(|k| if k < d { there[k] >> level } else { 0 });
                let own = usize::from(level) - 1;
                let node = index(h.levels[own].shape, place);
                out.iter_mut().zip(&self.shown).for_each(|(out, shown)| *out += weight * shown[own][node]);
            }
        }
    }

    /// The level of what a node of a level blends with at a sample: its own or a coarser one; `None` where nothing is.
    fn size(&self, at: Shape, level: u8) -> Option<u8> {
        let cover = self.cover[index(self.hierarchy.shape, at)];
        (cover != HOLE).then(|| cover.max(level))
    }
}

/// Errors of a grid against its samples: rows are summed in order, so threads change nothing.
pub fn errors(samples: &Samples, grid: &[Vec<f32>]) -> Errors {
    let row = samples.shape[0].max(1);
    let rows: Vec<(f32, f64, u64)> = samples
        .channels
        .iter()
        .zip(grid)
        .flat_map(|(channel, grid)| channel.chunks(row).zip(grid.chunks(row)))
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|(source, shown)| {
            source.iter().zip(shown).filter(|(s, _)| s.is_finite()).fold((0.0_f32, 0.0, 0), |(max, sum, n), (s, v)| {
                let off = f64::from(*s) - f64::from(*v);
                (max.max(off.abs() as f32), sum + off * off, n + 1)
            })
        })
        .collect();
    let (max, sum, n) = rows.iter().fold((0.0_f32, 0.0, 0), |a, b| (a.0.max(b.0), a.1 + b.1, a.2 + b.2));
    Errors { max, rms: if n > 0 { (sum / n as f64).sqrt() as f32 } else { 0.0 } }
}
