//! NumPy's arrays as a source of particles, read in place, chunk by chunk.

use crate::error::Failure;
use deepfield_draw::codec::quantize::MAX_ATTRIBUTES;
use deepfield_draw::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use deepfield_draw::model::{FamilyName, Unit};
use deepfield_draw::store::FamilyMetadata;
use numpy::ndarray::{Axis, Slice};
use numpy::{Element, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What messages and files call the source.
const NAME: &str = "arrays";

/// What is said of arrays beside their columns.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Said {
    /// Edge of the periodic box, unit of positions.
    pub box_size: Option<f64>,
    /// Simulation time.
    pub time: Option<f64>,
    /// Redshift.
    pub redshift: Option<f64>,
}

/// The values of a field.
enum Column {
    Single(Py<PyArrayDyn<f32>>),
    Double(Py<PyArrayDyn<f64>>),
}

impl Column {
    /// An array of 32-bit or 64-bit floats in the machine's order of bytes, with its shape.
    fn of(array: &Bound<'_, PyAny>) -> Option<(Column, Vec<usize>)> {
        if let Ok(array) = array.cast::<PyArrayDyn<f32>>() {
            return Some((Column::Single(array.clone().unbind()), array.shape().to_vec()));
        }
        let array = array.cast::<PyArrayDyn<f64>>().ok()?;
        Some((Column::Double(array.clone().unbind()), array.shape().to_vec()))
    }

    /// Copies the values of some particles.
    fn read(&self, rows: Range<usize>, out: &mut [f64]) -> Result<(), String> {
        let read = Python::try_attach(|py| match self {
            Column::Single(array) => copy(array.bind(py), rows, out),
            Column::Double(array) => copy(array.bind(py), rows, out),
        });
        // A build that was given up may outlive the interpreter.
        read.unwrap_or_else(|| Err("no interpreter that has it".into()))
    }
}

fn copy<T: Element + Copy + Into<f64>>(
    array: &Bound<'_, PyArrayDyn<T>>,
    rows: Range<usize>,
    out: &mut [f64],
) -> Result<(), String> {
    let array = array.try_readonly().map_err(|error| error.to_string())?;
    let all = array.as_array();
    // It may have been given another shape since it was first seen.
    if all.shape().first().is_none_or(|length| *length < rows.end) {
        return Err("an array that has become shorter".into());
    }
    let part = all.slice_axis(Axis(0), Slice::from(rows));
    if part.len() != out.len() {
        return Err("an array that has another shape now".into());
    }
    out.iter_mut().zip(part.iter()).for_each(|(out, value)| *out = (*value).into());
    Ok(())
}

/// A family's columns, as they come.
struct Gathered {
    info: FamilyInfo,
    columns: Vec<(usize, Column)>,
}

/// Arrays as a source.
pub struct ArraySource {
    description: Description,
    /// Of each family, in the order of its fields.
    columns: Vec<Vec<Column>>,
}

impl ArraySource {
    /// The source of columns, each with its family's name, its own name, its unit, and an array of one value (n) or several (n, k) a particle.
    ///
    /// # Errors
    /// Where they do not fit together.
    pub fn new(columns: Vec<(String, String, String, Bound<'_, PyAny>)>, said: &Said) -> Result<ArraySource, Failure> {
        let mut families: Vec<Gathered> = Vec::new();
        for (family, name, unit, array) in columns {
            let path = format!("{NAME}: {family}: {name}");
            let family = FamilyName::parse(&family).ok_or_else(|| {
                format!("{NAME}: family {family}: expected a name of lower-case letters, digits and hyphens")
            })?;
            let (column, shape) = Column::of(&array).ok_or_else(|| format!("{path}: expected an array of floats"))?;
            let (kind, name) = meant(&name);
            let (count, components) = match (kind, &shape[..]) {
                (FieldKind::Position | FieldKind::Velocity, [count, 3]) => (*count, 3),
                (FieldKind::Position | FieldKind::Velocity, _) => {
                    return Err(format!("{path}: found shape {shape:?}, expected (n, 3)").into());
                }
                (_, [count]) => (*count, 1),
                (FieldKind::Other, [count, components]) if *components > 0 => (*count, *components),
                (FieldKind::Other, _) => {
                    return Err(format!("{path}: found shape {shape:?}, expected (n,) or (n, 3)").into());
                }
                _ => return Err(format!("{path}: found shape {shape:?}, expected (n,)").into()),
            };
            if count == 0 {
                continue;
            }
            let at = families.iter().position(|gathered| gathered.info.name == family).unwrap_or_else(|| {
                let info = FamilyInfo { name: family, count: count as u64, fields: Vec::new() };
                families.push(Gathered { info, columns: Vec::new() });
                families.len() - 1
            });
            let Gathered { info, columns } = &mut families[at];
            if info.count != count as u64 {
                return Err(
                    format!("{path}: found {count} particles, expected {} as other columns have", info.count).into()
                );
            }
            if info.fields.iter().any(|field| field.name == name) {
                return Err(format!("{path}: found {name} twice, expected it once").into());
            }
            columns.push((info.fields.len(), column));
            info.fields.push(Field { stored_as: name.clone(), name, unit: Unit::new(unit), components, kind });
        }
        ArraySource::of(families, said)
    }

    fn of(mut families: Vec<Gathered>, said: &Said) -> Result<ArraySource, Failure> {
        families.sort_by_key(|gathered| gathered.info.name.gadget_type().unwrap_or(u8::MAX));
        let mut description = Description::unitless(Path::new(NAME), NAME, 0);
        (description.box_size, description.time, description.redshift) = (said.box_size, said.time, said.redshift);
        let mut columns = Vec::with_capacity(families.len());
        for Gathered { mut info, columns: mut own } in families {
            if info.find(FieldKind::Position).is_none() {
                return Err(
                    format!("{NAME}: {}: positions: missing, expected an array of shape (n, 3)", info.name).into()
                );
            }
            for field in &info.fields {
                let scene = match field.kind {
                    FieldKind::Position | FieldKind::SmoothingLength => &mut description.length_unit,
                    FieldKind::Mass => &mut description.mass_unit,
                    _ => continue,
                };
                if scene.is_unknown() {
                    *scene = field.unit.clone();
                } else if !field.unit.is_unknown() && field.unit != *scene {
                    let (family, name, found) = (info.name, &field.name, &field.unit);
                    return Err(
                        format!("{NAME}: {family}: {name}: found {found}, expected {scene} as others have").into()
                    );
                }
            }
            description.bytes += 8 * info.count * info.fields.iter().map(|field| field.components as u64).sum::<u64>();
            // Fields are listed in the order of their kinds.
            own.sort_by_key(|(index, _)| info.fields[*index].kind);
            info.fields.sort_by_key(|field| field.kind);
            columns.push(own.into_iter().map(|(_, column)| column).collect());
            description.families.push(info);
        }
        Ok(ArraySource { description, columns })
    }

    /// Every attribute that there is: scalars, components of vectors, and the speed.
    pub fn attributes(&self) -> Vec<String> {
        attributes_of(&self.description.families)
    }

    /// What there is to tell of attributes that families of a file lack, which was built of as many of them as it has places for.
    pub fn left_out(&self, built: &[FamilyMetadata]) -> Vec<String> {
        let note = |family: &FamilyMetadata| {
            let info = self.description.families.iter().find(|info| info.name == family.name)?;
            let mut names = attributes_of(std::slice::from_ref(info));
            names.retain(|name| family.attributes.iter().all(|kept| kept.name != *name));
            let names = (!names.is_empty()).then(|| names.join(", "))?;
            Some(format!(
                "{}: {names}: left out: found too many attributes, expected at most {MAX_ATTRIBUTES} with those that are derived; \
                 attributes= names others",
                family.name
            ))
        };
        built.iter().filter_map(note).collect()
    }
}

/// Names of the attributes of families, each once.
fn attributes_of(families: &[FamilyInfo]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for field in families.iter().flat_map(|info| &info.fields) {
        let own = match (field.kind, field.components) {
            (FieldKind::Velocity, _) => vec!["speed".to_owned()],
            (FieldKind::Other, 1) => vec![field.name.clone()],
            (FieldKind::Other, 3) => ["x", "y", "z"].map(|axis| format!("{}-{axis}", field.name)).to_vec(),
            _ => Vec::new(),
        };
        names.extend(own);
    }
    let mut known = std::collections::HashSet::new();
    names.retain(|name| known.insert(name.clone()));
    names
}

/// Lets go of the arrays at once, on whatever thread a build ends: else they would stay until Python next calls this library.
impl Drop for ArraySource {
    fn drop(&mut self) {
        Python::try_attach(|_| self.columns.clear());
    }
}

/// What a column of that name is, and its standard name.
fn meant(name: &str) -> (FieldKind, String) {
    let (kind, standard) = match name {
        "position" | "positions" | "coordinates" => (FieldKind::Position, "position"),
        "velocity" | "velocities" => (FieldKind::Velocity, "velocity"),
        "mass" | "masses" => (FieldKind::Mass, "mass"),
        "smoothing_length" | "smoothing_lengths" | "smoothing-length" => {
            (FieldKind::SmoothingLength, "smoothing-length")
        }
        "density" | "densities" => (FieldKind::Density, "density"),
        other => return (FieldKind::Other, other.replace('_', "-")),
    };
    (kind, standard.to_owned())
}

impl Source for ArraySource {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let about = self.description.check_range(family, field, &range, out.len())?;
        // Columns are those of the fields, and there are so many rows in memory.
        self.columns[family][field].read(range.start as usize..range.end as usize, out).map_err(|found| {
            let expected = "what it was when the build began".to_owned();
            ImportError::Malformed { path: PathBuf::from(NAME), field: about.name.clone(), found, expected }
        })
    }
}
