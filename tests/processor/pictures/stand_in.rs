//! What stands in for a view's splats while there is no time for all of them (clusters), and what comes after it.

use crate::stream::disk::offset_of;
use crate::support::write_demo_pages;
use deepfield::hierarchy::{Kinds, Purpose};
use deepfield::mode::{Depiction, Levels, Mode, Settings};
use deepfield::modes::{column_density, density_squared};
use deepfield::picture::stand_in::{Chosen, StandIn, Wanted};
use deepfield::store::{NodeRef, PageFile, Tree};
use deepfield::stream::{StreamOptions, Streamer};
use deepfield::view::{Detail, View};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const SPLATS: u64 = 4000;
const TAU: f64 = 0.8;

/// Whether the view moves, and how many splats there is time for.
type Pace = (bool, Option<u64>);
const MOVING: Pace = (true, Some(SPLATS));
const RESTING: Pace = (false, Some(SPLATS));

fn built(folder: &Path) -> Arc<PageFile> {
    let path = folder.join("clusters.df");
    write_demo_pages(&path, Kinds::of_particles());
    Arc::new(PageFile::open(&path).unwrap())
}

/// A window without a window.
struct Frames {
    streamer: Streamer,
    stand_in: StandIn,
    depiction: Depiction,
    families: Vec<u32>,
    view: View,
}

impl Frames {
    fn new(file: &Arc<PageFile>, mode: &'static Mode, levels: Levels, budget: u64) -> Frames {
        let metadata = file.metadata();
        let mut depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
        depiction.choice.levels = levels;
        let options = StreamOptions { budget, prefetch: false, ..StreamOptions::default() };
        let families = (0..metadata.families.len() as u32).collect();
        let view = View::around(metadata.bounds(), 0.8, 640, 480).unwrap();
        let streamer = Streamer::new(Arc::clone(file), options);
        Frames { streamer, stand_in: StandIn::default(), depiction, families, view }
    }

    fn next(&mut self, (moves, splats): Pace) -> Chosen {
        self.streamer.arrive();
        let Frames { depiction, families, view, .. } = self;
        let wanted = Wanted { depiction, tau: TAU, families, moves, splats };
        let chosen = self.stand_in.select(&mut self.streamer, view, &wanted);
        self.streamer.serve();
        self.streamer.take_evicted();
        if self.streamer.is_busy() {
            self.streamer.wait(Duration::from_millis(20));
        }
        chosen
    }

    /// Frames until one is as it is asked for.
    fn until(&mut self, pace: Pace, what: impl Fn(&Chosen) -> bool) -> Vec<Chosen> {
        let mut frames = Vec::new();
        loop {
            frames.push(self.next(pace));
            if what(&frames[frames.len() - 1]) {
                return frames;
            }
            assert!(frames.len() < 5000, "{:?}", frames.last());
        }
    }
}

fn drawn(chosen: &Chosen) -> Vec<NodeRef> {
    chosen.selection.draw.iter().map(|drawn| drawn.id).collect()
}

#[test]
fn a_view_that_moves_shows_clusters_and_one_that_rests_its_own_splats_after_them() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let mut frames = Frames::new(&file, &column_density::MODE, Levels::Auto, u64::MAX);
    let there = |chosen: &Chosen| chosen.selection.is_converged();
    let motion = frames.until(MOVING, there);
    let last = &motion[motion.len() - 1];
    assert!(motion.iter().all(|chosen| chosen.stands_in && chosen.selection.particles() <= SPLATS));
    assert!(last.purpose == Purpose::Clusters && last.selection.particles() >= SPLATS * 95 / 100);
    // Of the view's own levels nothing was asked for.
    let root = file.roots(&frames.families, Purpose::Splats, 0.0)[0].page;
    assert!(frames.streamer.residency.page(root).is_none());
    let rest = frames.until(RESTING, |chosen| !chosen.stands_in);
    let (own, on_the_way) = rest.split_last().unwrap();
    assert!(!on_the_way.is_empty() && on_the_way.iter().all(|chosen| chosen.stands_in && there(chosen)));
    assert!(there(own) && own.purpose == Purpose::Splats && own.selection.particles() > SPLATS);
    // As it would be without clusters, and again clusters as soon as it moves.
    assert_eq!(drawn(own), drawn(&frames.next((false, None))));
    assert!(frames.next(MOVING).stands_in && !frames.next(RESTING).stands_in);
    assert_eq!(drawn(last), drawn(&frames.next(MOVING)));
}

#[test]
fn a_view_that_has_just_opened_shows_clusters_first() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let mut frames = Frames::new(&file, &column_density::MODE, Levels::Auto, u64::MAX);
    let opening = frames.until(RESTING, |chosen| !chosen.stands_in);
    let complete = opening.iter().position(|chosen| chosen.selection.is_converged()).unwrap();
    assert!(opening[complete].stands_in && complete + 1 < opening.len());
    assert!(opening[opening.len() - 1].selection.is_converged());
}

#[test]
fn what_cannot_be_read_is_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let bytes = std::fs::read(file.path()).unwrap();
    let root = |purpose| file.roots(&[0], purpose, 0.0)[0].page;
    let (clusters, own) = (root(Purpose::Clusters), root(Purpose::Splats));
    assert_ne!(clusters, own);
    let damaged = |page| {
        let mut bytes = bytes.clone();
        let at = offset_of(&bytes, page) as usize + 500;
        bytes[at..at + 200].iter_mut().for_each(|byte| *byte ^= 0x5a);
        let path = folder.path().join(format!("damaged-{}.df", page.0));
        std::fs::write(&path, bytes).unwrap();
        let file = Arc::new(PageFile::open(&path).unwrap());
        Frames::new(&file, &column_density::MODE, Levels::Auto, u64::MAX)
    };
    // Without clusters a view shows its own detail when it rests.
    let without = damaged(clusters).until(RESTING, |chosen| !chosen.stands_in);
    let last = &without[without.len() - 1];
    assert!(last.selection.is_converged() && last.selection.particles() > SPLATS);
    assert!(without.iter().all(|chosen| !chosen.stands_in || chosen.selection.draw.is_empty()));
    // Without its own detail it keeps the clusters.
    let mut frames = damaged(own);
    frames.until(RESTING, |chosen| chosen.selection.is_converged());
    assert!((0..100).all(|_| !frames.next(RESTING).selection.draw.is_empty()));
}

#[test]
fn clusters_stand_in_where_they_are_wanted_and_suit() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let stands_in = |mode, levels| Frames::new(&file, mode, levels, u64::MAX).next(MOVING).stands_in;
    let (mass, twice) = (&column_density::MODE, &density_squared::MODE);
    assert!(stands_in(mass, Levels::Auto) && stands_in(mass, Levels::Clusters) && !stands_in(mass, Levels::Splats));
    assert!(!stands_in(twice, Levels::Auto) && stands_in(twice, Levels::Clusters));
    let plain = folder.path().join("plain.df");
    write_demo_pages(&plain, Kinds::default());
    let plain = Arc::new(PageFile::open(&plain).unwrap());
    assert!(!Frames::new(&plain, mass, Levels::Auto, u64::MAX).next(MOVING).stands_in);
}

#[test]
fn hue_waits_until_the_view_rests() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plain.df");
    write_demo_pages(&path, Kinds::default());
    let file = Arc::new(PageFile::open(&path).unwrap());
    let mut frames = Frames::new(&file, &density_squared::MODE, Levels::Auto, u64::MAX);
    assert!(frames.depiction.attribute.is_some());
    let is_there = |chosen: &Chosen| chosen.selection.is_converged();
    let shown = |frames: &mut Frames, pace| {
        let Chosen { detail, at_rest, stands_in, .. } = frames.until(pace, is_there).pop().unwrap();
        assert!(!stands_in);
        (detail, at_rest)
    };
    let [whole, quarter] = [TAU, 0.25 * TAU].map(|tau| Detail::Error { tau });
    for moving in [MOVING, (true, None)] {
        assert_eq!(shown(&mut frames, moving), (whole, false));
        assert_eq!(shown(&mut frames, RESTING), (quarter, true));
    }
    // Where nothing is in view nothing is left to wait for, either.
    let view = frames.view;
    frames.view.forward = -view.forward;
    frames.view.right = -view.right;
    assert_eq!(shown(&mut frames, MOVING), (whole, true));
    frames.view = view;
    // Without hue nothing is left to wait for.
    frames.depiction.attribute = None;
    assert_eq!([MOVING, RESTING].map(|pace| shown(&mut frames, pace)), [(whole, true); 2]);
}
