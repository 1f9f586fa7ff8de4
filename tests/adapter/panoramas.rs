//! Faces of panoramas and pictures of two eyes by an adapter against those of the processor.

use crate::support::{built, demo};
use deepfield::codec::VqBits;
use deepfield::color::accumulation::relative_error;
use deepfield::gpu::Offscreen;
use deepfield::look::{Backend, CameraConfig, LookPatch, Member, Shot};
use deepfield::mode::{Raw, SettingValue};
use deepfield::modes;
use deepfield::picture::{Picture, Session, SessionOptions};
use deepfield::view::cut::ClipBox;
use deepfield::view::{CutSettings, Eyes, Stereo, StereoKind, Surround, cut};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

const DOME: Surround = Surround::Dome { aperture: 210.0, tilt: 20.0 };

/// From the middle of the data, where particles are all around.
fn shot(mode: &str, surround: Surround) -> Shot {
    let mode = modes::find(mode);
    let camera =
        CameraConfig { eye: Some([25.0, 25.0, 24.0]), target: Some([25.0, 26.0, 0.0]), ..CameraConfig::default() };
    Shot { look: LookPatch { mode, ..LookPatch::default() }, camera, size: Some((64, 64)), surround, ..Shot::default() }
}

fn with(mut shot: Shot, name: &str, value: f64) -> Shot {
    shot.look.settings.0.insert(name.to_owned(), SettingValue::Number(value));
    shot
}

/// Of a field of attributes.
fn of_field(shot: Shot, set: &[(&str, &str)]) -> Shot {
    let mut settings = shot.look.settings.clone();
    for (setting, name) in set {
        settings.0.insert((*setting).to_owned(), SettingValue::Name((*name).to_owned()));
    }
    Shot { look: LookPatch { settings, ..shot.look }, ..shot }
}

fn session(file: &Path, backend: Backend) -> Session {
    let options = SessionOptions { backend: Some(backend), ..SessionOptions::default() };
    let opened = Session::open(&[Member::new(file)], options, [], |path| Ok(path.to_owned()), Arc::new(()));
    opened.unwrap().with_adapter(Some(Box::new(Offscreen::default())))
}

fn values(picture: &Picture) -> Vec<f32> {
    match &picture.values {
        Raw::Sums(sums, _) => sums.p.clone(),
        Raw::Light(painted) => painted.colors.rgba.as_flattened().to_vec(),
    }
}

#[test]
fn panoramas_and_pairs_are_those_of_the_processor() {
    let built = built(&demo(), VqBits::Eight);
    let [mut cpu, mut compute, mut raster] =
        [Backend::Cpu, Backend::Compute, Backend::Raster].map(|backend| session(built.file.path(), backend));
    let dome = |mode: &str| shot(mode, DOME);
    let pair = Stereo { kind: StereoKind::OffAxis, separation: 0.5, zero_parallax: 10.0, eyes: Eyes::SideBySide };
    let pair = |mode: &str| Shot { stereo: Some(pair), ..shot(mode, Surround::Flat) };
    for (what, shot, bound) in [
        ("sums", dome("column-density"), 2e-3),
        ("squares", shot("density-squared", Surround::Equirectangular), 1e-3),
        ("a cube", shot("column-density", Surround::Cube { layout: Default::default() }), 2e-3),
        ("a volume", with(dome("volume"), "smallest", 0.0), 1e-4),
        // The smallest particles are enlarged by their depth, not by their distance.
        ("a volume of enlarged particles", dome("volume"), 8e-2),
        // Ranges, and the densities that the opacity goes by, are those of all faces.
        ("a field", of_field(with(dome("volume"), "smallest", 0.0), &[("field", "smoothing-length")]), 2e-3),
        (
            "a pair of fields",
            of_field(with(pair("isosurface"), "smallest", 0.0), &[("surface-field", "smoothing-length")]),
            5e-3,
        ),
        ("a surface", with(dome("isosurface"), "smallest", 0.0), 1e-3),
        // Its box is that of all the data, and so the same for all faces.
        ("a Cartesian grid", with(dome("cartesian"), "cells", 64.0), 1e-3),
        ("a pair of Cartesian grids", with(pair("cartesian"), "cells", 64.0), 1e-3),
        // Fewer than usual.
        ("layers", with(with(dome("layered"), "smallest", 0.0), "layers", 32.0), 5e-3),
        ("sorted splats", with(dome("sorted-splats"), "smallest", 0.0), 1e-4),
        ("spheres", dome("spheres"), 1e-4),
        ("a pair of spheres", pair("spheres"), 1e-4),
        ("a pair", pair("column-density"), 2e-3),
        ("a pair of discs", pair("points"), 1e-3),
        ("a pair of volumes", pair("volume"), 1e-2),
    ] {
        let expected = cpu.draw(&shot).unwrap();
        assert_eq!(expected.drawn_by, ["cpu", "cpu"]);
        let is_sum = matches!(expected.values, Raw::Sums(..));
        for (name, session) in [("compute", &mut compute), ("raster", &mut raster)] {
            if name == "raster" && !is_sum {
                let why = session.draw(&shot).err().unwrap().to_string();
                assert!(why.starts_with("--backend: only"), "{what}: {why}");
                continue;
            }
            let found = session.draw(&shot).unwrap();
            assert_eq!(found.drawn_by[0], name, "{what}");
            assert_eq!((found.converged, found.particles, found.nodes), (true, expected.particles, expected.nodes));
            let (l1, l2) = relative_error(&values(&found), &values(&expected));
            println!("{what} by {name}: L1 {l1}, L2 {l2}");
            assert!(l1 < bound && l2 < bound, "{what} by {name}: L1 {l1}, L2 {l2}");
            assert!(values(&expected).iter().filter(|value| **value > 0.0).count() > 900, "{what}: nothing to see");
        }
    }
}

#[test]
fn what_is_left_out_of_a_cartesian_grid_is_what_the_processor_leaves_out() {
    let built = built(&demo(), VqBits::Eight);
    let [mut cpu, mut compute] = [Backend::Cpu, Backend::Compute].map(|backend| session(built.file.path(), backend));
    let whole = with(shot("cartesian", Surround::Flat), "cells", 64.0);
    let clip = Some(ClipBox { min: DVec3::new(4.0, 26.0, 2.0), max: DVec3::new(40.0, 48.0, 22.0) });
    // Depth is that for the picture's camera, not along an axis of the grid.
    let fade = Some(cut::Fade { start: 4.0, length: 6.0 });
    let cuts = [(clip, None), (None, fade), (clip, fade)].map(|(clip, fade)| CutSettings {
        clip,
        fade,
        ..CutSettings::default()
    });
    let before = values(&cpu.draw(&whole).unwrap());
    for cut in cuts {
        let shot = Shot { look: LookPatch { cut: Some(cut), ..whole.look.clone() }, ..whole.clone() };
        let [expected, found] = [&mut cpu, &mut compute].map(|session| values(&session.draw(&shot).unwrap()));
        let (_, changed) = relative_error(&expected, &before);
        let (l1, l2) = relative_error(&found, &expected);
        println!("{cut:?}: L1 {l1}, L2 {l2}, changed by {changed}");
        assert!(changed > 0.05 && l1 < 1e-3 && l2 < 1e-3, "{cut:?}: L1 {l1}, L2 {l2}, changed by {changed}");
    }
}

#[test]
fn what_an_adapter_would_draw_otherwise_on_each_face_is_refused() {
    let built = built(&demo(), VqBits::Eight);
    let mut session = session(built.file.path(), Backend::Compute);
    let mut refused = |shot: &Shot| session.draw(shot).err().unwrap().to_string();
    assert_eq!(refused(&shot("points", DOME)), "--backend: only cpu draws panoramas of points");
    let fade = Some(cut::Fade { start: 5.0, length: 5.0 });
    let fading = shot("column-density", DOME);
    let cut = Some(CutSettings { fade, ..CutSettings::default() });
    let fading = Shot { look: LookPatch { cut, ..fading.look }, ..fading };
    assert_eq!(refused(&fading), "--backend: only cpu draws panoramas that fade with the distance");
}
