//! Colours of heights.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::color::transfer::TransferFunction;
use crate::look::CameraConfig;
use crate::mode::LevelChoice;
use crate::model::Unit;
use crate::modes::surface::MODE;
use crate::picture::surface::fixtures::{Told, field, opened};
use crate::view::{Eyes, Stereo, StereoKind};

/// A ramp from -300 to 900 along x, drawn from above without shades: its picture.
fn ramp(unit: &str, settings: &str, transfer: Option<TransferFunction>) -> Picture {
    let mut session = opened(unit, [121, 41], [6.0, 50.0], 0.01, |x, _| -300.0 + (x - 6.0) * 1000.0);
    let settings: crate::mode::Settings = ron::from_str(settings).unwrap();
    let bounds = session.opened().bounds(&settings).unwrap();
    let (center, size) = (bounds.center(), bounds.size());
    let eye = [center.x, center.y, bounds.max.z + size.x];
    let camera = CameraConfig {
        eye: Some(eye),
        target: Some(center.to_array()),
        up: Some([0.0, 1.0, 0.0]),
        fov: None,
        ortho: Some(0.5 * size.x),
    };
    let look = LookPatch { settings, transfer, ..LookPatch::default() };
    session.draw(&Shot { look, camera, size: Some((480, 240)), ..Shot::default() }).unwrap()
}

/// The colour of a height in the middle row, encoded.
fn color(picture: &Picture, height: f64) -> [f32; 3] {
    let Raw::Light(light) = &picture.values else { panic!("light") };
    let column = ((height + 300.0) / 1200.0 * 480.0) as usize;
    let [r, g, b, alpha] = light.colors.rgba[120 * 480 + column];
    assert!(alpha > 0.99);
    [r, g, b]
}

#[test]
fn the_sea_ends_at_height_0_of_places_on_the_earth() {
    let is_blue = |[r, g, b]: [f32; 3]| b > 1.1 * g && g > r;
    let is_green = |[r, g, b]: [f32; 3]| g > 1.3 * r && g > 1.3 * b;
    let terrain = TransferFunction::preset("terrain");
    for (map, chosen) in [("plate", None), ("local", None), ("plate", terrain.clone())] {
        let picture =
            ramp("deg", &format!("{{\"ambient\": 1.0, \"exaggeration\": 0.001, \"map\": \"{map}\"}}"), chosen);
        for below in [-290.0, -100.0, -8.0] {
            assert!(is_blue(color(&picture, below)), "{map} {below}: {:?}", color(&picture, below));
        }
        for above in [8.0, 40.0] {
            assert!(is_green(color(&picture, above)), "{map} {above}: {:?}", color(&picture, above));
        }
        // A legend has the picture's colours at the picture's range.
        let legend = picture.transfer.bake_colors();
        for height in [-290.0, -150.0, -8.0, 8.0, 300.0, 880.0] {
            let place = (height + 300.0) / 1200.0 * (f64::from(legend.width) - 1.0);
            let [r, g, b, _] = legend.rgba[place.round() as usize];
            let told = [r, g, b].map(|byte| crate::color::colors::to_linear(f32::from(byte) / 255.0));
            let found = color(&picture, height);
            assert!((0..3).all(|k| (told[k] - found[k]).abs() < 0.03), "{height}: {told:?}, not {found:?}");
        }
    }
    // Elsewhere, and with other colours or a range of land alone, nothing is moved.
    let plain = ramp("m", "{\"ambient\": 1.0}", None);
    assert_eq!(Some(&plain.transfer), terrain.as_ref());
    let grey = TransferFunction::preset("grey").unwrap();
    assert_eq!(ramp("deg", "{\"map\": \"plate\"}", Some(grey.clone())).transfer, grey);
    let land =
        terrain.map(|terrain| TransferFunction { range: crate::color::transfer::Range::Fixed(0.0, 900.0), ..terrain });
    assert_eq!(Some(&ramp("deg", "{\"map\": \"plate\"}", land.clone()).transfer), land.as_ref());
}

#[test]
fn lengths_are_told_in_the_unit_that_a_map_gives_them() {
    let session = opened("deg", [41, 41], [6.0, 50.0], 0.01, |x, y| x + y);
    for (map, unit) in [("plate", "deg"), ("local", "m"), ("globe", "m")] {
        let settings = ron::from_str(&format!("{{\"map\": \"{map}\"}}")).unwrap();
        let attribute = None;
        let depiction = Depiction { mode: &MODE, settings, attribute, choice: LevelChoice::default() };
        assert_eq!(session.opened().units(&depiction).length, Unit::new(unit), "{map}");
    }
}

/// Values of a legend are true ones, and it says where the surface is drawn higher than it is.
#[test]
fn legends_tell_how_much_higher_a_surface_is_drawn() {
    let session = opened("m", [41, 41], [0.0, 0.0], 1.0, |x, y| x + y);
    for (settings, attribute, title) in [
        ("{}", None, "height"),
        ("{\"exaggeration\": 10.0}", None, "height, drawn 10 × as high"),
        ("{\"exaggeration\": 0.25}", Some("slope"), "slope, drawn 0.25 × as high"),
        (
            "{\"exaggeration\": 2.5, \"form\": \"sphere\"}",
            Some("residual"),
            "residual from sphere, drawn 2.5 × as high",
        ),
    ] {
        let settings = ron::from_str(settings).unwrap();
        let attribute = attribute.map(|name: &str| Coloring { name: name.into(), fallback: 0.0, least: 0.0 });
        let depiction = Depiction { mode: &MODE, settings, attribute, choice: LevelChoice::default() };
        let Shown::Named(found, _) = session.opened().units(&depiction).value else { panic!("{title}") };
        assert_eq!(found, title);
    }
}

/// Pyramids of means look alike near by, where triangles are T's, but there is no error to tell.
#[test]
fn pyramids_of_means_have_no_error_to_tell() {
    let [nested, means] = ["nested", "means"]
        .map(|pyramid| ramp("m", &format!("{{\"ambient\": 1.0, \"pyramid\": \"{pyramid}\"}}"), None));
    assert!(nested.converged && nested.error_px <= 0.8 && means.converged && means.error_px.is_infinite());
    for height in [-290.0, -100.0, 8.0, 500.0, 880.0] {
        let [one, other] = [&nested, &means].map(|picture| color(picture, height));
        assert!((0..3).all(|k| (one[k] - other[k]).abs() < 0.02), "{height}: {one:?} {other:?}");
    }
}

/// A picture without room for its chunks is coarser, whatever was drawn before it, and told of once.
#[test]
fn pictures_without_room_are_coarser_by_their_views_alone() {
    let folder = tempfile::tempdir().unwrap();
    let rough = |x: f64, y: f64| 8.0 * (0.7 * x).sin() * (0.9 * y).cos();
    let path = field(folder.path(), "rough.asc", [601, 401], [0.0, 0.0], 1.0, rough);
    let told = Arc::new(Told::default());
    let open = |memory: u64| {
        let options = SessionOptions { chunk_memory: Some(memory), ..SessionOptions::default() };
        SurfaceSession::open(&path, &HeightsSaid::default(), options, told.clone()).unwrap()
    };
    let draw = |session: &mut SurfaceSession, middle: [f64; 2], ortho: f64| {
        let [x, y] = middle;
        let (eye, target) = (Some([x, y, 400.0]), Some([x, y, 0.0]));
        let camera = CameraConfig { eye, target, up: Some([0.0, 1.0, 0.0]), fov: None, ortho: Some(ortho) };
        let look = LookPatch { error_px: Some(0.01), ..LookPatch::default() };
        let picture = session.draw(&Shot { look, camera, size: Some((90, 60)), ..Shot::default() }).unwrap();
        let Raw::Light(light) = &picture.values else { panic!("light") };
        (light.colors.rgba.clone(), [picture.converged, picture.is_coarser, session.lacks_memory()])
    };
    let about_memory = || told.0.lock().unwrap().iter().filter(|message| message.contains("drawn coarser")).count();
    let (all, near) = ([300.0, 200.0], [60.0, 40.0]);
    let mut ample = open(1 << 30);
    let (fine, facts) = draw(&mut ample, all, 200.0);
    assert_eq!((facts, about_memory()), ([true, false, false], 0));
    let (mut first, mut later) = (open(1 << 20), open(1 << 20));
    let (coarse, facts) = draw(&mut first, all, 200.0);
    assert_eq!((facts, about_memory()), ([false, true, true], 1));
    assert!(coarse != fine);
    // What is near has room, and is what it is with ample memory.
    assert!(draw(&mut later, near, 10.0) == draw(&mut ample, near, 10.0));
    assert!(draw(&mut later, all, 200.0) == (coarse, [false, true, true]));
    assert_eq!(draw(&mut later, near, 10.0).1, [true, false, false]);
    draw(&mut later, all, 200.0);
    // Each of the two has told it.
    assert_eq!(about_memory(), 2);
    assert!(told.0.lock().unwrap().iter().any(|message| message.contains("rough.asc") && message.contains("--memory")));
}

#[test]
fn spikes_do_not_have_the_colours_of_a_field() {
    let hill = |x: f64, y: f64| 0.01 * (x + y);
    let range = |spike: f64, transfer: Option<TransferFunction>| {
        let session =
            opened("m", [101, 101], [0.0, 0.0], 1.0, |x, y| if [x, y] == [50.0, 50.0] { spike } else { hill(x, y) });
        session.prepare(&LookPatch { transfer, ..LookPatch::default() }).unwrap().look.range
    };
    assert_eq!(range(4.0, None), [0.0, 4.0]);
    let [low, high] = range(900.0, None);
    assert_eq!([low, high], [0.0, 2.0]);
    let session =
        opened("m", [101, 101], [0.0, 0.0], 1.0, |x, y| if x == 0.0 && y < 60.0 { 900.0 } else { hill(x, y) });
    let told = |look: &LookPatch| session.told(&session.prepare(look).unwrap(), look).1.value;
    assert_eq!(told(&LookPatch::default()), Shown::Named("height, 0.6 % beyond".into(), Unit::new("m")));
    let single = opened("m", [101, 101], [0.0, 0.0], 1.0, |x, y| if [x, y] == [7.0, 9.0] { 900.0 } else { hill(x, y) });
    let look = LookPatch::default();
    let named = single.told(&single.prepare(&look).unwrap(), &look).1.value;
    assert_eq!(named, Shown::Named("height, < 0.1 % beyond".into(), Unit::new("m")));
    // What lies about singly is much of a field's samples, and nothing of its surface.
    let dust = |x: f64, y: f64| if (x + y) % 7.0 < 0.5 && x % 2.0 == 0.0 { 900.0 + x } else { f64::NAN };
    let dusty = opened("m", [301, 301], [0.0, 0.0], 1.0, |x, y| if y < 150.0 { hill(x, y) } else { dust(x, y) });
    let [low, high] = dusty.prepare(&LookPatch::default()).unwrap().look.range;
    assert!(low == 0.0 && (4.0..5.0).contains(&high), "{low} {high}");
    let transfer = Some(TransferFunction { range: Range::Fixed(-5.0, 900.0), ..TransferFunction::default() });
    assert_eq!(told(&LookPatch { transfer, ..LookPatch::default() }), Shown::Named("height".into(), Unit::new("m")));
    let own = TransferFunction { range: Range::Fixed(-5.0, 900.0), ..TransferFunction::default() };
    assert_eq!(range(900.0, Some(own)), [-5.0, 900.0]);
}

#[test]
fn degrees_that_are_not_said_to_be_are_taken_for_such_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let steep = |x: f64, y: f64| 500.0 + 9e3 * (x + 84.0) + 7e3 * (y - 36.0);
    let path = field(folder.path(), "steep.asc", [30, 20], [-84.0, 36.0], 0.001, steep);
    let unit = |said: HeightsSaid| {
        let session = SurfaceSession::open(&path, &said, SessionOptions::default(), Arc::new(())).unwrap();
        let about = session.file().about();
        (about.grid.xy_unit.0.clone(), about.notes.iter().any(|note| note.contains(": --xy-unit m")))
    };
    assert_eq!(unit(HeightsSaid::default()), ("deg".to_owned(), true));
    let said = HeightsSaid { xy_unit: Some(Unit::new("m")), ..HeightsSaid::default() };
    assert_eq!(unit(said), ("m".to_owned(), false));
    let said = HeightsSaid { height_unit: Some(Unit::new("um")), ..HeightsSaid::default() };
    assert_eq!(unit(said), (String::new(), false));
}

/// Under a sun at 45 degrees the shadow of a cliff is as long as it is high, as dark as light from everywhere leaves it, and nothing else changes.
#[test]
fn a_cliff_casts_its_shadow_away_from_the_sun() {
    let mut session = opened("m", [121, 41], [0.0, 0.0], 1.0, |x, _| if x < 39.5 { 30.0 } else { 0.0 });
    let camera = CameraConfig {
        eye: Some([60.0, 20.0, 200.0]),
        target: Some([60.0, 20.0, 0.0]),
        up: Some([0.0, 1.0, 0.0]),
        fov: None,
        ortho: Some(60.0),
    };
    let mut draw = |more: &str| {
        let sun = "\"azimuth\": 270.0, \"altitude\": 45.0, \"ambient\": 0.2";
        let settings: crate::mode::Settings = ron::from_str(&format!("{{{sun}{more}}}")).unwrap();
        let look = LookPatch { settings, ..LookPatch::default() };
        let picture = session.draw(&Shot { look, camera, size: Some((480, 240)), ..Shot::default() }).unwrap();
        let Raw::Light(light) = picture.values else { panic!("light") };
        light.colors.rgba
    };
    let plain = draw("");
    assert!(plain == draw(", \"shadows\": 0.0, \"ambient-occlusion\": 0.0, \"light-size\": 9.0"));
    let shadowed = draw(", \"shadows\": 1.0, \"light-size\": 0.0");
    let left = 0.2 / (0.2 + 0.8 * 45.0_f32.to_radians().sin());
    for (column, x) in (0..480).map(|column| (column, (f64::from(column) + 0.5) / 4.0)) {
        let [before, after] = [&plain, &shadowed].map(|colors| colors[120 * 480 + column as usize]);
        let found = after[1] / before[1];
        if (43.0..66.0).contains(&x) {
            assert!((found - left).abs() < 0.02, "{x}: {found}, not {left}");
        } else if !(38.0..71.0).contains(&x) {
            assert!(found == 1.0 && before[3] == after[3], "{x}: {found}");
        }
    }
    // At the foot of the cliff a good part of the sky is hidden, far from it none is.
    let occluded = draw(", \"ambient-occlusion\": 1.0, \"occlusion-radius\": 0.2");
    let at = |x: usize| occluded[120 * 480 + 4 * x][1] / plain[120 * 480 + 4 * x][1];
    assert!(at(42) < 0.8 && at(110) == 1.0 && at(20) == 1.0, "{} {} {}", at(42), at(110), at(20));
}

#[test]
fn two_eyes_have_the_same_heights_along_lines() {
    let mut session = opened("m", [101, 101], [0.0, 0.0], 1.0, |x, y| 0.25 * x + 0.02 * y);
    let settings = ron::from_str(r#"{"contours": 5.0, "contour-labels": true, "samples": 1.0}"#).unwrap();
    let (kind, eyes) = (StereoKind::OffAxis, Eyes::SideBySide);
    let stereo = Some(Stereo { kind, separation: 2.0, zero_parallax: 150.0, eyes });
    let look = LookPatch { settings, ..LookPatch::default() };
    let picture = session.draw(&Shot { look, stereo, size: Some((480, 320)), ..Shot::default() }).unwrap();
    let Raw::Light(light) = &picture.values else { panic!("light") };
    let middle = 0.5 * f64::from(light.colors.width);
    let labels = picture.surface.unwrap().labels.unwrap();
    let (left, right) = labels.split_at(labels.len() / 2);
    assert!(!left.is_empty() && left.iter().map(|label| &label.text).eq(right.iter().map(|label| &label.text)));
    assert!(left.iter().all(|label| label.middle[0] < middle) && right.iter().all(|label| label.middle[0] > middle));
}
