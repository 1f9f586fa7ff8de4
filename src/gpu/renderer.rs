//! A Bevy application without a window that is driven by hand: it holds the particles of one request on the adapter and
//! draws them as often as asked.

use super::DeepfieldRenderPlugins;
use super::capabilities::Technique;
use super::device::{Gpu, GpuError, open};
use super::headless::HeadlessRequest;
use super::readback::{read_buffer, read_texture};
use super::scene::{NodeState, ParticleScene};
use super::splat::{Bindings, SplatBuffers, pipeline_error};
use super::timing::PassTimes;
use super::view::{Composite, DrawItem, SplatView};
use crate::color::Accumulation;
use crate::color::composite::Image as Picture;
use crate::color::transfer::TransferFunction;
use crate::view::View;
use bevy::asset::RenderAssetUsages;
use bevy::camera::RenderTarget;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::log::LogPlugin;
use bevy::prelude::*;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_asset::RenderAssets;
use bevy::render::render_resource::{
    Extent3d, PipelineCache, PollType, TextureDimension, TextureFormat, TextureUsages,
};
use bevy::render::renderer::RenderDevice;
use bevy::render::texture::GpuImage;
use bevy::render::{RenderApp, RenderPlugin};
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use std::collections::HashSet;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Most frames and time that a picture may take to complete: shaders are compiled in it.
const PATIENCE: Duration = Duration::from_secs(300);

/// The application that draws.
pub struct HeadlessRenderer {
    app: App,
    camera: Entity,
    target: Handle<Image>,
    adapter: String,
    technique: Technique,
    particles: u64,
    size: UVec2,
}

impl HeadlessRenderer {
    /// Opens the adapter and uploads the particles.
    ///
    /// # Errors
    /// [`GpuError`]: no adapter, one that cannot carry the backend out, or too little memory.
    pub fn open(request: &HeadlessRequest) -> Result<HeadlessRenderer, GpuError> {
        let gpu = open(&request.device)?;
        let technique = gpu.technique(request.backend)?;
        HeadlessRenderer::new(gpu, technique, request)
    }

    /// Uploads the particles to an open adapter, which can hold all of the view.
    ///
    /// # Errors
    /// [`GpuError`]: too little memory.
    pub fn new(gpu: Gpu, technique: Technique, request: &HeadlessRequest) -> Result<HeadlessRenderer, GpuError> {
        let bytes: u64 = request.nodes.iter().map(|node| node.upload.payload.bytes()).sum();
        // Fragments at the end of chunks are lost; twice the bytes always suffices.
        let scene = ParticleScene::new((2 * bytes).max(64 << 20), u64::MAX);
        let mut app = App::new();
        app.add_plugins(
            DefaultPlugins
                .set(WindowPlugin {
                    primary_window: None,
                    exit_condition: ExitCondition::DontExit,
                    ..WindowPlugin::default()
                })
                .set(RenderPlugin {
                    render_creation: gpu.creation,
                    synchronous_pipeline_compilation: true,
                    ..RenderPlugin::default()
                })
                .disable::<WinitPlugin>()
                .disable::<LogPlugin>()
                .disable::<PipelinedRenderingPlugin>(),
        );
        app.insert_resource(scene.clone()).insert_resource(request.device.withheld).add_plugins(DeepfieldRenderPlugins);

        let tables: Vec<_> = request.tables.iter().map(|table| scene.insert_table(table.clone())).collect();
        let items = request
            .nodes
            .iter()
            .map(|node| DrawItem {
                node: node.upload.id,
                table: node.table.and_then(|table| tables.get(table).copied()),
                weight_scale: node.weight_scale,
                offset: node.offset,
                sample: node.sample,
            })
            .collect();
        let mut known = HashSet::new();
        let first = request.nodes.iter().filter(|node| known.insert(node.upload.id));
        scene.insert_nodes(first.map(|node| node.upload.clone()));

        let size = UVec2::new(request.view.width, request.view.height);
        let mut target = Image::new_uninit(
            Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
            TextureDimension::D2,
            // Encoded colours: what the composite writes arrives unchanged.
            TextureFormat::Rgba8Unorm,
            RenderAssetUsages::RENDER_WORLD,
        );
        target.texture_descriptor.usage |=
            TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING;
        let target = app.world_mut().resource_mut::<Assets<Image>>().add(target);
        let camera = app
            .world_mut()
            .spawn((
                Camera3d::default(),
                Camera { clear_color: ClearColorConfig::Custom(Color::BLACK), ..Camera::default() },
                RenderTarget::Image(target.clone().into()),
                Msaa::Off,
                Tonemapping::None,
                SplatView {
                    view: request.view,
                    footprint: request.footprint,
                    backend: request.backend,
                    culling: request.culling,
                    faintest: request.faintest,
                    items,
                    always: false,
                },
            ))
            .id();
        if let Some(mode) = &request.mode {
            app.world_mut().entity_mut(camera).insert(mode.clone());
        }
        app.finish();
        app.cleanup();
        let mut renderer =
            HeadlessRenderer { app, camera, target, adapter: gpu.adapter, technique, particles: 0, size };
        renderer.particles = request.nodes.iter().map(|node| node.upload.payload.len() as u64).sum();
        renderer.upload(&scene, request, bytes)?;
        Ok(renderer)
    }

    /// The adapter's name and driver.
    pub fn adapter(&self) -> &str {
        &self.adapter
    }

    /// The technique that draws.
    pub fn technique(&self) -> Technique {
        self.technique
    }

    /// Particles on the adapter.
    pub fn particles(&self) -> u64 {
        self.particles
    }

    /// The particles that may be drawn.
    pub fn scene(&self) -> &ParticleScene {
        self.app.world().resource::<ParticleScene>()
    }

    /// Draws something else from now on.
    pub fn show(&mut self, view: SplatView) {
        self.app.world_mut().entity_mut(self.camera).insert(view);
    }

    /// Draws the same from another camera from now on.
    pub fn look(&mut self, from: View) {
        self.view_mut(|view| view.view = from);
    }

    /// Draws one frame and waits for it.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn frame(&mut self) -> Result<(), GpuError> {
        self.app.update();
        let waited = self.app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
        if waited.is_err() || self.app.should_exit().is_some() {
            return Err(GpuError::Failed(format!("{}x{} pixels on {}", self.size.x, self.size.y, self.adapter)));
        }
        Ok(())
    }

    /// Waits until all particles are on the GPU.
    fn upload(&mut self, scene: &ParticleScene, request: &HeadlessRequest, needed: u64) -> Result<(), GpuError> {
        loop {
            self.frame()?;
            let states = request.nodes.iter().map(|node| scene.node_state(node.upload.id));
            let mut waiting = false;
            for state in states {
                match state {
                    Some(NodeState::Rejected) => {
                        return Err(GpuError::OutOfMemory { needed, budget: scene.stats().budget_bytes });
                    }
                    Some(NodeState::Queued) => waiting = true,
                    _ => {}
                }
            }
            if !waiting {
                return Ok(());
            }
        }
    }

    fn render_world(&mut self) -> &mut World {
        self.app.sub_app_mut(RenderApp).world_mut()
    }

    fn buffers(&mut self) -> Option<&SplatBuffers> {
        let world = self.render_world();
        let mut query = world.query::<&SplatBuffers>();
        query.iter(world).next()
    }

    /// Draws frames until shaders are compiled and the picture is there.
    ///
    /// # Errors
    /// [`GpuError`]: a shader does not compile, or the driver fails.
    pub fn complete(&mut self) -> Result<(), GpuError> {
        let start = Instant::now();
        loop {
            self.frame()?;
            if self.buffers().is_some_and(|buffers| buffers.accumulated.load(Ordering::Relaxed)) {
                return Ok(());
            }
            let world = self.render_world();
            let error = world.get_resource::<PipelineCache>().and_then(pipeline_error);
            if let Some(error) = error {
                return Err(GpuError::Shader(error));
            }
            if start.elapsed() > PATIENCE {
                return Err(GpuError::Shader("the shaders took too long to load".into()));
            }
            // Shader files are read on another thread.
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Milliseconds of `repeat` complete frames, and of their passes.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn measure(&mut self, repeat: u32) -> Result<(Vec<f64>, PassTimes), GpuError> {
        self.view_mut(|view| view.always = true);
        self.frame()?;
        let mut frames = Vec::new();
        let mut passes = PassTimes::default();
        for _ in 0..repeat.max(1) {
            frames.push(self.timed_frame(&mut passes)?.as_secs_f64() * 1e3);
        }
        // GPU times arrive some frames late.
        for _ in 0..4 {
            self.timed_frame(&mut passes)?;
        }
        self.view_mut(|view| view.always = false);
        Ok((frames, passes))
    }

    fn timed_frame(&mut self, passes: &mut PassTimes) -> Result<Duration, GpuError> {
        let start = Instant::now();
        self.frame()?;
        let time = start.elapsed();
        passes.collect(self.app.world());
        Ok(time)
    }

    fn view_mut(&mut self, change: impl FnOnce(&mut SplatView)) {
        if let Some(mut view) = self.app.world_mut().get_mut::<SplatView>(self.camera) {
            change(&mut view);
        }
    }

    /// Reads the accumulation back, and the number of splats where the technique counts them.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn accumulation(&mut self, attribute: bool) -> Result<(Accumulation, Option<u64>), GpuError> {
        let failed = || GpuError::Failed("(reading the picture back)".into());
        let device = self.app.world().resource::<RenderDevice>().clone();
        let queue = self.app.world().resource::<bevy::render::renderer::RenderQueue>().clone();
        let size = self.size;
        let buffers = self.buffers().ok_or_else(failed)?;
        let (width, stride) = (size.x as usize, buffers.stride as usize);
        let bytes = 8 * u64::from(buffers.stride) * u64::from(size.y);
        let cells = read_buffer(&device, &queue, &buffers.shared.cells, 0, bytes).ok_or_else(failed)?;
        let splats = match &buffers.bindings {
            Bindings::Compute(bindings) if buffers.particles.is_empty() => {
                // What is outside comes last and is not counted.
                let outside = u64::from(buffers.grids.uniform.bin_count - 1) * 4;
                let counted = read_buffer(&device, &queue, &bindings.starts, outside, 4).ok_or_else(failed)?;
                counted.first_chunk::<4>().map(|bytes| u64::from(u32::from_le_bytes(*bytes)))
            }
            Bindings::Compute(_) | Bindings::Raster(_) => None,
        };
        let cells: &[[f32; 2]] = bytemuck::cast_slice(&cells);
        let cells = cells.chunks(stride).flat_map(|row| &row[..width.min(row.len())]);
        let mut accumulation = Accumulation::new(size.x, size.y, attribute);
        for (index, cell) in cells.enumerate() {
            accumulation.p[index] = cell[0];
            if let Some(ps) = accumulation.ps.get_mut(index) {
                *ps = cell[1];
            }
        }
        Ok((accumulation, splats))
    }

    /// Colours the picture and reads it back.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn colors(&mut self, transfer: &TransferFunction, accumulation: &Accumulation) -> Result<Picture, GpuError> {
        let composite = Composite::new(transfer, transfer.levels(accumulation), accumulation.has_attribute());
        self.app.world_mut().entity_mut(self.camera).insert(composite);
        // The first frame compiles the pipeline.
        for _ in 0..3 {
            self.frame()?;
        }
        let failed = || GpuError::Failed("(reading the colours back)".into());
        let device = self.app.world().resource::<RenderDevice>().clone();
        let queue = self.app.world().resource::<bevy::render::renderer::RenderQueue>().clone();
        let (target, size) = (self.target.clone(), self.size);
        let images = self.render_world().resource::<RenderAssets<GpuImage>>();
        let image = images.get(&target).ok_or_else(failed)?;
        let rgba = read_texture(&device, &queue, &image.texture, size).ok_or_else(failed)?;
        Ok(Picture { width: size.x, height: size.y, rgba })
    }
}
