//! The folder of pages that servers have sent holds what `DEEPFIELD_CACHE` says.

use super::{served, sound};
use crate::support::fault_server::Fault;
use crate::support::program;
use std::path::Path;

/// Bytes of all files below a folder.
fn held(folder: &Path) -> u64 {
    let of_entry = |entry: std::fs::DirEntry| match entry.file_type().unwrap().is_dir() {
        true => held(&entry.path()),
        false => entry.metadata().unwrap().len(),
    };
    std::fs::read_dir(folder).into_iter().flatten().map(|entry| of_entry(entry.unwrap())).sum()
}

#[test]
fn pages_are_kept_within_the_budget_that_is_stated() {
    const BUDGET: u64 = 500_000;
    let (folder, server) = (tempfile::tempdir().unwrap(), served());
    let url = server.url("sound.df");
    let run = |budget: &str, arguments: &[&str]| {
        let mut command = program();
        command.args(arguments).current_dir(folder.path());
        let cache = folder.path().join(format!("cache-{budget}"));
        let output = command.env("XDG_CACHE_HOME", &cache).env("DEEPFIELD_CACHE", budget).output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{arguments:?}: {told}");
        (held(&cache.join("deepfield/pages")), told)
    };
    // How many requests a picture of all particles takes, what is kept then, and the picture.
    let read = |budget: &str| {
        let before = server.asked().len();
        let picture = ["--error-px", "0.01", "--size", "64x48", "--backend", "cpu", "-o", "picture.png"];
        let (kept, _) = run(budget, &[&["render", &url][..], &picture[..]].concat());
        (server.asked().len() - before, kept, std::fs::read(folder.path().join("picture.png")).unwrap())
    };
    let [first, again] = ["1GB"; 2].map(read);
    assert!(first.1 > 2 * BUDGET, "{} of {} bytes are kept: too few for this test", first.1, sound().len());
    assert!(first.0 > again.0 && again.0 == 2 && again.1 == first.1, "{} requests, then {}", first.0, again.0);
    let narrow = BUDGET.to_string();
    for _ in 0..2 {
        let (requests, kept, picture) = read(&narrow);
        assert!(kept > 0 && kept <= BUDGET, "{kept} bytes are kept");
        assert!(requests > 2 && picture == first.2, "{requests} requests");
    }
    // How the file begins and ends makes room last: with that the rest is of use without a network, too.
    server.answer(|_| Fault::Cut);
    assert!(run(&narrow, &["info", &url]).1.contains("what was read of it before is shown"));
}
