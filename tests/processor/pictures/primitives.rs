//! Outlines of what a hierarchy draws: one for each splat of the statistics, of whatever levels.

use super::clusters::data;
use deepfield::color::colors::to_linear;
use deepfield::look::{Camera, LookPatch, SceneFile, Shot};
use deepfield::mode::{Raw, SettingValue};
use deepfield::modes::primitives;
use deepfield::picture::{Picture, Session};
use std::path::Path;
use std::sync::Arc;

/// All of the data, from an eye outside of it, with these settings of the levels, and of the mode.
fn draw(session: &mut Session, ortho: bool, levels: &[(&str, SettingValue)], own: &[(&str, &str)]) -> Picture {
    let mut look = LookPatch { mode: Some(&primitives::MODE), ..LookPatch::default() };
    for (name, value) in levels {
        look.budget.0.insert((*name).into(), value.clone());
    }
    for (name, value) in own {
        look.settings.0.insert((*name).into(), SettingValue::Name((*value).into()));
    }
    look.settings.0.insert(primitives::FILL.name.into(), SettingValue::Number(0.0));
    let bounds = session.framed(&look).unwrap();
    let size = bounds.size().length();
    let camera = Camera {
        eye: (bounds.center() + glam::DVec3::new(0.6, 0.5, 1.0) * 2.0 * size).into(),
        target: bounds.center().into(),
        up: [0.0, 1.0, 0.0],
        fov: 50.0,
        ortho: ortho.then_some(2.0 * size),
    };
    let scene = SceneFile { look, size: Some((120, 120)), camera: Some(camera), ..SceneFile::new(Vec::new()) };
    session.draw(&Shot::of_scene(scene, Path::new(""))).unwrap()
}

#[test]
fn every_splat_has_an_outline_in_the_colour_of_what_it_stands_for() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    let name = |name: &str| SettingValue::Name(name.into());
    let few = ("splats", SettingValue::Number(500.0));
    let sets: [(&[(&str, SettingValue)], &str); 4] = [
        (&[("levels", name("clusters")), few.clone()], "clusters"),
        (&[("levels", name("splats"))], "splats"),
        (std::slice::from_ref(&few), "clusters"),
        (&[("levels", name("clusters")), ("splats", SettingValue::Number(1e9))], "clusters"),
    ];
    for ortho in [true, false] {
        for (levels, drawn_from) in &sets {
            let picture = draw(&mut session, ortho, levels, &[("outline-color", "type")]);
            let Raw::Light(painted) = &picture.values else { panic!("outlines are colours") };
            assert_eq!(painted.report.particles, picture.particles, "{levels:?}");
            assert_eq!((picture.drawn_from, picture.level_report.splats), (*drawn_from, picture.particles));
            // All clusters are orange, all particles, of which there is room for all, nearly white.
            let is_few = levels.contains(&few);
            let rgba = painted.colors.rgba.iter().filter(|rgba| rgba[3] > 0.9);
            let shares: Vec<[f32; 2]> = rgba.map(|[r, g, b, _]| [g / r, b / r]).collect();
            assert!(shares.len() > 100, "{}", shares.len());
            let orange = [to_linear(0.55), to_linear(0.15)];
            for share in shares.iter().filter(|_| *drawn_from == "clusters") {
                let is_orange = (0..2).all(|k| (share[k] - orange[k]).abs() < 0.02);
                assert_eq!(is_orange, is_few, "{levels:?}: {share:?}");
            }
        }
    }
}
