//! Catalogues that somebody wrote as RON.

use super::{Catalogue, Object};
use crate::explore::ExploreError;
use crate::model::{Unit, ron_file};
use glam::DVec3;
use serde::Deserialize;
use std::path::Path;

/// Largest file that is read: it is held in memory.
const MOST_BYTES: u64 = 256 << 20;

/// The file's content.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    length_unit: String,
    #[serde(default)]
    mass_unit: String,
    objects: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    position: DVec3,
    #[serde(default)]
    radius: Option<f64>,
    #[serde(default)]
    mass: Option<f64>,
}

pub(super) fn read(path: &Path) -> Result<Catalogue, ExploreError> {
    let bytes = std::fs::metadata(path).map_err(|source| ExploreError::io(path, "opening", source))?.len();
    if bytes > MOST_BYTES {
        let expected = format!("at most {MOST_BYTES}: a larger catalogue as a table");
        return Err(ExploreError::malformed(path, "file", format!("{bytes} bytes"), expected));
    }
    let written: Written = ron_file::read(path)?;
    let object = |Entry { name, position, radius, mass }| Object { name, position, radius, mass };
    Ok(Catalogue {
        path: path.into(),
        format: "ron",
        length_unit: Unit::new(written.length_unit),
        mass_unit: Unit::new(written.mass_unit),
        box_size: None,
        left_out: 0,
        objects: written.objects.into_iter().map(object).collect(),
        properties: Vec::new(),
        is_in_plane: false,
        tree: None,
    })
}
