//! Saving the window as a PNG.

use super::state::notices::Notices;
use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy::tasks::{IoTaskPool, Task, futures::check_ready};
use std::path::{Path, PathBuf};

/// Pictures that are being written.
#[derive(Resource, Default)]
pub struct Screenshots(Vec<Task<Result<PathBuf, String>>>);

/// Asks for a picture of the window as it will be drawn in this frame.
pub(super) fn take(commands: &mut Commands) {
    commands.spawn(Screenshot::primary_window()).observe(
        |captured: On<ScreenshotCaptured>, mut screenshots: ResMut<Screenshots>| {
            let image = captured.image.clone();
            let task = IoTaskPool::get().spawn(async move {
                let folder = std::env::current_dir().map_err(|error| format!("working folder: {error}"))?;
                write(image, &free_name(&folder))
            });
            screenshots.0.push(task);
        },
    );
}

/// The first of `deepfield-0001.png`, `deepfield-0002.png`, ... that does not exist in `folder`.
fn free_name(folder: &Path) -> PathBuf {
    let name = |i: u32| folder.join(format!("deepfield-{i:04}.png"));
    (1..u32::MAX).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(u32::MAX))
}

/// Writes an image as an opaque PNG.
fn write(image: Image, path: &Path) -> Result<PathBuf, String> {
    let fail = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let picture = image.try_into_dynamic().map_err(|error| fail(&error))?.to_rgb8();
    picture.save(path).map_err(|error| fail(&error))?;
    Ok(path.to_owned())
}

/// Reports pictures that have been written.
pub(super) fn report_screenshots(mut screenshots: ResMut<Screenshots>, mut notices: ResMut<Notices>) {
    screenshots.bypass_change_detection().0.retain_mut(|task| match check_ready(task) {
        None => true,
        Some(Ok(path)) => {
            notices.info(format!("saved {}", path.display()));
            false
        }
        Some(Err(error)) => {
            notices.error(error);
            false
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_picture_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let first = free_name(folder.path());
        assert_eq!(first.file_name().unwrap(), "deepfield-0001.png");
        std::fs::write(&first, b"mine").unwrap();
        assert_eq!(free_name(folder.path()).file_name().unwrap(), "deepfield-0002.png");
    }
}
