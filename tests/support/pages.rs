//! Page files built for the tests, and what the tests draw from them.

use super::files::{demo, kept_page_file};
use super::program::ok;
use deepfield::build::{BuildOptions, build, build_source};
use deepfield::codec::VqBits;
use deepfield::color::Accumulation;
use deepfield::color::composite::Image;
use deepfield::cpu::Method;
use deepfield::hierarchy::Kinds;
use deepfield::import::{LoadOptions, load};
use deepfield::look::LookPatch;
use deepfield::mode::{Depiction, Plan, Raw, Settings};
use deepfield::model::{Bounds, Dataset};
use deepfield::modes;
use deepfield::picture::Subject;
use deepfield::picture::look::transfer_of;
use deepfield::store::{InMemory, Metadata, PageFile, Tree};
use deepfield::stream::{Scene, SceneNode, first_nodes};
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

/// How a source is had in memory.
type Read = Box<dyn FnOnce() -> Dataset + Send>;

/// The page file of a source, and the source in memory, for a test that asks for it.
pub struct Built {
    pub dataset: LazyLock<Dataset, Read>,
    pub file: Arc<PageFile>,
    _folder: tempfile::TempDir,
}

impl Built {
    /// Of a page file that is made in a folder of its own.
    fn new(read: impl FnOnce() -> Dataset + Send + 'static, make: impl FnOnce(&Path)) -> Built {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("built.df");
        make(&path);
        let read: Read = Box::new(read);
        Built { dataset: LazyLock::new(read), file: Arc::new(PageFile::open(&path).unwrap()), _folder: folder }
    }

    /// The box around the source's particles.
    pub fn bounds(&self) -> Bounds {
        self.file.metadata().bounds()
    }
}

/// Imports a source and builds it: the demo snapshot, with which many tests begin, once for all of them.
pub fn built(source: &Path, vq_bits: VqBits) -> Built {
    match source == demo() {
        true => built_of_demo(&format!("demo-{vq_bits:?}"), &BuildOptions::with_vq_bits(vq_bits)),
        false => built_from(source, &LoadOptions::default(), vq_bits),
    }
}

/// The demo snapshot, built with codes that are not refined: an adapter's table of them is small.
pub fn built_plainly() -> Built {
    let mut options = BuildOptions::with_vq_bits(VqBits::Eight);
    options.octree.refined = false;
    built_of_demo("demo-plain", &options)
}

/// The demo snapshot, built in one way by whichever test first asks for it under that name.
fn built_of_demo(name: &str, options: &BuildOptions) -> Built {
    let read = || load(&demo(), &LoadOptions::default(), &()).unwrap();
    let kept = kept_page_file(name, |path| {
        build(read(), options, path, &()).unwrap();
    });
    Built::new(read, |path| std::fs::write(path, kept).unwrap())
}

/// Writes the page file of the demo snapshot with these hierarchies, which otherwise is as a build makes it: built once, too.
pub fn write_demo_pages(path: &Path, hierarchies: Kinds) {
    let kept = kept_page_file(&format!("demo-{hierarchies}"), |path| {
        let options = BuildOptions { hierarchies, ..BuildOptions::default() };
        build_source(&demo(), &LoadOptions::default(), &options, path, &()).unwrap();
    });
    std::fs::write(path, kept).unwrap();
}

/// Writes a box of a universe of few particles into a folder: the snapshot `box.gadget2`, and the page file whose path it gives.
pub fn write_box(folder: &Path) -> PathBuf {
    ok(folder, &["synth", "cosmology", "-n", "30000", "-o", "box.gadget2"]);
    ok(folder, &["build", "box.gadget2", "-o", "box.df"]);
    folder.join("box.df")
}

/// Imports what `options` say of a source and builds it.
pub fn built_from(source: &Path, options: &LoadOptions, vq_bits: VqBits) -> Built {
    built_from_dataset(load(source, options, &()).unwrap(), vq_bits)
}

/// Builds a dataset.
pub fn built_from_dataset(dataset: Dataset, vq_bits: VqBits) -> Built {
    let source = dataset.clone();
    Built::new(
        || dataset,
        |path| {
            build(source, &BuildOptions::with_vq_bits(vq_bits), path, &()).unwrap();
        },
    )
}

/// What the CPU renderer draws of nodes by a plan, in the mode's usual colours.
pub fn draw_nodes(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[SceneNode],
    method: Method,
    plan: &Plan,
) -> Raw {
    let transfer = transfer_of(&LookPatch::default(), depiction);
    let subject = Subject::new(metadata, depiction, &transfer, metadata.bounds().size().length());
    Subject { method, ..subject }.draw_nodes(view, nodes, plan).unwrap()
}

/// `P` and `P S` of all particles of nodes, by the CPU renderer.
pub fn sum_nodes(view: &View, depiction: &Depiction, metadata: &Metadata, nodes: &[SceneNode]) -> Accumulation {
    let drawn = draw_nodes(view, depiction, metadata, nodes, Method::Pyramid, &Plan::default());
    drawn.sums(depiction.mode).unwrap().0
}

/// The picture of the page file at `tau`, by the CPU renderer.
pub fn draw_pages(file: &Arc<PageFile>, mode: &str, view: &View, tau: f64) -> Accumulation {
    let metadata = file.metadata();
    let depiction = Depiction::new(modes::find(mode).unwrap(), Settings::default(), None, metadata).unwrap();
    let mut scene = Scene::new(Arc::clone(file), u64::MAX);
    let selection = scene.converge_blocking(view, tau).unwrap();
    assert!(selection.converged);
    sum_nodes(view, &depiction, metadata, &selection.nodes)
}

/// The colours of the page file at `tau`, of a mode that draws colours.
pub fn paint_pages(file: &Arc<PageFile>, mode: &str, view: &View, tau: f64) -> Image {
    let metadata = file.metadata();
    let depiction = Depiction::new(modes::find(mode).unwrap(), Settings::default(), None, metadata).unwrap();
    let selection = Scene::new(Arc::clone(file), u64::MAX).converge_blocking(view, tau).unwrap();
    let drawn = draw_nodes(view, &depiction, metadata, &selection.nodes, Method::Pyramid, &Plan::default());
    drawn.light(depiction.mode).unwrap().colors.image()
}

/// The picture of the source particles, by the CPU renderer.
pub fn draw_source(dataset: &Dataset, mode: &str, view: &View, method: Method) -> Accumulation {
    let tree = InMemory::new(dataset.clone());
    let metadata = tree.metadata();
    let depiction = Depiction::new(modes::find(mode).unwrap(), Settings::default(), None, metadata).unwrap();
    let nodes = first_nodes(&tree, view).unwrap();
    draw_nodes(view, &depiction, metadata, &nodes, method, &Plan::default()).sums(depiction.mode).unwrap().0
}

/// A perspective view of the middle of the data from `distance` (in sizes of its box) along `direction`.
pub fn view_from(dataset: &Dataset, direction: DVec3, distance: f64, width: u32, height: u32) -> View {
    view_of(dataset.bounds(), direction, distance, width, height)
}

/// The box between the 10 % and the 90 % quantile of all coordinates.
pub fn core(dataset: &Dataset) -> Bounds {
    let quantiles = |axis: usize| {
        let mut values: Vec<f64> =
            dataset.families.iter().flat_map(|family| &family.positions).map(|at| at[axis]).collect();
        values.sort_by(f64::total_cmp);
        [values[values.len() / 10], values[values.len() * 9 / 10]]
    };
    let [x, y, z] = [0, 1, 2].map(quantiles);
    Bounds { min: DVec3::new(x[0], y[0], z[0]), max: DVec3::new(x[1], y[1], z[1]) }
}

/// [`view_from`] of a box.
pub fn view_of(bounds: Bounds, direction: DVec3, distance: f64, width: u32, height: u32) -> View {
    let eye = bounds.center() + direction.normalize() * distance * bounds.size().max_element();
    let projection = Projection::Perspective { fov_y: 0.8 };
    View::look_at(eye, bounds.center(), DVec3::new(0.1, 1.0, 0.2), projection, width, height).unwrap()
}

/// A view along z that holds everything, kernels included; and the area of a pixel.
pub fn whole(dataset: &Dataset, pixels: u32) -> (View, f64) {
    let bounds = dataset.bounds();
    let reach = dataset.families.iter().flat_map(|family| &family.smoothing_length).fold(0.0f32, |a, &b| a.max(b));
    let height = 1.02 * bounds.size().max_element() + 2.0 * f64::from(reach);
    let eye = bounds.center() + DVec3::Z * 2.0 * height;
    let projection = Projection::Orthographic { height };
    let view = View::look_at(eye, bounds.center(), DVec3::Y, projection, pixels, pixels).unwrap();
    (view, (height / f64::from(pixels)).powi(2))
}
