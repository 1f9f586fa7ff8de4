//! Pictures of clusters (HE03): within a number of splats, nearer to the particles the more there are, and as far away as they say.

use crate::support::{Random, write_demo_pages};
use deepfield::color::Accumulation;
use deepfield::color::transfer::Range;
use deepfield::cpu::volume::VolumeLevels;
use deepfield::hierarchy::Kinds;
use deepfield::look::LookPatch;
use deepfield::mode::levels::{LEVELS, SPLATS};
use deepfield::mode::lod_budget::{PRESENCE, THINNING};
use deepfield::mode::{Depiction, LevelChoice, Levels, Mode, Plan, SettingValue, Settings};
use deepfield::model::Bounds;
use deepfield::modes::{cartesian, column_density, find};
use deepfield::picture::level_report::{bound, estimate};
use deepfield::picture::look::transfer_of;
use deepfield::picture::{Session, Subject};
use deepfield::store::{PageFile, Representative};
use deepfield::stream::{Scene, SceneNode};
use deepfield::view::{Detail, Projection, Scope, View};
use glam::DVec3;
use std::sync::Arc;

pub struct Data {
    pub file: Arc<PageFile>,
    _folder: tempfile::TempDir,
}

pub fn data() -> Data {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clusters.df");
    write_demo_pages(&path, Kinds::of_particles());
    Data { file: Arc::new(PageFile::open(&path).unwrap()), _folder: folder }
}

struct Drawn {
    sums: Accumulation,
    splats: u64,
    nodes: Vec<SceneNode>,
}

struct Light {
    rgba: Vec<[f32; 4]>,
    levels: VolumeLevels,
    splats: u64,
}

impl Data {
    /// What a fresh reader draws.
    fn draw(&self, view: &View, choice: LevelChoice, tau: f64, plan: Plan) -> (Drawn, Depiction) {
        let metadata = self.file.metadata();
        let depiction = Depiction::new(&column_density::MODE, Settings::default(), None, metadata).unwrap();
        let depiction = Depiction { choice, attribute: None, ..depiction };
        let mut scene = Scene::new(Arc::clone(&self.file), u64::MAX);
        scene.purpose = depiction.purpose(metadata);
        let selection = scene.converge_blocking(view, depiction.detail(view, tau, metadata)).unwrap();
        assert!(selection.converged);
        let transfer = transfer_of(&LookPatch::default(), &depiction);
        let subject = Subject::new(metadata, &depiction, &transfer, 1.0);
        let sums = subject.draw_nodes(view, &selection.nodes, &plan).unwrap().sums(depiction.mode).unwrap().0;
        (Drawn { sums, splats: selection.particles, nodes: selection.nodes }, depiction)
    }

    /// The same of a mode that draws light, with these ranges of densities and of the attribute, or its own, which come back.
    fn light(&self, mode: &'static Mode, view: &View, choice: LevelChoice, levels: Option<VolumeLevels>) -> Light {
        let metadata = self.file.metadata();
        let mut settings = Settings::default();
        if mode.name == cartesian::MODE.name {
            // About as many as the picture has pixels: what volumes have, too.
            settings.set(&cartesian::CELLS, SettingValue::Number(96.0));
        }
        let depiction = Depiction::new(mode, settings, None, metadata).unwrap();
        let depiction = Depiction { choice, ..depiction };
        let mut scene = Scene::new(Arc::clone(&self.file), u64::MAX);
        scene.purpose = depiction.purpose(metadata);
        let tau = if choice.splats.is_some() { 0.8 } else { 0.0 };
        let selection = scene.converge_blocking(view, depiction.detail(view, tau, metadata)).unwrap();
        let mut transfer = transfer_of(&LookPatch::default(), &depiction);
        if let Some(levels) = levels {
            let fixed = |[from, to]: [f64; 2]| Range::Fixed(from, to);
            transfer.range = fixed(levels.density);
            transfer.hue.iter_mut().for_each(|hue| hue.range = fixed(levels.attribute));
        }
        let subject = Subject::new(metadata, &depiction, &transfer, 1.0);
        let picture = subject.draw_nodes(view, &selection.nodes, &Plan::default()).unwrap().light(mode).unwrap();
        Light { rgba: picture.colors.rgba, levels: picture.levels, splats: selection.particles }
    }

    fn clusters(&self, view: &View, splats: u64) -> Drawn {
        let choice = LevelChoice { levels: Levels::Clusters, splats: Some(splats), ..LevelChoice::default() };
        self.draw(view, choice, 0.8, Plan::default()).0
    }

    fn leaves(&self, view: &View, share: f32) -> Accumulation {
        let choice = LevelChoice { levels: Levels::Splats, ..LevelChoice::default() };
        self.draw(view, choice, 0.0, Plan { share, ..Plan::default() }).0.sums
    }
}

/// Relative L1 and L2 distance.
fn off(a: &Accumulation, b: &Accumulation) -> [f64; 2] {
    let pairs = || a.p.iter().zip(&b.p).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let (first, second) = pairs().fold((0.0, 0.0), |(x, y), (a, b)| (x + (a - b).abs(), y + (a - b) * (a - b)));
    let (sum, squares) = pairs().fold((0.0, 0.0), |(x, y), (_, b)| (x + b.abs(), y + b * b));
    [first / sum, (second / squares).sqrt()]
}

fn above(bounds: Bounds, height: f64) -> View {
    let eye = bounds.center() + DVec3::Z * bounds.size().length();
    View::look_at(eye, bounds.center(), DVec3::Y, Projection::Orthographic { height }, 256, 256).unwrap()
}

#[test]
fn what_particles_may_be_left_out_leaves_clusters_as_they_are() {
    let data = data();
    let view = above(data.file.metadata().bounds(), 50.0);
    let mut session = Session::of(Arc::clone(&data.file), u64::MAX);
    let mut picture = |thinning: f64, presence: f64| {
        let mut look = LookPatch::default();
        let name = |text: &str| SettingValue::Name(text.into());
        for (setting, value) in [(&LEVELS, name("clusters")), (&SPLATS, SettingValue::Number(2000.0))] {
            look.budget.set(setting, value);
        }
        look.budget.set(&THINNING, SettingValue::Number(thinning));
        look.budget.set(&PRESENCE, SettingValue::Number(presence));
        session.image(&look, &view, None, 1.0, u64::MAX).unwrap()
    };
    let usual = picture(0.0, 0.0);
    assert!((1900..=2000).contains(&usual.1), "{}", usual.1);
    assert!(picture(8.0, 0.0) == usual && picture(0.0, 5.0) == usual);
}

#[test]
fn more_splats_are_nearer_to_the_particles_and_budgets_are_kept() {
    let data = data();
    let metadata = data.file.metadata();
    let (bounds, particles) = (metadata.bounds(), metadata.particles());
    let view = above(bounds, bounds.size().max_element());
    let leaves = data.leaves(&view, 1.0);
    let finest: u64 = metadata.families.iter().map(|family| family.clusters.as_ref().unwrap().finest()).sum();
    let mut before = f64::INFINITY;
    for percent in [1, 2, 4, 8, 16, 32, 64] {
        let splats = particles * percent / 100;
        let drawn = data.clusters(&view, splats);
        let [_, error] = off(&drawn.sums, &leaves);
        assert!(error < before, "{percent} %: {error} after {before}");
        before = error;
        assert!(drawn.splats <= splats, "{} of {splats}", drawn.splats);
        assert!(splats > finest || drawn.splats as f64 >= 0.95 * splats as f64, "{} of {splats}", drawn.splats);
        // Whatever came first from the disk.
        let again = data.clusters(&view, splats);
        assert!(again.sums.p == drawn.sums.p, "{percent} %");
        if percent == 4 || percent == 16 {
            let [_, sampled] = off(&data.leaves(&view, percent as f32 / 100.0), &leaves);
            assert!(error < 0.5 * sampled, "{percent} %: {error}, an even sample {sampled}");
        }
    }
    let all = data.clusters(&view, 2 * particles);
    assert!(all.sums.p == leaves.p && all.splats == particles);
}

#[test]
fn budgets_are_used_from_within_the_data_too() {
    let data = data();
    let bounds = data.file.metadata().bounds();
    let eye = bounds.center();
    let ahead = eye + DVec3::new(0.62, 0.37, 0.69);
    let view = View::look_at(eye, ahead, DVec3::Y, Projection::Perspective { fov_y: 0.8 }, 300, 200).unwrap();
    for splats in [1000, 1500, 2250, 3400, 5000, 7600, 11_000, 17_000] {
        let drawn = data.clusters(&view, splats).splats;
        assert!(drawn <= splats && drawn >= splats * 9 / 10, "{drawn} of {splats}");
    }
}

#[test]
fn mass_and_centre_are_kept_at_any_number() {
    let data = data();
    let metadata = data.file.metadata();
    let bounds = metadata.bounds();
    let height = 3.0 * bounds.size().max_element();
    let view = above(bounds, height);
    let light = |sums: &Accumulation| {
        let (mut total, mut along) = (0.0, [0.0; 2]);
        for (index, p) in sums.p.iter().enumerate() {
            let p = f64::from(*p);
            total += p;
            along[0] += p * (index % 256) as f64;
            along[1] += p * (index / 256) as f64;
        }
        (total * (height / 256.0).powi(2), along.map(|sum| sum / total / 256.0))
    };
    let (_, middle) = light(&data.leaves(&view, 1.0));
    let mass: f64 = metadata.families.iter().map(|family| family.mass).sum();
    for splats in [1, 10, 100, 2000] {
        for representative in [Representative::Ellipsoid, Representative::Round, Representative::Published] {
            let choice = LevelChoice {
                levels: Levels::Clusters,
                splats: Some(splats),
                representative,
                ..LevelChoice::default()
            };
            let (total, centre) = light(&data.draw(&view, choice, 0.8, Plan::default()).0.sums);
            assert!((total / mass - 1.0).abs() < 2e-5, "{splats} {representative:?}: {total} of {mass}");
            assert!((0..2).all(|k| (centre[k] - middle[k]).abs() < 1e-4), "{splats}: {centre:?} {middle:?}");
        }
    }
}

#[test]
fn errors_are_within_their_bound_and_near_their_estimate() {
    let data = data();
    let metadata = data.file.metadata();
    let (bounds, particles) = (metadata.bounds(), metadata.particles());
    let size = bounds.size().max_element();
    let mut random = Random(7);
    let mut near = 0;
    const VIEWS: usize = 24;
    for _ in 0..VIEWS {
        let mut signed = || 2.0 * random.next() - 1.0;
        let direction = DVec3::new(signed(), signed(), signed()).normalize();
        let target = bounds.center() + 0.2 * size * DVec3::new(signed(), signed(), signed());
        let up = DVec3::new(signed(), signed(), signed());
        let height = size * 0.3 * 5.0_f64.powf(0.5 + 0.5 * signed());
        let splats = (particles as f64 * 0.01 * 32.0_f64.powf(0.5 + 0.5 * signed())) as u64;
        let projection = Projection::Orthographic { height };
        let view = View::look_at(target + 2.0 * size * direction, target, up, projection, 256, 256).unwrap();
        let choice = LevelChoice { levels: Levels::Clusters, splats: Some(splats), ..LevelChoice::default() };
        let (drawn, depiction) = data.draw(&view, choice, 0.8, Plan::default());
        let [error, _] = off(&drawn.sums, &data.leaves(&view, 1.0));
        let total: f64 = drawn.sums.p.iter().map(|p| f64::from(*p)).sum();
        let most = bound(&view, &depiction, &drawn.nodes, total).unwrap();
        assert!(error <= most, "{error} {most}");
        let thought = estimate(&drawn.sums.p, &data.clusters(&view, drawn.splats / 2).sums.p);
        near += usize::from((0.5..=2.0).contains(&(error / thought)));
    }
    assert!(near >= VIEWS - 1, "{near} of {VIEWS}");
    // A perspective view from among the particles.
    let eye = bounds.center() + 0.3 * size * DVec3::new(0.5, 0.2, 1.0);
    let view = View::look_at(eye, bounds.center(), DVec3::Y, Projection::Perspective { fov_y: 0.9 }, 256, 256).unwrap();
    let drawn = data.clusters(&view, particles / 20);
    let sampled = off(&data.leaves(&view, 0.05), &data.leaves(&view, 1.0));
    let [error, _] = off(&drawn.sums, &data.leaves(&view, 1.0));
    // What is bright comes before what is faint, for which the mean error, which counts both alike, is a little larger than it could be.
    assert!(error < 0.55 * sampled[0], "{error} {sampled:?}");
    assert_eq!(Detail::Budget { splats: 5, scope: Scope::Picture }.tolerance(&view), f64::INFINITY);
}

#[test]
fn light_of_clusters_comes_to_that_of_the_particles() {
    let data = data();
    let metadata = data.file.metadata();
    let (bounds, particles) = (metadata.bounds(), metadata.particles());
    let size = bounds.size().max_element();
    let eye = bounds.center() + 1.2 * size * DVec3::new(0.3, 0.4, 1.0);
    let view = View::look_at(eye, bounds.center(), DVec3::Y, Projection::Perspective { fov_y: 0.8 }, 96, 96).unwrap();
    for name in ["volume", "isosurface", "volume-isosurface", "cartesian", "sorted-splats"] {
        let mode = find(name).unwrap();
        let of = |levels, splats, ranges| {
            data.light(mode, &view, LevelChoice { levels, splats, ..LevelChoice::default() }, ranges)
        };
        let leaves = of(Levels::Splats, Some(2 * particles), None);
        let ranges = Some(leaves.levels);
        let off = |light: &Light| -> f64 {
            let pairs = light.rgba.as_flattened().iter().zip(leaves.rgba.as_flattened());
            pairs.map(|(a, b)| f64::from((a - b).powi(2))).sum::<f64>().sqrt()
        };
        let errors = [1, 8, 64].map(|percent| {
            let light = of(Levels::Clusters, Some(particles * percent / 100), ranges);
            assert!(light.splats <= particles * percent / 100, "{name}: {}", light.splats);
            off(&light)
        });
        println!("{name}: {errors:?}");
        assert!(errors[0] > errors[1] && errors[1] > errors[2], "{name}: {errors:?}");
        let all = of(Levels::Clusters, Some(2 * particles), ranges);
        assert!(all.splats == particles && off(&all) < 1e-3 * errors[2], "{name}: {} {}", all.splats, off(&all));
    }
    let spheres = Depiction::new(find("spheres").unwrap(), Settings::default(), None, metadata).unwrap();
    assert!(!spheres.takes_clusters());
}
