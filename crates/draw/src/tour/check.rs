//! Values of a tour that are of the right type and make no sense all the same.

use super::file::{Keyframe, TourFile, VERSION, VERSION_TIME, What};
use super::place::TourPlace;
use crate::look::ERRORS_PX;
use crate::mode::Mode;
use crate::model::ron_file::RonError;
use crate::model::ron_place::Place;
use crate::modes;
use crate::view::Stereo;

/// The longest that anything in a tour takes, seconds.
const LONGEST: f64 = 86_400.0;

/// Checks what types cannot.
///
/// # Errors
/// The first mistake with its place.
pub(super) fn check(tour: &TourFile, file: &str, text: &str) -> Result<(), RonError> {
    let place = Place { file, text };
    if !(VERSION..=VERSION_TIME).contains(&tour.version) {
        return Err(place.refuse(&["version"], tour.version, format!("{VERSION} or {VERSION_TIME}")));
    }
    let (width, height) = tour.size;
    if !((1..=32768).contains(&width) && (1..=32768).contains(&height)) {
        return Err(place.refuse(&["size"], format!("{width}x{height}"), "1x1 to 32768x32768"));
    }
    if let Some((field, found, expected)) = tour.projection.mistake() {
        return Err(place.refuse(&[field], found, expected));
    }
    if let Some((_, found, expected)) = tour.stereo.as_ref().and_then(Stereo::mistake) {
        return Err(place.refuse(&["stereo"], found, expected));
    }
    if !(0.01..=1000.0).contains(&tour.rate) {
        return Err(place.refuse(&["rate"], tour.rate, "0.01 to 1000 pictures a second"));
    }
    let length = tour.upward().length_squared();
    if !(length > 0.0 && length.is_finite()) {
        return Err(place.refuse(&["up"], format!("{:?}", tour.upward().to_array()), "a direction"));
    }
    if !(tour.comfort.turn > 0.0 && tour.comfort.turn.is_finite()) {
        return Err(place.refuse(&["turn"], tour.comfort.turn, "degrees per second above 0"));
    }
    if tour.keyframes.is_empty() {
        return Err(place.refuse(&["keyframes"], "none", "one or more"));
    }
    let labels: Vec<&str> = tour.keyframes.iter().filter_map(|keyframe| keyframe.label.as_deref()).collect();
    for (key, label) in &tour.keys {
        if !labels.contains(&label.as_str()) {
            return Err(place.refuse(&["keys"], format!("{label} on {key}"), format!("one of {}", labels.join(", "))));
        }
    }
    let mut mode: &Mode = modes::first();
    let mut reached = 0.0;
    for (index, keyframe) in tour.keyframes.iter().enumerate() {
        if let Some(label) = &keyframe.label
            && tour.keyframes[..index].iter().any(|other| other.label.as_ref() == Some(label))
        {
            return Err(place.refuse_in(index, &["label"], label, "a name that no other keyframe has"));
        }
        mode = keyframe.look.mode.unwrap_or(mode);
        reached = check_times(&place, index, keyframe, reached)?;
        check_camera(&place, index, keyframe)?;
        let refuse = |path: &[&str], found, expected| place.refuse_in(index, path, found, expected);
        keyframe.look.check(mode, ERRORS_PX, &refuse)?;
    }
    Ok(())
}

/// When a keyframe is left at the earliest, for one before it that is left at `reached`.
fn check_times(place: &Place<'_>, index: usize, keyframe: &Keyframe, reached: f64) -> Result<f64, RonError> {
    let times = [
        ("pause", Some(keyframe.pause)),
        ("after", keyframe.after),
        ("at", keyframe.at),
        ("fade", Some(keyframe.fade)),
    ];
    for (name, seconds) in times {
        if let Some(seconds) = seconds.filter(|seconds| !(0.0..=LONGEST).contains(seconds)) {
            return Err(place.refuse_in(index, &[name], seconds, format!("0 to {LONGEST} seconds")));
        }
    }
    if keyframe.at.is_some() && keyframe.after.is_some() {
        return Err(place.refuse_in(index, &["after"], "at and after", "one of them"));
    }
    if let Some(at) = keyframe.at.filter(|at| *at < reached) {
        return Err(place.refuse_in(index, &["at"], at, format!("{reached} or later, when the one before is left")));
    }
    Ok(keyframe.at.unwrap_or(reached + keyframe.after.unwrap_or(0.0)) + keyframe.pause)
}

fn check_camera(place: &Place<'_>, index: usize, keyframe: &Keyframe) -> Result<(), RonError> {
    if keyframe.camera.is_some() && keyframe.around.is_some() {
        return Err(place.refuse_in(index, &["around"], "camera and around", "one of them"));
    }
    if !keyframe.orbit.is_finite() || keyframe.orbit.abs() > 36_000.0 {
        return Err(place.refuse_in(index, &["orbit"], keyframe.orbit, "-36000 to 36000 degrees"));
    }
    if let Some(camera) = &keyframe.camera {
        let refuse = |name: &str, found: String, expected: String| {
            Err(place.refuse_in(index, &["camera", name], found, expected))
        };
        if !(camera.fov > 0.0 && camera.fov < 180.0) {
            return refuse("fov", camera.fov.to_string(), "between 0 and 180 degrees".into());
        }
        if let Some(height) = camera.ortho.filter(|height| !(*height > 0.0 && height.is_finite())) {
            return refuse("ortho", height.to_string(), "a finite height above 0".into());
        }
        if let Err(error) = camera.view(64, 64) {
            return refuse("eye", format!("{:?}", camera.eye), format!("a camera that sees something: {error}"));
        }
    }
    let Some(around) = &keyframe.around else { return Ok(()) };
    let refuse =
        |name: &str, found: f64, expected: &str| Err(place.refuse_in(index, &["around", name], found, expected));
    if !(around.distance > 0.0 && around.distance.is_finite()) {
        return refuse("distance", around.distance, "a number above 0");
    }
    if !around.azimuth.is_finite() {
        return refuse("azimuth", around.azimuth, "degrees");
    }
    if !(-90.0..=90.0).contains(&around.elevation) {
        return refuse("elevation", around.elevation, "-90 to 90 degrees");
    }
    if !(around.fov > 0.0 && around.fov < 180.0) {
        return refuse("fov", around.fov, "between 0 and 180 degrees");
    }
    if let What::Ball(middle, radius) = &around.what
        && !(middle.iter().all(|x| x.is_finite()) && *radius > 0.0 && radius.is_finite())
    {
        return Err(place.refuse_in(
            index,
            &["around", "what"],
            format!("{middle:?}, {radius}"),
            "finite numbers, a radius above 0",
        ));
    }
    Ok(())
}
