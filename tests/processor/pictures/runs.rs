//! Golden images of runs between their steps, by the program: paths over the particles, a surface of what moves, and a periodic box
//! whose paths cross its faces. `DEEPFIELD_BLESS=1` writes them anew; look at them before committing.

use crate::support::golden::{self, picture_at};
use crate::support::ok;
use std::path::{Path, PathBuf};

/// Draws a moment of `run.df` and compares it.
fn check(folder: &Path, name: &str, arguments: &[&str]) {
    let common = ["render", "run.df", "-o", "picture.png", "--size", "240x160", "--backend", "cpu"];
    ok(folder, &[&common[..], arguments].concat());
    golden::check(name, &picture_at(&folder.join("picture.png")));
}

fn sequence(name: &str) -> PathBuf {
    PathBuf::from(std::env::var_os("DEEPFIELD_DATA").unwrap()).join("sequences").join(name)
}

#[test]
fn a_periodic_box_has_paths_without_streaks() {
    let folder = tempfile::tempdir().unwrap();
    ok(folder.path(), &["synth", "pancake", "-n", "4096", "--steps", "6", "-o", "snap"]);
    ok(folder.path(), &["build", "snap_*", "-o", "run.df"]);
    let arguments =
        ["--mode", "paths", "--time", "a:0.7", "--ortho", "110", "--eye", "50,50,400", "--target", "50,50,50"];
    std::fs::write(folder.path().join("paths.ron"), "(paths: (of: all, level: 0, tail: 1, shape: line))").unwrap();
    check(folder.path(), "run-box-paths", &[&arguments[..], &["--config", "paths.ron"]].concat());
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn the_star_merger_has_paths_over_its_particles() {
    let folder = tempfile::tempdir().unwrap();
    ok(folder.path(), &["build", sequence("star_merger").to_str().unwrap(), "-o", "run.df"]);
    check(folder.path(), "run-merger-paths", &["--mode", "density-squared", "--time", "9.3", "--paths", "all"]);
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn the_dam_break_has_a_surface_between_steps() {
    let folder = tempfile::tempdir().unwrap();
    ok(folder.path(), &["build", sequence("dam_break").to_str().unwrap(), "-o", "run.df"]);
    check(folder.path(), "run-dam-surface", &["--mode", "isosurface", "--time", "0.61"]);
}
