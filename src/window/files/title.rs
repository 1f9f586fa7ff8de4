//! The window's title: what is open, and whether the scene file in use says something else than the window shows.

use crate::window::history::History;
use crate::window::scene::{Scene, Settings};
use crate::window::scene_io::{Bookmarks, SceneFiles};
use bevy::prelude::*;
use bevy::window::PrimaryWindow;
use std::path::Path;

/// What a scene file holds, as far as the user edits it: looking around is no edit.
#[derive(Default)]
pub(crate) struct Saved {
    /// How often a scene was saved or opened until then.
    changes: u64,
    /// Settings and bookmarks; `None` until what was opened is settled, and where there is no scene file.
    held: Option<(Settings, Bookmarks)>,
}

/// The title of a window that shows a file; `unsaved`: its scene file says something else.
fn title_of(file: Option<&Path>, unsaved: bool) -> String {
    let mark = if unsaved { "*" } else { "" };
    match file.map(|file| file.file_name().map_or_else(|| file.to_string_lossy(), |name| name.to_string_lossy())) {
        Some(name) => format!("{mark}{name} - deepfield"),
        None => "deepfield".to_owned(),
    }
}

/// Keeps the title.
pub(crate) fn keep_title(
    mut saved: Local<Saved>,
    (scene, files, history): (Option<Res<Scene>>, Res<SceneFiles>, Res<History>),
    (settings, bookmarks): (Res<Settings>, Res<Bookmarks>),
    mut windows: Query<&mut Window, With<PrimaryWindow>>,
) {
    if saved.changes != files.changes {
        *saved = Saved { changes: files.changes, held: None };
    }
    // What the program itself adjusts after opening belongs to what was opened.
    let is_settled = history.present() == Some(&*settings);
    if saved.held.is_none() && files.path.is_some() && is_settled {
        saved.held = Some((settings.clone(), bookmarks.clone()));
    }
    // Of another file there are no settings until they are settled.
    let shown = saved.held.as_ref().zip(history.present());
    let unsaved = shown.is_some_and(|(held, present)| (present, &*bookmarks) != (&held.0, &held.1));
    let file = files.path.as_deref().or(scene.as_ref().map(|scene| scene.path.as_path()));
    let title = title_of(file, unsaved);
    if let Ok(mut window) = windows.single_mut()
        && window.title != title
    {
        window.title = title;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::preset::Preset;
    use std::path::PathBuf;

    #[test]
    fn a_title_names_the_file() {
        for (file, unsaved, title) in [
            (None, false, "deepfield"),
            (Some("/data/snapshot_099.hdf5"), false, "snapshot_099.hdf5 - deepfield"),
            (Some("halo.scene.ron"), true, "*halo.scene.ron - deepfield"),
            (Some("/"), false, "/ - deepfield"),
        ] {
            assert_eq!(title_of(file.map(Path::new), unsaved), title);
        }
    }

    #[test]
    fn an_asterisk_stands_for_settings_that_the_scene_file_does_not_have() {
        let mut app = App::new();
        app.insert_resource(Settings::new(&Preset::default(), None))
            .init_resource::<History>()
            .init_resource::<SceneFiles>()
            .init_resource::<Bookmarks>()
            .add_systems(Update, keep_title);
        let window = app.world_mut().spawn((Window::default(), PrimaryWindow)).id();
        let title = |app: &mut App| {
            for _ in 0..6 {
                let settings = app.world().resource::<Settings>().clone();
                app.world_mut().resource_mut::<History>().observe(&settings, false);
                app.update();
            }
            app.world().get::<Window>(window).unwrap().title.clone()
        };
        let edit = |app: &mut App, error_px: f64| app.world_mut().resource_mut::<Settings>().error_px = error_px;
        assert_eq!(title(&mut app), "deepfield");
        let save = |app: &mut App| {
            let mut files = app.world_mut().resource_mut::<SceneFiles>();
            files.path = Some(PathBuf::from("a.scene.ron"));
            files.changes += 1;
        };
        save(&mut app);
        assert_eq!(title(&mut app), "a.scene.ron - deepfield");
        let before = app.world().resource::<Settings>().error_px;
        edit(&mut app, 2.0 * before);
        assert_eq!(title(&mut app), "*a.scene.ron - deepfield");
        edit(&mut app, before);
        assert_eq!(title(&mut app), "a.scene.ron - deepfield", "what is undone is saved");
        edit(&mut app, 3.0 * before);
        save(&mut app);
        assert_eq!(title(&mut app), "a.scene.ron - deepfield");
    }
}
