//! Every format against what was written, against real files, and against damage.

mod files;
pub(super) mod hostile;
mod more_written;
mod raw;
mod real;
mod summary;
mod written;

use super::{HeightOptions, HeightSource, open_heights};
use crate::model::{Heights, Window};
use std::path::{Path, PathBuf};

/// Opens a file without anything said.
pub(super) fn open(path: &Path) -> HeightSource {
    open_heights(path, &HeightOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// A file of these bytes in a folder of its own, which goes with the first.
pub(super) fn file_of(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// What is said of a file of these bytes that is refused, without its folder.
pub(super) fn refusal(name: &str, bytes: &[u8], options: &HeightOptions) -> String {
    let (folder, path) = file_of(name, bytes);
    let text = match open_heights(&path, options) {
        Ok(source) => super::summarize_heights(&source).unwrap_err().to_string(),
        Err(error) => error.to_string(),
    };
    assert!(!text.contains('\n'), "{text}");
    text.replace(&format!("{}/", folder.path().display()), "")
}

/// All heights; NaN where nothing was measured.
pub(super) fn heights(source: &HeightSource) -> Vec<f64> {
    let window = Window::all(source.grid());
    let mut out = vec![0.0; window.samples() as usize];
    source.heights(window, &mut out).unwrap();
    out
}

/// All values of a plane.
pub(super) fn plane(source: &HeightSource, plane: usize) -> Vec<u8> {
    let window = Window::all(source.grid());
    let mut out = vec![0; window.samples() as usize];
    source.plane(plane, window, &mut out).unwrap();
    out
}

/// Whether these are the same numbers, or none in the same places.
pub(super) fn same(found: &[f64], expected: &[f64], relative: f64) -> bool {
    let close = |(a, b): (&f64, &f64)| (a.is_nan() && b.is_nan()) || (a - b).abs() <= relative * b.abs();
    found.len() == expected.len() && found.iter().zip(expected).all(close)
}

/// Under the names that `info` tells.
#[test]
fn the_tables_of_formats_in_the_documentation_name_each_of_them() {
    let pages = [include_str!("../../../../../docs/formats.md"), include_str!("../../../../../docs/heights.md")];
    for (page, text) in ["formats.md", "heights.md"].iter().zip(pages) {
        for format in super::FORMATS {
            let name = format!("`{}`", format.name);
            let is_row =
                |line: &str| line.starts_with('|') && line.split('|').nth(2).is_some_and(|cell| cell.contains(&name));
            assert!(text.lines().any(is_row), "{page}: no row of {name}");
        }
    }
}
