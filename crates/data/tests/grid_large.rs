//! Grids larger than the memory that a build may take: how much it takes, and how long.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::build::grid::{GridBuildOptions, build_grid};
use deepfield_data::import::{GridOptions, open_grid};
use deepfield_data::store::grid::verify_grid;
use deepfield_data::synth::grid_files;
use deepfield_data::synth::grids::{Kind, SyntheticGrid};
use std::time::Instant;

/// The most memory that this process has held, bytes, where the system says so.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? << 10)
}

/// Builds a grid in `memory` bytes, and checks that it does.
fn built(dimensions: usize, shape: [u64; 3], memory: u64) {
    let folder = tempfile::tempdir().unwrap();
    let [source, output] = ["blobs.nrrd", "blobs.df"].map(|name| folder.path().join(name));
    let begin = Instant::now();
    grid_files::write(&SyntheticGrid::new(Kind::Blobs, dimensions, shape, 1), &source, &()).unwrap();
    println!("{shape:?}: made in {:.1} s, peak {} MiB", begin.elapsed().as_secs_f64(), peak().unwrap_or(0) >> 20);
    let begin = Instant::now();
    let opened = open_grid(&source, &GridOptions::default()).unwrap();
    let options = GridBuildOptions { memory: Some(memory), ..GridBuildOptions::default() };
    build_grid(&opened, &options, &output, &()).unwrap();
    let bytes = std::fs::metadata(&output).unwrap().len();
    println!(
        "built in {:.1} s, {} MiB, peak {} MiB",
        begin.elapsed().as_secs_f64(),
        bytes >> 20,
        peak().unwrap_or(0) >> 20
    );
    let begin = Instant::now();
    verify_grid(&output, &()).unwrap();
    println!("verified in {:.1} s, peak {} MiB", begin.elapsed().as_secs_f64(), peak().unwrap_or(0) >> 20);
    assert!(peak().is_none_or(|peak| peak <= memory + memory / 10));
}

#[test]
#[ignore = "takes long: half an hour on two cores"]
fn a_large_volume_is_built_in_a_gibibyte() {
    let side: u64 = std::env::var("DEEPFIELD_SIDE").map_or(1024, |side| side.parse().unwrap());
    built(3, [side; 3], 1 << 30);
}

#[test]
#[ignore = "takes long: half an hour on two cores"]
fn a_large_image_is_built_in_a_gibibyte() {
    let side: u64 = std::env::var("DEEPFIELD_SIDE").map_or(32768, |side| side.parse().unwrap());
    built(2, [side, side, 1], 1 << 30);
}
