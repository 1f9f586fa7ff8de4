//! The arrays of a data set of points, and of its pieces, as a source's fields.

use crate::import::bytes::Order;
use crate::import::grid::scratch::Storage;
use crate::import::typed_columns::{Column, Component, FieldList, Run, TypedColumns, TypedFamily};
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError};
use crate::model::{FamilyName, SampleType, Unit};
use std::path::Path;

/// The most arrays that are read, and the most numbers a point that one has.
pub(super) const MOST_ARRAYS: usize = 256;
pub(super) const MOST_COMPONENTS: u64 = 64;

/// What arrays of velocities are called, in lower case.
const VELOCITIES: [&str; 4] = ["velocity", "velocities", "vel", "v"];

/// What the points are called.
const POINTS: &str = "Points";

/// Where the numbers of an array are: one point behind the other, without gaps.
pub(super) struct Place {
    /// Index among the storages of all pieces.
    pub storage: usize,
    pub offset: u64,
    pub number: SampleType,
    pub order: Order,
    pub components: u64,
}

/// The arrays of a piece of a data set.
#[derive(Default)]
pub(super) struct Arrays {
    /// Number of points.
    pub count: u64,
    fields: FieldList,
    /// Names of those that are left out.
    pub left_out: Vec<String>,
}

impl Arrays {
    /// None yet of `count` points.
    pub(super) fn new(count: u64) -> Arrays {
        Arrays { count, ..Arrays::default() }
    }

    /// Adds the points.
    pub(super) fn push_points(&mut self, place: &Place) {
        self.fields.push("position", POINTS, FieldKind::Position, components(place));
    }

    /// Adds an array of data; what is without a name is numbered.
    pub(super) fn push(&mut self, name: &str, number: usize, place: &Place) {
        let name: String = name.chars().filter(|letter| !letter.is_control()).collect();
        let name = if name.is_empty() { format!("array-{number}") } else { name };
        match place.components {
            1 => {
                if let [component] = components(place)[..] {
                    self.fields.push_scalar(&name, component);
                }
            }
            3 if VELOCITIES.contains(&&*name.to_lowercase()) => {
                self.fields.push("velocity", &name, FieldKind::Velocity, components(place));
            }
            _ => self.fields.push(&name, &name, FieldKind::Other, components(place)),
        }
    }

    /// Gives an array of data, or the points without a name, a unit.
    pub(super) fn set_unit(&mut self, name: Option<&str>, unit: &Unit) {
        self.fields.set_unit_stored_as(name.unwrap_or(POINTS), unit);
    }
}

/// The pieces of a data set, one behind the other.
#[derive(Default)]
pub(super) struct Pieces {
    /// Those with points.
    pub arrays: Vec<Arrays>,
    /// Where the numbers of all of them are.
    pub storages: Vec<Storage>,
    /// How many files they are in, one that names the others among them, and the bytes of these together.
    pub files: usize,
    pub bytes: u64,
}

impl Pieces {
    /// The source that is called `path`.
    ///
    /// # Errors
    /// Where there are no points, or pieces have other arrays than the first.
    pub(super) fn source(self, path: &Path) -> Result<TypedColumns, ImportError> {
        let mut about = Description::unitless(path, "vtk-points", self.bytes);
        about.files = self.files;
        let mut whole: Option<(FamilyInfo, TypedFamily)> = None;
        for (index, piece) in self.arrays.into_iter().enumerate() {
            if !piece.fields.has_positions() {
                return Err(ImportError::missing(path, "points", "a data set with points"));
            }
            let (info, family) = piece.fields.family(FamilyName::Dark, piece.count, vec![Run::WHOLE]);
            let Some((all, parts)) = &mut whole else {
                if !piece.left_out.is_empty() {
                    about.notes.push(format!("other arrays are left out: {}", piece.left_out.join(", ")));
                }
                whole = Some((info, family));
                continue;
            };
            if info.fields != all.fields {
                let field = format!("arrays of piece {} with points", index + 1);
                let expected = format!("{}, as in the first", named(&all.fields));
                return Err(ImportError::malformed(path, field, named(&info.fields), expected));
            }
            parts.extend(family, all.count);
            all.count = all.count.saturating_add(info.count);
        }
        let none = || ImportError::NoParticles { path: path.into(), field: "NumberOfPoints".into() };
        let whole = whole.ok_or_else(none)?;
        let unit = |kind| whole.0.find(kind).map(|field| whole.0.fields[field].unit.clone()).unwrap_or_default();
        (about.length_unit, about.mass_unit) = (unit(FieldKind::Position), unit(FieldKind::Mass));
        Ok(TypedColumns::new(about, self.storages, vec![whole]))
    }
}

/// Arrays by their names, numbers a point and units, for messages.
fn named(fields: &[Field]) -> String {
    let named = |field: &Field| match field.unit.is_unknown() {
        true => format!("{} ({})", field.stored_as, field.components),
        false => format!("{} ({}) [{}]", field.stored_as, field.components, field.unit),
    };
    fields.iter().map(named).collect::<Vec<String>>().join(", ")
}

fn components(place: &Place) -> Vec<Component> {
    let size = place.number.size() as u64;
    let stride = size * place.components;
    let column = |component: u64| Column {
        storage: place.storage,
        offset: place.offset + component * size,
        stride,
        number: place.number,
        order: place.order,
    };
    (0..place.components).map(|component| Component::plain(column(component))).collect()
}
