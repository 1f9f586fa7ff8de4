//! A Bevy application without a window that is driven by hand: it holds the particles of one request on the adapter and
//! draws them as often as asked.

use super::DeepfieldRenderPlugins;
use super::bloom::{Glow, GlowWork};
use super::capabilities::Technique;
use super::device::{DeviceOptions, GpuError, open};
use super::headless::{HeadlessNode, HeadlessRequest};
use super::integrals::{IntegralFindings, IntegralNews, IntegralView};
use super::light::{LightCells, LightView};
use super::mode_view::ModeView;
use super::readback::{read_buffer, read_texture};
use super::scene::{NodeId, NodeState, ParticleScene, Payload, TableId};
use super::splat::{Bindings, CountOverdraw, OverdrawBuffers, SplatBuffers, SplatPipelines, pipeline_error};
use super::surface::work::SurfaceWork;
use super::surface::{SurfaceNews, SurfaceView, seen};
use super::tile_passes::TilePasses;
use super::tiles::TileNews;
use super::timing::{FrameTimes, MeasuredPasses, PassTimes, median};
use super::view::{Backend, Composite, DrawItem, SplatView};
use super::volume::{VolumeFindings, VolumeNews, VolumeView};
use crate::color::composite::Image as Picture;
use crate::color::transfer::TransferFunction;
use crate::color::{Accumulation, Colors};
use crate::cpu::overdraw::{Differences, Overdraw};
use crate::cpu::volume::{FieldRange, OpaqueDepths};
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
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::texture::GpuImage;
use bevy::render::{RenderApp, RenderPlugin};
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use std::collections::HashSet;
use std::sync::Arc;
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

    /// Draws a volume of the particles, as often as asked: its light, what was found out, and the median milliseconds of its passes and
    /// of a whole picture.
    ///
    /// # Errors
    /// [`GpuError`]: a shader does not compile, the driver fails, or nothing fits.
    pub fn volume(
        &mut self,
        mut volume: VolumeView,
        repeat: u32,
    ) -> Result<(Colors, VolumeFindings, (MeasuredPasses, f64)), GpuError> {
        let mut frames = Vec::new();
        let mut passes = MeasuredPasses::default();
        self.pass_times();
        let number = volume.light.as_ref().map_or(0, |job| job.number);
        let found = loop {
            let round = frames.len() as u64;
            if let Some(job) = &mut volume.light {
                job.number = number + (round << 32);
            }
            self.insert((LightView::default(), volume.clone()));
            let wanted = volume.light.as_ref().map(|job| job.number);
            let start = Instant::now();
            let found = self.until(&mut passes, |found| match found.no_room {
                no_room if no_room.is_some() && no_room == wanted => Err(()),
                _ => Ok(found.drawn == wanted),
            })?;
            frames.push(start.elapsed().as_secs_f64() * 1e3);
            // The first one compiles the shaders.
            if frames.len() > repeat.max(1) as usize || repeat <= 1 {
                break found;
            }
        };
        if frames.len() > 1 {
            frames.remove(0);
        }
        Ok((self.light()?, found, (passes, median(&mut frames))))
    }

    /// Draws what passes by tiles do, as often as asked: its light, what it hides where that is asked for, and the median milliseconds
    /// of its passes and of a frame. Every picture has another number.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn tiles(
        &mut self,
        number: u64,
        passes: TilePasses,
        repeat: u32,
    ) -> Result<(Colors, Option<Arc<OpaqueDepths>>, (MeasuredPasses, f64)), GpuError> {
        self.insert(LightView::default());
        let world = self.app.world_mut();
        passes.show(number, u64::MAX, &mut world.commands().entity(self.camera));
        world.flush();
        let start = Instant::now();
        let mut passes = MeasuredPasses::default();
        self.pass_times();
        self.complete()?;
        let mut frames = vec![start.elapsed().as_secs_f64() * 1e3];
        passes.add(self.pass_times());
        if repeat > 1 {
            (frames, passes) = self.measure(repeat)?;
        }
        let opaque = loop {
            let found = self.app.world().resource::<TileNews>().now();
            if found.drawn == Some(number) {
                break found.opaque;
            }
            self.frame()?;
            self.check_shaders(start)?;
        };
        Ok((self.light()?, opaque, (passes, median(&mut frames))))
    }

    /// Draws measured heights: their light, if it is wanted, and the milliseconds of the passes and of a frame.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn surface(&mut self, surface: SurfaceView) -> Result<(Colors, (MeasuredPasses, f64)), GpuError> {
        let (number, is_colored, [width, height]) = (surface.number, surface.is_colored, surface.job.size());
        self.insert((LightView::default(), surface));
        let start = Instant::now();
        let mut passes = MeasuredPasses::default();
        self.pass_times();
        loop {
            self.frame()?;
            passes.add(self.pass_times());
            let found = self.app.world().resource::<SurfaceNews>().now();
            match found.number == number {
                true if found.no_room => return Err(GpuError::NoRoom(format!("{width}x{height} pixels of heights"))),
                true if self.is_complete() => break,
                _ => self.check_shaders(start)?,
            }
        }
        let colors = if is_colored { self.light()? } else { Colors::default() };
        Ok((colors, (passes, 1e3 * start.elapsed().as_secs_f64())))
    }

    /// Reads back the number of what each sample of the heights shows that were drawn last, row by row.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn surface_seen(&mut self) -> Result<Vec<u32>, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&SurfaceWork>();
        let found = query.iter(world).next().and_then(|work| seen::numbers(work, &device, &queue));
        found.ok_or_else(|| GpuError::Failed("(reading back what is seen)".into()))
    }

    /// Reads back how many pixels of the heights that were drawn last, in colours, are covered by what was measured.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn surface_covered(&mut self) -> Result<f64, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&SurfaceWork>();
        let found = query.iter(world).next().and_then(|work| seen::covered(work, &device, &queue));
        found.ok_or_else(|| GpuError::Failed("(reading back what is covered)".into()))
    }

    /// What has been found out about line integrals.
    pub fn integral_findings(&self) -> IntegralFindings {
        self.app.world().resource::<IntegralNews>().now()
    }

    /// What has been found out about the volume on its way.
    pub fn volume_findings(&self) -> VolumeFindings {
        self.app.world().resource::<VolumeNews>().now()
    }

    /// Finds between which values the mass of the particles' field lies; `None` where there is none.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn ranges(&mut self, volume: VolumeView) -> Result<Option<FieldRange>, GpuError> {
        let wanted = volume.ranges.as_ref().map(|job| job.number);
        self.insert((LightView::default(), volume));
        let found = self.until(&mut MeasuredPasses::default(), |found| match found.no_room {
            no_room if no_room.is_some() && no_room == wanted => Err(()),
            _ => Ok(found.ranges.map(|(number, _)| number) == wanted),
        })?;
        Ok(found.ranges.and_then(|(_, range)| range))
    }

    /// Draws frames until something has been found out; there is no room for it where `is_there` fails.
    fn until(
        &mut self,
        passes: &mut MeasuredPasses,
        is_there: impl Fn(&VolumeFindings) -> Result<bool, ()>,
    ) -> Result<VolumeFindings, GpuError> {
        let start = Instant::now();
        loop {
            self.frame()?;
            passes.add(self.pass_times());
            let found = self.volume_findings();
            match is_there(&found) {
                Ok(true) => return Ok(found),
                Ok(false) => self.check_shaders(start)?,
                Err(()) => {
                    let pixels = || GpuError::NoRoom(format!("{}x{} pixels", self.size.x, self.size.y));
                    return Err(found
                        .most_cells
                        .filter(|most| *most > 1)
                        .map_or_else(pixels, |most| GpuError::GridTooLarge { most }));
                }
            }
        }
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

    /// Counts the splats over each pixel; the picture is not drawn.
    ///
    /// # Errors
    /// [`GpuError`]: an adapter without compute shaders, a shader that does not compile, or the driver fails.
    pub fn overdraw(&mut self) -> Result<Overdraw, GpuError> {
        let lacks = |pipelines: &SplatPipelines| pipelines.capabilities.technique(Backend::Compute).err();
        if let Some(missing) = self.render_world().get_resource().and_then(lacks) {
            return Err(GpuError::Unsupported { adapter: self.adapter.clone(), backend: "compute", missing });
        }
        self.insert(CountOverdraw);
        let start = Instant::now();
        let differences = loop {
            self.frame()?;
            if let Some(differences) = self.differences()? {
                break differences;
            }
            self.check_shaders(start)?;
        };
        self.app.world_mut().entity_mut(self.camera).remove::<CountOverdraw>();
        Ok(differences.sum())
    }

    /// What has been counted, once it is.
    fn differences(&mut self) -> Result<Option<Differences>, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&OverdrawBuffers>();
        let Some(buffers) = query.iter(world).next().filter(|buffers| buffers.counted.load(Ordering::Relaxed)) else {
            return Ok(None);
        };
        let ([width, height], bytes) = (buffers.size, buffers.bytes());
        let found = read_buffer(&device, &queue, &buffers.differences, 0, bytes);
        let found = found.ok_or_else(|| GpuError::Failed("(reading the overdraw back)".into()))?;
        Ok(Some(Differences::found(width, height, bytemuck::pod_collect_to_vec(&found))))
    }

    /// Reads the accumulation back, and the number of splats where the technique counts them.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn accumulation(&mut self, attribute: bool) -> Result<(Accumulation, Option<u64>), GpuError> {
        let failed = || GpuError::Failed("(reading the picture back)".into());
        let (device, queue) = self.device();
        let size = self.size;
        let buffers = self.buffers().ok_or_else(failed)?;
        let (width, stride) = (size.x as usize, buffers.stride as usize);
        let bytes = 8 * u64::from(buffers.stride) * u64::from(size.y);
        let cells = read_buffer(&device, &queue, &buffers.shared.cells, 0, bytes).ok_or_else(failed)?;
        let splats = match &buffers.bindings {
            Some(Bindings::Compute(bindings)) => {
                // What is outside comes last and is not counted.
                let outside = u64::from(buffers.grids.uniform.bin_count - 1) * 4;
                let counted = read_buffer(&device, &queue, &bindings.starts, outside, 4).ok_or_else(failed)?;
                counted.first_chunk::<4>().map(|bytes| u64::from(u32::from_le_bytes(*bytes)))
            }
            Some(Bindings::Raster(_)) | None => None,
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

    /// Reads the light of the camera's passes back.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn light(&mut self) -> Result<Colors, GpuError> {
        let failed = || GpuError::Failed("(reading the light back)".into());
        let (device, queue) = self.device();
        let cells = self.cells().ok_or_else(failed)?;
        let [width, height] = cells.size;
        let bytes = 16 * u64::from(width) * u64::from(height);
        let rgba = read_buffer(&device, &queue, &cells.buffer, 0, bytes).ok_or_else(failed)?;
        Ok(Colors { width, height, rgba: bytemuck::pod_collect_to_vec(&rgba) })
    }

    /// Colours the picture and reads it back.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn colors(&mut self, transfer: &TransferFunction, accumulation: &Accumulation) -> Result<Picture, GpuError> {
        let composite = Composite::new(transfer, transfer.levels(accumulation), accumulation.has_attribute());
        self.insert(composite);
        self.shown()
    }

    /// Reads back what the camera's target shows.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn shown(&mut self) -> Result<Picture, GpuError> {
        // The first frame compiles the pipeline.
        for _ in 0..3 {
            self.frame()?;
        }
        let failed = || GpuError::Failed("(reading the colours back)".into());
        let (device, queue) = self.device();
        let (target, size) = (self.target.clone(), self.size);
        let images = self.render_world().resource::<RenderAssets<GpuImage>>();
        let image = images.get(&target).ok_or_else(failed)?;
        let rgba = read_texture(&device, &queue, &image.texture, size).ok_or_else(failed)?;
        Ok(Picture { width: size.x, height: size.y, rgba })
    }
}
