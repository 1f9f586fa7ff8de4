//! `deepfield bench remote`: a file by URL, from [`serve`](crate::serve) in this process over a link that is as fast and as far as is said:
//! how soon there is a picture, what is read for it, and how it is flown through, beside the same file from the disk.

mod link;
mod options;
mod random_flight;

pub use options::Options;

use super::flight::check::values;
use super::flight::engine::{Engine, Haste, Station};
use super::flight::series::Summary;
use super::flight::{self, Opened};
use super::splat::Failure;
use crate::command_line::arguments::PictureSize;
use crate::command_line::cache;
use crate::command_line::progress_bar::TerminalProgress;
use crate::look::DataKind;
use crate::mode::Plan;
use crate::serve::{Files, Offer, ServeOptions, Server};
use crate::store::{PageFile, PageId, Tree, keep_pages_from_afar};
use crate::stream::Streamer;
use link::{Counts, Link, Shape};
use random_flight::Flown;
use serde::Serialize;
use std::collections::HashSet;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The picture's size where none is said.
const SIZE: PictureSize = PictureSize { width: 1280, height: 720 };

/// What a file came to.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The file.
    pub path: PathBuf,
    /// Number of source particles.
    pub particles: u64,
    /// Its length.
    pub bytes: u64,
    /// Bits per second of the link.
    pub rate: f64,
    /// Seconds of a round trip.
    pub latency_s: f64,
    /// What `info` reads: what the file is, and what it holds.
    pub info: Read,
    /// Until the usual view shows the whole of every family, coarse.
    pub first_picture: Read,
    /// Until it is within the error; `None` where it is not after two minutes, or needs more memory than there is.
    pub converged: Option<Read>,
    /// Bytes of the pages that this view draws, as they are in memory once it is drawn from the disk, with nothing read ahead.
    pub wanted_bytes: u64,
    /// What was read for the converged picture beyond these pages and what opening reads, as a share of these pages.
    pub above_wanted: Option<f64>,
    /// Whether the picture is that from the disk, to the bit.
    pub is_same: Option<bool>,
    /// A flight with nothing in memory when it begins, from the disk and over the link.
    pub disk: Summary,
    /// See `disk`.
    pub link: Summary,
    /// What passed for that over the link.
    pub link_passed: Counts,
    /// Random flight over a link that spoils answers, where it is asked for.
    pub faults: Option<Flown>,
    /// What was told, but for what random flight was.
    pub messages: Vec<String>,
}

/// What it took to read something.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Read {
    /// Seconds from opening the file.
    pub seconds: f64,
    /// Requests and bytes by then.
    #[serde(flatten)]
    pub passed: Counts,
}

/// A file that is served over a link.
struct Bench<'a> {
    path: &'a Path,
    /// Its name in URLs.
    name: String,
    options: flight::Options,
    link: Link,
}

/// The usual view over the link.
struct Usual {
    first_picture: Read,
    converged: Option<Read>,
    station: Station,
    messages: Vec<String>,
}

/// Measures a file, or generated cosmologies of all sizes, and prints what came of it to standard error.
///
/// # Errors
/// When a file cannot be built, served or read, or is none of particles.
pub fn measure(arguments: &super::Arguments) -> Result<Vec<Outcome>, Failure> {
    let sizes = if arguments.path.is_some() { &arguments.sizes[..1] } else { &arguments.sizes[..] };
    let outcome = |&particles: &u64| -> Result<Outcome, Failure> {
        let path = match &arguments.path {
            Some(path) => cache::page_file_of(path, &TerminalProgress::new())?,
            None => flight::generated(arguments.seed, particles, true)?,
        };
        let outcome = measure_file(arguments, &path)?;
        print(&outcome);
        Ok(outcome)
    };
    sizes.iter().map(outcome).collect()
}

fn measure_file(arguments: &super::Arguments, path: &Path) -> Result<Outcome, Failure> {
    let said = &arguments.remote;
    let options = flight::Options { size: Some(arguments.flight.size.unwrap_or(SIZE)), ..arguments.flight.clone() };
    let files = Files::of(path)?;
    let name = files.address();
    let listen = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let server = Server::bind(ServeOptions { listen, ..ServeOptions::default() }, Offer::Files(files))?.start()?;
    let link_with =
        |faults| Link::new(server.address(), Shape { rate: said.rate / 8.0, latency: said.latency, faults });
    // What is kept of other files makes no difference, and nothing of this one is left.
    let kept = tempfile::tempdir()?;
    cache::keep_apart(kept.path(), u64::MAX);
    keep_pages_from_afar(cache::for_pages_from_afar);

    let bench = Bench { path, name, options, link: link_with(None)? };
    let info = bench.info()?;
    let (local, wanted_bytes) = bench.usual_here()?;
    let Usual { first_picture, converged, station, mut messages } = bench.usual_afar()?;
    let beyond = |read: Read| read.passed.bytes as f64 - info.passed.bytes as f64 - wanted_bytes as f64;
    let is_comparable = local.converged.is_some() && converged.is_some();
    let (plan, disk) = bench.flight_here()?;
    let (link, link_passed) = bench.flight_afar(plan, &mut messages)?;
    let faults = match said.faults {
        true => {
            // Pages that made room are asked for again.
            cache::keep_apart(kept.path(), 0);
            let bad = link_with(Some(arguments.seed))?;
            let url = bad.url("faults", &bench.name);
            Some(random_flight::fly(path, &url, &bad, &bench.options, 60.0 * said.minutes, arguments.seed)?)
        }
        false => None,
    };
    let file = PageFile::open(path)?;
    Ok(Outcome {
        path: path.to_owned(),
        particles: file.metadata().particles(),
        bytes: file.bytes(),
        rate: said.rate,
        latency_s: said.latency.as_secs_f64(),
        info,
        first_picture,
        converged,
        wanted_bytes,
        above_wanted: converged.filter(|_| is_comparable).map(|read| beyond(read) / wanted_bytes.max(1) as f64),
        is_same: is_comparable.then(|| values(&local.picture) == values(&station.picture)),
        disk,
        link,
        link_passed,
        faults,
        messages,
    })
}

impl Bench<'_> {
    /// What has passed since then.
    fn since(&self, at: Instant, then: Counts) -> Read {
        Read { seconds: at.elapsed().as_secs_f64(), passed: self.link.counts().since(then) }
    }

    /// Opens the file and reads nothing of its pages.
    fn info(&self) -> Result<Read, Failure> {
        let (at, then) = (Instant::now(), self.link.counts());
        let url = self.link.url("info", &self.name);
        DataKind::of(&url)?;
        PageFile::open(&url)?;
        Ok(self.since(at, then))
    }

    /// The usual view from the disk, and the bytes of its pages.
    fn usual_here(&self) -> Result<(Station, u64), Failure> {
        flight::with_canvas("cpu", self.path, &self.options, |engine, opened| {
            engine.options.prefetch = false;
            let mut streamer = engine.streamer();
            let station = engine.converge(&mut streamer, &opened.view)?;
            let is_here = |page: &PageId| streamer.residency.page(*page).is_some();
            let pages = (0..engine.tree.page_count()).map(PageId).filter(is_here);
            Ok((station, pages.map(|page| engine.tree.page_bytes(page)).sum()))
        })
    }

    /// The usual view over the link.
    fn usual_afar(&self) -> Result<Usual, Failure> {
        let then = self.link.counts();
        flight::with_canvas("cpu", &self.link.url("view", &self.name), &self.options, |engine, opened| {
            let mut streamer = engine.streamer();
            show_all(engine, &mut streamer, opened)?;
            let first_picture = self.since(opened.at, then);
            let station = engine.converge(&mut streamer, &opened.view)?;
            let converged = station.converged.map(|_| self.since(opened.at, then));
            let messages = std::mem::take(&mut engine.messages);
            Ok(Usual { first_picture, converged, station, messages })
        })
    }

    /// A flight from the disk, and what its pictures leave undrawn.
    fn flight_here(&self) -> Result<(Plan, Summary), Failure> {
        flight::with_canvas("cpu", self.path, &self.options, |engine, opened| {
            let view = opened.flight.view(0.0, engine.size.0, engine.size.1)?;
            let mut streamer = engine.streamer();
            engine.prepare(&mut streamer, &view)?;
            drop(streamer);
            Ok((engine.plan, flown(engine, opened)?))
        })
    }

    /// The same flight over the link.
    fn flight_afar(&self, plan: Plan, messages: &mut Vec<String>) -> Result<(Summary, Counts), Failure> {
        let then = self.link.counts();
        flight::with_canvas("cpu", &self.link.url("flight", &self.name), &self.options, |engine, opened| {
            engine.plan = plan;
            let summary = flown(engine, opened)?;
            messages.append(&mut engine.messages);
            Ok((summary, self.link.counts().since(then)))
        })
    }
}

/// Flies with nothing in memory when it begins.
fn flown(engine: &mut Engine<'_>, opened: &Opened) -> Result<Summary, Failure> {
    let mut streamer = engine.streamer();
    Ok(Summary::of(&engine.fly(&mut streamer, &opened.flight, 0.0, opened.flight.seconds)?))
}

/// Draws frames of the usual view until there is something of every family in it.
fn show_all(engine: &mut Engine<'_>, streamer: &mut Streamer, opened: &Opened) -> Result<(), Failure> {
    let families = engine.tree.metadata().families.len();
    loop {
        let (frame, selection) = engine.frame(streamer, &opened.view, Haste::OnTheWay)?;
        let shown: HashSet<u32> = selection.nodes.iter().map(|node| node.page.family).collect();
        if shown.len() == families || frame.converged {
            return Ok(());
        }
        if !streamer.is_busy() {
            let why = engine.messages.first().map_or("found no root that can be read, expected one", String::as_str);
            return Err(format!("{}: {why}", engine.tree.path().display()).into());
        }
        streamer.wait(Duration::from_millis(5));
    }
}

/// Prints what a file came to to standard error.
fn print(outcome: &Outcome) {
    let Outcome { particles, bytes, info, first_picture, converged, wanted_bytes, .. } = outcome;
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    eprintln!(
        "{particles} particles, {:.3} GB, over {:.0} Mbit/s and {:.0} ms",
        *bytes as f64 / 1e9,
        outcome.rate / 1e6,
        1e3 * outcome.latency_s
    );
    let line = |name: &str, read: &Read| {
        let Counts { requests, bytes, .. } = read.passed;
        eprintln!("  {name}: {:.2} s, {requests} requests, {:.2} MB", read.seconds, megabytes(bytes));
    };
    line("info", info);
    line("first picture", first_picture);
    match converged {
        Some(read) => line("converged", read),
        None => eprintln!("  converged: never"),
    }
    let above = outcome.above_wanted.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share));
    let is_same = match outcome.is_same {
        Some(true) => "the same picture as from the disk",
        Some(false) => "ANOTHER PICTURE than from the disk",
        None => "not compared",
    };
    eprintln!("  pages of that view: {:.2} MB, read beyond them {above}, {is_same}", megabytes(*wanted_bytes));
    for (name, summary) in [("disk", &outcome.disk), ("link", &outcome.link)] {
        eprintln!(
            "  flight from the {name}: {} frames, {:.1} ms (50 %) {:.1} ms (99 %), streaming and selection {:.1} ms (99 %), not \
             converged {:.1} % (worst {:.2} px)",
            summary.frames,
            summary.frame_ms_p50,
            summary.frame_ms_p99,
            summary.streaming_ms_p99,
            100.0 * summary.not_converged,
            summary.worst_error_px
        );
    }
    if let Some(flown) = &outcome.faults {
        let resident: Vec<String> = flown.resident_bytes.iter().map(|bytes| (bytes >> 20).to_string()).collect();
        eprintln!(
            "  random flight of {:.0} s: {} frames, {} requests, {} of them spoilt; {} stops, {} not converged, {} with another picture; pages \
             took at most {} of {} MiB, the program {} MiB; {} messages",
            flown.seconds,
            flown.frames,
            flown.passed.requests,
            flown.passed.spoilt,
            flown.stops,
            flown.not_converged,
            flown.different,
            flown.most_bytes >> 20,
            flown.budget_bytes >> 20,
            if resident.is_empty() { "-".to_owned() } else { resident.join(", ") },
            flown.messages.len()
        );
        flown.messages.iter().take(3).for_each(|message| eprintln!("  {message}"));
    }
    outcome.messages.iter().for_each(|message| eprintln!("  {message}"));
}
