//! Where the memory goes that a picture of pages may take (`--memory`): what is drawn with takes its part first, whatever the budget, and what
//! is left is for pages. Bytes an item are those of the types that hold it, at most; see `docs/streaming.md`.

use super::summing::{PORTION, SUPPLIED};
use crate::cpu::Summation;
use crate::cpu::volume::supply;
use crate::mode::{Depiction, Output, Settings};
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
/// What a picture of all particles at once takes for each pixel beside that: surfaces and their normals, a lamp's pictures, colours.
const WHOLE_PIXEL: u64 = 128;
/// Bytes of a particle of such a picture: decoded, projected, sorted or cut, and what the allocator keeps, in the mode that takes most (measured,
/// `docs/results.md`).
const WHOLE_PARTICLE: u64 = 224;
/// The same in pictures of volumes, and of each column whose field they show beside.
const VOLUME_PARTICLE: u64 = 112;
const COLUMN_PARTICLE: u64 = 40;
/// Bytes that a source particle takes in its page.
const PAGED_PARTICLE: u64 = 10;
/// Most bytes that the cells of a slab take: the setting's usual ones.
const SLAB: u64 = 256 << 20;
/// The same where there is no room: slabs have a layer of bricks at least.
const LEAST_SLAB: u64 = 1 << 20;
/// What pages have at least, unless that is more than half of the memory.
const LEAST_PAGES: u64 = 32 << 20;
/// The same where all that they hold is drawn at once.
const LEAST_WHOLE_PAGES: u64 = 8 << 20;

/// What is drawn within a memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Task {
    /// Pixels of a picture.
    pixels: u64,
    /// Whether it is a volume.
    is_volume: bool,
    /// Columns whose fields it shows, beside what densities take.
    columns: u64,
    /// Whether it needs all particles at once.
    is_whole: bool,
}

impl Task {
    /// A picture of so many pixels. One that is drawn as a whole needs all particles of a volume at once: around a place, or with paths in it.
    pub fn of(depiction: &Depiction, (width, height): (u32, u32), as_a_whole: bool) -> Task {
        let (technique, settings) = (depiction.mode.technique, &depiction.settings);
        let is_volume = technique.takes_supply(&Settings::default());
        let in_slabs = !as_a_whole && technique.takes_supply(settings);
        Task {
            pixels: u64::from(width) * u64::from(height),
            is_volume,
            columns: if is_volume { technique.fields(settings).len() as u64 } else { 0 },
            is_whole: technique.output() != Output::Sums && !in_slabs && !depiction.mode.is_of_paths(),
        }
    }

    /// The same where an adapter draws, for which no particle is decoded.
    #[must_use]
    pub fn on_adapter(self) -> Task {
        Task { is_whole: false, ..self }
    }

    /// What is taken whatever the memory: by the program, by pages as they lie on the disk, which wait to be decoded, by the particles of a
    /// portion, and by pixels.
    fn fixed(self) -> u64 {
        let of_volume = VOLUME_PIXEL + self.columns * COLUMN_PIXEL;
        let [particles, pixel] = match (self.is_whole, self.is_volume) {
            (true, true) => [0, WHOLE_PIXEL + of_volume],
            (true, false) => [0, WHOLE_PIXEL],
            (false, true) => {
                let particle = DECODED + self.columns * size_of::<f32>() as u64 + supply::PARTICLE_BYTES;
                [SUPPLIED * particle, of_volume]
            }
            (false, false) => [PORTION * DECODED + Summation::SORTED_BYTES, SUMS_PIXEL],
        };
        PROGRAM + IN_FLIGHT as u64 * PAGE_BYTES as u64 + particles + pixel.saturating_mul(self.pixels)
    }

    /// Bytes of a particle that is drawn while its page is held; none where only some are at a time.
    fn particle(self) -> u64 {
        match (self.is_whole, self.is_volume) {
            (true, true) => VOLUME_PARTICLE + self.columns * COLUMN_PARTICLE,
            (true, false) => WHOLE_PARTICLE,
            (false, _) => 0,
        }
    }

    /// Pages that take so many bytes, with all that grows with them.
    fn pages_within(self, bytes: u64) -> u64 {
        bytes / (5 * PAGED_PARTICLE + 4 * self.particle()) * (4 * PAGED_PARTICLE)
    }

    /// What pages take, with all that grows with them: what the allocator keeps of those that made room, until it is given back, is taken to be a
    /// quarter of that.
    fn taken_by(self, pages: u64) -> u64 {
        pages + pages / 4 + pages.div_ceil(PAGED_PARTICLE) * self.particle()
    }

    fn least_pages(self) -> u64 {
        if self.is_whole { LEAST_WHOLE_PAGES } else { LEAST_PAGES }
    }
}

/// The shares of a memory, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Account {
    /// For pages, and what is known of their nodes.
    pub pages: u64,
    /// Pages whose particles may be decoded all at once.
    pub at_once: u64,
    /// For the cells of a slab of a volume.
    pub slab: u64,
    /// All that is taken, where that is more than there is.
    pub exceeding: Option<u64>,
}

impl Account {
    /// Shares a memory out. Cells of coarser grids are taken to be a quarter of those of a slab.
    pub fn of(memory: u64, task: Task) -> Account {
        let fixed = task.fixed();
        let rest = memory.saturating_sub(fixed);
        let slab = (rest / 5).clamp(LEAST_SLAB, SLAB);
        let slabs = if task.is_volume { slab + slab / 4 } else { 0 };
        let left = rest.saturating_sub(slabs);
        let pages = task.pages_within(left).max(task.least_pages()).min(memory / 2);
        let at_once = Task { is_whole: true, ..task }.pages_within(left).min(pages);
        let taken = fixed.saturating_add(slabs + task.taken_by(pages));
        Account { pages, at_once, slab, exceeding: Some(taken).filter(|taken| *taken > memory) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::{LevelChoice, SettingValue};
    use crate::modes;
    use proptest::prelude::*;

    proptest! {
        /// The parts are added up anew here.
        #[test]
        fn shares_are_no_more_than_there_is(
            (width, height) in (1_u64..8192, 1_u64..8192), (is_volume, columns) in (any::<bool>(), 0_u64..4),
            is_whole in any::<bool>(), more in 0_u64..(1 << 36),
        ) {
            let task = Task { pixels: width * height, is_volume, columns, is_whole };
            // What the fewest pages take, and the slabs that there are then.
            let [spare, least] = if is_whole { [320 << 20, LEAST_WHOLE_PAGES] } else { [64 << 20, LEAST_PAGES] };
            let memory = task.fixed() + spare + more;
            let account = Account::of(memory, task);
            let Account { pages, at_once, slab, exceeding } = account;
            let particle = if is_volume { VOLUME_PARTICLE + columns * COLUMN_PARTICLE } else { WHOLE_PARTICLE };
            let [all, some] = [pages, at_once].map(|pages| pages.div_ceil(PAGED_PARTICLE) * particle);
            let held = task.fixed() + if is_volume { 5 * (slab / 4) } else { 0 };
            let taken = held + 5 * (pages / 4) + if is_whole { all } else { 0 };
            prop_assert!(at_once <= pages && held + 5 * (at_once / 4) + some <= memory, "{memory}: {account:?}");
            prop_assert!(taken <= memory && exceeding.is_none(), "{memory}: {account:?}");
            prop_assert!(pages >= least && (LEAST_SLAB..=SLAB).contains(&slab), "{memory}: {account:?}");
            // Nothing is left over but some particles, but where pages have half or the least.
            let is_all = taken + 2048 >= memory || pages == memory / 2 || pages == least;
            prop_assert!(is_all, "{memory}: {account:?}");
            // What is added is taken from nobody, and in less nobody has more.
            let next = Account::of(memory + (1 << 20), task);
            prop_assert!(next.pages >= pages && next.slab >= slab, "{account:?} {next:?}");
            let little = more % memory;
            let less = Account::of(little, task);
            prop_assert!(less.pages <= little / 2 && less.pages <= pages && less.slab <= slab, "{little}: {less:?}");
            prop_assert!(little >= task.fixed() || less.exceeding.is_some_and(|taken| taken > little));
        }
    }

    /// Sums and flat volumes are drawn of some particles at a time; what all are decoded for at once has the smaller share of pages for it.
    #[test]
    fn what_is_drawn_at_once_counts() {
        let task = |mode: &str, settings: &[(&str, SettingValue)], as_a_whole: bool| {
            let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
            let mode = modes::find(mode).unwrap();
            let (settings, attribute, choice) = (Settings(settings), None, LevelChoice::default());
            Task::of(&Depiction { mode, settings, attribute, choice }, (300, 200), as_a_whole)
        };
        let dark = [("shadows", SettingValue::Number(0.5))];
        let field = [("field", SettingValue::Name("temperature".into()))];
        for mode in ["column-density", "density-squared", "points", "paths"] {
            assert!(!task(mode, &[], false).is_whole && !task(mode, &[], true).is_whole, "{mode}");
        }
        for mode in ["volume", "isosurface", "volume-isosurface"] {
            assert!(task(mode, &[], false).is_volume && !task(mode, &[], false).is_whole, "{mode}");
            assert!(task(mode, &[], true).is_volume && task(mode, &[], true).is_whole, "{mode}");
        }
        assert!(task("isosurface", &dark, false).is_whole && task("isosurface", &dark, false).is_volume);
        assert!(task("volume", &field, false).columns > 0);
        for mode in ["layered", "sorted-splats", "spheres", "cartesian", "cross-section", "primitives"] {
            assert!(task(mode, &[], false).is_whole && !task(mode, &[], false).is_volume, "{mode}");
        }
        let [sums, spheres] = ["column-density", "spheres"].map(|mode| Account::of(4 << 30, task(mode, &[], false)));
        assert!(sums.pages == 2 << 30 && spheres.pages < 200 << 20, "{sums:?} {spheres:?}");
        let volume = Account::of(4 << 30, task("volume", &[], false));
        assert!(volume.pages == 2 << 30 && volume.at_once < volume.pages / 4, "{volume:?}");
        let over = Depiction {
            mode: modes::find("column-density").unwrap(),
            settings: Settings::default(),
            attribute: None,
            choice: LevelChoice::default(),
        };
        assert!(Task::of(&over.as_over(), (300, 200), false).is_whole);
    }
}
