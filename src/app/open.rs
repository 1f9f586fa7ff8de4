//! Opening files: on a background thread, with progress that the window shows, and without stopping the program where
//! a file cannot be read.

use super::messages::Messages;
use super::objects::{Objects, is_catalogue};
use super::options::{OpenRequest, Opener};
use super::scene_io::OpenedScene;
use crate::model::Bounds;
use crate::model::progress::Progress;
use crate::scene_file::{SceneFile, is_scene_file};
use crate::store::PageFile;
use crate::stream::first_frame;
use bevy::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// How far a background task has come; shared between its threads and the window.
#[derive(Debug, Default)]
pub struct SharedProgress {
    stage: Mutex<String>,
    total: AtomicU64,
    done: AtomicU64,
}

impl SharedProgress {
    /// The present stage's name, and the share of it that is done where its length is known.
    pub fn state(&self) -> (String, Option<f32>) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let total = self.total.load(Ordering::Relaxed);
        let share = self.done.load(Ordering::Relaxed) as f64 / total as f64;
        (stage, (total > 0).then_some(share.min(1.0) as f32))
    }
}

impl Progress for SharedProgress {
    fn begin(&self, stage: &str, total: u64) {
        let mut name = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        stage.clone_into(&mut name);
        self.done.store(0, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
    }

    fn advance(&self, n: u64) {
        self.done.fetch_add(n, Ordering::Relaxed);
    }
}

/// How the window opens files, and what it is opening.
#[derive(Resource)]
pub struct Openings {
    opener: Opener,
    current: Option<Opening>,
}

/// A file on its way.
struct Opening {
    path: PathBuf,
    progress: Arc<SharedProgress>,
    outcome: Mutex<Receiver<Result<Opened, String>>>,
}

/// A file has arrived.
#[derive(bevy::ecs::message::Message, Clone)]
pub struct Opened {
    /// What the user named.
    pub path: PathBuf,
    /// The page file made of it.
    pub file: Arc<PageFile>,
    /// The box to look at first.
    pub frame: Bounds,
    /// The scene that names it.
    pub scene: Option<Arc<OpenedScene>>,
}

impl Openings {
    /// Opens nothing yet.
    pub fn new(opener: Opener) -> Openings {
        Openings { opener, current: None }
    }

    /// Starts to open a file; one that is still on its way is abandoned.
    pub fn start(&mut self, request: OpenRequest) {
        let progress = Arc::new(SharedProgress::default());
        progress.begin("reading", 0);
        let (opener, path, shared) = (Arc::clone(&self.opener), request.path.clone(), Arc::clone(&progress));
        let (send, outcome) = channel();
        // A thread of its own: a disk that does not answer must not take one from a pool that draws.
        let open = move || {
            let (request, scene) = data_of(request)?;
            let file = opener(&request, shared.as_ref())?;
            let file = PageFile::open(&file).map_err(|error| error.to_string())?;
            let families: Vec<u32> = (0..file.metadata().families.len() as u32).collect();
            let frame = first_frame(&file, &families);
            Ok(Opened { path: request.path, file: Arc::new(file), frame, scene: scene.map(Arc::new) })
        };
        let failed = send.clone();
        // Nobody listens any more where another file was opened meanwhile.
        let thread = std::thread::Builder::new().name("deepfield open".into()).spawn(move || drop(send.send(open())));
        if let Err(error) = thread {
            drop(failed.send(Err(format!("{}: no thread can be started: {error}", path.display()))));
        }
        self.current = Some(Opening { path, progress, outcome: Mutex::new(outcome) });
    }

    /// What is being opened: its path, the stage and the share of the stage that is done.
    pub fn progress(&self) -> Option<(&Path, String, Option<f32>)> {
        let opening = self.current.as_ref()?;
        let (stage, share) = opening.progress.state();
        Some((&opening.path, stage, share))
    }
}

/// The data to open: what is named, or what the scene that is named says; its own data where both are.
fn data_of(request: OpenRequest) -> Result<(OpenRequest, Option<OpenedScene>), String> {
    let (path, data) = match request.scene {
        Some(scene) => (scene, request.path),
        None if is_scene_file(&request.path) => (request.path, PathBuf::new()),
        None => return Ok((request, None)),
    };
    let scene = SceneFile::read(&path).map_err(|error| error.to_string())?;
    let mut notes = Vec::new();
    let mut data = data;
    if data.as_os_str().is_empty() {
        let named = scene.datasets.first().ok_or_else(|| format!("{}: no dataset is named", path.display()))?;
        let located = named.locate(&path).map_err(|error| error.to_string())?;
        (data, notes) = (located.path, located.notes);
    }
    Ok((OpenRequest { path: data, scene: None }, Some(OpenedScene { path, scene, notes })))
}

/// Starts to open files that are dropped on the window.
pub(super) fn open_dropped_files(
    mut dropped: MessageReader<FileDragAndDrop>,
    mut openings: ResMut<Openings>,
    mut objects: ResMut<Objects>,
) {
    for event in dropped.read() {
        if let FileDragAndDrop::DroppedFile { path_buf, .. } = event {
            if is_catalogue(path_buf) {
                objects.open(path_buf.clone());
                continue;
            }
            openings.start(OpenRequest { path: path_buf.clone(), scene: None });
        }
    }
}

/// Hands over files that have arrived and reports those that cannot be opened.
pub(super) fn finish_opening(
    mut openings: ResMut<Openings>,
    mut messages: ResMut<Messages>,
    mut opened: MessageWriter<Opened>,
) {
    let Some(opening) = openings.bypass_change_detection().current.as_mut() else { return };
    let outcome = opening.outcome.get_mut().unwrap_or_else(PoisonError::into_inner).try_recv();
    let path = std::mem::take(&mut opening.path);
    let result = match outcome {
        Ok(result) => result,
        Err(TryRecvError::Disconnected) => Err(format!("{}: opening it has failed", path.display())),
        Err(TryRecvError::Empty) => {
            opening.path = path;
            return;
        }
    };
    openings.current = None;
    match result {
        Ok(file) => {
            opened.write(file);
        }
        Err(error) => messages.error(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[test]
    fn a_scene_leads_to_its_data() {
        let folder = tempfile::tempdir().unwrap();
        let (data, path) = (folder.path().join("box.df"), folder.path().join("a.scene.ron"));
        std::fs::write(&data, b"data").unwrap();
        std::fs::write(&path, "(version: 1, datasets: [(path: \"box.df\")])").unwrap();
        let open = |path: &Path, scene: Option<&Path>| {
            data_of(OpenRequest { path: path.to_owned(), scene: scene.map(Path::to_owned) })
        };
        let (request, scene) = open(&path, None).unwrap();
        assert_eq!((request.path, scene.unwrap().path), (data.clone(), path.clone()));
        let (request, scene) = open(Path::new("other.df"), Some(&path)).unwrap();
        assert!(request.path == Path::new("other.df") && scene.is_some(), "other data in the light of a scene");
        assert!(open(&data, None).unwrap().1.is_none());
        std::fs::remove_file(&data).unwrap();
        let error = open(&path, None).unwrap_err();
        assert!(error.contains("a.scene.ron: the data is not at") && error.contains("--scene"), "{error}");
    }

    #[test]
    fn a_dropped_file_is_opened_and_a_failure_is_reported() {
        let opener: Opener = Arc::new(|request, _| Err(format!("{}: not readable", request.path.display())));
        let mut app = App::new();
        app.add_message::<FileDragAndDrop>()
            .add_message::<Opened>()
            .insert_resource(Openings::new(opener))
            .init_resource::<Messages>()
            .init_resource::<Objects>()
            .add_systems(Update, (open_dropped_files, finish_opening).chain());
        let window = app.world_mut().spawn_empty().id();
        app.world_mut().write_message(FileDragAndDrop::HoveredFile { window, path_buf: "dragged.hdf5".into() });
        app.update();
        assert!(app.world().resource::<Openings>().current.is_none(), "a file that only hovers is not opened");
        app.world_mut().write_message(FileDragAndDrop::DroppedFile { window, path_buf: "dropped.hdf5".into() });
        let start = Instant::now();
        while app.world().resource::<Messages>().all().next().is_none() {
            assert!(start.elapsed() < Duration::from_secs(60), "nothing is reported");
            app.update();
            std::thread::sleep(Duration::from_millis(1));
        }
        let messages: Vec<String> =
            app.world().resource::<Messages>().all().map(|message| message.text.clone()).collect();
        assert_eq!(messages, ["dropped.hdf5: not readable"]);
    }
}
