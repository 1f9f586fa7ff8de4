//! The folder of pages that servers have sent holds what `DEEPFIELD_CACHE` says.

use super::{served, sound};
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
    let folder = tempfile::tempdir().unwrap();
    let server = served();
    // What a picture of all particles reads; how many requests that took, and what is kept then.
    let read = |budget: &str, cache: &str| {
        let cache = folder.path().join(cache);
        let before = server.asked().len();
        let mut render = program();
        render.args(["render", &server.url("sound.df"), "--exact", "--size", "64x48", "--backend", "cpu"]);
        render.args(["-o", "picture.png"]).current_dir(folder.path());
        let output = render.env("XDG_CACHE_HOME", &cache).env("DEEPFIELD_CACHE", budget).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let picture = std::fs::read(folder.path().join("picture.png")).unwrap();
        (server.asked().len() - before, held(&cache.join("deepfield/pages")), picture)
    };
    let [first, again] = [0, 1].map(|_| read("1GB", "roomy"));
    assert!(first.1 > 2 * BUDGET, "{} of {} bytes are kept: too few for this test", first.1, sound().len());
    assert!(first.0 > again.0 && again.0 == 2 && again.1 == first.1, "{} requests, then {}", first.0, again.0);
    let budget = BUDGET.to_string();
    for _ in 0..2 {
        let (requests, kept, picture) = read(&budget, "narrow");
        // Room is made each time that a sixteenth of it was written.
        assert!(kept > 0 && kept <= BUDGET + BUDGET / 16, "{kept} bytes are kept");
        assert!(requests > 2 && picture == first.2, "{requests} requests");
    }
}
