//! Numbers that catalogues have of their objects beside place, radius and mass. They are kept where somebody asks for them.

use crate::explore::ExploreError;
use crate::explore::export::column_name;
use crate::import::{FamilyInfo, Field, FieldKind, Source};
use crate::model::Unit;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Numbers of all objects of a catalogue.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Property {
    /// The file's own name, such as `Vmax`; of vectors with the component, `GroupVel-x`.
    pub name: String,
    /// Its unit; empty when unknown.
    pub unit: Unit,
    /// A number for each object, in their order; NaN where there is none.
    pub values: Vec<f64>,
}

/// What every object has, as tables name it.
const OF_OBJECTS: [&str; 9] = ["name", "kind", "id", "position", "x", "y", "z", "radius", "mass"];

/// Properties while a file is read.
pub(in crate::explore) struct Kept<'a> {
    /// Those that are asked for; all where nothing is said.
    names: Option<&'a [String]>,
    /// Bytes that they may take.
    memory: u64,
    /// All that the file has, and the places of those that are kept.
    there: BTreeMap<String, Option<usize>>,
    properties: Vec<Property>,
}

impl<'a> Kept<'a> {
    /// Properties of these names, or all, in so many bytes.
    pub fn new(names: Option<&'a [String]>, memory: u64) -> Kept<'a> {
        Kept { names, memory, there: BTreeMap::new(), properties: Vec::new() }
    }

    /// None at all.
    pub fn nothing() -> Kept<'static> {
        Kept::new(Some(&[]), 0)
    }

    /// Whether none is asked for, so that nobody needs to look which there are.
    pub fn is_nothing(&self) -> bool {
        self.names.is_some_and(<[String]>::is_empty)
    }

    /// Whether a field of that name, or some component of it, is asked for.
    pub fn may_want(&self, name: &str) -> bool {
        let is_of =
            |other: &String| other.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'));
        self.names.is_none_or(|names| names.iter().any(is_of))
    }

    /// The place of the property of that name, which the file has; `None` where it is not asked for.
    pub fn place(&mut self, name: &str, unit: &Unit) -> Option<usize> {
        if let Some(place) = self.there.get(name) {
            return *place;
        }
        let is_asked = self.names.is_none_or(|names| names.iter().any(|other| other == name));
        let place = is_asked.then_some(self.properties.len());
        if is_asked {
            self.properties.push(Property { name: name.to_owned(), unit: unit.clone(), values: Vec::new() });
        }
        self.there.insert(name.to_owned(), place);
        place
    }

    /// Whether there is room for the numbers of so many objects.
    ///
    /// # Errors
    /// [`ExploreError`] where there is not.
    pub fn check_room(&self, path: &Path, objects: usize) -> Result<(), ExploreError> {
        let (count, each) = (self.properties.len() as u64, size_of::<f64>() as u64);
        if count.saturating_mul(objects as u64).saturating_mul(each) <= self.memory {
            return Ok(());
        }
        let found = format!("{count} of {objects} objects and more, {each} bytes each");
        let expected = format!("at most {} bytes: fewer fields or more memory", self.memory);
        Err(ExploreError::malformed(path, "properties", found, expected))
    }

    /// Puts the numbers of objects, from the place `first` among all on, into the property at `place`.
    pub fn put(&mut self, place: usize, first: usize, values: impl IntoIterator<Item = f64>) {
        let own = &mut self.properties[place].values;
        own.resize(first, f64::NAN);
        own.extend(values);
    }

    /// The components of a field, a vector or a number alone, that are asked for, and their places.
    pub fn places(&mut self, field: (&str, FieldKind), components: usize, unit: &Unit) -> Vec<(usize, usize)> {
        let (name, kind) = field;
        let place = |component| Some((component, self.place(&column_name(name, kind, component, components), unit)?));
        (0..components).filter_map(place).collect()
    }

    /// Puts the components of vectors, which lie one behind the other, into their places.
    pub fn put_vectors(&mut self, places: &[(usize, usize)], components: usize, first: usize, values: &[f64]) {
        for (component, place) in places {
            self.put(*place, first, values.iter().skip(*component).step_by(components.max(1)).copied());
        }
    }

    /// Reads the fields of a family of a source, but those that are the objects' `own`; its objects begin at the place `first` among all.
    /// `naming` says what a field is called, and as what its components are.
    ///
    /// # Errors
    /// When it cannot be read, or takes too much memory.
    pub fn read(
        &mut self,
        path: &Path,
        source: &dyn Source,
        family: (usize, &FamilyInfo),
        own: &[Option<usize>],
        first: usize,
        naming: impl Fn(&Field) -> (String, FieldKind),
    ) -> Result<(), ExploreError> {
        if self.is_nothing() {
            return Ok(());
        }
        let (family, info) = family;
        let count = info.count as usize;
        let mut asked = Vec::new();
        for (index, field) in info.fields.iter().enumerate().filter(|(index, _)| !own.contains(&Some(*index))) {
            let (name, kind) = naming(field);
            let places = self.places((name.as_str(), kind), field.components, &field.unit);
            if !places.is_empty() {
                asked.push((index, places));
            }
        }
        self.check_room(path, first + count)?;
        source.announce(family, &asked.iter().map(|(index, _)| *index).collect::<Vec<usize>>());
        for (index, places) in asked {
            let components = info.fields[index].components;
            let mut values = vec![0.0; count * components];
            source.read(family, index, 0..info.count, &mut values)?;
            self.put_vectors(&places, components, first, &values);
        }
        Ok(())
    }

    /// Gives up the numbers, as all are read again.
    pub fn clear(&mut self) {
        self.properties.iter_mut().for_each(|property| property.values.clear());
    }

    /// The properties of so many objects.
    pub fn finished(&mut self, objects: usize) -> Vec<Property> {
        self.properties.iter_mut().for_each(|property| property.values.resize(objects, f64::NAN));
        std::mem::take(&mut self.properties)
    }

    /// Whether the file has all that are asked for.
    ///
    /// # Errors
    /// [`ExploreError::Missing`] for the first that it has not.
    pub fn check(&self, path: &Path) -> Result<(), ExploreError> {
        let has = |name: &str| OF_OBJECTS.contains(&name) || self.there.contains_key(name);
        match self.names.unwrap_or_default().iter().find(|name| !has(name)) {
            None => Ok(()),
            Some(name) => {
                let known: Vec<&str> = OF_OBJECTS.into_iter().chain(self.there.keys().map(String::as_str)).collect();
                Err(ExploreError::missing(path, format!("field {name}"), format!("one of {}", known.join(", "))))
            }
        }
    }
}
