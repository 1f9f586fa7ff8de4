//! Particles in velocity fields: paths against closed ones and against finer integrations of the same field, ends and beginnings where
//! they should be, the same for any number of threads, and damaged files as errors of one line.

#![allow(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

mod ends;
mod files;
mod paths;
mod reference;

use deepfield_data::import::vector_field::{TraceOptions, trace};
use deepfield_data::import::{FieldKind, Run, RunStep};
use deepfield_data::model::{Bounds, ReadMethod};
use glam::DVec3;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// An array as NumPy writes it.
fn npy(shape: &[usize], values: &[f64], is_double: bool) -> Vec<u8> {
    let kind = if is_double { "<f8" } else { "<f4" };
    let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", sides.trim_end());
    text += &" ".repeat((10 + text.len() + 1).next_multiple_of(64) - 11 - text.len());
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(((text.len() + 1) as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.push(b'\n');
    for value in values {
        match is_double {
            true => bytes.extend(value.to_le_bytes()),
            false => bytes.extend((*value as f32).to_le_bytes()),
        }
    }
    bytes
}

fn npz(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, array) in arrays {
        archive.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(array).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// The nodes of a box that both ends belong to, or a period without its end: (z, y, x).
fn nodes(shape: [usize; 3], from: [f64; 3], to: [f64; 3], is_periodic: bool) -> Vec<[f64; 3]> {
    let along = |axis: usize, node: usize| {
        let cells = if is_periodic { shape[axis] } else { shape[axis].max(2) - 1 };
        from[axis] + (to[axis] - from[axis]) * node as f64 / cells as f64
    };
    let mut all = Vec::new();
    for z in 0..shape[2] {
        for y in 0..shape[1] {
            all.extend((0..shape[0]).map(|x| [along(0, x), along(1, y), along(2, z)]));
        }
    }
    all
}

fn bounds(from: [f64; 3], to: [f64; 3]) -> Option<Bounds> {
    Some(Bounds { min: from.into(), max: to.into() })
}

fn traced(path: &Path, options: &TraceOptions) -> Result<Run, String> {
    trace(&[path.to_owned()], options, ReadMethod::default(), &()).map_err(|error| error.to_string())
}

/// Places by id.
fn places(step: &RunStep) -> BTreeMap<u64, [f64; 3]> {
    let source = step.open(ReadMethod::default()).unwrap();
    let info = &source.description().families[0];
    let column = |kind: FieldKind| {
        let field = info.find(kind).unwrap();
        let mut values = vec![0.0; info.count as usize * info.fields[field].components];
        source.read(0, field, 0..info.count, &mut values).unwrap();
        values
    };
    let mut ids = vec![0; info.count as usize];
    source.read_ids(0, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut ids).unwrap();
    ids.into_iter().zip(column(FieldKind::Position).as_chunks::<3>().0.iter().copied()).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (DVec3::from(a) - DVec3::from(b)).length()
}
