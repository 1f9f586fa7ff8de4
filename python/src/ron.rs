//! Transfer functions, scenes and tours between the RON of files and the JSON that crosses over to Python; and what has names.

use crate::error::{Failure, told};
use deepfield_draw::color::colormap::ColorMap;
use deepfield_draw::color::transfer::{TransferFunction, presets};
use deepfield_draw::look::{self, OfRun, SceneFile, page_cache};
use deepfield_draw::tour::{TourFile, around_data};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::path::Path;

/// What texts are of.
#[derive(Clone, Copy)]
enum Kind {
    Transfer,
    Scene,
    Tour,
}

impl Kind {
    fn named(name: &str) -> Result<Kind, Failure> {
        match name {
            "transfer" => Ok(Kind::Transfer),
            "scene" => Ok(Kind::Scene),
            "tour" => Ok(Kind::Tour),
            _ => Err(format!("kind: found {name}, expected transfer, scene or tour").into()),
        }
    }
}

/// The JSON of a text in RON, which is checked as a file of the name `file` is.
///
/// # Errors
/// With file, line, column and field.
#[pyfunction]
pub fn json_of(kind: &str, text: &str, file: &str) -> PyResult<String> {
    let read = || -> Result<String, Failure> {
        Ok(match Kind::named(kind)? {
            Kind::Transfer => serde_json::to_string(&TransferFunction::parse(text, file)?)?,
            Kind::Scene => serde_json::to_string(&SceneFile::parse(file, text)?)?,
            Kind::Tour => serde_json::to_string(&TourFile::parse(file, text)?)?,
        })
    };
    read().map_err(told)
}

/// The text in RON of what is said in JSON, which is checked as a file is.
///
/// # Errors
/// With the field.
#[pyfunction]
pub fn ron_of(kind: &str, said: &str) -> PyResult<String> {
    let write = || -> Result<String, Failure> {
        let mut said: Value = serde_json::from_str(said)?;
        Ok(match Kind::named(kind)? {
            Kind::Transfer => of_json::<TransferFunction>(kind, &said)?.to_ron(),
            Kind::Scene => {
                let of_run = OfRun::take(&mut said)?;
                let of_before = said.pointer_mut("/film/from").map(OfRun::take).transpose()?;
                let mut scene: SceneFile = of_json(kind, &said)?;
                of_run.give(&mut scene.look);
                let before = scene.film.as_mut().and_then(|film| film.from.as_mut());
                if let Some((of_before, before)) = of_before.zip(before) {
                    of_before.give(&mut before.look);
                }
                let text = scene.text(Path::new(kind))?;
                SceneFile::parse(kind, &text)?;
                text
            }
            Kind::Tour => {
                let keyframes = said.get_mut("keyframes").and_then(Value::as_array_mut);
                let of_runs = keyframes.into_iter().flatten().map(OfRun::take).collect::<Result<Vec<_>, _>>()?;
                let mut tour: TourFile = of_json(kind, &said)?;
                let keyframes = tour.keyframes.iter_mut().zip(of_runs);
                keyframes.for_each(|(keyframe, of_run)| of_run.give(&mut keyframe.look));
                let text = tour.to_ron();
                TourFile::parse(kind, &text)?;
                text
            }
        })
    };
    write().map_err(told)
}

/// What is said in JSON, in messages about a kind of text.
fn of_json<T: DeserializeOwned>(kind: &str, said: &Value) -> Result<T, Failure> {
    look::of_json(said).map_err(|error| format!("{kind}: {error}").into())
}

/// Names of transfer functions: built in, and of files where the program has some.
#[pyfunction]
pub fn transfer_functions() -> Vec<String> {
    presets::names(presets::folder().as_deref())
}

/// The RON of a transfer function by its name or its file.
///
/// # Errors
/// The names that there are.
#[pyfunction]
pub fn transfer_function(name: &str) -> PyResult<String> {
    let found = TransferFunction::named(name, presets::folder().as_deref()).map_err(|error| told(error.into()))?;
    Ok(found.to_ron())
}

/// The RON of a tour around data, so many seconds long.
///
/// # Errors
/// Where that is no length of time.
#[pyfunction]
pub fn tour_around(seconds: f64) -> PyResult<String> {
    if !(2.0..=86_400.0).contains(&seconds) {
        return Err(told(format!("seconds: found {seconds}, expected 2 to 86400").into()));
    }
    Ok(around_data(seconds).to_ron())
}

/// Names of visualization modes.
#[pyfunction]
pub fn modes() -> Vec<&'static str> {
    deepfield_draw::modes::all().into_iter().map(|mode| mode.name).collect()
}

/// Names of colour maps and a line about each, the perceptually uniform ones first.
#[pyfunction]
pub fn color_maps() -> Vec<(&'static str, &'static str)> {
    ColorMap::all().map(|map| (map.name(), map.help())).collect()
}

/// Colours of a map at evenly spaced places: (n, 3), gamma-encoded, 0 to 1.
///
/// # Errors
/// The names that there are, or a number of colours that makes no sense.
#[pyfunction]
pub fn color_map<'py>(py: Python<'py>, name: &str, count: usize) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let unknown = || {
        let names: Vec<&str> = ColorMap::all().map(|map| map.name()).collect();
        told(format!("color_map: found {name}, expected one of {}", names.join(", ")).into())
    };
    let map = ColorMap::named(name).ok_or_else(unknown)?;
    if !(1..=1 << 20).contains(&count) {
        return Err(told(format!("count: found {count}, expected 1 to {}", 1 << 20).into()));
    }
    PyArray1::from_slice(py, map.sample(count).as_flattened()).reshape([count, 3])
}

/// An amount of memory such as `2GiB`, bytes.
///
/// # Errors
/// What was expected.
#[pyfunction]
pub fn bytes(amount: &str) -> PyResult<u64> {
    page_cache::bytes(amount).map_err(|expected| told(format!("memory: found '{amount}', {expected}").into()))
}
