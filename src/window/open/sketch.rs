//! Opening an image or a volume: its samples are shown as soon as they are read, and a few of its voxels stand in for all of them as
//! particles until those are built.

use super::{Opened, OpenedScene};
use crate::build::{BuildOptions, build};
use crate::look::{DataKind, Member};
use crate::model::ReadMethod;
use crate::picture::field::{MEMORY, OpenField};
use crate::store::PageFile;
use crate::stream::first_frame;
use crate::window::sampled::Sampled;
use crate::window::scene::SceneField;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tempfile::TempDir;

/// Particles that stand in for all voxels.
const SKETCHED: usize = 20_000;
/// What takes no longer than this is waited for: the voxels are in the cache.
pub(super) const PATIENCE: Duration = Duration::from_millis(600);
/// Grids of more samples than this are shown without all of their voxels.
const MOST_VOXELS: u64 = 1 << 28;

/// What is shown before everything is there.
pub(super) struct Sketch {
    first: Opened,
    field: SceneField,
    send: Sender<Result<Opened, String>>,
    /// Whether all voxels have come, or the sketch is shown.
    state: Arc<Mutex<State>>,
    /// Why all voxels are not built.
    alone: Option<String>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Begun,
    Shown,
    Over,
}

impl Sketch {
    /// Reads the samples.
    ///
    /// # Errors
    /// When they cannot be read, or nothing can be written to the folder for temporary files.
    pub fn begin(
        members: &[Member],
        scene: &Option<OpenedScene>,
        read: ReadMethod,
        send: Sender<Result<Opened, String>>,
    ) -> Result<Sketch, String> {
        let members = members.iter().map(Member::resolved).collect::<Result<Vec<_>, _>>();
        let members = members.map_err(|error| error.to_string())?;
        let path = members.first().map(|member| member.path.clone()).unwrap_or_default();
        let field = OpenField::open(&path, read, Some(MEMORY)).map_err(|error| error.to_string())?;
        let field = Arc::new(field);
        let (file, folder) = sketched(&Sampled::Field(Arc::clone(&field)))?;
        let families: Vec<u32> = (0..file.metadata().families.len() as u32).collect();
        let frame = first_frame(&file, &families, 0.0);
        let is_built = matches!(DataKind::of(&path), Ok(DataKind::Grid));
        let alone = match (is_built, field.samples() > MOST_VOXELS) {
            (true, _) => {
                Some("a few of its voxels are there as particles: a file that was built holds no others".into())
            }
            (_, true) => {
                Some(format!("a few of its voxels are there as particles, since it has more than {MOST_VOXELS}"))
            }
            (false, false) => None,
        };
        let notes = field.notes().iter().map(|note| format!("{}: {note}", path.display())).collect();
        let field = SceneField { sketch: Some(Arc::new(folder)), ..SceneField::new(Sampled::Field(field)) };
        let first = Opened {
            path,
            members,
            notes,
            run: None,
            tracks: None,
            field: Some(field.clone()),
            file: Arc::new(file),
            frame,
            scene: scene.clone().map(Arc::new),
            map: None,
            keeps: false,
            has_more: true,
        };
        Ok(Sketch { first, field, send, state: Arc::default(), alone })
    }

    /// Opens all voxels, and shows the sketch meanwhile where that takes long.
    ///
    /// # Errors
    /// As `open`, where nothing is shown yet.
    pub fn end(self, open: impl FnOnce() -> Result<Opened, String> + Send) -> Result<Opened, String> {
        let Sketch { first, field, send, state, alone } = self;
        if let Some(why) = alone {
            let notes = first.notes.iter().cloned().chain([why]).collect();
            return Ok(Opened { notes, has_more: false, ..first });
        }
        let (shown, known) = (first.clone(), Arc::clone(&state));
        let show = move || {
            std::thread::sleep(PATIENCE);
            let mut state = known.lock().unwrap_or_else(PoisonError::into_inner);
            // Nobody listens any more where another file was opened meanwhile.
            if *state == State::Begun && send.send(Ok(shown)).is_ok() {
                *state = State::Shown;
            }
        };
        // Without a thread all of it is waited for.
        drop(std::thread::Builder::new().name("deepfield sketch".into()).spawn(show));
        // A part of the processor only: the picture of the samples needs it more.
        let threads = (std::thread::available_parallelism().map_or(1, usize::from) / 2).max(1);
        let all = match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(few) => few.install(open),
            Err(error) => Err(format!("no threads can be started: {error}")),
        };
        let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
        let is_shown = std::mem::replace(&mut *state, State::Over) == State::Shown;
        match (all, is_shown) {
            (Ok(all), _) => {
                let own = if is_shown { Vec::new() } else { first.notes };
                let notes = own.into_iter().chain(all.notes).collect();
                Ok(Opened { field: Some(field), notes, keeps: is_shown, ..all })
            }
            // Its samples can be seen all the same.
            (Err(why), false) => Ok(Opened { notes: vec![why], has_more: false, ..first }),
            (Err(why), true) => Err(why),
        }
    }
}

/// A page file of the sketch, in a folder for it alone.
pub(super) fn sketched(field: &Sampled) -> Result<(PageFile, TempDir), String> {
    let told = |error: std::io::Error| format!("a folder for temporary files: {error}");
    let folder = tempfile::Builder::new().prefix("deepfield-sketch").tempdir().map_err(told)?;
    let path = folder.path().join("sketch.df");
    build(field.sketch(SKETCHED), &BuildOptions::default(), &path, &()).map_err(|error| error.to_string())?;
    Ok((PageFile::open(&path).map_err(|error| error.to_string())?, folder))
}
