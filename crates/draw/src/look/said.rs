//! What a user says of a dataset in place of its file: what it is taken for, of heights, what they are, and of particles, what is derived.

use crate::heights::import::{HeightOptions, PhotoChoice};
use crate::model::{DerivedQuantity, ReadMethod, Unit};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What a file is taken for that could be several things.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TakenFor {
    /// Measured heights.
    Heights,
    /// An image or a volume.
    #[serde(alias = "other")]
    Image,
    /// Particles: also the pixels or voxels of a source.
    Particles,
}

/// What is said of heights, or what is derived for particles; of a page file it is in it already.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeightsSaid {
    /// What the file is taken for; what its content tells where it is `None`.
    pub taken_for: Option<TakenFor>,
    /// The stored value of samples that were not measured.
    pub nodata: Option<f64>,
    /// Distances of columns and of rows.
    pub spacing: Option<[f64; 2]>,
    /// Unit of x and y.
    pub xy_unit: Option<Unit>,
    /// Unit of heights.
    pub height_unit: Option<Unit>,
    /// A photo that is laid over them.
    pub texture: Option<PhotoChoice>,
    /// An earlier state of them that they are compared with: a source or a page file, of which the same is said.
    pub before: Option<PathBuf>,
    /// Attributes of particles that are derived from velocities, in this order.
    pub derive: Vec<DerivedQuantity>,
}

impl HeightsSaid {
    /// Whether the file is taken for heights; as its content tells where it is `None`.
    pub fn is_heights(&self) -> Option<bool> {
        self.taken_for.map(|kind| kind == TakenFor::Heights)
    }

    /// The same as importers are told, who read files in a way.
    pub fn options(&self, read: ReadMethod) -> HeightOptions {
        HeightOptions {
            is_asked: self.is_heights() == Some(true),
            no_data: self.nodata,
            spacing: self.spacing,
            xy_unit: self.xy_unit.clone(),
            height_unit: self.height_unit.clone(),
            texture: self.texture.clone(),
            read,
        }
    }

    /// What others say where this one says nothing.
    #[must_use]
    pub fn or(self, other: &HeightsSaid) -> HeightsSaid {
        HeightsSaid {
            taken_for: self.taken_for.or(other.taken_for),
            nodata: self.nodata.or(other.nodata),
            spacing: self.spacing.or(other.spacing),
            xy_unit: self.xy_unit.or(other.xy_unit.clone()),
            height_unit: self.height_unit.or(other.height_unit.clone()),
            texture: self.texture.or(other.texture.clone()),
            before: self.before.or(other.before.clone()),
            derive: if self.derive.is_empty() { other.derive.clone() } else { self.derive },
        }
    }

    /// The same with the files that it names where `place` says they are.
    #[must_use]
    pub(super) fn with_files(&self, place: impl Fn(&Path) -> PathBuf) -> HeightsSaid {
        let texture = self.texture.clone().map(|photo| PhotoChoice { path: place(&photo.path), ..photo });
        HeightsSaid { texture, before: self.before.as_deref().map(place), ..self.clone() }
    }

    /// What of it is said of the heights alone that are built of a source, which nothing is derived for and nothing compared with.
    #[must_use]
    pub fn of_built_heights(&self) -> HeightsSaid {
        HeightsSaid { before: None, derive: Vec::new(), ..self.clone() }
    }

    /// What of it is said of the earlier heights as well.
    #[must_use]
    pub fn of_before(&self) -> HeightsSaid {
        HeightsSaid { texture: None, before: None, ..self.clone() }
    }
}
