//! Requests as pages are asked for: one follows another as soon as that is answered, whatever frames do meanwhile, and none is sent for what is
//! no longer wanted.

use super::{open, pages_apart, place, served, some_page};
use crate::support::fault_server::{Fault, FaultServer};
use deepfield::store::{NodeRef, PageFile, PageId};
use deepfield::stream::{LookAhead, StreamOptions, Streamer};
use std::sync::Arc;
use std::time::{Duration, Instant};

fn streamer(file: &Arc<PageFile>) -> Streamer {
    // All that is read at a time may be read ahead, as far as a link lets it.
    let ahead = LookAhead { share: 1.0, ..LookAhead::default() };
    let options = StreamOptions { budget: u64::MAX, prefetch: false, ahead, ..StreamOptions::default() };
    Streamer::new(Arc::clone(file), options)
}

fn nodes(pages: &[PageId]) -> impl Iterator<Item = NodeRef> {
    pages.iter().map(|&page| NodeRef { page, node: 0 })
}

/// Asks for pages and nothing else.
fn hold(streamer: &mut Streamer, pages: &[PageId]) {
    assert!(streamer.hold(nodes(pages)));
}

/// Waits until so many of these pages have been asked for. Those that have been, in their order in the file.
fn asked(server: &FaultServer, pages: &[PageId], count: usize) -> Vec<PageId> {
    let (start, places) = (Instant::now(), pages.iter().map(|page| (*page, place(*page))).collect::<Vec<_>>());
    loop {
        let ranges: Vec<_> = server.asked().into_iter().filter_map(|asked| asked.range).collect();
        let found = places.iter().filter(|(_, place)| ranges.contains(place));
        let asked: Vec<PageId> = found.map(|(page, _)| *page).collect();
        if asked.len() >= count {
            return asked;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "{asked:?} of {pages:?}, expected {count} of them");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_server_is_asked_for_the_next_page_before_the_next_frame() {
    let server = served();
    let file = open(&server);
    let (pages, at_once) = (pages_apart(&file), file.reads_at_once().unwrap());
    let mut streamer = streamer(&file);
    hold(&mut streamer, &pages);
    let started = streamer.serve().started;
    assert_eq!(started, pages[..2 * at_once]);
    // No frame begins, and yet all of them are asked for, not all at a time.
    assert_eq!(asked(&server, &pages, started.len()), started);
    assert!(server.most_at_once() < started.len(), "{} at a time", server.most_at_once());
}

#[test]
fn what_is_no_longer_wanted_is_not_asked_for() {
    let server = served();
    let file = open(&server);
    let (pages, at_once) = (pages_apart(&file), file.reads_at_once().unwrap());
    let (old, new) = pages.split_at(2 * at_once);
    assert!(!new.is_empty(), "{pages:?} are too few for this test");
    server.answer(|_| Fault::Stall);
    let mut streamer = streamer(&file);
    hold(&mut streamer, old);
    assert_eq!(streamer.serve().started, old);
    assert_eq!(asked(&server, &pages, at_once), old[..at_once]);
    // The view changes before anything has come.
    hold(&mut streamer, new);
    let mut served = streamer.serve();
    served.withdrawn.sort_unstable();
    assert_eq!(served.withdrawn, old[at_once..]);
    assert_eq!(served.started, new[..new.len().min(at_once)]);
    let under_way = [&old[..at_once], &served.started[..]].concat();
    server.answer(|_| Fault::Sound);
    let start = Instant::now();
    while streamer.is_busy() {
        assert!(start.elapsed() < Duration::from_secs(60));
        streamer.wait(Duration::from_millis(10));
        streamer.arrive();
    }
    assert_eq!(asked(&server, &pages, under_way.len()), under_way);
    assert!(under_way.iter().all(|page| streamer.residency.page(*page).is_some()));
}

#[test]
fn reading_ahead_has_half_of_the_requests_at_most_and_the_rest_is_for_what_is_missed() {
    let server = served();
    let file = open(&server);
    let (pages, at_once) = (pages_apart(&file), file.reads_at_once().unwrap());
    let (missed, later) = pages.split_at(at_once);
    let half = at_once / 2;
    assert!(half > 0 && later.len() > half, "{pages:?} are too few for this test");
    server.answer(|_| Fault::Stall);
    let mut streamer = streamer(&file);
    streamer.read_ahead(nodes(later));
    assert_eq!(streamer.serve().started, later[..half]);
    assert_eq!(asked(&server, &pages, half), later[..half]);
    // Other frames that miss nothing ask for no more of them.
    streamer.read_ahead(nodes(later));
    assert!(streamer.serve().started.is_empty());
    // What is missed does not wait for them: at least as many requests as theirs are left for it.
    hold(&mut streamer, missed);
    assert_eq!(streamer.serve().started, missed);
    assert_eq!(asked(&server, &pages, at_once), [&missed[..at_once - half], &later[..half]].concat());
    server.answer(|_| Fault::Sound);
}

#[test]
fn a_server_that_is_busy_or_fails_is_asked_for_less_at_a_time() {
    for (status, is_less) in
        [(404, false), (408, true), (429, true), (500, true), (502, true), (503, true), (504, true)]
    {
        let server = served();
        let file = open(&server);
        let (page, before) = (some_page(&file), file.reads_at_once().unwrap());
        server.answer(move |_| Fault::Status(status, None));
        assert!(file.read_page(page).is_err(), "{status}");
        let after = file.reads_at_once().unwrap();
        assert_eq!(after < before, is_less, "{status}: {before}, then {after}");
    }
}
