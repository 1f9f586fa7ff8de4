//! Where the memory goes that a picture of pages may take (`--memory`): what is drawn with takes its part first, whatever the budget, and what
//! is left is for pages. Bytes an item are those of the types that hold it, at most; see `docs/streaming.md`.

use super::summing::{PORTION, SUPPLIED};
use crate::cpu::Summation;
use crate::cpu::volume::supply;
use crate::look::Shot;
use crate::mode::Mode;
use crate::store::paging::PAGE_BYTES;
use crate::stream::IN_FLIGHT;

/// Code and libraries, stacks, tables of kernels, codebooks (measured, `docs/results.md`).
const PROGRAM: u64 = 64 << 20;
/// Bytes of a decoded particle: three places, smoothing length, weight, attribute, density.
const DECODED: u64 = 28;
/// Bytes of sums for each of their pixels: tiles of all levels with their margins, in two channels; levels while they are put together; the sums,
/// their colours in linear light and as they are written.
const SUMS_PIXEL: u64 = 96;
/// The same of a volume: two layers of bricks of two channels that are full, with those of coarser grids; the ray, its colour and its depth.
const VOLUME_PIXEL: u64 = 384;
/// What each column of a volume of attributes adds to that: its numbers in two layers, and coarser grids of its own in two channels.
const COLUMN_PIXEL: u64 = 256;
/// Most bytes that the cells of a slab take: the setting's usual ones.
const SLAB: u64 = 256 << 20;
/// The same where there is no room: slabs have a layer of bricks at least.
const LEAST_SLAB: u64 = 1 << 20;
/// What pages have at least, unless that is more than half of the memory.
const LEAST_PAGES: u64 = 32 << 20;

/// What is drawn within a memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Task {
    /// Pixels of a picture.
    pub pixels: u64,
    /// Whether it may be a volume.
    pub is_volume: bool,
    /// Columns whose fields it may show, beside what densities take.
    pub columns: u64,
}

impl Task {
    /// A tour of which nothing is known yet; most are of sums.
    const UNKNOWN: Task = Task { pixels: 1920 * 1080, is_volume: false, columns: 0 };

    /// The largest of what these shots draw.
    pub fn of<'a>(shots: impl IntoIterator<Item = &'a Shot>) -> Task {
        let of_shot = |shot: &'a Shot| {
            let (width, height) = shot.size();
            let settings = &shot.look.settings;
            let is_volume = |mode: &&Mode| mode.technique.takes_supply(settings);
            let volume = shot.look.mode.filter(is_volume);
            let columns = volume.map_or(0, |mode| mode.technique.fields(settings).len() as u64);
            Task { pixels: u64::from(width) * u64::from(height), is_volume: volume.is_some(), columns }
        };
        let both = |a: Task, b: Task| Task {
            pixels: a.pixels.max(b.pixels),
            is_volume: a.is_volume || b.is_volume,
            columns: a.columns.max(b.columns),
        };
        shots.into_iter().map(of_shot).reduce(both).unwrap_or(Task::UNKNOWN)
    }

    /// What is taken whatever the memory: by the program, by pages as they lie on the disk, which wait to be decoded, by the particles of a
    /// portion, and by pixels.
    fn fixed(self) -> u64 {
        let [particles, pixel] = match self.is_volume {
            true => [
                SUPPLIED * (DECODED + self.columns * size_of::<f32>() as u64 + supply::PARTICLE_BYTES),
                VOLUME_PIXEL + self.columns * COLUMN_PIXEL,
            ],
            false => [PORTION * DECODED + Summation::SORTED_BYTES, SUMS_PIXEL],
        };
        PROGRAM + IN_FLIGHT as u64 * PAGE_BYTES as u64 + particles + pixel.saturating_mul(self.pixels)
    }
}

/// The shares of a memory, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Account {
    /// For pages, and what is known of their nodes.
    pub pages: u64,
    /// For the cells of a slab of a volume.
    pub slab: u64,
    /// All that is taken, where that is more than there is.
    pub exceeding: Option<u64>,
}

impl Account {
    /// Shares a memory out. What the allocator keeps of pages that made room, until it is given back, is taken to be a quarter of what they take; cells
    /// of coarser grids a quarter of those of a slab.
    pub fn of(memory: u64, task: Task) -> Account {
        let fixed = task.fixed();
        let rest = memory.saturating_sub(fixed);
        let slab = (rest / 5).clamp(LEAST_SLAB, SLAB);
        let slabs = if task.is_volume { slab + slab / 4 } else { 0 };
        let pages = (rest.saturating_sub(slabs) / 5 * 4).max(LEAST_PAGES).min(memory / 2);
        let taken = fixed.saturating_add(slabs + pages + pages / 4);
        Account { pages, slab, exceeding: Some(taken).filter(|taken| *taken > memory) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The parts are added up anew here.
        #[test]
        fn shares_are_no_more_than_there_is(
            (width, height) in (1_u64..8192, 1_u64..8192), (is_volume, columns) in (any::<bool>(), 0_u64..4),
            more in 0_u64..(1 << 36),
        ) {
            let task = Task { pixels: width * height, is_volume, columns };
            let memory = task.fixed() + (64 << 20) + more;
            let account = Account::of(memory, task);
            let Account { pages, slab, exceeding } = account;
            let taken = task.fixed() + 5 * (pages / 4) + if is_volume { 5 * (slab / 4) } else { 0 };
            prop_assert!(taken <= memory && exceeding.is_none(), "{memory}: {account:?}");
            prop_assert!(pages >= LEAST_PAGES && (LEAST_SLAB..=SLAB).contains(&slab), "{memory}: {account:?}");
            // Nothing is left over, but where pages have half.
            prop_assert!(taken + 64 >= memory || pages == memory / 2, "{memory}: {account:?}");
            // What is added is taken from nobody, and in less nobody has more.
            let next = Account::of(memory + (1 << 20), task);
            prop_assert!(next.pages >= pages && next.slab >= slab, "{account:?} {next:?}");
            let little = more % memory;
            let less = Account::of(little, task);
            prop_assert!(less.pages <= little / 2 && less.pages <= pages && less.slab <= slab, "{little}: {less:?}");
            prop_assert!(little >= task.fixed() || less.exceeding.is_some_and(|taken| taken > little));
        }
    }
}
