//! Fields for tests, from files, and whoever keeps what is told of them.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::session::SurfaceSession;
use crate::look::HeightsSaid;
use crate::model::{Progress, Unit};
use crate::picture::SessionOptions;
use crate::picture::session::Reporter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Keeps what it is told.
#[derive(Default)]
pub(super) struct Told(pub(super) Mutex<Vec<String>>);

impl Reporter for Told {
    fn tell(&self, message: String) {
        self.0.lock().unwrap().push(message);
    }

    fn progress(&self) -> Box<dyn Progress + '_> {
        Box::new(())
    }
}

/// A field of heights in metres as text, its first sample at the lowest x and y.
pub(in crate::picture) fn field(
    folder: &Path,
    name: &str,
    [columns, rows]: [usize; 2],
    corner: [f64; 2],
    step: f64,
    height: impl Fn(f64, f64) -> f64,
) -> PathBuf {
    let mut text =
        format!("ncols {columns}\nnrows {rows}\nxllcenter {}\nyllcenter {}\ncellsize {step}\n", corner[0], corner[1]);
    // From north to south.
    for row in (0..rows).rev() {
        let line = (0..columns).map(|column| height(corner[0] + column as f64 * step, corner[1] + row as f64 * step));
        text += &line.map(|height| format!("{height:.6}")).collect::<Vec<_>>().join(" ");
        text += "\n";
    }
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// An open field whose heights are those of places, its first sample at the lowest x and y, in metres over places in this unit.
pub(super) fn opened(
    unit: &str,
    size: [usize; 2],
    corner: [f64; 2],
    step: f64,
    height: impl Fn(f64, f64) -> f64,
) -> SurfaceSession {
    let folder = tempfile::tempdir().unwrap();
    let path = field(folder.path(), "field.asc", size, corner, step, height);
    let said =
        HeightsSaid { xy_unit: Some(Unit::new(unit)), height_unit: Some(Unit::new("m")), ..HeightsSaid::default() };
    SurfaceSession::open(&path, &said, SessionOptions::default(), Arc::new(())).unwrap()
}
