//! A Bevy application without a window that is driven by hand: it holds the particles of one request on the adapter and
//! draws them as often as asked.

mod passes;
mod results;

use super::DeepfieldRenderPlugins;
use super::bloom::{Glow, GlowWork};
use super::capabilities::Technique;
use super::device::{DeviceOptions, GpuError, open};
use super::headless::{HeadlessNode, HeadlessRequest};
use super::integrals::IntegralView;
use super::light::{LightCells, LightView};
use super::mode_view::ModeView;
use super::scene::{NodeId, NodeState, ParticleScene, Payload, TableId};
use super::splat::{CountOverdraw, SplatBuffers, pipeline_error};
use super::surface::SurfaceView;
use super::tile_passes::TilePasses;
use super::timing::{FrameTimes, MeasuredPasses, PassTimes};
use super::view::{Backend, Composite, DrawItem, SplatView};
use super::volume::VolumeView;
use crate::view::View;
use bevy::asset::RenderAssetUsages;
use bevy::camera::RenderTarget;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::log::LogPlugin;
use bevy::prelude::*;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_resource::{
    Extent3d, PipelineCache, PollType, TextureDimension, TextureFormat, TextureUsages,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
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
    /// Nodes and tables that are there.
    held: Vec<NodeId>,
    tables: Vec<TableId>,
}

impl HeadlessRenderer {
    /// Opens the adapter and uploads the particles.
    ///
    /// # Errors
    /// [`GpuError`]: no adapter, one that cannot carry the backend out, or too little memory.
    pub fn open(request: &HeadlessRequest) -> Result<HeadlessRenderer, GpuError> {
        let mut renderer = HeadlessRenderer::bare(&request.device, request.backend)?;
        renderer.load(request)?;
        Ok(renderer)
    }

    /// Opens the adapter without any particles.
    ///
    /// # Errors
    /// [`GpuError`]: no adapter, or one that cannot carry the backend out.
    pub fn bare(options: &DeviceOptions, backend: Backend) -> Result<HeadlessRenderer, GpuError> {
        let gpu = open(options)?;
        let technique = gpu.technique(backend)?;
        let scene = ParticleScene::new(0, u64::MAX);
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
        app.insert_resource(scene).insert_resource(options.withheld).add_plugins(DeepfieldRenderPlugins);
        let camera = app
            .world_mut()
            .spawn((
                Camera3d::default(),
                Camera { clear_color: ClearColorConfig::Custom(Color::BLACK), ..Camera::default() },
                Msaa::Off,
                Tonemapping::None,
            ))
            .id();
        app.finish();
        app.cleanup();
        Ok(HeadlessRenderer {
            app,
            camera,
            target: Handle::default(),
            adapter: gpu.adapter,
            technique,
            particles: 0,
            size: UVec2::ZERO,
            held: Vec::new(),
            tables: Vec::new(),
        })
    }

    /// Whether it can carry a backend out.
    pub fn serves(&self, backend: Backend) -> bool {
        match backend {
            Backend::Auto => true,
            Backend::Compute => self.technique == Technique::Compute,
            Backend::Raster => self.technique == Technique::Raster,
        }
    }

    /// The adapter's device, and the queue of its work.
    pub fn device(&self) -> (RenderDevice, RenderQueue) {
        let world = self.app.world();
        (world.resource::<RenderDevice>().clone(), world.resource::<RenderQueue>().clone())
    }

    /// Holds a request's particles from now on and shows them; nodes of pages that have been there before stay.
    ///
    /// # Errors
    /// [`GpuError`]: too little memory.
    pub fn load(&mut self, request: &HeadlessRequest) -> Result<(), GpuError> {
        let scene = self.scene().clone();
        let bytes: u64 = request.nodes.iter().map(|node| node.upload.payload.bytes()).sum();
        // Fragments at the end of chunks are lost; twice the bytes always suffices.
        scene.set_budgets((2 * bytes).max(64 << 20).max(scene.stats().budget_bytes), u64::MAX);
        // A page's nodes are what their names say; all else is named anew for each picture.
        let is_page = |node: &HeadlessNode| matches!(node.upload.payload, Payload::Page { .. });
        let wanted: HashSet<NodeId> =
            request.nodes.iter().filter(|node| is_page(node)).map(|node| node.upload.id).collect();
        let mut held = std::mem::take(&mut self.held);
        scene.remove_nodes(held.extract_if(.., |id| !wanted.contains(id)));
        std::mem::take(&mut self.tables).into_iter().for_each(|table| scene.remove_table(table));
        self.tables = request.tables.iter().map(|table| scene.insert_table(table.clone())).collect();
        let mut known: HashSet<NodeId> = held.iter().copied().collect();
        let first = request.nodes.iter().filter(|node| known.insert(node.upload.id));
        scene.insert_nodes(first.map(|node| node.upload.clone()));
        self.held = known.into_iter().collect();
        self.particles = request.nodes.iter().map(|node| node.upload.payload.len() as u64).sum();

        self.resize(UVec2::new(request.view.width, request.view.height));
        let item = |node: &HeadlessNode| DrawItem {
            node: node.upload.id,
            table: node.table.and_then(|table| self.tables.get(table).copied()),
            weight_scale: node.weight_scale,
            offset: node.offset,
            sample: node.sample,
            limit: node.limit,
        };
        let items = request.nodes.iter().map(item).collect();
        // Nothing is drawn before everything is there.
        let world = self.app.world_mut();
        world.entity_mut(self.camera).remove::<(
            SplatView,
            ModeView,
            Composite,
            LightView,
            Glow,
            VolumeView,
            CountOverdraw,
            IntegralView,
            SurfaceView,
        )>();
        TilePasses::hide(&mut world.commands().entity(self.camera));
        world.flush();
        match self.upload(&scene, request, bytes) {
            // What pictures before have left of the adapter's memory is in pieces.
            Err(GpuError::OutOfMemory { .. }) if !wanted.is_empty() || scene.stats().resident_nodes > 0 => {
                scene.remove_nodes(self.held.iter().copied());
                let mut known = HashSet::new();
                let first = request.nodes.iter().filter(|node| known.insert(node.upload.id));
                scene.insert_nodes(first.map(|node| node.upload.clone()));
                self.upload(&scene, request, bytes)?;
            }
            done => done?,
        }
        let view = SplatView {
            keeps_last: false,
            view: request.view,
            footprint: request.footprint,
            backend: request.backend,
            culling: request.culling,
            faintest: request.faintest,
            items,
            always: false,
        };
        let mut camera = self.app.world_mut().entity_mut(self.camera);
        camera.insert(view);
        if let Some(mode) = &request.mode {
            camera.insert(mode.clone());
        }
        Ok(())
    }

    /// Draws into a target of this size from now on, or of the largest that there can be: light is read from its cells.
    fn resize(&mut self, size: UVec2) {
        let most = self.device().0.limits().max_texture_dimension_2d;
        let size = size.min(UVec2::splat(most));
        if self.size == size {
            return;
        }
        let mut target = Image::new_uninit(
            Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
            TextureDimension::D2,
            // Encoded colours: what the composite writes arrives unchanged.
            TextureFormat::Rgba8Unorm,
            RenderAssetUsages::RENDER_WORLD,
        );
        target.texture_descriptor.usage |=
            TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING;
        let world = self.app.world_mut();
        self.target = world.resource_mut::<Assets<Image>>().add(target);
        world.entity_mut(self.camera).insert(RenderTarget::Image(self.target.clone().into()));
        self.size = size;
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

    /// Gives the camera more components, such as those of a mode's passes.
    pub fn insert(&mut self, components: impl Bundle) {
        self.app.world_mut().entity_mut(self.camera).insert(components);
    }

    fn cells(&mut self) -> Option<&LightCells> {
        let world = self.render_world();
        let mut query = world.query::<&LightCells>();
        query.iter(world).next()
    }

    /// Whether all of the picture is there.
    fn is_complete(&mut self) -> bool {
        if !self.glows_as_wanted() {
            return false;
        }
        match self.app.world().get::<LightView>(self.camera) {
            Some(_) => self.cells().is_some_and(|cells| cells.complete),
            None => self.buffers().is_some_and(|buffers| buffers.accumulated.load(Ordering::Relaxed)),
        }
    }

    /// Whether light spreads that is shown and is to.
    fn glows_as_wanted(&mut self) -> bool {
        let camera = self.app.world().entity(self.camera);
        if !camera.contains::<Glow>() || !(camera.contains::<LightView>() || camera.contains::<Composite>()) {
            return true;
        }
        let world = self.render_world();
        let mut query = world.query::<&GlowWork>();
        query.iter(world).any(|work| work.is_shown.load(Ordering::Relaxed))
    }

    /// Draws frames until shaders are compiled and the picture is there.
    ///
    /// # Errors
    /// [`GpuError`]: a shader does not compile, or the driver fails.
    pub fn complete(&mut self) -> Result<(), GpuError> {
        let start = Instant::now();
        loop {
            self.frame()?;
            if self.is_complete() {
                return Ok(());
            }
            self.check_shaders(start)?;
        }
    }

    /// Whether a picture that was begun at `start` may still come.
    fn check_shaders(&mut self, start: Instant) -> Result<(), GpuError> {
        let world = self.render_world();
        let cache = world.get_resource::<PipelineCache>();
        if let Some(error) = cache.and_then(pipeline_error) {
            return Err(GpuError::Shader(error));
        }
        let is_compiling = cache.is_some_and(|cache| cache.waiting_pipelines().next().is_some());
        if is_compiling && start.elapsed() > PATIENCE {
            return Err(GpuError::Shader("the shaders took too long to load".into()));
        }
        if is_compiling {
            // Shader files are read on another thread.
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    /// Milliseconds of `repeat` complete frames, and of their passes.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn measure(&mut self, repeat: u32) -> Result<(Vec<f64>, MeasuredPasses), GpuError> {
        self.view_mut(|view| view.always = true);
        self.frame()?;
        let mut frames = Vec::new();
        let mut passes = MeasuredPasses::default();
        self.pass_times();
        for _ in 0..repeat.max(1) {
            let start = Instant::now();
            self.frame()?;
            frames.push(start.elapsed().as_secs_f64() * 1e3);
            passes.add(self.pass_times());
        }
        self.view_mut(|view| view.always = false);
        Ok((frames, passes))
    }

    /// The times of the frames since the last call, each of which has been waited for.
    fn pass_times(&self) -> Vec<FrameTimes> {
        self.app.world().resource::<PassTimes>().take()
    }

    fn view_mut(&mut self, change: impl FnOnce(&mut SplatView)) {
        if let Some(mut view) = self.app.world_mut().get_mut::<SplatView>(self.camera) {
            change(&mut view);
        }
    }
}
