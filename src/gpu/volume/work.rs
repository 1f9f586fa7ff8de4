//! A picture on its way: how it is cut, which particles each slab reads, and how far it has come.

use super::bindings::{Bindings, Buffers, Groups, Wanted};
use super::constants::BRICK;
use super::cut::{Cut, Window};
use super::field::runs;
use super::layout::{self, MOST_TIERS, Portion, TierPortion, VolumeUniform};
use super::programs::Variant;
use super::room::Room;
use super::store::{Held, Store};
use super::view::{Shows, VolumeJob, VolumeView};
use crate::cpu::volume::bricks::{BORDER, BrickGrid};
use crate::cpu::volume::particles::growth;
use crate::cpu::volume::{coarse, extents, raycast};
use crate::gpu::answer::Answer;
use crate::gpu::arena::Arena;
use crate::gpu::field_samples::{Finest, HeldSamples};
use crate::gpu::splat::draw_list::{DrawBatch, DrawList, PartToDraw};
use crate::gpu::splat::layout::{Grids, Node};
use crate::gpu::splat::{particle_layout, resources::slice, workgroups};
use crate::gpu::view::{DrawItem, Footprint};
use crate::view::perspective_grid::seen;
use crate::view::{Extent, View};
use bevy::render::render_resource::{BindGroup, BindGroupEntries, Buffer, PipelineCache};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

/// A window, and the pixels that it draws.
#[derive(Clone, Copy, Debug)]
pub struct Pane {
    /// The window.
    pub window: Window,
    /// First pixel, and behind the last.
    pub pixels: [[u32; 2]; 2],
}

impl Pane {
    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        let [first, behind] = self.pixels;
        [0, 1].map(|axis: usize| behind[axis] - first[axis])
    }

    /// Number of pixels.
    pub fn len(&self) -> u64 {
        self.size().map(u64::from).iter().product()
    }
}

/// Blocks of particles in one chunk of the arena.
pub struct Loaded {
    /// Group 0 of [`Kind::Project`].
    pub particles: BindGroup,
    /// Workgroups along x and y.
    pub workgroups: (u32, u32),
}

/// A batch of a slab's particles.
pub struct Batch {
    /// Where they are loaded from.
    pub loaded: Vec<Loaded>,
    /// Places of particles that are looked at.
    pub candidates: u32,
    /// Turns that its most crowded brick may take.
    pub turns: u32,
}

/// Layers of a slab that are filled from a level of a field.
pub struct FieldRun {
    /// The level.
    pub level: usize,
    /// Bricks that may be filled.
    pub bricks: u32,
}

/// A slab of one pane.
pub struct SlabWork {
    /// The batches of each column that is resampled by itself, one at least: of densities there is one. None of a field.
    pub columns: Vec<Vec<Batch>>,
    /// What is filled from a field; each has a portion behind the first.
    pub runs: Vec<FieldRun>,
    /// Number of its first portion.
    pub first_portion: usize,
    /// Layers of bricks.
    pub layers: u32,
    /// Bricks of each tier that may be filled.
    pub bricks: Vec<u32>,
    /// Which pane it belongs to, and whether it is the first or the last of it.
    pub pane: usize,
    /// Whether nothing has been drawn of the pane before.
    pub opens: bool,
    /// Whether the pane is complete with it.
    pub closes: bool,
}

/// A picture on its way.
pub struct Work {
    /// What is wanted.
    pub job: VolumeJob,
    /// What it was begun with.
    items: Arc<[DrawItem]>,
    nodes: Vec<Node>,
    /// The arena's state in which the particles were last known to be where the bindings say.
    pub generation: u64,
    /// What is compiled into the shaders.
    pub variant: Variant,
    /// How the grid is cut.
    pub cut: Cut,
    /// The windows' pixels.
    pub panes: Vec<Pane>,
    /// All slabs of all panes, in the order in which they are drawn.
    pub slabs: Vec<SlabWork>,
    /// Digits that pairs are sorted by.
    pub digits: u32,
    /// Bins of all levels.
    pub bin_count: u32,
    /// Bindings.
    pub groups: Groups,
    /// Buffers.
    pub buffers: Buffers,
    /// Where the picture goes, `vec4<f32>` a pixel.
    pub target: Option<Buffer>,
    /// What is read back when it is complete: [`Bindings::answer`].
    pub answer: Option<Answer>,
    /// The number 1.
    pub one: Held,
    /// By how many levels a field's samples are coarser than the grid asks for, if they are.
    pub coarser: Option<usize>,
    /// Slabs that have been encoded.
    pub done: AtomicUsize,
}

/// What a job is begun with.
pub struct Means<'a> {
    /// The particles.
    pub arena: &'a Arena,
    /// Creates buffers.
    pub device: &'a RenderDevice,
    /// Takes bytes.
    pub queue: &'a RenderQueue,
    /// Knows layouts.
    pub cache: &'a PipelineCache,
    /// Whether subgroups have exactly eight lanes.
    pub vectors: bool,
}

/// The windows that have pixels, and what all passes read of pixels: places of columns and rows, readers of bricks.
fn panes(job: &VolumeJob, cut: &Cut) -> (Vec<Pane>, Vec<[u32; 2]>, Vec<[i32; 2]>) {
    let grid = &job.grid;
    let places = [job.view.width, job.view.height].map(|pixels| raycast::places(grid, pixels));
    let brick = BRICK as usize;
    let first_pixel =
        |axis: usize, bricks: u32| places[axis].partition_point(|(cell, _)| *cell < bricks as usize * brick) as u32;
    let pane = |window: &Window| Pane {
        window: *window,
        pixels: [window.own_first, window.own_behind]
            .map(|bricks| [0, 1].map(|axis: usize| first_pixel(axis, bricks[axis]))),
    };
    let panes = cut.windows.iter().map(pane).filter(|pane| pane.len() > 0).collect();
    let readers = |axis: usize| {
        let bricks = (grid.size[axis] as usize + 2 * BORDER).div_ceil(brick);
        let places = &places[axis];
        (0..bricks)
            .map(move |index| raycast::readers(places, index * brick..(index + 1) * brick).map(|pixel| pixel as i32))
    };
    let readers = readers(0).chain(readers(1)).collect();
    (panes, layout::places(&places[0], &places[1]), readers)
}

impl Work {
    /// Begins a job; `None` where nothing fits into the room.
    pub fn begin(
        job: &VolumeJob,
        shown: &VolumeView,
        (view, items): (&View, &Arc<[DrawItem]>),
        room: &Room,
        store: &mut Store,
        means: &Means<'_>,
    ) -> Option<Work> {
        let Means { arena, device, cache, vectors, .. } = *means;
        // Columns are resampled one by one, each as densities with an attribute.
        let column_count = job.columns().map_or(1, |march| march.columns.len().max(1));
        let attribute = shown.attribute || job.columns().is_some();
        let grids = coarse::brick_grids(&job.grid, widest(job, &shown.extents));
        let cut = match job.cartesian() {
            Some(_) => Cut::whole(&job.grid, grids.len(), attribute, job.options.memory, room.cells)?,
            None => {
                let [cells, limit] = room.of_column(job);
                Cut::new(&job.grid, grids.len(), attribute, cells, limit)?
            }
        };
        let (panes, places, readers) = panes(job, &cut);
        let variant = Variant {
            kernel: job.options.kernel,
            attribute,
            surfaces: job.scenery().is_some_and(|scenery| !scenery.surfaces.is_empty()),
            centered: places.iter().all(|[_, share]| f32::from_bits(*share) == 0.0),
            vectors,
            field: job.field().is_some(),
            lit: job.scenery().is_some_and(|scenery| scenery.volume_light.is_some()),
            columns: job.columns().is_some(),
            smooth: job.smooths(),
            covering: job.keeps_covering(),
        };
        let pixels = panes.iter().map(Pane::len).max().unwrap_or(0);
        if variant.keeps_faces() && pixels * Room::of_progress(job) > room.limit {
            return None;
        }
        let uniform = VolumeUniform::new(job, &grids, &cut);
        let (of_layers, coarser) = levels(job, room, store, means)?;
        let digits = (u32::BITS - uniform.bin_count.leading_zeros()).div_ceil(super::constants::DIGIT_BITS);

        // Per slab only what reaches into what it fills (F12 5.7.1).
        let of_column = items.len() / column_count;
        let listed = |column: usize| {
            let own = &items[column * of_column..(column + 1) * of_column];
            DrawList::parts((view.eye, view.time), own, arena, job.stride)
        };
        let mut lists: Vec<(DrawList, Vec<PartToDraw>)> = (0..column_count).map(listed).collect();
        let reaches: Vec<Reach> = shown.extents.iter().map(|extent| Reach::of(job, extent)).collect();
        let filled = cut.filled();
        let mut batches_of: Vec<Vec<Vec<DrawBatch>>> = Vec::with_capacity(cut.slabs.len());
        for layers in &filled {
            let ends: Vec<Option<[f32; 2]>> =
                grids.iter().zip(layers).map(|(grid, layers)| ends(grid, layers)).collect();
            let overlaps = |part: &&PartToDraw| reaches.get(part.item).is_none_or(|reach| reach.is_within(&ends));
            batches_of.push(match job.field() {
                Some(_) => Vec::new(),
                None => {
                    let batched = |(list, parts): &mut (DrawList, Vec<PartToDraw>)| {
                        list.cut(parts.iter().filter(overlaps), room.batch)
                    };
                    lists.iter_mut().map(batched).collect()
                }
            });
        }
        let all_batches = || batches_of.iter().flatten().flatten();
        let most = |number: fn(&DrawBatch) -> u32| all_batches().map(number).max().unwrap_or(0).max(1);
        let most_places = u64::from(most(|batch| batch.places));
        let most_turns = most(|batch| batch.places).div_ceil(variant.turn());

        let held = lists.iter().enumerate();
        let particles: Vec<Particles> =
            held.map(|(column, (list, _))| Particles::new(view, job, (column, list), store, means)).collect();
        let (mut slabs, mut portions) = (Vec::new(), Vec::new());
        for (pane_index, pane) in panes.iter().enumerate() {
            let origins = cut.origins(&pane.window);
            for (index, ((slab, layers), columns)) in cut.slabs.iter().zip(&filled).zip(&batches_of).enumerate() {
                let own = layers[0].clone();
                let bricks: Vec<u32> =
                    cut.tiers.iter().zip(layers).map(|(tier, layers)| tier.columns() * layers.len() as u32).collect();
                let mut tiers = [TierPortion::default(); MOST_TIERS];
                for (((out, layers), origin), grid) in tiers.iter_mut().zip(layers).zip(&origins).zip(&grids) {
                    *out = TierPortion::new(*origin, layers, ends(grid, layers).unwrap_or_default());
                }
                let first_portion = portions.len();
                let whole = Portion {
                    origin: pane.window.origin,
                    first_pixel: pane.pixels[0],
                    behind_pixel: pane.pixels[1],
                    rows: job.view.width,
                    brick_rows: cut.finest().bricks[0],
                    first_layer: own.start,
                    layers: own.len() as u32,
                    first_step: slab.steps.start,
                    behind_step: slab.steps.end,
                    candidates: 0,
                    opening: 1,
                    bricks: bricks.iter().sum(),
                    unused: 0,
                    tiers,
                };
                for (number, batch) in columns.iter().flat_map(|batches| batches.iter().enumerate()) {
                    let opening = u32::from(number == 0);
                    portions.push(Portion { candidates: batch.places, opening, ..whole });
                }
                let mut runs = Vec::new();
                if job.field().is_some() {
                    portions.push(whole);
                    for run in runs::runs(&of_layers, own.clone()) {
                        let count = cut.finest().columns() * run.layers.len() as u32;
                        let mut tiers = whole.tiers;
                        tiers[0] =
                            TierPortion::new(origins[0], &run.layers, ends(&grids[0], &run.layers).unwrap_or_default());
                        portions.push(Portion { bricks: count, tiers, ..whole });
                        runs.push(FieldRun { level: run.level, bricks: count });
                    }
                }
                let bound = |particles: &Particles, batch: &DrawBatch| Batch {
                    loaded: batch.ranges.iter().map(|range| particles.bind(range, arena, device, cache)).collect(),
                    candidates: batch.places,
                    turns: batch.places.div_ceil(variant.turn()).max(1),
                };
                let all_bound = |(batches, particles): (&Vec<DrawBatch>, &Particles)| {
                    batches.iter().map(|batch| bound(particles, batch)).collect::<Vec<Batch>>()
                };
                slabs.push(SlabWork {
                    columns: columns.iter().zip(&particles).map(all_bound).collect(),
                    runs,
                    first_portion,
                    layers: own.len() as u32,
                    bricks,
                    pane: pane_index,
                    opens: index == 0,
                    closes: index + 1 == cut.slabs.len(),
                });
            }
        }

        let is_finest = |level: &&usize| of_layers.first() == Some(*level);
        let finest_slices = BRICK * of_layers.iter().take_while(is_finest).count() as u32;
        let wanted = Wanted {
            job,
            variant,
            cut: &cut,
            grids: &grids,
            uniform: &uniform,
            portions,
            places: &places,
            readers: &readers,
            pixels,
            particles: u64::from(most(|batch| batch.particles)),
            candidates: most_places,
            turns: most_turns,
            digits,
            levels: &of_layers.iter().copied().collect(),
            finest_slices,
        };
        let Bindings { groups, buffers, one, target, answer } = Bindings::new(wanted, store, means);
        Some(Work {
            job: job.clone(),
            items: Arc::clone(items),
            nodes: lists.into_iter().flat_map(|(list, _)| list.nodes).collect(),
            generation: arena.generation,
            variant,
            cut,
            panes,
            slabs,
            digits,
            bin_count: uniform.bin_count,
            groups,
            buffers,
            target,
            answer: Some(answer),
            one,
            coarser,
            done: AtomicUsize::new(0),
        })
    }

    /// Whether this is the job, and the particles still lie where the bindings say.
    pub fn is_current(&mut self, job: &VolumeJob, view: &View, items: &Arc<[DrawItem]>, arena: &Arena) -> bool {
        self.job.is_same(job) && Arc::ptr_eq(&self.items, items) && self.is_intact(view, arena)
    }

    /// Whether it has filled the Cartesian grid of another picture's job.
    pub fn holds_grid_of(&mut self, job: &VolumeJob, attribute: bool, items: &Arc<[DrawItem]>, arena: &Arena) -> bool {
        let (Shows::Cartesian(known), Shows::Cartesian(wanted)) = (&self.job.shows, &job.shows) else { return false };
        let fades = job.view.cut.fade_rate != 0.0;
        // The same picture once more is drawn from the beginning: somebody measures it.
        !Arc::ptr_eq(known, wanted)
            && self.is_complete()
            && known.lattice == wanted.lattice
            && (known.view == wanted.view || !fades)
            && self.job.view == job.view
            && self.job.options == job.options
            && self.variant.attribute == attribute
            && Arc::ptr_eq(&self.items, items)
            && self.is_intact(&job.view, arena)
    }

    /// Leaves out what fills the grid: a picture before has done it.
    pub fn keep_grid(&mut self) {
        let last = self.slabs.pop();
        self.slabs = last.into_iter().map(|last| SlabWork { columns: Vec::new(), opens: false, ..last }).collect();
    }

    /// Whether all of its particles, and no others of its list, lie where the bindings say.
    pub fn is_intact(&mut self, view: &View, arena: &Arena) -> bool {
        if self.generation != arena.generation {
            let (list, _) =
                DrawList::parts((self.job.camera(view).eye, view.time), &self.items, arena, self.job.stride);
            if list.nodes != self.nodes {
                return false;
            }
            self.generation = arena.generation;
        }
        true
    }
}

/// The level that each layer of bricks of a field is filled from, once these are on the adapter, and by how many levels they are coarser
/// than they would be but for want of memory; no levels without a field. `None` where there is no room.
fn levels(job: &VolumeJob, room: &Room, store: &mut Store, means: &Means<'_>) -> Option<(Vec<usize>, Option<usize>)> {
    let Some(picture) = job.field() else { return Some((Vec::new(), None)) };
    let wanted = runs::levels(&picture.field, &job.grid);
    let all: BTreeSet<usize> = wanted.iter().copied().collect();
    let source = (&picture.field, picture.hue);
    let finest: Finest =
        HeldSamples::load(&mut store.samples, source, &all, room.samples, (means.device, means.queue))?;
    let coarser = Some(finest.missing(&all)).filter(|missing| *missing > 0);
    Some((wanted.into_iter().map(|level| finest.in_place_of(level)).collect(), coarser))
}

/// An upper bound of the smoothing lengths of a job's particles in cells of its grid.
fn widest(job: &VolumeJob, extents: &[Extent]) -> f32 {
    let grown = extents.iter().map(|extent| with_growth(job, extent));
    let seen: Vec<Extent> = seen(&job.view, grown, job.options.smallest * job.grid.sigma).collect();
    extents::widest(&job.view, &seen, job.grid.sigma)
}

/// An extent whose particles are as large as the job draws them.
fn with_growth(job: &VolumeJob, extent: &Extent) -> Extent {
    Extent { margin: extent.margin * growth(job.stride as usize), ..*extent }
}

/// Depths of the centres of the first and the last slice of layers of a tier; `None` without any.
fn ends(brick_grid: &BrickGrid, layers: &Range<u32>) -> Option<[f32; 2]> {
    let last = (layers.end * BRICK).checked_sub(1).filter(|_| !layers.is_empty())?;
    Some([(layers.start * BRICK) as usize, last as usize].map(|slice| brick_grid.depth[slice]))
}

/// Where the particles within an extent may show.
struct Reach {
    /// Between these depths, those that the grid enlarges included.
    depths: [f64; 2],
    /// Tiers that they may belong to.
    tiers: usize,
}

impl Reach {
    fn of(job: &VolumeJob, extent: &Extent) -> Reach {
        let nearest = job.view.nearest_depth(extent);
        let farthest = 2.0 * job.view.to_camera(extent.bounds.center()).z - nearest;
        let grown = with_growth(job, extent);
        let margin = |depth: f64| {
            let enlarged = job.options.smallest * job.grid.spacing(depth.max(0.0));
            grown.margin.max(enlarged)
        };
        // A little more than what is compared, for what rounding makes of particles.
        let cells = 1.001 * extents::widest(&job.view, &[grown], job.grid.sigma);
        let enlarged = 1.001 * job.options.smallest as f32;
        let tiers = coarse::levels_of(cells.max(enlarged), MOST_TIERS);
        Reach { depths: [nearest - margin(farthest), farthest + margin(farthest)], tiers }
    }

    /// Whether they may reach between the ends of what is filled of some tier.
    fn is_within(&self, ends: &[Option<[f32; 2]>]) -> bool {
        let [from, to] = self.depths;
        let mut ends = ends.iter().take(self.tiers).flatten();
        ends.any(|[near, far]| from <= f64::from(*far) && to >= f64::from(*near))
    }
}

/// What loads particles.
struct Particles {
    view: Held,
    nodes: Held,
    blocks: Held,
    tables: Option<Buffer>,
}

impl Particles {
    /// Those of a list for a column.
    fn new(
        view: &View,
        job: &VolumeJob,
        (column, list): (usize, &DrawList),
        store: &mut Store,
        means: &Means<'_>,
    ) -> Particles {
        let own = 2 * column + usize::from(matches!(job.shows, Shows::Ranges));
        let kernel = Footprint::Kernel(job.options.kernel);
        // The camera alone counts, and what it leaves out.
        let uniform = Grids::new(view, kernel, true, 0.0, false).uniform;
        let uniform = match job.cartesian() {
            Some(picture) => uniform.fading_for(view, &picture.view),
            None => uniform,
        };
        let Means { device, queue, arena, .. } = *means;
        let mut put = |name, bytes: &[u8]| store.holding(device, queue, name, own, bytes);
        Particles {
            view: put("deepfield volume camera", bytemuck::bytes_of(&uniform)),
            nodes: put("deepfield volume nodes", bytemuck::cast_slice(&list.nodes)),
            blocks: put("deepfield volume blocks", bytemuck::cast_slice(&list.blocks)),
            tables: arena.table_buffer().cloned(),
        }
    }

    fn bind(
        &self,
        range: &crate::gpu::splat::draw_list::BlockRange,
        arena: &Arena,
        device: &RenderDevice,
        cache: &PipelineCache,
    ) -> Loaded {
        let (offset, bytes) = range.bytes();
        let tables = self.tables.as_ref().unwrap_or(&self.nodes.buffer);
        let entries = BindGroupEntries::sequential((
            self.view.binding(),
            self.nodes.binding(),
            slice(&self.blocks.buffer, offset, bytes),
            arena.chunk(range.chunk).as_entire_binding(),
            arena.chunk(range.chunk).as_entire_binding(),
            tables.as_entire_binding(),
        ));
        let layout = cache.get_bind_group_layout(&particle_layout());
        Loaded {
            particles: device.create_bind_group("deepfield volume particles", &layout, &entries),
            workgroups: workgroups(range.blocks as u32),
        }
    }
}
