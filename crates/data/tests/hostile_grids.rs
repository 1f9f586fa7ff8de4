//! Files of images and volumes that were cut or changed at random: an error of one line or a grid, never a panic, and no more memory than
//! the file's size allows.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![allow(unsafe_code, reason = "an allocator that counts is unsafe to write")]

use counting::counted;
use deepfield_data::import::{GridOptions, ImportError, open_grid, summarize_grid};
use files::Case;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::path::Path;

#[allow(dead_code, reason = "tests inside the package use more of it")]
#[path = "../src/import/grid/tests/array_files.rs"]
mod array_files;
#[path = "support/counting.rs"]
mod counting;
#[path = "../src/import/grid/tests/exr_files.rs"]
mod exr_files;
#[allow(dead_code, reason = "tests inside the package use more of it")]
#[path = "../src/import/grid/tests/files.rs"]
mod files;
#[allow(dead_code, reason = "tests inside the package use more of it")]
#[path = "../src/import/grid/tests/more_files.rs"]
mod more_files;

/// Where those find the types that they name.
mod model {
    pub use deepfield_data::model::SampleType;
}

/// Buffers of a fixed size, and what deflate can make of the file, four times.
fn most(bytes: usize) -> usize {
    (64 << 20) + 4 * 1040 * bytes
}

/// Opens the file and reads all of it. What is said of a file that cannot be.
fn read(folder: &Path, case: &Case, bytes: &[u8]) -> Option<String> {
    let path = folder.join(case.name);
    std::fs::write(&path, bytes).unwrap();
    let (result, took) = counted(|| {
        let source = open_grid(&path, &GridOptions::default())?;
        let summary = summarize_grid(&source)?;
        let samples: u64 = summary.shape.iter().product();
        for channel in &summary.channels {
            let finite: u64 = channel.histogram.iter().sum();
            assert_eq!(finite + channel.nan + channel.infinite + channel.no_data, samples, "{}", case.name);
        }
        Ok::<_, ImportError>(())
    });
    assert!(took <= most(bytes.len()), "{}: {took} bytes of memory for {} of a file", case.name, bytes.len());
    let text = result.err()?.to_string();
    assert!(!text.contains('\n') && text.contains(&*folder.to_string_lossy()), "{}: {text}", case.name);
    Some(text)
}

#[test]
fn damage_is_an_error_or_a_grid_and_takes_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut random = Pcg32::seed_from_u64(20);
    for case in files::every() {
        for (name, bytes) in &case.beside {
            std::fs::write(folder.join(name), bytes).unwrap();
        }
        assert_eq!(read(folder, &case, &case.bytes), None);
        for part in 0..16 {
            read(folder, &case, &case.bytes[..case.bytes.len() * part / 16]);
        }
        for round in 0..32 {
            let mut bytes = case.bytes.clone();
            let among = if round % 2 == 0 { bytes.len() } else { bytes.len().min(600) };
            for _ in 0..1 + random.next_u32() % 8 {
                let at = random.next_u32() as usize % among;
                // Numbers as large as can be are what sizes are made of.
                bytes[at] = if random.next_u32().is_multiple_of(4) { 0xff } else { random.next_u32() as u8 };
            }
            read(folder, &case, &bytes);
        }
    }
}
