//! Draws one view without a window, until its picture is complete, and reads it back.

use super::device::{DeviceOptions, GpuError};
use super::mode_view::ModeView;
use super::parts::Parts;
use super::renderer::HeadlessRenderer;
use super::scene::{NodeUpload, Payload, Table};
use super::timing::{MeasuredPasses, median};
use super::view::{Backend, Footprint};
use crate::color::Accumulation;
use crate::color::composite::{self, Image as Picture};
use crate::color::transfer::TransferFunction;
use crate::cpu::overdraw::Overdraw;
use crate::mode::sample::Sample;
use crate::model::Kernel;
use crate::view::{Extent, View};
use bevy::math::DVec3;
use bevy::prelude::Bundle;

/// One node to draw.
#[derive(Clone, Debug)]
pub struct HeadlessNode {
    /// Its particles. Those of the same id are the same: images of a node.
    pub upload: NodeUpload,
    /// Index into [`HeadlessRequest::tables`]; `None` for raw particles.
    pub table: Option<usize>,
    /// Factor on every weight.
    pub weight_scale: f32,
    /// By how much its image is displaced, world units; packed nodes only.
    pub offset: DVec3,
    /// Which of its particles are drawn.
    pub sample: Sample,
    /// Which of its clusters are drawn; see [`super::DrawItem::limit`].
    pub limit: u16,
    /// How far its particles reach, displaced as its image is.
    pub reach: Extent,
}

/// What to draw, and how.
#[derive(Clone, Debug)]
pub struct HeadlessRequest {
    /// The camera and the picture's size.
    pub view: View,
    /// The mode, for those that bring passes of their own.
    pub mode: Option<ModeView>,
    /// The particles' shape.
    pub footprint: Footprint,
    /// How they are accumulated.
    pub backend: Backend,
    /// Whether particles outside the picture are dropped at once.
    pub culling: bool,
    /// Particles that add less than this to every pixel's `P` are dropped; 0: none.
    pub faintest: f32,
    /// The particles.
    pub nodes: Vec<HeadlessNode>,
    /// Attribute tables of packed nodes.
    pub tables: Vec<Table>,
    /// Whether the `S` channel is wanted.
    pub attribute: bool,
    /// Colours; `None`: only the accumulation.
    pub transfer: Option<TransferFunction>,
    /// How often the complete picture is drawn, for times; at least once.
    pub repeat: u32,
    /// Limits and the like.
    pub device: DeviceOptions,
}

impl HeadlessRequest {
    /// A picture of no particles, for passes that draw something else.
    pub fn without_particles(view: &View, attribute: bool) -> HeadlessRequest {
        HeadlessRequest {
            view: *view,
            mode: None,
            footprint: Footprint::Kernel(Kernel::default()),
            backend: Backend::Compute,
            culling: false,
            faintest: 0.0,
            nodes: Vec::new(),
            tables: Vec::new(),
            attribute,
            transfer: None,
            repeat: 1,
            device: DeviceOptions::default(),
        }
    }

    /// Whether some of the particles are in the space of one camera.
    pub fn has_own_particles(&self) -> bool {
        self.nodes.iter().any(|node| matches!(node.upload.payload, Payload::Camera(_)))
    }
}

/// The complete picture.
#[derive(Clone, Debug)]
pub struct HeadlessFrame {
    /// `P` and `P S`.
    pub accumulation: Accumulation,
    /// Colours, if they were asked for.
    pub picture: Option<Picture>,
    /// Numbers.
    pub stats: HeadlessStats,
}

/// Numbers about a picture.
#[derive(Clone, Debug, Default)]
pub struct HeadlessStats {
    /// The adapter's name and driver.
    pub adapter: String,
    /// `compute` or `raster`.
    pub backend: &'static str,
    /// Particles that were looked at.
    pub particles: u64,
    /// Splats that reach the picture, where the technique counts them and there are no parts.
    pub splats: Option<u64>,
    /// Median milliseconds of each GPU pass, where the adapter can tell; of a part where there are parts.
    pub passes: MeasuredPasses,
    /// Median milliseconds from the start of a frame to the end of all its GPU work.
    pub frame: f64,
}

/// Draws one view, in parts where the adapter cannot hold all of it.
///
/// # Errors
/// [`GpuError`]: no adapter, one that cannot carry the backend out, a shader that does not compile on it, too little memory.
pub fn render_headless(request: HeadlessRequest) -> Result<HeadlessFrame, GpuError> {
    render(&mut HeadlessRenderer::bare(&request.device, request.backend)?, request)
}

/// The same with an adapter that is open.
///
/// # Errors
/// As [`render_headless`].
pub fn render(renderer: &mut HeadlessRenderer, request: HeadlessRequest) -> Result<HeadlessFrame, GpuError> {
    render_with(renderer, request, ())
}

/// The same where the camera has components of other passes that fill its cells.
///
/// # Errors
/// As [`render_headless`].
pub fn render_with(
    renderer: &mut HeadlessRenderer,
    mut request: HeadlessRequest,
    components: impl Bundle,
) -> Result<HeadlessFrame, GpuError> {
    let whole = request.view;
    let parts = parts_of(renderer, &request)?;
    request.view = parts.view(&whole, 0);
    renderer.load(&request)?;
    renderer.insert(components);
    renderer.complete()?;
    let (mut frames, passes) = renderer.measure(request.repeat)?;
    let (mut accumulation, mut splats) = renderer.accumulation(request.attribute)?;
    if parts.count() > 1 {
        let first =
            std::mem::replace(&mut accumulation, Accumulation::new(whole.width, whole.height, request.attribute));
        parts.join(&mut accumulation, &first, 0);
        // Splats on an edge were counted in both parts.
        splats = None;
        for index in 1..parts.count() {
            renderer.look(parts.view(&whole, index));
            renderer.complete()?;
            let (times, _) = renderer.measure(request.repeat)?;
            frames.iter_mut().zip(times).for_each(|(frame, time)| *frame += time);
            parts.join(&mut accumulation, &renderer.accumulation(request.attribute)?.0, index);
        }
    }
    let picture = match &request.transfer {
        Some(transfer) if parts.count() > 1 => Some(composite::composite(&accumulation, transfer)),
        Some(transfer) => Some(renderer.colors(transfer, &accumulation)?),
        None => None,
    };
    let stats = HeadlessStats {
        adapter: renderer.adapter().to_owned(),
        backend: renderer.technique().name(),
        particles: renderer.particles(),
        splats,
        passes,
        frame: median(&mut frames),
    };
    Ok(HeadlessFrame { accumulation, picture, stats })
}

/// Counts the splats over each pixel of a view with an adapter that is open, in parts as [`render`] draws them.
///
/// # Errors
/// As [`render_headless`].
pub fn overdraw(renderer: &mut HeadlessRenderer, mut request: HeadlessRequest) -> Result<Overdraw, GpuError> {
    let whole = request.view;
    let parts = parts_of(renderer, &request)?;
    request.view = parts.view(&whole, 0);
    // Passes of a mode have nothing to do.
    request.mode = None;
    renderer.load(&request)?;
    let first = renderer.overdraw()?;
    if parts.count() == 1 {
        return Ok(first);
    }
    let [width, height] = [whole.width, whole.height];
    let mut counts = vec![0; width as usize * height as usize];
    parts.join_values(&mut counts, &first.counts, 0);
    for index in 1..parts.count() {
        renderer.look(parts.view(&whole, index));
        parts.join_values(&mut counts, &renderer.overdraw()?.counts, index);
    }
    Ok(Overdraw { width, height, counts })
}

/// The parts that a request's picture is drawn in.
fn parts_of(renderer: &HeadlessRenderer, request: &HeadlessRequest) -> Result<Parts, GpuError> {
    let View { width, height, .. } = request.view;
    Parts::of(&request.view, request.footprint, renderer.technique(), &renderer.device().0.limits())
        .ok_or_else(|| GpuError::NoRoom(format!("{width}x{height} pixels")))
}
