//! How the window comes to its files, as other programs of a desktop do: by the system's dialogs, a path that is typed, the list of files
//! that were opened before, the first page of a window without one, and another process that asks for one.
//!
//! What the menu, the page and keys ask for is noted in [`Files`], and carried out once a frame. Files are opened as those are that are
//! dropped on the window.

pub mod door;
pub mod menu;
pub mod page;
pub mod recent;
pub mod typed;

mod chosen;
mod title;

pub(crate) use title::keep_title;

use super::input::{PointerOwner, is_control, is_shift};
use super::open::{Opened, Wanted};
use super::options::{Demo, WindowOptions};
use super::scene::Scene;
use super::scene_io::SceneFiles;
use super::state::answer::Answer;
use super::state::notices::Notices;
use crate::look::is_scene_file;
use bevy::ecs::system::NonSendMarker;
use bevy::prelude::*;
use bevy::window::PrimaryWindow;
use chosen::{Choice, Made};
use door::Door;
use recent::Recent;
use std::path::{Path, PathBuf};
use typed::Typed;

/// What a file is chosen for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// To open it.
    Open,
    /// To save the scene there.
    SaveAs,
}

/// What the user asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ask {
    /// To choose a file in the system's dialog; where there is none, to type its path.
    Choose(Purpose),
    /// The same with a folder to open, which stands for what is in it.
    ChooseFolder,
    /// To type the path of a file.
    Type(Purpose),
    /// To have the file that was chosen or typed.
    Use(Purpose, PathBuf),
    /// To save the scene where it was saved before.
    Save,
    /// To open the demo.
    Demo,
    /// To forget the files that were opened before.
    Forget,
}

/// The files that the window knows of, and what is asked for.
#[derive(Resource, Default)]
pub struct Files {
    /// What the user asks for.
    pub asked: Option<Ask>,
    /// Files that were opened before.
    pub recent: Recent,
    /// A path that is being typed.
    pub typed: Option<Typed>,
    /// Whether the first page is shown.
    pub is_page_shown: bool,
    /// Whether something else than a file is waited for, so that there is no first page.
    waits: bool,
    choice: Option<Choice>,
    /// There is no dialog: this has been told.
    lacks_dialogs: bool,
    demo: Option<Demo>,
    making_demo: Answer<PathBuf>,
    door: Option<Door>,
}

impl Files {
    /// What a window begins with.
    pub(super) fn new(options: &WindowOptions) -> Files {
        Files {
            recent: Recent::new(options.recent.clone()),
            waits: options.grower.is_some() || options.tour.is_some() || options.audience,
            demo: options.demo.clone(),
            // Without a door the window does all else that it does.
            door: options.reached_in.as_deref().and_then(|folder| Door::open(folder).ok()),
            ..Files::default()
        }
    }

    /// Whether there is a demo to open.
    pub fn has_demo(&self) -> bool {
        self.demo.is_some()
    }

    /// Whether a window that shows nothing and opens nothing shows the first page.
    pub fn has_page(&self) -> bool {
        !self.waits
    }
}

/// Ctrl+O, Ctrl+Shift+O and Ctrl+Shift+S.
pub(super) fn take_keys(keys: Res<ButtonInput<KeyCode>>, owner: Res<PointerOwner>, mut files: ResMut<Files>) {
    if !is_control(&keys) || !owner.keyboard_is_free() {
        return;
    }
    match (is_shift(&keys), keys.just_pressed(KeyCode::KeyO), keys.just_pressed(KeyCode::KeyS)) {
        (false, true, _) => files.asked = Some(Ask::Choose(Purpose::Open)),
        (true, true, _) => files.asked = Some(Ask::ChooseFolder),
        (true, _, true) => files.asked = Some(Ask::Choose(Purpose::SaveAs)),
        _ => {}
    }
}

/// Carries out what is asked for, and goes on with what takes its time. Dialogs are opened on the main thread.
pub(super) fn carry_out(
    _main_thread: NonSendMarker,
    mut files: ResMut<Files>,
    mut scene_files: ResMut<SceneFiles>,
    scene: Option<Res<Scene>>,
    mut notices: ResMut<Notices>,
    mut wanted: MessageWriter<Wanted>,
    mut windows: Query<(Entity, &mut Window), With<PrimaryWindow>>,
) {
    let files = &mut *files;
    if let Some(why) = files.recent.go_on() {
        notices.error(why);
    }
    if let Some(path) = files.door.as_mut().and_then(Door::asked) {
        wanted.write(Wanted(path));
        if let Ok((_, mut window)) = windows.single_mut() {
            window.focused = true;
        }
    }
    if files.making_demo.receive() {
        match std::mem::take(&mut files.making_demo) {
            Answer::Here(path) => {
                wanted.write(Wanted(path));
            }
            Answer::Failed(why) => notices.error(why),
            Answer::Nothing | Answer::Coming(_) => {}
        }
    }
    if let Some((purpose, made)) = files.choice.as_mut().and_then(Choice::made) {
        files.choice = None;
        match made {
            Made::Chosen(path) => files.asked = Some(Ask::Use(purpose, path)),
            Made::Nothing => {}
            Made::NoDialog => {
                if !std::mem::replace(&mut files.lacks_dialogs, true) {
                    notices.info("this system has no file dialog (an XDG desktop portal, or zenity): type the path");
                }
                files.asked = Some(Ask::Type(purpose));
            }
        }
    }
    let Some(ask) = files.asked.take() else { return };
    let is_folder = ask == Ask::ChooseFolder;
    let saves = matches!(
        ask,
        Ask::Choose(Purpose::SaveAs) | Ask::Type(Purpose::SaveAs) | Ask::Use(Purpose::SaveAs, _) | Ask::Save
    );
    if saves && scene.is_none() {
        notices.info("nothing is open: there is no scene to save");
        return;
    }
    match ask {
        Ask::Choose(purpose) if files.lacks_dialogs => files.typed = Some(Typed::new(purpose)),
        Ask::ChooseFolder if files.lacks_dialogs => files.typed = Some(Typed::new(Purpose::Open)),
        // One dialog at a time.
        Ask::Choose(_) | Ask::ChooseFolder if files.choice.is_some() => {}
        Ask::Choose(_) | Ask::ChooseFolder => {
            let purpose = if saves { Purpose::SaveAs } else { Purpose::Open };
            let window = windows.single().ok().map(|(entity, _)| entity);
            let begin = scene.as_ref().map(|scene| scene.path.as_path());
            let begin = scene_files.path.as_deref().or(begin);
            let begin = begin.or(files.recent.files().first().map(|known| known.path.as_path()));
            files.choice = Some(Choice::begin(purpose, is_folder, begin, window));
        }
        Ask::Type(purpose) => files.typed = Some(Typed::new(purpose)),
        Ask::Use(Purpose::Open, path) => {
            wanted.write(Wanted(path));
        }
        Ask::Use(Purpose::SaveAs, path) => {
            let named = scene_path(path.clone());
            // A dialog has asked before the file that was chosen is replaced, and about no other.
            match named != path && named.exists() {
                true => notices.error(format!("{}: found a file, expected a name that none has", named.display())),
                false => scene_files.save_as = Some(named),
            }
        }
        Ask::Save => scene_files.asked = true,
        Ask::Demo => {
            if let Some(demo) = files.demo.clone() {
                files.making_demo = Answer::ask("demo", move |_| demo());
            }
        }
        Ask::Forget => files.recent.clear(),
    }
}

/// Keeps what was opened in the list.
pub(super) fn remember_opened(mut opened: MessageReader<Opened>, mut files: ResMut<Files>) {
    // What is more of what is open was opened under another name.
    for opened in opened.read().filter(|opened| !opened.keeps) {
        let path = opened.scene.as_ref().map_or(opened.path.as_path(), |scene| scene.path.as_path());
        if opened.scene.is_some() || opened.members.len() == 1 {
            files.recent.add(path);
        }
    }
}

/// Where a scene is saved that is to be at `path`: it has to end as scenes do to be opened as one.
fn scene_path(path: PathBuf) -> PathBuf {
    if is_scene_file(&path) {
        return path;
    }
    let mut name = path.into_os_string();
    name.push(".scene.ron");
    name.into()
}

/// The last part of a path.
fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    #[test]
    fn scenes_end_as_scenes_do() {
        for (path, expected) in
            [("/a/halo.scene.ron", "/a/halo.scene.ron"), ("halo.RON", "halo.RON"), ("snap.099", "snap.099.scene.ron")]
        {
            assert_eq!(scene_path(path.into()), PathBuf::from(expected));
        }
    }

    #[test]
    fn files_and_folders_are_asked_for_by_keys() {
        let mut app = App::new();
        app.init_resource::<Files>().init_resource::<PointerOwner>().add_systems(Update, take_keys);
        let [control, shift] = [KeyCode::ControlLeft, KeyCode::ShiftLeft];
        for (keys, asked) in [
            (vec![KeyCode::KeyO], None),
            (vec![control, KeyCode::KeyO], Some(Ask::Choose(Purpose::Open))),
            (vec![control, shift, KeyCode::KeyO], Some(Ask::ChooseFolder)),
            (vec![control, shift, KeyCode::KeyS], Some(Ask::Choose(Purpose::SaveAs))),
        ] {
            let mut input = ButtonInput::<KeyCode>::default();
            keys.iter().for_each(|key| input.press(*key));
            app.insert_resource(input);
            app.update();
            assert_eq!(app.world_mut().resource_mut::<Files>().asked.take(), asked, "{keys:?}");
        }
    }

    #[test]
    fn the_demo_and_typed_files_are_asked_for_and_a_scene_is_saved_only_where_something_is_open() {
        let mut app = App::new();
        let demo: Demo = Arc::new(|| Ok("/cache/demo.hdf5".into()));
        app.add_message::<Wanted>()
            .insert_resource(Files { demo: Some(demo), lacks_dialogs: true, ..Files::default() })
            .init_resource::<SceneFiles>()
            .init_resource::<Notices>()
            .add_systems(Update, carry_out);
        let mut wanted = |ask: Ask| {
            app.world_mut().resource_mut::<Files>().asked = Some(ask);
            let start = Instant::now();
            loop {
                app.update();
                let mut messages = app.world_mut().resource_mut::<bevy::ecs::message::Messages<Wanted>>();
                let found = messages.drain().next();
                let is_over = {
                    let files = app.world().resource::<Files>();
                    files.typed.is_some() || matches!(files.making_demo, Answer::Nothing)
                };
                if found.is_some() || is_over {
                    let notices = app.world().resource::<Notices>().all().map(|notice| notice.text.clone());
                    let notices: Vec<String> = notices.collect();
                    return (found, app.world_mut().resource_mut::<Files>().typed.take(), notices);
                }
                assert!(start.elapsed() < Duration::from_secs(60), "nothing happens");
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        assert_eq!(wanted(Ask::Demo).0, Some(Wanted("/cache/demo.hdf5".into())));
        assert_eq!(wanted(Ask::Use(Purpose::Open, "a.df".into())).0, Some(Wanted("a.df".into())));
        for ask in [Ask::Choose(Purpose::Open), Ask::ChooseFolder] {
            let (_, typed, _) = wanted(ask);
            assert!(typed.is_some_and(|typed| typed.purpose == Purpose::Open), "there are no dialogs");
        }
        let (_, typed, notices) = wanted(Ask::Choose(Purpose::SaveAs));
        assert!(typed.is_none() && notices == ["nothing is open: there is no scene to save"], "{notices:?}");
    }
}
