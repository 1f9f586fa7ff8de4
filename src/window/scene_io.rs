//! Scenes in the window: saved with Ctrl+S, under another name with Ctrl+Shift+S, opened as any other file.

use super::camera::{Anchor, Flight, Lens, Viewpoint};
use super::free_name::free_name;
use super::input::{PointerOwner, is_control, is_shift};
use super::objects::Objects;
use super::open::OpenedScene;
use super::picture::{DataCamera, Picture};
use super::picture_sizes::panorama_size;
use super::playhead::Playhead;
use super::scene::{Scene, Settings};
use super::state::notices::Notices;
use super::state::panels::{Closed, Shown};
use super::state::plots::PlotChoice;
use crate::explore::PlotSettings;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::dataset::relative_to;
use crate::look::{Bookmark, Camera, DatasetRef, Fingerprint, LookPatch, Member, Panels, SceneFile};
use crate::model::FamilyName;
use crate::store::PartInfo;
use bevy::ecs::system::SystemParam;
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;
use std::path::{Path, PathBuf};

/// The scene file in use, and whether it is to be saved.
#[derive(Resource, Clone, Debug, Default)]
pub struct SceneFiles {
    /// Where the scene is saved; chosen at the first time.
    pub path: Option<PathBuf>,
    /// A button of the panel asks to save.
    pub asked: bool,
    /// The user asks to save there, and from then on.
    pub save_as: Option<PathBuf>,
    /// How often it was saved or opened.
    pub changes: u64,
}

/// Viewpoints on number keys, as scenes keep them.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Bookmarks(pub Vec<Bookmark>);

/// What a scene sets beside [`Settings`] and the camera.
#[derive(SystemParam)]
pub struct SceneParts<'w> {
    files: ResMut<'w, SceneFiles>,
    bookmarks: ResMut<'w, Bookmarks>,
    closed: ResMut<'w, Closed>,
    shown: ResMut<'w, Shown>,
    plot: ResMut<'w, PlotChoice>,
    objects: ResMut<'w, Objects>,
}

impl SceneParts<'_> {
    /// Where the scene is saved, if that is known.
    pub fn saves_to(&self) -> Option<&Path> {
        self.files.path.as_deref()
    }

    /// Says where the scene is saved from now on.
    pub fn save_to(&mut self, path: Option<PathBuf>) {
        self.files.path = path;
    }
}

/// The open data as files elsewhere name it, by whole paths; looked at once, because its fingerprints have to be read.
#[derive(Debug, Default)]
pub(crate) struct ShownData {
    dataset: u32,
    datasets: Vec<DatasetRef>,
}

impl ShownData {
    /// The datasets of the scene, with the families that the settings show.
    pub fn of(&mut self, scene: &Scene, settings: &Settings) -> Vec<DatasetRef> {
        if self.dataset != scene.dataset {
            let of = |member: &Member| DatasetRef {
                path: member.path.canonicalize().unwrap_or_else(|_| member.path.clone()),
                fingerprint: Fingerprint::of(&member.path).ok(),
                families: None,
                offset: member.offset.to_array(),
                scale: member.scale,
                said: member.said.clone(),
                own_look: member.own_look.clone(),
            };
            (self.dataset, self.datasets) = (scene.dataset, scene.members.iter().map(of).collect());
        }
        let data = self.datasets.iter().cloned().zip(families_of(scene, settings));
        data.map(|(dataset, families)| DatasetRef { families, ..dataset }).collect()
    }
}

/// A viewpoint with the settings' lens, as files keep it.
pub fn camera_of(viewpoint: &Viewpoint, lens: &Lens) -> Camera {
    Camera {
        eye: viewpoint.eye.to_array(),
        target: viewpoint.target.to_array(),
        up: viewpoint.up.to_array(),
        fov: lens.fov_deg,
        ortho: lens.parallel.then(|| lens.height_at(viewpoint.distance())),
    }
}

/// The viewpoint and the lens that a file's camera stands for.
pub fn viewpoint_of(camera: &Camera) -> (Viewpoint, Lens) {
    let [eye, target, up] = [camera.eye, camera.target, camera.up].map(DVec3::from);
    let viewpoint = Viewpoint { eye, target, up, fov_y: camera.fov.to_radians() };
    let mut lens = Lens { fov_deg: camera.fov, parallel: camera.ortho.is_some() };
    // Where a user has written a height of his own, the field of view follows it.
    if let Some(height) = camera.ortho
        && (lens.height_at(viewpoint.distance()) / height - 1.0).abs() > 1e-9
    {
        lens.fov_deg = Lens::fov_of(height, viewpoint.distance());
    }
    (Viewpoint { fov_y: lens.fov_deg.to_radians(), ..viewpoint }, lens)
}

/// The families of each dataset that are drawn; `None` for all of them.
pub(crate) fn families_of(scene: &Scene, settings: &Settings) -> Vec<Option<Vec<FamilyName>>> {
    let all = &scene.metadata().families;
    if scene.moving.is_some() {
        let shown = all.iter().zip(&settings.families).filter(|(_, shown)| **shown).map(|(family, _)| family.name);
        let names: Vec<FamilyName> = shown.collect();
        return vec![(names.len() < all.len()).then_some(names)];
    }
    let shown = |i: &usize| settings.families.get(*i).copied().unwrap_or(true);
    let of = |part: PartInfo<'_>| {
        let count = part.families.len();
        let names: Vec<FamilyName> = part.families.filter(shown).filter_map(|i| Some(all.get(i)?.name)).collect();
        (names.len() < count).then_some(names)
    };
    let mut parts = scene.file.parts().map(of);
    // Heights, images and volumes have no families.
    match scene.field.as_ref().and_then(|field| field.opened.mixed()) {
        None => parts.collect(),
        Some(mixed) => {
            let own = |index| if mixed.is_of_particles(index) { parts.next().flatten() } else { None };
            (0..scene.members.len()).map(own).collect()
        }
    }
}

/// The scene that the window shows of these datasets, to be saved at `path`.
pub(crate) fn scene_file(
    datasets: Vec<DatasetRef>,
    settings: &Settings,
    viewpoint: &Viewpoint,
    picture: &Picture,
    parts: &SceneParts<'_>,
    path: &Path,
) -> SceneFile {
    let size = match settings.is_projected() {
        true => panorama_size(picture.size(), settings.surround, settings.stereo),
        false => picture.size(),
    };
    SceneFile {
        size: Some((size.x, size.y)),
        camera: Some(camera_of(viewpoint, &settings.lens)),
        projection: settings.surround,
        stereo: settings.stereo,
        bookmarks: parts.bookmarks.0.clone(),
        labels: parts.objects.path().map(|labels| relative_to(labels, path)),
        panels: Panels { shown: parts.shown.panel, closed: Some(parts.closed.0.iter().cloned().collect()) },
        plot: Some(parts.plot.0.clone()).filter(|plot| *plot != PlotSettings::default()),
        look: settings.look.patch(),
        ..SceneFile::new(datasets)
    }
}

/// Says in a scene which moment of a run is shown, and how what is between its steps.
pub(crate) fn say_moment(look: &mut LookPatch, scene: &Scene, playhead: Option<&Playhead>) {
    look.time = scene.when();
    look.interpolation = playhead.map(Playhead::interpolation).filter(|own| *own != Interpolation::default());
}

/// Where a scene of the data at `data` is saved at first.
pub(crate) fn first_path(data: &Path) -> PathBuf {
    let stem = data.file_stem().map_or_else(|| "scene".to_owned(), |stem| stem.to_string_lossy().into_owned());
    free_name(data, &stem, "scene.ron")
}

/// Saves the scene on Ctrl+S and where the panel's button asks for it.
pub(crate) fn save_scene(
    keys: Res<ButtonInput<KeyCode>>,
    owner: Res<PointerOwner>,
    (scene, playhead): (Option<Res<Scene>>, Option<Res<Playhead>>),
    settings: Res<Settings>,
    picture: Res<Picture>,
    mut parts: SceneParts,
    mut notices: ResMut<Notices>,
    camera: Single<&Viewpoint, With<DataCamera>>,
) {
    let control = is_control(&keys) && owner.keyboard_is_free();
    let pressed = control && !is_shift(&keys) && keys.just_pressed(KeyCode::KeyS);
    let asked = parts.files.asked || parts.files.save_as.is_some();
    if !(pressed || asked) {
        return;
    }
    parts.files.asked = false;
    let named = parts.files.save_as.take();
    let Some(scene) = scene else { return };
    let path = named.or_else(|| parts.files.path.clone()).unwrap_or_else(|| first_path(&scene.path));
    let dataset = |(member, families): (&Member, _)| DatasetRef { families, ..DatasetRef::of_member(member, &path) };
    let datasets = scene.members.iter().zip(families_of(&scene, &settings)).map(dataset).collect();
    let mut file = scene_file(datasets, &settings, &camera, &picture, &parts, &path);
    say_moment(&mut file.look, &scene, playhead.as_deref());
    match file.write(&path) {
        Ok(()) => {
            notices.info(format!("scene saved in {}", path.display()));
            parts.files.path = Some(path);
            parts.files.changes += 1;
        }
        Err(error) => notices.error(error.to_string()),
    }
}

/// Shows what a scene says of the file that has just been adopted; what does not apply to it is told and left out.
pub(crate) fn apply(
    opened: Option<&OpenedScene>,
    attributes: &[String],
    settings: &mut Settings,
    (entity, viewpoint, anchor, orbit): (Entity, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera),
    parts: &mut SceneParts<'_>,
    commands: &mut Commands,
    notices: &mut Notices,
) {
    parts.files.changes += 1;
    let Some(OpenedScene { path, scene, notes }) = opened else {
        parts.files.path = None;
        parts.bookmarks.0.clear();
        // Selections stay: the same particles, or the same region, of another snapshot.
        return;
    };
    notes.iter().for_each(|note| notices.error(note));
    let told = |what: String| format!("{}: {what}", path.display());
    if let Some(name) = settings.show(&LookPatch::beginning().then(&scene.look), attributes) {
        notices.error(told(format!("the data has no attribute {name}; the usual one is shown")));
    }
    (settings.surround, settings.stereo) = (scene.projection, scene.stereo);
    if let Some(camera) = &scene.camera {
        let lens;
        (*viewpoint, lens) = viewpoint_of(camera);
        settings.lens = lens;
        *anchor = anchor.adopt(viewpoint, orbit);
        commands.entity(entity).remove::<Flight>();
    }
    parts.bookmarks.0.clone_from(&scene.bookmarks);
    parts.objects.open_of_scene(scene.labels.as_deref().map(|labels| crate::look::dataset::located(labels, path)));
    parts.shown.panel = scene.panels.shown;
    if let Some(closed) = &scene.panels.closed {
        parts.closed.0 = closed.iter().cloned().collect();
    }
    parts.plot.0 = scene.plot.clone().unwrap_or_default();
    parts.files.path = Some(path.clone());
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A viewpoint comes back from a file's camera: exactly in perspective, to rounding where lines of sight are parallel.
        #[test]
        fn viewpoints_come_back(
            eye in prop::array::uniform3(-1e3..1e3f64),
            target in prop::array::uniform3(-1e3..1e3f64),
            fov_deg in 1.0..150.0f64,
            parallel in any::<bool>(),
        ) {
            let lens = Lens { fov_deg, parallel };
            let [eye, target] = [eye, target].map(DVec3::from);
            prop_assume!(eye.distance(target) > 1e-3);
            let viewpoint = Viewpoint { eye, target, up: DVec3::Y, fov_y: fov_deg.to_radians() };
            let camera = camera_of(&viewpoint, &lens);
            prop_assert_eq!(viewpoint_of(&camera), (viewpoint, lens));
        }
    }

    #[test]
    fn scenes_are_saved_beside_the_data_under_a_free_name() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("box.hdf5");
        let first = first_path(&data);
        assert_eq!(first, folder.path().join("box.scene.ron"));
        std::fs::write(&first, "mine").unwrap();
        assert_eq!(first_path(&data), folder.path().join("box-2.scene.ron"));
        assert_eq!(first_path(Path::new("/nowhere/at/all.df")), Path::new("all.scene.ron"), "the working folder");
    }
}
