//! One way to a picture: what a session draws of a shot is what a tour blends and what ranges are found for, in every mode, of pages
//! and of source particles.

use crate::support::{
    Random, Told, built_from_dataset, dataset_of, demo, gas, in_repository, write_box, write_demo_pages,
};
use deepfield::codec::VqBits;
use deepfield::cpu::Method;
use deepfield::hierarchy::Kinds;
use deepfield::look::{Attribute, Camera, Film, LookPatch, Member, SceneFile, Shot};
use deepfield::mode::{PathSettings, PathsOf, SettingValue};
use deepfield::model::{Family, FamilyName};
use deepfield::modes;
use deepfield::picture::level_report::{LevelReport, ROUNDING};
use deepfield::picture::ranges::Format;
use deepfield::picture::{Adapter, PictureError, Reporter, Session, SessionOptions};
use deepfield::view::Surround;
use std::path::Path;
use std::sync::Arc;

const SIZE: (u32, u32) = (90, 60);

/// A session on the demo data's pages.
fn session(folder: &Path) -> Session {
    session_with(folder, SessionOptions::default())
}

fn session_with(folder: &Path, options: SessionOptions) -> Session {
    let pages = folder.join("demo.df");
    let page_file = |_: &Path| -> Result<_, PictureError> {
        if !pages.exists() {
            write_demo_pages(&pages, Kinds::default());
        }
        Ok(pages.clone())
    };
    Session::open(&[Member::new(demo())], options, [&Shot::default()], page_file, Arc::new(())).unwrap()
}

fn shot(mode: &'static deepfield::mode::Mode, session: &mut Session) -> (Shot, Camera) {
    let look = LookPatch { mode: Some(mode), ..LookPatch::default() };
    let bounds = session.framed(&look).unwrap();
    let eye = bounds.center() + bounds.size() * 0.9;
    let camera =
        Camera { eye: eye.into(), target: bounds.center().into(), up: [0.0, 1.0, 0.0], fov: 45.0, ortho: None };
    let scene = SceneFile { look, size: Some(SIZE), camera: Some(camera), ..SceneFile::new(Vec::new()) };
    (Shot::of_scene(scene, Path::new("")), camera)
}

#[test]
fn every_mode_comes_to_the_same_picture_and_ranges_on_every_way() {
    const SIZE: (u32, u32) = (30, 20);
    // What usually are many comes to the same on every way where it is few, too.
    const FEW: [(&str, &str, f64); 2] = [("cartesian", "cells", 64.0), ("layered", "layers", 16.0)];
    let folder = tempfile::tempdir().unwrap();
    let (pages, source) = (write_box(folder.path()), folder.path().join("box.gadget2"));
    let of_pages: Vec<_> =
        modes::all().into_iter().filter(|mode| mode.takes_particles() && !mode.is_of_paths()).collect();
    // Light has no method of its own where it is drawn from the source: a volume and splats are all of it.
    let mut of_source = of_pages.clone();
    of_source.retain(|mode| !mode.is_light() || ["volume", "sorted-splats"].contains(&mode.name));
    for (exact, modes) in [(None, of_pages), (Some(Method::Pyramid), of_source)] {
        let options = SessionOptions { exact, ..SessionOptions::default() };
        let page_file = |_: &Path| -> Result<_, PictureError> { Ok(pages.clone()) };
        let member = [Member::new(&source)];
        let mut session = Session::open(&member, options, [&Shot::default()], page_file, Arc::new(())).unwrap();
        for mode in modes {
            let (mut shot, camera) = shot(mode, &mut session);
            shot.size = Some(SIZE);
            for (_, setting, number) in FEW.into_iter().filter(|(name, ..)| *name == mode.name) {
                shot.look.settings.0.insert(setting.into(), SettingValue::Number(number));
            }
            let picture = session.draw(&shot).unwrap();
            assert!(picture.converged && picture.size() == [SIZE.0, SIZE.1], "{}", mode.name);
            let image = picture.image(&shot).unwrap();
            assert!(image.rgba.iter().any(|pixel| pixel[..3] != image.rgba[0][..3]), "{}: one colour", mode.name);
            let diameter = session.framed(&shot.look).unwrap().size().length();
            let view = camera.view(SIZE.0, SIZE.1).unwrap();
            let (blended, _) = session.image(&shot.look, &view, None, diameter, u64::MAX).unwrap();
            assert!(blended == image, "{}", mode.name);
            let format = Format { size: SIZE, surround: Surround::Flat };
            let found = session.ranges(&shot.look, &camera, format).unwrap();
            assert_eq!(found.levels, picture.coloration().levels, "{}", mode.name);
        }
    }
}

#[test]
fn a_film_shows_the_picture_before_then_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = session(folder.path());
    let (before, camera) = shot(modes::find("points").unwrap(), &mut session);
    let (own, _) = shot(modes::find("volume").unwrap(), &mut session);
    let [before_image, own_image] =
        [&before, &own].map(|shot| session.draw(shot).and_then(|picture| picture.image(shot)).unwrap());
    assert!(before_image != own_image);
    for (share, expected) in [(0.0, &before_image), (1.0, &own_image)] {
        let from = SceneFile { look: before.look.clone(), camera: Some(camera), ..SceneFile::new(Vec::new()) };
        let film = Some(Film { from: Some(Box::new(from)), share, ..Film::default() });
        let shot = Shot { film, ..own.clone() };
        let picture = session.draw(&shot).unwrap();
        assert!(session.finished(&shot, &picture).unwrap() == *expected, "{share}");
    }
}

/// Each picture of a blend keeps to its own number of clusters, in every projection.
#[test]
fn a_film_between_clusters_shows_both() {
    let data = super::clusters::data();
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    for surround in [Surround::Flat, Surround::Equirectangular] {
        let mut clusters = |mode: &str, splats: f64| {
            let (mut shot, camera) = shot(modes::find(mode).unwrap(), &mut session);
            shot.look.budget.0.insert("levels".into(), SettingValue::Name("clusters".into()));
            shot.look.budget.0.insert("splats".into(), SettingValue::Number(splats));
            (Shot { surround, ..shot }, camera)
        };
        let ((before, camera), (own, _)) = (clusters("column-density", 300.0), clusters("volume", 3000.0));
        let mut drawn = |shot: &Shot| {
            let picture = session.draw(shot).unwrap();
            (picture.particles, picture.image(shot).unwrap())
        };
        let ((few, before_image), (many, own_image)) = (drawn(&before), drawn(&own));
        assert!(few <= 300 && (2500..=3000).contains(&many), "{surround:?}: {few} {many}");
        for (share, expected) in [(0.0, &before_image), (1.0, &own_image)] {
            let from = SceneFile { look: before.look.clone(), camera: Some(camera), ..SceneFile::new(Vec::new()) };
            let from = Some(Box::new(SceneFile { projection: surround, ..from }));
            let shot = Shot { film: Some(Film { from, share, ..Film::default() }), ..own.clone() };
            let picture = session.draw(&shot).unwrap();
            assert!(session.finished(&shot, &picture).unwrap() == *expected, "{surround:?} {share}");
        }
    }
}

/// A card that can do nothing.
struct Broken;

impl Adapter for Broken {
    fn is_card(&mut self) -> bool {
        true
    }
}

#[test]
fn the_processor_draws_and_counts_what_an_adapter_cannot() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("overdraw.png");
    let with_overdraw = || SessionOptions { overdraw: Some(path.clone()), ..SessionOptions::default() };
    let mut alone = session_with(folder.path(), with_overdraw());
    let (shot, _) = shot(modes::find("column-density").unwrap(), &mut alone);
    let expected = alone.draw(&shot).unwrap();
    let told = Arc::new(Told::default());
    let reporter: Arc<dyn Reporter> = told.clone();
    let broken = session_with(folder.path(), with_overdraw()).with_reporter(reporter);
    let picture = broken.with_adapter(Some(Box::new(Broken))).draw(&shot).unwrap();
    assert_eq!(
        *told.0.lock().unwrap(),
        [
            "the adapter does not count the splats of pixels; counting the overdraw with the CPU instead",
            "the adapter does not draw particles; drawing with the CPU instead"
        ]
    );
    assert!(picture.left_out.overdraw.is_some() && picture.left_out.overdraw == expected.left_out.overdraw);
    assert!(picture.image(&shot).unwrap() == expected.image(&shot).unwrap());
}

/// Gas of one temperature that lies about.
fn some_gas() -> Family {
    let mut random = Random(5);
    let mut family = gas();
    for _ in 0..500 {
        family.positions.push([(); 3].map(|()| random.next()));
        family.mass.push(1.0);
        family.smoothing_length.push(0.1);
        family.density.push(500.0);
        family.attributes[0].values.push(1e4);
    }
    family
}

#[test]
fn points_without_magnitudes_show_mass() {
    for (attribute, expected) in [("magnitude", ["Flux", ""]), ("temperature", ["Mass per pixel", "Msun"])] {
        let mut family = some_gas();
        family.attributes[0].name = attribute.into();
        family.attributes[0].values.fill(4.0);
        let built = built_from_dataset(dataset_of(family), VqBits::Eight);
        let mut session = Session::of(Arc::clone(&built.file), u64::MAX);
        let (shot, _) = shot(modes::find("points").unwrap(), &mut session);
        let shown = session.draw(&shot).unwrap().legend().unwrap().p;
        assert_eq!([shown.title, shown.unit], expected);
    }
}

#[test]
fn that_there_are_no_paths_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let told = Arc::new(Told::default());
    let reporter: Arc<dyn Reporter> = told.clone();
    let mut session = session(folder.path()).with_reporter(reporter);
    let of_paths = || told.0.lock().unwrap().iter().filter(|message| message.contains("paths")).count();
    let (alone, _) = shot(modes::find("paths").unwrap(), &mut session);
    let why = session.draw(&alone).err().unwrap().to_string();
    assert!(why.contains("mode paths: the data is no run: paths are left out") && of_paths() == 0, "{why}");
    let (plain, _) = shot(modes::find("column-density").unwrap(), &mut session);
    let paths = Some(PathSettings { of: Some(PathsOf::All), ..PathSettings::default() });
    let among = Shot { look: LookPatch { paths, ..plain.look.clone() }, ..plain };
    for _ in 0..2 {
        session.draw(&among).unwrap();
        assert_eq!(of_paths(), 1);
    }
}

/// Stars have no temperature: what is drawn as if they had that of gas is told, once, and only where it is drawn.
#[test]
fn families_without_the_attribute_are_told() {
    let family = some_gas();
    let stars = Family { name: FamilyName::Stars, attributes: Vec::new(), ..family.clone() };
    let mut dataset = dataset_of(family);
    dataset.families.push(stars);
    let built = built_from_dataset(dataset, VqBits::Eight);
    let told = Arc::new(Told::default());
    let reporter: Arc<dyn Reporter> = told.clone();
    let mut session = Session::of(Arc::clone(&built.file), u64::MAX).with_reporter(reporter);
    let (plain, _) = shot(modes::find("density-squared").unwrap(), &mut session);
    let attribute = Some(Attribute::Named("temperature".into()));
    let colored = Shot { look: LookPatch { attribute, ..plain.look.clone() }, ..plain.clone() };
    let families = Some(vec![FamilyName::Gas]);
    let of_gas = Shot { look: LookPatch { families, ..colored.look.clone() }, ..colored.clone() };
    for (shot, expected) in [(&plain, 0), (&of_gas, 0), (&colored, 1), (&colored, 1)] {
        session.draw(shot).unwrap();
        assert_eq!(told.0.lock().unwrap().len(), expected);
    }
    let told = told.0.lock().unwrap().concat();
    assert!(told.contains("attribute temperature: not in stars, which are coloured as its mean"), "{told}");
}

#[test]
fn what_does_not_fit_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = session(folder.path());
    let (shot, _) = shot(modes::find("column-density").unwrap(), &mut session);
    let family = |name: &str| FamilyName::parse(name).map(|name| vec![name]);
    let absent = Shot { look: LookPatch { families: family("stars"), ..shot.look.clone() }, ..shot.clone() };
    let why = session.draw(&absent).err().unwrap().to_string();
    assert!(why.contains("no particles of family stars") && why.contains("lcdm"), "{why}");
    let none = session.draw(&Shot { size: Some((0, 10)), ..shot });
    assert!(none.is_err());
    let missing = Session::open(
        &[Member::new(in_repository("none.hdf5"))],
        SessionOptions { exact: Some(Method::Pyramid), ..SessionOptions::default() },
        [&Shot::default()],
        |path| Ok(path.to_owned()),
        Arc::new(()),
    );
    assert!(missing.err().unwrap().to_string().contains("none.hdf5"));
}

#[test]
fn clusters_are_as_many_as_time_and_error_ask_for() {
    let folder = tempfile::tempdir().unwrap();
    write_demo_pages(&folder.path().join("demo.df"), Kinds::of_particles());
    let mut session = session(folder.path());
    let (shot, _) = shot(&modes::column_density::MODE, &mut session);
    let mut with = |name: &str, value: f64| {
        let mut shot = shot.clone();
        shot.look.budget.0.insert(name.into(), SettingValue::Number(value));
        session.draw(&shot).unwrap().level_report
    };
    // Whatever machine this is, one of these is too little time, and one is enough for everything.
    let [few, all] = [1e-3, 1e6].map(|milliseconds| with("frame-ms", milliseconds));
    assert!(few.levels == "clusters" && few.splats <= 1000 && few.splats > 500, "{few:?}");
    assert!(all.error_estimate == Some(ROUNDING) && all.splats > 50 * few.splats, "{all:?}");
    let [coarse, fine] = [0.2, 0.05].map(|error| with("error-picture", error));
    let estimate = |report: &LevelReport| report.error_estimate.unwrap();
    assert!(estimate(&coarse) <= 0.2 && estimate(&fine) <= 0.05 && coarse.splats < fine.splats, "{coarse:?} {fine:?}");
}
