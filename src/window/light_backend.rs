//! Drawing modes of light with the adapter: the data camera gets the same list of nodes as for splats, and what its passes draw of it.
//!
//! Ranges of colours are found by the adapter too, from a sketch of the field, before the picture is drawn with them. While the view
//! moves, pictures have fewer pixels and a sample of the particles; one that is on its way is completed before the next begins. Of fields of
//! attributes the processor finds the ranges ([`field_plans`]): at rest a picture waits for its own, in motion it has those before.

mod field_plans;

use super::cpu_backend::CpuPicture;
use super::exposure::Exposure;
use super::gpu_backend::GpuTables;
use super::listed::Listed;
use super::live::LiveParticles;
use super::live::copies::LiveCopies;
use super::look::{Held, Look};
use super::occlusion::Occlusion;
use super::pages::ViewSelection;
use super::pass_times::LastPasses;
use super::picture::{DataCamera, Picture};
use super::picture_sizes::{moving_ms, moving_size, volume_limit};
use super::preset::Preset;
use super::scene::Scene;
use super::shader_reload::ShaderTexts;
use super::state::notices::Notices;
use super::statistics::{ActiveBackend, Converged, Statistics};
use super::touring::Before;
use crate::color::transfer::{Levels, TransferFunction};
use crate::cpu::cartesian::CartesianOptions;
use crate::cpu::volume::attributes::Column;
use crate::cpu::volume::range::Sketch;
use crate::cpu::volume::{FieldRange, VolumeError};
use crate::gpu::measure::Measure;
use crate::gpu::tile_passes::TilePasses;
use crate::gpu::tiles::TileNews;
use crate::gpu::volume::{Shows, VolumeJob, VolumeNews};
use crate::gpu::{self, Composite, DrawItem, Fading, LightView, ModeView, ParticleScene, SplatView, VolumeView};
use crate::mode::{Adapter, LightPasses, LightPlan, Plan};
use crate::picture::Subject;
use crate::view::perspective_grid::GridError;
use crate::view::{Extent, View};
use bevy::prelude::*;
use field_plans::FieldPlans;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// After this time a picture is tried again with as many pixels as wanted.
const PATIENCE: Duration = Duration::from_secs(10);
/// Least time between two looks for ranges of a view that moves.
const MEASURE_EVERY: Duration = Duration::from_millis(300);

/// Fewer cells of a Cartesian grid along its longest side show nothing.
const LEAST_CELLS: u32 = 8;

/// Pictures that are remembered until they are complete.
const MOST_ASKED: usize = 64;
/// After this time a shader that has been written is in use.
const RELOAD: Duration = Duration::from_millis(500);

/// What a list was made for.
#[derive(Clone, Copy, PartialEq)]
struct ListKey {
    selection: u64,
    /// The state of live particles, if they are what is drawn.
    live: Option<u32>,
    limit: u64,
    /// The plan of fields that says which columns are drawn; 0 without.
    fields: u64,
}

/// What a picture was asked for with.
#[derive(Clone, PartialEq)]
struct PictureKey {
    list: ListKey,
    size: UVec2,
    /// Most cells of a Cartesian grid along its longest side, where memory is short.
    most_cells: Option<u32>,
    depiction: u64,
    transfer: TransferFunction,
    ranges: Option<FieldRange>,
}

/// A picture that the adapter draws.
enum Light {
    /// A volume, slab by slab.
    Volume(VolumeJob),
    /// By tiles: its number, from where, and by which passes.
    Tiles(u64, View, TilePasses),
}

impl Light {
    fn number(&self) -> u64 {
        match self {
            Light::Volume(job) => job.number,
            Light::Tiles(number, ..) => *number,
        }
    }
}

/// The pictures of light that the adapter draws.
#[derive(Resource, Default)]
pub(super) struct LightPictures {
    list: Option<ListKey>,
    items: Arc<[DrawItem]>,
    extents: Arc<[Extent]>,
    asked: Option<PictureKey>,
    /// The picture that was asked for last.
    light: Option<Light>,
    /// When pictures were asked for, and with how many pixels.
    began: VecDeque<(u64, Instant, UVec2)>,
    /// Pixels and milliseconds of the last complete one.
    last: Option<(UVec2, f64)>,
    levels: Option<Levels>,
    /// What ranges are looked for, and what was found last.
    sketch: Option<VolumeJob>,
    sketched: Option<(ListKey, Instant)>,
    ranges: Option<FieldRange>,
    /// What is drawn of fields of attributes.
    fields: FieldPlans,
    /// What could not be drawn.
    failed: Option<PictureKey>,
    /// Pixels are this many times as wide, since when.
    coarser: Option<(u32, Instant)>,
    /// Most cells of a Cartesian grid along its longest side that have turned out to fit, in so much memory and for this depiction.
    most_cells: Option<(u32, [u64; 2])>,
    /// When a shader was changed of which pictures may not have been drawn yet.
    reloaded: Option<Instant>,
    slabs: u32,
    /// How many particles are in the list.
    taken: u64,
    /// Counts jobs.
    number: u64,
    /// What has been told.
    told_coarser: bool,
    told_thinner: bool,
    told_cells: Option<u32>,
    seen: u64,
}

impl LightPictures {
    fn next(&mut self) -> u64 {
        self.number += 1;
        self.number
    }
}

/// Tells the data camera what light to draw.
pub(super) fn draw_light_on_gpu(
    mut commands: Commands,
    active: Res<ActiveBackend>,
    (particles, news, tile_news): (Res<ParticleScene>, Res<VolumeNews>, Res<TileNews>),
    (scene, look, held): (Option<Res<Scene>>, Option<Res<Look>>, Res<Held>),
    selection: Res<ViewSelection>,
    (live, mut copies): (Res<LiveParticles>, ResMut<LiveCopies>),
    (motion, preset, before, picture): (Res<CpuPicture>, Res<Preset>, Res<Before>, Res<Picture>),
    mut tables: ResMut<GpuTables>,
    mut pictures: ResMut<LightPictures>,
    (mut exposure, mut occlusion): (ResMut<Exposure>, ResMut<Occlusion>),
    (mut converged, mut statistics): (ResMut<Converged>, ResMut<Statistics>),
    last_passes: Res<LastPasses>,
    (mut notices, shaders): (ResMut<Notices>, Option<Res<ShaderTexts>>),
    camera: Single<(Entity, Option<&LightView>), With<DataCamera>>,
) {
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else { return };
    let is_mine = *active == ActiveBackend::Gpu && look.depiction.mode.technique.adapter() == Adapter::Light;
    let pictures = &mut *pictures;
    if !is_mine {
        if pictures.list.is_some() {
            (statistics.slabs, statistics.work_bytes) = (None, 0);
            *pictures = LightPictures { number: pictures.number, ..default() };
            copies.note_pictures(None);
        }
        return;
    }
    if statistics.backend != "compute" {
        "compute".clone_into(&mut statistics.backend);
    }
    let (entity, shown) = camera.into_inner();
    let metadata = scene.metadata();
    if tables.follow(&particles, &look, &scene) {
        commands.entity(entity).remove::<(Composite, Measure, ModeView)>();
        *pictures = LightPictures { number: pictures.number, ..default() };
    }
    if shaders.is_some_and(|shaders| shaders.is_changed() && !shaders.is_added()) {
        pictures.reloaded = Some(Instant::now());
    }
    // The render world takes a moment to hear of it.
    if pictures.reloaded.is_some_and(|since| since.elapsed() > RELOAD) {
        (pictures.reloaded, pictures.asked) = (None, None);
    }
    let found = news.now();
    if found.ranges.is_some_and(|(number, _)| pictures.sketch.as_ref().is_some_and(|job| job.number == number)) {
        pictures.ranges = found.ranges.and_then(|(_, range)| range);
        pictures.sketch = None;
    }
    if found.no_room.is_some() && found.no_room == pictures.sketch.as_ref().map(|job| job.number) {
        pictures.sketch = None;
        notices.error("the graphics memory is too small for the ranges of this volume's colours");
    }

    // What is drawn, of how many particles, with how many pixels.
    let moving = motion.is_moving(&preset.motion);
    let full = picture.size();
    let draws_own = live.is_shown();
    let limit = match draws_own {
        true => u64::MAX,
        false => volume_limit(moving, true, statistics.particles, &preset.motion),
    };
    let given = held.0.filter(|levels| levels.p[0] > 0.0 && levels.p[0] < levels.p[1]);
    let transfer = given.map_or_else(|| look.transfer.clone(), |levels| look.transfer.clone().with_levels(&levels));
    let draws_fields = look.depiction.draws_fields();
    if draws_fields {
        pictures.fields.follow((&scene, &look, &transfer), (view, &selection, limit));
    }
    let list = ListKey {
        selection: selection.revision,
        limit,
        live: draws_own.then(|| copies.number()),
        fields: pictures.fields.number(),
    };
    // What was drawn before stays as it is until it is known what is drawn next.
    let awaits_fields = draws_fields && (pictures.fields.plan().is_none() || !moving && !pictures.fields.is_current());
    let columns: &[Column] = if draws_fields { pictures.fields.columns() } else { &[Column::Attribute] };
    if pictures.list != Some(list) && !awaits_fields && !columns.is_empty() {
        let Listed { items, extents, plan, taken } = match draws_own {
            true => copies.listed(&view, Plan::default()),
            false => tables.list(&selection, &look, &scene, (limit, Plan::default()), columns),
        };
        (pictures.items, pictures.extents, pictures.taken) = (items, extents, taken);
        pictures.list = Some(list);
        statistics.sampled = (!plan.is_complete()).then_some(taken);
    }
    let frame_ms = moving_ms(&preset);
    let wanted_size = if moving { moving_size(full, pictures.last, frame_ms, &preset.motion) } else { full };
    if pictures.coarser.is_some_and(|(_, since)| since.elapsed() > PATIENCE) {
        pictures.coarser = None;
    }
    let size = match pictures.coarser {
        Some((factor, _)) => (wanted_size / factor).max(UVec2::ONE),
        None => wanted_size,
    };
    let memory = preset.residency.gpu_bytes()[1];
    let cells_known_for = [memory, look.depiction_revision];
    pictures.most_cells = pictures.most_cells.filter(|(_, known_for)| *known_for == cells_known_for);
    let drawn_view = view.resized(size.x, size.y);
    let subject = Subject::new(metadata, &look.depiction, &transfer, scene.frame.size().length());
    let seen = |extents: &[Extent]| -> Vec<Extent> {
        extents.iter().filter_map(|extent| extent.within(&view.cut.bounds)).collect()
    };

    // Ranges are looked for once for each list, and not too often while it changes in every frame.
    let mut wants_ranges = None;
    let key = PictureKey {
        list,
        size,
        most_cells: pictures.most_cells.map(|(cells, _)| cells),
        depiction: look.depiction_revision,
        transfer: transfer.clone(),
        ranges: pictures.ranges,
    };
    let asked_before = pictures.asked.as_ref() == Some(&key) || pictures.failed.as_ref() == Some(&key);
    let plan = if asked_before && !moving {
        None
    } else if draws_fields {
        pictures.fields.plan().cloned().map(|plan| plan.map(Some))
    } else {
        let known = pictures.ranges;
        Some(subject.light(&drawn_view, &mut |options| {
            wants_ranges = Some(*options);
            known.ok_or(VolumeError::Grid(GridError::NothingInView))
        }))
    };
    if let Some(options) = wants_ranges {
        let stale = pictures.sketched.is_none_or(|(known, since)| {
            known != list && (!moving || known.selection == 0 || since.elapsed() > MEASURE_EVERY)
        });
        if stale && pictures.sketch.is_none() {
            let sketch = Sketch::of(&view, pictures.taken as usize, &options);
            pictures.sketched = Some((list, Instant::now()));
            match sketch.grid(seen(&pictures.extents)) {
                Ok((grid, _)) => {
                    pictures.sketch = Some(VolumeJob {
                        number: pictures.next(),
                        view: sketch.view,
                        grid,
                        options: sketch.options,
                        stride: sketch.stride as u32,
                        shows: Shows::Ranges,
                        covers: false,
                    });
                }
                Err(_) => pictures.ranges = None,
            }
        }
    }
    // A picture at rest waits for its own ranges.
    let awaits = match draws_fields {
        true => awaits_fields,
        false => pictures.sketch.is_some() && (!moving || pictures.ranges.is_none()),
    };
    let is_new = pictures.asked.as_ref() != Some(&key);
    match plan {
        Some(Ok(Some(LightPlan { passes, levels, .. }))) if !awaits && is_new => {
            pictures.levels = Some(Levels { p: levels.density, s: levels.attribute });
            let number = pictures.next();
            let passes = with_cells(passes, key.most_cells);
            let attribute = look.depiction.attribute.is_some();
            pictures.light = match light_of(number, &passes, (&drawn_view, &seen(&pictures.extents)), attribute) {
                Ok(light) => Some(light),
                // A view without data is a black picture, and no error.
                Err(VolumeError::Grid(GridError::NothingInView)) => None,
                Err(error) => {
                    notices.error(error.to_string());
                    None
                }
            };
            pictures.began.push_back((number, Instant::now(), size));
            if pictures.began.len() > MOST_ASKED {
                pictures.began.pop_front();
            }
            pictures.asked = Some(key.clone());
        }
        Some(Err(VolumeError::Grid(GridError::NothingInView))) if !awaits => {
            pictures.light = None;
            pictures.asked = Some(key.clone());
        }
        Some(Err(error)) if !awaits && pictures.failed.as_ref() != Some(&key) => {
            notices.error(error.to_string());
            pictures.failed = Some(key.clone());
        }
        _ => {}
    }

    let number = pictures.light.as_ref().map(Light::number);
    let tiles_found = tile_news.now();
    let (drawn, opaque) = match &pictures.light {
        Some(Light::Tiles(..)) => (tiles_found.drawn, tiles_found.opaque.clone()),
        _ => {
            let opaque = found.opaque.as_ref().filter(|(of, _)| Some(*of) == found.drawn);
            (found.drawn, opaque.map(|(_, opaque)| Arc::clone(opaque)))
        }
    };
    let is_drawn = number.is_none() || drawn == number;
    if let Some(drawn) = drawn.filter(|drawn| *drawn != pictures.seen) {
        pictures.seen = drawn;
        if let Some(&(_, began, size)) = pictures.began.iter().find(|(number, ..)| *number == drawn) {
            let milliseconds = 1e3 * began.elapsed().as_secs_f64();
            pictures.last = Some((size, milliseconds));
            statistics.draw_ms = Some(milliseconds);
        }
        // A sample's wider kernels may hide what all particles together do not: it says nothing.
        if Some(drawn) == number && statistics.sampled.is_none() {
            // Live particles hide nothing of the file, and what moves hides something else in a moment.
            let opaque = opaque.filter(|_| !draws_own && scene.moving.is_none());
            occlusion.drew(opaque, (scene.generation, look.depiction_revision), selection.complete);
        }
    }
    let takes_frames = matches!(pictures.light, Some(Light::Volume(_)));
    copies.note_pictures(takes_frames.then_some([pictures.number, pictures.seen]));
    let is_refused = found.no_room.is_some() && found.no_room == number;
    if let (true, Some(most)) = (is_refused, found.most_cells.filter(|most| *most >= LEAST_CELLS)) {
        pictures.most_cells = Some((most, cells_known_for));
        if pictures.told_cells.replace(most) != Some(most) {
            notices.error(format!(
                "the graphics memory is too small for so many cells: the grid is drawn with {most} along its longest side"
            ));
        }
    } else if is_refused && pictures.coarser.is_none_or(|(by, _)| by < 16) {
        let by = pictures.coarser.map_or(2, |(by, _)| 2 * by);
        pictures.coarser = Some((by, Instant::now()));
        if !std::mem::replace(&mut pictures.told_coarser, true) {
            notices.error("the graphics memory is too small for this volume: it is drawn with fewer pixels");
        }
    }
    if found.thinner && !std::mem::replace(&mut pictures.told_thinner, true) {
        notices.info("the graphics memory is short: volumes are drawn in thinner slabs");
    }
    (statistics.slabs, statistics.work_bytes) = match pictures.light {
        Some(Light::Tiles(..)) => (None, found.bytes + tiles_found.bytes),
        Some(Light::Volume(_)) => (Some(found.slabs), found.bytes),
        None => (None, found.bytes),
    };
    if let Some(levels) = pictures.levels.filter(|levels| exposure.levels != Some(*levels) || look.is_changed()) {
        exposure.set_if_neq(Exposure::of_codebooks(&subject, levels));
    }

    statistics.passes = last_passes.of_picture().map(|times| times.passes).unwrap_or_default();
    // As many slabs a frame as there is time for: twice as many while frames are short, half where they are long.
    let spent: f64 = statistics.passes.iter().map(|(_, milliseconds)| milliseconds).sum();
    pictures.slabs = match pictures.slabs {
        0 => 1,
        slabs if spent > frame_ms => (slabs / 2).max(1),
        slabs if spent < 0.4 * frame_ms && !is_drawn => (2 * slabs).min(1024),
        slabs => slabs,
    };
    let (job, tiles) = match &pictures.light {
        Some(Light::Volume(job)) => (Some(job.clone()), None),
        Some(Light::Tiles(number, from, passes)) => (None, Some((*number, *from, passes.clone()))),
        None => (None, None),
    };
    // Where lists are drawn, volumes find no more than ranges.
    let [_, memory] = preset.residency.gpu_bytes();
    let memory = if tiles.is_some() { memory / 2 } else { memory };
    let mut camera = commands.entity(entity);
    camera.insert((
        VolumeView {
            extents: Arc::clone(&pictures.extents),
            light: job,
            ranges: pictures.sketch.clone(),
            ranges_only: tiles.is_some(),
            attribute: look.depiction.attribute.is_some(),
            memory,
            slabs: pictures.slabs,
        },
        SplatView {
            view: tiles.as_ref().map_or(view, |(_, from, _)| *from),
            footprint: gpu::Footprint::Kernel(metadata.kernel),
            backend: gpu::Backend::Compute,
            culling: true,
            faintest: 0.0,
            items: Arc::clone(&pictures.items),
            keeps_last: false,
            always: false,
        },
    ));
    match tiles {
        Some((number, _, passes)) => passes.show(number, memory, &mut camera),
        None => TilePasses::hide(&mut camera),
    }
    let fading = before.fade().map(|(image, share)| Fading { image: Arc::clone(image), share });
    let light = LightView { before: fading };
    if shown != Some(&light) {
        camera.insert(light);
    }
    let chosen = draws_own || selection.complete && selection.occlusion == occlusion.revision;
    let is_asked = pictures.asked.as_ref() == Some(&key);
    converged.0 = chosen
        && !moving
        && is_asked
        && !awaits
        && is_drawn
        && pictures.reloaded.is_none()
        && size == full
        && look.settled
        && before.is_settled();
}

/// The picture that a technique's passes draw of particles within extents, from a camera. `attribute`: whether particles have one.
fn light_of(
    number: u64,
    passes: &LightPasses,
    (view, extents): (&View, &[Extent]),
    attribute: bool,
) -> Result<Light, VolumeError> {
    if let Some(job) = VolumeJob::picture_of(number, passes, view, extents, attribute)? {
        return Ok(Light::Volume(job));
    }
    match TilePasses::of(passes, view, extents)? {
        Some(tiles) => Ok(Light::Tiles(number, *view, tiles)),
        None => Err(VolumeError::Device("no passes draw this mode".into())),
    }
}

/// The same with no more cells than so many.
fn with_cells(passes: LightPasses, most: Option<u32>) -> LightPasses {
    match (passes, most) {
        (LightPasses::Cartesian(scenery, options, cartesian), Some(most)) => {
            let cells = cartesian.cells.min(most);
            LightPasses::Cartesian(scenery, options, CartesianOptions { cells, ..cartesian })
        }
        (passes, _) => passes,
    }
}
