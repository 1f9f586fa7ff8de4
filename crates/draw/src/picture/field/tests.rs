//! Pictures of images and volumes against what is known of them.

use super::{FieldSession, GRADIENT, OpenField, Wanted};
use crate::build::grid::{GridBuildOptions, build_grid};
use crate::color::transfer::{Range, TransferFunction};
use crate::cpu::shadowing::Lighting;
use crate::explore::export::grid::{GridFormat, write_grid};
use crate::hierarchy::wavelet::Weighting;
use crate::import::{GridOptions, open_grid};
use crate::look::{Attribute, CameraConfig, LookPatch, Shot};
use crate::mode::{Raw, SettingValue};
use crate::model::{Channel, Grid, ReadMethod, SampleType};
use crate::modes;
use crate::picture::{PictureError, SessionOptions};
use crate::view::cut::ClipBox;
use crate::view::{CutSettings, Eyes, Stereo, StereoKind, Surround};
use glam::{DMat3, DVec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

mod points;

/// A file of a volume of bytes.
fn volume(folder: &Path, shape: [u64; 3], value: impl Fn([u64; 3]) -> f64) -> PathBuf {
    let grid = Grid::volume(shape, SampleType::U8, Channel::numbered(1));
    stored(folder, &grid, value)
}

fn stored(folder: &Path, grid: &Grid, value: impl Fn([u64; 3]) -> f64) -> PathBuf {
    let [x, y, z] = grid.shape;
    let samples: Vec<u8> =
        (0..x * y * z).map(|i| value([i % x, i / x % y, i / (x * y)]).round().clamp(0.0, 255.0) as u8).collect();
    let path = folder.join("volume.nrrd");
    write_grid(&path, GridFormat::Nrrd, grid, &samples).unwrap();
    path
}

/// Straight along z, `height` world units high.
fn above(target: DVec3, height: f64) -> CameraConfig {
    let eye = target + DVec3::Z * 1000.0;
    CameraConfig {
        eye: Some(eye.to_array()),
        target: Some(target.to_array()),
        up: None,
        fov: None,
        ortho: Some(height),
    }
}

fn shot(mode: &str, transfer: &str, camera: CameraConfig, size: (u32, u32)) -> Shot {
    let transfer = (!transfer.is_empty()).then(|| TransferFunction::parse(transfer, "t").unwrap());
    let look = LookPatch { mode: modes::find(mode), transfer, ..LookPatch::default() };
    Shot { look, camera, size: Some(size), ..Shot::default() }
}

fn with(mut shot: Shot, name: &str, value: SettingValue) -> Shot {
    shot.look.settings.0.insert(name.into(), value);
    shot
}

fn pixels(path: &Path, shot: &Shot) -> Vec<[f32; 4]> {
    let mut session = FieldSession::open(path, SessionOptions::default(), Arc::new(())).unwrap();
    match session.draw(shot).unwrap().values {
        Raw::Light(painted) => painted.colors.rgba,
        Raw::Sums(sums, _) => sums.p.iter().map(|p| [*p, 0.0, 0.0, 1.0]).collect(),
    }
}

const HAZE: &str = "(scale: linear, range: fixed(0.0, 255.0), color_map: [(0.0, \"#000000\"), (1.0, \"#ffffff\")], \
                    opacity: [(0.0, 0.1), (1.0, 0.1)], brightness: [(0.0, 0.0), (1.0, 1.0)], unit_length: fixed(2.0))";

/// Parts that something else is drawn among come to the picture itself, in every pixel, and are few and in order.
#[test]
fn parts_come_to_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [24, 20, 28], |[x, y, z]| {
        8.0 * x as f64 + 3.0 * ((y * z) as f64 * 0.2).sin().abs() * y as f64
    });
    let mut session = FieldSession::open(&path, SessionOptions::default(), Arc::new(())).unwrap();
    let camera = CameraConfig { eye: Some([40.0, 30.0, 60.0]), fov: Some(35.0), ..CameraConfig::default() };
    for (mode, most) in [("volume", 17), ("isosurface", 40), ("volume-isosurface", 40), ("slice", 1)] {
        for transfer in [HAZE, ""] {
            let own = shot(mode, transfer, camera, (80, 60));
            let prepared = session.prepare(&own).unwrap();
            let view = own.view(session.opened().grid().bounds(), None).unwrap();
            let Raw::Light(whole) = prepared.draw(&view).unwrap() else { panic!("light") };
            let parts = prepared.parts(&view, &Lighting::default()).unwrap();
            let together = parts.colors();
            let mut lit = 0;
            for (index, (own, expected)) in together.rgba.iter().zip(&whole.colors.rgba).enumerate() {
                assert!((0..4).all(|k| (own[k] - expected[k]).abs() < 2e-5), "{mode}: {own:?}, not {expected:?}");
                let of = parts.of(index % 80, index / 80);
                assert!(of.len() <= most && of.is_sorted_by(|a, b| a.depth <= b.depth), "{mode}: {of:?}");
                lit += usize::from(!of.is_empty());
            }
            assert!(lit > 500, "{mode}: {lit}");
        }
    }
    let away = shot("volume", HAZE, CameraConfig { target: Some([90.0, 90.0, 900.0]), ..camera }, (80, 60));
    let prepared = session.prepare(&away).unwrap();
    let view = away.view(session.opened().grid().bounds(), None).unwrap();
    assert!(prepared.parts(&view, &Lighting::default()).unwrap().colors().rgba.iter().all(|color| *color == [0.0; 4]));
}

/// An eye in the middle of an image would see it from its edge.
#[test]
fn an_image_is_seen_around_an_eye() {
    let folder = tempfile::tempdir().unwrap();
    let image = Grid::image([32, 24], SampleType::U8, Channel::numbered(1));
    let path = stored(folder.path(), &image, |[x, y, _]| if (x / 4 + y / 4) % 2 == 0 { 250.0 } else { 100.0 });
    let dome = Surround::Dome { aperture: 180.0, tilt: 0.0 };
    for (surround, (width, height)) in [(dome, (128, 128)), (Surround::Equirectangular, (256, 128))] {
        let shot = Shot { surround, ..shot("image", "", CameraConfig::default(), (width, height)) };
        let [mut left, mut right, mut above] = [0; 3];
        for (at, _) in (0_u32..).zip(pixels(&path, &shot)).filter(|(_, color)| color[1] > 0.1) {
            *(if at % width < width / 2 { &mut left } else { &mut right }) += 1_u32;
            above += u32::from(at / width < height / 2);
        }
        // To the left and to the right of the middle alike, and in a dome between front and zenith.
        assert!(left > 100 && left.abs_diff(right) * 4 < left, "{surround:?}: {left} {right}");
        assert!(if surround == dome { above == 0 } else { above > 100 }, "{surround:?}: {above}");
    }
}

#[test]
fn opacity_is_that_of_the_way_through() {
    let folder = tempfile::tempdir().unwrap();
    let mut grid = Grid::volume([16, 16, 24], SampleType::U8, Channel::numbered(1));
    grid.to_world.matrix3 = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.5));
    let path = stored(folder.path(), &grid, |_| 100.0);
    // 12 units of an opacity of 0.1 in two units, whatever the resolution.
    for (resolution, tolerance) in [(1.0, 2e-3), (0.5, 4e-3)] {
        let haze = shot("volume", HAZE, above(DVec3::new(7.5, 7.5, 6.0), 8.0), (64, 64));
        let haze = with(haze, "resolution", SettingValue::Number(resolution));
        let alpha = pixels(&path, &haze)[32 * 64 + 32][3];
        assert!((alpha - (1.0 - 0.9f32.powi(6))).abs() < tolerance, "{resolution}: {alpha}");
    }
}

#[test]
fn images_are_seen_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (40u64, 30u64);
    let grid = Grid::image([width, height], SampleType::U8, Channel::of_picture(3));
    let samples: Vec<u8> = (0..width * height * 3).map(|i| (i * i % 251) as u8).collect();
    let path = folder.path().join("image.png");
    write_grid(&path, GridFormat::Png, &grid, &samples).unwrap();
    let mut session = FieldSession::open(&path, SessionOptions::default(), Arc::new(())).unwrap();
    let own = Shot { size: Some((width as u32, height as u32)), ..Shot::default() };
    let picture = session.draw(&own).unwrap();
    let image = picture.image(&own).unwrap();
    for (pixel, sample) in image.rgba.iter().zip(samples.chunks(3)) {
        assert!((0..3).all(|k| pixel[k].abs_diff(sample[k]) <= 1), "{pixel:?} {sample:?}");
    }
}

#[test]
fn slices_are_the_values_on_a_plane() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [20, 20, 20], |[x, y, z]| (10 * x + 2 * y) as f64 + 0.2 * z as f64);
    let mut own = shot("slice", "", above(DVec3::splat(9.5), 20.0), (20, 20));
    let grey = TransferFunction::preset("grey").unwrap();
    own.look.transfer = Some(TransferFunction { range: Range::Fixed(0.0, 255.0), ..grey });
    let found = pixels(&path, &own);
    for (x, y) in [(3usize, 4usize), (10, 10), (17, 12)] {
        // The first row of a picture is the highest y.
        let expected = (10 * x + 2 * (19 - y)) as f32 + 2.0;
        let light = crate::color::colors::to_linear(expected / 255.0);
        assert!((found[y * 20 + x][0] - light).abs() < 0.004, "{x} {y}: {} {light}", found[y * 20 + x][0]);
    }
    let turned = with(own, "normal", SettingValue::Numbers(vec![1.0, 0.0, 0.2]));
    assert!(pixels(&path, &turned).iter().any(|pixel| pixel[3] > 0.0));
}

#[test]
fn a_surface_is_where_its_value_is() {
    let folder = tempfile::tempdir().unwrap();
    let away = |at: [u64; 3]| (DVec3::from_array(at.map(|x| x as f64)) - DVec3::splat(23.5)).length();
    let path = volume(folder.path(), [48, 48, 48], |at| 200.0 - 8.0 * away(at));
    let own = shot("isosurface", "", above(DVec3::splat(23.5), 48.0), (96, 96));
    let own = with(own, "isovalues", SettingValue::Numbers(vec![120.0]));
    let covered = pixels(&path, &own).iter().filter(|pixel| pixel[3] > 0.5).count() as f64;
    // A ball of radius 10, two pixels a unit.
    let expected = std::f64::consts::PI * 20.0 * 20.0;
    assert!((covered / expected - 1.0).abs() < 0.03, "{covered} {expected}");
    let wrong = with(own, "isovalues", SettingValue::Numbers(vec![1e4]));
    let mut session = FieldSession::open(&path, SessionOptions::default(), Arc::new(())).unwrap();
    let why = session.draw(&wrong).map(drop).unwrap_err().to_string();
    assert!(why.contains("isovalues is 10000 (number 1), expected values from"), "{why}");
}

#[test]
fn what_is_cut_off_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [32, 32, 32], |_| 90.0);
    for mode in ["volume", "xray", "slice"] {
        let transfer = if mode == "xray" { "" } else { HAZE };
        let mut own = shot(mode, transfer, above(DVec3::splat(15.5), 32.0), (64, 64));
        let whole = pixels(&path, &own);
        let clip = ClipBox { min: DVec3::splat(-1.0), max: DVec3::new(15.5, 40.0, 40.0) };
        own.look.cut = Some(CutSettings { clip: Some(clip), ..CutSettings::default() });
        let half = pixels(&path, &own);
        let seen = |pixels: &[[f32; 4]], x: usize| pixels[32 * 64 + x][if mode == "xray" { 0 } else { 3 }];
        assert!(seen(&whole, 50) > 0.0 && seen(&half, 50) == 0.0, "{mode}");
        assert!((seen(&whole, 12) - seen(&half, 12)).abs() < 1e-3 * seen(&whole, 12), "{mode}");
    }
}

#[test]
fn what_does_not_fit_is_refused_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [8, 8, 8], |[x, ..]| x as f64);
    let mut session = FieldSession::open(&path, SessionOptions::default(), Arc::new(())).unwrap();
    let mut refusal = |shot: &Shot| -> String {
        let refused: Result<_, PictureError> = session.draw(shot).map(drop);
        refused.unwrap_err().to_string()
    };
    let camera = CameraConfig::default();
    assert!(refusal(&shot("points", "", camera, (8, 8))).contains("mode points does not draw a volume"));
    assert!(refusal(&shot("image", "", camera, (8, 8))).contains("expected one of volume, isosurface"));
    let mut many = shot("volume", "", camera, (8, 8));
    many.look.budget.0.insert("splats".into(), SettingValue::Number(10.0));
    assert!(refusal(&many).contains("deepfield build"));
}

#[test]
fn panoramas_are_line_integrals_in_all_directions() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [32, 32, 32], |_| 100.0);
    // From the middle of a cube of half a side of 16.
    let mut around = shot("xray", "", CameraConfig::default(), (64, 32));
    around.surround = Surround::Equirectangular;
    let found = pixels(&path, &around);
    let way = |x: f64, y: f64| {
        let (turn, rise) = (std::f64::consts::TAU * x / 64.0, std::f64::consts::PI * (0.5 - y / 32.0));
        let way = [rise.cos() * turn.cos(), rise.sin(), rise.cos() * turn.sin()];
        1600.0 / way.map(f64::abs).into_iter().fold(0.0, f64::max)
    };
    for y in 0..32 {
        // A pixel is the mean over what it covers.
        let mean = |x: usize| {
            let places =
                (0..64).map(|k| [x as f64 + (f64::from(k % 8) + 0.5) / 8.0, y as f64 + (f64::from(k / 8) + 0.5) / 8.0]);
            places.map(|[x, y]| way(x, y)).sum::<f64>() / 64.0
        };
        // Whichever quarter of a turn the row begins with, and whichever way round it goes.
        let mut expected: Vec<f64> = (0..64).map(mean).collect();
        let mut row: Vec<f64> = found[64 * y..64 * (y + 1)].iter().map(|pixel| f64::from(pixel[0])).collect();
        expected.sort_by(f64::total_cmp);
        row.sort_by(f64::total_cmp);
        for (found, expected) in row.iter().zip(&expected) {
            assert!((found / expected - 1.0).abs() < 0.01, "row {y}: {found} {expected}");
        }
    }
}

#[test]
fn each_eye_sees_what_its_own_camera_sees() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [24, 24, 24], |[x, y, z]| if x > 8 && y > 5 && z > 11 { 200.0 } else { 10.0 });
    let camera = CameraConfig {
        fov: Some(40.0),
        eye: Some([12.0, 12.0, 70.0]),
        target: Some([12.0; 3]),
        ..CameraConfig::default()
    };
    let mut pair = shot("volume", HAZE, camera, (40, 40));
    pair.stereo =
        Some(Stereo { kind: StereoKind::OffAxis, separation: 4.0, zero_parallax: 58.0, eyes: Eyes::SideBySide });
    let both = pixels(&path, &pair);
    assert_eq!(both.len(), 80 * 40);
    for (half, eyes) in [(0, Eyes::Left), (1, Eyes::Right)] {
        pair.stereo = pair.stereo.map(|stereo| Stereo { eyes, ..stereo });
        let alone = pixels(&path, &pair);
        assert!((0..40).all(|y| both[80 * y + 40 * half..][..40] == alone[40 * y..][..40]));
    }
    assert!(both[80 * 20..][..40] != both[80 * 20 + 40..][..40]);
}

#[test]
fn how_steep_values_are_colours_a_volume() {
    let folder = tempfile::tempdir().unwrap();
    // Steeper from left to right.
    let path = volume(folder.path(), [32, 20, 20], |[x, ..]| 0.2 * (x * x) as f64 + 20.0);
    let camera = above(DVec3::new(15.5, 9.5, 9.5), 20.0);
    let transfer = "(scale: linear, range: fixed(0.0, 255.0), opacity: [(0.0, 1.0), (1.0, 1.0)], brightness: [(0.0, 0.5), (1.0, 0.5)], \
                    hue: (scale: linear, range: fixed(0.0, 12.0), color_map: [(0.0, \"#0000ff\"), (1.0, \"#ff0000\")]))";
    let mut steep = shot("volume", transfer, camera, (64, 40));
    steep.look.attribute = Some(Attribute::Named(GRADIENT.into()));
    let found = pixels(&path, &steep);
    let [left, right] = [20 * 64 + 20, 20 * 64 + 44].map(|at| found[at]);
    assert!(left[2] > left[0] && right[0] > right[2], "{left:?} {right:?}");
    steep.look.attribute = Some(Attribute::Named("steepness".into()));
    let mut session = FieldSession::open(&path, SessionOptions::default(), Arc::new(())).unwrap();
    let why = session.draw(&steep).err().unwrap().to_string();
    assert!(why.contains("steepness") && why.contains(GRADIENT), "{why}");
}

#[test]
fn what_was_prepared_is_used_again_for_other_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [16, 16, 16], |[x, y, z]| (x * y + z) as f64);
    let mut session = FieldSession::open(&path, SessionOptions::default(), Arc::new(())).unwrap();
    let camera = above(DVec3::splat(7.5), 16.0);
    let first = session.prepare(&shot("volume", HAZE, camera, (8, 8))).unwrap();
    let other = session.prepare(&shot("volume", "", camera, (8, 8))).unwrap();
    assert!(Arc::ptr_eq(&first.field, &other.field));
    let mut colored = shot("volume", HAZE, camera, (8, 8));
    colored.look.attribute = Some(Attribute::Named(GRADIENT.into()));
    assert!(!Arc::ptr_eq(&first.field, &session.prepare(&colored).unwrap().field));
    let view = crate::view::View::look_at(
        DVec3::new(7.5, 7.5, 90.0),
        DVec3::splat(7.5),
        DVec3::Y,
        crate::view::Projection::Orthographic { height: 16.0 },
        8,
        8,
    );
    let look = shot("volume", HAZE, camera, (8, 8)).look;
    let image = session.image(&look, &view.unwrap(), None).unwrap();
    assert!(image.rgba.iter().any(|pixel| pixel[0] > 20));
}

#[test]
fn values_beyond_single_precision_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let notes = |beyond: usize| {
        let grid = Grid::volume([4, 4, 4], SampleType::F64, Channel::numbered(1));
        let value = |k: usize| if k < beyond { 1e43 } else { k as f64 };
        let samples: Vec<u8> = (0..64).flat_map(|k| value(k).to_ne_bytes()).collect();
        let path = folder.path().join("heavy.nrrd");
        write_grid(&path, GridFormat::Nrrd, &grid, &samples).unwrap();
        OpenField::open(&path, ReadMethod::default(), None).unwrap().notes()
    };
    assert!(notes(0).is_empty());
    let told = notes(3);
    assert!(
        told.len() == 1 && told[0].starts_with("3 of 64 values are infinite or beyond single precision"),
        "{told:?}"
    );
}

#[test]
fn what_is_too_large_is_thinned_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let value = |[x, y, z]: [u64; 3]| ((3 * x + 7 * y + 11 * z) % 251) as f64;
    let source = volume(folder.path(), [41, 70, 66], value);
    let built = folder.path().join("volume.df");
    let open = open_grid(&source, &GridOptions::default()).unwrap();
    build_grid(&open, &GridBuildOptions::default(), &built, &()).unwrap();
    let samples = 41 * 70 * 66;
    for path in [&source, &built] {
        let whole = OpenField::open(path, ReadMethod::default(), Some(10 * samples)).unwrap();
        assert!(whole.notes().is_empty() && whole.grid().shape == [41, 70, 66]);
        // A third along each axis is what a twentieth of the memory has room for.
        let thinned = OpenField::open(path, ReadMethod::default(), Some(samples / 2)).unwrap();
        assert_eq!((thinned.grid().shape, thinned.samples()), ([14, 24, 22], samples));
        assert!(thinned.notes()[0].contains("one of 3 samples") && !thinned.has_points());
        assert!(thinned.shown(Some(&Wanted::Points(9, Weighting::Rms)), &[0], false).is_err());
        let shown = thinned.shown(None, &[0], false).unwrap();
        let place = thinned.grid().to_world.transform_point3(DVec3::new(13.0, 23.0, 21.0));
        assert_eq!(place, whole.grid().to_world.transform_point3(DVec3::new(39.0, 69.0, 63.0)));
        for (i, found) in shown.field.channels[0].levels[0].values.iter().enumerate() {
            let at = [i % 14, i / 14 % 24, i / (14 * 24)].map(|index| 3 * index as u64);
            assert_eq!(f64::from(*found), value(at), "{at:?}");
        }
    }
}

#[test]
fn points_count_as_the_eye_sees_them() {
    let folder = tempfile::tempdir().unwrap();
    // Waves of two samples beside one of sixty.
    let value = |[x, y, _]: [u64; 3]| {
        120.0 + 50.0 * (y as f64 / 10.0).sin() + if x < 32 && x.is_multiple_of(2) { 30.0 } else { 0.0 }
    };
    let source = volume(folder.path(), [64, 64, 16], value);
    let built = folder.path().join("volume.df");
    let open = open_grid(&source, &GridOptions::default()).unwrap();
    build_grid(&open, &GridBuildOptions::default(), &built, &()).unwrap();
    let mut session = FieldSession::open(&built, SessionOptions::default(), Arc::new(())).unwrap();
    let mut report = |weighting: &str, pixels: f64| {
        // So many pixels a sample, without perspective.
        let camera = above(DVec3::new(31.5, 31.5, 7.5), 64.0 / pixels);
        let mut shot = with(shot("xray", "", camera, (64, 64)), "weighting", SettingValue::Name(weighting.into()));
        shot.look.budget.0.insert("splats".into(), SettingValue::Number(8000.0));
        session.prepare(&shot).unwrap().report
    };
    let rms = report("rms", 1.0);
    assert_eq!((rms.weighting, report("max", 1.0).weighting), (Some("rms"), Some("max")));
    assert!(report("max", 1.0).error_value.max <= rms.error_value.max);
    // From near both waves are seen; from afar the fine one is not, and no point is spent on it.
    let [near, far] = [8.0, 0.1].map(|pixels| report("perceptual", pixels));
    assert_eq!(near.weighting, Some("perceptual"));
    assert!(near.error_value.rms < 5.0 && far.error_value.rms > 9.0, "{near:?} {far:?}");
}

#[test]
fn a_sketch_fills_the_box_of_the_samples() {
    let folder = tempfile::tempdir().unwrap();
    let path = volume(folder.path(), [50, 40, 30], |[x, ..]| if x > 20 { 90.0 } else { 0.0 });
    let open = OpenField::open(&path, ReadMethod::default(), None).unwrap();
    let sketch = open.sketch(5000);
    let family = &sketch.families[0];
    assert!((500..=5000).contains(&family.len()), "{}", family.len());
    let bounds = family.bounds();
    assert_eq!((bounds.min, bounds.max), (DVec3::ZERO, DVec3::new(49.0, 39.0, 29.0)));
    let mass: f64 = family.mass.iter().map(|mass| f64::from(*mass)).sum();
    assert!((mass / (90.0 * 29.0 * 40.0 * 30.0) - 1.0).abs() < 0.15, "{mass}");
}
