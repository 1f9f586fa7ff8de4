//! Measured heights by an adapter's passes: the processor's pictures, without cracks, and the same bits each time.

mod among;
mod holes;
mod rays;
mod seen;

use crate::support::Random;
use deepfield::color::Image;
use deepfield::color::transfer::TransferFunction;
use deepfield::cpu::surface::holes::Holes as HoleLook;
use deepfield::cpu::surface::look::{Attribute, Light, Look};
use deepfield::cpu::surface::paged::PagedSurface;
use deepfield::cpu::surface::placed::{Map, Placed};
use deepfield::cpu::surface::select::{CutNode, Primitive, SurfaceCut, Technique};
use deepfield::cpu::surface::source::SurfaceNodes;
use deepfield::cpu::surface::stitch::Scene;
use deepfield::gpu::Offscreen;
use deepfield::heights::build::{HeightBuildOptions, HeightOrigin, Measured, build_heights};
use deepfield::heights::hierarchy::chunks::ChunkKey;
use deepfield::heights::model::{
    Globe, HeightError, HeightField, HeightGrid, Heights, PhotoAbout, PhotoPlace, PhotoRows, Plane, Window,
};
use deepfield::heights::store::HeightFile;
use deepfield::look::{self, Backend, CameraConfig, HeightsSaid, LookPatch, Shot};
use deepfield::mode::{SettingValue, Settings};
use deepfield::model::{Bounds, ReadMethod, Unit};
use deepfield::picture::adapter::{Adapter as _, AdapterSurface, AdapterValues, Passes};
use deepfield::picture::surface::SurfaceSession;
use deepfield::picture::{Picture, SessionOptions};
use deepfield::view::{Extent, Projection, Surround, View};
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
fn nothing_shows_through_where_levels_meet_on_a_globe() {
    let folder = tempfile::tempdir().unwrap();
    // The first column once more at the end, and rows at both poles: all around without help.
    let [columns, rows] = [2305, 1153];
    let mut field = hills([columns, rows], Holes::None);
    for row in 0..rows {
        field.stored[row * columns + columns - 1] = field.stored[row * columns];
    }
    for (row, beside) in [(0, 1), (rows - 1, rows - 2)] {
        let beside: f64 = field.stored[beside * columns..(beside + 1) * columns].iter().sum();
        field.stored[row * columns..(row + 1) * columns].fill(beside / columns as f64);
    }
    (field.grid.step, field.grid.origin) = ([0.15625, -0.15625], [-180.0, 90.0]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    let file = HeightFile::open(&built(folder.path(), &field), ReadMethod::default()).unwrap();
    let nodes = PagedSurface::new(Arc::new(file), u64::MAX);
    let globe = Globe { equator: 20_000.0, pole: 19_900.0 };
    let placed = Placed::new(&field.grid, Map::Globe(globe), 3.0, 0.0);
    let look = Look {
        attribute: Attribute::Level,
        transfer: TransferFunction::preset("grey").unwrap(),
        range: [-1.0, 6.0],
        light: Light::Eye,
        ambient: 1.0,
        contours: None,
    };
    let mut random = Random(14);
    let mut adapter = Offscreen::preferred();
    let mut joined = 0;
    // Each of these places by each of the passes.
    for round in 0..9 {
        // Over the seam, over the poles, and anywhere; near by and far away.
        let (longitude, latitude) = match round % 3 {
            0 => (180.0, 120.0 * random.next() - 60.0),
            1 => (360.0 * random.next(), if round % 2 == 0 { 89.9 } else { -89.9 }),
            _ => (360.0 * random.next(), 120.0 * random.next() - 60.0),
        };
        let up = DVec3::from(Globe::up(longitude, latitude));
        let away = 20_000.0 + 600.0 + 4000.0 * random.next() * random.next();
        // Narrow enough to see nothing but the globe, though it looks aside.
        let limb = (19_700.0 / away).asin();
        let aside = 0.3 * limb * random.next();
        let level = up.any_orthonormal_vector();
        let target = away * up + away * (aside.sin() * level - aside.cos() * up);
        let projection = Projection::Perspective { fov_y: (0.6 * limb).min(1.0) };
        let view = View::look_at(away * up, target, level.cross(up), projection, 120, 90).unwrap();
        let cut = random_cut(&nodes, &placed, &view, &mut random, 1);
        let scene = Scene::new(&nodes, &placed, cut);
        joined += scene.meshes.iter().flat_map(|mesh| mesh.is_laid).filter(|is_laid| *is_laid).count();
        let (passes, technique) = match round / 3 % 3 {
            2 => (Passes::Compute, Technique::Rays),
            _ => ([Passes::Compute, Passes::Raster][round / 3 % 2], Technique::Hybrid),
        };
        let job = AdapterSurface { technique, ..plain_job(scene, view, look.clone(), passes) };
        let AdapterValues::Light(colors, _) = adapter.surface(Arc::new(job)).unwrap().values else { panic!("sums") };
        let open = colors.rgba.iter().filter(|color| color[3] < 1.0).count();
        assert_eq!(open, 0, "{passes:?}, {technique:?}, round {round}: at {longitude} {latitude} {away} {aside}");
    }
    assert!(joined > 50, "{joined} borders of levels");
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

/// A field with a photo over it.
struct Covered {
    field: HeightField,
    photo: Pixels,
}

struct Pixels {
    about: PhotoAbout,
    values: Vec<u8>,
}

impl PhotoRows for Pixels {
    fn about(&self) -> &PhotoAbout {
        &self.about
    }

    fn memory_bytes(&self) -> u64 {
        0
    }

    fn rows(&self, first: u64, count: u64, out: &mut [u8]) -> Result<(), HeightError> {
        let row = 3 * self.about.size[1] as usize;
        out.copy_from_slice(&self.values[first as usize * row..][..count as usize * row]);
        Ok(())
    }
}

impl Heights for Covered {
    fn grid(&self) -> &HeightGrid {
        self.field.grid()
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.field.stored(window, out)
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        self.field.plane(plane, window, out)
    }
}

impl Measured for Covered {
    fn photo_rows(&self) -> Option<Box<dyn PhotoRows + '_>> {
        Some(Box::new(&self.photo))
    }
}

/// A field under a photo of waves and a little noise, several pixels to a sample, over all of it or somewhere.
fn covered(mut field: HeightField, place: Option<PhotoPlace>) -> Covered {
    (field.planes, field.grid.planes) = (Vec::new(), Vec::new());
    let (rows, columns) = (1100, 1500);
    let mut random = Random(5);
    let values = (0..rows * columns * 3).map(|at| {
        let (x, y) = ((at / 3 % columns) as f64, (at / 3 / columns) as f64);
        let wave = (x / (110.0 + 40.0 * (at % 3) as f64) + (y / 160.0).cos()).sin();
        (128.0 + 105.0 * wave + 12.0 * random.next()) as u8
    });
    let values = values.collect();
    let (place, size) = (place.unwrap_or(PhotoPlace::whole(&field.grid)), [rows as u64, columns as u64]);
    let about = PhotoAbout { path: "p".into(), format: "png".into(), bytes: 0, size, is_grey: false, place };
    Covered { field, photo: Pixels { about, values } }
}

#[test]
fn an_adapter_draws_photos() {
    let folder = tempfile::tempdir().unwrap();
    let part = PhotoPlace { rows: [100.0, 330.0], columns: [-40.0, 420.0] };
    // Over the seam of a globe.
    let beyond = PhotoPlace { rows: [100.0, 430.0], columns: [450.0, 800.0] };
    let all = PhotoPlace { rows: [-0.5, 529.5], columns: [-0.5, 619.5] };
    let near = Wanted { eye: Some([310.0, 200.0, 40.0]), target: Some([500.0, 350.0, -20.0]), ..PLAIN };
    let above_all = Wanted {
        eye: Some([310.0, 265.0, 900.0]),
        target: Some([310.0, 265.5, 0.0]),
        ortho: Some(40.0),
        settings: &[("technique", name("triangles"))],
        ..PLAIN
    };
    let flat = [
        ("far", Wanted { attribute: Some("texture"), ..PLAIN }),
        ("near", Wanted { settings: &[("light", name("eye"))], ..near }),
        ("lines", Wanted { settings: &[("contours", number(8.0))], ..near }),
        ("pixels of the photo", above_all),
    ];
    let target = Some([0.0; 3]);
    let high = [("exaggeration", number(3000.0)), ("light", name("eye"))];
    let round = [
        ("the seam", Wanted { eye: above(180.0, 10.0, 2e7), target, settings: &high, ..PLAIN }),
        ("a pole", Wanted { eye: above(30.0, 88.0, 8e6), target, settings: &high[1..], ..PLAIN }),
    ];
    let fields = [
        ("lakes", covered(hills(SIZE, Holes::Lakes), None), &flat[..], 0.01),
        ("a part", covered(hills(SIZE, Holes::None), Some(part)), &flat[1..2], 0.01),
        ("globe", covered(world(Holes::None), Some(all)), &round[..], 0.01),
        // Its edge is moved by parts of a pixel, as lines are.
        ("a part of a globe", covered(world(Holes::None), Some(beyond)), &round[..1], 0.02),
    ];
    for (field, covered, pictures, most) in &fields {
        let path = built(folder.path(), covered);
        let mut processor = session(&path, Backend::Cpu);
        let expected: Vec<_> = pictures.iter().map(|(_, wanted)| wanted.draw(&mut processor).1).collect();
        // A photo is the same function of what is seen, whatever found that: parts are drawn by one of them.
        let backends = [(Backend::Compute, "compute"), (Backend::Raster, "raster")];
        for (backend, passes) in backends.into_iter().take(pictures.len()) {
            let mut adapter = session(&path, backend);
            for ((what, wanted), expected) in pictures.iter().zip(&expected) {
                let (picture, found) = wanted.draw(&mut adapter);
                assert_eq!(picture.drawn_by[0], passes, "{field}, {what}");
                let (share, mean) = differences(&found, expected);
                println!("{field}, {what}, {passes}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
                assert!(share <= *most && mean < 1.0, "{field}, {what}, {passes}: {share} {mean}");
                // What is kept draws the same.
                assert!(*what != "near" || wanted.draw(&mut adapter).1 == found, "{field}, {what}, {passes}");
            }
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

/// A random camera above a field that looks onto a place where chunks meet, so that nothing but the field is in the picture.
fn camera_over(field: &HeightField, random: &mut Random) -> View {
    let [columns, rows] = [field.grid.columns, field.grid.rows].map(|count| (count - 1) as f64);
    let high = field.stored.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = field.stored.iter().copied().fold(f64::INFINITY, f64::min);
    loop {
        let mut between = |low: f64, high: f64| low + (high - low) * random.next();
        let border = |at: f64| (at / 256.0).round() * 256.0;
        let target = DVec3::new(border(columns * between(0.1, 0.9)), border(rows * between(0.2, 0.8)), 0.0);
        let (angle, away, up) = (between(0.0, 6.3), between(1.0, 150.0), between(2.0, 250.0));
        let eye = target + DVec3::new(away * angle.cos(), away * angle.sin(), high + up);
        let projection = match between(0.0, 1.0) < 0.3 {
            true => Projection::Orthographic { height: between(20.0, 300.0) },
            false => Projection::Perspective { fov_y: between(0.2, 1.0) },
        };
        let Ok(view) = View::look_at(eye, target, DVec3::Z, projection, 120, 90) else { continue };
        // Where rays through the corners meet the lowest ground there may be.
        let is_over = [[0.0, 0.0], [120.0, 0.0], [0.0, 90.0], [120.0, 90.0]].into_iter().all(|corner| {
            let from = view.at_depth(corner, 0.0);
            let along = view.at_depth(corner, 1.0) - from;
            let at = from + (low - from.z) / along.z * along;
            from.z > high && along.z < 0.0 && at.x > 1.0 && at.y > 1.0 && at.x < columns - 1.0 && at.y < rows - 1.0
        });
        if is_over {
            return view;
        }
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

/// Random chunks of all levels that cover a field, as points of so many pixels where these leave no gap.
fn random_cut(nodes: &PagedSurface, placed: &Placed, view: &View, random: &mut Random, point: u32) -> SurfaceCut {
    let lattice = nodes.lattice();
    let (mut waiting, mut chosen) = (vec![lattice.root()], Vec::new());
    while let Some(key) = waiting.pop() {
        // The root alone would meet nothing.
        if key.level > 0 && (key == lattice.root() || random.next() < 0.6) {
            let finer = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[row, column]| ChunkKey {
                level: key.level - 1,
                row: 2 * key.row + row,
                column: 2 * key.column + column,
            });
            waiting.extend(finer.into_iter().filter(|key| lattice.has(*key)));
            continue;
        }
        let facts = nodes.facts(key).unwrap();
        let ends = [0, 1].map(|axis| {
            let places = lattice.places(key, axis);
            [places[0], *places.last().unwrap()]
        });
        let corner = |k: usize| placed.world(ends[0][k] as f64, ends[1][k] as f64, [facts.min, facts.max][k]);
        // A globe's chunk may be anywhere on it.
        let corners =
            if placed.is_flat() { [0, 1].map(corner) } else { [-1.0, 1.0].map(|way| DVec3::splat(3e4 * way)) };
        let extent = Extent { bounds: Bounds::of(corners.map(|corner| corner.to_array())), margin: 0.0 };
        let whole = f64::from(1_u32 << key.level);
        let apart = view.error_pixels(&extent, whole.hypot(whole).hypot(facts.step));
        let primitive = if apart <= 0.999 * f64::from(point) { Primitive::Points } else { Primitive::Triangles };
        // What borders add is reckoned with by those who choose.
        let added = facts.max - facts.min;
        chosen.push(CutNode { key, facts, extent, primitive, error_px: 0.0, added });
    }
    SurfaceCut::new(chosen)
}

#[test]
fn nothing_shows_through_where_levels_meet() {
    let folder = tempfile::tempdir().unwrap();
    // Four levels, with borders along rows as well as along columns.
    let field = hills([1200, 1150], Holes::None);
    let file = HeightFile::open(&built(folder.path(), &field), ReadMethod::default()).unwrap();
    let nodes = PagedSurface::new(Arc::new(file), u64::MAX);
    let placed = Placed::new(&field.grid, Map::Plate, 1.0, 0.0);
    let look = Look {
        attribute: Attribute::Level,
        transfer: TransferFunction::preset("grey").unwrap(),
        range: [-1.0, 6.0],
        light: Light::Eye,
        ambient: 1.0,
        contours: None,
    };
    let mut random = Random(7);
    let mut adapter = Offscreen::preferred();
    let mut joined = 0;
    for round in 0..12 {
        let view = camera_over(&field, &mut random);
        let point = [1, 3][round / 3 % 2];
        let cut = random_cut(&nodes, &placed, &view, &mut random, point);
        let scene = Scene::new(&nodes, &placed, cut);
        joined += scene.meshes.iter().flat_map(|mesh| mesh.is_laid).filter(|is_laid| *is_laid).count();
        let (passes, technique) = [
            (Passes::Compute, Technique::Hybrid),
            (Passes::Raster, Technique::Hybrid),
            (Passes::Compute, Technique::Rays),
        ][round % 3];
        let job = AdapterSurface { technique, point, ..plain_job(scene, view, look.clone(), passes) };
        let AdapterValues::Light(colors, _) = adapter.surface(Arc::new(job)).unwrap().values else { panic!("sums") };
        let open = colors.rgba.iter().filter(|color| color[3] < 1.0).count();
        assert_eq!(open, 0, "{passes:?}, {technique:?}, round {round}: {view:?}");
    }
    assert!(joined > 50, "{joined} borders of levels");
}
