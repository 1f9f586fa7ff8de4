//! Clusters in pictures of all directions and for two eyes: one number of splats for all faces, one selection for both eyes.

use super::clusters::data;
use deepfield::color::Colors;
use deepfield::color::transfer::Levels;
use deepfield::look::{Camera, LookPatch, SceneFile, Shot};
use deepfield::mode::{LightPicture, Raw, SettingValue};
use deepfield::modes::{column_density, find};
use deepfield::picture::{Picture, Session};
use deepfield::view::{CubeLayout, Eyes, Panorama, Stereo, StereoKind, Surround};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// An eye in the data, in units of its diagonal from the middle.
const WITHIN: DVec3 = DVec3::new(0.02, -0.03, 0.05);
/// One outside of it.
const OUTSIDE: DVec3 = DVec3::new(0.3, 0.4, 1.4);

struct Around {
    surround: Surround,
    stereo: Option<Stereo>,
    eye: DVec3,
}

impl Around {
    fn shot(&self, session: &mut Session, look: &LookPatch) -> Shot {
        let bounds = session.framed(look).unwrap();
        let eye = bounds.center() + bounds.size().length() * self.eye;
        let camera =
            Camera { eye: eye.into(), target: bounds.center().into(), up: [0.0, 1.0, 0.0], fov: 60.0, ortho: None };
        let size = match self.surround {
            Surround::Equirectangular => (96, 48),
            _ => (48, 48),
        };
        let scene =
            SceneFile { look: look.clone(), size: Some(size), camera: Some(camera), ..SceneFile::new(Vec::new()) };
        let stereo =
            self.stereo.map(|stereo| Stereo { separation: stereo.separation * bounds.size().length(), ..stereo });
        Shot { surround: self.surround, stereo, ..Shot::of_scene(scene, Path::new("")) }
    }

    fn draw(&self, session: &mut Session, look: &LookPatch) -> Picture {
        let shot = self.shot(session, look);
        session.draw(&shot).unwrap()
    }
}

fn look(mode: &str, splats: Option<f64>) -> LookPatch {
    let mut look = LookPatch { mode: find(mode), ..LookPatch::default() };
    let levels = if splats.is_some() { "clusters" } else { "splats" };
    look.budget.0.insert("levels".into(), SettingValue::Name(levels.into()));
    if let Some(splats) = splats {
        look.budget.0.insert("splats".into(), SettingValue::Number(splats));
    }
    look
}

fn values(picture: &Picture) -> Vec<f32> {
    match &picture.values {
        Raw::Sums(sums, _) => sums.p.clone(),
        Raw::Light(painted) => painted.colors.rgba.iter().flatten().copied().collect(),
    }
}

const SURROUNDS: [Surround; 4] = [
    Surround::Dome { aperture: 180.0, tilt: 30.0 },
    Surround::Dome { aperture: 320.0, tilt: 0.0 },
    Surround::Equirectangular,
    Surround::Cube { layout: CubeLayout::Cross },
];

#[test]
fn all_faces_together_keep_to_the_number_of_splats() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    // Sums and colours in each projection, and each other way to draw in one of them.
    let others = ["points", "sorted-splats", "cartesian", "primitives"];
    for (surround, other) in SURROUNDS.into_iter().zip(others) {
        for mode in ["column-density", "volume", other] {
            let around = Around { surround, stereo: None, eye: WITHIN };
            let splats = 3000_u32;
            let mut look = look(mode, Some(f64::from(splats)));
            if mode == "cartesian" {
                // How many splats are drawn has nothing to do with the grid.
                look.settings.0.insert("cells".into(), SettingValue::Number(64.0));
            }
            let picture = around.draw(&mut session, &look);
            let drawn = picture.particles;
            assert!(drawn <= u64::from(splats), "{surround:?} {mode}: {drawn}");
            assert!(drawn >= u64::from(splats) * 9 / 10, "{surround:?} {mode}: {drawn}");
            assert_eq!((picture.drawn_from, picture.level_report.splats), ("clusters", drawn), "{mode}");
            assert!(values(&picture).iter().any(|value| *value > 0.0), "{mode}");
        }
    }
}

/// Light over the solid angle is the weight over the squared distance: merging moves it a little nearer to the middle.
#[test]
fn light_is_that_of_the_particles() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    for (eye, few, many) in [(OUTSIDE, 2e-3, 1e-3), (WITHIN, 0.05, 0.02)] {
        let around = Around { surround: Surround::Equirectangular, stereo: None, eye };
        let mut light = |splats: Option<f64>| -> (f64, Vec<f64>) {
            let look = look("column-density", splats);
            let shot = around.shot(&mut session, &look);
            let view = shot.view(session.framed(&look).unwrap(), None).unwrap();
            let panorama = Panorama::around(&view, shot.surround).unwrap().unwrap();
            let values = values(&session.draw(&shot).unwrap());
            let place = |index: usize| [(index % 96) as f64 + 0.5, (index / 96) as f64 + 0.5];
            let lit: Vec<f64> = (0..).zip(values).map(|(i, p)| panorama.solid_angle(place(i)) * f64::from(p)).collect();
            (lit.iter().sum(), lit)
        };
        let (all, leaves) = light(None);
        let mut before = f64::INFINITY;
        for (splats, tolerance) in [(500.0, few), (4000.0, few), (16_000.0, many)] {
            let (sum, lit) = light(Some(splats));
            assert!((sum / all - 1.0).abs() < tolerance, "{eye} {splats}: {sum} of {all}");
            let differ: f64 = lit.iter().zip(&leaves).map(|(a, b)| (a - b).abs()).sum::<f64>() / all;
            assert!(differ < before, "{eye} {splats}: {differ} after {before}");
            before = differ;
        }
    }
}

#[test]
fn both_eyes_draw_the_same_splats() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    let pair = |kind, eyes| Some(Stereo { kind, separation: 0.02, zero_parallax: 30.0, eyes });
    for (surround, kind) in
        [(Surround::Flat, StereoKind::OffAxis), (Surround::Equirectangular, StereoKind::Omnidirectional)]
    {
        for mode in ["column-density", "volume"] {
            let mut draw = |eyes| {
                let around = Around { surround, stereo: pair(kind, eyes), eye: WITHIN };
                let picture = around.draw(&mut session, &look(mode, Some(2000.0)));
                (picture.particles, values(&picture))
            };
            let (left, right, both) = (draw(Eyes::Left), draw(Eyes::Right), draw(Eyes::OverUnder));
            assert!(left.0 <= 2000 && left.0 >= 1800, "{surround:?} {mode}: {}", left.0);
            assert_eq!((left.0, left.0), (right.0, both.0), "{surround:?} {mode}");
            assert!(both.1 == [&left.1[..], &right.1[..]].concat(), "{surround:?} {mode}");
            assert!(left.1 != right.1, "{surround:?} {mode}");
        }
    }
}

/// Eyes that are next to each other see what one sees, in colours of the same ranges.
#[test]
fn splats_lie_over_each_other_for_two_eyes() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    let mut look = look("column-density", Some(2000.0));
    look.budget.0.insert("blend".into(), SettingValue::Name("over".into()));
    let stereo = Stereo { kind: StereoKind::OffAxis, separation: 1e-9, zero_parallax: 30.0, eyes: Eyes::OverUnder };
    let around = |stereo| Around { surround: Surround::Flat, stereo, eye: OUTSIDE };
    let one = values(&around(None).draw(&mut session, &look));
    let picture = around(Some(stereo)).draw(&mut session, &look);
    let both = values(&picture);
    assert_eq!(picture.level_report.order, Some("exact"));
    let differ = both.iter().zip(one.iter().chain(&one)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(both.len() == 2 * one.len() && differ < 5e-3, "{differ}");
}

/// A colour between the middles of four pixels.
fn between(colors: &Colors, [x, y]: [f64; 2]) -> [f32; 4] {
    let (i, j) = ((x - 0.5).floor(), (y - 0.5).floor());
    let (u, v) = ((x - 0.5 - i) as f32, (y - 0.5 - j) as f32);
    let at = |i: f64, j: f64| colors.rgba[j as usize * colors.width as usize + i as usize];
    let corners = [at(i, j), at(i + 1.0, j), at(i, j + 1.0), at(i + 1.0, j + 1.0)];
    let shares = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    std::array::from_fn(|k| corners.iter().zip(shares).map(|(corner, share)| share * corner[k]).sum())
}

fn colors(picture: Picture) -> Colors {
    match picture.values {
        Raw::Light(painted) => painted.colors,
        Raw::Sums(..) => unreachable!("splats that lie over each other are light"),
    }
}

/// Around the middle of a dome that leans to the front, splats over each other look as in a flat picture with as wide pixels there, but for
/// what reading both between pixels blurs.
#[test]
fn splats_that_lie_over_each_other_look_the_same_all_around() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    for splats in [Some(2000.0), None] {
        let mut look = look("column-density", splats);
        look.budget.0.insert("blend".into(), SettingValue::Name("over".into()));
        let leaning = Surround::Dome { aperture: 60.0, tilt: 90.0 };
        let dome = Around { surround: leaning, stereo: None, eye: OUTSIDE };
        let flat = Around { surround: Surround::Flat, ..dome };
        // In colours of the same ranges.
        let first = flat.draw(&mut session, &look);
        let Raw::Light(LightPicture { levels, .. }) = &first.values else { unreachable!("they are light") };
        look.transfer = Some(first.transfer.clone().with_levels(&Levels { p: levels.density, s: levels.attribute }));
        let shot = Shot { size: Some((320, 320)), ..dome.shot(&mut session, &look) };
        let view = shot.view(session.framed(&look).unwrap(), None).unwrap();
        let panorama = Panorama::around(&view, leaning).unwrap().unwrap();
        let picture = session.draw(&shot).unwrap();
        assert_eq!(picture.level_report.order, Some("exact"));
        let around = colors(picture);
        // With the shot's 60 degrees.
        let height = (2.0 * 30f64.to_radians().tan() / panorama.pixel_angle()).round() as u32;
        let shot = Shot { size: Some((height, height)), ..flat.shot(&mut session, &look) };
        let view = shot.view(session.framed(&look).unwrap(), None).unwrap();
        let flat = colors(session.draw(&shot).unwrap());
        let (mut apart, mut all, mut lit) = (0.0, 0.0, 0);
        for (index, found) in around.rgba.iter().enumerate() {
            let place = [(index % 320) as f64 + 0.5, (index / 320) as f64 + 0.5];
            let Some(ray) = panorama.direction(place) else { continue };
            if ray.dot(view.forward) < 10f64.to_radians().cos() {
                continue;
            }
            let [x, y] = view.to_pixels(view.to_camera(view.eye + ray)).unwrap();
            let expected = between(&flat, [x, y]);
            lit += usize::from(expected[3] > 0.1);
            for k in 0..4 {
                apart += f64::from(found[k] - expected[k]).powi(2);
                all += f64::from(expected[k]).powi(2);
            }
        }
        let found = (apart / all).sqrt();
        println!("{splats:?}: {found:.4}, {lit} pixels");
        assert!(lit > 2000 && found < 0.05, "{splats:?}: {found}, {lit} pixels");
    }
}

/// Other footprints show the same matter, in flat pictures, and nowhere where they are not drawn.
#[test]
fn footprints_keep_the_light() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    let flat = Around { surround: Surround::Flat, stereo: None, eye: OUTSIDE };
    let with = |name: &'static str, value: &str| {
        let mut look = look("column-density", Some(2000.0));
        look.budget.0.insert("footprint".into(), SettingValue::Name(value.into()));
        look.budget.0.insert(name.into(), SettingValue::Name(if name == "blend" { "over" } else { value }.into()));
        look
    };
    let sum = |values: &[f32]| values.iter().map(|value| f64::from(*value)).sum::<f64>();
    let kernels = values(&flat.draw(&mut session, &look("column-density", Some(2000.0))));
    for footprint in ["gaussian", "disc", "pixel"] {
        let drawn = values(&flat.draw(&mut session, &with("footprint", footprint)));
        assert!((sum(&drawn) / sum(&kernels) - 1.0).abs() < 0.01, "{footprint}: {} {}", sum(&drawn), sum(&kernels));
        let apart: f64 = drawn.iter().zip(&kernels).map(|(a, b)| f64::from((a - b).abs())).sum();
        assert!(apart > 0.01 * sum(&kernels), "{footprint}: {apart}");
    }
    let dome = Around { surround: Surround::Dome { aperture: 180.0, tilt: 0.0 }, stereo: None, eye: OUTSIDE };
    for (around, look, why) in [
        (dome, with("footprint", "disc"), "footprint disc: only flat pictures are drawn so"),
        (flat, with("blend", "disc"), "blend over: lays kernels over each other, found footprint disc"),
    ] {
        let shot = around.shot(&mut session, &look);
        assert_eq!(session.draw(&shot).err().map(|error| error.to_string()).unwrap_or_default(), why);
    }
}

#[test]
fn an_error_of_a_panorama_is_kept_and_told() {
    let data = data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    let around = Around { surround: Surround::Dome { aperture: 180.0, tilt: 90.0 }, stereo: None, eye: OUTSIDE };
    let leaves = values(&around.draw(&mut session, &look("column-density", None)));
    let mut look = LookPatch { mode: Some(&column_density::MODE), ..LookPatch::default() };
    look.budget.0.insert("error-picture".into(), SettingValue::Number(0.1));
    let picture = around.draw(&mut session, &look);
    let told = picture.level_report.error_estimate.unwrap();
    assert!(told <= 0.1 && picture.drawn_from == "clusters", "{told}");
    // Never exceeded over the solid angle, of which the middle of this dome's pixels have nearly the same.
    let bound = picture.level_report.error_bound.unwrap();
    assert!(bound > told && bound <= 2.0, "{bound}, {told}");
    let found = values(&picture);
    let differ: f32 = found.iter().zip(&leaves).map(|(a, b)| (a - b).abs()).sum::<f32>() / leaves.iter().sum::<f32>();
    assert!(differ < 0.2 && differ > 0.005 && f64::from(differ) < bound, "{differ}, told as {told}, at most {bound}");
    look.budget.0.insert("error-picture".into(), SettingValue::Number(0.0));
    look.budget.0.insert("frame-ms".into(), SettingValue::Number(200.0));
    let picture = around.draw(&mut session, &look);
    assert!(picture.drawn_from == "clusters" && picture.particles > 0);
}
