//! `deepfield bench play`: a run while time goes on, forward, backward and in jumps, streamed as the window streams.

use super::flight::canvas::Canvas;
use super::flight::engine::{Engine, Haste};
use super::flight::series::{Frame, Summary};
use super::splat::Failure;
use crate::hierarchy::Purpose;
use crate::hierarchy::spacetime::Interpolation;
use crate::mode::{Depiction, Settings};
use crate::model::{Moment, ReadMethod};
use crate::store::run::RunTree;
use crate::store::{RunFile, Tree};
use crate::stream::{Streamer, first_frame};
use crate::view::View;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Seconds between two jumps.
const JUMP_SECS: f64 = 0.5;

/// What playing a run came to.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The run.
    pub path: PathBuf,
    /// Particles of the largest step.
    pub particles: u64,
    /// Steps.
    pub steps: usize,
    /// Bytes of the run.
    pub bytes: u64,
    /// What draws, and with what.
    pub backend: String,
    /// See `backend`.
    pub adapter: String,
    /// Seconds from opening the file until the first picture.
    pub first_picture_s: f64,
    /// The whole run in the duration, from its beginning to its end.
    pub forward: Played,
    /// From its end to its beginning.
    pub backward: Played,
    /// To another moment each half second, which nothing is known of before.
    pub jumping: Played,
}

/// What playing in one direction came to.
#[derive(Clone, Debug, Serialize)]
pub struct Played {
    /// The frames.
    #[serde(flatten)]
    pub frames: Summary,
    /// Frames that had nothing to draw of their moment.
    pub late_frames: u64,
    /// Tracks that a frame drew, clusters and particles, in the mean.
    pub tracks: f64,
}

/// Plays a run.
///
/// # Errors
/// When it cannot be read or has no tracks, or it cannot be drawn.
pub fn measure(arguments: &super::Arguments) -> Result<Vec<Outcome>, Failure> {
    let path = arguments.path.as_ref().ok_or("bench play: name a run, as `deepfield bench play run.df`")?;
    arguments.backends.iter().map(|backend| measure_with(backend, path, &arguments.flight)).collect()
}

/// Plays a run with one backend.
fn measure_with(backend: &str, path: &Path, options: &super::flight::Options) -> Result<Outcome, Failure> {
    let opening = Instant::now();
    let run = Arc::new(RunFile::open(path, ReadMethod::default())?);
    let tree = Arc::new(RunTree::new(Arc::clone(&run), Interpolation::Auto)?);
    let ends = [0, run.directory().steps.len() - 1].map(|step| tree.time(Moment { step, u: 0.0 }));
    let families: Vec<u32> = (0..tree.metadata().families.len() as u32).collect();
    let frame = first_frame(&*tree, &families, ends[0]);
    let size = options.picture_size();
    let view = View::around(frame, 45_f64.to_radians(), size.width, size.height)?;
    let view = View { time: ends[0], ..view };
    let depiction = Depiction::new(options.mode(), Settings::default(), None, tree.metadata())?;
    if depiction.mode.is_light() {
        return Err(format!("bench play: {} draws light; choose a mode of sums", depiction.mode.name).into());
    }
    let drawn = Arc::clone(&tree) as Arc<dyn Tree>;
    let until_now = opening.elapsed().as_secs_f64();
    // A program that runs has opened its adapter before it opens a file.
    let mut canvas: Box<dyn Canvas> = options.canvas(backend, &drawn, &depiction, &view)?;
    let mut engine = options.engine(drawn, depiction, (size.width, size.height), &mut *canvas);
    let mut streamer = engine.streamer();
    let first = engine.converge(&mut streamer, &view)?;
    engine.prepare(&mut streamer, &view)?;
    let [begin, end] = ends;
    let at = |seconds: f64| begin + (end - begin) * (seconds / options.duration).clamp(0.0, 1.0);
    let seconds = options.duration;
    let ahead = |at: &dyn Fn(f64) -> f64, now: f64, lead: f64| tree.next_intervals(at(now), at(now + lead));
    let forward = play(&mut engine, &mut streamer, &view, seconds, &at, &|now, lead| ahead(&at, now, lead))?;
    let back = |now: f64| at(seconds - now);
    let backward = play(&mut engine, &mut streamer, &view, seconds, &back, &|now, lead| ahead(&back, now, lead))?;
    // Far from each other, and from where they were before: multiples of the golden section.
    let jump = |now: f64| begin + (end - begin) * (0.618_034 * (1.0 + (now / JUMP_SECS).floor())).fract();
    let mut streamer = engine.streamer();
    let jumping = play(&mut engine, &mut streamer, &view, seconds, &jump, &|_, _| Vec::new())?;
    let (backend, adapter) = engine.canvas.name();
    let steps = &run.directory().steps;
    let outcome = Outcome {
        path: path.to_owned(),
        particles: steps.iter().map(|step| step.particles).max().unwrap_or(0),
        steps: steps.len(),
        bytes: run.bytes(),
        backend,
        adapter,
        first_picture_s: until_now + first.first_picture,
        forward,
        backward,
        jumping,
    };
    print(&outcome, &engine.messages);
    Ok(outcome)
}

/// Plays for so many seconds: `at` says which moment is shown then, and `next` which ones will be within so many seconds.
fn play(
    engine: &mut Engine,
    streamer: &mut Streamer,
    view: &View,
    seconds: f64,
    at: &dyn Fn(f64) -> f64,
    next: &dyn Fn(f64, f64) -> Vec<f64>,
) -> Result<Played, Failure> {
    let families = 0..engine.tree.metadata().families.len() as u32;
    let (mut frames, mut late_frames): (Vec<Frame>, u64) = (Vec::new(), 0);
    let start = Instant::now();
    loop {
        let now = start.elapsed().as_secs_f64();
        if now >= seconds {
            let tracks = frames.iter().map(|frame| frame.particles as f64).sum::<f64>() / frames.len().max(1) as f64;
            return Ok(Played { frames: Summary::of(&frames), late_frames, tracks });
        }
        let view = View { time: at(now), ..*view };
        let comes = |time| {
            let roots = streamer.roots(families.clone(), Purpose::Splats, time);
            (engine.depiction.selection_view(&View { time, ..view }), roots)
        };
        streamer.upcoming = next(now, streamer.lead_secs()).into_iter().map(comes).collect();
        let (frame, _) = engine.frame(streamer, &view, Haste::Moves(engine.frame_ms))?;
        late_frames += u64::from(frame.nodes == 0);
        frames.push(Frame { seconds: now, ..frame });
    }
}

/// Prints what it came to to standard error.
fn print(outcome: &Outcome, messages: &[String]) {
    let Outcome { particles, steps, backend, adapter, .. } = outcome;
    let gigabytes = outcome.bytes as f64 / 1e9;
    eprintln!("{particles} particles, {steps} steps, {gigabytes:.3} GB, {backend} on {adapter}");
    eprintln!("  first picture {:.2} s", outcome.first_picture_s);
    let ways = [("forward", &outcome.forward), ("backward", &outcome.backward), ("jumping", &outcome.jumping)];
    for (name, Played { frames, late_frames, tracks }) in ways {
        eprintln!(
            "  {name}: {:.1} frames/s, frame {:.1} ms (50 %) {:.1} ms (99 %), {:.2} M tracks/frame (samples of {:.0} %), memory {:.0} MiB, disk \
             {:.1} MB/s, not converged {:.1} % (worst {:.2} px), {late_frames} with nothing to draw",
            frames.frames_per_second,
            frames.frame_ms_p50,
            frames.frame_ms_p99,
            tracks / 1e6,
            100.0 * frames.sampled,
            frames.main_mib,
            frames.disk_mb_per_s,
            100.0 * frames.not_converged,
            frames.worst_error_px,
        );
    }
    messages.iter().for_each(|message| eprintln!("  {message}"));
}
