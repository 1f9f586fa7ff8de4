//! Import across formats: what is written comes back, real files give their known numbers, damaged ones a clear error.

mod compressed;
mod endings;
mod expansion;
mod folders;
mod gadget;
mod generic_io;
mod hdf5;
mod hostile;
mod las;
mod light_cones;
mod nchilada;
mod openpmd;
mod others;
mod phantom;
mod ply;
mod ramses;
mod reference;
mod tables;
mod tipsy;
mod vtk_points;
mod writers;

use crate::support::in_repository;
use deepfield::import::{ImportError, Source};
use std::path::{Path, PathBuf};

/// A file of `tests/data`.
fn data(name: &str) -> PathBuf {
    in_repository("tests/data").join(name)
}

/// Every value of the field `name` of family `family`, read in ranges of `step` particles.
fn read_all(source: &dyn Source, family: usize, name: &str, step: u64) -> Vec<f64> {
    let info = &source.description().families[family];
    let field = info.named(name).unwrap_or_else(|| panic!("no field {name} in {:?}", info.fields));
    let components = info.fields[field].components;
    let mut all = Vec::new();
    for start in (0..info.count).step_by(step as usize) {
        let range = start..info.count.min(start + step);
        let mut values = vec![f64::NAN; (range.end - range.start) as usize * components];
        source.read(family, field, range, &mut values).unwrap();
        all.extend(values);
    }
    all
}

/// The error's text, after a look at whether it is one line that names the file.
fn message(error: &ImportError, path: &Path) -> String {
    let text = error.to_string();
    assert!(!text.contains(['\n', '\r']), "{text}");
    let stem = path.file_name().unwrap().to_string_lossy();
    let stem = stem.split('.').next().unwrap();
    assert!(text.contains(stem), "{text} does not name {stem}");
    text
}
