//! What a camera's surface is drawn with, and the passes.

use super::arena::SurfaceArena;
use super::constants::{CHUNK, ENTRY, GROUP, MARGIN, POINTS, SCANNERS, TILE};
use super::job::{SurfaceFindings, SurfaceNews, SurfaceView};
use super::layout::{SurfaceStep, SurfaceUniform};
use super::list::DrawList;
use super::pipelines::{DEPTHS, NUMBERS, Ready, Step, SurfacePipelines, Variant};
use crate::cpu::surface::look::Ramp;
use crate::gpu::light::{self, LightCells, LightView};
use crate::gpu::splat::SplatBuffers;
use crate::gpu::splat::resources::{ALIGNMENT, at_least, slice, whole};
use crate::gpu::timing::PassTimer;
use crate::picture::adapter::AdapterSurface;
use bevy::prelude::*;
use bevy::render::render_resource::{
    BindGroup, BindGroupEntry, BindGroupLayoutDescriptor, BindingResource, Buffer, BufferUsages, CommandEncoder,
    ComputePassDescriptor, Extent3d, LoadOp, Operations, PipelineCache, RenderPassColorAttachment,
    RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp, TexelCopyBufferInfo, TexelCopyBufferLayout,
    Texture, TextureDescriptor, TextureDimension, TextureUsages, TextureView, TextureViewDescriptor,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use std::sync::Arc;

/// Chunks with large triangles that are drawn at a time: the list of these has room for all that they may have.
const NEAR: u32 = 8;
/// Large triangles of a chunk at most.
const TRIANGLES: u32 = 2 * CHUNK * CHUNK;
/// Workgroups along an axis of a dispatch at most.
const GROUPS: u32 = 65_535;
/// Samples of a row of the picture are a multiple of this: rows of textures begin at such places in buffers.
const ROW: u32 = 64;

/// What is drawn at a time.
#[derive(Clone, Copy, Debug)]
struct Turn {
    step: Step,
    /// Where its uniform begins.
    offset: u32,
    /// The first of them in the lists.
    first: u32,
    /// How many chunks, triangles or squares of the picture there are.
    count: u32,
}

/// What a camera's surface is drawn with (render world).
#[derive(Component)]
pub struct SurfaceWork {
    number: u64,
    job: Arc<AdapterSurface>,
    buffers: Buffers,
    targets: Option<Targets>,
    shared: BindGroup,
    visible: BindGroup,
    raster: BindGroup,
    resolve: BindGroup,
    turns: Vec<Turn>,
    /// Pixels of the largest square about a sample, for each chunk in the order in which they are listed.
    squares: Vec<u32>,
}

/// Buffers that are kept from picture to picture.
#[derive(Clone, Default)]
struct Buffers {
    view: Option<Buffer>,
    draws: Option<Buffer>,
    lists: Option<Buffer>,
    steps: Option<Buffer>,
    nearest: Option<Buffer>,
    shown: Option<Buffer>,
    large: Option<Buffer>,
    counts: Option<Buffer>,
    ramp: Option<Buffer>,
    covered: Option<Buffer>,
    /// In place of a photo's texels where there is none.
    no_texels: Option<Buffer>,
}

/// What the rasteriser draws into.
#[derive(Clone)]
struct Targets {
    size: [u32; 2],
    numbers: Texture,
    views: [TextureView; 2],
}

/// Forgets what belongs to a device that is lost.
pub fn forget(mut commands: Commands, cameras: Query<Entity, With<SurfaceWork>>) {
    cameras.iter().for_each(|camera| {
        commands.entity(camera).remove::<SurfaceWork>();
    });
    commands.remove_resource::<SurfacePipelines>();
    commands.insert_resource(SurfaceArena::default());
}

/// Has what cameras show on the adapter.
pub fn prepare_surfaces(
    mut commands: Commands,
    cameras: Query<(Entity, &SurfaceView, Option<&SurfaceWork>, Option<&LightCells>), With<LightView>>,
    pipelines: Option<Res<SurfacePipelines>>,
    mut arena: ResMut<SurfaceArena>,
    news: Res<SurfaceNews>,
    (cache, device, queue): (Res<PipelineCache>, Res<RenderDevice>, Res<RenderQueue>),
) {
    let Some(pipelines) = pipelines else { return };
    for (entity, view, before, cells) in &cameras {
        if before.is_some_and(|before| before.number == view.number) && cells.is_some() {
            continue;
        }
        let made = SurfaceWork::new(view, before, &pipelines, &mut arena, cells, (&cache, &device, &queue));
        *news.lock() = SurfaceFindings { number: view.number, no_room: made.is_none(), is_drawn: false };
        if let Some((work, cells)) = made {
            commands.entity(entity).insert((work, cells));
        }
    }
}

/// Draws the surface of a camera into its [`LightCells`].
pub fn draw_surfaces(
    view: ViewQuery<(&SplatBuffers, &SurfaceWork, &SurfaceView, &mut LightCells, &LightView)>,
    pipelines: Option<Res<SurfacePipelines>>,
    (cache, timer, news): (Res<PipelineCache>, Res<PassTimer>, Res<SurfaceNews>),
    mut context: RenderContext,
) {
    let (splats, work, wanted, mut cells, _) = view.into_inner();
    if work.number != wanted.number || cells.complete && !splats.always {
        return;
    }
    let Some(pipelines) = pipelines else { return };
    let ready = pipelines.ready(Variant::of(&work.job), &cache);
    if work.draw(&ready, wanted.is_colored, &timer, context.command_encoder()).is_some() {
        cells.complete = true;
        *news.lock() = SurfaceFindings { number: work.number, no_room: false, is_drawn: true };
    }
}

impl SurfaceWork {
    /// What a picture is drawn with, and its pixels; `None` where the adapter has no room for it.
    fn new(
        view: &SurfaceView,
        before: Option<&SurfaceWork>,
        pipelines: &SurfacePipelines,
        arena: &mut SurfaceArena,
        cells: Option<&LightCells>,
        (cache, device, queue): (&PipelineCache, &RenderDevice, &RenderQueue),
    ) -> Option<(SurfaceWork, LightCells)> {
        let job = &view.job;
        let size = [job.view.width, job.view.height];
        let stride = size[0].next_multiple_of(ROW);
        let limits = device.limits();
        let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let bytes = 4 * u64::from(stride) * u64::from(size[1]);
        let [width, height] = job.size().map(u64::from);
        let is_large = size.iter().any(|side| *side > limits.max_texture_dimension_2d.min(1 << 14));
        // Buffers have a quarter more room than is asked for.
        if bytes + bytes / 4 + ALIGNMENT > most || 16 * width * height > most || is_large {
            return None;
        }
        let (held, photo) = arena.hold(job, view.memory, (device, queue))?;
        let ramp: Vec<[f32; 4]> =
            Ramp::new(&job.look.transfer).colors().iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
        let list = DrawList::new(job, &held, photo.as_ref());
        let listed = 4 * list.lists.len() as u64;
        if listed + listed / 4 + ALIGNMENT > most {
            return None;
        }
        let most_large = (NEAR.min(list.near.1) * TRIANGLES).max(list.fans.1).max(GROUP * GROUP);
        let square = |number: &u32| {
            let flags = list.draws[*number as usize].flags;
            let point = if flags & POINTS == 0 { 0 } else { job.technique.side(job.point, job.parts) };
            job.parts.max(flags >> MARGIN & 63).max(point).pow(2)
        };
        let squares = list.lists[..(list.far.1 + list.near.1) as usize].iter().map(square).collect();
        let (steps, turns, counters) = turns_of(&list, most_large);

        let mut buffers = before.map(|before| before.buffers.clone()).unwrap_or_default();
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let mut kept = |slot: fn(&mut Buffers) -> &mut Option<Buffer>, bytes: u64, usage: BufferUsages| {
            let known = slot(&mut buffers).take();
            let buffer = at_least(known, bytes.max(64), usage, "deepfield surface", device);
            slot(&mut buffers).insert(buffer).clone()
        };
        let written = |buffer: Buffer, bytes: &[u8]| {
            queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let about = SurfaceUniform::new(job, stride, ramp.len() as u32, &list);
        let about = bytemuck::bytes_of(&about);
        let about = written(kept(|buffers| &mut buffers.view, about.len() as u64, uniform), about);
        let bytes_of_draws: &[u8] = bytemuck::cast_slice(&list.draws);
        let draws = written(kept(|buffers| &mut buffers.draws, bytes_of_draws.len() as u64, storage), bytes_of_draws);
        let bytes_of_lists: &[u8] = bytemuck::cast_slice(&list.lists);
        let lists = written(kept(|buffers| &mut buffers.lists, bytes_of_lists.len() as u64, storage), bytes_of_lists);
        let steps = written(kept(|buffers| &mut buffers.steps, steps.len() as u64, uniform), &steps);
        let bytes_of_ramp: &[u8] = bytemuck::cast_slice(&ramp);
        let ramp = written(kept(|buffers| &mut buffers.ramp, bytes_of_ramp.len() as u64, storage), bytes_of_ramp);
        let no_texels = kept(|buffers| &mut buffers.no_texels, 64, storage);
        let texels = photo.map_or(no_texels, |photo| photo.buffer);
        let nearest = kept(|buffers| &mut buffers.nearest, if job.is_raster() { 64 } else { bytes }, storage);
        let shown = kept(|buffers| &mut buffers.shown, bytes, storage | BufferUsages::COPY_SRC);
        let covered = kept(|buffers| &mut buffers.covered, 4 * width * height, storage | BufferUsages::COPY_SRC);
        let room = if job.is_raster() { 64 } else { 4 * u64::from(ENTRY) * u64::from(most_large) };
        let large = kept(|buffers| &mut buffers.large, room, storage);
        let counts = kept(|buffers| &mut buffers.counts, 4 * u64::from(counters), storage);
        let targets = job.is_raster().then(|| {
            let known = before.and_then(|before| before.targets.clone());
            known.filter(|targets| targets.size == size).unwrap_or_else(|| Targets::new(size, device))
        });

        let cells = light::cells(cells, job.size(), device);
        let group = |layout: &BindGroupLayoutDescriptor, resources: &[BindingResource<'_>]| {
            let entries: Vec<BindGroupEntry<'_>> = (0..)
                .zip(resources)
                .map(|(binding, resource)| BindGroupEntry { binding, resource: resource.clone() })
                .collect();
            device.create_bind_group("deepfield surface", &cache.get_bind_group_layout(layout), &entries)
        };
        let step = || slice(&steps, 0, size_of::<SurfaceStep>() as u64);
        let of_samples = [whole(&about), whole(&held.buffer), whole(&draws), whole(&lists)];
        let shared = group(&pipelines.shared, &of_samples);
        let seen = [step(), whole(&nearest), whole(&shown), whole(&large), whole(&counts)];
        let visible = group(&pipelines.visible, &seen);
        let raster = group(&pipelines.raster, &[step()]);
        let colors = [whole(&shown), whole(&ramp), whole(&cells.buffer), whole(&texels), whole(&covered)];
        let resolve = group(&pipelines.resolve, &colors);
        let job = Arc::clone(job);
        let number = view.number;
        let work = SurfaceWork { number, job, buffers, targets, shared, visible, raster, resolve, turns, squares };
        Some((work, cells))
    }

    /// The numbers of what its samples show, inverted: where they are, how many a row takes, and columns and rows of samples.
    pub(super) fn shown(&self) -> Option<(&Buffer, u32, [u32; 2])> {
        let [width, height] = [self.job.view.width, self.job.view.height];
        Some((self.buffers.shown.as_ref()?, width.next_multiple_of(ROW), [width, height]))
    }

    /// How much of each pixel is covered by what was measured: where that is, and how many pixels there are.
    pub(super) fn covered(&self) -> Option<(&Buffer, u64)> {
        let pixels = self.job.size().into_iter().map(u64::from).product();
        Some((self.buffers.covered.as_ref()?, pixels))
    }

    /// Draws, in colours if they are wanted; `None` while pipelines are not compiled.
    fn draw(&self, ready: &Ready<'_>, is_colored: bool, timer: &PassTimer, encoder: &mut CommandEncoder) -> Option<()> {
        let resolve = if is_colored { Some(ready.steps[Step::Resolve as usize]?) } else { None };
        let span = timer.begin("visible", encoder);
        match &self.targets {
            Some(targets) => self.rasterise(targets, ready, encoder)?,
            None => self.compute(ready, encoder)?,
        }
        span.end(encoder);
        let Some(resolve) = resolve else { return Some(()) };
        let span = timer.begin("resolve", encoder);
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            pass.set_pipeline(resolve);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.resolve, &[]);
            let [x, y] = self.job.size().map(|pixels| pixels.div_ceil(8));
            pass.dispatch_workgroups(x, y, 1);
        }
        span.end(encoder);
        Some(())
    }

    fn compute(&self, ready: &Ready<'_>, encoder: &mut CommandEncoder) -> Option<()> {
        for buffer in [&self.buffers.nearest, &self.buffers.shown, &self.buffers.counts] {
            encoder.clear_buffer(buffer.as_ref()?, 0, None);
        }
        let large = ready.steps[Step::Large as usize]?;
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_bind_group(0, &self.shared, &[]);
        for turn in &self.turns {
            pass.set_pipeline(ready.steps[turn.step as usize]?);
            pass.set_bind_group(1, &self.visible, &[turn.offset]);
            match turn.step {
                Step::Rays => {
                    pass.dispatch_workgroups(turn.count, 1, 1);
                    continue;
                }
                Step::Fans => pass.dispatch_workgroups(turn.count.div_ceil(GROUP), 1, 1),
                _ => pass.dispatch_workgroups((CHUNK / TILE).pow(2), turn.count, 1),
            }
            // What these have listed.
            pass.set_pipeline(large);
            pass.dispatch_workgroups(SCANNERS, 1, 1);
        }
        Some(())
    }

    fn rasterise(&self, targets: &Targets, ready: &Ready<'_>, encoder: &mut CommandEncoder) -> Option<()> {
        let shown = self.buffers.shown.as_ref()?;
        let [cells, fans, points] = ready.shapes;
        let (cells, fans, points) = (cells?, fans?, points?);
        {
            let [numbers, depths] = &targets.views;
            let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
                label: Some("deepfield surface"),
                color_attachments: &[Some(RenderPassColorAttachment {
                    view: numbers,
                    depth_slice: None,
                    resolve_target: None,
                    ops: Operations { load: LoadOp::Clear(wgpu::Color::TRANSPARENT), store: StoreOp::Store },
                })],
                depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                    view: depths,
                    depth_ops: Some(Operations { load: LoadOp::Clear(0.0), store: StoreOp::Discard }),
                    stencil_ops: None,
                }),
                timestamp_writes: None,
                occlusion_query_set: None,
                multiview_mask: None,
            });
            pass.set_bind_group(0, &self.shared, &[]);
            let cell_corners = 6 * CHUNK * CHUNK;
            // All is drawn once.
            for turn in self.turns.iter().take(self.turns.len() / 2) {
                pass.set_bind_group(1, &self.raster, &[turn.offset]);
                match turn.step {
                    Step::Fans => {
                        pass.set_pipeline(fans);
                        pass.draw(0..3 * turn.count, 0..1);
                    }
                    _ => {
                        pass.set_pipeline(cells);
                        pass.draw(0..cell_corners, 0..turn.count);
                        pass.set_pipeline(points);
                        let mut done = 0;
                        let chunks = &self.squares[turn.first as usize..(turn.first + turn.count) as usize];
                        for alike in chunks.chunk_by(|a, b| a == b) {
                            let count = alike.len() as u32;
                            pass.draw(0..alike[0] * (CHUNK + 1).pow(2), done..done + count);
                            done += count;
                        }
                    }
                }
            }
        }
        let [width, height] = targets.size;
        encoder.copy_texture_to_buffer(
            targets.numbers.as_image_copy(),
            TexelCopyBufferInfo {
                buffer: shown,
                layout: TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(4 * width.next_multiple_of(ROW)),
                    rows_per_image: None,
                },
            },
            Extent3d { width, height, depth_or_array_layers: 1 },
        );
        Some(())
    }
}

impl Targets {
    fn new(size: [u32; 2], device: &RenderDevice) -> Targets {
        let texture = |format, usage| {
            device.create_texture(&TextureDescriptor {
                label: Some("deepfield surface"),
                size: Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format,
                usage: TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            })
        };
        let numbers = texture(NUMBERS, TextureUsages::COPY_SRC);
        let depths = texture(DEPTHS, TextureUsages::empty());
        let views = [&numbers, &depths].map(|texture| texture.create_view(&TextureViewDescriptor::default()));
        Targets { size, numbers, views }
    }
}

/// What is drawn one after the other, first for depths and then for numbers, with the bytes of its uniforms; and how many counters that takes.
fn turns_of(list: &DrawList, most: u32) -> (Vec<u8>, Vec<Turn>, u32) {
    let (far, (first, near), fans) = (list.far, list.near, list.fans);
    let batches = (0..near).step_by(NEAR as usize).map(|done| (Step::Cells, first + done, NEAR.min(near - done)));
    let (squares_at, cast) = list.rays;
    let casts =
        (0..cast).step_by(GROUPS as usize).map(|done| (Step::Rays, squares_at + 2 * done, GROUPS.min(cast - done)));
    let all: Vec<(Step, u32, u32)> = casts
        .chain(std::iter::once((Step::Cells, far.0, far.1)))
        .chain(batches)
        .chain(std::iter::once((Step::Fans, fans.0, fans.1)))
        .filter(|(_, _, count)| *count > 0)
        .collect();
    let (mut bytes, mut turns) = (Vec::new(), Vec::new());
    for is_second in [0, 1] {
        for (step, first, count) in &all {
            let (offset, counter) = (bytes.len() as u32, turns.len() as u32);
            let (first, count) = (*first, *count);
            let about = SurfaceStep { is_second, first, count, counter, most, ..SurfaceStep::default() };
            bytes.extend_from_slice(bytemuck::bytes_of(&about));
            bytes.resize(bytes.len().next_multiple_of(ALIGNMENT as usize), 0);
            turns.push(Turn { step: *step, offset, first, count });
        }
    }
    let counters = turns.len() as u32;
    (bytes, turns, counters)
}
