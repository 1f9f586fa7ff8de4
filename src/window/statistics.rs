//! Numbers of the running program: frames, what is drawn, what is resident.

use crate::gpu::Technique;
use crate::picture::field::PointsReport;
use bevy::prelude::*;
use serde::Serialize;
use std::collections::VecDeque;

/// What the last picture was made of.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Which renderer draws: `compute` or `cpu`.
    pub backend: String,
    /// The graphics adapter.
    pub adapter: String,
    /// Particles drawn.
    pub particles: u64,
    /// Particles that the sample of a picture in motion takes; none where all are drawn.
    pub sampled: Option<u64>,
    /// Which state of [`super::live::LiveParticles`] the picture shows; none where it shows the file.
    pub live: Option<u64>,
    /// Points that stand for the samples of an image or a volume, where that is drawn.
    pub points: Option<PointsReport>,
    /// Nodes drawn.
    pub nodes: usize,
    /// Which levels of the file are drawn: `splats`, `volume` or `clusters`; of an image or a volume `samples` or `wavelet`.
    pub levels: &'static str,
    /// Nodes that are left as they are because they are hidden.
    pub hidden: usize,
    /// Largest screen-space error of what is drawn, pixels.
    pub error_px: f64,
    /// Nodes that the view needs and that are not there yet.
    pub missing: usize,
    /// Pages in memory.
    pub pages_resident: usize,
    /// Pages on their way.
    pub pages_loading: usize,
    /// Pages that cannot be read.
    pub pages_failed: usize,
    /// Pages by where they stand.
    pub pages: PageCounts,
    /// Bytes of the resident pages.
    pub bytes: u64,
    /// Bytes that they may take.
    pub budget_bytes: u64,
    /// Bytes of the copies in the graphics adapter's memory, and how many they may be; none where there are no copies.
    pub copies: Option<[u64; 2]>,
    /// Time to draw the last picture, milliseconds, where it is known.
    pub draw_ms: Option<f64>,
    /// Its passes' times, milliseconds.
    pub passes: Vec<(&'static str, f64)>,
    /// Slabs of a volume that the adapter has drawn, and how many its picture has; none for other pictures.
    pub slabs: Option<[usize; 2]>,
    /// Bytes of the adapter's memory that volumes work in.
    pub work_bytes: u64,
}

/// How many pages stand where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PageCounts {
    /// Being read.
    pub reading: usize,
    /// In memory, where copies are drawn and there is none.
    pub in_memory: usize,
    /// On the way to the adapter.
    pub copying: usize,
    /// What can be drawn.
    pub drawable: usize,
    /// What cannot be read.
    pub failed: usize,
    /// Those in memory, copied or not, of which nothing shows.
    pub hidden: usize,
}

/// What draws the picture.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ActiveBackend {
    /// Background tasks on the processor.
    #[default]
    Cpu,
    /// Passes of the data camera.
    Gpu,
    /// Background tasks that draw an image or a volume.
    Field,
    /// Passes of the data camera that draw a volume.
    FieldOnGpu,
    /// Passes of the data camera that draw heights.
    SurfaceOnGpu(Technique),
    /// Background tasks that put pictures of all directions, and for two eyes, together.
    Surround,
}

impl ActiveBackend {
    /// Whether the data camera draws into the picture's image.
    pub fn is_on_adapter(self) -> bool {
        matches!(self, ActiveBackend::Gpu | ActiveBackend::FieldOnGpu | ActiveBackend::SurfaceOnGpu(_))
    }
}

/// Whether the picture shows all that the view needs at its error bound: every page is resident, uploaded and drawn.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Converged(pub bool);

/// Frame times, smoothed over about half a second.
#[derive(Resource, Clone, Debug, Default)]
pub struct FrameClock {
    smoothed_secs: f64,
    /// Milliseconds of the last frames, the latest last.
    recent: VecDeque<f32>,
}

impl FrameClock {
    /// Frames that are kept.
    pub const RECENT: usize = 120;

    /// Milliseconds of the last [`FrameClock::RECENT`] frames, the latest last.
    pub fn recent(&self) -> impl Iterator<Item = f32> {
        self.recent.iter().copied()
    }

    /// Frames per second; 0 before the first frame.
    pub fn fps(&self) -> f64 {
        if self.smoothed_secs > 0.0 { 1.0 / self.smoothed_secs } else { 0.0 }
    }

    /// Milliseconds per frame.
    pub fn milliseconds(&self) -> f64 {
        1000.0 * self.smoothed_secs
    }

    /// Takes in a frame of that duration.
    pub fn tick(&mut self, seconds: f64) {
        let weight = if self.smoothed_secs == 0.0 { 1.0 } else { 1.0 - (-seconds / 0.5).exp() };
        self.smoothed_secs += (seconds - self.smoothed_secs) * weight;
        if self.recent.len() == FrameClock::RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back((1e3 * seconds) as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_clock_settles_on_the_rate() {
        let mut clock = FrameClock::default();
        assert_eq!(clock.fps(), 0.0);
        for _ in 0..200 {
            clock.tick(1.0 / 60.0);
        }
        assert!((clock.fps() - 60.0).abs() < 1e-6);
        for _ in 0..200 {
            clock.tick(1.0 / 30.0);
        }
        assert!((clock.fps() - 30.0).abs() < 0.1);
    }
}
