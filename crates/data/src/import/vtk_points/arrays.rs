//! The arrays of a data set of points as a source's fields.

use crate::import::bytes::Order;
use crate::import::grid::Content;
use crate::import::grid::scratch::Storage;
use crate::import::typed_columns::{Column, Component, FieldList, Run, TypedColumns};
use crate::import::{Description, FieldKind, ImportError};
use crate::model::{FamilyName, SampleType, Unit};

/// The most arrays that are read, and the most numbers a point that one has.
pub(super) const MOST_ARRAYS: usize = 256;
pub(super) const MOST_COMPONENTS: u64 = 64;

/// What arrays of velocities are called, in lower case.
const VELOCITIES: [&str; 4] = ["velocity", "velocities", "vel", "v"];

/// What the points are called.
const POINTS: &str = "Points";

/// Where the numbers of an array are: one point behind the other, without gaps.
pub(super) struct Place {
    /// Index of the storage.
    pub storage: usize,
    pub offset: u64,
    pub number: SampleType,
    pub order: Order,
    pub components: u64,
}

/// The arrays of a data set.
#[derive(Default)]
pub(super) struct Arrays {
    /// Number of points.
    pub count: u64,
    pub storages: Vec<Storage>,
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

    /// The source.
    ///
    /// # Errors
    /// Where there are no points.
    pub(super) fn source(self, content: &Content) -> Result<TypedColumns, ImportError> {
        let path = &*content.named;
        if !self.fields.has_positions() {
            return Err(ImportError::missing(path, "points", "a data set with points"));
        }
        let mut about = Description::unitless(path, "vtk-points", content.length);
        if !self.left_out.is_empty() {
            about.notes.push(format!("other arrays are left out: {}", self.left_out.join(", ")));
        }
        about.length_unit = self.fields.unit_of(FieldKind::Position);
        about.mass_unit = self.fields.unit_of(FieldKind::Mass);
        let family = self.fields.family(FamilyName::Dark, self.count, vec![Run::WHOLE]);
        Ok(TypedColumns::new(about, self.storages, vec![family]))
    }
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
