//! Fields in NumPy's arrays, whose axes are (time, z, y, x, component); those of time and z may be missing. In archives components may
//! have an array each, and times and places of nodes have some of one axis.

use super::axis::Axis;
use super::field::{FieldOptions, Part, Stored};
use crate::import::ImportError;
use crate::import::grid::NumpyArrays;
use crate::model::{SampleType, Unit};
use std::sync::Arc;

/// Names of arrays of components.
const COMPONENTS: [[&str; 3]; 4] =
    [["u", "v", "w"], ["U", "V", "W"], ["vx", "vy", "vz"], ["velocity_x", "velocity_y", "velocity_z"]];
/// Names of arrays of times.
const TIMES: [&str; 3] = ["time", "times", "t"];
/// Names of arrays of places along x, y and z. Degrees are none: velocities are lengths in a time.
const PLACES: [&[&str]; 3] = [&["x", "X"], &["y", "Y"], &["z", "Z", DEPTH]];
/// It counts downwards.
const DEPTH: &str = "depth";
/// What an array of vectors may be.
const VECTORS: &str =
    "axes (y, x, 2), (z, y, x, 3), (time, y, x, 2) or (time, z, y, x, 2 or 3), the last that of components";
/// What the array of a component may be.
const SCALARS: &str = "axes (y, x), (z, y, x), (time, y, x) beside an array of times, or (time, z, y, x)";

/// The shape of a field, without that of components.
struct Shape {
    times: Option<u64>,
    /// x, y, z.
    nodes: [u64; 3],
}

/// What the arrays of a file say of a field.
///
/// # Errors
/// [`ImportError`] where they are none, are not like each other, or cannot be read.
pub(super) fn stored(arrays: &NumpyArrays, options: &FieldOptions) -> Result<Stored, ImportError> {
    let names = names(arrays, &options.components)?;
    let shape = shape(arrays, &names)?;
    let [x, y, z] = shape.nodes;
    let stacked = [x, y, z.saturating_mul(shape.times.unwrap_or(1))];
    let mut sources = Vec::with_capacity(names.len());
    for name in &names {
        let channels =
            if names.len() > 1 { 1 } else { arrays.shape(name).and_then(<[u64]>::last).copied().unwrap_or(1) };
        sources.push(Arc::new(arrays.volume(name, stacked, channels)?));
    }
    let parts = |step: u64| sources.iter().map(|source| Part { source: Arc::clone(source), first: step * z }).collect();
    let steps = (0..shape.times.unwrap_or(1)).map(parts).collect();
    let mut notes = Vec::new();
    if names.iter().any(|name| !name.is_empty()) {
        notes.push(format!("velocities are {}", names.join(", ")));
    }
    let times = TIMES.iter().find(|name| matches!(arrays.shape(name), Some(&[count]) if Some(count) == shape.times));
    let times = times.map(|name| arrays.numbers(name)).transpose()?;
    let mut nodes = ["x", "y", "z"].map(|name| (name.to_owned(), Vec::new()));
    for ((own, count), names) in nodes.iter_mut().zip(shape.nodes).zip(PLACES) {
        let found = names.iter().find(|name| matches!(arrays.shape(name), Some(&[other]) if other == count));
        own.1 = match found {
            Some(name) => {
                let places = arrays.numbers(name)?;
                own.0 = (*name).to_owned();
                if *name == DEPTH {
                    notes.push("z is the depth below 0".into());
                    places.into_iter().map(|depth| -depth).collect()
                } else {
                    places
                }
            }
            None => Axis::even(0.0, 1.0, count),
        };
    }
    Ok(Stored {
        path: arrays.path().to_owned(),
        format: arrays.format().to_owned(),
        bytes: arrays.bytes(),
        steps,
        nodes,
        times,
        length_unit: Unit::default(),
        notes,
    })
}

/// What in a file looks like velocities, in words: arrays with the names of components, or floating-point numbers by twos or threes. `None` where
/// nothing does, and where one array of several is named.
pub(super) fn velocities(arrays: &NumpyArrays) -> Option<String> {
    if arrays.part().is_some() {
        return None;
    }
    let has = |name: &str| arrays.shape(name).is_some();
    if let Some([u, v, _]) = COMPONENTS.into_iter().find(|[u, v, _]| has(u) && has(v)) {
        return Some(format!("{u} and {v} have the names of components"));
    }
    // Whole numbers are rather colours.
    let is_field = |name: &str, shape: &[u64]| {
        vectors(shape).is_some() && arrays.sample_type(name).is_some_and(SampleType::is_float)
    };
    let (_, shape) = arrays.shapes().find(|(name, shape)| is_field(name, shape))?;
    shape.last().map(|components| format!("its last axis has {components} values, as vectors have"))
}

/// The arrays that hold velocities: one of vectors, or those of components.
fn names(arrays: &NumpyArrays, wanted: &[String]) -> Result<Vec<String>, ImportError> {
    let has = |name: &str| arrays.shape(name).is_some();
    if let [_, .., _] = wanted {
        return match wanted.iter().find(|name| !has(name)) {
            Some(missing) => Err(arrays.missing(missing)),
            None => Ok(wanted.to_vec()),
        };
    }
    if let Some(name) = wanted.first().map(String::as_str).or(arrays.part()) {
        return if has(name) { Ok(vec![name.to_owned()]) } else { Err(arrays.missing(name)) };
    }
    if let Some([u, v, w]) = COMPONENTS.into_iter().find(|[u, v, _]| has(u) && has(v)) {
        return Ok([u, v].into_iter().chain(Some(w).filter(|w| has(w))).map(str::to_owned).collect());
    }
    let is_field = |shape: &[u64]| vectors(shape).is_some();
    let mut fields = arrays.shapes().filter(|(_, shape)| is_field(shape)).map(|(name, _)| name);
    match (fields.next(), fields.next(), arrays.shapes().next()) {
        (Some(only), None, _) => Ok(vec![only.to_owned()]),
        // The only one of a file says what it is.
        (None, _, Some(("", _))) => Err(arrays.wrong_shape("", VECTORS)),
        _ => {
            let all: Vec<&str> = arrays.shapes().map(|(name, _)| name).collect();
            let expected = "u and v, one array of vectors, or --components";
            Err(ImportError::malformed(arrays.path(), "arrays", all.join(", "), expected))
        }
    }
}

/// The shape that the arrays have together.
fn shape(arrays: &NumpyArrays, names: &[String]) -> Result<Shape, ImportError> {
    let of = |name: &str| arrays.shape(name).ok_or_else(|| arrays.missing(name));
    let [first, others @ ..] = names else { return Err(arrays.missing("u")) };
    let own = of(first)?;
    if others.is_empty() {
        return vectors(own).ok_or_else(|| arrays.wrong_shape(first, VECTORS));
    }
    for other in others {
        if of(other)? != own {
            return Err(arrays.wrong_shape(other, &format!("the shape of {first}")));
        }
    }
    let has_times =
        TIMES.iter().any(|name| matches!(arrays.shape(name), Some(&[count]) if Some(&count) == own.first()));
    match *own {
        [y, x] => Ok(Shape { times: None, nodes: [x, y, 1] }),
        [t, y, x] if has_times => Ok(Shape { times: Some(t), nodes: [x, y, 1] }),
        [z, y, x] => Ok(Shape { times: None, nodes: [x, y, z] }),
        [t, z, y, x] => Ok(Shape { times: Some(t), nodes: [x, y, z] }),
        _ => Err(arrays.wrong_shape(first, SCALARS)),
    }
}

/// The shape of an array of vectors.
fn vectors(shape: &[u64]) -> Option<Shape> {
    match *shape {
        [y, x, 2] => Some(Shape { times: None, nodes: [x, y, 1] }),
        [z, y, x, 3] => Some(Shape { times: None, nodes: [x, y, z] }),
        [t, y, x, 2] => Some(Shape { times: Some(t), nodes: [x, y, 1] }),
        [t, z, y, x, 2 | 3] => Some(Shape { times: Some(t), nodes: [x, y, z] }),
        _ => None,
    }
}
