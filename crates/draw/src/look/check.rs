//! Values of a scene that are of the right type and make no sense all the same.

use super::{Camera, DatasetRef, ERRORS_PX, LookPatch, SceneFile, VERSION, VERSION_TIME};
use crate::model::ron_file::RonError;
use crate::model::ron_place::Place;
use crate::view::Stereo;

/// Datasets of a scene at most.
const MOST_DATASETS: usize = 64;

/// Checks what types cannot.
///
/// # Errors
/// The first mistake with its place.
pub(super) fn check(scene: &SceneFile, file: &str, text: &str) -> Result<(), RonError> {
    let place = Place { file, text };
    if !(VERSION..=VERSION_TIME).contains(&scene.version) {
        return Err(place.refuse(&["version"], scene.version, format!("{VERSION} or {VERSION_TIME}")));
    }
    if !(1..=MOST_DATASETS).contains(&scene.datasets.len()) {
        let (found, expected) =
            (format!("a list of {}", scene.datasets.len()), format!("1 to {MOST_DATASETS} datasets"));
        return Err(place.refuse(&["datasets"], found, expected));
    }
    for dataset in &scene.datasets {
        check_dataset(dataset, &|path: &[&str], found: String, expected: String| {
            let path: Vec<&str> = ["datasets"].iter().chain(path).copied().collect();
            place.refuse(&path, found, expected)
        })?;
    }
    let refuse = |path: &[&str], found, expected| place.refuse(path, found, expected);
    scene.look.check(scene.look.mode_of_settings(), ERRORS_PX, &refuse)?;
    if let Some((width, height)) = scene.size
        && !((1..=32768).contains(&width) && (1..=32768).contains(&height))
    {
        return Err(place.refuse(&["size"], format!("{width}x{height}"), "1x1 to 32768x32768"));
    }
    if let Some((field, found, expected)) = scene.projection.mistake() {
        return Err(place.refuse(&["projection", field], found, expected));
    }
    if let Some((_, found, expected)) = scene.stereo.as_ref().and_then(Stereo::mistake) {
        return Err(place.refuse(&["stereo"], found, expected));
    }
    if let Some(camera) = &scene.camera {
        check_camera(&place, &["camera"], camera)?;
    }
    for (i, bookmark) in scene.bookmarks.iter().enumerate() {
        if bookmark.key > 9 {
            return Err(place.refuse(&["bookmarks", "key"], bookmark.key, "0 to 9"));
        }
        if scene.bookmarks[..i].iter().any(|other| other.key == bookmark.key) {
            return Err(place.refuse(&["bookmarks"], format!("key {} twice", bookmark.key), "each key once"));
        }
        check_camera(&place, &["bookmarks", "camera"], &bookmark.camera)?;
    }
    if let Some(film) = &scene.film {
        if !(0.0..=1.0).contains(&film.share) {
            return Err(place.refuse(&["film", "share"], film.share, "a number from 0 to 1"));
        }
        if let Some(from) = &film.from {
            if from.film.is_some() {
                return Err(place.refuse(&["film", "from", "film"], "a film in a film", "none"));
            }
            check(from, file, text)?;
        }
    }
    Ok(())
}

/// Checks what types cannot of a dataset. `refuse` makes the error of a field by its path, of what was found and what is expected.
///
/// # Errors
/// The first mistake.
pub(crate) fn check_dataset<E>(dataset: &DatasetRef, refuse: &dyn Fn(&[&str], String, String) -> E) -> Result<(), E> {
    if !dataset.offset.iter().all(|x| x.is_finite()) {
        return Err(refuse(&["offset"], format!("{:?}", dataset.offset), "finite numbers".into()));
    }
    if let Some(own) = &dataset.own_look {
        let look = LookPatch {
            mode: own.mode,
            settings: own.settings.clone(),
            attribute: own.attribute.clone(),
            transfer: own.transfer.clone(),
            ..LookPatch::default()
        };
        let refuse = |path: &[&str], found: String, expected: String| {
            let path: Vec<&str> = ["look"].iter().chain(path).copied().collect();
            refuse(&path, found, expected)
        };
        look.check(look.mode_of_settings(), ERRORS_PX, &refuse)?;
    }
    if let Some(scale) = dataset.scale.filter(|scale| !(1e-30..=1e30).contains(scale)) {
        return Err(refuse(&["scale"], scale.to_string(), "a positive number, 1e-30 to 1e30".into()));
    }
    Ok(())
}

fn check_camera(place: &Place<'_>, path: &[&str], camera: &Camera) -> Result<(), RonError> {
    let refuse = |field: &'static str, found: String, expected: &str| {
        let path: Vec<&str> = path.iter().copied().chain([field]).collect();
        Err(place.refuse(&path, found, expected))
    };
    for (name, point) in [("eye", camera.eye), ("target", camera.target), ("up", camera.up)] {
        if !point.iter().all(|x| x.is_finite()) {
            return refuse(name, format!("{point:?}"), "finite numbers");
        }
    }
    if !(camera.fov > 0.0 && camera.fov < 180.0) {
        return refuse("fov", camera.fov.to_string(), "between 0 and 180 degrees");
    }
    if let Some(height) = camera.ortho.filter(|height| !(*height > 0.0 && height.is_finite())) {
        return refuse("ortho", height.to_string(), "a finite height above 0");
    }
    match camera.view(64, 64) {
        Ok(_) => Ok(()),
        Err(error) => refuse("eye", format!("{:?}", camera.eye), &format!("a camera that sees something: {error}")),
    }
}
