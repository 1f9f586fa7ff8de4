//! Heights and what is among them, from files.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::annotate::Annotations;
use crate::build::{BuildOptions, build};
use crate::heights::build::HeightBuildOptions;
use crate::heights::{OpenHeights, is_heights};
use crate::look::{CameraConfig, HeightsSaid, say};
use crate::mode::Settings;
use crate::model::{Attribute as Field, Dataset, Family, FamilyName, Kernel, Provenance, ReadMethod};
use crate::picture::surface::fixtures::field;
use crate::synth::random::Random;
use crate::view::{Eyes, Stereo, StereoKind, Surround};
use glam::DVec3;

mod fields;
mod finding;
mod lighting;

/// Particles at these places, of these smoothing lengths and masses.
fn particles(folder: &Path, name: &str, of: &[(DVec3, f64, f64)], unit: &str, magnitude: Option<f32>) -> PathBuf {
    let column =
        |value: &dyn Fn(&(DVec3, f64, f64)) -> f64| -> Vec<f32> { of.iter().map(|own| value(own) as f32).collect() };
    let magnitudes = magnitude.map(|magnitude| Field {
        name: "magnitude".into(),
        unit: Unit::default(),
        values: vec![magnitude; of.len()],
    });
    let family = Family {
        name: FamilyName::Stars,
        positions: of.iter().map(|(place, ..)| place.to_array()).collect(),
        mass: column(&|(_, _, mass)| *mass),
        smoothing_length: column(&|(_, h, _)| *h),
        density: column(&|(_, h, mass)| mass / h.powi(3)),
        attributes: magnitudes.into_iter().collect(),
    };
    let dataset = Dataset {
        families: vec![family],
        length_unit: Unit::new(unit),
        mass_unit: Unit::new("kg"),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    };
    let path = folder.join(name);
    build(dataset, &BuildOptions::default(), &path, &()).unwrap();
    path
}

fn open(members: &[Member], unit: &str, options: SessionOptions) -> MixedSession {
    let said =
        HeightsSaid { xy_unit: Some(Unit::new(unit)), height_unit: Some(Unit::new("m")), ..HeightsSaid::default() };
    let mut members = members.to_vec();
    say(&mut members, &said);
    MixedSession::open(&members, options, [], |path| Ok(path.to_owned()), Arc::new(())).unwrap()
}

fn shot(mode: Option<&str>, settings: &str, eye: [f64; 3], ortho: Option<f64>) -> Shot {
    let look = LookPatch {
        mode: mode.map(|name| modes::find(name).unwrap()),
        settings: ron::from_str(settings).unwrap(),
        ..LookPatch::default()
    };
    // Straight down y has to be up.
    let up = if eye[0] == 0.0 && eye[1] == 0.0 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let camera = CameraConfig { eye: Some(eye), target: Some([0.0; 3]), up: Some(up), fov: None, ortho };
    Shot { look, camera, size: Some((160, 120)), ..Shot::default() }
}

/// A cloud through which the plane z = 0 goes, no particle of which it cuts.
fn cloud() -> Vec<(DVec3, f64, f64)> {
    let mut random = Random::new(11, 1);
    let mut of = Vec::new();
    while of.len() < 3000 {
        let place = DVec3::from_array(std::array::from_fn(|_| 2.0 * random.uniform() - 1.0));
        let h = 0.02 + 0.06 * random.uniform();
        if place.z.abs() > h + 0.02 {
            of.push((place, h, 1.0 + random.uniform()));
        }
    }
    of
}

/// The plane z = 0, which lies elsewhere and is smaller by itself, and particles whose lengths are in kilometres.
fn plane_in_a_cloud(folder: &Path, of: &[(DVec3, f64, f64)]) -> [Member; 2] {
    let plane = field(folder, "plane.asc", [41, 33], [5.0, 7.0], 1.0, |_, _| 0.0);
    let far: Vec<_> = of.iter().map(|(place, h, mass)| (*place / 1000.0, h / 1000.0, *mass)).collect();
    let cloud = particles(folder, "cloud.df", &far, "km", None);
    let offset = DVec3::new(-2.0 - 0.5, -1.6 - 0.7, 0.0);
    [Member { offset, scale: Some(0.1), ..Member::new(plane) }, Member::new(cloud)]
}

#[test]
fn light_on_the_eyes_side_of_a_plane_is_what_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let of = cloud();
    let mut session = open(&plane_in_a_cloud(folder.path(), &of), "m", SessionOptions::default());
    for (eye, above) in [([0.0, 0.0, 5.0], true), ([0.0, 0.0, -5.0], false)] {
        let shot = shot(Some("column-density"), "{}", eye, Some(3.0));
        let picture = session.draw(&shot).unwrap();
        let Raw::Sums(sums, _) = &picture.values else { panic!("sums") };
        let found = sums.sum() * (3.0_f64 / 120.0).powi(2);
        let expected: f64 = of.iter().filter(|(place, ..)| (place.z > 0.0) == above).map(|(.., mass)| mass).sum();
        assert!((found / expected - 1.0).abs() < 1e-3, "above {above}: {found}, not {expected}");
        assert!(picture.converged && picture.ground.is_some() && picture.told.is_none());
        let report = picture.surface.as_ref().unwrap().report;
        // 4 by 3.2 of 4 by 3.
        assert!((report.covered / (160.0 * 120.0) - 1.0).abs() < 1e-3, "{}", report.covered);
    }
}

#[test]
fn stars_in_parsecs_are_around_a_globe_whose_heights_have_no_unit() {
    let folder = tempfile::tempdir().unwrap();
    let globe = field(folder.path(), "globe.asc", [36, 18], [-175.0, -85.0], 10.0, |_, _| 0.0);
    // One behind the globe, and one to the right of it. Their densities are no 32-bit numbers in metres.
    let of = [(DVec3::new(-10.0, 0.0, 0.0), 1.0, 1.0), (DVec3::new(-10.0, 5.0, 0.0), 1.0, 1.0)];
    let stars = particles(folder.path(), "stars.df", &of, "pc", Some(0.0));
    let mut members = [Member::new(globe), Member::new(stars)];
    say(&mut members, &HeightsSaid { xy_unit: Some(Unit::new("deg")), ..HeightsSaid::default() });
    let options = SessionOptions::default();
    let mut session = MixedSession::open(&members, options, [], |path| Ok(path.to_owned()), Arc::new(())).unwrap();
    let picture = session.draw(&shot(Some("points"), "{}", [2e7, 0.0, 0.0], None)).unwrap();
    let Raw::Sums(sums, _) = &picture.values else { panic!("sums") };
    let columns: Vec<usize> = (0..160 * 120).filter(|at| sums.p[*at] > 0.0).map(|at| at % 160).collect();
    assert!(!columns.is_empty() && columns.iter().all(|column| *column > 120), "{columns:?}");
}

#[test]
fn names_without_heights_stand_on_a_field_among_others() {
    let folder = tempfile::tempdir().unwrap();
    let [plane, cloud] = plane_in_a_cloud(folder.path(), &cloud());
    let table = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        Some(path)
    };
    // In the plane's own coordinates, and where that is in the scene.
    let flat = table("flat.csv", "name,x,y\nPlace,29,25\n");
    let tall = table("tall.csv", "name,x,y,z\nPlace,0.4,0.2,0\n");
    for (members, mode) in [
        (vec![plane.clone(), cloud.clone()], "column-density"),
        (vec![plane.clone(), cloud], "surface"),
        (vec![plane.clone(), plane], "surface"),
    ] {
        let mut session = open(&members, "m", SessionOptions::default());
        let [without, flat, tall] = [None, flat.clone(), tall.clone()].map(|labels| {
            let mut own = Shot { labels, ..shot(Some(mode), "{}", [0.0, 0.0, 5.0], Some(3.0)) };
            own.look.annotations = Some(Annotations { labels: 4, ..Annotations::NONE });
            session.draw(&own).unwrap().image(&own).unwrap()
        });
        assert!(flat.rgba == tall.rgba && flat.rgba != without.rgba, "{mode}");
    }
}

#[test]
fn every_technique_hides_what_is_behind_and_shows_what_is_before() {
    let folder = tempfile::tempdir().unwrap();
    let plane =
        field(folder.path(), "plane.asc", [41, 41], [-2.0, -2.0], 0.1, |x, y| 0.02 * (9.0 * x).sin() * (7.0 * y).cos());
    let of: Vec<_> = cloud().into_iter().filter(|(place, ..)| place.z > 0.2).collect();
    let cloud = particles(folder.path(), "cloud.df", &of, "m", None);
    let members = [Member::new(&plane), Member::new(cloud)];
    let mut alone = SurfaceSession::open(
        &plane,
        &HeightsSaid { xy_unit: Some(Unit::new("m")), height_unit: Some(Unit::new("m")), ..HeightsSaid::default() },
        SessionOptions::default(),
        Arc::new(()),
    )
    .unwrap();
    let mut session = open(&members, "m", SessionOptions::default());
    for (mode, settings) in [
        ("column-density", "{}"),
        ("points", "{}"),
        ("volume", "{}"),
        ("isosurface", "{}"),
        ("layered", "{}"),
        ("sorted-splats", "{}"),
        ("spheres", "{}"),
    ] {
        for eye in [[0.4, -0.5, -4.0], [0.4, -0.5, 4.0]] {
            let mut own = shot(None, settings, eye, None);
            own.camera.fov = Some(25.0);
            let plain = alone.draw(&own).unwrap();
            let plain = plain.image(&own).unwrap();
            own.look.mode = modes::find(mode);
            let picture = session.draw(&own).unwrap_or_else(|error| panic!("{mode}: {error}"));
            let image = picture.image(&own).unwrap();
            let differs = |a: &[u8; 4], b: &[u8; 4]| (0..3).any(|k| a[k].abs_diff(b[k]) > 1);
            let changed = image.rgba.iter().zip(&plain.rgba).filter(|(a, b)| differs(a, b)).count();
            match eye[2] > 0.0 {
                true => assert!(changed > 1000, "{mode}: {changed} pixels show the particles"),
                false => assert_eq!(changed, 0, "{mode}: pixels show particles behind the plane"),
            }
        }
    }
    let refused = session.draw(&shot(Some("cartesian"), "{}", [0.0, 0.0, 4.0], None)).err().unwrap().to_string();
    assert!(refused.contains("found cartesian") && refused.contains("volume"), "{refused}");
}

#[test]
fn a_star_behind_a_globe_shows_nowhere_and_one_before_it_does() {
    const RADIUS: f64 = 1_737_400.0;
    let folder = tempfile::tempdir().unwrap();
    let globe = field(folder.path(), "globe.asc", [37, 19], [-180.0, -90.0], 10.0, |x, y| {
        3000.0 * (3.0 * x).to_radians().sin() * y.to_radians().cos().powi(2)
    });
    let eye = DVec3::new(-4.0, 0.0, 1.5) * RADIUS;
    let mut plain = shot(None, "{\"map\": \"globe:moon\"}", eye.to_array(), None);
    plain.size = Some((120, 80));
    let mut alone =
        open(&[Member { offset: DVec3::X * 1e-9, ..Member::new(&globe) }], "deg", SessionOptions::default());
    let expected = alone.draw(&plain).unwrap().image(&plain).unwrap();
    for (share, is_seen) in [(-0.5, false), (0.6, true)] {
        let star = particles(folder.path(), &format!("star{share}.df"), &[(share * eye, 1.0, 1.0)], "m", Some(-1.0));
        let mut session = open(&[Member::new(&globe), Member::new(star)], "deg", SessionOptions::default());
        let picture = session.draw(&plain).unwrap();
        assert!(picture.told.is_some() && picture.annotation.depiction.mode.name == "surface");
        let image = picture.image(&plain).unwrap();
        let differs = |a: &[u8; 4], b: &[u8; 4]| (0..3).any(|k| a[k].abs_diff(b[k]) > 1);
        let changed = image.rgba.iter().zip(&expected.rgba).filter(|(a, b)| differs(a, b)).count();
        assert!(if is_seen { (5..60).contains(&changed) } else { changed == 0 }, "{share}: {changed} pixels");
        // In all directions from between the star and the globe, the star is behind the eye.
        let mut around = shot(None, "{\"map\": \"globe:moon\"}", (0.5 * eye).to_array(), None);
        (around.surround, around.size) = (Surround::Equirectangular, Some((128, 64)));
        let picture = session.draw(&around).unwrap();
        let Raw::Sums(sums, _) = &picture.values else { panic!("sums") };
        assert_eq!(sums.sum() > 0.0, is_seen, "{share}: around the eye");
        assert!(picture.ground.as_ref().unwrap().rgba.iter().any(|color| color[3] > 0.9));
    }
}

#[test]
fn fields_that_cross_are_their_upper_envelope_from_above() {
    let folder = tempfile::tempdir().unwrap();
    let rise = field(folder.path(), "rise.asc", [61, 61], [-3.0, -3.0], 0.1, |x, y| 0.5 * x + 0.1 * y);
    // Of another lattice, and of half the size by itself.
    let fall = field(folder.path(), "fall.asc", [48, 50], [-1.0, -1.0], 0.09, |x, _| -0.5 * x);
    let members =
        [Member::new(rise), Member { offset: DVec3::new(-2.0, -2.0, 0.25), scale: Some(2.0), ..Member::new(fall) }];
    let mut session = open(&members, "m", SessionOptions { raw: true, ..SessionOptions::default() });
    let shot = shot(None, "{\"technique\": \"triangles\"}", [0.0, 0.0, 6.0], Some(3.0));
    let picture = session.draw(&shot).unwrap();
    assert!(picture.is_of_heights_alone() && picture.converged);
    let channels = picture.surface.as_ref().unwrap().channels.as_ref().unwrap();
    let height = |x: f64, y: f64| {
        let other = 0.25 + 2.0 * (-0.5 * (x + 2.0) / 2.0);
        (0.5 * x + 0.1 * y).max(other)
    };
    let mut sides = [0, 0];
    for (index, own) in channels.values.iter().enumerate() {
        let pixel = 3.0 / 120.0;
        let (x, y) = (((index % 160) as f64 + 0.5 - 80.0) * pixel, (60.0 - (index / 160) as f64 - 0.5) * pixel);
        assert!((6.0 - own[0] - height(x, y)).abs() < 1e-5, "{x} {y}: {own:?}");
        sides[usize::from(0.5 * x + 0.1 * y < height(x, y))] += 1;
    }
    assert!(sides.iter().all(|count| *count > 2000), "{sides:?}");
    // Two eyes and all directions see both.
    let mut pair = self::shot(None, "{}", [0.5, -4.0, 3.0], None);
    pair.stereo =
        Some(Stereo { kind: StereoKind::OffAxis, separation: 0.1, zero_parallax: 4.0, eyes: Eyes::default() });
    session.is_raw = false;
    let [width, height] = session.draw(&pair).unwrap().size();
    assert_eq!([width, height], [320, 120]);
}

#[test]
fn settings_are_those_of_both_modes_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let members = plane_in_a_cloud(folder.path(), &cloud()[..50]);
    let mut session = open(&members, "m", SessionOptions::default());
    let both = "{\"exaggeration\": 2.0, \"radius\": 4.0}";
    assert!(session.draw(&shot(Some("points"), both, [0.0, 0.0, 5.0], None)).is_ok());
    let refused = session.draw(&shot(Some("points"), "{\"radios\": 4.0}", [0.0, 0.0, 5.0], None)).err().unwrap();
    assert!(refused.to_string().contains("points has no setting radios"), "{refused}");
    // What lies first says which way is up, and how large a length is.
    assert!(session.begins_with_heights());
    let framed = session.framed(&LookPatch::default()).unwrap();
    assert!(
        (framed.size() - DVec3::new(4.0, 3.2, 0.0)).length() < 1e-9 && framed.center().length() < 1e-9,
        "{framed:?}"
    );
    let [plane, cloud] = members;
    let mut session = open(&[cloud, Member { scale: None, ..plane }], "m", SessionOptions::default());
    assert!(!session.begins_with_heights());
    let looks = session.looks(&LookPatch::default()).unwrap();
    let ready = session.prepare(&looks).unwrap();
    assert_eq!(session.placements(&ready).heights[0].scale, 1e-3);
    assert!(session.framed(&LookPatch::default()).unwrap().size().length() < 0.01);
}

/// The page file of heights that a user names, with what he says of them; particles are built.
fn built(folder: &Path) -> impl FnMut(&Path, &HeightsSaid) -> Result<PathBuf, PictureError> {
    move |path, said| {
        if !is_heights(path) {
            return Ok(path.to_owned());
        }
        let out = folder.join(path.file_name().unwrap()).with_extension("df");
        let heights = OpenHeights::open(path, &said.options(ReadMethod::default())).unwrap();
        heights.build(&HeightBuildOptions::default(), &out, &()).unwrap();
        Ok(out)
    }
}

#[test]
fn sessions_of_what_is_open_draw_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut members = plane_in_a_cloud(folder, &cloud());
    let metres =
        HeightsSaid { xy_unit: Some(Unit::new("m")), height_unit: Some(Unit::new("m")), ..HeightsSaid::default() };
    say(&mut members, &metres);
    let (read, memory) = ((ReadMethod::default(), None), [1 << 30, 1 << 28]);
    let (opened, notes) = OpenMixed::open(&members, read, memory, &Settings::default(), built(folder)).unwrap();
    assert!(notes.is_empty() && opened.begins_with_heights() && opened.heights().len() == 1, "{notes:?}");
    let reporter: Arc<dyn Reporter> = Arc::new(());
    let (mut one, mut other) = (opened.session(&reporter), open(&members, "m", SessionOptions::default()));
    assert_eq!(one.particles().unwrap().residency().budget_bytes, memory[1]);
    for mode in [None, Some("column-density"), Some("points"), Some("volume")] {
        let shot = shot(mode, "{}", [2.0, -4.0, 3.0], None);
        let view = other.draw(&shot).unwrap().annotation.view;
        let (image, taken) = other.image(&shot.look, &view, None, 4.0, u64::MAX).unwrap();
        let seen = one.seen(&shot.look, &view, None, (4.0, u64::MAX)).unwrap();
        assert!(seen.image == image && seen.particles.taken == taken && taken > 0, "{mode:?}");
        assert!(seen.heights.is_converged && seen.heights.samples_drawn > 0 && seen.error.is_none());
        assert_eq!((seen.colored.is_some(), seen.particles.sums.is_some()), (mode.is_none(), mode != Some("volume")));
        assert!(seen.levels.is_some(), "{mode:?}");
    }
    // From above and in front, with z up, as pictures whose camera nobody has placed.
    let (view, target) = opened.home(&Settings::default(), 45.0, (160, 120)).unwrap().unwrap();
    let bare = Shot { size: Some((160, 120)), ..Shot::default() };
    let same = other.draw(&bare).unwrap().annotation.view;
    assert!((view.eye - same.eye).length() < 1e-9 && view.eye.z > 1.0 && target.length() < 1e-9, "{view:?} {same:?}");
    assert_eq!(opened.bounds(&Settings::default()).unwrap(), other.framed(&LookPatch::default()).unwrap());
    // What is drawn, and what is asked: the first field lies elsewhere.
    let draws = |name: &str| opened.is_drawn_by(modes::find(name).unwrap());
    assert!(draws("surface") && draws("points") && draws("volume") && !draws("cartesian"));
    assert!(opened.asked().is_none() && opened.told_by(&surface::MODE).is_some());
    assert_eq!((opened.of_particles(&["plane", "cloud"]), opened.usual_mode().name), (vec!["cloud"], "surface"));
    // What is said of a file that was built is refused, and particles that come first have the world.
    let [plane, cloud] = members;
    let page_file = plane.path.with_extension("df");
    let again = [Member::new(&page_file), cloud.clone()];
    let (first, _) = OpenMixed::open(&again, read, memory, &Settings::default(), built(folder)).unwrap();
    assert!(first.asked().is_some());
    let mut wrong = again.clone();
    say(&mut wrong, &HeightsSaid { nodata: Some(0.0), ..HeightsSaid::default() });
    let refused = OpenMixed::open(&wrong, read, memory, &Settings::default(), built(folder)).err().unwrap();
    assert!(refused.to_string().contains("--nodata: found a page file"), "{refused}");
    let last = [cloud, Member { scale: None, ..plane }];
    let (last, _) = OpenMixed::open(&last, read, memory, &Settings::default(), built(folder)).unwrap();
    assert!(!last.begins_with_heights() && last.asked().is_none());
    assert_eq!((last.usual_mode().name, last.heights()[0].index), ("column-density", 1));
    assert!(last.home(&Settings::default(), 45.0, (160, 120)).unwrap().is_none());
}
