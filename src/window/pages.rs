//! Streaming in the frame: traversal, loading and eviction are systems, each of which asks the
//! [`crate::stream::Streamer`] for one step; every page that is loading, resident or failed is an entity that shows
//! afterwards where it stands ([`super::page_entities`]).
//!
//! A frame, after the camera has settled: reads that have ended are taken in ([`finish_loads`]); what the last pictures hide is
//! marked ([`super::occlusion`]); the tree is traversed top-down and the nodes to draw are chosen, with a parent standing in for what is not there ([`traverse`]); pages that
//! are missed are read on threads of their own, the most missed first, then those that the camera comes near to, and
//! the least recently used ones make room within the budget ([`start_loads`]). The frame never waits for the disk. All
//! of that is the streamer's work.
//!
//! Where a renderer keeps copies of pages (the GPU's arena), a page counts as there only when its copy is
//! ([`PageCopies`]); until then its parent is drawn.

use super::camera::{CameraSystems, DataDistance, Viewpoint, distance_to_boxes};
use super::occlusion::{Occlusion, hide_pages, occlude};
use super::page_entities::{PageCopies, PageExtent, PageKey, PageOcclusion, PageStatus, tell_evicted, tell_standings};
use super::playhead::Playhead;
use super::preset::Preset;
use super::scene::Scene;
use super::state::notices::Notices;
use super::statistics::{ActiveBackend, Statistics};
use super::streaming::{Present, Streaming};
use crate::hierarchy::Purpose;
use crate::picture::stand_in::{Chosen, Wanted};
use crate::store::PageId;
use crate::stream::{PageState, SceneNode};
use crate::view::View;
use bevy::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// What the view draws in this frame.
#[derive(Resource, Clone, Debug, Default)]
pub struct ViewSelection {
    /// The view; `None` before anything is open.
    pub view: Option<View>,
    /// The nodes; none is an ancestor of another.
    pub nodes: Arc<[SceneNode]>,
    /// Whether everything that the view needs at its error bound, at rest, is there.
    pub complete: bool,
    /// Whether clusters stand in for what the view shows at rest.
    pub stands_in: bool,
    /// Counts up whenever the nodes or the view change.
    pub revision: u64,
    /// Counts up whenever the view changes, or its nodes in a way that no clusters stand in for.
    pub motion: u64,
    /// When the view changed.
    pub moved: Option<Instant>,
    /// The [`Occlusion::revision`] by which the nodes were chosen.
    pub occlusion: u64,
}

/// How many splats of clusters the renderer has time for while the view moves or pages come in; `None` where it draws no clusters.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SplatsInTime(pub Option<u64>);

impl SplatsInTime {
    /// Follows what pictures take, but for small differences, which would only make another picture.
    pub fn follow(&mut self, splats: Option<u64>) {
        let differs = match (self.0, splats) {
            (Some(old), Some(new)) => old.abs_diff(new) > old / 10,
            (old, new) => old != new,
        };
        if differs {
            self.0 = splats;
        }
    }
}

/// Where the camera is known to be in a moment, as on a tour.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct Upcoming(pub Option<Viewpoint>);

/// When pages are handled within a frame; all of it runs in `PostUpdate`, after the camera has settled.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum PageSystems {
    /// A new file, reads that have ended, renderers' copies that have arrived.
    Arrive,
    /// Marking what is hidden, choosing what to draw.
    Traverse,
    /// Reading what is missed, evicting what is not used, drawing.
    Serve,
}

/// Page entities and the systems over them.
pub struct PagesPlugin;

impl Plugin for PagesPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<PageCopies>()
            .init_resource::<ActiveBackend>()
            .init_resource::<Occlusion>()
            .init_resource::<SplatsInTime>()
            .init_resource::<Upcoming>()
            .init_resource::<ViewSelection>()
            .configure_sets(
                PostUpdate,
                (PageSystems::Arrive, PageSystems::Traverse, PageSystems::Serve).chain().after(CameraSystems::Settle),
            )
            .add_systems(
                PostUpdate,
                (
                    (follow_scene, finish_loads).chain().in_set(PageSystems::Arrive),
                    (occlude, hide_pages, traverse).chain().in_set(PageSystems::Traverse),
                    (start_loads, evict).chain().in_set(PageSystems::Serve),
                    tell_standings.after(PageSystems::Serve),
                ),
            )
            .add_observer(tell_evicted);
    }
}

/// Starts over when another file was opened, or when the preset's budgets have changed.
pub fn follow_scene(
    mut commands: Commands,
    scene: Option<Res<Scene>>,
    streaming: Option<ResMut<Streaming>>,
    preset: Res<Preset>,
    mut selection: ResMut<ViewSelection>,
    copies: Res<PageCopies>,
    pages: Query<Entity, With<PageKey>>,
) {
    let Some(scene) = scene else { return };
    if let Some(mut streaming) = streaming
        && streaming.generation == scene.generation
        && streaming.preset == preset.residency
    {
        if let Some(moving) = &scene.moving {
            streaming.time = moving.time;
            streaming.next.clone_from(&moving.next);
        }
        // Another renderer begins without copies.
        if streaming.streamer.copies.is_some() != copies.0 {
            let options = streaming.preset.copy_options();
            streaming.streamer.keep_copies(copies.0.then_some(options));
        }
        return;
    }
    pages.iter().for_each(|page| commands.entity(page).despawn());
    let (revision, motion) = (selection.revision + 1, selection.motion + 1);
    *selection = ViewSelection { revision, motion, ..default() };
    commands.insert_resource(Streaming::new(&scene, &preset.residency, copies.0));
}

/// Takes in pages that have been read.
pub fn finish_loads(
    mut commands: Commands,
    streaming: Option<ResMut<Streaming>>,
    mut notices: ResMut<Notices>,
    mut pages: Query<&mut PageStatus>,
) {
    let Some(mut streaming) = streaming else { return };
    let arrivals = streaming.streamer.arrive();
    arrivals.messages.into_iter().for_each(|message| notices.error(message));
    for id in arrivals.pages {
        let Some(entity) = streaming.entity(id) else { continue };
        let Ok(mut status) = pages.get_mut(entity) else { continue };
        match streaming.streamer.residency.state(id) {
            Some(PageState::Resident(page)) => {
                *status = PageStatus::Resident(Arc::clone(page));
                commands.entity(entity).insert(PageExtent::of(page));
            }
            Some(PageState::Failed(failure)) => *status = PageStatus::Failed(failure.why.clone()),
            // Without room, it is evicted at once.
            Some(PageState::Loading) | None => {}
        }
    }
    if streaming.streamer.residency.statistics().over_budget && !streaming.told_memory {
        streaming.told_memory = true;
        let budget = streaming.preset.budget_mib;
        notices
            .error(format!("the view needs more than the {budget} MiB of residency.budget_mib: it is shown coarser"));
    }
}

/// Chooses what the view draws and what it misses.
pub fn traverse(
    streaming: Option<ResMut<Streaming>>,
    present: Present,
    preset: Res<Preset>,
    mut selection: ResMut<ViewSelection>,
    mut statistics: ResMut<Statistics>,
    mut distance: ResMut<DataDistance>,
    (occlusion, upcoming, in_time): (Res<Occlusion>, Res<Upcoming>, Res<SplatsInTime>),
) {
    let Some(mut streaming) = streaming else { return };
    let Some(view) = present.view(&streaming) else { return };
    let Present { settings, look, .. } = &present;
    // From where a camera on a tour will be.
    let upcoming = upcoming.0.and_then(|next| present.view_from(&next, &streaming));
    let streaming = &mut *streaming;
    let families = settings.families.iter().enumerate().filter(|(_, visible)| **visible);
    let families: Vec<u32> = families.map(|(index, _)| index as u32).collect();
    let depiction = look.as_ref().map(|look| &look.depiction);
    let metadata = streaming.streamer.residency.tree().metadata();
    let levels = depiction.map_or(Purpose::Splats, |depiction| depiction.purpose(metadata));
    let tau = settings.error_px;
    let times = match streaming.next.is_empty() {
        true => upcoming.iter().map(|_| view.time).collect(),
        false => std::mem::take(&mut streaming.next),
    };
    let comes = |time: &f64| {
        let next = View { time: *time, ..upcoming.unwrap_or(view) };
        let roots = streaming.streamer.roots(families.iter().copied(), levels, *time);
        (depiction.map_or(next, |depiction| depiction.selection_view(&next)), roots)
    };
    streaming.streamer.upcoming = times.iter().map(comes).collect();
    let moves_now = selection.view != Some(view);
    let has_rested = selection.moved.is_none_or(|at| at.elapsed().as_millis() >= u128::from(preset.motion.rest_ms));
    let (moves, splats) = (moves_now || !has_rested, in_time.0);
    let Chosen { selection: chosen, purpose, stands_in, at_rest, .. } = match depiction {
        Some(depiction) => {
            let wanted = Wanted { depiction, tau, families: &families, moves, splats };
            streaming.stand_in.select(&mut streaming.streamer, &view, &wanted)
        }
        None => {
            let roots = streaming.streamer.roots(families.iter().copied(), levels, view.time);
            let selection = streaming.streamer.select(&view, tau, &roots);
            Chosen { selection, detail: tau.into(), purpose: levels, stands_in: false, at_rest: true }
        }
    };
    // The interval before is shown until something of this one is there.
    let comes = chosen.draw.is_empty() && !chosen.is_converged();
    if comes && !selection.nodes.is_empty() && selection.view.is_some_and(|old| old.time != view.time) {
        selection.complete = false;
        return;
    }
    let nodes: Vec<SceneNode> = chosen
        .draw
        .iter()
        .filter_map(|drawn| {
            let page = Arc::clone(streaming.streamer.residency.page(drawn.id.page)?);
            Some(SceneNode {
                page,
                node: drawn.id,
                error_pixels: drawn.error_pixels,
                offset: drawn.offset,
                time: view.time,
                part: drawn.part.then_some(drawn.particles as u32),
            })
        })
        .collect();
    let place = |drawn: &SceneNode| Some(drawn.page.nodes.get(drawn.node.node as usize)?.bounds.moved(drawn.offset));
    let boxes = nodes.iter().filter_map(place);
    distance.0 = distance_to_boxes(view.eye, boxes);
    statistics.particles = chosen.particles();
    statistics.nodes = nodes.len();
    statistics.levels = purpose.name();
    statistics.error_px = chosen.error_pixels();
    statistics.missing = chosen.missing.len();
    statistics.hidden = chosen.hidden.len();
    let same = selection.view == Some(view)
        && selection.nodes.len() == nodes.len()
        && selection.nodes.iter().zip(&nodes).all(|(old, new)| is_same(old, new));
    if moves_now {
        selection.moved = Some(Instant::now());
    }
    if !same {
        // What comes after clusters, and clusters that become finer, are no reason to draw less of it.
        selection.motion += u64::from(moves_now || !(stands_in || selection.stands_in));
        selection.revision += 1;
        selection.view = Some(view);
        selection.nodes = nodes.into();
    }
    selection.stands_in = stands_in;
    selection.complete = chosen.is_converged() && at_rest;
    selection.occlusion = occlusion.revision;
}

fn is_same(old: &SceneNode, new: &SceneNode) -> bool {
    (old.node, old.offset, old.part) == (new.node, new.offset, new.part)
}

/// Removes the entities of pages that are neither in memory nor on their way any more.
fn despawn(commands: &mut Commands, streaming: &mut Streaming, pages: Vec<PageId>) {
    for id in pages {
        if let Some(entity) = streaming.entities.remove(&id) {
            commands.entity(entity).despawn();
        }
    }
}

/// Starts to read what is missed, as many pages at a time as the preset allows.
pub fn start_loads(
    mut commands: Commands,
    streaming: Option<ResMut<Streaming>>,
    playhead: Option<ResMut<Playhead>>,
    mut statistics: ResMut<Statistics>,
    mut pages: Query<&mut PageStatus>,
) {
    let Some(mut streaming) = streaming else { return };
    if let Some(mut playhead) = playhead {
        playhead.bypass_change_detection().lead_secs = streaming.streamer.lead_secs();
    }
    let served = streaming.streamer.serve();
    despawn(&mut commands, &mut streaming, served.withdrawn);
    for id in served.started {
        // A page that has failed is tried again.
        if let Some(mut status) = streaming.entity(id).and_then(|entity| pages.get_mut(entity).ok()) {
            *status = PageStatus::Loading;
            continue;
        }
        let key = PageKey { id, generation: streaming.generation };
        let entity = commands.spawn((key, PageStatus::Loading, PageOcclusion::default())).id();
        streaming.entities.insert(id, entity);
    }
    let residency = streaming.streamer.residency.statistics();
    statistics.pages_resident = residency.resident;
    statistics.pages_loading = residency.loading + residency.stalled + residency.queued;
    statistics.pages_failed = residency.failed;
    statistics.bytes = residency.bytes;
    statistics.budget_bytes = residency.budget_bytes;
    let copies = streaming.streamer.copies.as_ref();
    statistics.copies = copies.map(|copies| [copies.bytes(), copies.options().budget]);
}

/// Removes the entities of pages that had to make room.
pub fn evict(mut commands: Commands, streaming: Option<ResMut<Streaming>>) {
    let Some(mut streaming) = streaming else { return };
    let evicted = streaming.streamer.take_evicted();
    despawn(&mut commands, &mut streaming, evicted);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build_source};
    use crate::cpu::volume::OpaqueDepths;
    use crate::import::LoadOptions;
    use crate::store::PageFile;
    use crate::view::Extent;
    use crate::window::picture::{DataCamera, Picture};
    use crate::window::scene::Settings;
    use crate::window::statistics::PageCounts;
    use bevy::math::DVec3;
    use std::path::Path;

    /// A page file of the demo dataset.
    fn demo(folder: &Path) -> Arc<PageFile> {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5");
        let output = folder.join("demo.df");
        build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &output, &()).unwrap();
        Arc::new(PageFile::open(&output).unwrap())
    }

    /// The streaming systems around a camera that looks at all of `file`.
    fn streaming_app(file: &Arc<PageFile>, budget_mib: u64) -> App {
        let bounds = file.metadata().bounds();
        let mut preset = Preset::default();
        preset.residency.budget_mib = budget_mib;
        let mut settings = Settings::new(&preset, None);
        settings.families = vec![true; file.metadata().families.len()];
        let picture = Picture::at(Rect::new(0.0, 0.0, 960.0, 720.0));
        let mut app = App::new();
        app.insert_resource(preset)
            .insert_resource(settings)
            .insert_resource(picture)
            .insert_resource(Scene::of_file(Arc::clone(file), Vec::new()))
            .init_resource::<Notices>()
            .init_resource::<Statistics>()
            .init_resource::<DataDistance>()
            .add_plugins(PagesPlugin);
        app.world_mut().spawn((DataCamera, Viewpoint::around(bounds, 0.8, 960, 720).unwrap()));
        app
    }

    /// Runs frames until the view is complete.
    fn complete(app: &mut App) {
        for _ in 0..2000 {
            app.update();
            if app.world().resource::<ViewSelection>().complete {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        panic!("the view is not complete: {:?}", app.world().resource::<Statistics>());
    }

    fn pages(app: &mut App) -> usize {
        app.world_mut().query::<&PageKey>().iter(app.world()).count()
    }

    #[test]
    fn pages_become_entities_and_the_view_completes() {
        let folder = tempfile::tempdir().unwrap();
        let file = demo(folder.path());
        let mut app = streaming_app(&file, 1024);
        app.update();
        assert!(!app.world().resource::<ViewSelection>().complete, "the first frame waits for nothing");
        complete(&mut app);
        assert_eq!(app.world().resource::<Statistics>().particles, file.metadata().particles());
        let resident = app.world().resource::<Streaming>().streamer.residency.statistics().resident;
        assert_eq!(pages(&mut app), resident);
        let standing = PageCounts { drawable: resident, ..PageCounts::default() };
        assert_eq!(app.world().resource::<Statistics>().pages, standing);
        let mut described = app.world_mut().query::<(&PageStatus, &PageExtent)>();
        let bounds = file.metadata().bounds();
        for (status, PageExtent(Extent { bounds: page, margin })) in described.iter(app.world()) {
            assert!(matches!(status, PageStatus::Resident(_)) && *margin > 0.0);
            assert!(page.min.cmpge(bounds.min - 1e-3).all() && page.max.cmple(bounds.max + 1e-3).all());
        }
        assert!(app.world().resource::<DataDistance>().0.is_some_and(|distance| distance > 0.0));
    }

    #[test]
    fn a_copy_that_is_not_there_is_drawn_by_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let file = demo(folder.path());
        let mut app = streaming_app(&file, 1024);
        app.world_mut().resource_mut::<PageCopies>().0 = true;
        let root = file.metadata().families[0].root_page;
        for _ in 0..200 {
            app.update();
            std::thread::sleep(std::time::Duration::from_millis(2));
            if app.world().resource::<Streaming>().streamer.uncopied() == [root] {
                break;
            }
        }
        let selection = app.world().resource::<ViewSelection>().clone();
        assert!(!selection.complete && selection.nodes.is_empty());
        assert_eq!(app.world().resource::<Streaming>().streamer.uncopied(), [root]);
        // As copies arrive, the picture refines down to the leaves.
        for _ in 0..2000 {
            if app.world().resource::<ViewSelection>().complete {
                break;
            }
            let streamer = &mut app.world_mut().resource_mut::<Streaming>().streamer;
            let plan = streamer.plan_copies();
            let copies = streamer.copies.as_mut().unwrap();
            plan.insert.into_iter().for_each(|page| copies.arrived(page));
            app.update();
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        assert!(app.world().resource::<ViewSelection>().complete);
    }

    #[test]
    fn pages_behind_a_picture_are_hidden_while_the_camera_moves_until_they_may_show() {
        let folder = tempfile::tempdir().unwrap();
        let file = demo(folder.path());
        let mut app = streaming_app(&file, 1024);
        let around = Viewpoint::around(file.metadata().bounds(), 0.8, 960, 720).unwrap();
        let way = around.eye - around.target;
        let first = Viewpoint { eye: around.target + 2.0 * way, ..around };
        let look_from = |app: &mut App, viewpoint: Viewpoint| {
            let mut cameras = app.world_mut().query::<&mut Viewpoint>();
            *cameras.single_mut(app.world_mut()).unwrap() = viewpoint;
            app.update();
        };
        look_from(&mut app, first);
        complete(&mut app);
        // A wall before all of it.
        let view = app.world().resource::<ViewSelection>().view.unwrap();
        let wall = (0.9 * way.length()) as f32;
        let opaque = OpaqueDepths::new(&view, vec![wall; (view.width * view.height) as usize], 1.0, 2.0);
        app.world_mut().resource_mut::<Occlusion>().drew(Some(Arc::new(opaque)), (1, 0), true);
        let hidden = |app: &mut App| {
            let mut pages = app.world_mut().query::<(&PageKey, &PageOcclusion)>();
            let pages: Vec<_> = pages.iter(app.world()).map(|(key, state)| (key.id, *state)).collect();
            let residency = &app.world().resource::<Streaming>().streamer.residency;
            let is_hidden = |state: PageOcclusion| state == PageOcclusion::Hidden;
            assert!(pages.iter().all(|&(page, state)| residency.is_hidden(page) == is_hidden(state)));
            pages.iter().filter(|(_, state)| is_hidden(*state)).count() as f64 / pages.len() as f64
        };
        let speed_falls = |app: &mut App| {
            std::thread::sleep(std::time::Duration::from_millis(1500));
            (0..2).for_each(|_| app.update());
        };
        speed_falls(&mut app);
        assert_eq!(hidden(&mut app), 1.0);
        assert!(app.world().resource::<Statistics>().hidden > 0 && app.world().resource::<ViewSelection>().complete);
        let turned = Viewpoint { target: first.target + 0.05 * way.any_orthogonal_vector(), ..first };
        look_from(&mut app, turned);
        assert_eq!(hidden(&mut app), 1.0, "a turn shows nothing");
        let aside = 0.02 * way.length() * way.any_orthonormal_vector();
        look_from(&mut app, Viewpoint { eye: first.eye + aside, ..first });
        speed_falls(&mut app);
        assert_eq!(hidden(&mut app), 1.0, "a step aside shows nothing");
        look_from(&mut app, Viewpoint { eye: first.target - 2.0 * way, ..first });
        speed_falls(&mut app);
        assert_eq!(hidden(&mut app), 0.0, "from the other side nothing is known");
        app.world_mut().resource_mut::<Occlusion>().drew(None, (1, 0), true);
        look_from(&mut app, first);
        assert_eq!(hidden(&mut app), 0.0, "a clear picture hides nothing");
    }

    #[test]
    fn another_file_starts_over() {
        let folder = tempfile::tempdir().unwrap();
        let file = demo(folder.path());
        let mut app = streaming_app(&file, 1024);
        complete(&mut app);
        let revision = app.world().resource::<ViewSelection>().revision;
        app.world_mut().resource_mut::<Scene>().generation = 2;
        app.update();
        assert!(!app.world().resource::<ViewSelection>().complete);
        complete(&mut app);
        assert!(app.world().resource::<ViewSelection>().revision > revision);
        let mut keys = app.world_mut().query::<&PageKey>();
        assert!(keys.iter(app.world()).all(|key| key.generation == 2));
    }

    #[test]
    fn hidden_families_are_not_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let file = demo(folder.path());
        let mut app = streaming_app(&file, 1024);
        complete(&mut app);
        app.world_mut().resource_mut::<Settings>().families.fill(false);
        app.update();
        assert_eq!(app.world().resource::<Statistics>().particles, 0);
        assert!(app.world().resource::<ViewSelection>().nodes.is_empty());
    }

    #[test]
    fn the_particle_under_the_cursor_is_picked() {
        let folder = tempfile::tempdir().unwrap();
        let file = demo(folder.path());
        let mut app = streaming_app(&file, 1024);
        complete(&mut app);
        let selection = app.world().resource::<ViewSelection>().clone();
        let view = selection.view.unwrap();
        let pick = |cursor| crate::window::pick::pick(&view, file.metadata(), &selection.nodes, cursor);
        let picked = pick([480.0, 360.0]).expect("the box is full of particles");
        let pixel = view.to_pixels(view.to_camera(picked.position)).unwrap();
        assert!((pixel[0] - 480.0).hypot(pixel[1] - 360.0) <= crate::window::pick::REACH_PX + 1e-6);
        assert!((picked.pixels - (pixel[0] - 480.0).hypot(pixel[1] - 360.0)).abs() < 1e-6);
        let bounds = file.metadata().bounds();
        assert!(picked.position.clamp(bounds.min - DVec3::ONE, bounds.max + DVec3::ONE) == picked.position);
        assert!(pick([2.0, 2.0]).is_none(), "nothing is in the corner of a view of the whole box");
    }
}
