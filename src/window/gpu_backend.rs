//! Drawing with the GPU: pages are copied into the renderer's arena, and the data camera gets the list of nodes to
//! splat and the transfer function to show them with.
//!
//! A page counts as there only when all its nodes have arrived in the arena, so a parent is drawn until then and never
//! a hole.

use super::cpu_backend::CpuPicture;
use super::exposure::Exposure;
use super::field_backend::{self, on_adapter::FieldOnAdapter, surface_on_adapter::SurfaceOnAdapter};
use super::listed::Listed;
use super::live::LiveParticles;
use super::live::copies::LiveCopies;
use super::look::Look;
use super::page_entities::{GpuSlot, PageCopies, PageKey, PageStatus};
use super::pages::{SplatsInTime, ViewSelection};
use super::pass_times::LastPasses;
use super::paths::Paths;
use super::picture::DataCamera;
use super::preset::{Backend, Preset};
use super::scene::{Scene, Settings};
use super::state::aim::Aim;
use super::state::notices::Notices;
use super::statistics::{ActiveBackend, Converged, Statistics};
use super::streaming::Streaming;
use super::surround_backend;
use super::touring::Before;
use crate::color::Accumulation;
use crate::cpu::volume::attributes::Column;
use crate::gpu::column_tables::ColumnTables;
use crate::gpu::content_look::ContentLook;
use crate::gpu::integrals::IntegralView;
use crate::gpu::measure::{Measure, Measured, MeasuredPicture};
use crate::gpu::page_copies::{self, CopyState};
use crate::gpu::surface::SurfaceView;
use crate::gpu::tile_passes::TilePasses;
use crate::gpu::{self, Composite, DrawItem, LightView, ModeView, ParticleScene, SplatView, VolumeView};
use crate::gpu::{Capabilities, Technique, Withheld};
use crate::mode::{Adapter, Footprint, LodBudget, Plan};
use crate::modes;
use crate::picture::Subject;
use crate::picture::drawing_cost::{self, DrawingCost};
use crate::picture::splat_budget::SplatBudget;
use crate::picture::stand_in::FADE_SECS;
use bevy::prelude::*;
use bevy::render::renderer::{RenderAdapter, RenderAdapterInfo, RenderDevice};
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::DeviceType;

/// What the renderer holds for the present look of the present file.
#[derive(Resource, Default)]
pub struct GpuTables {
    /// The look that the tables belong to: generation of the file and revision of the depiction.
    made_for: Option<(u32, u64)>,
    /// What the codes of its particles stand for.
    tables: ColumnTables,
    /// The selection that the camera draws, the state of live particles in its place, what the settings leave out of it, and whether it
    /// moves.
    drawn: Option<(u64, Option<u32>, Plan, bool)>,
    /// What the camera draws.
    items: Arc<[DrawItem]>,
    /// When a picture was last taken for ranges and histograms.
    measured: Option<Instant>,
    /// The picture that they are of.
    exposed: Option<Arc<Measured>>,
    drawing_cost: DrawingCost,
    splat_budget: SplatBudget,
    /// Particles that the last pictures took, and when the last one was changed.
    taken: [u64; 3],
    changed: Option<Instant>,
    /// How particles are accumulated; none if the processor does it.
    technique: Option<Technique>,
    /// The backend that was asked for last.
    asked: Option<Backend>,
    /// The file for which it was told that the graphics memory is full.
    told_full: Option<u32>,
    /// How copies of what moves, and of clusters, are to be seen, and which look that is.
    content: Option<((u32, u64), Arc<ContentLook>)>,
    /// Of which states of view and live particles the camera draws clusters that stand in; `None` where it draws the view's own.
    stood_in: Option<[u64; 2]>,
    /// When a picture has taken the place of such clusters.
    replaced: Option<Instant>,
}

/// Least time between two looks at how bright a view is that moves.
const MEASURE_EVERY: Duration = Duration::from_millis(100);

/// Whether something else draws the mode on an adapter than before, or light spreads now.
pub(super) fn technique_changed(
    (settings, live, scene): (Res<Settings>, Res<LiveParticles>, Option<Res<Scene>>),
    mut before: Local<Option<(Adapter, [bool; 3])>>,
) -> bool {
    let technique = settings.drawn_mode().technique;
    let is_processors =
        technique.is_darkened(&settings.look.settings) || lacks_columns(&settings, &live, scene.as_deref());
    let glows = !settings.bloom.is_off();
    let now = Some((technique.adapter(), [technique.tells_columns(), is_processors, glows]));
    std::mem::replace(&mut *before, now) != now
}

/// Whether settings draw fields of particles of which copies hold a single column: what moves, clusters and live particles.
fn lacks_columns(settings: &Settings, live: &LiveParticles, scene: Option<&Scene>) -> bool {
    let brings_values =
        |scene: &Scene| scene.moving.is_some() || scene.following.is_some() || scene.metadata().has_clusters();
    let draws_fields = !settings.drawn_mode().technique.fields(&settings.look.settings).is_empty();
    draws_fields && (live.is_shown() || scene.is_some_and(brings_values))
}

/// Follows the preset's choice of a backend, and the processor's modes.
pub(super) fn choose_backend(
    mut commands: Commands,
    preset: Res<Preset>,
    settings: Option<Res<Settings>>,
    device: Option<Res<RenderDevice>>,
    adapter: Option<Res<RenderAdapter>>,
    info: Option<Res<RenderAdapterInfo>>,
    mut active: ResMut<ActiveBackend>,
    mut copies: ResMut<PageCopies>,
    mut statistics: ResMut<Statistics>,
    mut tables: ResMut<GpuTables>,
    cameras: Query<Entity, With<DataCamera>>,
    mut notices: ResMut<Notices>,
    (live, paths, scene): (Res<LiveParticles>, Res<Paths>, Option<Res<Scene>>),
    (field, surfaces): (Res<FieldOnAdapter>, Res<SurfaceOnAdapter>),
    slots: Query<Entity, With<GpuSlot>>,
    aim: Option<Res<Aim>>,
) {
    let asked = preset.drawing.backend;
    let surrounds =
        settings.as_ref().is_some_and(|settings| surround_backend::is_wanted(settings, &live, aim.as_deref()));
    let is_field =
        settings.as_ref().is_some_and(|settings| field_backend::is_wanted(scene.as_deref(), settings, &live));
    let drawn = |settings: &Res<Settings>| scene.as_ref().is_some_and(|scene| surfaces.draws(scene, settings));
    let is_surface = is_field && settings.as_ref().is_some_and(drawn);
    let is_left = |settings: &Res<Settings>| {
        let technique = settings.drawn_mode().technique;
        let is_processors = technique.is_darkened(&settings.look.settings);
        !is_field && (is_processors || lacks_columns(settings, &live, scene.as_deref()))
    };
    let is_left = settings.as_ref().is_some_and(is_left);
    let is_processors_field =
        |settings: &Res<Settings>| is_field && settings.drawn_mode().technique.is_darkened(&settings.look.settings);
    let is_processors_field = settings.as_ref().is_some_and(is_processors_field);
    let glows = settings.as_ref().is_some_and(|settings| !settings.bloom.is_off());
    let mode = settings.map_or(modes::first(), |settings| settings.drawn_mode());
    let has_field_passes = mode.technique.has_field_passes() && !is_processors_field;
    let adapter_of_mode = match mode.technique.tells_columns() {
        _ if is_surface => Adapter::Splats,
        _ if is_left => Adapter::None,
        _ if is_field && has_field_passes => Adapter::Light,
        // Ranges of the sums, which splats over each other are coloured by, no passes find beside them.
        true => Adapter::None,
        false => mode.technique.adapter(),
    };
    let has_room = scene.as_ref().is_some_and(|scene| !field.is_refused(scene));
    let is_processors = is_field && !is_surface && !(has_field_passes && has_room);
    // A driver without a graphics card draws on the processor too, and volumes slower than our own renderer.
    let is_card = info.as_ref().is_some_and(|info| info.device_type != DeviceType::Cpu);
    let wanted = match asked {
        // Panoramas are put together from pages themselves.
        _ if surrounds || is_processors || adapter_of_mode == Adapter::None => None,
        // What paths hide, and what hides them, the processor knows.
        _ if paths.is_among() => None,
        Backend::Compute if adapter_of_mode == Adapter::Light => Some(gpu::Backend::Compute),
        Backend::Auto if adapter_of_mode == Adapter::Light && is_card => Some(gpu::Backend::Compute),
        _ if adapter_of_mode == Adapter::Light => None,
        Backend::Auto | Backend::Compute | Backend::Raster if adapter_of_mode == Adapter::Plugin => {
            Some(gpu::Backend::Compute)
        }
        Backend::Cpu => None,
        Backend::Auto if is_surface && !is_card => None,
        Backend::Auto => Some(gpu::Backend::Auto),
        Backend::Compute => Some(gpu::Backend::Compute),
        Backend::Raster => Some(gpu::Backend::Raster),
    };
    let graphics = device.zip(adapter).zip(info);
    let (found, refusal) = match (wanted, &graphics) {
        (None, _) => (None, None),
        (Some(wanted), Some(((device, adapter), info))) => {
            let capabilities = Capabilities::of(device, adapter, info, Withheld::default());
            let found = capabilities.technique(wanted);
            let other = match adapter_of_mode {
                Adapter::Plugin | Adapter::Light => found,
                _ => found.or_else(|_| capabilities.technique(gpu::Backend::Auto)),
            };
            // Light spreads in compute passes.
            let is_able = !glows || capabilities.compute || adapter_of_mode == Adapter::Plugin;
            (other.ok().filter(|_| is_able), found.err())
        }
        (Some(_), None) => (None, Some("a working driver")),
    };
    if tables.asked.replace(asked) != Some(asked)
        && let Some(missing) = refusal
    {
        let used = found.map_or("cpu", Technique::name);
        notices.error(format!("{used} draws: the graphics adapter lacks {missing}"));
    }
    if tables.technique != found {
        tables.technique = found;
        tables.drawn = None;
    }
    statistics.adapter = graphics.map_or_else(String::new, |(_, info)| format!("{} ({})", info.name, info.driver_info));
    let wanted = match found {
        Some(technique) if is_surface => ActiveBackend::SurfaceOnGpu(technique),
        Some(_) if is_field => ActiveBackend::FieldOnGpu,
        Some(_) => ActiveBackend::Gpu,
        None if surrounds => ActiveBackend::Surround,
        None if is_field => ActiveBackend::Field,
        None => ActiveBackend::Cpu,
    };
    // While something else is shown, the file's pages have no place there.
    let uses_copies = wanted == ActiveBackend::Gpu && !live.is_shown();
    if wanted != ActiveBackend::Gpu && live.is_shown() && live.particles().is_none() {
        notices.error("the processor cannot draw particles in the graphics adapter's memory: the file is shown");
    }
    if *active == wanted && copies.0 == uses_copies {
        return;
    }
    if adapter_of_mode == Adapter::None && !is_field {
        notices.info(format!("the processor draws {}", mode.name));
    } else if paths.is_among() {
        notices.info(format!("the processor draws {} with paths", mode.name));
    }
    *active = wanted;
    copies.0 = uses_copies;
    *tables = GpuTables { asked: Some(asked), technique: found, ..default() };
    slots.iter().for_each(|page| {
        commands.entity(page).remove::<GpuSlot>();
    });
    for entity in &cameras {
        commands.entity(entity).remove::<(
            SplatView,
            Composite,
            ModeView,
            LightView,
            VolumeView,
            IntegralView,
            SurfaceView,
            Measure,
        )>();
        TilePasses::hide(&mut commands.entity(entity));
    }
}

/// Gives the arena the preset's budgets.
pub(super) fn follow_budgets(preset: Res<Preset>, particles: Res<ParticleScene>) {
    let residency = &preset.residency;
    particles.set_budgets(residency.gpu_bytes()[0], residency.upload_mib << 20);
}

/// Notes pages that have arrived in the arena.
pub(super) fn receive_copies(
    mut commands: Commands,
    particles: Res<ParticleScene>,
    streaming: Option<ResMut<Streaming>>,
    mut pages: Query<(&PageKey, &PageStatus, &mut GpuSlot)>,
) {
    let Some(mut streaming) = streaming else { return };
    let Some(copies) = streaming.streamer.copies.as_ref() else { return };
    let waiting: Vec<_> = copies.on_their_way().collect();
    for id in waiting {
        let Some(entity) = streaming.entity(id) else { continue };
        let Ok((key, PageStatus::Resident(page), mut slot)) = pages.get_mut(entity) else { continue };
        let state = page_copies::state(&particles, key.generation, page);
        let Some(copies) = streaming.streamer.copies.as_mut() else { return };
        match state {
            CopyState::Waiting => {}
            CopyState::Complete => {
                *slot = GpuSlot::Resident;
                copies.arrived(id);
            }
            CopyState::Rejected => {
                copies.rejected(id);
                commands.entity(entity).remove::<GpuSlot>();
            }
        }
    }
}

/// Lets what moves, and clusters, be copied anew for another look: their copies hold what a mode makes of them, so that nothing is left to do
/// for them while time goes on and budgets change.
pub(super) fn renew_content(
    mut commands: Commands,
    (scene, look): (Option<Res<Scene>>, Option<Res<Look>>),
    streaming: Option<ResMut<Streaming>>,
    mut tables: ResMut<GpuTables>,
    slots: Query<Entity, With<GpuSlot>>,
) {
    let (Some(scene), Some(look), Some(mut streaming)) = (scene, look, streaming) else { return };
    let seen = (scene.generation, look.depiction_revision);
    if tables.content.as_ref().is_some_and(|(known, _)| *known == seen) {
        return;
    }
    let look = ContentLook::new(look.depiction.clone(), scene.metadata());
    let before = tables.content.replace((seen, Arc::new(look)));
    let is_same_file = before.is_some_and(|((generation, _), _)| generation == scene.generation);
    if (scene.moving.is_some() || scene.metadata().has_clusters())
        && is_same_file
        && streaming.generation == scene.generation
    {
        let options = streaming.streamer.copies.as_ref().map(|copies| *copies.options());
        streaming.streamer.keep_copies(options);
        slots.iter().for_each(|page| {
            commands.entity(page).remove::<GpuSlot>();
        });
    }
}

/// Frees the copies that have to make room, and queues those that the view misses or will.
pub(super) fn upload_pages(
    mut commands: Commands,
    particles: Res<ParticleScene>,
    streaming: Option<ResMut<Streaming>>,
    mut tables: ResMut<GpuTables>,
    mut notices: ResMut<Notices>,
) {
    let Some(mut streaming) = streaming else { return };
    let generation = streaming.generation;
    let plan = streaming.streamer.plan_copies();
    for (id, nodes) in plan.remove {
        // At once, so that what follows finds the room.
        page_copies::remove(&particles, generation, id, nodes);
        if let Some(entity) = streaming.entity(id) {
            commands.entity(entity).remove::<GpuSlot>();
        }
    }
    let residency = &streaming.streamer.residency;
    // Without a look nothing is drawn yet, and nothing missed.
    let Some((_, look)) = &tables.content else { return };
    for id in plan.insert {
        let (Some(entity), Some(page)) = (streaming.entity(id), residency.page(id)) else { continue };
        page_copies::insert(&particles, generation, page, look);
        commands.entity(entity).insert(GpuSlot::Queued);
    }
    if streaming.streamer.copies.as_ref().is_some_and(|copies| copies.is_full())
        && tables.told_full.replace(generation) != Some(generation)
    {
        notices.error("the graphics memory is full (residency.gpu_budget_mib): a coarser picture is shown");
    }
}

/// Frees the arena's copy of a page whose entity goes, or which is no longer drawn by the GPU.
pub(super) fn free_slot(
    removed: On<Remove, GpuSlot>,
    particles: Res<ParticleScene>,
    pages: Query<(&PageKey, &PageStatus)>,
) {
    let Ok((key, PageStatus::Resident(page))) = pages.get(removed.entity) else { return };
    page_copies::remove(&particles, key.generation, key.id, page.nodes.len() as u32);
}

/// Leaves the picture as it is until something of another file or step is there.
pub(super) fn hold_picture(
    (active, live, selection): (Res<ActiveBackend>, Res<LiveParticles>, Res<ViewSelection>),
    surfaces: Res<SurfaceOnAdapter>,
    mut camera: Single<&mut Camera, With<DataCamera>>,
) {
    let is_there = live.is_shown() || selection.complete || !selection.nodes.is_empty();
    let draws = match *active {
        ActiveBackend::Gpu => is_there,
        ActiveBackend::SurfaceOnGpu(_) => surfaces.is_there(),
        backend => backend.is_on_adapter(),
    };
    if camera.is_active != draws {
        camera.is_active = draws;
    }
}

impl GpuTables {
    /// Has tables for a look; true where they are other ones than before.
    pub(super) fn follow(&mut self, particles: &ParticleScene, look: &Look, scene: &Scene) -> bool {
        let wanted = (scene.generation, look.depiction_revision);
        if self.made_for == Some(wanted) {
            return false;
        }
        let made = ColumnTables::new(particles, &look.depiction, scene.metadata());
        std::mem::replace(&mut self.tables, made).free(particles);
        self.made_for = Some(wanted);
        self.drawn = None;
        true
    }

    /// Lists what is drawn of a selection, with each of some columns: as even a sample as is within `limit` particles, else what `usual` says.
    pub(super) fn list(
        &self,
        selection: &ViewSelection,
        look: &Look,
        scene: &Scene,
        (limit, usual): (u64, Plan),
        columns: &[Column],
    ) -> Listed {
        let Some(view) = selection.view else {
            return Listed { items: Arc::default(), extents: Arc::default(), plan: usual, taken: 0 };
        };
        let metadata = scene.metadata();
        let important = self.tables.most_important();
        let (plan, taken) =
            drawing_cost::within(limit, usual, &view, &look.depiction, metadata, &selection.nodes, &important);
        let wanted = (&look.depiction, metadata, &plan);
        let (items, extents) = self.tables.items(columns, &selection.nodes, (scene.generation, &view), wanted);
        Listed { items: items.into(), extents: extents.into(), plan, taken }
    }
}

/// Tells the data camera what to draw and how to show it.
pub(super) fn draw_on_gpu(
    mut commands: Commands,
    active: Res<ActiveBackend>,
    particles: Res<ParticleScene>,
    scene: Option<Res<Scene>>,
    look: Option<Res<Look>>,
    selection: Res<ViewSelection>,
    (live, copies): (Res<LiveParticles>, Res<LiveCopies>),
    (motion, preset, before): (Res<CpuPicture>, Res<Preset>, Res<Before>),
    last_passes: Res<LastPasses>,
    (measured, mut exposure): (Res<MeasuredPicture>, ResMut<Exposure>),
    mut tables: ResMut<GpuTables>,
    mut converged: ResMut<Converged>,
    mut statistics: ResMut<Statistics>,
    camera: Single<(Entity, Option<&Composite>), With<DataCamera>>,
    mut in_time: ResMut<SplatsInTime>,
) {
    if *active != ActiveBackend::Gpu {
        return;
    }
    let frame_ms = preset.drawing.frame_ms;
    in_time.follow((frame_ms > 0.0).then(|| tables.splat_budget.limit(frame_ms)));
    let Some(technique) = tables.technique else { return };
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else { return };
    if look.depiction.mode.technique.adapter() == Adapter::Light {
        return;
    }
    if statistics.backend != technique.name() {
        technique.name().clone_into(&mut statistics.backend);
    }
    let (entity, composite) = camera.into_inner();
    let metadata = scene.metadata();
    let tables = &mut *tables;
    if tables.follow(&particles, &look, &scene) {
        let (mode, settings) = (look.depiction.mode, look.depiction.settings.clone());
        let mut camera = commands.entity(entity);
        camera.insert((ModeView { mode, settings }, Measure)).remove::<(LightView, VolumeView)>();
        TilePasses::hide(&mut camera);
    }
    let moving = motion.is_moving(&preset.motion);
    let stands_in = selection.stands_in && !live.is_shown();
    // Samples that are weighed take particles to plan; the adapter draws all of them at rest.
    let lod_budget = LodBudget { thinning: 0.0, ..look.lod_budget };
    let subject = Subject::new(metadata, &look.depiction, &look.transfer, 0.0);
    let usual = subject.plan(&view, &[], &lod_budget, Some(look.levels)).unwrap_or_default();
    // Clusters were chosen within a limit of their own.
    let pressed = moving && frame_ms > 0.0 && !stands_in;
    let drawn = (selection.revision, live.is_shown().then(|| copies.number()), usual, pressed);
    if tables.drawn != Some(drawn) {
        tables.drawn = Some(drawn);
        let limit = if pressed { tables.drawing_cost.limit(frame_ms, preset.motion.sample_sizes()) } else { u64::MAX };
        let Listed { items, plan, taken, .. } = match live.is_shown() {
            true => copies.listed(&view, usual),
            false => tables.list(&selection, &look, &scene, (limit, usual), &[Column::Attribute]),
        };
        statistics.sampled = (plan != usual).then_some(taken);
        tables.taken = [taken, tables.taken[0], tables.taken[1]];
        tables.changed = Some(Instant::now());
        tables.items = items;
        let backend = match technique {
            Technique::Compute => gpu::Backend::Compute,
            Technique::Raster => gpu::Backend::Raster,
        };
        let footprint = match look.depiction.footprint() {
            Footprint::Kernel => gpu::Footprint::Kernel(metadata.kernel),
            Footprint::Pixels(radius) => gpu::Footprint::Pixels { radius },
        };
        let (culling, faintest, items) = (plan.culling, plan.faintest, Arc::clone(&tables.items));
        let state = [selection.motion, live.state()];
        let keeps_last = !stands_in && tables.stood_in == Some(state);
        tables.stood_in = stands_in.then_some(state);
        tables.replaced = keeps_last.then(Instant::now);
        let shown = SplatView { view, footprint, backend, culling, faintest, items, always: false, keeps_last };
        commands.entity(entity).insert(shown);
    }
    let found = measured.now();
    let is_current = found.as_ref().is_some_and(|found| found.view == view && Arc::ptr_eq(&found.items, &tables.items));
    let paced = tables.measured.is_none_or(|since| since.elapsed() > MEASURE_EVERY);
    if let Some(found) = found
        && (is_current || paced)
        && (exposure.levels.is_none()
            || !tables.exposed.as_ref().is_some_and(|known| Arc::ptr_eq(known, &found))
            || look.is_changed())
    {
        tables.exposed = Some(Arc::clone(&found));
        tables.measured = Some(Instant::now());
        let ps = if look.depiction.attribute.is_some() { found.cells.ps.clone() } else { Vec::new() };
        exposure.set_if_neq(Exposure::of(&Accumulation { ps, ..found.cells.clone() }, &look.transfer));
    }
    let passed = tables.replaced.map(|since| since.elapsed().as_secs_f32() / FADE_SECS);
    let last = passed.filter(|share| *share < 1.0);
    if last.is_none() {
        tables.replaced = None;
    }
    let shown = look.composite(before.fade(), last);
    let same = composite.is_some_and(|now| now.is_same(&shown));
    if !same {
        commands.entity(entity).insert(shown);
    }
    let times = last_passes.of_picture();
    let has_drawn = times.is_some();
    let (milliseconds, at) = times.as_ref().map(|times| (times.sum(), times.at)).unzip();
    statistics.draw_ms = milliseconds;
    statistics.passes = times.map(|times| times.passes).unwrap_or_default();
    // Times come a picture or two late: while the last samples differ much, nobody knows which one a time belongs to.
    let [taken, ..] = tables.taken;
    let [most, least] = [tables.taken.iter().max(), tables.taken.iter().min()];
    if let (Some(milliseconds), Some(at)) = (milliseconds, at)
        && tables.changed.is_some_and(|changed| at > changed)
        && most.zip(least).is_some_and(|(&most, &least)| most <= 2 * least)
    {
        match stands_in {
            true => tables.splat_budget.drew(taken, milliseconds),
            false => tables.drawing_cost.drew(taken, milliseconds),
        }
        tables.changed = None;
    }
    // Passes are timed only once their shaders are there, so a first time means a first picture.
    converged.0 = selection.complete && !moving && same && look.settled && has_drawn && is_current;
    converged.0 &= before.is_settled() && last.is_none();
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::ecs::system::RunSystemOnce;

    #[test]
    fn a_backend_that_is_not_there_is_told_once() {
        let mut world = World::new();
        world.init_resource::<Preset>();
        world.init_resource::<ActiveBackend>();
        world.init_resource::<PageCopies>();
        world.init_resource::<Statistics>();
        world.init_resource::<GpuTables>();
        world.init_resource::<Notices>();
        world.init_resource::<LiveParticles>();
        world.init_resource::<Paths>();
        world.init_resource::<FieldOnAdapter>();
        world.init_resource::<SurfaceOnAdapter>();
        let mut told = |backend| {
            world.resource_mut::<Preset>().drawing.backend = backend;
            world.run_system_once(choose_backend).unwrap();
            world.resource::<Notices>().all().count()
        };
        let asked = [Backend::Auto, Backend::Raster, Backend::Raster, Backend::Compute, Backend::Raster];
        // Without any adapter.
        assert_eq!(asked.map(&mut told), [1, 2, 2, 3, 4]);
        let text = world.resource::<Notices>().all().next().unwrap().text.clone();
        assert!(text.contains("cpu draws") && text.contains("lacks a working driver"), "{text}");
    }
}
