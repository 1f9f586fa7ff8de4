//! What one picture binds: its particles, tables and work space on the adapter.

use super::constants::{BIN_GROUP, DIGITS, HEADER, SCAN_GROUP, SORT_BLOCK, TURN};
use super::cut::{Cut, Window};
use super::draw::{Picture, Room};
use super::layout::{self, MOST_BINS, Portion, Turn, VolumeUniform};
use super::programs::{Kind, Programs};
use super::store::{Held, Store};
use crate::cpu::volume::bricks::BORDER;
use crate::cpu::volume::raycast;
use bevy::render::render_resource::{BindGroup, BindGroupEntry};
use rayon::prelude::*;

/// Uniforms of a list begin at multiples of this.
const STRIDE: usize = 256;
/// Words of `work` and of `dispatch`.
const WORK_WORDS: u64 = 8;
/// Where `work` has the workgroups of the sorting, bytes.
pub const SORT_GROUPS: u64 = 8;
/// Where `work` has the number of pairs of all slabs, bytes.
pub const ALL_PAIRS: u64 = 20;
/// Where `dispatch` has the workgroups of crowded bricks, bytes.
pub const CROWDED: u64 = 12;
/// Where `dispatch` has the number of bricks of all slabs, bytes.
pub const ALL_BRICKS: u64 = 24;

/// One batch of particles.
pub struct Batch {
    /// Number of its particles.
    pub particles: u32,
    /// Bindings of [`Kind::Bin`].
    pub bin: BindGroup,
    /// Bindings of [`Kind::Gather`].
    pub gather: BindGroup,
}

/// Buffers and bindings.
pub struct Inputs {
    /// What all passes read.
    pub uniform: VolumeUniform,
    /// What those of one slab and batch read, for a window.
    pub portions: Held,
    /// The batches, one at least.
    pub batches: Vec<Batch>,
    /// Digits that pairs are sorted by.
    pub digits: u32,
    /// Turns that the most crowded brick may take.
    pub turns: u32,
    /// Bindings of [`Kind::Scan`] over bins, over the pairs of workgroups, over digits.
    pub scans: [BindGroup; 3],
    /// Bindings of [`Kind::Sort`], for even and odd digits.
    pub sorts: [BindGroup; 2],
    /// Bindings of [`Kind::Plan`].
    pub plan: BindGroup,
    /// Bindings of [`Kind::Occlusion`].
    pub occlusion: BindGroup,
    /// Bindings of [`Kind::Raycast`].
    pub raycast: BindGroup,
    /// Number of particles of each bin, and so on; see the shaders.
    pub bins: Held,
    /// The list of bricks.
    pub items: Held,
    /// The largest density of each part of each brick.
    pub densest: Held,
    /// What is hidden.
    pub hidden: Held,
    /// Light and opacity.
    pub rays: Held,
    /// Shares of cells.
    pub progress: Held,
    /// Number of columns that somebody sees.
    pub visible: Held,
    /// Numbers of pairs and blocks.
    pub work: Held,
    /// Numbers of bricks.
    pub dispatch: Held,
}

/// The offset of an entry of a list of uniforms.
pub fn offset(entry: usize) -> u32 {
    (entry * STRIDE) as u32
}

/// Uniforms, each at its offset.
pub fn strided<T: bytemuck::Pod>(entries: impl IntoIterator<Item = T>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for entry in entries {
        bytes.extend_from_slice(bytemuck::bytes_of(&entry));
        bytes.resize(bytes.len().next_multiple_of(STRIDE), 0);
    }
    bytes
}

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

impl Picture<'_> {
    /// The windows that have pixels, and what all passes read of pixels: places of columns and rows, readers of bricks.
    pub fn panes(&self, cut: &Cut) -> (Vec<Pane>, Vec<[u32; 2]>, Vec<[i32; 2]>) {
        let grid = &self.prepared.grid;
        let places = [self.view.width, self.view.height].map(|pixels| raycast::places(grid, pixels));
        let brick = super::constants::BRICK as usize;
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
            (0..bricks).map(move |index| {
                raycast::readers(places, index * brick..(index + 1) * brick).map(|pixel| pixel as i32)
            })
        };
        let readers = readers(0).chain(readers(1)).collect();
        (panes, layout::places(&places[0], &places[1]), readers)
    }

    /// Uploads what the passes read but for portions, and makes room for these and for what they write.
    pub fn inputs(
        &self,
        programs: &Programs,
        store: &mut Store,
        room: &Room,
        cut: &Cut,
        portions: usize,
        (largest_pane, places, readers): (u64, &[[u32; 2]], &[[i32; 2]]),
    ) -> Inputs {
        let (device, queue) = (self.device, self.queue);
        let particles = &self.prepared.particles;
        let uniform = VolumeUniform::new(&self.prepared.grid, self.prepared.brick_grid(), self.scenery, cut);
        let digits = u32::BITS - uniform.bin_count.leading_zeros();
        let digits = digits.div_ceil(super::constants::DIGIT_BITS);
        let batch_size = room.batch.min(particles.len().max(1));
        let turns = batch_size.div_ceil(u64::from(TURN)) as u32;
        let turn = |number: u32| Turn { number, unused: [0; 3] };

        let mut put = |name, bytes: &[u8]| store.holding(device, queue, name, 0, bytes);
        let view = put("deepfield volume", bytemuck::bytes_of(&uniform));
        let turn_list = put("deepfield volume turns", &strided((0..turns.max(digits)).map(turn)));
        let depths = put("deepfield volume depths", bytemuck::cast_slice(&layout::depths(self.prepared.brick_grid())));
        let table = put("deepfield volume table", bytemuck::cast_slice(&layout::table(self.scenery)));
        let places = put("deepfield volume places", bytemuck::cast_slice(places));
        let readers = put("deepfield volume readers", bytemuck::cast_slice(readers));

        let mut make = |name, index, bytes| store.room(device, name, index, bytes);
        let portions = make("deepfield volume portions", 0, (portions * STRIDE) as u64);
        let pairs = MOST_BINS * batch_size;
        let bins = make("deepfield volume bins", 0, 4 * (u64::from(uniform.bin_count) + 1));
        let parts = (u64::from(uniform.bin_count) + 1).div_ceil(u64::from(SCAN_GROUP));
        let parts = make("deepfield volume parts", 0, 4 * parts);
        let sums = make("deepfield volume sums", 0, 4 * batch_size.div_ceil(u64::from(BIN_GROUP)));
        let digit_table = 4 * u64::from(DIGITS) * pairs.div_ceil(u64::from(SORT_BLOCK));
        let digit_table = make("deepfield volume digits", 0, digit_table);
        let keys = [0, 1].map(|side| make("deepfield volume keys", side, 4 * pairs));
        let listed = [0, 1].map(|side| make("deepfield volume pairs", side, 4 * pairs));
        let work = make("deepfield volume work", 0, 4 * WORK_WORDS);
        let dispatch = make("deepfield volume dispatch", 0, 4 * WORK_WORDS);
        let slab = u64::from(cut.columns()) * u64::from(cut.layers);
        let items = make("deepfield volume bricks", 0, 4 * (u64::from(HEADER) + 2 * slab));
        let field = make("deepfield volume field", 0, cut.bytes(particles.attribute));
        let densest = make("deepfield volume densest", 0, 4 * u64::from(self.variant().parts()) * cut.bricks());
        let reach = make("deepfield volume reach", 0, 4 * cut.bricks());
        let hidden = make("deepfield volume hidden", 0, 4 * u64::from(uniform.bin_count));
        let rays = make("deepfield volume rays", 0, 16 * largest_pane);
        let progress = make("deepfield volume progress", 0, 4 * largest_pane);
        let visible = make("deepfield volume visible", 0, 4);

        let group = |kind: Kind, list: &[bevy::render::render_resource::BindingResource<'_>]| {
            let entries: Vec<BindGroupEntry<'_>> = list
                .iter()
                .enumerate()
                .map(|(binding, resource)| BindGroupEntry { binding: binding as u32, resource: resource.clone() })
                .collect();
            device.create_bind_group(kind.shader(), &programs.layout(kind), &entries)
        };
        let all = || view.binding();
        let portion = || portions.part(size_of::<Portion>() as u64);
        let turn = || turn_list.part(size_of::<Turn>() as u64);
        // After an odd number of digits the pairs are on the other side.
        let sorted = &listed[digits as usize % 2];
        let scan =
            |list: &Held| group(Kind::Scan, &[all(), portion(), list.binding(), parts.binding(), work.binding()]);
        let sort = |side: usize| {
            let (from, to) = (side, 1 - side);
            let list = [
                turn(),
                work.binding(),
                keys[from].binding(),
                listed[from].binding(),
                keys[to].binding(),
                listed[to].binding(),
                digit_table.binding(),
            ];
            group(Kind::Sort, &list)
        };
        let scans = [scan(&bins), scan(&sums), scan(&digit_table)];
        let sorts = [sort(0), sort(1)];
        let plan = group(
            Kind::Plan,
            &[
                all(),
                portion(),
                bins.binding(),
                hidden.binding(),
                densest.binding(),
                items.binding(),
                dispatch.binding(),
            ],
        );
        let occlusion = group(
            Kind::Occlusion,
            &[
                all(),
                portion(),
                densest.binding(),
                reach.binding(),
                rays.binding(),
                readers.binding(),
                hidden.binding(),
                visible.binding(),
            ],
        );
        let raycast = group(
            Kind::Raycast,
            &[
                all(),
                portion(),
                depths.binding(),
                field.binding(),
                densest.binding(),
                reach.binding(),
                table.binding(),
                rays.binding(),
                progress.binding(),
                places.binding(),
            ],
        );
        let uploaded = self.upload(store, batch_size as usize);
        let batches = uploaded
            .iter()
            .map(|(count, spots, amounts)| Batch {
                particles: *count,
                bin: group(
                    Kind::Bin,
                    &[
                        all(),
                        portion(),
                        spots.binding(),
                        hidden.binding(),
                        bins.binding(),
                        sums.binding(),
                        keys[0].binding(),
                        listed[0].binding(),
                    ],
                ),
                gather: group(
                    Kind::Gather,
                    &[
                        all(),
                        portion(),
                        turn(),
                        spots.binding(),
                        amounts.binding(),
                        bins.binding(),
                        sorted.binding(),
                        items.binding(),
                        depths.binding(),
                        field.binding(),
                        densest.binding(),
                    ],
                ),
            })
            .collect();
        Inputs {
            uniform,
            portions: portions.clone(),
            batches,
            digits,
            turns,
            scans,
            sorts,
            plan,
            occlusion,
            raycast,
            bins,
            items,
            densest,
            hidden,
            rays,
            progress,
            visible,
            work,
            dispatch,
        }
    }

    /// The particles in batches: number, `spots`, `amounts`.
    fn upload(&self, store: &mut Store, batch: usize) -> Vec<(u32, Held, Held)> {
        let particles = &self.prepared.particles;
        let kernel = self.options.kernel;
        let all = || particles.chunks.par_iter().flat_map_iter(|chunk| chunk.iter());
        let (spots, amounts): (Vec<[f32; 4]>, Vec<[f32; 2]>) =
            all().map(|particle| layout::particle(particle, kernel)).unzip();
        let batches = spots.chunks(batch).zip(amounts.chunks(batch)).enumerate();
        let batches = batches.map(|(index, (spots, amounts))| {
            let mut put = |name, bytes: &[u8]| store.holding(self.device, self.queue, name, index, bytes);
            let places = put("deepfield volume spots", bytemuck::cast_slice(spots));
            (spots.len() as u32, places, put("deepfield volume amounts", bytemuck::cast_slice(amounts)))
        });
        batches.collect()
    }
}
