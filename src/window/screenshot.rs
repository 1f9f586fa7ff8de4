//! Saving the window as a PNG.

use super::state::notices::Notices;
use crate::model::new_file;
use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy::tasks::{IoTaskPool, Task, futures::check_ready};
use std::fs::File;
use std::io;
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
                write(image, &folder)
            });
            screenshots.0.push(task);
        },
    );
}

/// The first of `deepfield-0001.png`, `deepfield-0002.png`, ... that nobody has in `folder`: made as an empty file, so that no other picture
/// takes it.
fn claim_name(folder: &Path) -> io::Result<PathBuf> {
    for number in 1..u32::MAX {
        let path = folder.join(format!("deepfield-{number:04}.png"));
        match File::create_new(&path) {
            Ok(_) => return Ok(path),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

/// Writes an image as an opaque PNG into a folder: whole under a name that no file has, or not at all.
fn write(image: Image, folder: &Path) -> Result<PathBuf, String> {
    let fail = |error: &dyn std::fmt::Display| format!("{}: {error}", folder.display());
    let picture = image.try_into_dynamic().map_err(|error| fail(&error))?.to_rgb8();
    let whole = new_file::builder().suffix(".png").tempfile_in(folder);
    let whole = whole.map_err(|error| fail(&new_file::without_name(&error)))?.into_temp_path();
    picture.save(&whole).map_err(|error| fail(&error))?;
    let path = claim_name(folder).map_err(|error| fail(&error))?;
    whole.persist(&path).map_err(|error| format!("{}: {}", path.display(), error.error))?;
    Ok(path)
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
    use bevy::asset::RenderAssetUsages;
    use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};

    #[test]
    fn pictures_of_one_moment_are_written_beside_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let first = folder.path().join("deepfield-0001.png");
        std::fs::write(&first, "mine").unwrap();
        let image = || {
            let size = Extent3d { width: 5, height: 4, depth_or_array_layers: 1 };
            let (format, usage) = (TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::default());
            Image::new_fill(size, TextureDimension::D2, &[1, 2, 3, 255], format, usage)
        };
        std::thread::scope(|scope| {
            for _ in 0..6 {
                scope.spawn(|| write(image(), folder.path()).unwrap());
            }
        });
        assert_eq!(std::fs::read(&first).unwrap(), b"mine");
        let files: Vec<PathBuf> =
            std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        let whole = files.iter().filter(|path| std::fs::read(path).unwrap().starts_with(b"\x89PNG")).count();
        assert_eq!((files.len(), whole), (7, 6), "{files:?}");
    }
}
