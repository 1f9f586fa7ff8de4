//! Speed of reading pages: from the system's file cache to particles that can be drawn.

use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::{BuildOptions, build};
use crate::store::{PageFile, PageId};
use crate::synth::{clusters::Clusters, dataset};
use rayon::prelude::*;
use serde::Serialize;
use std::time::{Duration, Instant};

/// One line of the results.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Number of source particles.
    pub particles: u64,
    /// Particles in all nodes of the file.
    pub stored: u64,
    /// Threads.
    pub threads: u16,
    /// Size of the page file divided by the source particles.
    pub bytes_per_particle: f64,
    /// Bytes that the pages take in memory divided by the source particles.
    pub memory_per_particle: f64,
    /// Seconds to fetch the bytes of all pages.
    pub fetch: Times,
    /// Seconds to check and decode them.
    pub decode: Times,
    /// Seconds to copy as many bytes as the decoded pages have.
    pub copy: Times,
}

/// Measures all sizes on all numbers of threads and prints a table to standard error.
///
/// # Errors
/// When a file cannot be built or read.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("bench.df");
    let mut outcomes = Vec::new();
    eprintln!(
        "{:>10} {:>8} {:>8} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "particles", "threads", "B each", "fetch s", "decode s", "M/s", "GB/s out", "copy GB/s"
    );
    for &particles in &arguments.sizes {
        build(dataset(&Clusters::new(arguments.seed, particles)), &BuildOptions::default(), &path, &())?;
        let file = PageFile::open_with(&path, arguments.read)?;
        for &threads in &arguments.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build()?;
            let outcome = pool.install(|| of_file(&file, particles, threads, arguments.repeat))?;
            let rate = |amount: f64, times: &Times| amount / times.median;
            let bytes = outcome.memory_per_particle * particles as f64;
            eprintln!(
                "{particles:>10} {threads:>8} {:>8.2} {:>9.4} {:>9.4} {:>9.1} {:>9.2} {:>9.2}",
                outcome.bytes_per_particle,
                outcome.fetch.median,
                outcome.decode.median,
                rate(outcome.stored as f64 / 1e6, &outcome.decode),
                rate(bytes / 1e9, &outcome.decode),
                rate(bytes / 1e9, &outcome.copy),
            );
            outcomes.push(outcome);
        }
    }
    Ok(outcomes)
}

fn of_file(file: &PageFile, particles: u64, threads: u16, repeat: u32) -> Result<Outcome, Failure> {
    let pages = || (0..file.page_count()).into_par_iter().map(PageId);
    let (mut fetches, mut decodes, mut copies) = (Vec::new(), Vec::new(), Vec::new());
    let (mut stored, mut memory) = (0, 0);
    for _ in 0..repeat {
        let start = Instant::now();
        let bytes: Vec<_> = pages().map(|page| file.fetch_page(page)).collect::<Result<_, _>>()?;
        fetches.push(start.elapsed());
        let start = Instant::now();
        let decoded: Vec<_> = bytes.into_par_iter().map(|bytes| file.decode_page(bytes)).collect::<Result<_, _>>()?;
        decodes.push(start.elapsed());
        stored = decoded.iter().flat_map(|page| &page.nodes).map(|node| u64::from(node.particles)).sum();
        memory = decoded.iter().map(|page| page.memory()).sum();
        copies.push(copy(&decoded.iter().map(|page| page.memory() as usize).collect::<Vec<_>>()));
    }
    Ok(Outcome {
        particles,
        stored,
        threads,
        bytes_per_particle: file.bytes() as f64 / particles as f64,
        memory_per_particle: memory as f64 / particles as f64,
        fetch: Times::of(fetches),
        decode: Times::of(decodes),
        copy: Times::of(copies),
    })
}

/// Time to fill new buffers of these lengths from others: what decoding would take if it were only a copy.
fn copy(lengths: &[usize]) -> Duration {
    let from = vec![1_u8; lengths.iter().copied().max().unwrap_or(0)];
    let start = Instant::now();
    let copies: Vec<Vec<u8>> = lengths.par_iter().map(|&length| from[..length].to_vec()).collect();
    let elapsed = start.elapsed();
    std::hint::black_box(&copies);
    elapsed
}
