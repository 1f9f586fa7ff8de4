//! Speed of converged frames of a page file: what the selection at 0.8 pixels leaves to draw, and how long it takes.

use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::{BuildOptions, build};
use crate::codec::VqBits;
use crate::color::transfer::TransferFunction;
use crate::mode::{Depiction, LodBudget, Plan, Settings};
use crate::modes::column_density;
use crate::picture::Subject;
use crate::store::PageFile;
use crate::stream::{Scene, SceneNode};
use crate::synth::{Generator, clusters::Clusters, dataset};
use crate::view::{Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Largest displacement of a drawn particle, pixels.
const ERROR_PX: f64 = 0.8;

/// One line of the results.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Number of source particles.
    pub particles: u64,
    /// Where the camera is.
    pub view: &'static str,
    /// The backend that draws.
    pub backend: String,
    /// Number of particles that are drawn of the picture's nodes.
    pub drawn: u64,
    /// Seconds for one picture of nodes that are in memory, or in the adapter's memory.
    pub seconds: Times,
}

/// Measures all sizes and prints a table to standard error.
///
/// # Errors
/// When a file cannot be built or read, or a backend fails.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("bench.df");
    let mut outcomes = Vec::new();
    eprintln!("{:>10}  {:8} {:24} {:>9} {:>9} {:>9}", "particles", "view", "backend", "drawn", "median s", "fastest s");
    for &particles in &arguments.sizes {
        let generator = Clusters::new(arguments.seed, particles);
        build(dataset(&generator), &BuildOptions::with_vq_bits(VqBits::default()), &path, &())?;
        let file = Arc::new(PageFile::open(&path)?);
        let bounds = generator.bounds();
        let (center, size) = (bounds.center(), bounds.size());
        let pixels = arguments.pixels;
        let whole = Projection::Orthographic { height: size.y };
        let inside = Projection::Perspective { fov_y: 0.8 };
        let views = [
            ("whole", View::look_at(center + DVec3::Z * size.z, center, DVec3::Y, whole, pixels, pixels)?),
            ("inside", View::look_at(center + 0.2 * size, center, DVec3::Y, inside, pixels, pixels)?),
        ];
        let depiction = Depiction::new(&column_density::MODE, Settings::default(), None, file.metadata())?;
        for (name, view) in views {
            let nodes = Scene::new(Arc::clone(&file), u64::MAX).converge_blocking(&view, ERROR_PX)?.nodes;
            let lod_budget = LodBudget { thinning: arguments.thinning, ..LodBudget::NONE };
            let transfer = TransferFunction::preset(depiction.mode.transfer[0]).unwrap_or_default();
            let subject = Subject::new(file.metadata(), &depiction, &transfer, size.length());
            // A window finds it beside its frames.
            let plan = subject.plan(&view, &nodes, &lod_budget, None)?;
            let kept = subject.decode(&view, &nodes, &plan);
            let drawn = kept.iter().map(|node| node.len() as u64).sum();
            drop(kept);
            let frame = Frame { plan, view, subject, nodes: &nodes, repeat: arguments.repeat };
            for (backend, times) in frame.draw(arguments)? {
                let seconds = Times::of(times);
                eprintln!(
                    "{particles:>10}  {name:8} {backend:24} {drawn:>9} {:>9.4} {:>9.4}",
                    seconds.median, seconds.fastest
                );
                outcomes.push(Outcome { particles, view: name, backend, drawn, seconds });
            }
        }
    }
    Ok(outcomes)
}

/// A frame that is drawn by all backends.
struct Frame<'a> {
    plan: Plan,
    view: View,
    subject: Subject<'a>,
    nodes: &'a [SceneNode],
    repeat: u32,
}

impl Frame<'_> {
    fn draw(&self, arguments: &Arguments) -> Result<Vec<(String, Vec<Duration>)>, Failure> {
        let wanted = |name: &str| arguments.backends.iter().any(|backend| backend == name);
        let mut all = Vec::new();
        if wanted("cpu") {
            for &threads in &arguments.threads {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build()?;
                all.push((super::splat::cpu_name(threads), pool.install(|| self.on_cpu())?));
            }
        }
        #[cfg(feature = "viewer")]
        for backend in [crate::gpu::Backend::Compute, crate::gpu::Backend::Raster] {
            if wanted(backend.name()) {
                let request = crate::gpu::depiction::request_nodes(
                    &self.view,
                    self.subject.depiction,
                    self.subject.metadata,
                    self.nodes,
                    &self.plan,
                    backend,
                );
                let (name, drawn) = super::splat_gpu::draw(&request, self.repeat)?;
                all.push((name, drawn.times));
            }
        }
        Ok(all)
    }

    /// Decoding counts: it is part of every frame whose nodes have changed.
    fn on_cpu(&self) -> Result<Vec<Duration>, Failure> {
        let mut times = Vec::new();
        for repetition in 0..=self.repeat {
            let start = Instant::now();
            self.subject.draw_nodes(&self.view, self.nodes, &self.plan)?;
            // The first run pays for tables and pages of memory.
            if repetition > 0 {
                times.push(start.elapsed());
            }
        }
        Ok(times)
    }
}
