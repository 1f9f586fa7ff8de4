//! Measured heights by an adapter's passes: the processor's pictures, without cracks, and the same bits each time.

mod among;
mod holes;
mod limbs;
mod photos;
mod rays;
mod seams;
mod seen;

use crate::support::Random;
use deepfield::color::Image;
use deepfield::color::transfer::TransferFunction;
use deepfield::cpu::surface::holes::Holes as HoleLook;
use deepfield::cpu::surface::look::{Attribute, Light, Look};
use deepfield::cpu::surface::paged::PagedSurface;
use deepfield::cpu::surface::placed::{Map, Placed};
use deepfield::cpu::surface::select::Technique;
use deepfield::cpu::surface::stitch::Scene;
use deepfield::gpu::Offscreen;
use deepfield::heights::build::{HeightBuildOptions, HeightOrigin, Measured, build_heights};
use deepfield::heights::model::{Globe, HeightField, Plane};
use deepfield::heights::store::HeightFile;
use deepfield::look::{self, Backend, CameraConfig, HeightsSaid, LookPatch, Shot};
use deepfield::mode::{SettingValue, Settings};
use deepfield::model::{ReadMethod, Unit};
use deepfield::picture::adapter::{Adapter as _, AdapterSurface, AdapterValues, Passes};
use deepfield::picture::surface::SurfaceSession;
use deepfield::picture::{Picture, SessionOptions};
use deepfield::view::{Projection, Surround, View};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Columns and rows of the fields: no multiples of a chunk's.
const SIZE: [usize; 2] = [620, 530];

/// How a field is broken.
#[derive(Clone, Copy, PartialEq)]
enum Holes {
    None,
    /// Lakes of several sizes.
    Lakes,
    /// A third of all samples.
    Random,
}

/// Hills of several sizes, with roughness from sample to sample.
fn hills([columns, rows]: [usize; 2], holes: Holes) -> HeightField {
    let mut random = Random(columns as u64);
    let waves: Vec<[f64; 4]> = (0..9)
        .map(|k| {
            let (size, angle) = (400.0 / 1.9_f64.powi(k), 6.3 * random.next());
            [angle.cos() / size, angle.sin() / size, 6.3 * random.next(), 0.12 * size]
        })
        .collect();
    let lakes: Vec<[f64; 3]> = (0..8)
        .map(|k| [columns as f64 * random.next(), rows as f64 * random.next(), 50.0 / (1.0 + f64::from(k))])
        .collect();
    let height = |index: usize| {
        let (x, y) = ((index % columns) as f64, (index / columns) as f64);
        let height: f64 = waves.iter().map(|[a, b, phase, size]| size * (a * x + b * y + phase).sin()).sum();
        let height = height + 0.3 * random.next();
        let is_hole = match holes {
            Holes::None => false,
            Holes::Lakes => lakes.iter().any(|[cx, cy, size]| (x - cx).hypot(y - cy) < *size),
            Holes::Random => random.next() < 0.33,
        };
        if is_hole { f64::NAN } else { height }
    };
    let heights = (0..rows * columns).map(height).collect();
    let mut field = HeightField::of(columns as u64, rows as u64, heights);
    field.grid.planes = ["red", "green", "blue"].map(|name| Plane { name: name.into() }).into();
    let shade = |plane: usize, index: usize| {
        let (x, y) = ((index % columns) as f64, (index / columns) as f64);
        (128.0 + 120.0 * (x / (40.0 + 20.0 * plane as f64) + (y / 70.0).cos()).sin()) as u8
    };
    field.planes = (0..3).map(|plane| (0..rows * columns).map(|index| shade(plane, index)).collect()).collect();
    field
}

fn built(folder: &Path, field: &dyn Measured) -> PathBuf {
    let path = folder.join("field.df");
    build_heights(field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
    path
}

/// A picture and what it looks like.
struct Wanted<'a> {
    eye: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    ortho: Option<f64>,
    attribute: Option<&'a str>,
    settings: &'a [(&'a str, SettingValue)],
}

const PLAIN: Wanted<'static> = Wanted { eye: None, target: None, ortho: None, attribute: None, settings: &[] };

fn number(value: f64) -> SettingValue {
    SettingValue::Number(value)
}

fn name(value: &str) -> SettingValue {
    SettingValue::Name(value.into())
}

impl Wanted<'_> {
    fn shot(&self) -> Shot {
        let settings = self.settings.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
        let look = LookPatch {
            settings: Settings(settings.collect()),
            attribute: self.attribute.map(|name| look::Attribute::Named(name.into())),
            ..LookPatch::default()
        };
        let camera = CameraConfig { eye: self.eye, target: self.target, ortho: self.ortho, ..CameraConfig::default() };
        Shot { look, camera, size: Some((210, 140)), ..Shot::default() }
    }

    fn draw(&self, session: &mut SurfaceSession) -> (Picture, Image) {
        let shot = self.shot();
        let picture = session.draw(&shot).unwrap();
        let image = picture.image(&shot).unwrap();
        (picture, image)
    }
}

fn session(path: &Path, backend: Backend) -> SurfaceSession {
    let options = SessionOptions { backend: Some(backend), ..SessionOptions::default() };
    let session = SurfaceSession::open(path, &HeightsSaid::default(), options, Arc::new(())).unwrap();
    session.with_adapter(Some(Box::new(Offscreen::preferred())))
}

/// How many of a picture's pixels differ from another's by more than 4 of 255, and the mean of all.
fn differences(found: &Image, expected: &Image) -> (f64, f64) {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let pairs = found.rgba.iter().zip(&expected.rgba);
    let apart: Vec<u8> = pairs.map(|(a, b)| (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap()).collect();
    let many = apart.iter().filter(|difference| **difference > 4).count();
    let count = apart.len() as f64;
    (many as f64 / count, apart.iter().map(|difference| f64::from(*difference)).sum::<f64>() / count)
}

#[test]
fn an_adapter_draws_what_the_processor_draws() {
    let folder = tempfile::tempdir().unwrap();
    let near = Wanted { eye: Some([310.0, 200.0, 40.0]), target: Some([500.0, 350.0, -20.0]), ..PLAIN };
    let pictures: &[(Holes, &[(&str, Wanted<'_>)])] = &[
        (
            Holes::None,
            &[
                ("colours", Wanted { ..PLAIN }),
                ("lines", Wanted { attribute: Some("height"), settings: &[("contours", number(8.0))], ..PLAIN }),
                (
                    "slopes by a lamp at the eye",
                    Wanted { attribute: Some("slope"), settings: &[("light", name("eye"))], ..near },
                ),
                (
                    "from above",
                    Wanted {
                        eye: Some([310.0, 265.0, 900.0]),
                        target: Some([310.0, 265.5, 0.0]),
                        ortho: Some(300.0),
                        attribute: Some("aspect"),
                        settings: &[("technique", name("triangles"))],
                    },
                ),
                ("lines near by", Wanted { attribute: Some("height"), settings: &[("contours", number(2.0))], ..near }),
            ],
        ),
        (
            Holes::Lakes,
            &[
                ("lakes", Wanted { attribute: Some("height"), ..PLAIN }),
                (
                    "thrice as high",
                    Wanted { attribute: Some("red"), settings: &[("exaggeration", number(3.0))], ..PLAIN },
                ),
            ],
        ),
        (Holes::Random, &[("a third is missing", Wanted { attribute: Some("height"), ..PLAIN })]),
    ];
    for (holes, wanted) in pictures {
        let path = built(folder.path(), &hills(SIZE, *holes));
        let mut processor = session(&path, Backend::Cpu);
        let expected: Vec<_> = wanted.iter().map(|(_, wanted)| wanted.draw(&mut processor).1).collect();
        let count = expected.len();
        for (backend, passes) in [(Backend::Compute, "compute"), (Backend::Raster, "raster")] {
            let mut adapter = session(&path, backend);
            for (number, ((what, wanted), expected)) in wanted.iter().zip(&expected).enumerate() {
                let (picture, found) = wanted.draw(&mut adapter);
                assert_eq!(picture.drawn_by[0], passes, "{what}");
                let (share, mean) = differences(&found, expected);
                println!("{what}, {passes}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
                assert!(share <= 0.01 && mean < 0.5, "{what}, {passes}: {share} {mean}");
                // The same picture twice is the same bits.
                assert!(number + 1 < count || wanted.draw(&mut adapter).1 == found, "{what}, {passes}");
            }
        }
    }
}

/// Hills all around a globe: samples in the middles of cells, so that half a spacing is left at each pole and a spacing at the seam.
fn world(holes: Holes) -> HeightField {
    let [columns, rows] = SIZE;
    let mut field = hills(SIZE, holes);
    let step = [360.0 / columns as f64, -180.0 / rows as f64];
    (field.grid.step, field.grid.origin) = (step, [-180.0 + 0.5 * step[0], 90.0 + 0.5 * step[1]]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

/// Far above a longitude and a latitude of the Earth.
fn above(longitude: f64, latitude: f64, away: f64) -> Option<[f64; 3]> {
    Some(Globe::up(longitude, latitude).map(|part| away * part))
}

#[test]
fn an_adapter_draws_globes() {
    let folder = tempfile::tempdir().unwrap();
    let high = ("exaggeration", number(3000.0));
    let lamp = ("light", name("eye"));
    let target = Some([0.0; 3]);
    // Largest share of pixels that differ by more than 4 of 255.
    let pictures: [(&str, f64, Wanted<'_>); 6] = [
        ("a globe", 0.01, Wanted { ..PLAIN }),
        (
            "the seam and mountains at the limb",
            0.01,
            Wanted { eye: above(180.0, 10.0, 2e7), target, settings: &[high.clone(), lamp.clone()], ..PLAIN },
        ),
        (
            "a pole",
            0.01,
            Wanted {
                eye: above(30.0, 88.0, 8e6),
                target,
                attribute: Some("slope"),
                settings: &[high.clone(), lamp.clone()],
                ..PLAIN
            },
        ),
        (
            "the other pole, in parallel",
            0.01,
            Wanted {
                eye: above(20.0, -89.5, 8e6),
                target,
                ortho: Some(6e5),
                attribute: Some("red"),
                settings: &[("technique", name("triangles")), lamp.clone()],
            },
        ),
        (
            "points",
            0.01,
            Wanted { attribute: Some("curvature"), settings: &[("technique", name("points")), high.clone()], ..PLAIN },
        ),
        // On the processor triangles are as round as the globe, which moves lines by parts of a pixel.
        (
            "lines",
            0.04,
            Wanted {
                eye: above(100.0, 40.0, 9e6),
                target,
                attribute: Some("height"),
                settings: &[("contours", number(20.0))],
                ..PLAIN
            },
        ),
    ];
    // What lakes look like is seen in two of them; more of holes is beside this.
    for (holes, pictures) in [(Holes::None, &pictures[..]), (Holes::Lakes, &pictures[1..3])] {
        let path = built(folder.path(), &world(holes));
        let mut processor = session(&path, Backend::Cpu);
        let expected: Vec<_> = pictures.iter().map(|(_, _, wanted)| wanted.draw(&mut processor).1).collect();
        for (backend, passes) in [(Backend::Compute, "compute"), (Backend::Raster, "raster")] {
            let mut adapter = session(&path, backend);
            for ((what, most, wanted), expected) in pictures.iter().zip(&expected) {
                let (picture, found) = wanted.draw(&mut adapter);
                assert_eq!(picture.drawn_by[0], passes, "{what}");
                let (share, mean) = differences(&found, expected);
                println!("{what}, {passes}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
                assert!(share <= *most && mean < 1.0, "{what}, {passes}: {share} {mean}");
                assert!(found.rgba.iter().any(|color| color[..3] != found.rgba[0][..3]), "{what}: nothing is drawn");
            }
        }
    }
}

#[test]
fn an_adapter_draws_what_is_left_of_a_form_and_what_has_changed() {
    let folder = tempfile::tempdir().unwrap();
    let before = hills(SIZE, Holes::Lakes);
    let mut after = hills(SIZE, Holes::None);
    let [columns, _] = SIZE;
    for (index, height) in after.stored.iter_mut().enumerate() {
        let (x, y) = ((index % columns) as f64, (index / columns) as f64);
        *height += 0.2 * x + 15.0 * (-((x - 300.0).powi(2) + (y - 200.0).powi(2)) / 4000.0).exp();
    }
    let earlier = folder.path().join("earlier.df");
    std::fs::rename(built(folder.path(), &before), &earlier).unwrap();
    let path = built(folder.path(), &after);
    let said = HeightsSaid { before: Some(earlier), ..HeightsSaid::default() };
    let open = |backend| {
        let options = SessionOptions { backend: Some(backend), ..SessionOptions::default() };
        let session = SurfaceSession::open(&path, &said, options, Arc::new(())).unwrap();
        session.with_adapter(Some(Box::new(Offscreen::preferred())))
    };
    let mut processor = open(Backend::Cpu);
    let near = Wanted { eye: Some([310.0, 100.0, 240.0]), target: Some([310.0, 300.0, 60.0]), ..PLAIN };
    let pictures = [
        ("what a plane leaves", Wanted { attribute: Some("residual"), settings: &[("form", name("plane"))], ..PLAIN }),
        (
            "what a quadric leaves",
            Wanted { attribute: Some("residual"), settings: &[("form", name("quadric"))], ..near },
        ),
        (
            "a sphere, and beside it",
            Wanted { attribute: Some("residual"), settings: &[("form", name("sphere"))], ..near },
        ),
        ("a difference", Wanted { attribute: Some("difference"), ..PLAIN }),
        ("a difference near by", Wanted { attribute: Some("difference"), ..near }),
    ];
    let expected = pictures.each_ref().map(|(_, wanted)| wanted.draw(&mut processor).1);
    for (backend, passes) in [(Backend::Compute, "compute"), (Backend::Raster, "raster")] {
        let mut adapter = open(backend);
        for ((what, wanted), expected) in pictures.iter().zip(&expected) {
            let (picture, found) = wanted.draw(&mut adapter);
            assert_eq!(picture.drawn_by[0], passes, "{what}");
            let (share, mean) = differences(&found, expected);
            println!("{what}, {passes}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
            assert!(share <= 0.01 && mean < 0.5, "{what}, {passes}: {share} {mean}");
        }
    }
}

#[test]
fn an_adapter_draws_faces_of_panoramas() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), &hills(SIZE, Holes::None));
    let wanted = Wanted { eye: Some([310.0, 265.0, 60.0]), target: Some([310.0, 400.0, 40.0]), ..PLAIN };
    let dome = Surround::Dome { aperture: 200.0, tilt: -40.0 };
    let mut sessions = [Backend::Cpu, Backend::Compute].map(|backend| (session(&path, backend), backend));
    for surround in [dome, Surround::Equirectangular] {
        let shot = Shot { surround, size: Some((160, 160)), ..wanted.shot() };
        let [expected, found] = sessions.each_mut().map(|(session, backend)| {
            let picture = session.draw(&shot).unwrap();
            assert_eq!(picture.drawn_by[0] == "cpu", *backend == Backend::Cpu, "{surround:?}");
            picture.image(&shot).unwrap()
        });
        // Faces are sampled once more, and so a little softer than rays.
        let (share, mean) = differences(&found, &expected);
        println!("{surround:?}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
        assert!(share <= 0.04 && mean < 1.2, "{surround:?}: {share} {mean}");
    }
}

/// What an adapter is asked for where only chunks and colours matter.
fn plain_job(scene: Scene, view: View, look: Look, passes: Passes) -> AdapterSurface {
    AdapterSurface {
        scene: Arc::new(scene),
        view,
        parts: 1,
        look,
        form: None,
        photo: None,
        technique: Technique::Hybrid,
        point: 1,
        holes: HoleLook::Open,
        walls: None,
        reference: 0.0,
        passes,
    }
}
