//! Catalogues of named objects as arrays of NumPy.

use crate::asked::read_asked;
use crate::error::Failure;
use crate::work;
use deepfield_draw::build::default_memory;
use deepfield_draw::explore::{Catalogue, MergerTree, Object};
use deepfield_draw::import::file_in;
use deepfield_draw::model::{Unit, When};
use deepfield_draw::picture::asked::State;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is asked of a catalogue.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct AskedCatalogue {
    /// When, of one of several steps.
    time: Option<String>,
    /// The columns beside names; all where nothing is said.
    fields: Option<Vec<String>>,
    /// Bytes that those of the file's own may take.
    memory: Option<u64>,
}

impl AskedCatalogue {
    /// Reads it.
    ///
    /// # Errors
    /// When it cannot be read, has no such columns, or none of the time that is asked for.
    fn read(&self, path: &Path) -> Result<Catalogue, Failure> {
        let Some(time) = &self.time else {
            let memory = self.memory.unwrap_or_else(default_memory);
            return Ok(Catalogue::read_whole(path, self.fields.as_deref(), memory)?);
        };
        let path = file_in(path, &[])?;
        let wrong = |reason: &str| format!("{}: time: {reason}", path.display());
        let expected = "trees, a table with ids, steps and descendants, or catalogues with links beside them";
        let one = || wrong(&format!("found one step, expected {expected}"));
        let tree = MergerTree::of_series(&path)?.ok_or_else(one)?;
        let times = tree.times();
        let moment = times.moment(time.parse::<When>()?).map_err(|reason| wrong(&reason))?;
        let time = times.time(moment);
        Ok(Catalogue::of_tree(Arc::new(tree), Some(time))?)
    }

    /// Whether a column is asked for.
    fn wants(&self, name: &str) -> bool {
        let is_axis = matches!(name, "x" | "y" | "z");
        let is_asked = |field: &String| field == name || (is_axis && field == "position");
        self.fields.as_ref().is_none_or(|fields| fields.iter().any(is_asked))
    }
}

/// What stands before the number in a name, of all objects which of these they have, and their numbers.
type Numbered = (Vec<String>, Vec<u16>, Vec<u64>);

/// The most words before numbers; haloes have one or two.
const MOST_KINDS: usize = 16;

/// The numbers in the names of a catalogue whose names are such: `Group 0`, `Subhalo 12`.
fn numbered(catalogue: &Catalogue) -> Option<Numbered> {
    // Names of others are what somebody wrote.
    if matches!(catalogue.format, "csv" | "ron") {
        return None;
    }
    let (mut kinds, mut kind, mut ids) = (Vec::<String>::new(), Vec::new(), Vec::new());
    for Object { name, .. } in &catalogue.objects {
        let (word, number) = name.rsplit_once(' ')?;
        let place = kinds.iter().position(|other| other == word).unwrap_or(kinds.len());
        if place == MOST_KINDS {
            return None;
        }
        if place == kinds.len() {
            kinds.push(word.to_owned());
        }
        kind.push(place as u16);
        ids.push(number.parse().ok()?);
    }
    Some((kinds, kind, ids))
}

/// The objects of a catalogue, the most important first: columns by name, what they are as JSON, and what there was to tell.
///
/// # Errors
/// As [`work::run`].
#[pyfunction]
pub fn catalogue<'py>(
    py: Python<'py>,
    path: PathBuf,
    asked: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, String, Vec<String>)> {
    let asked = asked.to_owned();
    let job = move |state: &Arc<State>| -> Result<(AskedCatalogue, Catalogue), Failure> {
        let asked: AskedCatalogue = read_asked(&asked)?;
        let found = asked.read(&path)?;
        if found.left_out > 0 {
            state.note(format!("{}: left out: {} without a position", found.path.display(), found.left_out));
        }
        Ok((asked, found))
    };
    let ((asked, found), told) = work::run_alone(py, progress, job)?;
    let kinds = numbered(&found);
    let Catalogue { path, format, length_unit, mass_unit, box_size, left_out, objects, properties, .. } = found;
    let columns = PyDict::new(py);
    let mut units: BTreeMap<String, Unit> = BTreeMap::new();
    let names: Vec<&str> = objects.iter().map(|object| object.name.as_str()).collect();
    columns.set_item("name", names)?;
    let kinds = match kinds {
        Some((kinds, kind, ids)) => {
            if asked.wants("kind") {
                columns.set_item("kind", PyArray1::from_vec(py, kind))?;
            }
            if asked.wants("id") {
                columns.set_item("id", PyArray1::from_vec(py, ids))?;
            }
            kinds
        }
        None => Vec::new(),
    };
    type Number = fn(&Object) -> f64;
    let own: [(&str, &Unit, Number); 5] = [
        ("x", &length_unit, |object| object.position.x),
        ("y", &length_unit, |object| object.position.y),
        ("z", &length_unit, |object| object.position.z),
        ("radius", &length_unit, |object| object.radius.unwrap_or(f64::NAN)),
        ("mass", &mass_unit, |object| object.mass.unwrap_or(f64::NAN)),
    ];
    for (name, unit, value) in own.into_iter().filter(|(name, ..)| asked.wants(name)) {
        columns.set_item(name, PyArray1::from_vec(py, objects.iter().map(value).collect()))?;
        units.insert(name.to_owned(), unit.clone());
    }
    for property in properties {
        // What is called as what every object has is that.
        if !columns.contains(&property.name)? {
            columns.set_item(&property.name, PyArray1::from_vec(py, property.values))?;
            units.insert(property.name, property.unit);
        }
    }
    let about = json!({
        "units": units,
        "kinds": kinds,
        "path": path.display().to_string(),
        "format": format,
        "length_unit": length_unit,
        "mass_unit": mass_unit,
        "box_size": box_size,
        "left_out": left_out,
    });
    Ok((columns, about.to_string(), told))
}
