//! Times of passes, measured by the adapter.
//!
//! Each span of commands takes two timestamps, and those of a frame are read back together when the frame is done. Of every frame that
//! is measured the times arrive, however many are on their way. (Bevy's own diagnostics keep one frame: of two that are done at once,
//! one is lost.)

use super::answer::Answer;
use bevy::prelude::*;
use bevy::render::render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder};
use bevy::render::renderer::{PendingCommandBuffers, RenderDevice, RenderGraph, RenderGraphSystems, RenderQueue};
use bevy::render::{GpuResourceAppExt, Render, RenderApp, RenderSystems};
use std::collections::VecDeque;
use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::Poll;
use std::time::Instant;
use wgpu::{CommandEncoderDescriptor, Features, QuerySet, QuerySetDescriptor, QueryType};

/// Most spans of a frame that are measured; those beyond have no time.
const MOST_SPANS: usize = 2048;
/// Most frames whose times wait to be taken; the oldest ones are forgotten.
const MOST_FRAMES: usize = 64;
/// Bytes of the two timestamps of a span.
const STAMPS: u64 = 16;

/// Measures spans of commands (render world).
#[derive(Resource)]
pub struct PassTimer {
    stamps: Option<Stamps>,
    /// Spans of this frame.
    spans: Mutex<Vec<Recorded>>,
    times: PassTimes,
}

/// Where an adapter that can tell leaves its times.
struct Stamps {
    queries: QuerySet,
    resolved: Buffer,
    /// Nanoseconds of a tick.
    period: f64,
}

/// A span of this frame: its name, and the milliseconds in which its commands were written.
type Recorded = (&'static str, f64);

/// A span that has begun. One that is not ended has no time.
#[must_use]
pub struct Span<'a> {
    timer: &'a PassTimer,
    number: usize,
    start: Instant,
}

impl PassTimer {
    /// Begins a span of this name; a frame may have several, which count as one.
    pub fn begin(&self, name: &'static str, encoder: &mut CommandEncoder) -> Span<'_> {
        let mut spans = lock(&self.spans);
        let number = spans.len();
        if number < MOST_SPANS {
            spans.push((name, 0.0));
        }
        let span = Span { timer: self, number, start: Instant::now() };
        span.stamp(0, encoder);
        span
    }
}

impl Span<'_> {
    /// Ends the span.
    pub fn end(self, encoder: &mut CommandEncoder) {
        self.stamp(1, encoder);
        if let Some((_, milliseconds)) = lock(&self.timer.spans).get_mut(self.number) {
            *milliseconds = 1e3 * self.start.elapsed().as_secs_f64();
        }
    }

    fn stamp(&self, which: u32, encoder: &mut CommandEncoder) {
        if let Some(stamps) = self.timer.stamps.as_ref().filter(|_| self.number < MOST_SPANS) {
            encoder.write_timestamp(&stamps.queries, 2 * self.number as u32 + which);
        }
    }
}

/// Milliseconds of the passes of one frame, each by its name.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTimes(pub Vec<(&'static str, f64)>);

impl FrameTimes {
    fn of(spans: impl Iterator<Item = Recorded>) -> FrameTimes {
        let mut passes: Vec<Recorded> = Vec::new();
        for (name, milliseconds) in spans {
            match passes.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => *sum += milliseconds,
                None => passes.push((name, milliseconds)),
            }
        }
        FrameTimes(passes)
    }
}

/// The times of frames that have been drawn, from the render world to the main world. Clones share it.
#[derive(Resource, Clone, Default)]
pub struct PassTimes(Arc<Mutex<VecDeque<Frame>>>);

/// A frame whose times are known, or on their way.
struct Frame {
    spans: Vec<Recorded>,
    /// The timestamps and the nanoseconds of their ticks, where the adapter tells.
    stamps: Option<(Answer, f64)>,
}

impl PassTimes {
    /// The times of all frames that are done and have not been taken, the oldest first: the adapter's, or what it took to write the
    /// commands where the adapter does not tell.
    pub fn take(&self) -> Vec<FrameTimes> {
        let mut waiting = lock(&self.0);
        let mut done = Vec::new();
        while let Some(frame) = waiting.front() {
            let spans = frame.spans.iter().copied();
            match frame.stamps.as_ref().map(|(answer, period)| (answer.take(), period)) {
                None => done.push(FrameTimes::of(spans)),
                Some((Poll::Ready(Some(bytes)), period)) => {
                    let (words, _) = bytes.as_chunks::<8>();
                    let (pairs, _) = words.as_chunks::<2>();
                    let measured = spans.zip(pairs).map(|((name, _), pair)| {
                        let [start, end] = pair.map(u64::from_le_bytes);
                        (name, 1e-6 * period * end.saturating_sub(start) as f64)
                    });
                    done.push(FrameTimes::of(measured));
                }
                Some((Poll::Ready(None), _)) => {}
                Some((Poll::Pending, _)) => break,
            }
            waiting.pop_front();
        }
        done
    }
}

/// Milliseconds of each pass in several frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredPasses(Vec<(&'static str, Vec<f64>)>);

impl MeasuredPasses {
    /// Adds frames.
    pub fn add(&mut self, frames: Vec<FrameTimes>) {
        for (name, milliseconds) in frames.into_iter().flat_map(|frame| frame.0) {
            match self.0.iter_mut().find(|(known, _)| *known == name) {
                Some((_, times)) => times.push(milliseconds),
                None => self.0.push((name, vec![milliseconds])),
            }
        }
    }

    /// Median milliseconds of each pass that was measured.
    pub fn medians(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(pass, times)| (*pass, median(&mut times.clone())))
    }
}

/// The median; 0 of nothing.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n => 0.5 * (values[(n - 1) / 2] + values[n / 2]),
    }
}

/// Adds [`PassTimer`] and [`PassTimes`].
pub struct TimingPlugin;

impl Plugin for TimingPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<PassTimes>();
    }

    fn finish(&self, app: &mut App) {
        let times = app.world().resource::<PassTimes>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .insert_resource(times)
            .init_gpu_resource::<PassTimer>()
            .add_systems(RenderGraph, read_back.after(RenderGraphSystems::Render).before(RenderGraphSystems::Submit))
            .add_systems(Render, ask_for_times.in_set(RenderSystems::Cleanup));
    }
}

impl FromWorld for PassTimer {
    fn from_world(world: &mut World) -> PassTimer {
        let stamps = Stamps::new(world.resource(), world.resource());
        PassTimer { stamps, spans: Mutex::default(), times: world.resource::<PassTimes>().clone() }
    }
}

impl Stamps {
    fn new(device: &RenderDevice, queue: &RenderQueue) -> Option<Stamps> {
        if !device.features().contains(Features::TIMESTAMP_QUERY | Features::TIMESTAMP_QUERY_INSIDE_ENCODERS) {
            return None;
        }
        let queries = device.wgpu_device().create_query_set(&QuerySetDescriptor {
            label: Some("deepfield times"),
            ty: QueryType::Timestamp,
            count: 2 * MOST_SPANS as u32,
        });
        let resolved = device.create_buffer(&BufferDescriptor {
            label: Some("deepfield times"),
            size: STAMPS * MOST_SPANS as u64,
            usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Some(Stamps { queries, resolved, period: f64::from(queue.get_timestamp_period()) })
    }
}

/// Has the times of this frame copied to where they are read. The next frame's passes overwrite them after that.
fn read_back(timer: Res<PassTimer>, device: Res<RenderDevice>, mut pending: ResMut<PendingCommandBuffers>) {
    let spans = mem::take(&mut *lock(&timer.spans));
    if spans.is_empty() {
        return;
    }
    let stamps = timer.stamps.as_ref().map(|stamps| {
        let answer = Answer::new(STAMPS * spans.len() as u64, "deepfield times that are read", &device);
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
        encoder.resolve_query_set(&stamps.queries, 0..2 * spans.len() as u32, &stamps.resolved, 0);
        encoder.copy_buffer_to_buffer(&stamps.resolved, 0, answer.buffer(), 0, answer.buffer().size());
        pending.push_encoder(encoder);
        answer.copied();
        (answer, stamps.period)
    });
    let mut waiting = lock(&timer.times.0);
    waiting.push_back(Frame { spans, stamps });
    if waiting.len() > MOST_FRAMES {
        waiting.pop_front();
    }
}

/// Asks for the times of frames that have been submitted.
fn ask_for_times(timer: Res<PassTimer>) {
    lock(&timer.times.0).iter().filter_map(|frame| frame.stamps.as_ref()).for_each(|(answer, _)| answer.ask());
}

/// What is locked is changed by single pushes and pops: whoever panicked left something consistent.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_of_a_frame_count_as_one_and_frames_are_taken_once() {
        let times = PassTimes::default();
        let frame = |spans: &[Recorded]| lock(&times.0).push_back(Frame { spans: spans.to_vec(), stamps: None });
        frame(&[("list", 1.0), ("blend", 7.0), ("list", 2.0)]);
        frame(&[("list", 5.0), ("list", 0.5), ("list", 0.5)]);
        let mut measured = MeasuredPasses::default();
        measured.add(times.take());
        measured.add(times.take());
        frame(&[("list", 4.0)]);
        measured.add(times.take());
        assert_eq!(measured.0, [("list", vec![3.0, 6.0, 4.0]), ("blend", vec![7.0])]);
        assert_eq!(measured.medians().collect::<Vec<_>>(), [("list", 4.0), ("blend", 7.0)]);
    }
}
