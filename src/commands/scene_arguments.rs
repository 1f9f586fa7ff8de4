//! Scenes on the command line: `deepfield render x.scene.ron`, or `--scene x.scene.ron` for any data.

use super::arguments::PictureSize;
use super::render_arguments::Arguments;
use crate::look::dataset::located;
use crate::look::{Member, SceneError, SceneFile, is_scene_file};
use crate::mode::Settings;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// The scene and the data that the command line names: a scene's own data where it names no other. `None` without a scene.
fn named(path: &Path, scene: Option<&Path>) -> Option<(PathBuf, Option<PathBuf>)> {
    match scene {
        Some(scene) => Some((scene.to_owned(), (!path.as_os_str().is_empty()).then(|| path.to_owned()))),
        None => is_scene_file(path).then(|| (path.to_owned(), None)),
    }
}

/// The arguments with what the scene that they name says where they say nothing; unchanged where they name none.
///
/// # Errors
/// [`SceneError`] where the scene or its data cannot be found or read.
pub fn complete(arguments: Arguments) -> Result<Arguments, SceneError> {
    let Some((path, data)) = named(&arguments.path, arguments.scene.as_deref()) else { return Ok(arguments) };
    let mut scene = SceneFile::read(&path)?;
    if let Some(film) = &mut scene.film {
        let folder = path.parent().unwrap_or(Path::new(""));
        film.overlay.images.iter_mut().for_each(|image| image.path = folder.join(&image.path));
    }
    let members = match data {
        // Other data in the light of the scene: its families are those that the scene's first dataset shows.
        Some(data) => {
            let families = scene.datasets.first().and_then(|dataset| dataset.families.clone());
            vec![Member { families, ..Member::new(data) }]
        }
        None => {
            let located = scene.locate(&path)?;
            located.notes.iter().for_each(|note| eprintln!("deepfield: {note}"));
            located.members
        }
    };
    Ok(filled(arguments, scene, members, &path))
}

/// The arguments for these datasets with what a scene, read from `file`, says where they say nothing.
pub(super) fn filled(own: Arguments, scene: SceneFile, members: Vec<Member>, file: &Path) -> Arguments {
    let families = |member: &Member| member.families.clone().or(scene.look.families.clone());
    let mut members = members
        .into_iter()
        .map(|member| Member { families: families(&member), ..member })
        .collect::<Vec<_>>()
        .into_iter();
    let first = members.next().unwrap_or_default();
    let camera = scene.camera;
    let has_projection = own.fov.is_some() || own.ortho.is_some();
    let is_own_mode = own.mode.is_some();
    let names_attribute = own.attribute.is_some();
    Arguments {
        path: first.path.clone(),
        with: members.chain(own.with.iter().cloned()).collect(),
        first,
        size: own.size.or(scene.size.map(|(width, height)| PictureSize { width, height })),
        mode: own.mode.or(scene.look.mode),
        attribute: own.attribute.or(scene.look.attribute_name().map(str::to_owned)),
        plain: scene.look.is_plain() && !names_attribute,
        eye: own.eye.or(camera.map(|camera| DVec3::from(camera.eye))),
        target: own.target.or(camera.map(|camera| DVec3::from(camera.target))),
        up: own.up.or(camera.map(|camera| DVec3::from(camera.up))),
        fov: if has_projection { own.fov } else { camera.map(|camera| camera.fov) },
        ortho: if has_projection { own.ortho } else { camera.and_then(|camera| camera.ortho) },
        error_px: own.error_px.or(scene.look.error_px),
        settings: {
            // The mode's own settings go with the mode that the scene names.
            let mut settings = if is_own_mode { Settings::default() } else { scene.look.settings };
            settings.0.extend(own.settings.0.clone());
            settings
        },
        budget: Settings(scene.look.budget.0.into_iter().chain(own.budget.0).collect()),
        volume: own.volume.clone().or(scene.look.transfer.clone().filter(|_| !is_own_mode)),
        transfer: own.transfer.or(scene.look.transfer.filter(|_| !is_own_mode)),
        background: own.background.or(scene.look.background),
        surround: if own.surround.is_flat() { scene.projection } else { own.surround },
        stereo_pair: own.stereo_pair.or(scene.stereo),
        annotations: own.annotations.or(scene.look.annotations),
        selections: scene.look.selections.unwrap_or_default(),
        labels: scene.labels.map(|labels| located(&labels, file)),
        film: scene.film,
        cut: if own.cut == Default::default() { scene.look.cut.unwrap_or_default() } else { own.cut },
        ..own
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::{Attribute, Camera, DatasetRef};
    use crate::mode::SettingValue;
    use crate::modes;

    #[test]
    fn the_command_line_overrides_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("box.df");
        std::fs::write(&data, b"data").unwrap();
        let path = folder.path().join("a.scene.ron");
        let mut scene = SceneFile::new(vec![DatasetRef::of(&data, &path)]);
        scene.look.mode = modes::find("points");
        scene.look.settings.0.insert("radius".into(), SettingValue::Number(3.0));
        scene.size = Some((300, 200));
        scene.look.attribute = Some(Attribute::None);
        scene.labels = Some("groups.hdf5".into());
        scene.camera =
            Some(Camera { eye: [1.0, 2.0, 3.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov: 33.0, ortho: Some(5.0) });
        scene.write(&path).unwrap();

        let arguments = Arguments::new(path.clone(), "b.png".into());
        let complete_one = |arguments: &Arguments| complete(arguments.clone()).unwrap();
        let all = complete_one(&arguments);
        assert_eq!(all.path, folder.path().join("box.df"));
        assert_eq!((all.ortho, all.plain, all.eye), (Some(5.0), true, Some(DVec3::new(1.0, 2.0, 3.0))));
        assert_eq!(all.size, Some(PictureSize { width: 300, height: 200 }));
        assert_eq!(all.settings.0.len(), 1);
        assert_eq!(all.labels, Some(folder.path().join("groups.hdf5")));
        let own =
            Arguments { fov: Some(20.0), mode: modes::find("volume"), attribute: Some("mass".into()), ..arguments };
        let some = complete_one(&own);
        assert_eq!((some.fov, some.ortho, some.plain), (Some(20.0), None, false));
        assert!(some.settings.0.is_empty(), "settings of another mode");
        // The scene of other data.
        let other = Arguments { scene: Some(path), ..Arguments::new("other.df".into(), "b.png".into()) };
        assert_eq!(complete_one(&other).path, Path::new("other.df"));
        // Nothing is read where no scene is named.
        assert_eq!(complete_one(&Arguments::new("x.df".into(), "b.png".into())).path, Path::new("x.df"));
    }
}
