//! Random flight over a link that spoils answers: memory stays as it is, and where the flight stops the picture is that of the file here.

use super::super::flight::check::values;
use super::super::flight::engine::{Engine, Haste};
use super::super::flight::{self, Options};
use super::super::process_memory::resident_memory;
use super::super::splat::Failure;
use super::link::{Counts, Link};
use crate::model::Bounds;
use crate::store::{PageId, Tree};
use crate::synth::random::Random;
use crate::view::{Projection, View, ViewError};
use glam::DVec3;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Seconds between two stops, and parts of the flight between them at most.
const LEG_SECS: f64 = 10.0;
const LEGS: f64 = 3.0;
/// Pages take this share of the memory of all pages at most, so that they come and go.
const SHARE: f64 = 0.7;
/// How often memory is looked at, from the beginning to the end.
const LOOKS: usize = 5;
/// Messages that are kept.
const MOST_MESSAGES: usize = 100;

/// What random flight came to.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Flown {
    /// How long it took, seconds.
    pub seconds: f64,
    /// Frames in motion.
    pub frames: u64,
    /// Halts.
    pub stops: u64,
    /// Of these, those where the picture did not converge within the two minutes that it is waited for, here or over the link.
    pub not_converged: u64,
    /// Of the others, those where a value of the picture was not that of the file here, to the bit.
    pub different: u64,
    /// What has passed.
    pub passed: Counts,
    /// How much memory pages may take, and what they took at most, bytes.
    pub budget_bytes: u64,
    /// See `budget_bytes`.
    pub most_bytes: u64,
    /// Resident memory of the program at the beginning, after each quarter and at the end, bytes; nothing where the system does not tell.
    pub resident_bytes: Vec<u64>,
    /// What was told.
    pub messages: Vec<String>,
}

/// A camera that flies at random: it glides towards places in the box, and now and then jumps.
struct Pilot {
    random: Random,
    /// What is flown through; places are shares of it.
    bounds: Bounds,
    eye: DVec3,
    goal: DVec3,
    /// Sides of the box a second.
    speed: f64,
    then: f64,
}

impl Pilot {
    fn new(bounds: Bounds, seed: u64) -> Pilot {
        let random = Random::new(seed, 0);
        Pilot { random, bounds, eye: DVec3::splat(0.5), goal: DVec3::splat(0.5), speed: 0.0, then: 0.0 }
    }

    fn anywhere(&mut self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| 1.2 * self.random.uniform() - 0.1))
    }

    /// The camera after so many seconds of flight.
    fn view(&mut self, seconds: f64, (width, height): (u32, u32)) -> Result<View, ViewError> {
        let way = self.speed * (seconds - self.then);
        self.then = seconds;
        if self.eye.distance(self.goal) <= way.max(1e-3) {
            self.goal = self.anywhere();
            self.speed = 0.01 + 0.2 * self.random.uniform().powi(2);
            if self.random.uniform() < 0.3 {
                self.eye = self.anywhere();
            }
        }
        self.eye += way * (self.goal - self.eye).normalize_or_zero();
        let place = |share: DVec3| self.bounds.min + share * self.bounds.size();
        // Never straight up, and not at the eye itself.
        let ahead = place(self.goal) + DVec3::new(1e-6, 2e-6, 3e-6) * self.bounds.size();
        let projection = Projection::Perspective { fov_y: 45_f64.to_radians() };
        View::look_at(place(self.eye), ahead, DVec3::new(0.1, 1.0, 0.2), projection, width, height)
    }
}

/// Flies for so many seconds through the file behind `url`, which is the one at `path`.
///
/// # Errors
/// When either cannot be opened, or it cannot be drawn.
pub fn fly(path: &Path, url: &Path, link: &Link, options: &Options, seconds: f64, seed: u64) -> Result<Flown, Failure> {
    flight::with_canvas("cpu", path, options, |here, _| {
        flight::with_canvas("cpu", url, options, |afar, _| through(here, afar, link, seconds, seed))
    })
}

fn through(
    here: &mut Engine<'_>,
    afar: &mut Engine<'_>,
    link: &Link,
    seconds: f64,
    seed: u64,
) -> Result<Flown, Failure> {
    let all: u64 = (0..here.tree.page_count()).map(|page| here.tree.page_memory(PageId(page))).sum();
    let budget_bytes = here.options.budget.min((SHARE * all as f64) as u64);
    (here.options.budget, afar.options.budget) = (budget_bytes, budget_bytes);
    let mut pilot = Pilot::new(here.tree.metadata().bounds(), seed);
    let (mut streamer, mut own) = (afar.streamer(), here.streamer());
    let mut flown = Flown { budget_bytes, resident_bytes: resident_memory().into_iter().collect(), ..Flown::default() };
    let leg = LEG_SECS.min(seconds / LEGS);
    let (start, mut halts) = (Instant::now(), leg);
    while flown.seconds < seconds {
        let view = pilot.view(flown.seconds, afar.size)?;
        afar.frame(&mut streamer, &view, Haste::Moves(afar.frame_ms))?;
        flown.frames += 1;
        flown.seconds = start.elapsed().as_secs_f64();
        if flown.seconds >= halts {
            let there = afar.converge(&mut streamer, &view)?;
            let local = here.converge(&mut own, &view)?;
            flown.stops += 1;
            match there.converged.is_some() && local.converged.is_some() {
                true => flown.different += u64::from(values(&there.picture) != values(&local.picture)),
                false => flown.not_converged += 1,
            }
            flown.seconds = start.elapsed().as_secs_f64();
            halts = flown.seconds + leg;
        }
        let room = MOST_MESSAGES.saturating_sub(flown.messages.len());
        flown.messages.extend(afar.messages.drain(..).take(room));
        let due = (flown.seconds / seconds * (LOOKS - 1) as f64) as usize + 1;
        while flown.resident_bytes.len() < due.min(LOOKS) {
            let Some(bytes) = resident_memory() else { break };
            flown.resident_bytes.push(bytes);
        }
    }
    flown.passed = link.counts();
    flown.most_bytes = streamer.residency.statistics().most_bytes;
    Ok(flown)
}
