//! What flow tracks have of mass, density and everything else: sums over their particles, those of a coarse track from the finer ones.

use super::flow_region::Region;
use crate::codec::AttributeMerge;
use crate::hierarchy::spacetime::TrackFlags;
use crate::store::run::FlowTracks;
use std::ops::Range;

/// Sums of an end before those of attributes: mass, volume, smoothing length by mass, and as it is.
const OF_END: usize = 4;

/// Sums over the particles of tracks.
pub(super) struct Sums {
    attributes: usize,
    /// Of each track, of each end, [`OF_END`] sums and two of each attribute: by mass (the sum of the light of a magnitude), and as it is.
    rows: Vec<f64>,
    counts: Vec<u32>,
    /// Mass at the beginning of what is unresolved.
    lost: Vec<f64>,
    /// The first particle of each in the region's order.
    first: Vec<u32>,
}

impl Sums {
    /// Of no track yet.
    pub fn new(attributes: usize) -> Sums {
        Sums { attributes, rows: Vec::new(), counts: Vec::new(), lost: Vec::new(), first: Vec::new() }
    }

    fn width(&self) -> usize {
        OF_END + 2 * self.attributes
    }

    /// The sums at one end of a track.
    fn row(&self, track: usize, end: usize) -> &[f64] {
        let at = (2 * track + end) * self.width();
        &self.rows[at..at + self.width()]
    }

    /// Appends the track of some particles of a region.
    pub fn push(&mut self, region: &Region<'_>, members: impl Iterator<Item = usize> + Clone) {
        let (at, width) = (self.rows.len(), self.width());
        self.rows.resize(at + 2 * width, 0.0);
        for (end, row) in self.rows[at..].chunks_exact_mut(width).enumerate() {
            for i in members.clone() {
                let [mass, density, length] = [0, 1, 2].map(|k| region.value(i, end, k));
                let volume = if density > 0.0 { mass / density } else { 0.0 };
                let own = [mass, volume, mass * length, length];
                row.iter_mut().zip(own).for_each(|(sum, value)| *sum += value);
                for (k, rule) in region.rules.iter().enumerate() {
                    let value = region.value(i, end, 3 + k);
                    row[OF_END + 2 * k] += match rule {
                        AttributeMerge::Mean => mass * value,
                        AttributeMerge::Magnitude => 10.0_f64.powf(-0.4 * value),
                    };
                    row[OF_END + 2 * k + 1] += value;
                }
            }
        }
        self.counts.push(members.clone().count() as u32);
        let lost = members.clone().filter(|i| region.is_unresolved[*i]).map(|i| region.value(i, 0, 0));
        self.lost.push(lost.sum());
        self.first.push(members.min().unwrap_or(0) as u32);
    }

    /// Appends the union of some tracks of others.
    pub fn push_union(&mut self, finer: &Sums, tracks: Range<usize>) {
        let (at, width) = (self.rows.len(), 2 * self.width());
        self.rows.resize(at + width, 0.0);
        for row in finer.rows[tracks.start * width..tracks.end * width].chunks_exact(width) {
            self.rows[at..].iter_mut().zip(row).for_each(|(sum, own)| *sum += own);
        }
        self.counts.push(finer.counts[tracks.clone()].iter().sum());
        self.lost.push(finer.lost[tracks.clone()].iter().sum());
        self.first.push(finer.first[tracks].iter().copied().min().unwrap_or(0));
    }

    /// The same tracks in another order.
    pub fn in_order(&self, order: &[u32]) -> Sums {
        let mut out = Sums::new(self.attributes);
        order.iter().for_each(|track| out.push_union(self, *track as usize..*track as usize + 1));
        out
    }

    /// Appends a track, whose clusters have these states, to the tracks of a level.
    pub fn track(&self, region: &Region<'_>, track: usize, states: [([i64; 3], [i64; 3]); 2], out: &mut FlowTracks) {
        let first = self.first[track] as usize;
        let count = f64::from(self.counts[track]);
        for (end, (place, movement)) in states.into_iter().enumerate() {
            let row = self.row(track, end);
            let (mass, volume) = (row[0], row[1]);
            let mean = |sum: f64, weight: f64, plain: f64| if weight > 0.0 { sum / weight } else { plain / count };
            let own = &mut out.tracks.ends[end];
            let shift = if end == 0 { [0; 3] } else { region.shift(first) };
            own.places.push(std::array::from_fn(|axis| place[axis] + shift[axis]));
            own.movements.push(movement);
            own.mass.push(mass as f32);
            own.density.push(if volume > 0.0 { mass / volume } else { 0.0 } as f32);
            own.smoothing_length.push(mean(row[2], mass, row[3]) as f32);
            for (k, (attribute, rule)) in own.attributes.iter_mut().zip(region.rules).enumerate() {
                let (sum, plain) = (row[OF_END + 2 * k], row[OF_END + 2 * k + 1]);
                attribute.push(match rule {
                    AttributeMerge::Mean => mean(sum, mass, plain),
                    AttributeMerge::Magnitude => -2.5 * sum.log10(),
                } as f32);
            }
        }
        let flags: TrackFlags = region.flags(first);
        out.tracks.flags.push(flags);
        out.counts.push(self.counts[track]);
        let mass = self.row(track, 0)[0];
        out.faded.push(if mass > 0.0 { (self.lost[track] / mass) as f32 } else { 0.0 });
    }
}
