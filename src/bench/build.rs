//! Build speed on a generated Gadget snapshot: from the source to a page file.

use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::{BuildOptions, Built, build_source};
use crate::import::{DEFAULT_NEIGHBOURS, LoadOptions, Smoothing};
use crate::synth::{clusters::Clusters, gadget};
use serde::Serialize;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

/// One line of the results.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Number of particles.
    pub particles: u64,
    /// Threads.
    pub threads: u16,
    /// Seconds from the snapshot (in the system's file cache) to the page file.
    pub build: Times,
    /// The same with plain codes of leaves.
    pub plain: Times,
    /// The same with smoothing lengths from 32 neighbours in place of the source's own.
    pub neighbours: Times,
    /// Million particles per second.
    pub million_per_second: f64,
    /// The same where smoothing lengths come from neighbours.
    pub million_per_second_neighbours: f64,
    /// Size of the page file divided by the particles.
    pub bytes_per_particle: f64,
    /// Most bytes of temporary files.
    pub temporary_bytes: u64,
}

/// Measures all sizes on all numbers of threads and prints a table to standard error.
///
/// # Errors
/// When a file cannot be written, read or built.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let folder = tempfile::tempdir()?;
    let mut outcomes = Vec::new();
    eprintln!(
        "{:>10} {:>8} {:>9} {:>7} {:>9} {:>9} {:>7} {:>7} {:>9}",
        "particles", "threads", "build s", "M/s", "plain s", "with knn", "M/s", "bytes", "temp MiB"
    );
    for &particles in &arguments.sizes {
        let source = folder.path().join("snapshot");
        let mut out = std::io::BufWriter::new(std::fs::File::create(&source)?);
        gadget::write(&Clusters::new(arguments.seed, particles), &mut out, &())?;
        out.flush()?;
        for &threads in &arguments.threads {
            let run = |smoothing: Smoothing, refined: bool| {
                let mut options = BuildOptions {
                    memory: arguments.memory,
                    threads: Some(threads.into()),
                    read: arguments.read,
                    ..BuildOptions::default()
                };
                options.octree.refined = refined;
                once(&source, &folder.path().join("out.df"), smoothing, &options)
            };
            let (mut builds, mut plain, mut searches) = (Vec::new(), Vec::new(), Vec::new());
            let (mut bytes, mut temporary_bytes) = (0, 0);
            for _ in 0..arguments.repeat {
                let (seconds, built) = run(Smoothing::Auto, true)?;
                builds.push(seconds);
                (bytes, temporary_bytes) = (built.bytes, built.temporary_bytes);
                plain.push(run(Smoothing::Auto, false)?.0);
                searches.push(run(Smoothing::Knn(DEFAULT_NEIGHBOURS), true)?.0);
            }
            let [build, plain, neighbours] = [builds, plain, searches].map(Times::of);
            let speed = |times: &Times| particles as f64 / times.median / 1e6;
            let (million_per_second, million_per_second_neighbours) = (speed(&build), speed(&neighbours));
            let bytes_per_particle = bytes as f64 / particles as f64;
            eprintln!(
                "{particles:>10} {threads:>8} {:>9.3} {million_per_second:>7.2} {:>9.3} {:>9.3} {million_per_second_neighbours:>7.2} {bytes_per_particle:>7.2} {:>9}",
                build.median,
                plain.median,
                neighbours.median,
                temporary_bytes >> 20
            );
            outcomes.push(Outcome {
                particles,
                threads,
                build,
                plain,
                neighbours,
                million_per_second,
                million_per_second_neighbours,
                bytes_per_particle,
                temporary_bytes,
            });
        }
    }
    Ok(outcomes)
}

fn once(source: &Path, out: &Path, smoothing: Smoothing, options: &BuildOptions) -> Result<(Duration, Built), Failure> {
    let start = Instant::now();
    let built = build_source(source, &LoadOptions { smoothing, ..LoadOptions::default() }, options, out, &())?;
    Ok((start.elapsed(), built))
}
