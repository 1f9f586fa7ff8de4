//! How many splats lie over each pixel, counted by an adapter and by the processor.

use crate::support::{Built, Random, alone, built, built_plainly, demo, sum_nodes, view_of};
use deepfield::annotate::overlay::read_png;
use deepfield::codec::VqBits;
use deepfield::cpu::overdraw::Overdraw;
use deepfield::gpu::depiction::request_nodes;
use deepfield::gpu::{Backend, GpuError, HeadlessRenderer, Offscreen, Withheld, headless};
use deepfield::look::{self, CameraConfig, LookPatch, Member, Shot};
use deepfield::mode::{Depiction, Plan, Settings};
use deepfield::model::Bounds;
use deepfield::modes;
use deepfield::picture::adapter::{Adapter, AdapterJob, Passes};
use deepfield::picture::decode::decoded_nodes;
use deepfield::picture::look::transfer_of;
use deepfield::picture::{Picture, PictureError, Session, SessionOptions, Subject};
use deepfield::stream::{Scene, SceneNode};
use deepfield::view::{Cut, Projection, View};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Largest difference of the means, relative to the processor's: a rectangle's edge that lies within rounding of a pixel's moves the
/// counts of one row or column of it.
const MEAN: f64 = 5e-5;
/// Largest share of pixels that may differ, of pictures with some thousand splats over each.
const DIFFER: f64 = 1e-2;
/// The most by which they may.
const MOST: u32 = 2;

fn compare(found: &Overdraw, expected: &Overdraw, what: &str) {
    assert_eq!((found.width, found.height), (expected.width, expected.height), "{what}");
    assert_eq!(found.counts.len(), expected.counts.len(), "{what}");
    let pairs = || found.counts.iter().zip(&expected.counts).map(|(a, b)| a.abs_diff(*b));
    let share = pairs().filter(|difference| *difference > 0).count() as f64 / found.counts.len() as f64;
    let most = pairs().max().unwrap();
    let mean = (found.mean() - expected.mean()).abs() / expected.mean().max(f64::MIN_POSITIVE);
    println!("{what}: mean {:.2}, off by {mean:.1e}; {share:.1e} of the pixels differ, by {most}", expected.mean());
    assert!(mean <= MEAN && share <= DIFFER && most <= MOST, "{what}: {mean} {share} {most}");
}

/// A page file, and a mode that draws it.
struct Data {
    built: Built,
    depiction: Depiction,
}

impl Data {
    fn new(mode: &str) -> Data {
        Data::of(built(&demo(), VqBits::Eight), mode)
    }

    fn of(built: Built, mode: &str) -> Data {
        let depiction =
            Depiction::new(modes::find(mode).unwrap(), Settings::default(), None, built.file.metadata()).unwrap();
        Data { built, depiction }
    }

    fn nodes(&self, view: &View) -> Vec<SceneNode> {
        Scene::new(Arc::clone(&self.built.file), u64::MAX).converge_blocking(view, 0.8).unwrap().nodes
    }

    fn by_processor(&self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Overdraw {
        let transfer = transfer_of(&LookPatch::default(), &self.depiction);
        let subject = Subject::new(self.built.file.metadata(), &self.depiction, &transfer, 0.0);
        subject.overdraw(view, &subject.decode(view, nodes, plan), plan).unwrap()
    }

    fn job<'a>(&'a self, view: &'a View, nodes: &'a [SceneNode], plan: &'a Plan, passes: Passes) -> AdapterJob<'a> {
        let (depiction, metadata) = (&self.depiction, self.built.file.metadata());
        AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 }
    }
}

/// A view from somewhere around or in the data, of some size.
fn random_view(random: &mut Random, bounds: Bounds, orthographic: bool) -> View {
    let direction = DVec3::from_array([0; 3].map(|_| 2.0 * random.next() - 1.0));
    let distance = 0.02 * 150f64.powf(random.next());
    let [width, height] = [0; 2].map(|_| 20 + (180.0 * random.next()) as u32);
    let view = view_of(bounds, direction, distance, width, height);
    let height = bounds.size().max_element() * (0.1 + random.next());
    let projection = if orthographic { Projection::Orthographic { height } } else { view.projection };
    View { projection, ..view }
}

#[test]
fn an_adapter_counts_what_the_processor_counts() {
    alone("overdraw::an_adapter_counts_what_the_processor_counts", || {
        let mut adapters = [Passes::Compute, Passes::Raster].map(|passes| (passes, Offscreen::default()));
        let mut random = Random(12);
        let mut dropped = 0;
        for mode in ["column-density", "density-squared", "points"] {
            let data = Data::new(mode);
            let bounds = data.built.bounds();
            for (number, orthographic) in [false, true, true, false, false, false].into_iter().enumerate() {
                let view = random_view(&mut random, bounds, orthographic);
                let nodes = data.nodes(&view);
                let sums = sum_nodes(&view, &data.depiction, data.built.file.metadata(), &nodes);
                let faintest = 3e-4 * sums.p.iter().copied().fold(0.0, f32::max);
                let all = Plan::default();
                let everything = data.by_processor(&view, &nodes, &all).mean();
                for (plan, of) in [
                    (all, "all"),
                    (Plan { culling: false, ..all }, "without culling"),
                    (Plan { faintest, ..all }, "without faint ones"),
                    (Plan { keep: 0.1, ..all }, "thinned by importance"),
                    (Plan { share: 0.3, faintest, ..all }, "a share without faint ones"),
                ] {
                    let expected = data.by_processor(&view, &nodes, &plan);
                    let some = 0.0 < expected.mean() && expected.mean() < 0.9 * everything;
                    dropped += u32::from(plan.share == 1.0 && plan.faintest > 0.0 && some);
                    let before = decoded_nodes();
                    let (passes, adapter) = &mut adapters[number % 2];
                    let found = adapter.overdraw(&data.job(&view, &nodes, &plan, *passes)).unwrap();
                    assert_eq!(decoded_nodes(), before, "the adapter alone loads particles");
                    let lens = if orthographic { "orthographic" } else { "perspective" };
                    compare(&found, &expected, &format!("{mode}, {lens} {number}, {of}"));
                }
            }
        }
        assert!(dropped >= 10, "only {dropped} pictures without their faint particles");
    });
}

#[test]
fn what_a_view_leaves_out_is_not_counted() {
    let data = Data::new("column-density");
    let bounds = data.built.bounds();
    let cut = Cut {
        bounds: Bounds { min: bounds.min + 0.3 * bounds.size(), max: DVec3::INFINITY },
        fade_start: bounds.size().x,
        fade_rate: 2.0 / bounds.size().x,
        around: false,
    };
    let whole = view_of(bounds, DVec3::new(-0.7, 0.2, 0.4), 1.2, 200, 150);
    let view = whole.with_cut(cut);
    let (nodes, plan) = (data.nodes(&view), Plan::default());
    let expected = data.by_processor(&view, &nodes, &plan);
    assert!(expected.mean() < 0.8 * data.by_processor(&whole, &nodes, &plan).mean());
    let found = Offscreen::default().overdraw(&data.job(&view, &nodes, &plan, Passes::Best)).unwrap();
    compare(&found, &expected, "a cut");
}

#[test]
fn parts_are_counted_as_the_whole() {
    let data = Data::of(built_plainly(), "column-density");
    let view = view_of(data.built.bounds(), DVec3::new(-0.7, 0.2, 0.4), 0.6, 300, 200);
    let (nodes, plan) = (data.nodes(&view), Plan::default());
    let expected = data.by_processor(&view, &nodes, &plan);
    let limit = 1 << 19;
    let limits =
        wgpu::Limits { max_storage_buffer_binding_size: limit, max_buffer_size: limit, ..wgpu::Limits::default() };
    let mut request =
        request_nodes(&view, &data.depiction, data.built.file.metadata(), &nodes, &plan, Backend::Compute);
    request.device.constrained_limits = Some(limits);
    let mut renderer = HeadlessRenderer::bare(&request.device, request.backend).unwrap();
    compare(&headless::overdraw(&mut renderer, request).unwrap(), &expected, "parts");
}

#[test]
fn an_adapter_without_compute_shaders_says_so() {
    let data = Data::new("column-density");
    let view = view_of(data.built.bounds(), DVec3::X, 1.5, 60, 40);
    let metadata = data.built.file.metadata();
    let mut request =
        request_nodes(&view, &data.depiction, metadata, &data.nodes(&view), &Plan::default(), Backend::Raster);
    request.device.withheld = Withheld { compute: true, ..Withheld::default() };
    let mut renderer = HeadlessRenderer::bare(&request.device, request.backend).unwrap();
    let refused = headless::overdraw(&mut renderer, request).unwrap_err();
    assert!(matches!(refused, GpuError::Unsupported { backend: "compute", .. }), "{refused}");
}

/// Draws a mode of a page file with a picture of its overdraw.
fn drawn(file: &Path, mode: &str, backend: look::Backend, overdraw: &Path) -> Result<Picture, PictureError> {
    let options =
        SessionOptions { backend: Some(backend), overdraw: Some(overdraw.to_owned()), ..SessionOptions::default() };
    let opened = Session::open(&[Member::new(file)], options, [], |path| Ok(path.to_owned()), Arc::new(()));
    let camera =
        CameraConfig { eye: Some([25.0, 25.0, 90.0]), target: Some([25.0, 26.0, 0.0]), ..CameraConfig::default() };
    let look = LookPatch { mode: modes::find(mode), ..LookPatch::default() };
    let shot = Shot { look, camera, size: Some((96, 64)), ..Shot::default() };
    opened?.with_adapter(Some(Box::new(Offscreen::default()))).draw(&shot)
}

#[test]
fn a_session_has_its_adapter_count() {
    alone("overdraw::a_session_has_its_adapter_count", || {
        let built = built(&demo(), VqBits::Eight);
        let folder = tempfile::tempdir().unwrap();
        let counted = |backend: look::Backend| {
            let path = folder.path().join(format!("{backend:?}.png"));
            let before = decoded_nodes();
            let picture = drawn(built.file.path(), "column-density", backend, &path).unwrap();
            assert_eq!(decoded_nodes() > before, backend == look::Backend::Cpu, "{backend:?}");
            (picture.left_out.overdraw.unwrap(), read_png(&path).unwrap())
        };
        let ((mean, most), expected) = counted(look::Backend::Cpu);
        for backend in [look::Backend::Compute, look::Backend::Raster] {
            let ((found, highest), image) = counted(backend);
            assert!(
                (found - mean).abs() <= MEAN * mean && highest.abs_diff(most) <= MOST,
                "{found} {mean} {highest} {most}"
            );
            let differ = image.rgba.iter().zip(&expected.rgba).filter(|(a, b)| a != b).count();
            assert!(differ as f64 <= DIFFER * expected.rgba.len() as f64, "{differ} pixels of {backend:?}");
        }
        for backend in [look::Backend::Cpu, look::Backend::Compute] {
            let refused = drawn(built.file.path(), "volume", backend, &folder.path().join("none.png")).err().unwrap();
            assert_eq!(refused.to_string(), "--overdraw: the mode volume has no splats");
        }
        assert!(!folder.path().join("none.png").exists());
    });
}
