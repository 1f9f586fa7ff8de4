//! Rays by an adapter's passes: the processor's rays, and what triangles show.

use super::holes::{broken, covered};
use super::seen::{assert_alike, read, reading};
use super::*;
use deepfield::view::CutSettings;
use deepfield::view::cut::ClipBox;

const PICTURE: (u32, u32) = (105, 70);

/// A small picture by a technique.
fn small(technique: &str, wanted: &Wanted<'_>) -> Shot {
    let settings = [wanted.settings, &[("technique", name(technique))][..]].concat();
    Shot { size: Some(PICTURE), ..Wanted { settings: &settings, ..*wanted }.shot() }
}

/// Only what is in a box.
fn cut(shot: Shot) -> Shot {
    let clip = Some(ClipBox { min: DVec3::new(100.3, 80.2, -500.0), max: DVec3::new(560.6, 400.4, 70.0) });
    let cut = Some(CutSettings { clip, ..CutSettings::default() });
    Shot { look: LookPatch { cut, ..shot.look }, ..shot }
}

#[test]
fn an_adapter_casts_rays_as_the_processor_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), &broken());
    let far = Wanted { attribute: Some("height"), ..PLAIN };
    let near = Wanted { eye: Some([310.0, 200.0, 60.0]), target: Some([480.0, 350.0, -20.0]), ..far };
    let aside =
        Wanted { eye: Some([700.0, -200.0, 500.0]), target: Some([380.0, 265.0, 0.0]), ortho: Some(260.0), ..far };
    // Rays along one of the axes, and such as are over one place all along.
    let above =
        Wanted { eye: Some([310.0, 265.0, 900.0]), target: Some([310.0, 265.5, 0.0]), ortho: Some(560.0), ..far };
    let down = Wanted { eye: Some([310.0, 265.0, 900.0]), target: Some([310.0, 265.0001, 0.0]), ..above };
    let filled = Wanted { settings: &[("holes", name("filled")), ("contours", number(8.0))], ..near };
    let pictures = [
        ("far away", &far, false),
        ("near by", &near, false),
        ("in parallel, in a box", &aside, true),
        ("from above", &above, false),
        ("straight down", &down, false),
        ("a membrane", &filled, false),
    ];
    let (mut processor, mut adapter) = (session(&path, Backend::Cpu), session(&path, Backend::Compute));
    for (what, wanted, is_cut) in pictures {
        let shot = |technique| if is_cut { cut(small(technique, wanted)) } else { small(technique, wanted) };
        let [rays, triangles] = ["rays", "triangles"].map(shot);
        let (expected, found) = (processor.draw(&rays).unwrap(), adapter.draw(&rays).unwrap());
        assert_eq!(found.drawn_by[0], "compute", "{what}");
        let counts = [&expected, &found].map(|picture| {
            let report = &picture.surface.as_ref().unwrap().report;
            [report.samples_drawn, report.points, report.triangles, report.nodes_drawn]
        });
        assert_eq!(counts[0], counts[1], "{what}");
        let image = found.image(&rays).unwrap();
        let others = [("the processor's", expected, 0.02), ("triangles", adapter.draw(&triangles).unwrap(), 0.03)];
        for (against, other, most) in &others {
            let (share, mean) = differences(&image, &other.image(&rays).unwrap());
            let covered = [&found, other].map(covered);
            println!("{what}, {against}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}, {covered:?}");
            assert!(share <= *most && mean < 0.6, "{what}, {against}: {share} {mean}");
            assert!((covered[0] - covered[1]).abs() < 0.01 * covered[1], "{what}, {against}: {covered:?}");
        }
        // The same picture twice is the same bits.
        assert_eq!(adapter.draw(&rays).unwrap().image(&rays).unwrap(), image, "{what}");
    }
    let shot = small("rays", &far);
    let (_, expected) = read(&mut reading(&path, Backend::Cpu), &shot);
    let (picture, found) = read(&mut reading(&path, Backend::Compute), &shot);
    assert_eq!(picture.drawn_by[0], "compute");
    assert_alike(&found, &expected, [PICTURE.0, PICTURE.1].map(|side| side as usize), "rays");
}

#[test]
fn an_adapter_casts_rays_through_globes() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), &world(Holes::Lakes));
    let high = [("exaggeration", number(3000.0)), ("light", name("eye"))];
    let low = [("exaggeration", number(300.0)), ("light", name("eye"))];
    let filled = [&high[..], &[("holes", name("filled"))]].concat();
    let target = Some([0.0; 3]);
    let seam = Wanted { eye: above(180.0, 10.0, 2e7), target, settings: &high, ..PLAIN };
    let pole = Wanted { eye: above(30.0, 88.0, 8e6), target, settings: &filled, ..PLAIN };
    let other = Wanted { eye: above(20.0, -89.5, 8e6), target, ortho: Some(6e5), settings: &high[1..], ..PLAIN };
    // Along the ground, to the horizon.
    let along = Wanted { eye: above(100.0, 40.0, 6.45e6), target: above(104.0, 44.0, 6.4e6), settings: &low, ..PLAIN };
    let part = ClipBox { min: DVec3::new(-1e7, -1e7, -2e6), max: DVec3::new(1e7, 1e7, 1.5e6) };
    let cut = Some(CutSettings { clip: Some(part), ..CutSettings::default() });
    // Two are compared with triangles, too: what the adapter makes of these is compared with the processor elsewhere.
    let pictures = [
        ("the seam and mountains at the limb", &seam, None, false),
        ("a pole, and membranes", &pole, None, false),
        ("the other pole, in parallel", &other, None, false),
        ("along the ground", &along, None, true),
        ("a zone", &seam, cut, true),
    ];
    let (mut processor, mut adapter) = (session(&path, Backend::Cpu), session(&path, Backend::Compute));
    for (what, wanted, cut, has_triangles) in pictures {
        let [rays, triangles] = ["rays", "triangles"].map(|technique| {
            let shot = small(technique, wanted);
            Shot { look: LookPatch { cut, ..shot.look }, ..shot }
        });
        let (expected, found) = (processor.draw(&rays).unwrap(), adapter.draw(&rays).unwrap());
        assert_eq!(found.drawn_by[0], "compute", "{what}");
        assert_eq!(found.surface.as_ref().unwrap().report.triangles, 0, "{what}");
        let image = found.image(&rays).unwrap();
        let by_triangles = has_triangles.then(|| ("triangles", adapter.draw(&triangles).unwrap(), 0.03));
        let others = [Some(("the processor's", expected, 0.02)), by_triangles];
        for (against, other, most) in others.iter().flatten() {
            let (share, mean) = differences(&image, &other.image(&rays).unwrap());
            let covered = [&found, other].map(covered);
            println!("{what}, {against}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}, {covered:?}");
            assert!(share <= *most && mean < 1.0, "{what}, {against}: {share} {mean}");
            assert!((covered[0] - covered[1]).abs() < 0.01 * covered[1], "{what}, {against}: {covered:?}");
        }
    }
    // The same triangles are hit, and what is missed is so but at the limb and at rims.
    let shot = small("rays", &PLAIN);
    let (_, expected) = read(&mut reading(&path, Backend::Cpu), &shot);
    let (picture, found) = read(&mut reading(&path, Backend::Compute), &shot);
    assert_eq!(picture.drawn_by[0], "compute");
    assert_alike(&found, &expected, [PICTURE.0, PICTURE.1].map(|side| side as usize), "rays through a globe");
}

#[test]
fn an_adapter_casts_rays_around_the_eye() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), &hills(SIZE, Holes::None));
    let inside = Wanted { eye: Some([310.0, 265.0, 60.0]), target: Some([310.0, 400.0, 40.0]), ..PLAIN };
    let surround = Surround::Dome { aperture: 200.0, tilt: -40.0 };
    let shot = Shot { surround, size: Some((120, 120)), ..small("rays", &inside) };
    let mut processor = session(&path, Backend::Cpu);
    let expected = processor.draw(&shot).unwrap().image(&shot).unwrap();
    let found = session(&path, Backend::Compute).draw(&shot).unwrap();
    assert_eq!(found.drawn_by[0], "compute");
    // Faces are sampled once more, and so a little softer.
    let (share, mean) = differences(&found.image(&shot).unwrap(), &expected);
    println!("a dome: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
    assert!(share <= 0.05 && mean < 1.3, "{share} {mean}");
}

#[test]
fn the_rasteriser_has_triangles_in_place_of_rays() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), &hills([60, 50], Holes::None));
    let [found, expected] = ["rays", "triangles"].map(|technique| {
        let shot = small(technique, &PLAIN);
        let picture = session(&path, Backend::Raster).draw(&shot).unwrap();
        (picture.drawn_by[0].clone(), picture.image(&shot).unwrap())
    });
    assert_eq!(found.0, "raster");
    assert_eq!(found, expected);
}
