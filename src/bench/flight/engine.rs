//! Flying: frames are drawn as fast as they come, while pages stream in beside them.

use super::super::splat::Failure;
use super::canvas::Canvas;
use super::path::Flight;
use super::series::Frame;
use crate::color::transfer::TransferFunction;
use crate::mode::{Depiction, LodBudget, Plan, Raw};
use crate::picture::Subject;
use crate::picture::drawing_cost::{self, DrawingCost, SampleSizes};
use crate::picture::splat_budget::SplatBudget;
use crate::picture::stand_in::{StandIn, Wanted};
use crate::store::Tree;
use crate::stream::{Scene, SceneSelection, StreamOptions, Streamer};
use crate::view::View;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is flown with.
pub struct Engine<'a> {
    /// What is flown through.
    pub tree: Arc<dyn Tree>,
    /// What is shown of it.
    pub depiction: Depiction,
    /// The screen-space error, pixels.
    pub tau: f64,
    /// Picture size, pixels.
    pub size: (u32, u32),
    /// How pages are streamed.
    pub options: StreamOptions,
    /// What pictures may leave undrawn, and what that comes to; see [`Engine::prepare`].
    pub lod_budget: LodBudget,
    /// See `lod_budget`.
    pub plan: Plan,
    /// Milliseconds that a frame of a flight may take to draw; none: as long as it needs.
    pub frame_ms: Option<f64>,
    /// What drawing has cost so far.
    pub drawing_cost: DrawingCost,
    /// How many splats of clusters there is time for.
    pub splat_budget: SplatBudget,
    /// What stands in for what there is no time for.
    pub stand_in: StandIn,
    /// Milliseconds that a frame's selection takes, smoothed.
    pub selecting_ms: f64,
    /// The backend that draws.
    pub canvas: &'a mut dyn Canvas,
    /// What there is to tell about pages that cannot be read.
    pub messages: Vec<String>,
}

/// How much time a frame has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Haste {
    /// The view moves, and a frame has so many milliseconds, if that is limited.
    Moves(Option<f64>),
    /// The view rests, and this is a picture on the way to the converged one.
    OnTheWay,
    /// The view rests, and everything that is there is drawn.
    Rests,
}

impl Haste {
    fn frame_ms(self) -> Option<f64> {
        match self {
            Haste::Moves(frame_ms) => frame_ms,
            Haste::OnTheWay => Some(ON_THE_WAY_MS),
            Haste::Rests => None,
        }
    }
}

/// A view that has converged.
pub struct Station {
    /// Seconds until something was drawn.
    pub first_picture: f64,
    /// Seconds until everything was.
    pub converged: Option<f64>,
    /// The picture.
    pub picture: Raw,
    /// What it shows.
    pub selection: SceneSelection,
}

/// Time after which a view that does not converge is taken as it is.
const PATIENCE: Duration = Duration::from_secs(120);
/// Milliseconds that a picture on the way to the converged one may take, as the window's pictures may.
const ON_THE_WAY_MS: f64 = 50.0;

impl Engine<'_> {
    /// Nothing is in memory yet.
    pub fn streamer(&self) -> Streamer {
        let mut streamer = Streamer::new(Arc::clone(&self.tree), self.options);
        streamer.keep_copies(self.canvas.copies());
        streamer
    }

    /// Streams and draws one frame, as much of it as there is time for; never waits for a page.
    ///
    /// # Errors
    /// What the canvas reports.
    pub fn frame(
        &mut self,
        streamer: &mut Streamer,
        view: &View,
        haste: Haste,
    ) -> Result<(Frame, SceneSelection), Failure> {
        let start = Instant::now();
        let arrivals = streamer.arrive();
        self.messages.extend(arrivals.messages);
        let copied = streamer.copies.as_ref().map_or(0, |copies| copies.copied_bytes());
        self.canvas.receive(streamer);
        let copied = streamer.copies.as_ref().map_or(0, |copies| copies.copied_bytes()) - copied;
        let (selection, stands_in) = self.select(streamer, view, haste);
        streamer.serve();
        streamer.take_evicted();
        self.canvas.copy(streamer);
        let (plan, taken) = match stands_in {
            true => (self.everything(), selection.particles),
            false => self.governed(view, &selection, haste.frame_ms()),
        };
        let streamed = start.elapsed();
        self.canvas.draw(view, &selection.nodes, &plan)?;
        let drawing_ms = 1e3 * (start.elapsed() - streamed).as_secs_f64();
        let streaming_ms = 1e3 * streamed.as_secs_f64();
        match stands_in {
            true => self.splat_budget.drew(taken, drawing_ms),
            false => self.drawing_cost.drew(taken, drawing_ms),
        }
        self.selecting_ms += 0.5 * (streaming_ms - self.selecting_ms);
        let frame = Frame {
            seconds: 0.0,
            frame_ms: 1e3 * start.elapsed().as_secs_f64(),
            streaming_ms,
            main_bytes: streamer.residency.statistics().bytes,
            disk_bytes: arrivals.bytes,
            gpu_bytes: streamer.copies.as_ref().map_or(0, |copies| copies.bytes()),
            upload_bytes: copied,
            particles: selection.particles,
            taken,
            nodes: selection.nodes.len() as u64,
            missing: selection.missing as u64,
            converged: selection.converged && (!stands_in || haste != Haste::OnTheWay),
            error_px: selection.error_pixels,
            prefetch_distance: streamer.prefetch_distance(),
        };
        Ok((frame, selection))
    }

    /// What a frame draws, and whether that is clusters in place of what there is no time for.
    pub fn select(&mut self, streamer: &mut Streamer, view: &View, haste: Haste) -> (SceneSelection, bool) {
        let families: Vec<u32> = (0..self.tree.metadata().families.len() as u32).collect();
        let in_time = |frame_ms: f64| self.splat_budget.limit((frame_ms - self.selecting_ms).max(0.1 * frame_ms));
        let (moves, splats) = (matches!(haste, Haste::Moves(_)), haste.frame_ms().map(in_time));
        let wanted = Wanted { depiction: &self.depiction, tau: self.tau, families: &families, moves, splats };
        let chosen = self.stand_in.select(streamer, view, &wanted);
        (SceneSelection::of(streamer, view, chosen.detail, &chosen.selection), chosen.stands_in)
    }

    /// What a frame of a view that moves draws once all of it is there, and whether that is clusters.
    ///
    /// # Errors
    /// What the backend reports.
    pub fn in_motion(&mut self, streamer: &mut Streamer, view: &View) -> Result<(SceneSelection, bool), Failure> {
        let start = Instant::now();
        loop {
            self.canvas.receive(streamer);
            let (selection, stands_in) = self.select(streamer, view, Haste::Moves(self.frame_ms));
            streamer.serve();
            streamer.take_evicted();
            self.canvas.copy(streamer);
            if selection.converged || !streamer.is_busy() || start.elapsed() > PATIENCE {
                return Ok((selection, stands_in));
            }
            if streamer.copies.is_some() {
                // Copies are made while pictures are drawn.
                self.canvas.draw(view, &selection.nodes, &self.everything())?;
            }
            streamer.wait(Duration::from_millis(5));
            self.messages.extend(streamer.arrive().messages);
        }
    }

    /// Of a selection everything is drawn.
    pub fn everything(&self) -> Plan {
        Plan { culling: self.plan.culling, ..Plan::default() }
    }

    /// What of a selection is drawn in so many milliseconds, and how many particles that takes (see [`drawing_cost::within`]).
    pub fn governed(&self, view: &View, selection: &SceneSelection, frame_ms: Option<f64>) -> (Plan, u64) {
        let metadata = self.tree.metadata();
        let important = drawing_cost::most_important(&self.depiction, metadata);
        let limit = frame_ms.map_or(u64::MAX, |frame_ms| self.drawing_cost.limit(frame_ms, SampleSizes::default()));
        drawing_cost::within(limit, self.plan, view, &self.depiction, metadata, &selection.nodes, &important)
    }

    /// Converges the view that a flight begins with, and finds there what its pictures leave undrawn.
    ///
    /// # Errors
    /// What the canvas reports.
    pub fn prepare(&mut self, streamer: &mut Streamer, view: &View) -> Result<(), Failure> {
        self.plan = Plan::default();
        let selection = self.converge(streamer, view)?.selection;
        let preset = self.depiction.mode.transfer[usize::from(self.depiction.attribute.is_some())];
        let transfer = TransferFunction::preset(preset).unwrap_or_default();
        // Sums have no use for a diameter.
        let subject = Subject::new(self.tree.metadata(), &self.depiction, &transfer, 0.0);
        self.plan = subject.plan(view, &selection.nodes, &self.lod_budget, None)?;
        Ok(())
    }

    /// Draws frames of a view that rests until everything is there: small samples on the way, as the window does, and
    /// the whole picture at the end.
    ///
    /// # Errors
    /// What the canvas reports.
    pub fn converge(&mut self, streamer: &mut Streamer, view: &View) -> Result<Station, Failure> {
        let start = Instant::now();
        let mut first_picture = None;
        loop {
            let (frame, selection) = self.frame(streamer, view, Haste::OnTheWay)?;
            if first_picture.is_none() && !selection.nodes.is_empty() {
                first_picture = Some(start.elapsed().as_secs_f64());
            }
            let is_full = streamer.copies.as_ref().is_some_and(|copies| copies.is_full());
            let is_stuck = !streamer.is_busy() && (streamer.uncopied().is_empty() || is_full);
            if frame.converged || is_stuck || start.elapsed() > PATIENCE {
                let (frame, selection) = self.frame(streamer, view, Haste::Rests)?;
                let seconds = start.elapsed().as_secs_f64();
                return Ok(Station {
                    first_picture: first_picture.unwrap_or(seconds),
                    converged: frame.converged.then_some(seconds),
                    picture: self.canvas.picture()?,
                    selection,
                });
            }
            if selection.nodes.is_empty() {
                streamer.wait(Duration::from_millis(5));
            }
        }
    }

    /// Flies from one second of the flight to another in real time, and says what every frame was made of.
    ///
    /// # Errors
    /// What the canvas reports.
    pub fn fly(&mut self, streamer: &mut Streamer, flight: &Flight, from: f64, to: f64) -> Result<Vec<Frame>, Failure> {
        let mut frames = Vec::new();
        let start = Instant::now();
        loop {
            let seconds = from + start.elapsed().as_secs_f64();
            if seconds >= to {
                return Ok(frames);
            }
            let view = flight.view(seconds, self.size.0, self.size.1)?;
            let (frame, _) = self.frame(streamer, &view, Haste::Moves(self.frame_ms))?;
            frames.push(Frame { seconds, ..frame });
        }
    }

    /// The picture of a view for which every page is waited for, with nothing in memory before.
    ///
    /// # Errors
    /// A root that cannot be read; what the canvas reports.
    pub fn waited(&mut self, view: &View) -> Result<Raw, Failure> {
        let mut scene = Scene::new(Arc::clone(&self.tree), u64::MAX);
        let metadata = self.tree.metadata();
        scene.purpose = self.depiction.purpose(metadata);
        let detail = self.depiction.detail(view, self.tau, metadata);
        scene.converge(&self.depiction.selection_view(view), detail, &mut |_| {})?;
        // The canvas may need copies, so frames are drawn until it has them.
        let mut streamer = scene.streamer;
        streamer.keep_copies(self.canvas.copies());
        Ok(self.converge(&mut streamer, view)?.picture)
    }
}
