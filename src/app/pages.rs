//! Streaming as entities: every page that is loading, resident or failed is an entity, and traversal, loading, eviction
//! are systems over them.
//!
//! A frame, after the camera has settled: reads that have ended are taken in ([`finish_loads`]); the tree is traversed
//! top-down and the nodes to draw are chosen, with a parent standing in for what is not there ([`traverse`]); pages that
//! are missed are read on background tasks, the most missed first, and the least recently used ones make room within
//! the budget ([`start_loads`]). The frame never waits for the disk.
//!
//! Where a renderer keeps copies of pages (the GPU's arena), a page counts as there only when its copy is
//! ([`PageCopies`]); until then its parent is drawn.

use super::camera::{CameraSystems, DataDistance, Viewpoint, distance_to_boxes};
use super::look::Look;
use super::messages::Messages;
use super::picture::{DataCamera, Picture};
use super::preset::Preset;
use super::scene::{Scene, Settings};
use super::statistics::Statistics;
use crate::model::Bounds;
use crate::store::{NodeRef, Page, PageFile, PageId, StoreError};
use crate::stream::{Residency, SceneNode};
use crate::view::{NodeInfo, NodeTree, View, select};
use bevy::prelude::*;
use bevy::tasks::{IoTaskPool, Task, futures::check_ready};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Which page an entity is.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PageKey {
    /// Number of the page in its file.
    pub id: PageId,
    /// The [`Scene::generation`] of the file.
    pub generation: u32,
}

/// Where a page stands.
#[derive(Component, Clone, Debug)]
pub enum PageStatus {
    /// A background task reads it.
    Loading,
    /// In memory.
    Resident(Arc<Page>),
    /// It cannot be read; the text says why.
    Failed(String),
}

/// The box around a resident page's nodes, world units.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct PageBounds(pub Bounds);

/// Depth of a resident page's coarsest node; 0 for the root.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageDepth(pub u8);

/// The frame that last drew from a page.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LastUse(pub u64);

/// A read under way.
#[derive(Component)]
pub struct PageRead(Task<Result<Page, StoreError>>);

/// Where a renderer's copy of a page stands; only while a renderer keeps copies.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpuSlot {
    /// On its way.
    Queued,
    /// There: the page may be drawn.
    Resident,
    /// There is no room for it.
    Rejected,
}

/// Which pages a renderer has copies of. `None`: the renderer draws from main memory and every resident page counts.
#[derive(Resource, Clone, Debug, Default)]
pub struct PageCopies(pub Option<HashSet<PageId>>);

/// What the view draws in this frame.
#[derive(Resource, Clone, Debug, Default)]
pub struct ViewSelection {
    /// The view; `None` before anything is open.
    pub view: Option<View>,
    /// The nodes; none is an ancestor of another.
    pub nodes: Arc<[SceneNode]>,
    /// Resident pages that the renderer lacks a copy of, the most missed first.
    pub wanted_copies: Vec<PageId>,
    /// Whether everything that the view needs at its error bound is there.
    pub complete: bool,
    /// Counts up whenever the nodes or the view change.
    pub revision: u64,
}

/// The open file's pages.
#[derive(Resource)]
pub struct Streaming {
    /// Which pages are in memory.
    pub residency: Residency,
    entities: HashMap<PageId, Entity>,
    /// The [`Scene::generation`] of the file.
    pub generation: u32,
    frame: u64,
    reported: HashSet<PageId>,
}

impl Streaming {
    /// Nothing of `file` is resident yet.
    pub fn new(file: Arc<PageFile>, budget_bytes: u64, generation: u32) -> Streaming {
        Streaming {
            residency: Residency::new(file, budget_bytes),
            entities: HashMap::new(),
            generation,
            frame: 0,
            reported: HashSet::new(),
        }
    }

    /// The entity of a page that is loading, resident or failed.
    pub fn entity(&self, page: PageId) -> Option<Entity> {
        self.entities.get(&page).copied()
    }
}

/// What may be drawn: resident, and copied where the renderer needs copies.
struct Drawable<'a> {
    residency: &'a Residency,
    copies: Option<&'a HashSet<PageId>>,
}

impl NodeTree for Drawable<'_> {
    type Id = NodeRef;

    fn node(&self, id: NodeRef) -> Option<NodeInfo<NodeRef>> {
        self.copies.is_none_or(|copies| copies.contains(&id.page)).then(|| self.residency.node(id))?
    }
}

/// When pages are handled within a frame; all of it runs in `PostUpdate`, after the camera has settled.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum PageSystems {
    /// A new file, reads that have ended, renderers' copies that have arrived.
    Arrive,
    /// Choosing what to draw.
    Traverse,
    /// Reading what is missed, evicting what is not used, drawing.
    Serve,
}

/// Page entities and the systems over them.
pub struct PagesPlugin;

impl Plugin for PagesPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<PageCopies>()
            .init_resource::<ViewSelection>()
            .configure_sets(
                PostUpdate,
                (PageSystems::Arrive, PageSystems::Traverse, PageSystems::Serve).chain().after(CameraSystems::Settle),
            )
            .add_systems(
                PostUpdate,
                (
                    (follow_scene, finish_loads).chain().in_set(PageSystems::Arrive),
                    traverse.in_set(PageSystems::Traverse),
                    (start_loads, evict).chain().in_set(PageSystems::Serve),
                ),
            );
    }
}

/// Starts over when another file was opened, or when the budget has changed.
pub fn follow_scene(
    mut commands: Commands,
    scene: Option<Res<Scene>>,
    streaming: Option<ResMut<Streaming>>,
    preset: Res<Preset>,
    mut selection: ResMut<ViewSelection>,
    mut copies: ResMut<PageCopies>,
    pages: Query<Entity, With<PageKey>>,
) {
    let Some(scene) = scene else { return };
    let budget = preset.residency.budget_mib << 20;
    if streaming.is_some_and(|s| s.generation == scene.generation && s.residency.statistics().budget == budget) {
        return;
    }
    pages.iter().for_each(|page| commands.entity(page).despawn());
    if let Some(copies) = &mut copies.0 {
        copies.clear();
    }
    *selection = ViewSelection { revision: selection.revision + 1, ..default() };
    commands.insert_resource(Streaming::new(Arc::clone(&scene.file), budget, scene.generation));
}

/// Takes in pages that background tasks have read.
pub fn finish_loads(
    mut commands: Commands,
    streaming: Option<ResMut<Streaming>>,
    mut messages: ResMut<Messages>,
    mut reads: Query<(Entity, &PageKey, &mut PageRead, &mut PageStatus)>,
) {
    let Some(mut streaming) = streaming else { return };
    for (entity, &PageKey { id, .. }, mut read, mut status) in &mut reads {
        // A read of a file that is no longer open is dropped with its entity.
        if streaming.entity(id) != Some(entity) {
            continue;
        }
        let Some(outcome) = check_ready(&mut read.0) else { continue };
        commands.entity(entity).remove::<PageRead>();
        if let Err(error) = &outcome
            && streaming.reported.insert(id)
        {
            messages.error(error.to_string());
            *status = PageStatus::Failed(error.to_string());
        }
        streaming.residency.loaded(id, outcome);
        if let Some(page) = streaming.residency.page(id) {
            let bounds = page.nodes.iter().fold(Bounds::EMPTY, |bounds, node| bounds.union(node.bounds));
            let depth = page.nodes.iter().map(|node| node.key.depth).min().unwrap_or(0);
            *status = PageStatus::Resident(Arc::clone(page));
            commands.entity(entity).insert((PageBounds(bounds), PageDepth(depth)));
        }
    }
}

/// Chooses what the view draws and what it misses.
pub fn traverse(
    streaming: Option<ResMut<Streaming>>,
    settings: Res<Settings>,
    picture: Res<Picture>,
    copies: Res<PageCopies>,
    look: Option<Res<Look>>,
    mut selection: ResMut<ViewSelection>,
    mut statistics: ResMut<Statistics>,
    mut distance: ResMut<DataDistance>,
    mut last_uses: Query<&mut LastUse>,
    camera: Single<&Viewpoint, With<DataCamera>>,
) {
    let Some(mut streaming) = streaming else { return };
    let size = picture.size();
    let Ok(view) = camera.view(size.x, size.y) else { return };
    let streaming = &mut *streaming;
    streaming.frame += 1;
    streaming.residency.begin_frame();
    let roots: Vec<NodeRef> = streaming
        .residency
        .file()
        .metadata()
        .families
        .iter()
        .zip(&settings.families)
        .filter(|(_, visible)| **visible)
        .map(|(family, _)| NodeRef { page: family.root_page, node: 0 })
        .collect();
    let tree = Drawable { residency: &streaming.residency, copies: copies.0.as_ref() };
    let seen = look.map_or(view, |look| look.depiction.selection_view(&view));
    let chosen = select(&seen, settings.error_px, &tree, &roots);
    streaming.residency.touch(chosen.visited.iter().copied());
    let (to_copy, to_read): (Vec<NodeRef>, Vec<NodeRef>) =
        chosen.missing.iter().map(|missing| missing.id).partition(|id| streaming.residency.page(id.page).is_some());
    // What waits for its copy is in use as much as what is drawn.
    streaming.residency.touch(to_copy.iter().copied());
    streaming.residency.request(to_read);
    let nodes: Vec<SceneNode> = chosen
        .draw
        .iter()
        .filter_map(|drawn| {
            let page = Arc::clone(streaming.residency.page(drawn.id.page)?);
            Some(SceneNode { page, node: drawn.id, error_pixels: drawn.error_pixels })
        })
        .collect();
    for page in nodes.iter().map(|drawn| drawn.node.page) {
        if let Some(mut last_use) = streaming.entity(page).and_then(|entity| last_uses.get_mut(entity).ok()) {
            last_use.0 = streaming.frame;
        }
    }
    let boxes = nodes.iter().filter_map(|drawn| Some(drawn.page.nodes.get(drawn.node.node as usize)?.bounds));
    distance.0 = distance_to_boxes(view.eye, boxes);
    statistics.particles = chosen.particles();
    statistics.nodes = nodes.len();
    statistics.error_px = chosen.error_pixels();
    statistics.missing = chosen.missing.len();
    let mut wanted: Vec<PageId> = Vec::new();
    for id in to_copy {
        if !wanted.contains(&id.page) {
            wanted.push(id.page);
        }
    }
    let same = selection.view == Some(view)
        && selection.nodes.len() == nodes.len()
        && selection.nodes.iter().zip(&nodes).all(|(old, new)| old.node == new.node);
    if !same {
        selection.revision += 1;
        selection.view = Some(view);
        selection.nodes = nodes.into();
    }
    selection.wanted_copies = wanted;
    selection.complete = chosen.is_converged();
}

/// Starts to read what is missed, as many pages at a time as the preset allows.
pub fn start_loads(
    mut commands: Commands,
    streaming: Option<ResMut<Streaming>>,
    preset: Res<Preset>,
    mut statistics: ResMut<Statistics>,
) {
    let Some(mut streaming) = streaming else { return };
    while let Some(id) = streaming.residency.next_to_load(preset.residency.requests) {
        let file = Arc::clone(streaming.residency.file());
        let read = IoTaskPool::get().spawn(async move { file.read_page(id) });
        let key = PageKey { id, generation: streaming.generation };
        let page = (key, PageStatus::Loading, LastUse(streaming.frame), PageRead(read));
        let entity = commands.spawn(page).id();
        streaming.entities.insert(id, entity);
    }
    let residency = streaming.residency.statistics();
    statistics.pages_resident = residency.resident;
    statistics.pages_loading = residency.loading + residency.queued;
    statistics.pages_failed = residency.failed;
    statistics.bytes = residency.bytes;
    statistics.budget_bytes = residency.budget;
}

/// Removes the entities of pages that had to make room.
pub fn evict(mut commands: Commands, streaming: Option<ResMut<Streaming>>, mut copies: ResMut<PageCopies>) {
    let Some(mut streaming) = streaming else { return };
    for id in streaming.residency.take_evicted() {
        if let Some(entity) = streaming.entities.remove(&id) {
            commands.entity(entity).despawn();
        }
        if let Some(copies) = &mut copies.bypass_change_detection().0 {
            copies.remove(&id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::facts::Facts;
    use crate::build::{BuildOptions, build_source};
    use crate::import::LoadOptions;
    use bevy::math::DVec3;
    use bevy::tasks::TaskPool;
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
        IoTaskPool::get_or_init(TaskPool::default);
        let bounds = file.metadata().bounds();
        let mut preset = Preset::default();
        preset.residency.budget_mib = budget_mib;
        let mut settings = Settings::new(&preset, None);
        settings.families = vec![true; file.metadata().families.len()];
        let picture = Picture {
            image: Handle::default(),
            texture: bevy_egui::egui::TextureId::default(),
            rect: Rect::new(0.0, 0.0, 960.0, 720.0),
            scale: 1.0,
        };
        let mut app = App::new();
        app.insert_resource(preset)
            .insert_resource(settings)
            .insert_resource(picture)
            .insert_resource(Scene {
                path: file.path().to_owned(),
                file: Arc::clone(file),
                bounds,
                frame: bounds,
                length_unit: String::new(),
                facts: Facts::of(file.metadata()),
                generation: 1,
            })
            .init_resource::<Messages>()
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
        let resident = app.world().resource::<Streaming>().residency.statistics().resident;
        assert_eq!(pages(&mut app), resident);
        let mut described = app.world_mut().query::<(&PageStatus, &PageBounds, &PageDepth, &LastUse)>();
        let bounds = file.metadata().bounds();
        for (status, page, ..) in described.iter(app.world()) {
            assert!(matches!(status, PageStatus::Resident(_)));
            assert!(page.0.min.cmpge(bounds.min - 1e-3).all() && page.0.max.cmple(bounds.max + 1e-3).all());
        }
        assert!(app.world().resource::<DataDistance>().0.is_some_and(|distance| distance > 0.0));
    }

    #[test]
    fn a_copy_that_is_not_there_is_drawn_by_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let file = demo(folder.path());
        let mut app = streaming_app(&file, 1024);
        app.world_mut().resource_mut::<PageCopies>().0 = Some(HashSet::new());
        for _ in 0..200 {
            app.update();
            std::thread::sleep(std::time::Duration::from_millis(2));
            if !app.world().resource::<ViewSelection>().wanted_copies.is_empty() {
                break;
            }
        }
        let selection = app.world().resource::<ViewSelection>().clone();
        assert!(!selection.complete && selection.nodes.is_empty());
        assert_eq!(selection.wanted_copies, [file.metadata().families[0].root_page]);
        // As copies arrive, the picture refines down to the leaves.
        for _ in 0..2000 {
            let selection = app.world().resource::<ViewSelection>().clone();
            if selection.complete {
                break;
            }
            if let Some(copies) = &mut app.world_mut().resource_mut::<PageCopies>().0 {
                copies.extend(selection.wanted_copies);
            }
            app.update();
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        assert!(app.world().resource::<ViewSelection>().complete);
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
        let pick = |cursor| crate::app::pick::pick(&view, file.metadata(), &selection.nodes, cursor);
        let picked = pick([480.0, 360.0]).expect("the box is full of particles");
        let pixel = view.to_pixels(view.to_camera(picked.position)).unwrap();
        assert!((pixel[0] - 480.0).hypot(pixel[1] - 360.0) <= crate::app::pick::REACH + 1e-6);
        assert!((picked.pixels - (pixel[0] - 480.0).hypot(pixel[1] - 360.0)).abs() < 1e-6);
        let bounds = file.metadata().bounds();
        assert!(picked.position.clamp(bounds.min - DVec3::ONE, bounds.max + DVec3::ONE) == picked.position);
        assert!(pick([2.0, 2.0]).is_none(), "nothing is in the corner of a view of the whole box");
    }
}
