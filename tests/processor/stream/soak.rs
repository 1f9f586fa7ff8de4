//! A quarter of an hour of random flight, run faster than real time: pages come and go within the budget, and memory stays
//! flat.

use super::disk::{in_memory, many};
use crate::support::{Random, alone};
use deepfield::hierarchy::Purpose;
use deepfield::store::{PageFile, PageId};
use deepfield::stream::{CopyOptions, StreamOptions, Streamer};
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::sync::Arc;
use std::time::Duration;

/// Error that makes the picture need a few pages at a time, pixels.
const TAU: f64 = 3.0;

/// A camera that flies at random: it glides towards places in the box, and now and then jumps.
struct Estimate {
    random: Random,
    eye: DVec3,
    goal: DVec3,
    speed: f64,
}

impl Estimate {
    fn new(seed: u64) -> Estimate {
        Estimate { random: Random(seed), eye: DVec3::splat(0.5), goal: DVec3::ONE, speed: 0.01 }
    }

    fn anywhere(&mut self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| 1.4 * self.random.next() - 0.2))
    }

    /// The next frame's camera; the box is the unit cube scaled and moved to the file's.
    fn fly(&mut self, file: &PageFile) -> View {
        if self.eye.distance(self.goal) < 2.0 * self.speed {
            self.goal = self.anywhere();
            self.speed = 0.04 * self.random.next().powi(2) + 1e-3;
            if self.random.next() < 0.3 {
                self.eye = self.anywhere();
            }
        }
        self.eye += self.speed * (self.goal - self.eye).normalize_or_zero();
        let bounds = file.metadata().bounds();
        let place = |unit: DVec3| bounds.min + unit * bounds.size();
        let projection = Projection::Perspective { fov_y: 0.3 };
        let ahead = place(self.goal) + DVec3::new(1e-6, 2e-6, 3e-6) * bounds.size();
        View::look_at(place(self.eye), ahead, DVec3::new(0.1, 1.0, 0.2), projection, 300, 200).unwrap()
    }
}

/// Resident memory of this process, bytes, where the system tells.
fn resident_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? << 10)
}

/// Flies so many frames in 7 of 10 parts of the memory that the file would take, and copies as a GPU would. What it is read from may fail, in
/// so far as `tells` lets what is told then.
pub fn soak(file: &Arc<PageFile>, frames: u32, tells: fn(&str) -> bool) {
    let memory: Vec<u64> = (0..file.page_count()).map(|page| file.page_memory(PageId(page))).collect();
    let (whole, largest) = (memory.iter().sum::<u64>(), memory.iter().copied().max().unwrap());
    let budget = (whole * 7 / 10).max(4 * largest);
    println!("{} pages of {} MiB, {} MiB of them may be there", memory.len(), whole >> 20, budget >> 20);
    let stall = Duration::from_secs(60);
    let options = StreamOptions { budget, in_flight: 4, stall, prefetch: true, ..StreamOptions::default() };
    let mut streamer = Streamer::new(Arc::clone(file), options);
    let copy_budget = budget * 9 / 10;
    streamer.keep_copies(Some(CopyOptions { budget: copy_budget, on_their_way: 8 << 20 }));
    let roots = streamer.roots(0..file.metadata().families.len() as u32, Purpose::Splats, 0.0);
    let mut pilot = Estimate::new(7);
    let (mut reads, mut evicted, mut converged, mut prefetched) = (0, 0, 0, 0);
    let mut before = None;
    for frame in 0..frames {
        let view = pilot.fly(file);
        let arrivals = streamer.arrive();
        assert!(arrivals.messages.iter().all(|message| tells(message)), "{:?}", arrivals.messages);
        reads += arrivals.pages.len();
        // The renderer's copies are there a frame later.
        let copies = streamer.copies.as_mut().unwrap();
        let waiting: Vec<_> = copies.on_their_way().collect();
        waiting.into_iter().for_each(|page| copies.arrived(page));
        let selection = streamer.select(&view, TAU, &roots);
        converged += u32::from(selection.is_converged());
        // What the frame draws stays where it is, whatever is read ahead.
        let drawn: Vec<_> = selection.visited.iter().map(|node| node.page).collect();
        let started = streamer.serve().started;
        prefetched += usize::from(selection.is_converged()) * started.len();
        evicted += streamer.take_evicted().len();
        streamer.plan_copies();
        let copies = streamer.copies.as_ref().unwrap();
        assert!(drawn.iter().all(|&page| streamer.residency.page(page).is_some() && copies.has(page)));
        assert!(copies.bytes() <= copy_budget, "{} of {copy_budget}", copies.bytes());
        let statistics = streamer.residency.statistics();
        assert!(statistics.bytes <= budget, "{} of {budget} bytes at frame {frame}", statistics.bytes);
        assert_eq!(statistics.stalled, 0);
        if frame == frames / 5 {
            before = resident_memory();
        }
        // A frame that waits for nothing takes no time.
        if !(selection.is_converged() && started.is_empty()) {
            std::thread::sleep(Duration::from_micros(300));
        }
    }
    println!(
        "{frames} frames: {reads} pages read ({prefetched} asked for ahead), {evicted} evicted, {converged} frames converged"
    );
    assert!(evicted > 10 && reads > evicted, "the budget is too large to be tested: {reads} read, {evicted} evicted");
    if let (Some(before), Some(after)) = (before, resident_memory()) {
        println!("resident memory {} MiB after a fifth, {} MiB at the end", before >> 20, after >> 20);
        assert!(after < before + before / 4 + (16 << 20), "memory grows: {before} to {after}");
    }
}

#[test]
fn a_random_flight_stays_within_its_budget() {
    // A quarter of an hour at 30 frames a second. A disk that does not fail gives nothing to tell.
    let fly = || soak(&in_memory(many()), 27_000, |_| false);
    alone("stream::soak::a_random_flight_stays_within_its_budget", fly);
}
