//! Spheres of objects, as regions name them.

use super::halo_tables::files_of_finder;
use super::{Catalogue, Object};
use crate::explore::{Data, ExploreError, Shape};
use crate::import::file_in;
use std::path::{Path, PathBuf};

/// What names an object: the catalogue, and its place or its name.
///
/// # Errors
/// [`ExploreError::Value`] of a text without both.
fn parts(at: &str) -> Result<(&Path, &str), ExploreError> {
    let parts = at.rsplit_once('#').filter(|(path, name)| !path.is_empty() && !name.is_empty());
    let (path, name) = parts.ok_or_else(|| ExploreError::value("at", at, "CATALOGUE#N such as groups.hdf5#0"))?;
    Ok((Path::new(path), name))
}

/// The files of the catalogue that `at` names an object of.
///
/// # Errors
/// As [`sphere_at`], of what names none, and where one of several files is not there.
pub fn files_of_catalogue(at: &str) -> Result<Vec<PathBuf>, ExploreError> {
    files_of_finder(&file_in(parts(at)?.0, &[])?)
}

/// The sphere in `data` of the object that `at` names: `CATALOGUE#N` is the one at place N by importance, from 0, and `CATALOGUE#NAME` the one of
/// that name; of a catalogue of several steps as it is at the data's time. `radius` stands in for the catalogue's.
///
/// # Errors
/// As [`Catalogue::read_at`] and [`Catalogue::sphere`], and where there is no such object.
pub fn sphere_at(at: &str, radius: Option<f64>, data: Data) -> Result<Shape, ExploreError> {
    let (path, name) = parts(at)?;
    let catalogue = Catalogue::read_at(path, data.time(), false)?;
    let object = match name.parse() {
        Ok(index) => catalogue.ranked(index)?,
        Err(_) => catalogue.named(name)?,
    };
    catalogue.sphere(object, radius, data)
}

impl Catalogue {
    /// The sphere in `data` of one of its objects; `radius` stands in for the catalogue's.
    ///
    /// # Errors
    /// [`ExploreError`] where lengths are in another unit than the data's, and where nothing says a radius.
    pub fn sphere(&self, object: &Object, radius: Option<f64>, data: Data) -> Result<Shape, ExploreError> {
        let (own, other) = (data.length_unit(), &self.length_unit);
        if !own.is_unknown() && !other.is_unknown() && own != other {
            let expected = format!("{own} as in {}", data.path().display());
            return Err(ExploreError::malformed(&self.path, "lengths", other, expected));
        }
        let radius = radius.or(object.radius).ok_or_else(|| {
            ExploreError::missing(&self.path, format!("radius of {}", object.name), "one that is said beside its name")
        })?;
        Ok(Shape::Sphere { center: object.position, radius })
    }
}
