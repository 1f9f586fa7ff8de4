//! Drawing speed: column density of a whole generated box in an orthographic view, with the error against the exact
//! area-averaged integral.

use super::{Arguments, Times};
use crate::color::Accumulation;
use crate::cpu::{Extent, Method, Positions, SplatOptions, Splats, draw};
use crate::model::{Dataset, Kernel};
use crate::synth::{Generator, clusters::Clusters, dataset};
use crate::view::{Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Error of anything that a contender may say.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Something that draws and is measured.
pub trait Contender {
    /// Its name in the results: backend, adapter or threads.
    fn name(&self) -> String;

    /// Draws column density `repeat` times, with the `S` channel or without, and says how long each drawing took,
    /// particles in memory (or in the adapter's memory) to finished accumulation.
    fn draw(&mut self, data: &Dataset, view: &View, attribute: bool, repeat: u32) -> Result<Drawn, Failure>;

    /// Whether a picture without the `S` channel is less work.
    fn has_single_channel(&self) -> bool {
        true
    }
}

/// What a contender drew.
pub struct Drawn {
    /// The picture.
    pub picture: Accumulation,
    /// The time of each drawing.
    pub times: Vec<Duration>,
    /// Median milliseconds of each pass, where there are passes.
    pub passes: BTreeMap<String, f64>,
}

/// One line of the results.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Contender.
    pub backend: String,
    /// Number of particles.
    pub particles: u64,
    /// `P` or `P and S`.
    pub channels: &'static str,
    /// Seconds for one picture.
    pub seconds: Times,
    /// Million particles per second, from the median.
    pub million_per_second: f64,
    /// Relative L1 error of `P` against the exact picture.
    pub error_l1: f64,
    /// Relative L2 error of `P`.
    pub error_l2: f64,
    /// Relative deviation of the picture's integral from the exact one's.
    pub error_sum: f64,
    /// Median milliseconds of each GPU pass.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub passes: BTreeMap<String, f64>,
}

/// The splats of a dataset's column density.
pub fn splats(data: &Dataset, attribute: bool) -> Result<Vec<Splats<'_>>, Failure> {
    data.families
        .iter()
        .map(|family| {
            let values = family.attributes.first().map(|attribute| attribute.values.as_slice());
            let extent = Extent::World(&family.smoothing_length);
            Ok(Splats::new(Positions::World(&family.positions), extent, &family.mass, values.filter(|_| attribute))?)
        })
        .collect()
}

/// The CPU renderer's name in the results.
pub fn cpu_name(threads: u16) -> String {
    format!("cpu, {threads} thread{}", if threads == 1 { "" } else { "s" })
}

/// The CPU renderer on a number of threads.
struct Cpu {
    threads: u16,
    pool: rayon::ThreadPool,
    method: Method,
}

impl Cpu {
    fn new(threads: u16, method: Method) -> Result<Cpu, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build()?;
        Ok(Cpu { threads, pool, method })
    }
}

impl Contender for Cpu {
    fn name(&self) -> String {
        cpu_name(self.threads)
    }

    fn draw(&mut self, data: &Dataset, view: &View, attribute: bool, repeat: u32) -> Result<Drawn, Failure> {
        let batches = splats(data, attribute)?;
        let options = SplatOptions { method: self.method, kernel: Kernel::CubicSpline, ..SplatOptions::default() };
        Ok(self.pool.install(|| {
            // The first run pays for tables and pages of memory.
            let mut picture = draw(view, &batches, &options);
            let times = (0..repeat).map(|_| {
                let start = Instant::now();
                picture = draw(view, &batches, &options);
                start.elapsed()
            });
            Drawn { times: times.collect(), picture, passes: BTreeMap::new() }
        }))
    }
}

/// Everything that is measured.
fn contenders(arguments: &Arguments) -> Result<Vec<Box<dyn Contender>>, Failure> {
    let mut all: Vec<Box<dyn Contender>> = Vec::new();
    let wanted = |name: &str| arguments.backends.iter().any(|backend| backend == name);
    if wanted("cpu") {
        for &threads in &arguments.threads {
            all.push(Box::new(Cpu::new(threads, Method::Pyramid)?));
        }
    }
    #[cfg(feature = "viewer")]
    for backend in [crate::gpu::Backend::Compute, crate::gpu::Backend::Raster] {
        if wanted(backend.name()) {
            all.push(Box::new(super::splat_gpu::Gpu::new(backend)));
        }
    }
    Ok(all)
}

/// Measures all contenders on all sizes and prints a table to standard error.
///
/// # Errors
/// When a contender fails.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let mut outcomes = Vec::new();
    let mut contenders = contenders(arguments)?;
    let available = std::thread::available_parallelism().map_or(1, |n| n.get() as u16);
    eprintln!(
        "{:>10}  {:32} {:8} {:>9} {:>9} {:>7}  {:>8} {:>8} {:>8}",
        "particles", "backend", "channels", "median s", "fastest s", "M/s", "L1", "L2", "sum"
    );
    for &particles in &arguments.sizes {
        let generator = Clusters::new(arguments.seed, particles);
        let data = dataset(&generator);
        let bounds = generator.bounds();
        let eye = bounds.center() + DVec3::Z * bounds.size().z;
        let projection = Projection::Orthographic { height: bounds.size().y };
        let view = View::look_at(eye, bounds.center(), DVec3::Y, projection, arguments.pixels, arguments.pixels)?;
        let exact = Cpu::new(available, Method::Exact)?.draw(&data, &view, false, 0)?.picture;
        for contender in &mut contenders {
            for attribute in [false, true] {
                if !attribute && !contender.has_single_channel() {
                    continue;
                }
                let Drawn { picture, times, passes } = contender.draw(&data, &view, attribute, arguments.repeat)?;
                let seconds = Times::of(times);
                let (error_l1, error_l2) = picture.error_against(&exact);
                let outcome = Outcome {
                    backend: contender.name(),
                    particles,
                    channels: if attribute { "P and S" } else { "P" },
                    seconds,
                    million_per_second: particles as f64 / seconds.median / 1e6,
                    error_l1,
                    error_l2,
                    error_sum: picture.sum() / exact.sum() - 1.0,
                    passes,
                };
                eprintln!(
                    "{:>10}  {:32} {:8} {:>9.4} {:>9.4} {:>7.2}  {:>8.1e} {:>8.1e} {:>8.1e}",
                    outcome.particles,
                    outcome.backend,
                    outcome.channels,
                    outcome.seconds.median,
                    outcome.seconds.fastest,
                    outcome.million_per_second,
                    outcome.error_l1,
                    outcome.error_l2,
                    outcome.error_sum
                );
                if !outcome.passes.is_empty() {
                    let passes = outcome.passes.iter().map(|(name, ms)| format!("{name} {ms:.1} ms"));
                    eprintln!("{:>10}  {}", "", passes.collect::<Vec<_>>().join(", "));
                }
                outcomes.push(outcome);
            }
        }
    }
    Ok(outcomes)
}
