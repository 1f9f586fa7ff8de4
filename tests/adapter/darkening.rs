//! Ambient occlusion and shadows on pictures that an adapter draws, lamps' included, against those of the processor.

use crate::support::{built, demo};
use deepfield::codec::VqBits;
use deepfield::color::accumulation::relative_error;
use deepfield::gpu::Offscreen;
use deepfield::look::{Backend, CameraConfig, LookPatch, Member, Shot};
use deepfield::mode::{Raw, SettingValue, Settings};
use deepfield::modes;
use deepfield::picture::{Picture, Session, SessionOptions};
use deepfield::view::{Eyes, Stereo, StereoKind, Surround};
use std::path::Path;
use std::sync::Arc;

/// The sky near by, and a lamp of several places.
const BOTH: &[(&str, f64)] =
    &[("ambient-occlusion", 0.8), ("shadows", 0.7), ("light-size", 8.0), ("light-samples", 3.0)];
/// A lamp that is a point.
const POINT: &[(&str, f64)] = &[("shadows", 0.8), ("light-size", 0.0)];

/// All of the data from outside, plainly lit.
fn shot(mode: &str, set: &[(&str, SettingValue)]) -> Shot {
    let camera = CameraConfig { eye: Some([60.0, 50.0, 105.0]), target: Some([25.0; 3]), ..CameraConfig::default() };
    let settings = Settings(set.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect());
    let look = LookPatch { mode: modes::find(mode), settings, ..LookPatch::default() };
    Shot { look, camera, size: Some((80, 60)), ..Shot::default() }
}

/// From the middle of the data, with particles all around.
fn within(shot: Shot) -> Shot {
    let camera =
        CameraConfig { eye: Some([25.0, 25.0, 24.0]), target: Some([25.0, 26.0, 0.0]), ..CameraConfig::default() };
    Shot { camera, size: Some((48, 48)), ..shot }
}

fn darkened(shot: &Shot, set: &[(&str, f64)]) -> Shot {
    let mut dark = shot.clone();
    let settings = &mut dark.look.settings.0;
    settings.extend(set.iter().map(|(name, number)| ((*name).to_owned(), SettingValue::Number(*number))));
    dark
}

fn session(file: &Path, backend: Backend) -> Session {
    let options = SessionOptions { backend: Some(backend), ..SessionOptions::default() };
    let opened = Session::open(&[Member::new(file)], options, [], |path| Ok(path.to_owned()), Arc::new(()));
    opened.unwrap().with_adapter(Some(Box::new(Offscreen::default())))
}

fn light(picture: &Picture) -> Vec<f32> {
    match &picture.values {
        Raw::Light(painted) => painted.colors.rgba.as_flattened().to_vec(),
        Raw::Sums(..) => panic!("sums are not lit"),
    }
}

#[test]
fn what_an_adapter_draws_is_as_dark_as_on_the_processor() {
    let built = built(&demo(), VqBits::Eight);
    let [mut cpu, mut compute] = [Backend::Cpu, Backend::Compute].map(|backend| session(built.file.path(), backend));
    let numbers = |numbers: &[f64]| SettingValue::Numbers(numbers.to_vec());
    let number = SettingValue::Number;
    // What covers is behind what does not, and before what would.
    let veiled = || ("iso-opacities", numbers(&[0.3, 0.8, 1.0]));
    let exact = || ("smallest", number(0.0));
    let surface = |set: &[(&'static str, SettingValue)]| shot("isosurface", &[&[veiled(), exact()], set].concat());
    let (thin, both) = (("opacity", number(0.05)), ("iso-opacities", numbers(&[0.8, 1.0])));
    let pair = Stereo { kind: StereoKind::OffAxis, separation: 0.5, zero_parallax: 10.0, eyes: Eyes::SideBySide };
    let dome = Surround::Dome { aperture: 210.0, tilt: 20.0 };
    for (what, plain, set) in [
        ("spheres", shot("spheres", &[]), BOTH),
        ("spheres all around", Shot { surround: dome, ..within(shot("spheres", &[])) }, POINT),
        ("a surface", surface(&[]), BOTH),
        // Where surfaces keep light from each other, that is not smoothed.
        ("bumps", surface(&[("surface-smoothing", number(4.0))]), POINT),
        (
            "a surface of another column",
            surface(&[("surface-field", SettingValue::Name("smoothing-length".into()))]),
            BOTH,
        ),
        ("a surface in a thin volume", shot("volume-isosurface", &[thin, both, exact()]), BOTH),
        ("a pair of surfaces", Shot { stereo: Some(pair), ..within(surface(&[])) }, POINT),
    ] {
        let shot = darkened(&plain, set);
        let (expected, found) = (cpu.draw(&shot).unwrap(), compute.draw(&shot).unwrap());
        assert_eq!([&expected.drawn_by[0], &found.drawn_by[0]], ["cpu", "compute"], "{what}");
        let (expected, undarkened) = (light(&expected), light(&cpu.draw(&plain).unwrap()));
        let (_, dark) = relative_error(&undarkened, &expected);
        let (l1, l2) = relative_error(&light(&found), &expected);
        println!("{what}: L1 {l1:.2e}, L2 {l2:.2e}; undarkened {dark:.2e}");
        assert!(dark > 0.01, "{what}: nothing is dark, {dark}");
        // In software 5e-6 and 1e-5: no silhouette is another pixel's, and no shadow.
        assert!(l1 < 1e-4 && l2 < 3e-4, "{what}: L1 {l1}, L2 {l2}, undarkened {dark}");
    }
}

#[test]
fn discs_are_not_darkened() {
    let built = built(&demo(), VqBits::Eight);
    let mut session = session(built.file.path(), Backend::Raster);
    for mode in ["spheres", "isosurface"] {
        let refused = session.draw(&darkened(&shot(mode, &[]), BOTH)).err().unwrap().to_string();
        assert_eq!(refused, format!("--backend: only compute and cpu draw the mode {mode}"));
    }
}
