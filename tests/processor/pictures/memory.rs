//! What `render` and `tour` take of memory, as Linux counts it, where there is little for pages: no more than they say that it takes, and the
//! pictures are the same.

use crate::support::golden::{difference, picture_at};
use crate::support::{kept_page_file, peak_memory, program};
use deepfield::build::{BuildOptions, build};
use deepfield::synth::{clusters::Clusters, dataset};
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

const MEBIBYTE: u64 = 1 << 20;
/// Less than the file's pages take, and enough for everything.
const MEMORIES: [&str; 2] = ["1MiB", "1GiB"];

/// Runs the program in a folder to its end: the most memory that it took, bytes, and what it said.
fn run(folder: &Path, arguments: &[&str]) -> (u64, String) {
    let mut command = program();
    // Each thread keeps memory of its own: as many as a small machine has.
    command.args(arguments).current_dir(folder).env("XDG_CACHE_HOME", folder).env("RAYON_NUM_THREADS", "2");
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut peak = 0;
    let status = loop {
        peak = peak.max(peak_memory(child.id()).unwrap_or(0));
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let said = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    assert!(status.success(), "{arguments:?}: {said}");
    (peak, said)
}

/// Draws 400 000 particles with little memory and with enough. The first keeps to what it says that it takes, which is less than the second
/// takes by `saved` bytes at least, and `picture` is the same.
fn keeps_to_what_it_says(arguments: &[&str], picture: &str, saved: u64) {
    let folder = tempfile::tempdir().unwrap();
    let kept = kept_page_file("clusters-of-400000", |path| {
        build(dataset(&Clusters::new(1, 400_000)), &BuildOptions::default(), path, &()).unwrap();
    });
    std::fs::write(folder.path().join("clusters.df"), kept).unwrap();
    std::fs::write(folder.path().join("orbit.ron"), ORBIT).unwrap();
    let [(little, said, coarse), (enough, silent, whole)] = MEMORIES.map(|memory| {
        let own = folder.path().join(memory);
        std::fs::create_dir(&own).unwrap();
        let (peak, said) = run(&own, &[arguments, &["--memory", memory]].concat());
        (peak, said, picture_at(&own.join(picture)))
    });
    let words = "a picture of this size takes ";
    let taken = said.split(words).nth(1).and_then(|rest| rest.split(" MiB").next());
    let taken = taken.and_then(|mebibytes| mebibytes.parse::<u64>().ok()).unwrap_or_else(|| panic!("{said}"));
    println!("{arguments:?}: {little} bytes at the peak, {taken} MiB said, {enough} bytes with enough");
    assert!(!silent.contains(words), "{silent}");
    assert!(little > 0 && little <= taken * MEBIBYTE, "{little} bytes at the peak, {taken} MiB said");
    assert!(little + saved <= enough, "{little} bytes at the peak, {enough} with enough memory");
    assert!(difference(&coarse, &whole) < 0.02, "{}", difference(&coarse, &whole));
}

/// Two frames of a volume.
const ORBIT: &str = r#"(
    version: 1,
    size: (48, 32),
    rate: 2.0,
    keyframes: [(mode: "volume", error_px: 0.05), (after: 0.5, orbit: 10.0)],
)"#;

const RENDER: [&str; 10] =
    ["render", "../clusters.df", "-o", "a.png", "--backend", "cpu", "--size", "48x32", "--error-px", "0.05"];

#[test]
fn sums_keep_to_the_memory_that_they_say() {
    keeps_to_what_it_says(&[&RENDER[..], &["--mode", "column-density"]].concat(), "a.png", 0);
}

#[test]
fn volumes_keep_to_the_memory_that_they_say() {
    // All particles at once take some 20 MiB more.
    keeps_to_what_it_says(&[&RENDER[..], &["--mode", "volume"]].concat(), "a.png", 8 * MEBIBYTE);
}

#[test]
fn tours_keep_to_the_memory_that_they_say() {
    let tour = ["tour", "../orbit.ron", "../clusters.df", "--record", "frames"];
    keeps_to_what_it_says(&tour, "frames/frame-00001.png", 8 * MEBIBYTE);
}
