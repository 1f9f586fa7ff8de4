//! Modes that draw slabs of particles: what a camera says of one, when its lists are made anew, and when its picture is drawn.

use super::TileRequest;
use super::layout::Tiling;
use super::list::TileList;
use super::pipelines::{Steps, TilePipelines, init_when_used};
use super::spots::{self, SpotList};
use crate::cpu::volume::OpaqueDepths;
use crate::gpu::answer::Answer;
use crate::gpu::capabilities::Capabilities;
use crate::gpu::light::{self, LightCells, LightView, prepare_light, show_light};
use crate::gpu::news::News;
use crate::gpu::splat::layout::Grids;
use crate::gpu::splat::resources::at_least;
use crate::gpu::splat::{SplatBuffers, SplatPipelines, prepare_splats};
use crate::gpu::target::written;
use crate::gpu::timing::PassTimer;
use crate::gpu::view::SplatView;
use crate::view::View;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::{
    BindGroup, BindGroupLayoutDescriptor, BindingResource, Buffer, BufferUsages, COPY_BUFFER_ALIGNMENT, PipelineCache,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::sync_component::SyncComponent;
use bevy::render::{Render, RenderApp, RenderSystems};
use std::marker::PhantomData;
use std::mem;
use std::sync::Arc;
use std::task::Poll;

/// A mode whose passes draw particles in slabs of depth.
pub trait TileMode: Clone + PartialEq + Send + Sync + 'static {
    /// Layouts and pipelines.
    type Pipelines: Resource;

    /// What its passes bind for one camera.
    type Bound: Send + Sync + 'static;

    /// Has its pipelines compiled.
    fn pipelines(server: &AssetServer, cache: &PipelineCache, on: &Capabilities) -> Self::Pipelines;

    /// Which particles of a view it lists, and how many at a time, with so many bytes for all that it works in but pixels; `grids` are
    /// those that its splats are sorted by.
    fn request(&self, view: &View, grids: &Grids, memory: u64) -> TileRequest;

    /// Binds what its passes need; of the picture `before` what is still right may be taken over.
    fn bind(&self, before: Option<(&Self, &Self::Bound)>, to: &Binding<'_, Self>) -> Self::Bound;

    /// Bytes that it works in beside the list of particles, but pixels.
    fn bytes(bound: &Self::Bound) -> u64;

    /// Draws into the camera's [`LightCells`], and into [`Binding::ends`]; `None` while its pipelines are not compiled.
    fn draw(&self, bound: &Self::Bound, on: &Canvas<'_, Self>, context: &mut RenderContext) -> Option<()>;

    /// What a picture hides, by what its passes have left in [`Binding::ends`], row by row.
    fn opaque(&self, view: &View, ends: &[f32]) -> OpaqueDepths;
}

/// What a picture hides, by the depths where its pixels become opaque.
pub fn opaque_depths(view: &View, ends: &[f32], smallest: f64) -> OpaqueDepths {
    let depths = ends.iter().map(|&end| if end == 0.0 { f32::INFINITY } else { end });
    OpaqueDepths::new(view, depths.collect(), 1.0, smallest)
}

/// On a camera with a [`LightView`]: its particles are drawn by a mode's passes (main world, extracted).
#[derive(Component, Clone, Debug)]
pub struct TilePicture<M: TileMode> {
    /// The caller's name for the picture, by which [`TileNews`] tells that it is complete; not 0.
    pub number: u64,
    /// What is drawn.
    pub mode: M,
    /// Whether [`TileNews`] says what the picture hides.
    pub occlusion: bool,
    /// Bytes that lists, and what the mode makes of them, may take.
    pub memory: u64,
}

impl<M: TileMode> SyncComponent for TilePicture<M> {
    type Target = (Self, TileBindings<M>);
}

impl<M: TileMode> ExtractComponent for TilePicture<M> {
    type QueryData = &'static Self;
    type QueryFilter = ();
    type Out = Self;

    fn extract_component(picture: &Self) -> Option<Self> {
        Some(picture.clone())
    }
}

/// What is known of pictures by tiles.
#[derive(Clone, Debug, Default)]
pub struct TileFindings {
    /// The number of the last complete picture, if there is one.
    pub drawn: Option<u64>,
    /// What it hides, where that was asked for.
    pub opaque: Option<Arc<OpaqueDepths>>,
    /// Bytes of the lists, and of what the mode makes of them; pixels are not counted.
    pub bytes: u64,
}

/// What is known of pictures by tiles.
pub type TileNews = News<TileFindings>;

/// What a mode's passes are bound to.
pub struct Binding<'a, M: TileMode> {
    /// The mode's layouts.
    pub pipelines: &'a M::Pipelines,
    /// The particles in slabs.
    pub spots: &'a SpotList,
    /// The picture's pixels.
    pub cells: &'a LightCells,
    /// For each pixel where it becomes opaque, in what [`TileMode::opaque`] takes for a depth, as `f32`; 0 where it does not.
    pub ends: &'a Buffer,
    /// The particles, and the grids that splats are sorted by.
    pub particles: &'a SplatBuffers,
    /// Bytes that the mode may work in.
    pub memory: u64,
    /// Compiled pipelines.
    pub cache: &'a PipelineCache,
    /// The adapter, and what is written to it.
    pub gpu: (&'a RenderDevice, &'a RenderQueue),
    tiles: &'a TilePipelines,
}

impl<M: TileMode> Binding<'_, M> {
    /// A new buffer that holds these bytes.
    pub fn buffer(&self, bytes: &[u8], usage: BufferUsages) -> Buffer {
        written(None, bytes, usage, self.gpu.0, self.gpu.1)
    }

    /// A new buffer of four numbers for each pixel, or the one before where it is as large.
    pub fn pixels(&self, before: Option<&Buffer>) -> Buffer {
        match before {
            Some(before) if before.size() == self.cells.buffer.size() => before.clone(),
            _ => light::cells(None, self.cells.size, self.gpu.0).buffer,
        }
    }

    /// Binds resources one after the other.
    pub fn group(&self, layout: &BindGroupLayoutDescriptor, resources: &[BindingResource<'_>]) -> BindGroup {
        spots::bind(layout, resources, self.cache, self.gpu.0)
    }

    /// The particles by tiles; buffers are taken over from the list before.
    pub fn tiles(&self, before: Option<&TileList>) -> TileList {
        TileList::new(self.spots, before, self.tiles, self.cache, self.gpu)
    }
}

/// What a mode draws on.
pub struct Canvas<'a, M: TileMode> {
    /// The mode's pipelines.
    pub pipelines: &'a M::Pipelines,
    /// The compiled passes of the lists.
    pub steps: Steps<'a>,
    /// The particles.
    pub particles: &'a SplatBuffers,
    /// The same in slabs.
    pub spots: &'a SpotList,
    /// The picture's pixels.
    pub cells: &'a LightCells,
    /// Compiled pipelines.
    pub cache: &'a PipelineCache,
    /// Measures passes.
    pub timer: &'a PassTimer,
}

/// What the passes of a camera bind, and what that was made of (render world).
#[derive(Component)]
pub struct TileBindings<M: TileMode> {
    spots: SpotList,
    bound: M::Bound,
    of: M,
    memory: u64,
    view: View,
    ends: Buffer,
    /// The last picture whose ends have been asked for.
    asked: u64,
    answers: Vec<Ends<M>>,
}

impl<M: TileMode> TileBindings<M> {
    /// What the picture that was drawn last is bound to, and its view.
    pub fn drawn(&self) -> (&M::Bound, &View) {
        (&self.bound, &self.view)
    }
}

/// The ends of a complete picture, on their way; the first one alone where nobody asks what the picture hides.
struct Ends<M> {
    number: u64,
    of: M,
    view: View,
    occlusion: bool,
    answer: Answer,
}

/// Adds a mode's passes.
pub struct TilePlugin<M>(PhantomData<fn() -> M>);

impl<M> Default for TilePlugin<M> {
    fn default() -> TilePlugin<M> {
        TilePlugin(PhantomData)
    }
}

impl<M: TileMode> Plugin for TilePlugin<M> {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<TilePicture<M>>::default());
        let news = app.world_mut().get_resource_or_init::<TileNews>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        init_when_used::<TilePicture<M>, M::Pipelines, _>(render_app, init_pipelines::<M>);
        render_app
            .insert_resource(news)
            .add_systems(
                Render,
                (
                    (take_in::<M>, prepare::<M>)
                        .chain()
                        .in_set(RenderSystems::PrepareBindGroups)
                        .after(prepare_splats)
                        .before(prepare_light),
                    ask_for_ends::<M>.in_set(RenderSystems::Cleanup),
                ),
            )
            .add_systems(
                Core3d,
                draw::<M>
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(show_light)
                    .before(main_transparent_pass_3d),
            );
    }
}

/// Has a mode's pipelines compiled.
fn init_pipelines<M: TileMode>(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    splats: Res<SplatPipelines>,
) {
    commands.insert_resource(M::pipelines(&server, &cache, &splats.capabilities));
}

/// Makes lists anew for cameras whose particles or mode are other ones than before.
fn prepare<M: TileMode>(
    mut commands: Commands,
    mut cameras: Query<
        (Entity, &SplatView, &TilePicture<M>, Ref<SplatBuffers>, Option<&mut TileBindings<M>>, Option<&LightCells>),
        With<LightView>,
    >,
    pipelines: Option<Res<M::Pipelines>>,
    tile_pipelines: Option<Res<TilePipelines>>,
    cache: Res<PipelineCache>,
    (device, queue): (Res<RenderDevice>, Res<RenderQueue>),
    news: Res<TileNews>,
) {
    let (Some(pipelines), Some(tile_pipelines)) = (pipelines, tile_pipelines) else { return };
    for (entity, view, picture, particles, mut before, cells) in &mut cameras {
        if before.as_ref().is_some_and(|before| before.of == picture.mode && before.memory == picture.memory)
            && cells.is_some()
            && !particles.is_changed()
        {
            continue;
        }
        // What has been asked for of pictures before is still wanted.
        let (asked, answers) =
            before.as_mut().map(|before| (before.asked, mem::take(&mut before.answers))).unwrap_or_default();
        let before = before.as_deref();
        let request = picture.mode.request(&view.view, &particles.grids, picture.memory);
        let tiling = Tiling::new(&view.view, &request);
        let known = before.map(|before| &before.spots);
        let spots = SpotList::new(tiling, request.at_a_time, &particles, known, &cache, (&device, &queue));
        let cells = light::cells(cells, tiling.uniform.size, &device);
        let pixels = tiling.uniform.size.map(u64::from).iter().product::<u64>();
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let ends =
            at_least(before.map(|before| before.ends.clone()), 4 * pixels, usage, "deepfield ends of rays", &device);
        let binding = Binding {
            pipelines: &*pipelines,
            spots: &spots,
            cells: &cells,
            ends: &ends,
            particles: &particles,
            memory: picture.memory,
            cache: &cache,
            gpu: (&device, &queue),
            tiles: &tile_pipelines,
        };
        let bound = picture.mode.bind(before.map(|before| (&before.of, &before.bound)), &binding);
        news.lock().bytes = spots.bytes() + M::bytes(&bound);
        let of = picture.mode.clone();
        commands.entity(entity).insert((
            TileBindings { spots, bound, of, memory: picture.memory, view: view.view, ends, asked, answers },
            cells,
        ));
    }
}

/// Draws the particles of a camera into its [`LightCells`].
fn draw<M: TileMode>(
    view: ViewQuery<(&SplatBuffers, &mut TileBindings<M>, &mut LightCells, &LightView, &TilePicture<M>)>,
    pipelines: Option<Res<M::Pipelines>>,
    tile_pipelines: Option<Res<TilePipelines>>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    device: Res<RenderDevice>,
    mut context: RenderContext,
) {
    let (particles, mut bindings, mut cells, _, picture) = view.into_inner();
    if !cells.complete || particles.always {
        let (Some(pipelines), Some(tile_pipelines)) = (pipelines, tile_pipelines) else { return };
        let Some(steps) = tile_pipelines.ready(&cache) else { return };
        let canvas = Canvas {
            pipelines: &*pipelines,
            steps,
            particles,
            spots: &bindings.spots,
            cells: &cells,
            cache: &cache,
            timer: &timer,
        };
        context.command_encoder().clear_buffer(&bindings.ends, 0, None);
        if bindings.of.draw(&bindings.bound, &canvas, &mut context).is_none() {
            return;
        }
        cells.complete = true;
    }
    let number = picture.number;
    if bindings.asked != number {
        // Commands are carried out later than they are given: that a picture is complete is read back, too.
        let bytes = if picture.occlusion { bindings.ends.size() } else { COPY_BUFFER_ALIGNMENT };
        let answer = Answer::new(bytes, "deepfield ends that are read", &device);
        context.command_encoder().copy_buffer_to_buffer(&bindings.ends, 0, answer.buffer(), 0, bytes);
        answer.copied();
        let (of, view) = (bindings.of.clone(), bindings.view);
        bindings.asked = number;
        bindings.answers.push(Ends { number, of, view, occlusion: picture.occlusion, answer });
    }
}

/// Asks for what complete pictures say.
fn ask_for_ends<M: TileMode>(cameras: Query<&TileBindings<M>>) {
    cameras.iter().flat_map(|bindings| &bindings.answers).for_each(|ends| ends.answer.ask());
}

/// Takes in what complete pictures say.
fn take_in<M: TileMode>(mut cameras: Query<&mut TileBindings<M>>, news: Res<TileNews>) {
    for mut bindings in &mut cameras {
        bindings.bypass_change_detection().answers.retain(|Ends { number, of, view, occlusion, answer }| {
            let Poll::Ready(bytes) = answer.take() else { return true };
            let opaque = bytes.filter(|_| *occlusion).map(|bytes| {
                let (words, _) = bytes.as_chunks::<4>();
                let pixels = view.width as usize * view.height as usize;
                let ends: Vec<f32> = words.iter().take(pixels).map(|word| f32::from_le_bytes(*word)).collect();
                Arc::new(of.opaque(view, &ends))
            });
            let mut found = news.lock();
            (found.drawn, found.opaque) = (Some(*number), opaque);
            false
        });
    }
}
