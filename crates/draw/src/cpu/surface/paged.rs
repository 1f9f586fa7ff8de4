//! The quadtree of a field in a page file: chunks are read and decoded as they are asked for, and the least recently used ones go first.

mod decode;
mod faults;
mod leaf;
mod normals;
mod photo;
mod slopes;
#[cfg(test)]
mod tests;

use super::photo::PhotoTiles;
use super::picture::{SurfaceOptions, chosen};
use super::placed::Placed;
use super::samples::MeanNormal;
use super::select::Coarse;
use super::sight::Sight;
use super::since::Since;
use super::source::{NodeFacts, NodeSamples, SurfaceNodes};
use crate::stream::residency::{ATTEMPTS, backoff};
use crate::stream::scene::STALL;
use decode::Decoder;
use deepfield_data::model::{SampleType, Scale};
use deepfield_data::store::error::Damage;
use deepfield_data::store::take_notes;
use deepfield_heights::hierarchy::chunks::{ChunkKey, ChunkNode, Coverage, Lattice};
use deepfield_heights::hierarchy::photo::TileKey;
use deepfield_heights::store::{HeightFile, Tile};
use faults::Pages;
use lru::LruCache;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::hash::Hash;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// The largest distance between two unit normals.
const FARTHEST: f32 = 2.0;

/// A chunk's samples, or a tile's texels, once somebody has decoded them; `None` where they cannot be read. Whoever asks meanwhile waits.
type Slot<V> = Arc<OnceLock<Option<Arc<V>>>>;

/// A page file's chunks as they are drawn. Several threads read and decode at once, a chunk one of them at a time.
pub struct PagedSurface {
    file: Arc<HeightFile>,
    pages: Pages,
    lattice: Lattice,
    decoder: Decoder,
    budget_bytes: u64,
    cache: Mutex<Cache<ChunkKey, NodeSamples>>,
    /// Tiles of the photo, if there is one, with a budget of their own.
    tile_budget_bytes: u64,
    tiles: Mutex<Cache<TileKey, Tile>>,
    /// The earlier field that changes are counted from, where they are asked for.
    since: Option<Arc<Since>>,
}

/// Chunks, or tiles, that are decoded or being decoded, by their last use.
struct Cache<K: Hash + Eq, V> {
    entries: LruCache<K, Entry<V>>,
    bytes: u64,
}

struct Entry<V> {
    slot: Slot<V>,
    /// 0 until it is decoded.
    bytes: u64,
}

impl PagedSurface {
    /// The chunks of a file. Of what is decoded `budget_bytes` are kept at most, beside what others hold, a quarter of them for a photo's tiles
    /// where there is one. A file whose chunks are of another
    /// size than is drawn has none, and [`PagedSurface::error`] says so until a picture begins.
    pub fn new(file: Arc<HeightFile>, budget_bytes: u64) -> PagedSurface {
        let about = file.about();
        let lattice = Lattice::new(about.grid.rows, about.grid.columns);
        let decoder = Decoder::new(about, slopes::of_file(&about.grid));
        let (cache, tiles) = (Mutex::new(Cache::new()), Mutex::new(Cache::new()));
        let tile_budget_bytes = if about.photo.is_some() { budget_bytes / 4 } else { 0 };
        let budget_bytes = budget_bytes - tile_budget_bytes;
        let pages = Pages::new(Arc::clone(&file), STALL);
        if *file.lattice() != lattice {
            let expected = format!("{0} x {0} cells, found {1} x {1}", lattice.side(), file.lattice().side());
            pages.note(&Damage::new("chunks", expected).in_file(file.path()));
        }
        PagedSurface { file, pages, lattice, decoder, budget_bytes, cache, tile_budget_bytes, tiles, since: None }
    }

    /// Pages are waited for so long from now on, those behind a URL for a minute at least.
    pub fn wait_for(&mut self, stall: Duration) {
        self.pages.wait_for(stall);
    }

    /// Begins a picture: turns normals to a world in which the field is placed so; exaggeration and base do not matter. Without this degrees are
    /// those of the Earth, as in the file. What is decoded is decoded again where slopes change, and what pictures before could not have is asked
    /// for again where it is time.
    pub fn place(&mut self, placed: &Placed) {
        self.begin();
        let about = self.file.about();
        let slopes = slopes::of_world(placed);
        if !slopes::is_same(slopes, self.decoder.slopes()) {
            self.decoder = Decoder::new(about, slopes);
            self.forget();
        }
    }

    /// Begins a picture; whether pages are asked for again that earlier ones could not have.
    pub(super) fn begin(&self) -> bool {
        if self.since.as_ref().is_some_and(|since| since.begin()) {
            self.forget();
        }
        self.pages.begin()
    }

    /// What is decoded is decoded again: changes may be known now.
    fn forget(&self) {
        *locked(&self.cache) = Cache::new();
    }

    /// Counts changes since an earlier field, or none. What is decoded is decoded again where that is another one.
    pub fn compare(&mut self, since: Option<&Arc<Since>>) {
        let is_same = match (&self.since, since) {
            (Some(own), Some(other)) => Arc::ptr_eq(own, other),
            (own, other) => own.is_none() && other.is_none(),
        };
        if !is_same {
            self.since = since.cloned();
            self.forget();
        }
    }

    /// The file.
    pub fn file(&self) -> &HeightFile {
        &self.file
    }

    /// Why something that the present picture needs could not be read. Coarser chunks stand in for such.
    pub fn error(&self) -> Option<String> {
        self.pages.error().or_else(|| self.since.as_ref().and_then(|since| since.error()))
    }

    /// What is to be told of pages that cannot be read, and of what has become of the file, since the last call, one sentence each.
    pub fn take_messages(&self) -> Vec<String> {
        let mut messages = self.pages.take_messages();
        messages.extend(self.since.iter().flat_map(|since| since.take_messages()));
        messages.extend(take_notes());
        messages
    }

    /// When another picture may have what this one does without.
    pub fn again(&self) -> Option<Instant> {
        self.pages.again().into_iter().chain(self.since.as_ref().and_then(|since| since.again())).min()
    }

    /// Whether something is to be tried again, since this was asked last, before it is told: nothing is lacked until then.
    pub(super) fn try_again(&self) -> bool {
        let is_since = self.since.as_ref().is_some_and(|since| since.try_again());
        if is_since {
            self.forget();
        }
        self.pages.try_again() | is_since
    }

    /// Bytes of the decoded chunks and tiles that are kept.
    pub fn held_bytes(&self) -> u64 {
        locked(&self.cache).bytes + locked(&self.tiles).bytes
    }

    /// Reads and decodes chunks by as many threads as there are: of these the first that fit into the budget.
    pub fn prefetch(&self, keys: &[ChunkKey]) {
        let mut left = self.budget_bytes;
        let fits = |key: &ChunkKey| {
            let after = left.checked_sub(self.bytes_of(*key));
            left = after.unwrap_or(0);
            after.is_some()
        };
        let fitting: Vec<ChunkKey> = keys.iter().copied().filter(|key| self.has(*key)).take_while(fits).collect();
        fitting.into_par_iter().for_each(|key| drop(self.samples(key)));
    }

    /// Reads what a picture needs, all at once. Where chunks turn out to be damaged, also what stands in for them: a picture that is drawn
    /// next has no gaps there. What the disk fails to give is asked for a few times before it is told.
    pub fn prepare(&self, placed: &Placed, sight: &Sight, options: &SurfaceOptions) {
        if options.coarse == Coarse::Means {
            // Leaves are read as they are drawn.
            return;
        }
        // What other parts of the picture lack is lacked still.
        let before = self.pages.take_lack();
        self.read_all(placed, sight, options);
        for attempt in (1..ATTEMPTS).take_while(|_| self.try_again()) {
            std::thread::sleep(backoff(attempt));
            self.read_all(placed, sight, options);
        }
        self.pages.lack(before);
    }

    fn read_all(&self, placed: &Placed, sight: &Sight, options: &SurfaceOptions) {
        let colors = options.look.is_some().then(|| options.clone());
        let raw = options.raw.then(|| SurfaceOptions { look: None, ..options.clone() });
        // A chunk whose stand-in is lost, too, has another one: at most one of each level.
        for _ in 0..=self.lattice.top() {
            let before = self.pages.lost();
            let mut keys = BTreeSet::new();
            for options in [&colors, &raw].into_iter().flatten() {
                for node in chosen(self, placed, sight, options).nodes {
                    keys.extend((node.key.level..=self.lattice.top()).map(|level| node.key.ancestor(level)));
                }
            }
            // Fine ones first, as drawing asks for them: where not all fit, it finds the first and reads none twice.
            self.prefetch(&keys.into_iter().collect::<Vec<_>>());
            if self.pages.lost() == before {
                return;
            }
        }
    }

    /// About how many bytes a chunk takes when it is decoded, at most.
    fn bytes_of(&self, key: ChunkKey) -> u64 {
        let [rows, columns] = [0, 1].map(|axis| self.lattice.span(key, axis).1 as u64);
        let (grid, facts) = (&self.file.about().grid, &self.file.about().facts);
        let is_whole = facts.valid == grid.samples();
        let height = match grid.sample_type {
            _ if grid.scale != Scale::NONE => 8,
            SampleType::I8 | SampleType::U8 | SampleType::I16 if is_whole => 2,
            SampleType::I32 | SampleType::U32 | SampleType::F64 => 8,
            _ => 4,
        };
        let normal = size_of::<MeanNormal>() as u64;
        let coverage = u64::from(!is_whole);
        let singles = grid.planes.len() as u64 + u64::from(self.since.is_some());
        rows * columns * (height + normal + coverage + 4 * singles)
    }

    fn has(&self, key: ChunkKey) -> bool {
        *self.file.lattice() == self.lattice && self.lattice.has(key)
    }

    fn read(&self, key: ChunkKey) -> Option<Arc<NodeSamples>> {
        let Some(page) = self.file.page_of(key) else {
            return Some(Arc::new(self.decoder.nothing([0, 1].map(|axis| self.lattice.span(key, axis).1))));
        };
        let chunk = self.pages.read(page, |raw| self.file.chunk_in(key, raw))?;
        let mut samples = self.decoder.samples(chunk, &self.lattice);
        if let Some(since) = &self.since {
            samples.changes = since.changes(&self.lattice, key, &samples.heights);
        }
        Some(Arc::new(samples))
    }
}

impl SurfaceNodes for PagedSurface {
    fn lattice(&self) -> Lattice {
        self.lattice
    }

    fn facts(&self, key: ChunkKey) -> Option<NodeFacts> {
        let node = self.file.node(key).filter(|_| self.has(key))?;
        let mut facts = facts(key, node);
        if let Some(since) = &self.since {
            facts.change = facts.delta + since.unseen(&self.lattice, key);
        }
        Some(facts)
    }

    fn samples(&self, key: ChunkKey) -> Option<Arc<NodeSamples>> {
        if !self.has(key) {
            return None;
        }
        cached(&self.cache, key, self.budget_bytes, bytes_of, || self.read(key))
    }

    fn is_there(&self, key: ChunkKey) -> bool {
        self.file.page_of(key).is_none_or(|page| self.pages.is_there(page))
    }

    fn room(&self) -> u64 {
        self.budget_bytes
    }

    fn bytes(&self, key: ChunkKey) -> u64 {
        self.bytes_of(key)
    }

    fn photo(&self) -> Option<&dyn PhotoTiles> {
        self.file.photo().map(|_| self as &dyn PhotoTiles)
    }
}

/// What is kept under a key, or read and kept.
fn cached<K: Hash + Eq + Copy, V>(
    cache: &Mutex<Cache<K, V>>,
    key: K,
    budget: u64,
    bytes_of: impl Fn(&V) -> u64,
    read: impl FnOnce() -> Option<Arc<V>>,
) -> Option<Arc<V>> {
    let slot = locked(cache).slot(key);
    if let Some(found) = slot.get() {
        return found.clone();
    }
    let found = slot.get_or_init(read).clone();
    locked(cache).keep(key, &slot, found.as_deref().map(bytes_of), budget);
    found
}

impl<K: Hash + Eq + Copy, V> Cache<K, V> {
    fn new() -> Cache<K, V> {
        Cache { entries: LruCache::unbounded(), bytes: 0 }
    }

    /// Where a chunk is, or will be.
    fn slot(&mut self, key: K) -> Slot<V> {
        self.entries.get_or_insert(key, || Entry { slot: Slot::default(), bytes: 0 }).slot.clone()
    }

    /// Counts a chunk that was decoded, and drops others until the budget holds; forgets one that could not be, so that it is read again.
    fn keep(&mut self, key: K, slot: &Slot<V>, bytes: Option<u64>, budget: u64) {
        // It may have been dropped while it was decoded, and others may have waited for it.
        let entry = self.entries.peek_mut(&key).filter(|entry| Arc::ptr_eq(&entry.slot, slot) && entry.bytes == 0);
        match (entry, bytes) {
            (Some(entry), Some(bytes)) => {
                entry.bytes = bytes;
                self.bytes += bytes;
            }
            (Some(_), None) => drop(self.entries.pop(&key)),
            (None, _) => {}
        }
        while self.bytes > budget {
            let Some((_, entry)) = self.entries.pop_lru() else { break };
            self.bytes -= entry.bytes;
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn bytes_of(samples: &NodeSamples) -> u64 {
    let NodeSamples { heights, coverage, normals, ranges, planes, changes, .. } = samples;
    let planes: usize = planes.iter().map(|plane| size_of_val(plane.as_slice())).sum();
    let others = [
        heights.bytes(),
        coverage.len(),
        normals.bytes(),
        size_of_val(ranges.as_slice()),
        size_of_val(changes.as_slice()),
    ];
    (others.into_iter().sum::<usize>() + planes + size_of::<NodeSamples>()) as u64
}

/// What the file keeps of a chunk, as choosing wants it.
///
/// The file has the root of the mean square of what differs from a sample's mean; choosing asks for the largest difference. What of a sample
/// of level `k` a sample of full resolution stands for is the share `4^-k` of it, and if that is `d` away from the mean, the mean square is
/// at least `4^-k d^2`: so no `d` is above `2^k` times the root. This is what it may be where all differs in one place, as a dot on a map;
/// mostly it is far less, but a bound that is too large costs no more than samples a pixel apart.
fn facts(key: ChunkKey, node: &ChunkNode) -> NodeFacts {
    let spread = node.normal_deviation.max(node.colour_deviation);
    NodeFacts {
        delta: node.delta,
        step: node.step,
        min: node.min,
        max: node.max,
        coverage: match node.coverage {
            Coverage::None => [0, 0],
            Coverage::Partial => [1, u8::MAX - 1],
            Coverage::Whole => [u8::MAX; 2],
        },
        deviation: (spread * f32::from(key.level).exp2()).min(FARTHEST),
        change: 0.0,
    }
}
