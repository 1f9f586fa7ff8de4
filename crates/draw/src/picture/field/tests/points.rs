//! Pictures of the points themselves.

use super::*;
use crate::cpu::Method;
use crate::picture::Picture;

/// A file with points of what a source holds.
fn built(source: &Path) -> PathBuf {
    let path = source.with_extension("df");
    let open = open_grid(source, &GridOptions::default()).unwrap();
    build_grid(&open, &GridBuildOptions::default(), &path, &()).unwrap();
    path
}

fn drawn(path: &Path, shot: &Shot, exact: bool) -> Picture {
    let exact = exact.then(Method::default);
    let options = SessionOptions { exact, ..SessionOptions::default() };
    FieldSession::open(path, options, Arc::new(())).unwrap().draw(shot).unwrap()
}

fn light(picture: &Picture) -> &crate::mode::LightPicture {
    match &picture.values {
        Raw::Light(painted) => painted,
        Raw::Sums(..) => panic!("points are drawn in colours"),
    }
}

fn of_points(shot: &Shot, points: u64) -> Shot {
    let mut shot = shot.clone();
    shot.look.budget.0.insert("splats".into(), SettingValue::Number(points as f64));
    shot
}

/// Blobs of many sizes over nothing.
fn blobs(folder: &Path) -> (PathBuf, u64) {
    let shape = [48_u64, 44, 40];
    let blobs = [([14.0, 20.0, 17.0], 6.0, 180.0), ([33.0, 27.0, 25.0], 4.0, 240.0), ([30.0, 12.0, 10.0], 8.0, 120.0)];
    let value = |at: [u64; 3]| {
        let at = DVec3::from_array(at.map(|x| x as f64));
        let blob = |(center, radius, most): &([f64; 3], f64, f64)| {
            let away = at.distance(DVec3::from_array(*center));
            most / (1.0 + ((away - 1.5 * radius) / (0.15 * radius)).exp())
        };
        blobs.iter().map(blob).sum::<f64>()
    };
    (volume(folder, shape, value), shape.iter().product())
}

const GLASS: &str = "(scale: linear, range: fixed(0.0, 255.0), color_map: [(0.0, \"#000000\"), (1.0, \"#ffffff\")], \
                     opacity: [(0.0, 0.0), (0.1, 0.0), (0.3, 0.05), (1.0, 0.3)], brightness: [(0.0, 1.0), (1.0, 1.0)], \
                     unit_length: fixed(4.0))";

/// Mean opacity of a picture.
fn opacity(picture: &Picture) -> f64 {
    let rgba = &light(picture).colors.rgba;
    rgba.iter().map(|pixel| f64::from(pixel[3])).sum::<f64>() / rgba.len() as f64
}

#[test]
fn opacity_does_not_depend_on_the_number_of_points() {
    let folder = tempfile::tempdir().unwrap();
    let (source, samples) = blobs(folder.path());
    let file = built(&source);
    let middle = DVec3::new(23.5, 21.5, 19.5);
    for (eye, fov) in [(middle + DVec3::new(70.0, 40.0, 90.0), Some(35.0)), (middle + 100.0 * DVec3::Z, None)] {
        let ortho = if fov.is_none() { Some(60.0) } else { None };
        let camera =
            CameraConfig { eye: Some(eye.into()), target: Some(middle.into()), fov, ortho, ..CameraConfig::default() };
        let splats = shot("sorted-splats", GLASS, camera, (90, 90));
        let volume = opacity(&drawn(&file, &shot("volume", GLASS, camera, (90, 90)), true));
        let exact = opacity(&drawn(&file, &splats, true));
        // What is classified before it is mixed is as opaque as what is classified after, but for the edges.
        assert!(exact > 0.03 && (exact / volume - 1.0).abs() < 0.04, "{exact} {volume}");
        for (percent, tolerance) in [(64, 0.01), (16, 0.01), (4, 0.02), (1, 0.05)] {
            let picture = drawn(&file, &of_points(&splats, samples * percent / 100), false);
            let told = picture.points.unwrap();
            assert!(told.points > 0 && told.points <= samples * percent / 100);
            let found = opacity(&picture);
            assert!((found / exact - 1.0).abs() < tolerance, "{percent} %: {found} {exact}");
        }
    }
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn scans_are_as_opaque_from_few_points() {
    let data = PathBuf::from(std::env::var_os("DEEPFIELD_DATA").unwrap()).join("volumes");
    let folder = tempfile::tempdir().unwrap();
    // Of the scans the one in which few points show the least (docs/grids.md).
    let open = open_grid(&data.join("engine.nii.gz"), &GridOptions::default()).unwrap();
    let samples: u64 = open.grid().shape.iter().product();
    let file = folder.path().join("scan.df");
    build_grid(&open, &GridBuildOptions::default(), &file, &()).unwrap();
    let splats = shot("sorted-splats", "", CameraConfig::default(), (200, 200));
    let exact = opacity(&drawn(&file, &splats, true));
    let mut session = FieldSession::open(&file, SessionOptions::default(), Arc::new(())).unwrap();
    for percent in [16, 4, 1] {
        let picture = session.draw(&of_points(&splats, samples * percent / 100)).unwrap();
        let found = 100.0 * (opacity(&picture) / exact - 1.0);
        let [points, seen] = [picture.points.unwrap().points, light(&picture).report.particles];
        println!("{percent} %: {points} points, {seen} seen: {found:+.2} %");
        assert!(found.abs() < 5.0, "{percent} %: {found}");
    }
}

#[test]
fn a_block_of_samples_is_as_opaque_as_it_is_thick() {
    let folder = tempfile::tempdir().unwrap();
    let mut grid = Grid::volume([16, 16, 24], SampleType::U8, Channel::numbered(1));
    grid.to_world.matrix3 = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.5));
    let file = built(&stored(folder.path(), &grid, |_| 100.0));
    // 12 units of an opacity of 0.1 in two units.
    let haze = shot("sorted-splats", HAZE, above(DVec3::new(7.5, 7.5, 6.0), 8.0), (64, 64));
    let picture = drawn(&file, &haze, true);
    assert_eq!(picture.points.unwrap().points, 16 * 16 * 24);
    let rgba = &light(&picture).colors.rgba;
    let expected = 1.0 - 0.9f32.powi(6);
    let mean = rgba.iter().map(|pixel| pixel[3]).sum::<f32>() / rgba.len() as f32;
    assert!((mean - expected).abs() < 3e-3, "{mean} {expected}");
    assert!(rgba.iter().all(|pixel| (pixel[3] - expected).abs() < 0.05));
}

#[test]
fn every_point_has_an_outline() {
    let folder = tempfile::tempdir().unwrap();
    let everything = "(scale: linear, range: fixed(0.0, 255.0), opacity: [(0.0, 0.1), (1.0, 0.1)], \
                      brightness: [(0.0, 1.0), (1.0, 1.0)])";
    let (source, samples) = blobs(folder.path());
    let volume = built(&source);
    let grid = Grid::image([70, 50], SampleType::U8, Channel::numbered(1));
    let image = folder.path().join("image.nrrd");
    let bytes: Vec<u8> = (0..3500).map(|i| if i % 70 > i / 70 { 200 } else { (i % 70) as u8 }).collect();
    write_grid(&image, GridFormat::Nrrd, &grid, &bytes).unwrap();
    let image = built(&image);
    let of_volume = above(DVec3::new(23.5, 21.5, 19.5), 80.0);
    for color in ["level", "size", "misfit", "type"] {
        let color = SettingValue::Name(color.into());
        for points in [40, 700] {
            let own = with(shot("primitives", everything, of_volume, (80, 80)), "outline-color", color.clone());
            let picture = drawn(&volume, &of_points(&own, points), false);
            let told = picture.points.unwrap().points;
            assert!(told <= points && light(&picture).report.particles == told, "{told}");
            let own = with(shot("primitives", "", CameraConfig::default(), (70, 50)), "outline-color", color.clone());
            let picture = drawn(&image, &of_points(&own, points), false);
            let told = picture.points.unwrap().points;
            assert!(told <= points && light(&picture).report.particles == told, "{told}");
            assert!(light(&picture).colors.rgba.iter().any(|pixel| pixel[3] > 0.9 && pixel[0] > 0.01));
        }
    }
    // Where nothing is said, as many as can be told from each other.
    let own = shot("primitives", everything, of_volume, (80, 80));
    let told = drawn(&volume, &own, false).points.unwrap();
    assert!(told.points > 9000 && told.points <= 10_000 && told.weighting == Some("rms"), "{told:?}");
    let near = with(own.clone(), "error-value", SettingValue::Number(1.0));
    assert_eq!(drawn(&volume, &near, false).points.unwrap().weighting, None, "as near as asked");
    assert_eq!(drawn(&volume, &own, true).points.unwrap().points, samples);
    // Air has none: it is invisible by the usual colours.
    let own = shot("primitives", "", of_volume, (80, 80));
    let picture = drawn(&volume, &of_points(&own, samples / 10), false);
    let told = picture.points.unwrap().points;
    let seen = light(&picture).report.particles;
    assert!(seen > told / 20 && seen < told, "{seen} of {told}");
}

#[test]
fn colours_of_outlines_tell_levels_and_misfits() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&blobs(folder.path()).0);
    let camera = above(DVec3::new(23.5, 21.5, 19.5), 60.0);
    let range = |color: &str| {
        let own = shot("primitives", "", camera, (60, 60));
        let own = with(own, "outline-color", SettingValue::Name(color.into()));
        light(&drawn(&file, &of_points(&own, 3000), false)).levels.density
    };
    // 48 samples take six levels of nodes; samples are one step further from the root.
    let [coarse, fine] = range("level");
    assert!(coarse >= 1.0 && coarse < fine && fine <= 6.0, "{coarse} {fine}");
    let [least, most] = range("misfit");
    assert!(least >= 0.0 && most > 1.0 && most < 128.0, "{least} {most}");
    let [small, large] = range("size");
    assert!((0.15..0.35).contains(&small) && large > 1.0 && large < 10.0, "{small} {large}");
}

#[test]
fn an_image_of_points_is_as_opaque_as_its_colours_say() {
    let folder = tempfile::tempdir().unwrap();
    let grid = Grid::image([64, 64], SampleType::U8, Channel::numbered(1));
    let path = folder.path().join("image.nrrd");
    let bytes: Vec<u8> = (0..4096).map(|i| if i % 64 < 32 { 100 } else { 200 }).collect();
    write_grid(&path, GridFormat::Nrrd, &grid, &bytes).unwrap();
    let colors = "(scale: linear, range: fixed(0.0, 250.0), color_map: [(0.0, \"#000000\"), (1.0, \"#ffffff\")], \
                  opacity: [(0.0, 0.0), (1.0, 0.5)])";
    let own = shot("sorted-splats", colors, CameraConfig::default(), (128, 128));
    let picture = drawn(&built(&path), &own, true);
    let rgba = &light(&picture).colors.rgba;
    for (from, expected) in [(20, 0.2), (84, 0.4)] {
        let inner = (20..100).flat_map(|y| (from..from + 24).map(move |x| rgba[y * 128 + x][3]));
        let mean = inner.sum::<f32>() / (80.0 * 24.0);
        assert!((mean - expected).abs() < 0.01, "{mean} {expected}");
    }
}

#[test]
fn what_is_cut_off_has_no_points() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&volume(folder.path(), [32, 32, 32], |[x, y, z]| (90 + (x * 7 + y * 5 + z * 3) % 40) as f64));
    let mut own = shot("sorted-splats", HAZE, above(DVec3::splat(15.5), 32.0), (64, 64));
    let whole = light(&drawn(&file, &own, true)).colors.rgba.clone();
    let clip = ClipBox { min: DVec3::splat(-1.0), max: DVec3::new(15.5, 40.0, 40.0) };
    own.look.cut = Some(CutSettings { clip: Some(clip), ..CutSettings::default() });
    let half = light(&drawn(&file, &own, true)).colors.rgba.clone();
    assert!(whole[32 * 64 + 50][3] > 0.3 && half[32 * 64 + 50][3] == 0.0);
    assert!((whole[32 * 64 + 12][3] - half[32 * 64 + 12][3]).abs() < 1e-3);
}

#[test]
fn sources_have_no_points() {
    let folder = tempfile::tempdir().unwrap();
    let source = volume(folder.path(), [8, 8, 8], |[x, ..]| x as f64);
    let file = built(&source);
    let names = |path: &Path| -> Vec<&'static str> {
        OpenField::open(path, ReadMethod::default(), None).unwrap().modes().iter().map(|mode| mode.name).collect()
    };
    for mode in ["sorted-splats", "primitives"] {
        assert!(names(&file).contains(&mode) && !names(&source).contains(&mode));
    }
}
