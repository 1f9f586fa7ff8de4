use super::*;
use crate::build::{BuildOptions, build};
use crate::codec::VqBits;
use crate::hierarchy::OctreeOptions;
use crate::model::Placement;
use crate::store::disk::Change;
use crate::store::footer;
use crate::store::layout::{HEADER_LEN, MAGIC, VERSION, VERSION_INDEXED, u32_at, u64_at};
use crate::store::page::NODE_MEMORY;
use crate::store::verify::{Verified, verify_file};
use crate::store::writer::ends_of;
use crate::store::{PageFile, PageId};
use crate::synth::{dataset, merger::Merger};
use proptest::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Barrier};

/// Pages of an index page in most tests.
const TOGETHER: usize = 5;

/// What a disk does about reads that begin in some range.
#[derive(Debug, Default)]
enum Fault {
    #[default]
    None,
    /// Refuses so many.
    Refuse(Range<u64>, usize),
    /// Answers so many only when this is over.
    Stall(Range<u64>, usize),
}

/// Bytes in memory.
#[derive(Debug)]
struct Memory {
    bytes: Vec<u8>,
    /// Where reads have begun.
    asked: Mutex<Vec<u64>>,
    fault: Mutex<Fault>,
    changed: Condvar,
}

impl Memory {
    fn new(bytes: Vec<u8>) -> Arc<Memory> {
        Arc::new(Memory { bytes, asked: Mutex::default(), fault: Mutex::default(), changed: Condvar::new() })
    }

    fn set(&self, fault: Fault) {
        *self.fault.lock().unwrap() = fault;
        self.changed.notify_all();
    }

    fn asked(&self) -> Vec<u64> {
        self.asked.lock().unwrap().clone()
    }

    fn open(self: &Arc<Memory>) -> Result<PageFile, crate::store::StoreError> {
        PageFile::open_on(Path::new("memory.df"), Arc::clone(self) as Arc<dyn Disk>)
    }
}

impl Disk for Memory {
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        self.asked.lock().unwrap().push(offset);
        let mut fault = self.fault.lock().unwrap();
        if let Fault::Stall(range, times) = &mut *fault
            && range.contains(&offset)
            && *times > 0
        {
            *times -= 1;
            fault = self.changed.wait_while(fault, |fault| matches!(fault, Fault::Stall(..))).unwrap();
        }
        if let Fault::Refuse(range, times) = &mut *fault
            && range.contains(&offset)
            && *times > 0
        {
            *times -= 1;
            return Err(io::ErrorKind::TimedOut.into());
        }
        drop(fault);
        let from = usize::try_from(offset).unwrap();
        let bytes = from.checked_add(buffer.len()).and_then(|end| self.bytes.get(from..end));
        buffer.copy_from_slice(bytes.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.bytes.len() as u64)
    }

    fn change(&self) -> Option<Change> {
        None
    }
}

/// A file of some dozen pages whose table is in the footer.
fn whole() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let octree =
            OctreeOptions { vq_bits: VqBits::Eight, refined: false, leaf_capacity: 64, ..OctreeOptions::default() };
        let options = BuildOptions { octree, page_bytes: 2 << 10, ..BuildOptions::default() };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("whole.df");
        build(dataset(&Merger::new(3, 4000)), &options, &path, &()).unwrap();
        std::fs::read(path).unwrap()
    })
}

/// The same pages in a file with index pages of so many.
fn indexed(together: usize) -> Vec<u8> {
    let file = Memory::new(whole().to_vec()).open().unwrap();
    let table: Vec<PageEntry> = file.first().container().table().iter().copied().collect();
    let about = footer::encode(file.metadata(), VERSION_INDEXED);
    // Here the footer follows the last page at once.
    let end = u64_at(whole(), 24);
    let (header, tail) = ends_of(MAGIC, VERSION_INDEXED, &table, end, &about, together as u32);
    [&header.encode()[..], &whole()[HEADER_LEN..end as usize], &tail].concat()
}

/// Where the footer begins, and where the table lies before it.
fn places(bytes: &[u8]) -> (usize, Range<usize>) {
    let (footer, len) = (u64_at(bytes, 24) as usize, u32_at(bytes, 44) as usize * PAGE_ENTRY_LEN);
    let start = footer - len.next_multiple_of(ALIGNMENT as usize);
    (footer, start..start + len)
}

/// Where an index page of [`TOGETHER`] pages lies.
fn part(bytes: &[u8], number: usize) -> Range<u64> {
    let (start, len) = (places(bytes).1.start, TOGETHER * PAGE_ENTRY_LEN);
    (start + number * len) as u64..(start + (number + 1) * len) as u64
}

/// Whether all of the table can be read, and nothing but zeros follows it.
fn has_table(bytes: Vec<u8>) -> bool {
    let Ok(file) = Memory::new(bytes).open() else { return false };
    let container = file.first().container();
    let is_known = |page: PageId| container.learn(page, page).is_ok();
    (0..file.page_count()).map(PageId).all(is_known) && container.check_zeros(None).is_ok()
}

#[test]
fn pages_are_the_same_wherever_their_table_lies() {
    let here = Memory::new(whole().to_vec()).open().unwrap();
    let pages = here.page_count();
    assert!(pages > 4 * TOGETHER as u32, "{pages} pages are too few for these tests");
    for together in [1, 2, TOGETHER, pages as usize - 1, pages as usize, 1000] {
        let disk = Memory::new(indexed(together));
        let there = disk.open().unwrap();
        assert_eq!(disk.asked().len(), 2, "header and footer");
        assert_eq!(there.metadata(), here.metadata());
        assert_eq!(there.page_count(), pages);
        assert_eq!(there.largest_page_bytes(), here.largest_page_bytes());
        // Before anything is read, pages are as large as others, and together as large as all.
        let sum = |file: &PageFile| (0..pages).map(|page| file.page_memory(PageId(page))).sum::<u64>();
        let rounded = u64::from(pages) * (1 + NODE_MEMORY);
        assert!((sum(&here)..sum(&here) + rounded).contains(&sum(&there)), "{} of {}", sum(&there), sum(&here));
        // From the last one on, as no walk goes.
        for page in (0..pages).rev().map(PageId) {
            let [own, other] = [&here, &there].map(|file| file.fetch_page(page).unwrap());
            assert_eq!(own.bytes(), other.bytes());
            let [own, other] = [(&here, own), (&there, other)].map(|(file, bytes)| file.decode_page(bytes).unwrap());
            assert_eq!(own.nodes, other.nodes);
            assert!((0..own.nodes.len()).all(|node| own.children(node) == other.children(node)));
            let mut children = (0..other.nodes.len()).flat_map(|node| other.children(node)).map(|child| child.page);
            assert!(children.all(|child| there.page_memory(child) == here.page_memory(child)));
            assert_eq!(there.page_bytes(page), here.page_bytes(page));
        }
        assert_eq!(disk.asked().len(), 2 + pages as usize + (pages as usize).div_ceil(together));
        let verified = [&here, &there].map(|file| Verified { bytes: 0, ..verify_file(file, &()).unwrap() });
        assert_eq!(verified[0], verified[1]);
        assert!(there.read_page(PageId(pages)).unwrap_err().to_string().contains("to exist"));
    }
    let both = [Memory::new(indexed(TOGETHER)).open().unwrap(), here].map(|file| (file, Placement::HERE));
    let (scene, _) = PageFile::join(both.into()).unwrap();
    for page in 0..pages {
        let [first, second] = [page, pages + page].map(|page| scene.read_page(PageId(page)).unwrap());
        assert_eq!(first.nodes, second.nodes);
    }
}

#[test]
fn every_flipped_bit_of_a_table_is_found() {
    let sound = indexed(TOGETHER);
    let (footer, table) = places(&sound);
    assert!(has_table(sound.clone()));
    let index = footer..footer + 4 + u32_at(&sound, 44).div_ceil(TOGETHER as u32) as usize * INDEX_RECORD_LEN;
    let zeros = (table.end..footer).step_by(61);
    let missed = |at: &usize| {
        let mut flipped = sound.clone();
        flipped[*at] ^= 1 << (at % 8);
        has_table(flipped)
    };
    let missed: Vec<usize> = table.chain(zeros).chain(index).filter(missed).collect();
    assert!(missed.is_empty(), "flips not found at {missed:?}");
}

/// Gives index pages, footer and header the checksums that their bytes have, as somebody who means harm would.
fn correct(bytes: &mut [u8]) {
    let (footer, pages) = (u64_at(bytes, 24), u32_at(bytes, 44) as usize);
    if let Some(footer) = usize::try_from(footer).ok().filter(|footer| *footer < bytes.len() - 4) {
        let together = u32_at(bytes, footer).max(1) as usize;
        let table = (pages * PAGE_ENTRY_LEN).next_multiple_of(ALIGNMENT as usize);
        for number in 0..footer.checked_sub(table).map_or(0, |_| pages.div_ceil(together)) {
            let from = footer - table + number * together * PAGE_ENTRY_LEN;
            let to = footer - table + pages.min((number + 1) * together) * PAGE_ENTRY_LEN;
            let crc = crc32c::crc32c(&bytes[from..to]);
            let place = footer + 4 + number * INDEX_RECORD_LEN + 28;
            let Some(place) = bytes.get_mut(place..place + 4) else { break };
            place.copy_from_slice(&crc.to_le_bytes());
        }
        let crc = crc32c::crc32c(&bytes[footer..]);
        bytes[40..44].copy_from_slice(&crc.to_le_bytes());
    }
    let crc = crc32c::crc32c(&bytes[..60]);
    bytes[60..64].copy_from_slice(&crc.to_le_bytes());
}

#[test]
fn hostile_counts_and_places_are_refused_before_anything_is_read() {
    let sound = indexed(TOGETHER);
    let (footer, _) = places(&sound);
    let record = |number: usize, field: usize| footer + 4 + number * INDEX_RECORD_LEN + field;
    let start = u64_at(&sound, record(2, 0));
    let narrow = |at: usize, value: u32| (at, value.to_le_bytes().to_vec());
    let wide = |at: usize, value: u64| (at, value.to_le_bytes().to_vec());
    for (at, value) in [
        // Pages, and how many an index page has.
        narrow(44, 0),
        narrow(44, u32::MAX),
        narrow(footer, 0),
        narrow(footer, 1),
        narrow(footer, MOST_INDEX_ENTRIES + 1),
        narrow(footer, u32::MAX),
        // Where pages start: not after the header, over others, in others' places, nowhere.
        wide(record(0, 0), 0),
        wide(record(0, 0), 2 * ALIGNMENT),
        wide(record(1, 0), ALIGNMENT),
        wide(record(1, 0), start),
        wide(record(2, 0), start + 8),
        wide(record(2, 0), ALIGNMENT),
        wide(record(2, 0), u64::MAX),
        wide(record(2, 0), 0_u64.wrapping_sub(ALIGNMENT)),
        // Memory, nodes, the longest page.
        wide(record(1, 8), u64::MAX),
        wide(record(1, 16), 0),
        wide(record(1, 16), u64::MAX),
        narrow(record(1, 24), 0),
    ] {
        let mut forged = sound.clone();
        forged[at..at + value.len()].copy_from_slice(&value);
        correct(&mut forged);
        let disk = Memory::new(forged);
        let told = disk.open().unwrap_err().to_string();
        assert!(told.starts_with("memory.df: ") && !told.contains('\n'), "{told}");
        assert!(disk.asked().len() <= 2, "{at}: {told}");
    }
}

proptest! {
    #![proptest_config(crate::cases::cases(256))]

    #[test]
    fn no_forged_table_is_taken_for_another(
        changes in prop::collection::vec(
            (any::<prop::sample::Index>(), prop_oneof![any::<u32>(), Just(0), Just(u32::MAX), 0..9000_u32], 1..5_usize),
            1..4,
        ),
        place in 0..3_usize,
    ) {
        static SOUND: OnceLock<Vec<u8>> = OnceLock::new();
        let sound = SOUND.get_or_init(|| indexed(TOGETHER));
        let (footer, table) = places(sound);
        let records = (table.len() / PAGE_ENTRY_LEN).div_ceil(TOGETHER) * INDEX_RECORD_LEN;
        let range = [12..60, table, footer..footer + 4 + records][place].clone();
        let mut forged = sound.clone();
        for (at, value, width) in changes {
            let at = range.start + at.index(range.len() - 4);
            forged[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
        }
        correct(&mut forged);
        let is_read = |bytes: Vec<u8>| {
            let Ok(file) = Memory::new(bytes).open() else { return false };
            (0..file.page_count()).all(|page| file.read_page(PageId(page)).is_ok())
        };
        prop_assert!(forged == *sound || !is_read(forged));
    }
}

#[test]
fn what_an_index_page_lacks_is_lacking_where_it_is_needed_and_tried_again() {
    let sound = indexed(TOGETHER);
    let disk = Memory::new(sound.clone());
    let file = disk.open().unwrap();
    disk.set(Fault::Refuse(part(&sound, 0), 2));
    for _ in 0..2 {
        let error = file.read_page(PageId(0)).unwrap_err();
        assert!(error.may_pass() && error.to_string().contains("page 0: cannot be read"), "{error}");
    }
    file.read_page(PageId(0)).unwrap();
    // A damaged one takes away its own pages, and those that lead to them.
    let mut damaged = sound;
    let at = part(&damaged, 2).start as usize + 9;
    damaged[at] ^= 4;
    let damaged = Memory::new(damaged).open().unwrap();
    let mut lost = 0;
    for page in (0..file.page_count()).map(PageId) {
        let sound = file.read_page(page).unwrap();
        let children = (0..sound.nodes.len()).flat_map(|node| sound.children(node)).map(|child| child.page);
        let needs = children.chain([page]).any(|page| page.0 as usize / TOGETHER == 2);
        match damaged.read_page(page) {
            Ok(read) => assert!(!needs && read.nodes == sound.nodes),
            Err(error) => {
                assert!(needs && !error.may_pass() && error.to_string() == "memory.df: index page 2: its checksum");
                lost += 1;
            }
        }
    }
    assert!((TOGETHER as u32..file.page_count()).contains(&lost), "{lost} pages");
}

#[test]
fn threads_read_an_index_page_once() {
    let sound = indexed(TOGETHER);
    let disk = Memory::new(sound.clone());
    let file = disk.open().unwrap();
    let (threads, pages) = (8, file.page_count());
    let together = Barrier::new(threads);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                together.wait();
                (0..pages).for_each(|page| drop(file.read_page(PageId(page)).unwrap()));
            });
        }
    });
    for number in 0..(pages as usize).div_ceil(TOGETHER) {
        let range = part(&sound, number);
        assert_eq!(disk.asked().iter().filter(|offset| range.contains(offset)).count(), 1, "index page {number}");
    }
}

/// The table of a file, whose threads wait so long.
fn table(bytes: &[u8], waits: [Duration; 2]) -> PageTable {
    let versions = VERSION..=VERSION_INDEXED;
    let header = Header::decode(&bytes[..HEADER_LEN], bytes.len() as u64, MAGIC, versions).ok().unwrap();
    let (table, _) = PageTable::open(&header, &bytes[places(bytes).0..]).unwrap();
    PageTable { waits, ..table }
}

#[test]
fn of_threads_that_wait_for_a_stalled_read_one_at_a_time_reads_again() {
    const PATIENCE: Duration = Duration::from_millis(20);
    const STALLED: usize = 2;
    let sound = indexed(TOGETHER);
    let disk = Memory::new(sound.clone());
    let table = table(&sound, [PATIENCE, LONGEST_WAIT]);
    disk.set(Fault::Stall(part(&sound, 0), STALLED));
    let start = Instant::now();
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| table.load(0, &*disk).is_ok())).collect();
        let left = || threads.iter().filter(|thread| !thread.is_finished()).count();
        while left() > STALLED && start.elapsed() < LONGEST_WAIT {
            std::thread::yield_now();
        }
        let (left, asked) = (left(), disk.asked().len());
        let most = 1 + (start.elapsed().as_nanos() / PATIENCE.as_nanos()) as usize;
        disk.set(Fault::None);
        assert_eq!(left, STALLED);
        assert!((STALLED + 1..=most).contains(&asked), "{asked} reads, {most} at most");
        assert!(threads.into_iter().all(|thread| thread.join().unwrap()));
    });
}

#[test]
fn who_has_waited_long_for_a_stalled_read_is_told() {
    let sound = indexed(TOGETHER);
    let disk = Memory::new(sound.clone());
    let table = table(&sound, [LONGEST_WAIT, Duration::from_millis(5)]);
    disk.set(Fault::Stall(part(&sound, 0), 1));
    std::thread::scope(|scope| {
        let threads = [(); 2].map(|()| scope.spawn(|| table.load(0, &*disk)));
        while !threads.iter().any(|thread| thread.is_finished()) {
            std::thread::yield_now();
        }
        disk.set(Fault::None);
        let outcomes = threads.map(|thread| thread.join().unwrap());
        let mut errors = outcomes.iter().filter_map(|outcome| outcome.as_ref().err());
        let is_late = matches!(errors.next(), Some(Unread::Io(error)) if error.kind() == io::ErrorKind::TimedOut);
        assert!(is_late && errors.next().is_none(), "{outcomes:?}");
    });
    table.load(0, &*disk).unwrap();
    assert_eq!(disk.asked().len(), 1);
}
