//! Import and build speed on a generated Gadget snapshot.

use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::{BuildOptions, build};
use crate::codec::VqBits;
use crate::import::{DEFAULT_NEIGHBOURS, LoadOptions, Smoothing, load};
use crate::synth::{clusters::Clusters, gadget};
use serde::Serialize;
use std::io::Write;
use std::time::{Duration, Instant};

/// One line of the results.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Number of particles.
    pub particles: u64,
    /// Threads.
    pub threads: u16,
    /// Seconds to bring the snapshot into memory (from the system's file cache).
    pub import: Times,
    /// Seconds to bring it into memory with smoothing lengths from 32 neighbours in place of its own.
    pub neighbours: Times,
    /// Seconds to build and write the page file from memory.
    pub build: Times,
    /// Million particles per second, import and build together.
    pub million_per_second: f64,
    /// The same where smoothing lengths come from neighbours.
    pub million_per_second_neighbours: f64,
    /// Size of the page file divided by the particles.
    pub bytes_per_particle: f64,
}

/// Measures all sizes on all numbers of threads and prints a table to standard error.
///
/// # Errors
/// When a file cannot be written, read or built.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let folder = tempfile::tempdir()?;
    let mut outcomes = Vec::new();
    eprintln!(
        "{:>10} {:>8} {:>9} {:>9} {:>7} {:>9} {:>7} {:>7}",
        "particles", "threads", "import s", "build s", "M/s", "with knn", "M/s", "bytes"
    );
    for &particles in &arguments.sizes {
        let source = folder.path().join("snapshot");
        let mut out = std::io::BufWriter::new(std::fs::File::create(&source)?);
        gadget::write(&Clusters::new(arguments.seed, particles), &mut out, &())?;
        out.flush()?;
        for &threads in &arguments.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build()?;
            let (mut imports, mut searches, mut builds, mut bytes) = (Vec::new(), Vec::new(), Vec::new(), 0);
            for _ in 0..arguments.repeat {
                let once = pool.install(|| once(&source, &folder.path().join("out.df")))?;
                imports.push(once.import);
                searches.push(once.neighbours);
                builds.push(once.build);
                bytes = once.bytes;
            }
            let (import, neighbours, build) = (Times::of(imports), Times::of(searches), Times::of(builds));
            let speed = |import: &Times| particles as f64 / (import.median + build.median) / 1e6;
            let (million_per_second, million_per_second_neighbours) = (speed(&import), speed(&neighbours));
            let bytes_per_particle = bytes as f64 / particles as f64;
            eprintln!(
                "{particles:>10} {threads:>8} {:>9.3} {:>9.3} {million_per_second:>7.2} {:>9.3} {:>7.2} {:>7.1}",
                import.median, build.median, neighbours.median, million_per_second_neighbours, bytes_per_particle
            );
            outcomes.push(Outcome {
                particles,
                threads,
                import,
                neighbours,
                build,
                million_per_second,
                million_per_second_neighbours,
                bytes_per_particle,
            });
        }
    }
    Ok(outcomes)
}

/// One run.
struct Once {
    import: Duration,
    neighbours: Duration,
    build: Duration,
    bytes: u64,
}

fn once(source: &std::path::Path, out: &std::path::Path) -> Result<Once, Failure> {
    let start = Instant::now();
    let smoothing = Smoothing::Knn(DEFAULT_NEIGHBOURS);
    drop(load(source, &LoadOptions { smoothing, ..LoadOptions::default() }, &())?);
    let neighbours = start.elapsed();
    let start = Instant::now();
    let data = load(source, &LoadOptions::default(), &())?;
    let import = start.elapsed();
    let built = build(data, &BuildOptions::with_vq_bits(VqBits::default()), out, &())?;
    Ok(Once { import, neighbours, build: start.elapsed() - import, bytes: built.bytes })
}
