//! Names on fields with slopes, holes and seams.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::annotate::Annotations;
use crate::look::LookPatch;
use crate::picture::surface::SurfaceSession;
use crate::picture::surface::fixtures::{Told, opened};
use crate::view::Projection;
use glam::DVec3;

/// A table in a folder that goes with it.
fn table(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lab.csv");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

fn look(settings: &str) -> LookPatch {
    LookPatch { settings: ron::from_str(settings).unwrap(), ..LookPatch::default() }
}

/// What names of a field stand on with these settings.
fn floor(session: &SurfaceSession, settings: &str, placement: FieldPlacement) -> Floor {
    session.floor(&session.prepare(&look(settings)).unwrap(), placement)
}

/// From where all names are seen.
fn view() -> View {
    let projection = Projection::Perspective { fov_y: 0.8 };
    View::look_at(DVec3::new(4000.0, 0.0, 0.0), DVec3::ZERO, DVec3::Z, projection, 300, 300).unwrap()
}

/// Whether names are these, in their order, at these places.
fn are(found: &[Label], expected: &[(&str, DVec3)]) -> bool {
    let same =
        |(own, (name, place)): (&Label, &(&str, DVec3))| own.name == *name && (own.position - *place).length() < 1e-6;
    found.len() == expected.len() && found.iter().zip(expected).all(same)
}

#[test]
fn names_stand_on_the_first_surface_that_is_there() {
    // Heights are 2 x + y but for a hole at (103, 53); a second field lies beside, raised and twice as large.
    let height = |x: f64, y: f64| if (x, y) == (103.0, 53.0) { -9999.0 } else { 2.0 * x + y };
    let first = opened("m", [11, 9], [100.0, 50.0], 1.0, height);
    let second = opened("m", [21, 9], [100.0, 50.0], 1.0, |_, y| y);
    let settings = "{\"exaggeration\": 3.0, \"base\": 10.0}";
    let aside = FieldPlacement { offset: DVec3::new(1.0, 2.0, 3.0), scale: 2.0 };
    let fields: [(&dyn Heights, Floor); 2] = [
        (first.file(), floor(&first, settings, FieldPlacement::NONE)),
        (second.file(), floor(&second, settings, aside)),
    ];
    let (_folder, path) =
        table("name,x,y,radius\nSlope,104.25,52.5,\nHole,103.1,53.1,\nFar,99,50,\nNowhere,,1,\nSecond,112.5,51.5,4\n");
    let told = Told::default();
    let on_slope = DVec3::new(104.25, 52.5, 10.0 + 3.0 * (261.0 - 10.0));
    let mut known = None;
    for _ in 0..2 {
        let mut shot = Shot { labels: Some(path.clone()), ..Shot::default() };
        let shown = take(&mut known, &mut shot, &fields[..1], &told).unwrap().unwrap();
        assert_eq!(shot.labels, None);
        assert!(are(&shown.seen(&view()), &[("Slope", on_slope)]));
    }
    // It is told once.
    let found = told.0.lock().unwrap().clone();
    assert!(found.len() == 1 && found[0].contains("lab.csv: 4 of 5 names are left out"), "{found:?}");
    // With both fields; what has a radius comes first.
    let mut shot = Shot { labels: Some(path), ..Shot::default() };
    let shown = take(&mut known, &mut shot, &fields, &told).unwrap().unwrap();
    let own = DVec3::new(112.5, 51.5, 10.0 + 3.0 * (51.5 - 10.0));
    let in_hole = DVec3::new(103.1, 53.1, 10.0 + 3.0 * (53.1 - 10.0));
    let all = [("Second", aside.outside(own)), ("Slope", on_slope), ("Hole", aside.outside(in_hole))];
    let seen = shown.seen(&view());
    assert!(are(&seen, &all), "{seen:?}");
    assert_eq!(seen[0].radius, Some(4.0));
    // A table of places in space stays with the shot.
    let (_folder, path) = table("name,x,y,z\nA,104,52,0\n");
    let mut shot = Shot { labels: Some(path), ..Shot::default() };
    assert!(take(&mut known, &mut shot, &fields, &told).unwrap().is_none() && shot.labels.is_some());
}

#[test]
fn degrees_become_places_as_the_map_says() {
    let session = opened("deg", [41, 21], [6.0, 50.0], 0.01, |x, _| 100.0 * x);
    let (_folder, path) = table("name,x,y\nA,6.1,50.05\nB,366.1,50.05\nC,6.1,51\n");
    for settings in ["{\"map\": \"local\"}", "{\"map\": \"plate\", \"exaggeration\": 0.001}", "{\"map\": \"globe\"}"] {
        let floor = floor(&session, settings, FieldPlacement::NONE);
        let mut shot = Shot { labels: Some(path.clone()), ..Shot::default() };
        let shown = take(&mut None, &mut shot, &[(session.file(), floor)], &()).unwrap().unwrap();
        // Rows go from north to south, from 50.2 on.
        let place = floor.placed.world(15.0, 10.0, 610.0);
        let eye = 3.0 * place;
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(eye, place, DVec3::new(0.3, 0.2, 1.0), projection, 300, 300).unwrap();
        let seen = shown.seen(&view);
        let is_there = |label: &Label| (label.position - place).length() < 1e-9 * place.length();
        assert!(seen.len() == 2 && seen.iter().all(is_there), "{settings}: {seen:?}");
    }
}

#[test]
fn beyond_the_horizon_of_a_globe_there_are_none() {
    let session = opened("deg", [36, 19], [-180.0, -90.0], 10.0, |_, _| 500.0);
    let floor = floor(&session, "{\"map\": \"globe:moon\"}", FieldPlacement::NONE);
    // The third lies between the last column and the first.
    let (_folder, path) = table("name,x,y\nFront,0,0\nBack,180,0\nSeam,175,20\n");
    let mut shot = Shot { labels: Some(path), ..Shot::default() };
    let shown = take(&mut None, &mut shot, &[(session.file(), floor)], &()).unwrap().unwrap();
    let names = |eye: DVec3| -> Vec<String> {
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, projection, 300, 300).unwrap();
        shown.seen(&view).into_iter().map(|label| label.name).collect()
    };
    let away = 4.0 * floor.placed.world(9.0, 18.0, 0.0).length();
    assert_eq!(names(away * DVec3::X), ["Front"]);
    assert_eq!(names(-away * DVec3::X), ["Back", "Seam"]);
}

#[test]
fn pictures_have_names_without_heights_where_those_with_heights_are() {
    let mut session = opened("m", [41, 41], [0.0, 0.0], 1.0, |x, y| 0.1 * x * y);
    let annotations = Annotations { labels: 8, ..Annotations::NONE };
    let look = LookPatch { annotations: Some(annotations), ..LookPatch::default() };
    let mut image = |labels: Option<PathBuf>| {
        let shot = Shot { look: look.clone(), size: Some((200, 150)), labels, ..Shot::default() };
        let picture = session.draw(&shot).unwrap();
        session.finished(&shot, &picture).unwrap()
    };
    let (_flat, flat) = table("name,x,y\nPeak,30,20\n");
    let (_tall, tall) = table("name,x,y,z\nPeak,30,20,60\n");
    let [without, flat, tall] = [None, Some(flat), Some(tall)].map(&mut image);
    assert!(flat.rgba == tall.rgba && flat.rgba != without.rgba);
}
