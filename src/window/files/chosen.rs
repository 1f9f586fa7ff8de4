//! The system's own dialogs for files: asked for on the main thread, answered whenever the user has chosen.

use super::{Purpose, name_of};
use crate::heights::import::height_extensions;
use crate::import;
use crate::import::grid::grid_extensions;
use crate::look::is_scene_file;
use crate::window::scene_io::first_path;
use bevy::prelude::Entity;
use bevy::tasks::{IoTaskPool, Task, futures::check_ready};
use bevy::winit::WINIT_WINDOWS;
use rfd::AsyncFileDialog;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Nobody cancels a dialog within this time of asking for it: there was none. [`rfd`] tells a dialog that was cancelled from one that could
/// not be shown in its log alone.
const NO_DIALOG: Duration = Duration::from_millis(400);

/// What has come of a dialog.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Made {
    /// A file or a folder was chosen.
    Chosen(PathBuf),
    /// The dialog was cancelled.
    Nothing,
    /// There is no dialog.
    NoDialog,
}

impl Made {
    /// What an answer after some time means.
    fn of(path: Option<PathBuf>, after: Duration) -> Made {
        match path {
            Some(path) => Made::Chosen(path),
            None if after < NO_DIALOG => Made::NoDialog,
            None => Made::Nothing,
        }
    }
}

/// A dialog that is open.
pub(super) struct Choice {
    purpose: Purpose,
    made: Task<Made>,
}

impl Choice {
    /// Opens a dialog over a window, in the folder of `beside`, to choose what the purpose asks for, or a folder to open. On the main thread.
    pub fn begin(purpose: Purpose, is_folder: bool, beside: Option<&Path>, window: Option<Entity>) -> Choice {
        let mut dialog = AsyncFileDialog::new();
        if let Some(folder) = beside.and_then(Path::parent).filter(|folder| folder.is_absolute()) {
            dialog = dialog.set_directory(folder);
        }
        dialog = WINIT_WINDOWS.with_borrow(|windows| match window.and_then(|window| windows.get_window(window)) {
            Some(window) => dialog.set_parent(&**window),
            None => dialog,
        });
        let begun = Instant::now();
        let made = match purpose {
            Purpose::Open if is_folder => wait(begun, dialog.set_title("Open a folder").pick_folder()),
            Purpose::Open => {
                let picked = with_filters(dialog.set_title("Open")).pick_file();
                wait(begun, picked)
            }
            Purpose::SaveAs => {
                let name = beside.map(|path| if is_scene_file(path) { path.to_owned() } else { first_path(path) });
                let name = name.map_or_else(|| "scene.ron".to_owned(), |path| name_of(&path));
                let dialog = dialog.set_title("Save the scene as").add_filter("Scenes", &["ron"]);
                wait(begun, dialog.set_file_name(name).save_file())
            }
        };
        Choice { purpose, made }
    }

    /// What has come of it; to be asked until something has.
    pub fn made(&mut self) -> Option<(Purpose, Made)> {
        check_ready(&mut self.made).map(|made| (self.purpose, made))
    }
}

/// Waits for the user beside the frames.
fn wait(begun: Instant, picked: impl Future<Output = Option<rfd::FileHandle>> + Send + 'static) -> Task<Made> {
    IoTaskPool::get().spawn(async move {
        let path = picked.await.map(|file| file.path().to_owned());
        Made::of(path, begun.elapsed())
    })
}

/// A dialog with the kinds of files that can be opened. Only their content says what files are, so that all are shown at first: those of some
/// formats have names that end in nothing of their own.
fn with_filters(dialog: AsyncFileDialog) -> AsyncFileDialog {
    // There a filter hides all that does not match, and nothing shows the others again.
    if cfg!(target_os = "macos") {
        return dialog;
    }
    dialog
        .add_filter("All files", &["*"])
        .add_filter("Page files", &["df"])
        .add_filter("Particles and tables", &import::extensions())
        .add_filter("Images and volumes", &grid_extensions())
        .add_filter("Heights", &height_extensions())
        .add_filter("Scenes and tours", &["ron"])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_dialog_that_nobody_saw_is_none() {
        let path = PathBuf::from("/data/a.df");
        assert_eq!(Made::of(Some(path.clone()), Duration::ZERO), Made::Chosen(path));
        assert_eq!(Made::of(None, Duration::from_millis(5)), Made::NoDialog);
        assert_eq!(Made::of(None, Duration::from_secs(3)), Made::Nothing);
    }
}
