//! What the passes of a picture work in: buffers, and the bind groups over them.

use super::column::{self, ColumnUniform};
use super::constants::{BIN_GROUP, CELLS, DIGITS, HEADER, SCAN_GROUP, SORT_BLOCK};
use super::cut::Cut;
use super::field::layout::{FieldUniform, SlopeUniform, lines};
use super::layout::{self, MOST_BINS, MOST_TIERS, Portion, REACH_BYTES, Turn, VolumeUniform};
use super::march::{self, MarchUniform};
use super::programs::{Kind, Variant, matter_layout, slope_layout};
use super::room::Room;
use super::store::{Held, Store};
use super::view::{Shows, VolumeJob};
use super::work::Means;
use crate::cpu::volume::bricks::BrickGrid;
use crate::cpu::volume::range;
use crate::gpu::answer::Answer;
use crate::gpu::light;
use crate::gpu::matter::{self, LookupUniform};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntry, BindGroupLayoutDescriptor, BindingResource, Buffer, BufferId,
};
use std::collections::{BTreeMap, BTreeSet};

/// Uniforms of a list begin at multiples of this.
const STRIDE: usize = 256;
const _: () = assert!(size_of::<Portion>() <= STRIDE);
/// Words of `work` and of `dispatch`.
const WORK_WORDS: u64 = 12;
/// Where `work` has the workgroups of the sorting, bytes.
pub const SORT_GROUPS: u64 = 8;
/// Where `dispatch` has the workgroups of crowded bricks, bytes.
pub const CROWDED: u64 = 12;
/// Where `dispatch` has the workgroups of bricks that are interpolated, bytes.
pub const CHOSEN_GROUPS: u64 = 28;
/// Where `dispatch` has the number of bricks of all slabs, bytes.
pub const ALL_BRICKS: u64 = 24;
/// Bytes of the numbers at the beginning of what is read back of a picture.
pub const EFFORT: u64 = 12;
/// Bytes that each particle of a batch takes in what is shared by all slabs: keys and pairs, twice each, what is loaded and
/// where it reaches.
pub const BATCH_BYTES: u64 = 4 * 4 * MOST_BINS + 24 + REACH_BYTES + 8;

/// Bind groups that all slabs share.
pub struct Groups {
    /// Group 1 of [`Kind::Project`].
    pub project: BindGroup,
    /// [`Kind::Bin`].
    pub bin: BindGroup,
    /// [`Kind::Scan`] over bins, over the pairs of workgroups, over digits.
    pub scans: [BindGroup; 3],
    /// [`Kind::Sort`], for even and odd digits.
    pub sorts: [BindGroup; 2],
    /// What fills cells, of each column that is resampled by itself: one at least.
    pub filling: Vec<Filling>,
    /// [`Kind::Measure`]; of pictures there is none.
    pub measure: Option<BindGroup>,
    /// [`Kind::Occlusion`] and [`Kind::Raycast`], for pictures slab by slab.
    pub rays: Option<[BindGroup; 2]>,
    /// What surfaces of a sampled field face by.
    pub slopes: Option<BindGroup>,
    /// [`Kind::March`] and what matter is read from, for pictures of Cartesian grids.
    pub march: Option<[BindGroup; 2]>,
    /// [`Kind::Smooth`] from the first directions to the others, and back, for pictures that keep a surface for each pixel.
    pub smooth: Option<[BindGroup; 2]>,
    /// [`Kind::Field`] for each level that a field is read from.
    pub field: BTreeMap<usize, BindGroup>,
}

/// Bind groups of passes that fill cells.
pub struct Filling {
    /// [`Kind::Plan`].
    pub plan: BindGroup,
    /// [`Kind::Gather`].
    pub gather: BindGroup,
    /// [`Kind::Choose`].
    pub choose: BindGroup,
    /// [`Kind::Interpolate`].
    pub interpolate: BindGroup,
    /// [`Kind::Column`], for each thing that is read of a column.
    pub reads: Vec<BindGroup>,
}

/// Cells, and what is known of their bricks.
struct Cells {
    field: Held,
    densest: Held,
    marks: Held,
    bounds: Held,
}

/// Buffers that the encoder clears, copies or is told by.
pub struct Buffers {
    /// Number of particles of each bin.
    pub bins: Held,
    /// The list of bricks.
    pub items: Held,
    /// The cells.
    pub field: Held,
    /// The largest density of each part of each brick.
    pub densest: Held,
    /// The same of each column, where columns have cells of their own.
    pub columns: Vec<Held>,
    /// What is hidden.
    pub hidden: Held,
    /// Layers in which rays may meet something.
    pub reach: Held,
    /// Light and opacity of a pane.
    pub rays: Held,
    /// Shares of cells, or steps in which rays ended.
    pub progress: Held,
    /// Number of columns that somebody sees.
    pub visible: Held,
    /// Numbers of pairs and blocks.
    pub work: Held,
    /// Numbers of bricks.
    pub dispatch: Held,
    /// Mass of each class of values.
    pub masses: Held,
    /// Where the surface of each pixel lies, and its colour, of pictures that keep one.
    pub faces: [Held; 2],
}

impl Buffers {
    /// The buffers that hold all of a Cartesian grid.
    pub fn of_grid(&self) -> [BufferId; 2] {
        [&self.field, &self.densest].map(|held| held.buffer.id())
    }
}

/// What a picture binds.
pub struct Bindings {
    /// Bind groups.
    pub groups: Groups,
    /// Buffers.
    pub buffers: Buffers,
    /// The number 1.
    pub one: Held,
    /// Where the picture goes, `vec4<f32>` a pixel.
    pub target: Option<Buffer>,
    /// What is read back when it is complete: the masses of [`Shows::Ranges`]; of pictures [`EFFORT`] bytes of numbers, and the ends
    /// of all rays where occlusion is wanted.
    pub answer: Answer,
}

/// What a picture is made of, as far as its buffers ask.
pub struct Wanted<'a> {
    /// What is wanted.
    pub job: &'a VolumeJob,
    /// What is compiled into the shaders.
    pub variant: Variant,
    /// How the grid is cut.
    pub cut: &'a Cut,
    /// The grids of all tiers.
    pub grids: &'a [BrickGrid],
    /// What all passes read.
    pub uniform: &'a VolumeUniform,
    /// The batches of all slabs.
    pub portions: Vec<Portion>,
    /// Places of columns and rows of pixels.
    pub places: &'a [[u32; 2]],
    /// Pixels that read columns and rows of bricks.
    pub readers: &'a [[i32; 2]],
    /// Most pixels of a pane.
    pub pixels: u64,
    /// Most particles of a batch.
    pub particles: u64,
    /// Most places of particles of a batch.
    pub candidates: u64,
    /// Most turns of a batch.
    pub turns: u32,
    /// Digits that pairs are sorted by.
    pub digits: u32,
    /// Levels of a field that its bricks are filled from.
    pub levels: &'a BTreeSet<usize>,
    /// Slices that are filled from the finest of them.
    pub finest_slices: u32,
}

/// The offset of an entry of a list of uniforms.
pub fn offset(entry: usize) -> u32 {
    (entry * STRIDE) as u32
}

/// Uniforms, each at its offset.
fn strided<T: bytemuck::Pod>(entries: impl IntoIterator<Item = T>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for entry in entries {
        bytes.extend_from_slice(bytemuck::bytes_of(&entry));
        bytes.resize(bytes.len().next_multiple_of(STRIDE), 0);
    }
    bytes
}

impl Bindings {
    /// Takes what is wanted from a store.
    pub fn new(wanted: Wanted<'_>, store: &mut Store, means: &Means<'_>) -> Bindings {
        let Wanted { job, variant, cut, grids, uniform, portions, places, readers, .. } = wanted;
        let Wanted { pixels, particles, candidates, turns, digits, levels, finest_slices, .. } = wanted;
        let Means { device, queue, cache, .. } = *means;
        // What outlives a slab has a buffer for each kind of job, since both are on their way at the same time.
        let own = match job.shows {
            Shows::Light(_) | Shows::Columns(_) | Shows::Cartesian(_) | Shows::Field(_) => 0,
            Shows::Ranges => 1,
        };
        let mut put = |name, index, bytes: &[u8]| store.holding(device, queue, name, index, bytes);
        let all = put("deepfield volume", own, bytemuck::bytes_of(uniform));
        // Of a column everything is wanted: what shows depends on the others too.
        let open = job.columns().map(|_| VolumeUniform { least: 0.0, ..*uniform });
        let open = open.map(|open| put("deepfield volume open", 0, bytemuck::bytes_of(&open)));
        let mut reads: Vec<(usize, Held)> = Vec::new();
        for (index, (column, uniform)) in job.columns().map_or(Vec::new(), ColumnUniform::all).iter().enumerate() {
            reads.push((*column, put("deepfield volume column", index, bytemuck::bytes_of(uniform))));
        }
        let one = put("deepfield volume one", 0, bytemuck::bytes_of(&1u32));
        let portions = put("deepfield volume portions", own, &strided(portions));
        let turn = |number: u32| Turn { number, unused: [0; 3] };
        let turns =
            put("deepfield volume turns", own, &strided((0..turns.max(digits).max(MOST_TIERS as u32)).map(turn)));
        let depths = put("deepfield volume depths", own, bytemuck::cast_slice(&layout::depths(grids)));
        let places = put("deepfield volume places", own, bytemuck::cast_slice(places));
        let readers = put("deepfield volume readers", own, bytemuck::cast_slice(readers));
        let table = job.scenery().map(|scenery| matter::table(&scenery.classifier));
        let table = table.map(|table| put("deepfield volume table", 0, bytemuck::cast_slice(&table)));
        let march = job.cartesian().map(|picture| {
            let lookup = LookupUniform::new(&picture.scenery.classifier);
            [
                put("deepfield volume march", 0, bytemuck::bytes_of(&MarchUniform::new(picture))),
                put("deepfield volume lookup", 0, bytemuck::bytes_of(&lookup)),
            ]
        });
        let sampled = job.field().map(|picture| {
            let lines = lines(&job.view, &job.grid, &picture.field);
            let lines = put("deepfield volume lines", 0, bytemuck::cast_slice(&lines));
            let mut of_level = |&level: &usize| {
                let uniform = FieldUniform::new(&job.view, &picture.field, level, &picture.axis);
                (level, put("deepfield volume level", level, bytemuck::bytes_of(&uniform)))
            };
            let uniforms: Vec<(usize, Held)> = levels.iter().map(&mut of_level).collect();
            (lines, uniforms)
        });
        let facing = job.field().zip(levels.first()).filter(|_| variant.has_slopes()).map(|(picture, &level)| {
            let finest = (level, finest_slices);
            let uniform = SlopeUniform::new(&job.view, &job.grid, &picture.field, &picture.axis, finest);
            (level, put("deepfield volume slopes", 0, bytemuck::bytes_of(&uniform)))
        });
        let rooms: u32 = job.cartesian().map_or(0, |picture| march::rooms(picture).iter().product());

        let mut make = |name, index, bytes| store.room(device, name, index, bytes);
        let spots = make("deepfield volume spots", 0, 16 * candidates);
        let amounts = make("deepfield volume amounts", 0, 8 * candidates);
        let pairs = MOST_BINS * particles;
        let reached = make("deepfield volume reached", 0, REACH_BYTES * candidates);
        let bins = make("deepfield volume bins", 0, 4 * (u64::from(uniform.bin_count) + 1));
        let parts = (u64::from(uniform.bin_count) + 1).div_ceil(u64::from(SCAN_GROUP));
        let parts = make("deepfield volume parts", 0, 4 * parts);
        let sums = make("deepfield volume sums", 0, 4 * candidates.div_ceil(u64::from(BIN_GROUP)));
        let digit_table = 4 * u64::from(DIGITS) * pairs.div_ceil(u64::from(SORT_BLOCK));
        let digit_table = make("deepfield volume digits", 0, digit_table);
        let keys = [0, 1].map(|side| make("deepfield volume keys", side, 4 * pairs));
        let listed = [0, 1].map(|side| make("deepfield volume pairs", side, 4 * pairs));
        let work = make("deepfield volume work", 0, 4 * WORK_WORDS);
        let dispatch = make("deepfield volume dispatch", 0, 4 * WORK_WORDS);
        // Those that are gathered and the crowded ones of them; later those that are interpolated, two words each.
        let room_of_items = 2 * u64::from(uniform.brick_room) + 2 * u64::from(cut.finest().columns());
        let items_held = make("deepfield volume bricks", 0, 4 * (u64::from(HEADER) + room_of_items));
        let mut cells = |index: usize, bytes: u64| Cells {
            field: make("deepfield volume field", index, bytes),
            densest: make("deepfield volume densest", index, 4 * u64::from(variant.parts()) * cut.bricks()),
            marks: make("deepfield volume marks", index, 8 * cut.bricks()),
            bounds: make("deepfield volume bounds", index, 4 * cut.bricks()),
        };
        let of_columns = 4 * u64::from(column::VALUES * CELLS) * cut.finest().bricks_held();
        let shown = cells(own, if variant.columns { of_columns } else { cut.bytes(variant.attribute) });
        // Those of columns come behind those of both kinds of jobs.
        let count = job.columns().map_or(0, |march| march.columns.len());
        let columns: Vec<Cells> = (0..count).map(|column| cells(2 + column, cut.bytes(variant.attribute))).collect();
        let Cells { field, densest, .. } = &shown;
        let reach = make("deepfield volume reach", own, 8 * u64::from(cut.finest().columns()));
        let hidden = make("deepfield volume hidden", own, 4 * u64::from(uniform.bin_count));
        let visible = make("deepfield volume visible", own, 4);
        let rooms = make("deepfield volume rooms", own, 4 * u64::from(rooms));
        let pixels = if job.is_cast() { pixels } else { 0 };
        let rays = make("deepfield volume rays", own, 16 * pixels);
        let progress = make("deepfield volume progress", own, Room::of_progress(job) * pixels);
        let masses = make("deepfield volume masses", own, if own == 1 { 8 * range::CLASSES as u64 } else { 0 });

        let size = [job.seen_from().width, job.seen_from().height];
        let all_pixels = if variant.keeps_faces() { u64::from(size[0]) * u64::from(size[1]) } else { 0 };
        let [points, tints] =
            ["deepfield volume points", "deepfield volume tints"].map(|name| make(name, own, 16 * all_pixels));
        let normals = [0, 1].map(|side| make("deepfield volume normals", 2 * own + side, 16 * all_pixels));
        let target = job.scenery().map(|_| light::cells(None, size, device).buffer);

        let group_of = |layout: &BindGroupLayoutDescriptor, list: &[BindingResource<'_>]| {
            let entries: Vec<BindGroupEntry<'_>> = list
                .iter()
                .enumerate()
                .map(|(binding, resource)| BindGroupEntry { binding: binding as u32, resource: resource.clone() })
                .collect();
            device.create_bind_group(&*layout.label, &cache.get_bind_group_layout(layout), &entries)
        };
        let group = |kind: Kind, list: &[BindingResource<'_>]| group_of(&kind.layout(), list);
        let portion = || portions.part(size_of::<Portion>() as u64);
        let turn = || turns.part(size_of::<Turn>() as u64);
        // After an odd number of digits the pairs are on the other side.
        let sorted = &listed[digits as usize % 2];
        let scan = |list: &Held| {
            let bound = [all.binding(), portion(), list.binding(), parts.binding(), work.binding()];
            group(Kind::Scan, &bound)
        };
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
        let bin = [
            all.binding(),
            portion(),
            spots.binding(),
            hidden.binding(),
            bins.binding(),
            sums.binding(),
            keys[0].binding(),
            listed[0].binding(),
            reached.binding(),
            work.binding(),
        ];
        let filling = |cells: &Cells, reads: Vec<BindGroup>| {
            let Cells { field, densest, marks, bounds } = cells;
            let plan = [
                all.binding(),
                portion(),
                bins.binding(),
                hidden.binding(),
                densest.binding(),
                items_held.binding(),
                dispatch.binding(),
            ];
            let gather = [
                all.binding(),
                portion(),
                turn(),
                spots.binding(),
                amounts.binding(),
                bins.binding(),
                sorted.binding(),
                items_held.binding(),
                depths.binding(),
                field.binding(),
                densest.binding(),
            ];
            let choose = [
                open.as_ref().unwrap_or(&all).binding(),
                portion(),
                turn(),
                hidden.binding(),
                densest.binding(),
                marks.binding(),
                items_held.binding(),
                dispatch.binding(),
                bounds.binding(),
            ];
            let interpolate =
                [all.binding(), portion(), turn(), items_held.binding(), field.binding(), densest.binding()];
            Filling {
                plan: group(Kind::Plan, &plan),
                gather: group(Kind::Gather, &gather),
                choose: group(Kind::Choose, &choose),
                interpolate: group(Kind::Interpolate, &interpolate),
                reads,
            }
        };
        let filling_of = |(column, cells): (usize, &Cells)| {
            let read = |(_, uniform): &(usize, Held)| {
                let bound = [
                    all.binding(),
                    portion(),
                    uniform.binding(),
                    cells.field.binding(),
                    cells.densest.binding(),
                    field.binding(),
                    densest.binding(),
                ];
                group(Kind::Column, &bound)
            };
            filling(cells, reads.iter().filter(|(of, _)| *of == column).map(read).collect())
        };
        let measure = || {
            let list =
                [all.binding(), portion(), depths.binding(), field.binding(), densest.binding(), masses.binding()];
            group(Kind::Measure, &list)
        };
        let rays_groups = |table: &Held| {
            let occlusion = [
                all.binding(),
                portion(),
                densest.binding(),
                reach.binding(),
                rays.binding(),
                readers.binding(),
                hidden.binding(),
                visible.binding(),
            ];
            let raycast = [
                all.binding(),
                portion(),
                depths.binding(),
                field.binding(),
                densest.binding(),
                reach.binding(),
                table.binding(),
                rays.binding(),
                progress.binding(),
                places.binding(),
            ];
            [group(Kind::Occlusion, &occlusion), group(Kind::Raycast, &raycast)]
        };
        let march_groups = |(([march, lookup], table), target): ((&[Held; 2], &Held), &Buffer)| {
            let bound = [
                all.binding(),
                march.binding(),
                field.binding(),
                densest.binding(),
                rooms.binding(),
                target.as_entire_binding(),
            ];
            [group(Kind::March, &bound), group_of(&matter_layout(), &[lookup.binding(), table.binding()])]
        };
        let smooth_groups = |target: &Buffer| {
            [0, 1].map(|side: usize| {
                let bound = [
                    all.binding(),
                    portion(),
                    progress.binding(),
                    points.binding(),
                    tints.binding(),
                    normals[side].binding(),
                    normals[1 - side].binding(),
                    target.as_entire_binding(),
                ];
                group(Kind::Smooth, &bound)
            })
        };
        let mut of_levels = BTreeMap::new();
        for (lines, (level, uniform)) in
            sampled.iter().flat_map(|(lines, uniforms)| uniforms.iter().map(move |uniform| (lines, uniform)))
        {
            let (Some(picture), Some(held)) = (job.field(), store.samples.as_mut()) else { continue };
            let Some([shown, hues]) = held.of_level(*level) else { continue };
            let Some(most) = held.places(*level, &picture.axis, device) else { continue };
            let list = [
                all.binding(),
                portion(),
                uniform.binding(),
                lines.binding(),
                hidden.binding(),
                most.as_entire_binding(),
                items_held.binding(),
                field.binding(),
                densest.binding(),
                BindingResource::TextureView(&shown),
                BindingResource::TextureView(&hues),
            ];
            of_levels.insert(*level, group(Kind::Field, &list));
        }
        let slopes = facing.as_ref().and_then(|(level, uniform)| {
            let [shown, _] = store.samples.as_ref()?.of_level(*level)?;
            Some(group_of(&slope_layout(), &[uniform.binding(), BindingResource::TextureView(&shown)]))
        });
        let project = [all.binding(), spots.binding(), amounts.binding(), visible.binding()];
        let groups = Groups {
            project: group(Kind::Project, &project),
            bin: group(Kind::Bin, &bin),
            scans: [scan(&bins), scan(&sums), scan(&digit_table)],
            sorts: [sort(0), sort(1)],
            filling: match columns.is_empty() {
                true => vec![filling(&shown, Vec::new())],
                false => columns.iter().enumerate().map(filling_of).collect(),
            },
            measure: (own == 1).then(measure),
            rays: table.as_ref().filter(|_| march.is_none()).map(rays_groups),
            slopes,
            march: march.as_ref().zip(table.as_ref()).zip(target.as_ref()).map(march_groups),
            smooth: target.as_ref().filter(|_| variant.keeps_faces()).map(smooth_groups),
            field: of_levels,
        };
        let buffers = Buffers {
            bins,
            items: items_held,
            field: field.clone(),
            densest: densest.clone(),
            columns: columns.iter().map(|cells| cells.densest.clone()).collect(),
            hidden,
            reach,
            rays,
            progress,
            visible,
            work,
            dispatch,
            masses,
            faces: [points, tints],
        };
        let answer_bytes = match job.shows {
            Shows::Light(_) | Shows::Columns(_) | Shows::Cartesian(_) | Shows::Field(_) => {
                EFFORT + if job.reads_ends() { 4 * u64::from(size[0]) * u64::from(size[1]) } else { 0 }
            }
            Shows::Ranges => 8 * range::CLASSES as u64,
        };
        let answer = Answer::new(answer_bytes, "deepfield volume answer", device);
        Bindings { groups, buffers, one, target, answer }
    }
}
