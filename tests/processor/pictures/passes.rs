//! Pictures of more pages than there is memory for: sums are drawn in passes and volumes in slabs, and are what they are with all pages at once;
//! what is held keeps to its budget, but for a root where that is tiny. All else is drawn coarser, and told.

use crate::support::Told;
use deepfield::build::{self, BuildOptions};
use deepfield::color::Accumulation;
use deepfield::color::transfer::{Range, TransferFunction};
use deepfield::cpu::volume::VolumeError;
use deepfield::hierarchy::{Kinds, OctreeOptions};
use deepfield::look::{Attribute, Backend, Camera, LookPatch, Member, SceneFile, Shot};
use deepfield::mode::{Raw, SettingValue};
use deepfield::modes;
use deepfield::picture::adapter::AdapterValues;
use deepfield::picture::ranges::Format;
use deepfield::picture::{
    Adapter, AdapterFrame, AdapterJob, Picture, PictureError, Reporter, Session, SessionOptions, Subject,
};
use deepfield::store::{PageFile, PageId};
use deepfield::stream::Scene;
use deepfield::synth::{dataset, merger::Merger};
use deepfield::view::cut::ClipBox;
use deepfield::view::{CutSettings, Surround, View};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// What pages may take, less than all of a file's.
const BUDGETS: [u64; 2] = [384 << 10, 1 << 20];
const SIZE: (u32, u32) = (150, 100);

struct Data {
    path: PathBuf,
    _folder: tempfile::TempDir,
}

/// A page file of many small pages.
fn data(particles: u64, hierarchies: Kinds) -> Data {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("merger.df");
    let octree = OctreeOptions { leaf_capacity: 3000, ..OctreeOptions::default() };
    let options = BuildOptions { octree, hierarchies, page_bytes: 32 << 10, ..BuildOptions::default() };
    build::build(dataset(&Merger::new(3, particles)), &options, &path, &()).unwrap();
    Data { path, _folder: folder }
}

impl Told {
    /// Nothing was told but that less memory was given than a picture takes.
    fn is_of_memory_alone(&self) {
        let told = self.0.lock().unwrap();
        assert!(told.iter().all(|message| message.contains("a picture of this size takes")), "{told:?}");
    }
}

impl Data {
    /// Pages may take the half of `memory`.
    fn session(&self, memory: Option<u64>, told: &Arc<Told>) -> Session {
        self.open(SessionOptions { page_memory: memory, ..SessionOptions::default() }, told)
    }

    fn open(&self, options: SessionOptions, told: &Arc<Told>) -> Session {
        let told: Arc<dyn Reporter> = told.clone();
        let page_file = |path: &Path| -> Result<_, PictureError> { Ok(path.to_owned()) };
        Session::open(&[Member::new(&self.path)], options, [&Shot::default()], page_file, told).unwrap()
    }

    /// Memory of all pages.
    fn bytes(&self) -> u64 {
        let file = PageFile::open(&self.path).unwrap();
        (0..file.page_count()).map(|page| file.page_memory(PageId(page))).sum()
    }
}

/// Nearly everything, from outside; in panoramas from within.
fn shot(mode: &str, surround: Surround, session: &mut Session) -> (Shot, Camera) {
    let look = LookPatch { mode: modes::find(mode), error_px: Some(0.02), ..LookPatch::default() };
    let bounds = session.framed(&look).unwrap();
    let away = if surround.is_flat() { 0.6 } else { 0.1 };
    let eye = (bounds.center() + bounds.size() * away).into();
    let camera = Camera { eye, target: bounds.center().into(), up: [0.0, 1.0, 0.0], fov: 45.0, ortho: None };
    let scene = SceneFile { look, size: Some(SIZE), camera: Some(camera), ..SceneFile::new(Vec::new()) };
    (Shot { surround, ..Shot::of_scene(scene, Path::new("")) }, camera)
}

fn sums(picture: &Picture) -> &Accumulation {
    let Raw::Sums(sums, _) = &picture.values else { panic!("colours") };
    sums
}

fn bits(sums: &Accumulation) -> Vec<u32> {
    sums.p.iter().chain(&sums.ps).map(|value| value.to_bits()).collect()
}

/// A session in little memory draws what one draws that has as much as it needs, and keeps to its memory.
fn is_the_same(data: &Data, change: &dyn Fn(&mut Shot), (mode, surround): (&str, Surround)) {
    let told = Arc::default();
    let mut whole = data.session(None, &told);
    let (mut shot, camera) = shot(mode, surround, &mut whole);
    change(&mut shot);
    let expected = whole.draw(&shot).unwrap();
    let format = Format { size: SIZE, surround };
    let levels = whole.ranges(&shot.look, &camera, format).unwrap().levels;
    assert!(expected.converged, "{mode}, {surround:?}");
    for budget in BUDGETS {
        let mut session = data.session(Some(2 * budget), &told);
        let picture = session.draw(&shot).unwrap();
        let about = format!("{mode}, {surround:?}, {budget}: {} nodes of {}", picture.nodes, expected.nodes);
        assert!(picture.converged && bits(sums(&picture)) == bits(sums(&expected)), "{about}");
        assert!(picture.image(&shot).unwrap() == expected.image(&shot).unwrap(), "{about}");
        assert_eq!(
            (picture.nodes, picture.particles, picture.error_px),
            (expected.nodes, expected.particles, expected.error_px),
            "{about}"
        );
        assert_eq!(picture.level_report.splats, expected.level_report.splats, "{about}");
        let counts = |picture: &Picture| {
            let left_out = &picture.left_out;
            (left_out.splats, left_out.outside, left_out.faint, left_out.thinned)
        };
        assert_eq!(counts(&picture), counts(&expected), "{about}");
        assert_eq!(session.ranges(&shot.look, &camera, format).unwrap().levels, levels, "{about}");
        let held = session.residency();
        // A root is read whatever the budget: in the smallest one it may come on top of what is being listed of another tree.
        let most = if budget == BUDGETS[0] { budget + budget / 16 } else { budget };
        assert!(held.most_bytes <= most && held.budget_bytes == budget, "{about}: {held:?}");
    }
    told.is_of_memory_alone();
}

/// A volume of which some pages at a time are there is the one of all pages at once, but for what slabs of another thickness round.
fn is_the_same_volume(data: &Data, change: &dyn Fn(&mut Shot), mode: &str) {
    let told = Arc::default();
    let mut whole = data.session(None, &told);
    let (mut shot, camera) = shot(mode, Surround::Flat, &mut whole);
    shot.size = Some((90, 60));
    change(&mut shot);
    let expected = whole.draw(&shot).unwrap();
    let format = Format { size: SIZE, surround: Surround::Flat };
    let levels = whole.ranges(&shot.look, &camera, format).unwrap().levels;
    let mut session = data.session(Some(2 * BUDGETS[0]), &told);
    let picture = session.draw(&shot).unwrap();
    assert!(expected.converged && picture.converged && !session.lacks_memory(), "{mode}");
    let (Raw::Light(all), Raw::Light(some)) = (&expected.values, &picture.values) else { panic!("{mode}: sums") };
    let about = format!("{mode}: {:?}, of all pages {:?}", some.report, all.report);
    let pairs = || some.colors.rgba.as_flattened().iter().zip(all.colors.rgba.as_flattened());
    let brightest = pairs().fold(0.0_f32, |most, (_, all)| most.max(*all));
    assert!(brightest > 0.01 && pairs().all(|(some, all)| (some - all).abs() <= 1e-6), "{about}");
    assert!(some.report.slabs > 1 && all.report.slabs == 1, "{about}");
    assert_eq!((some.report.grid, some.report.planes), (all.report.grid, all.report.planes), "{about}");
    assert_eq!((some.levels, &some.isovalues), (all.levels, &all.isovalues), "{about}");
    let counts = |picture: &Picture| (picture.nodes, picture.particles, picture.left_out.thinned);
    assert!(counts(&picture) == counts(&expected) && picture.error_px <= expected.error_px, "{about}");
    assert_eq!(session.ranges(&shot.look, &camera, format).unwrap().levels, levels, "{about}");
    let held = session.residency();
    assert!(held.most_bytes <= held.budget_bytes && held.budget_bytes == BUDGETS[0], "{about}: {held:?}");
    told.is_of_memory_alone();
    // Where pages have room and thick slabs have none.
    if shot.look.settings.0.contains_key("field") {
        let mut session = data.session(Some(64 << 20), &told);
        let picture = session.draw(&shot).unwrap();
        let Raw::Light(some) = &picture.values else { panic!("{mode}: sums") };
        let mut pairs = some.colors.rgba.as_flattened().iter().zip(all.colors.rgba.as_flattened());
        assert!(session.residency().budget_bytes > data.bytes() && some.report.slabs > 1, "{:?}", some.report);
        assert!(pairs.all(|(some, all)| (some - all).abs() <= 1e-6), "{:?}", some.report);
    }
}

#[test]
fn volumes_are_the_same_in_however_little_memory() {
    let plain = data(60_000, Kinds::default());
    let clusters = data(60_000, Kinds::of_particles());
    assert!(plain.bytes() > BUDGETS[0] && clusters.bytes() > BUDGETS[0]);
    let colored = |shot: &mut Shot| shot.look.attribute = Some(Attribute::Named("internal-energy".into()));
    is_the_same_volume(&plain, &colored, "volume");
    // Three columns at once: values, densities and what colours both.
    let of_fields = |shot: &mut Shot| {
        colored(shot);
        shot.look.settings.0.insert("field".into(), SettingValue::Name("internal-energy".into()));
    };
    is_the_same_volume(&plain, &of_fields, "volume-isosurface");
    // What is cut off is known when particles are looked at.
    let cut = |shot: &mut Shot| {
        let target = DVec3::from(shot.camera.target.unwrap());
        let half = 0.5 * (DVec3::from(shot.camera.eye.unwrap()) - target).abs();
        let clip = Some(ClipBox { min: target - half, max: target + 2.0 * half });
        shot.look.cut = Some(CutSettings { clip, ..CutSettings::default() });
    };
    is_the_same_volume(&plain, &cut, "volume-isosurface");
    let of_clusters = |shot: &mut Shot| {
        shot.look.budget.0.insert("levels".into(), SettingValue::Name("clusters".into()));
        shot.look.budget.0.insert("splats".into(), SettingValue::Number(20_000.0));
    };
    is_the_same_volume(&clusters, &of_clusters, "isosurface");
}

#[test]
fn sums_have_the_same_bits_in_however_little_memory() {
    let data = data(150_000, Kinds::default());
    assert!(data.bytes() > 3 * BUDGETS[0] && data.bytes() > BUDGETS[1], "{} bytes", data.bytes());
    for pictures in
        [("column-density", Surround::Flat), ("points", Surround::Flat), ("column-density", Surround::Equirectangular)]
    {
        is_the_same(&data, &|_| {}, pictures);
    }
    // What is left out depends on the whole picture.
    let economic = |shot: &mut Shot| {
        for (name, value) in [("presence", 50.0), ("thinning", 2.0)] {
            shot.look.budget.0.insert(name.into(), SettingValue::Number(value));
        }
    };
    is_the_same(&data, &economic, ("column-density", Surround::Flat));
}

#[test]
fn clusters_have_the_same_bits_in_however_little_memory() {
    let data = data(100_000, Kinds::of_particles());
    assert!(data.bytes() > BUDGETS[1], "{} bytes", data.bytes());
    let clusters = |shot: &mut Shot| {
        shot.look.budget.0.insert("levels".into(), SettingValue::Name("clusters".into()));
        shot.look.budget.0.insert("splats".into(), SettingValue::Number(20_000.0));
    };
    is_the_same(&data, &clusters, ("column-density", Surround::Flat));
}

#[test]
fn what_needs_everything_at_once_is_drawn_coarser_and_told() {
    let data = data(150_000, Kinds::default());
    let told = Arc::default();
    let mut session = data.session(Some(2 * BUDGETS[0]), &told);
    let (mut shot, _) = shot("sorted-splats", Surround::Flat, &mut session);
    let picture = session.draw(&shot).unwrap();
    assert!(!picture.converged && picture.is_coarser && session.lacks_memory());
    let messages = told.0.lock().unwrap().clone();
    let [size, coarser] = &messages[..] else { panic!("{messages:?}") };
    assert!(size.contains("merger.df: a picture of this size takes") && size.contains("--memory"), "{size}");
    assert!(coarser.contains("merger.df: ") && coarser.contains("into the 0.4 MiB"), "{coarser}");
    let held = session.residency();
    assert!(held.most_bytes <= held.budget_bytes, "{held:?}");
    // With enough nothing is told.
    let mut session = data.session(Some(1 << 30), &told);
    assert!(session.draw(&shot).unwrap().converged && !session.lacks_memory());
    // Pages have less where all that they hold is decoded for it, whatever was drawn before.
    let shares = ["column-density", "sorted-splats", "column-density", "sorted-splats"].map(|mode| {
        shot.look.mode = modes::find(mode);
        assert!(session.draw(&shot).unwrap().converged, "{mode}");
        session.residency().budget_bytes
    });
    assert!(shares[0] == shares[2] && shares[1] == shares[3] && 8 * shares[1] < shares[0], "{shares:?}");
    assert_eq!(told.0.lock().unwrap().len(), 2);
}

/// How coarse a picture is depends on the memory alone: not on what was drawn before and is still there, nor on threads, nor on what pictures before it
/// hide.
#[test]
fn what_is_drawn_coarser_is_the_same_whatever_was_drawn_before() {
    let data = data(150_000, Kinds::default());
    let drawn = |picture: &Picture| {
        let Raw::Light(light) = &picture.values else { panic!("sums") };
        let bits: Vec<u32> = light.colors.rgba.as_flattened().iter().map(|channel| channel.to_bits()).collect();
        (bits, picture.nodes, picture.particles, picture.error_px, picture.is_coarser)
    };
    for (mode, range) in
        [("sorted-splats", Range::Auto), ("sorted-splats", Range::Fixed(1.0, 1e6)), ("layered", Range::Auto)]
    {
        let mut whole = data.session(None, &Arc::default());
        let (mut shot, _) = shot(mode, Surround::Flat, &mut whole);
        shot.look.transfer = Some(TransferFunction { range, ..TransferFunction::of_volumes(false) });
        // Fewer layers than usual are as coarse.
        if mode == "layered" {
            shot.look.settings.0.insert("layers".into(), SettingValue::Number(16.0));
        }
        let all = whole.draw(&shot).unwrap();
        assert!(all.converged && !all.is_coarser, "{mode}");
        let mut finer = (0, f64::INFINITY);
        for budget in BUDGETS {
            let alone = data.session(Some(2 * budget), &Arc::default()).draw(&shot).unwrap();
            let about = format!("{mode}, {range:?}, {budget}: {} nodes of {}", alone.nodes, all.nodes);
            assert!(!alone.converged && alone.is_coarser || budget > BUDGETS[0], "{about}");
            assert!(alone.nodes > finer.0 && alone.error_px <= finer.1, "{about}");
            assert!(alone.nodes < all.nodes && alone.error_px >= all.error_px || !alone.is_coarser, "{about}");
            finer = (alone.nodes, alone.error_px);
            let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let flown = threads.install(|| {
                let mut session = data.session(Some(2 * budget), &Arc::default());
                for fov in [2.0, 20.0, 44.0] {
                    let mut before = shot.clone();
                    before.camera.fov = Some(fov);
                    session.draw(&before).unwrap();
                }
                session.draw(&shot).unwrap()
            });
            assert!(drawn(&flown) == drawn(&alone), "{about}, {} after others", flown.nodes);
        }
    }
}

/// A list that is too long is coarser, the same whatever was listed before; what else was listed is no reason.
#[test]
fn lists_that_do_not_fit_are_coarser_by_the_memory_alone() {
    let data = data(60_000, Kinds::default());
    let file = Arc::new(PageFile::open(&data.path).unwrap());
    let (_, camera) = shot("column-density", Surround::Flat, &mut data.session(None, &Arc::default()));
    let view = |fov: f64| -> View { Camera { fov, ..camera }.view(SIZE.0, SIZE.1).unwrap() };
    let list = |scene: &mut Scene, fov: f64| {
        let listing = scene.list(&view(fov), 0.02, &mut |_| {}).unwrap();
        (listing.nodes, listing.converged, scene.take_coarser())
    };
    let all = list(&mut Scene::new(Arc::clone(&file), u64::MAX), 45.0);
    assert!(all.1 && !all.2 && all.0.len() > 20, "{} nodes", all.0.len());
    let [mut fits, mut are_coarser] = [0, 0];
    // From next to nothing on.
    for budget in [4 << 10, 8 << 10, 16 << 10, 256 << 10] {
        let alone = list(&mut Scene::new(Arc::clone(&file), budget), 45.0);
        let mut scene = Scene::new(Arc::clone(&file), budget);
        for fov in [1.0, 10.0, 30.0] {
            list(&mut scene, fov);
        }
        let about = format!("{budget}: {} nodes of {}", alone.0.len(), all.0.len());
        assert!(list(&mut scene, 45.0) == alone, "{about}");
        match alone.2 {
            true => assert!(alone.0.len() < all.0.len(), "{about}"),
            false => assert!(alone == all, "{about}"),
        }
        fits += usize::from(!alone.2);
        are_coarser += usize::from(alone.2);
    }
    assert!(fits > 0 && are_coarser > 0, "{fits} fit, {are_coarser} are coarser");
}

/// A card that draws with the processor, and counts how often.
struct Counting(Arc<AtomicUsize>);

impl Adapter for Counting {
    fn is_card(&mut self) -> bool {
        true
    }

    fn draw(&mut self, job: &AdapterJob<'_>) -> Result<AdapterFrame, VolumeError> {
        self.0.fetch_add(1, Ordering::Relaxed);
        let transfer = TransferFunction::default();
        let subject = Subject::new(job.metadata, job.depiction, &transfer, 1.0);
        let (sums, counts) = subject.draw_nodes(job.view, job.nodes, job.plan)?.sums(job.depiction.mode)?;
        Ok(AdapterFrame {
            values: AdapterValues::Sums(sums),
            splats: Some(counts.drawn),
            backend: "compute",
            adapter: "counting".into(),
            milliseconds: [("frame".to_owned(), 1.0)].into(),
            covered: None,
            note: None,
        })
    }
}

#[test]
fn an_adapter_draws_the_parts_and_they_are_added_up() {
    let data = data(60_000, Kinds::default());
    let told = Arc::default();
    let mut whole = data.session(None, &told);
    let (shot, _) = shot("column-density", Surround::Flat, &mut whole);
    let expected = whole.draw(&shot).unwrap();
    let draws = Arc::new(AtomicUsize::new(0));
    let adapter = || -> Option<Box<dyn Adapter>> { Some(Box::new(Counting(draws.clone()))) };
    let mut session = data.session(Some(2 * BUDGETS[0]), &told).with_adapter(adapter());
    let picture = session.draw(&shot).unwrap();
    assert!(picture.converged && picture.drawn_by[1] == "counting" && draws.load(Ordering::Relaxed) > 3);
    assert_eq!(picture.left_out.splats, expected.left_out.splats);
    let (sums, expected) = (sums(&picture), sums(&expected));
    let differ: f64 = sums.p.iter().zip(&expected.p).map(|(a, b)| f64::from((a - b).abs())).sum();
    assert!(differ <= 1e-6 * expected.p.iter().map(|p| f64::from(*p)).sum::<f64>(), "{differ}");
    // An empty view is a black picture of the adapter's.
    let mut away = shot.clone();
    [away.camera.eye, away.camera.target] = [100.0, 200.0].map(|far| shot.camera.eye.map(|eye| eye.map(|x| far * x)));
    let picture = session.draw(&away).unwrap();
    assert!(
        picture.nodes == 0 && self::sums(&picture).p.iter().all(|p| *p == 0.0) && picture.drawn_by[1] == "counting"
    );
}

#[test]
fn volumes_that_do_not_fit_are_drawn_in_slabs_where_an_adapter_is_asked_for() {
    let data = data(60_000, Kinds::default());
    let told = Arc::default();
    let draws = Arc::new(AtomicUsize::new(0));
    let little = Some(2 * BUDGETS[0]);
    let mut alone = data.session(little, &Arc::default());
    let open = |page_memory: Option<u64>| {
        let options = SessionOptions { page_memory, backend: Some(Backend::Compute), ..SessionOptions::default() };
        data.open(options, &told).with_adapter(Some(Box::new(Counting(draws.clone()))))
    };
    let mut session = open(little);
    for mode in ["volume", "isosurface"] {
        let (mut shot, _) = shot(mode, Surround::Flat, &mut alone);
        shot.size = Some((90, 60));
        let (picture, expected) = (session.draw(&shot).unwrap(), alone.draw(&shot).unwrap());
        assert!(picture.converged && expected.converged && picture.drawn_by[0] == "cpu", "{mode}");
        let (Raw::Light(own), Raw::Light(expected)) = (&picture.values, &expected.values) else {
            panic!("{mode}: sums")
        };
        assert!(own.report.slabs > 1 && own.colors.rgba == expected.colors.rgba, "{mode}: {:?}", own.report);
        // With enough memory it is the adapter's, which does not do this one.
        assert!(open(None).draw(&shot).is_err_and(|error| error.to_string().contains("the adapter")), "{mode}");
    }
    assert_eq!(draws.load(Ordering::Relaxed), 0);
    // Nothing is decoded for what an adapter draws, and pages have the room.
    let (shot, _) = shot("spheres", Surround::Flat, &mut alone);
    let budgets = [Backend::Compute, Backend::Cpu].map(|backend| {
        let options =
            SessionOptions { page_memory: Some(1 << 30), backend: Some(backend), ..SessionOptions::default() };
        let mut session = data.open(options, &told).with_adapter(Some(Box::new(Counting(draws.clone()))));
        assert_eq!(session.draw(&shot).is_ok(), backend == Backend::Cpu);
        session.residency().budget_bytes
    });
    assert!(budgets[0] == 1 << 29 && 8 * budgets[1] < budgets[0], "{budgets:?}");
    let messages = told.0.lock().unwrap();
    let of_it = messages.iter().filter(|message| message.contains("are drawn by the processor")).count();
    assert_eq!(of_it, 1, "{messages:?}");
}

/// What comes next is read as far as there is room, and what is drawn stays.
#[test]
fn what_is_read_ahead_takes_no_room_from_what_is_drawn() {
    let data = data(150_000, Kinds::default());
    let file = Arc::new(PageFile::open(&data.path).unwrap());
    let mut scene = Scene::new(Arc::clone(&file), 2 << 20);
    let mut session = data.session(None, &Arc::default());
    let (_, camera) = shot("column-density", Surround::Flat, &mut session);
    let view = |zoom: f64| -> View { Camera { fov: zoom, ..camera }.view(SIZE.0, SIZE.1).unwrap() };
    let drawn = scene.converge_blocking(&view(1.0), 2.0).unwrap();
    assert!(drawn.converged);
    let before = scene.streamer.residency.statistics();
    scene.look_ahead(&view(20.0), 0.05);
    while scene.streamer.is_busy() {
        scene.streamer.wait(Duration::from_millis(10));
        scene.streamer.arrive();
        scene.streamer.serve();
        scene.streamer.take_evicted();
    }
    let after = scene.streamer.residency.statistics();
    assert!(after.bytes > before.bytes && after.most_bytes <= after.budget_bytes, "{before:?} {after:?}");
    assert!(drawn.nodes.iter().all(|node| scene.streamer.residency.page(node.node.page).is_some()));
    // A picture begins to read what the next one needs, where that is known.
    let held = |next: Option<View>| {
        let mut session = data.session(None, &Arc::default());
        let (mut near, _) = shot("column-density", Surround::Flat, &mut session);
        near.camera.fov = Some(1.0);
        session.look_ahead(next);
        session.draw(&near).unwrap();
        session.residency().most_bytes
    };
    let [alone, with_next] = [None, Some(view(20.0))].map(held);
    assert!(with_next > alone, "{alone} bytes alone, {with_next} with the next picture's");
}
