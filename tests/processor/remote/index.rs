//! Files of so many pages that their table lies in index pages: opening reads none of these, and what one of them lacks comes later.

use super::{ENDS, converge, open, sound};
use crate::stream::disk::in_memory;
use crate::support::fault_server::{Asked, Fault, FaultServer};
use crate::support::run;
use deepfield::store::layout::{
    ALIGNMENT, NO_PAGE, NODE_RECORD_LEN, PAGE_ENTRY_LEN, PAGE_HEADER_LEN, VERSION_INDEXED, particles_memory,
};
use deepfield::store::{PageFileWriter, PageId};
use std::collections::HashMap;
use std::io::{Read, Seek};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

/// Pages at least: more than a table in the footer has.
const PAGES: u32 = 4097;
/// Bytes of the footer, about: so many that the beginning of the table before it is no part of what opening reads.
const FOOTER: usize = 240 << 10;
/// Bytes of an index page.
const PART: u64 = 1024 * PAGE_ENTRY_LEN as u64;

/// How far the pages of [`sound`] are from each other in number; those between hold nothing.
fn stride() -> u32 {
    PAGES.div_ceil(in_memory(sound()).page_count())
}

/// The pages of [`sound`] in a file of many.
fn many() -> &'static Arc<Vec<u8>> {
    static BYTES: OnceLock<Arc<Vec<u8>>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let (file, stride) = (in_memory(sound()), stride());
        let folder = tempfile::tempdir().unwrap();
        let mut writer = PageFileWriter::create(&folder.path().join("many.df")).unwrap();
        for id in (0..file.page_count()).map(PageId) {
            let page = file.read_page(id).unwrap();
            let mut bytes = file.fetch_page(id).unwrap().bytes().to_vec();
            // Its own number, and those of its nodes' children.
            let children = (0..page.nodes.len()).map(|node| PAGE_HEADER_LEN + node * NODE_RECORD_LEN + 128);
            for at in children.flat_map(|at| (0..8).map(move |child| at + 8 * child)).chain([4]) {
                let number = u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
                if number != NO_PAGE {
                    bytes[at..at + 4].copy_from_slice(&(number * stride).to_le_bytes());
                }
            }
            let memory = page.nodes.iter().map(|node| particles_memory(node.encoding, node.particles)).sum();
            writer.append(page.family, page.nodes.len() as u32, memory, &bytes).unwrap();
            for _ in 1..stride {
                writer.append(page.family, 1, 0, &[0; PAGE_HEADER_LEN]).unwrap();
            }
        }
        let mut metadata = file.metadata().clone();
        for family in &mut metadata.families {
            assert!(family.volume.is_none() && family.clusters.is_none(), "one tree, whose root is moved");
            family.root_page.0 *= stride;
        }
        let own = u64::from_le_bytes(sound()[32..40].try_into().unwrap()) as usize;
        metadata.provenance.notes.push(" ".repeat(FOOTER - own));
        let complete = writer.complete(&metadata).unwrap();
        let (mut bytes, mut written) = (Vec::new(), complete.file());
        written.rewind().unwrap();
        written.read_to_end(&mut bytes).unwrap();
        assert_eq!(bytes[8..12], VERSION_INDEXED.to_le_bytes());
        Arc::new(bytes)
    })
}

/// Where the first index page lies: first byte and the one after the last.
fn first_part() -> (u64, u64) {
    let footer = u64::from_le_bytes(many()[24..32].try_into().unwrap());
    let pages = u32::from_le_bytes(many()[44..48].try_into().unwrap());
    let start = footer - (u64::from(pages) * PAGE_ENTRY_LEN as u64).next_multiple_of(ALIGNMENT);
    (start, start + PART)
}

/// Answers requests for the first index page with a fault so many times, and all others well.
fn faulty(server: &FaultServer, fault: Fault, times: usize) {
    let left = Mutex::new(times);
    server.answer(move |asked: &Asked| {
        let mut left = left.lock().unwrap();
        match asked.range == Some(first_part()) && *left > 0 {
            true => {
                *left -= 1;
                fault
            }
            false => Fault::Sound,
        }
    });
}

#[test]
fn many_pages_open_with_few_bytes_and_each_index_page_is_read_once() {
    let (server, local) = (FaultServer::new(Arc::clone(many())), in_memory(sound()));
    let file = open(&server);
    assert_eq!(server.asked().len(), 2);
    assert!(server.sent() <= ENDS.iter().sum::<u64>(), "{} bytes", server.sent());
    assert!(file.page_count() >= PAGES && file.metadata().particles() == local.metadata().particles());
    assert_eq!(file.largest_page_bytes(), local.largest_page_bytes());
    let stride = stride();
    for page in 0..local.page_count() {
        let both = [(&file, page * stride), (&local, page)];
        let [there, here] = both.map(|(file, page)| file.read_page(PageId(page)).unwrap());
        assert_eq!(there.nodes, here.nodes);
    }
    let mut asked: HashMap<(u64, u64), usize> = HashMap::new();
    server.asked().iter().for_each(|asked_for| *asked.entry(asked_for.range.unwrap()).or_default() += 1);
    assert!(asked.values().all(|times| *times == 1), "{asked:?}");
    // Of the table whole index pages, as far as opening has not read them.
    let (start, _) = first_part();
    let end = many().len() as u64 - ENDS[1];
    let parts: Vec<_> = asked.keys().filter(|(from, _)| (start..end).contains(from)).collect();
    assert!(!parts.is_empty(), "{asked:?}");
    assert!(parts.iter().all(|(from, to)| (from - start).is_multiple_of(PART) && to - from == PART), "{parts:?}");
    let (folder, before) = (tempfile::tempdir().unwrap(), server.asked().len());
    let output = run(folder.path(), &["info", &server.url("told.df")]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(server.asked().len(), before + 2);
}

#[test]
fn an_index_page_that_fails_or_stalls_comes_later_and_shows_in_no_picture() {
    let server = FaultServer::new(Arc::clone(many()));
    let times = |since: usize| server.asked()[since..].iter().filter(|asked| asked.range == Some(first_part())).count();
    for fault in [Fault::Status(503, None), Fault::Short, Fault::Cut] {
        let (file, since) = (open(&server), server.asked().len());
        faulty(&server, fault, 2);
        let (selection, told) = converge(&file);
        assert!(selection.converged && told.is_empty(), "{fault:?}: {told:?}");
        assert!(times(since) >= 3, "{fault:?}");
    }
    let (file, since) = (open(&server), server.asked().len());
    faulty(&server, Fault::Stall, usize::MAX);
    std::thread::scope(|scope| {
        let converging = scope.spawn(|| {
            let (selection, told) = converge(&file);
            assert!(selection.converged && told.is_empty(), "{told:?}");
        });
        while times(since) == 0 && !converging.is_finished() {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(!converging.is_finished());
        server.answer(|_| Fault::Sound);
    });
    // What will not pass is told as of the page that needs it, and asked for once.
    let (file, since) = (open(&server), server.asked().len());
    faulty(&server, Fault::Status(403, None), 1);
    let told = file.read_page(PageId(0)).unwrap_err().to_string();
    assert!(told.contains("page 0: ") && told.contains("does not let this be read (status 403)"), "{told}");
    assert_eq!(server.asked().len(), since + 1);
    file.read_page(PageId(0)).unwrap();
}
