//! Files that are dropped on the window, or asked for in another way: tours, catalogues and data, each opened as what it is.

use super::objects::{Objects, may_be_catalogue};
use super::open::{Openings, Wanted};
use super::scene::Scene;
use super::touring::{Asked, Player};
use crate::look::is_scene_file;
use crate::tour::TourFile;
use bevy::prelude::*;
use std::path::Path;

/// Whether a file is RON that reads as a tour: a scene has the same ending.
fn is_tour(path: &Path) -> bool {
    is_scene_file(path) && TourFile::read(path).is_ok()
}

/// Starts to open files that are dropped on the window: in the place of what is open, or with it where the user wants that; what is asked for
/// otherwise always in its place.
pub(super) fn open_dropped_files(
    mut dropped: MessageReader<FileDragAndDrop>,
    mut wanted: MessageReader<Wanted>,
    keys: Res<ButtonInput<KeyCode>>,
    scene: Option<Res<Scene>>,
    mut openings: ResMut<Openings>,
    mut objects: ResMut<Objects>,
    mut player: ResMut<Player>,
) {
    let adds = openings.adds_dropped || keys.any_pressed([KeyCode::ShiftLeft, KeyCode::ShiftRight]);
    let dropped = dropped.read().filter_map(|event| match event {
        FileDragAndDrop::DroppedFile { path_buf, .. } => Some((path_buf, adds)),
        _ => None,
    });
    for (path, adds) in dropped.chain(wanted.read().map(|Wanted(path)| (path, false))) {
        if is_tour(path) {
            player.ask(Asked::Open(path.clone()));
            // It plays over what is open or on its way, else over the data that it names.
            if scene.is_none() && !openings.is_opening() {
                openings.open(path, false, None);
            }
            continue;
        }
        match may_be_catalogue(path) {
            true => objects.consider(path.clone(), adds),
            false => openings.open(path, adds, scene.as_deref()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::Member;
    use crate::store::PageFile;
    use crate::window::open::{Opened, finish_opening};
    use crate::window::options::Opener;
    use crate::window::picture::Picture;
    use crate::window::state::notices::Notices;
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    /// What opens files that are dropped, and the window that they are dropped on.
    fn app_with(opener: Opener) -> (App, Entity) {
        let mut app = App::new();
        app.add_message::<FileDragAndDrop>()
            .add_message::<Wanted>()
            .add_message::<Opened>()
            .insert_resource(Openings::new(opener))
            .insert_resource(Picture::at(Rect::new(0.0, 0.0, 1280.0, 720.0)))
            .init_resource::<Notices>()
            .init_resource::<Objects>()
            .init_resource::<Player>()
            .init_resource::<ButtonInput<KeyCode>>()
            .add_systems(
                Update,
                (open_dropped_files, crate::window::objects::receive_catalogue, finish_opening).chain(),
            );
        let window = app.world_mut().spawn_empty().id();
        (app, window)
    }

    #[test]
    fn tours_are_told_from_scenes_and_catalogues() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text, tour) in [
            ("show.ron", "(version: 1, keyframes: [()])", true),
            ("a.scene.ron", "(version: 1, datasets: [(path: \"a.df\")])", false),
            ("names.ron", "(objects: [(name: \"Coma\", position: (1.0, 2.0, 3.0))])", false),
            ("show.txt", "(version: 1, keyframes: [()])", false),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            assert_eq!(is_tour(&path), tour, "{name}");
        }
        assert!(!is_tour(&folder.path().join("none.ron")));
    }

    #[test]
    fn a_dropped_file_is_opened_and_a_failure_is_reported() {
        let opener: Opener = Arc::new(|path, _, _| Err(format!("{}: not readable", path.display())));
        let (mut app, window) = app_with(opener);
        app.world_mut().write_message(FileDragAndDrop::HoveredFile { window, path_buf: "dragged.hdf5".into() });
        app.update();
        assert!(app.world().resource::<Openings>().progress().is_none(), "a file that only hovers is not opened");
        app.world_mut().write_message(FileDragAndDrop::DroppedFile { window, path_buf: "dropped.hdf5".into() });
        let start = Instant::now();
        while app.world().resource::<Notices>().all().next().is_none() {
            assert!(start.elapsed() < Duration::from_secs(60), "nothing is reported");
            app.update();
            std::thread::sleep(Duration::from_millis(1));
        }
        let notices: Vec<String> = app.world().resource::<Notices>().all().map(|notice| notice.text.clone()).collect();
        assert_eq!(notices, ["dropped.hdf5: not readable"]);

        // A catalogue is told from data by its content, off the main thread, and opened beside the data.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("names.ron");
        std::fs::write(&path, "(objects: [(name: \"Coma\", position: (1.0, 2.0, 3.0))])").unwrap();
        app.world_mut().write_message(FileDragAndDrop::DroppedFile { window, path_buf: path.clone() });
        while app.world().resource::<Objects>().path() != Some(&path) {
            assert!(start.elapsed() < Duration::from_secs(60), "the catalogue is not opened");
            app.update();
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(app.world().resource::<Openings>().progress().is_none(), "it is no data");
        assert_eq!(app.world().resource::<Objects>().labels.len(), 1);
    }

    #[test]
    fn a_file_that_is_dropped_with_shift_joins_what_is_open() {
        let folder = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5");
        let page_file = folder.path().join("demo.df");
        let options = (crate::import::LoadOptions::default(), crate::build::BuildOptions::default());
        crate::build::build_source(&source, &options.0, &options.1, &page_file, &()).unwrap();
        let built = page_file.clone();
        let opener: Opener = Arc::new(move |_, _, _| Ok(built.clone()));
        let file = Arc::new(PageFile::open(&page_file).unwrap());
        let (mut app, window) = app_with(opener);
        app.insert_resource(Scene::of_file(file, vec![Member::new(&page_file)]));
        let mut open = |dropped: &[&str], shift: bool, adds: bool| {
            let mut keys = ButtonInput::<KeyCode>::default();
            if shift {
                keys.press(KeyCode::ShiftLeft);
            }
            app.insert_resource(keys);
            app.world_mut().resource_mut::<Openings>().adds_dropped = adds;
            for name in dropped {
                let path_buf = name.into();
                app.world_mut().write_message(FileDragAndDrop::DroppedFile { window, path_buf });
            }
            if dropped.is_empty() {
                app.world_mut().write_message(Wanted("new.hdf5".into()));
            }
            let start = Instant::now();
            loop {
                app.update();
                let arrived: Vec<Opened> =
                    app.world_mut().resource_mut::<bevy::ecs::message::Messages<Opened>>().drain().collect();
                if let Some(opened) = arrived.into_iter().last() {
                    return (opened.members.len(), opened.file.parts().len(), opened.path);
                }
                assert!(start.elapsed() < Duration::from_secs(60), "nothing arrives");
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        assert_eq!(open(&["new.hdf5"], false, false), (1, 1, "new.hdf5".into()));
        assert_eq!(open(&["new.hdf5"], true, false), (2, 2, page_file.clone()));
        assert_eq!(open(&["new.hdf5"], false, true), (2, 2, page_file.clone()));
        assert_eq!(open(&[], true, true), (1, 1, "new.hdf5".into()), "what is not dropped takes its place");
        // All files of one drop.
        assert_eq!(open(&["one", "other"], true, false), (3, 3, page_file.clone()));
        assert_eq!(open(&["one", "other"], false, false), (1, 1, "other".into()));
    }

    #[test]
    fn a_tour_brings_its_data_where_nothing_is_open() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("snapshot");
        std::fs::write(&data, "data").unwrap();
        let tour = folder.path().join("show.ron");
        std::fs::write(&tour, "(version: 1, dataset: (path: \"snapshot\"), keyframes: [()])").unwrap();
        let (mut app, window) = app_with(Arc::new(|path, _, _| Err(format!("{}: asked for", path.display()))));
        app.world_mut().write_message(FileDragAndDrop::DroppedFile { window, path_buf: tour });
        let start = Instant::now();
        while app.world().resource::<Notices>().all().next().is_none() {
            assert!(start.elapsed() < Duration::from_secs(60), "its data is not opened");
            app.update();
            std::thread::sleep(Duration::from_millis(1));
        }
        let notices: Vec<String> = app.world().resource::<Notices>().all().map(|notice| notice.text.clone()).collect();
        assert_eq!(notices, [format!("{}: asked for", data.display())]);
    }
}
