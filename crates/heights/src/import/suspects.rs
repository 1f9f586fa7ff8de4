//! Values that files often have where nothing was measured, without saying so.

use crate::model::HeightGrid;

/// Stored values that stand for no data in files of many programs, beside all from [`HUGE`] on.
const USUAL: [f64; 12] = [
    -32768.0,
    32767.0,
    65535.0,
    -9999.0,
    9999.0,
    -99999.0,
    99999.0,
    -999.0,
    -2_147_483_648.0,
    2_147_483_647.0,
    4_294_967_295.0,
    1e20,
];

/// Those of them that are the least or the largest value of a type: what was measured seldom comes near them.
const ENDS: [f64; 6] = [-32768.0, 32767.0, 65535.0, -2_147_483_648.0, 2_147_483_647.0, 4_294_967_295.0];

/// How far such a value has to be from all others, as a share of how far these are apart; any other value as far as they are.
const GAP: f64 = 0.01;

/// Nothing that was measured is so large in any unit.
const HUGE: f64 = 1e30;

/// How many samples have one of these values: more than one in so many is a suspicion.
const SHARE: u64 = 1000;

/// Samples with suspicious values, and the range of the others.
#[derive(Clone, Debug)]
pub struct Suspects {
    /// Of [`USUAL`], and of `huge`.
    counts: [u64; USUAL.len() + 1],
    /// The huge value that is farthest from 0.
    huge: f64,
    min: f64,
    max: f64,
}

impl Suspects {
    /// Those among stored samples that count as measured.
    ///
    /// A value that is far from all others is the least or the largest of the samples beside it: where neither is suspicious, none of these is. So
    /// what a field's note says is the same however its samples are cut into parts.
    pub fn among(samples: impl Iterator<Item = f64> + Clone) -> Suspects {
        let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
        for sample in samples.clone() {
            min = if sample < min { sample } else { min };
            max = if sample > max { sample } else { max };
        }
        let mut found = Suspects { min, max, ..Suspects::none() };
        if which(min).is_some() || which(max).is_some() {
            (found.min, found.max) = (f64::INFINITY, f64::NEG_INFINITY);
            samples.for_each(|sample| found.see(sample));
        }
        found
    }

    /// Nothing seen.
    pub fn none() -> Suspects {
        Suspects { counts: [0; USUAL.len() + 1], huge: HUGE, min: f64::INFINITY, max: f64::NEG_INFINITY }
    }

    fn see(&mut self, stored: f64) {
        match which(stored) {
            Some(index) if index == USUAL.len() => self.see_huge(stored, 1),
            Some(index) => self.counts[index] += 1,
            None => (self.min, self.max) = (self.min.min(stored), self.max.max(stored)),
        }
    }

    /// Huge values are one number where they stand for no data: of several the one farthest from 0 counts.
    fn see_huge(&mut self, stored: f64, times: u64) {
        let count = &mut self.counts[USUAL.len()];
        if *count == 0 || (stored.abs(), stored) > (self.huge.abs(), self.huge) {
            (self.huge, *count) = (stored, times);
        } else if stored == self.huge {
            *count += times;
        }
    }

    /// These, and those of other rows.
    pub fn and(mut self, other: &Suspects) -> Suspects {
        for (count, more) in self.counts[..USUAL.len()].iter_mut().zip(other.counts) {
            *count += more;
        }
        if other.counts[USUAL.len()] > 0 {
            self.see_huge(other.huge, other.counts[USUAL.len()]);
        }
        (self.min, self.max) = (self.min.min(other.min), self.max.max(other.max));
        self
    }

    /// A sentence where the most frequent of them are more than one in a thousand, and farther from all others than these are apart, or than a
    /// hundredth of that where the value is an end of a type.
    pub fn note(&self, grid: &HeightGrid) -> Option<String> {
        let value = |index: usize| USUAL.get(index).copied().unwrap_or(self.huge);
        let is_suspicious = |(index, count): &(usize, &u64)| {
            let away = (self.min - value(*index)).max(value(*index) - self.max);
            let gap = if ENDS.contains(&value(*index)) { GAP } else { 1.0 };
            **count > grid.samples() / SHARE && self.min <= self.max && away > gap * (self.max - self.min)
        };
        let found = self.counts.iter().enumerate().filter(is_suspicious);
        let (index, count) = found.max_by_key(|(index, count)| (**count, std::cmp::Reverse(*index)))?;
        let number = shown(value(index));
        Some(format!(
            "{count} of {} samples are {number}, far from all others, and count as heights: --nodata {number} declares them as not measured",
            grid.samples()
        ))
    }
}

/// Which of the suspicious values a stored one is, if any.
fn which(stored: f64) -> Option<usize> {
    if stored.abs() >= HUGE { Some(USUAL.len()) } else { USUAL.iter().position(|usual| *usual == stored) }
}

/// A number as it can be given back on a command line, bit for bit.
fn shown(value: f64) -> String {
    if value.abs() < 1e15 { format!("{value}") } else { format!("{value:e}") }
}
