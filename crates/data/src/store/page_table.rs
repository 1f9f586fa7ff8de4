//! Where the pages of a file lie: a table that the footer has whole or, of many pages, in parts that lie before it. Of these index pages the
//! footer tells enough for everything but reading a page; each is read, and checked, when a page in it is first asked for.
//!
//! What has been read is looked up without a lock and stays: index pages take a hundred-thousandth of what the pages take that they are of.

use super::disk::Disk;
use super::error::Damage;
use super::layout::{
    ALIGNMENT, Header, INDEX_RECORD_LEN, IndexRecord, MOST_INDEX_ENTRIES, PAGE_ENTRY_LEN, PAGE_HEADER_LEN, PageEntry,
    align_up,
};
use super::wire::Decoder;
use std::collections::HashMap;
use std::io;
use std::sync::{Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// How long threads wait for another one that reads the index page that they need, before one of them reads it as well: a read may never be
/// answered.
const PATIENCE: Duration = Duration::from_secs(1);
/// How long a thread waits in all: as long as for an answer over a network.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// The table of a file's pages, as far as it is known.
#[derive(Debug)]
pub struct PageTable {
    /// Number of pages.
    len: usize,
    /// Pages of an index page; the last one may have fewer. At least 1.
    together: usize,
    /// A whole table is one that is known from the beginning.
    index: Vec<IndexPage>,
    /// Where the table begins in the file, if it is not in the footer.
    place: Option<u64>,
    /// The index pages that are being read, and when the latest read of each began.
    reading: Mutex<HashMap<usize, Instant>>,
    /// One has been read, or could not be.
    ended: Condvar,
    /// [`PATIENCE`] and [`LONGEST_WAIT`].
    waits: [Duration; 2],
}

/// A part of the table.
#[derive(Debug)]
struct IndexPage {
    record: IndexRecord,
    /// Where its last page ends, with the zeros after it.
    end: u64,
    entries: OnceLock<Box<[PageEntry]>>,
}

/// What a page takes; before its index page is read, what the pages of that take on average.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageSize {
    /// Bytes in the file.
    pub bytes: u64,
    /// Node records.
    pub nodes: u64,
    /// Bytes that its particles take in memory.
    pub memory: u64,
}

/// Why an index page could not be read.
#[derive(Debug)]
pub(super) enum Unread {
    /// The disk's answer.
    Io(io::Error),
    /// What is wrong with it.
    Damaged(Damage),
}

impl PageTable {
    /// The table that a footer begins with, and how many bytes of the footer tell of it.
    ///
    /// # Errors
    /// [`Damage`] where pages do not follow one another from the header to the footer.
    pub(super) fn open(header: &Header, footer: &[u8]) -> Result<(PageTable, usize), Damage> {
        if header.is_indexed() { PageTable::indexed(header, footer) } else { PageTable::whole(header, footer) }
    }

    fn whole(header: &Header, footer: &[u8]) -> Result<(PageTable, usize), Damage> {
        let len = header.pages as usize;
        let bytes = len.checked_mul(PAGE_ENTRY_LEN).and_then(|len| footer.get(..len));
        let bytes = bytes.ok_or_else(|| Damage::new("footer", "room for the page table"))?;
        let entries = decode(bytes);
        let (record, end) = (IndexRecord::of(&entries, crc32c::crc32c(bytes)), header.footer_offset);
        if follow(&entries, 0, [ALIGNMENT, end])? != end {
            return Err(Damage::new("header", "a footer right after the last page"));
        }
        let index = vec![IndexPage { record, end, entries: OnceLock::from(entries) }];
        Ok((PageTable::new(len, len.max(1), index, None), bytes.len()))
    }

    fn indexed(header: &Header, footer: &[u8]) -> Result<(PageTable, usize), Damage> {
        let mut input = Decoder::new(footer, "footer");
        let together = input.u32("the entries of an index page")?;
        if !(1..=MOST_INDEX_ENTRIES).contains(&together) {
            let expected = format!("1 to {MOST_INDEX_ENTRIES} entries of an index page, found {together}");
            return Err(Damage::new("footer", expected));
        }
        let (len, together) = (header.pages as usize, together as usize);
        let records = len.div_ceil(together).saturating_mul(INDEX_RECORD_LEN);
        let records = input.bytes(records, "a record of each index page")?;
        let records = records.chunks_exact(INDEX_RECORD_LEN).filter_map(|record| record.try_into().ok());
        let records: Vec<IndexRecord> = records.map(IndexRecord::decode).collect();
        // 32 bits count the pages, so neither product nor sum is near 64 bits.
        let table = (u64::from(header.pages) * PAGE_ENTRY_LEN as u64).next_multiple_of(ALIGNMENT);
        let place = header.footer_offset.checked_sub(table);
        let place = place.ok_or_else(|| Damage::new("footer", "room for the page table before it"))?;
        if records.first().is_none_or(|first| first.start != ALIGNMENT) {
            return Err(Damage::new("footer", "an index of pages of which the first comes right after the header"));
        }
        let ends = records.iter().skip(1).map(|next| next.start).chain([place]);
        let parts = records.iter().zip(ends).enumerate().map(|(number, (&record, end))| {
            let pages = together.min(len - number * together) as u64;
            let longest = u64::from(record.longest).next_multiple_of(ALIGNMENT);
            let bytes = end.checked_sub(record.start).filter(|_| end.is_multiple_of(ALIGNMENT));
            let is_sound = bytes.is_some_and(|bytes| (pages * ALIGNMENT..=pages * longest).contains(&bytes))
                && (pages..=pages * u64::from(u32::MAX)).contains(&record.nodes)
                && record.memory <= pages * u64::from(u32::MAX);
            match is_sound {
                true => Ok(IndexPage { record, end, entries: OnceLock::new() }),
                false => {
                    let expected = format!("place, nodes and memory of {pages} pages before those of the next one");
                    Err(Damage::new(format!("footer, index page {number}"), expected))
                }
            }
        });
        let index = parts.collect::<Result<Vec<IndexPage>, Damage>>()?;
        Ok((PageTable::new(len, together, index, Some(place)), size_of::<u32>() + records.len() * INDEX_RECORD_LEN))
    }

    fn new(len: usize, together: usize, index: Vec<IndexPage>, place: Option<u64>) -> PageTable {
        let waits = [PATIENCE, LONGEST_WAIT];
        PageTable { len, together, index, place, reading: Mutex::default(), ended: Condvar::new(), waits }
    }

    /// Number of pages.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no page.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Where a page lies; `None` where there is no such page, or its index page has not been read.
    pub fn get(&self, page: usize) -> Option<&PageEntry> {
        self.index.get(page / self.together)?.entries.get()?.get(page % self.together)
    }

    /// What is known, in order: of a whole table all entries.
    pub fn iter(&self) -> impl Iterator<Item = &PageEntry> {
        self.index.iter().filter_map(|part| part.entries.get()).flat_map(|entries| entries.iter())
    }

    /// What a page takes, as far as is known; `None` where there is no such page.
    pub fn size(&self, page: usize) -> Option<PageSize> {
        let PageEntry { len, nodes, memory, .. } = match self.get(page) {
            Some(entry) => *entry,
            None => return self.usual(page),
        };
        Some(PageSize { bytes: len.into(), nodes: nodes.into(), memory: memory.into() })
    }

    /// What pages of the same index page take on average, rounded up.
    fn usual(&self, page: usize) -> Option<PageSize> {
        let number = page / self.together;
        let IndexPage { record, end, .. } = self.index.get(number).filter(|_| page < self.len)?;
        let mean = |sum: u64| sum.div_ceil(self.pages_of(number) as u64);
        Some(PageSize { bytes: mean(end - record.start), nodes: mean(record.nodes), memory: mean(record.memory) })
    }

    /// The largest length of a page, bytes.
    pub fn longest(&self) -> u32 {
        self.index.iter().map(|part| part.record.longest).max().unwrap_or(0)
    }

    /// Whether a page is in an index page that has not been read.
    pub(super) fn is_unread(&self, page: usize) -> bool {
        self.index.get(page / self.together).is_some_and(|part| part.entries.get().is_none())
    }

    /// Whether any index page has not been read.
    pub(super) fn has_unread(&self) -> bool {
        self.index.iter().any(|part| part.entries.get().is_none())
    }

    /// From where to where zeros follow the table before the footer.
    pub(super) fn zeros(&self) -> Option<[u64; 2]> {
        let end = self.place? + self.len as u64 * PAGE_ENTRY_LEN as u64;
        Some([end, end.next_multiple_of(ALIGNMENT)])
    }

    /// Reads the index page that a page is in, unless that was read; waits for the disk. Threads that want the same one wait for each other,
    /// though not for ever: from time to time one of them reads it as well.
    ///
    /// # Errors
    /// [`Unread`] where the disk fails, answers nobody for long, or it is damaged; then the next one who asks tries again.
    pub(super) fn load(&self, page: usize, disk: &dyn Disk) -> Result<(), Unread> {
        let number = page / self.together;
        let Some(part) = self.index.get(number).filter(|part| part.entries.get().is_none()) else { return Ok(()) };
        let Some(begun) = self.begin(number, part)? else { return Ok(()) };
        // Two of them read the same.
        let outcome = self.read(number, part, disk).map(|entries| drop(part.entries.set(entries)));
        let mut reading = self.reading();
        // Whoever began later is still at it.
        if reading.get(&number) == Some(&begun) {
            reading.remove(&number);
        }
        drop(reading);
        self.ended.notify_all();
        outcome
    }

    /// Waits until an index page has been read by another thread, or it is this one's turn to: then since when.
    fn begin(&self, number: usize, part: &IndexPage) -> Result<Option<Instant>, Unread> {
        let [patience, longest] = self.waits;
        let asked = Instant::now();
        let mut reading = self.reading();
        while part.entries.get().is_none() {
            let now = Instant::now();
            let turn = reading.get(&number).map_or(Duration::ZERO, |&begun| patience.saturating_sub(now - begun));
            let left = longest.saturating_sub(now - asked);
            if turn.is_zero() {
                reading.insert(number, now);
                return Ok(Some(now));
            }
            if left.is_zero() {
                return Err(Unread::Io(io::ErrorKind::TimedOut.into()));
            }
            let woken = self.ended.wait_timeout(reading, turn.min(left));
            (reading, _) = woken.unwrap_or_else(PoisonError::into_inner);
        }
        Ok(None)
    }

    fn reading(&self) -> MutexGuard<'_, HashMap<usize, Instant>> {
        self.reading.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of pages of an index page.
    fn pages_of(&self, number: usize) -> usize {
        self.together.min(self.len - number * self.together)
    }

    fn read(&self, number: usize, part: &IndexPage, disk: &dyn Disk) -> Result<Box<[PageEntry]>, Unread> {
        let damaged = |expected: &str| Unread::Damaged(Damage::new(format!("index page {number}"), expected));
        let first = number * self.together;
        let offset = self.place.map(|place| place + first as u64 * PAGE_ENTRY_LEN as u64);
        let offset = offset.ok_or_else(|| damaged("to exist"))?;
        // The whole table lies in the file, as opening has found.
        let mut bytes = vec![0; self.pages_of(number) * PAGE_ENTRY_LEN];
        disk.read_known_at(&mut bytes, offset, part.record.crc).map_err(Unread::Io)?;
        if crc32c::crc32c(&bytes) != part.record.crc {
            return Err(damaged("its checksum"));
        }
        let entries = decode(&bytes);
        let end = follow(&entries, first, [part.record.start, part.end]).map_err(Unread::Damaged)?;
        let is_as_told = IndexRecord::of(&entries, part.record.crc) == part.record && end == part.end;
        if !is_as_told || entries.iter().any(|entry| entry.nodes == 0) {
            return Err(damaged("pages that together are what the footer tells of them, with a node each at least"));
        }
        Ok(entries)
    }
}

/// The index of a table in parts of so many entries, as the footer has it, and the table itself.
pub(super) fn encode(table: &[PageEntry], together: u32) -> (Vec<u8>, Vec<u8>) {
    let mut index = together.to_le_bytes().to_vec();
    let mut entries = Vec::with_capacity(table.len() * PAGE_ENTRY_LEN);
    for part in table.chunks(together.max(1) as usize) {
        let from = entries.len();
        entries.extend(part.iter().flat_map(PageEntry::encode));
        index.extend(IndexRecord::of(part, crc32c::crc32c(&entries[from..])).encode());
    }
    (index, entries)
}

fn decode(bytes: &[u8]) -> Box<[PageEntry]> {
    let entries = bytes.chunks_exact(PAGE_ENTRY_LEN).filter_map(|entry| entry.try_into().ok());
    entries.map(PageEntry::decode).collect()
}

/// Pages, of which `first` is the number of the first, must follow one another from `start`, each at the next aligned place, and end before
/// `end`. Where the next one would be.
fn follow(entries: &[PageEntry], first: usize, [start, end]: [u64; 2]) -> Result<u64, Damage> {
    let mut next = start;
    for (i, entry) in entries.iter().enumerate() {
        let damaged = |expected: &str| Damage::new(format!("page table, entry {}", first + i), expected);
        if entry.offset != next || !entry.len.is_multiple_of(8) || (entry.len as usize) < PAGE_HEADER_LEN {
            return Err(damaged("a page right after the page before"));
        }
        let after = next.checked_add(u64::from(entry.len)).and_then(|after| align_up(after, ALIGNMENT));
        next = after.filter(|&after| after <= end).ok_or_else(|| damaged("a page that ends before the footer"))?;
    }
    Ok(next)
}

#[cfg(test)]
mod tests;
