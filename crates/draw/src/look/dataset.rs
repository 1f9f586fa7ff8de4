//! A dataset of a scene: what a scene file says of it.

mod fingerprint;
mod opened;
mod places;

pub use fingerprint::{Fingerprint, SPAN};
pub use places::{Located, located, named_in, relative_to};

use super::{Attribute, HeightsSaid, Member, TakenFor};
use crate::color::transfer::TransferFunction;
use crate::heights::import::PhotoChoice;
use crate::mode::{Mode, Settings};
use crate::model::url::shown;
use crate::model::{DerivedQuantity, FamilyName, Unit};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A dataset that a scene shows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "DatasetText", into = "DatasetText")]
pub struct DatasetRef {
    /// The source or page file; where it is relative, from the scene file's folder.
    pub path: PathBuf,
    /// What the file was when the scene was saved.
    pub fingerprint: Option<Fingerprint>,
    /// The families that are drawn; all where it is `None`.
    pub families: Option<Vec<FamilyName>>,
    /// Where its origin lies in the scene, the length unit of the scene's first dataset.
    pub offset: [f64; 3],
    /// Scene lengths for one of its own; what the units say, and else 1, where it is `None`.
    pub scale: Option<f64>,
    /// What is said of it; paths of a photo and of an earlier state of heights are as the dataset's.
    pub said: HeightsSaid,
    /// How it is drawn among other data where it is an image or a volume.
    pub own_look: Option<OwnLook>,
}

/// How an image or a volume is drawn among other data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OwnLook {
    /// The mode; `volume` or `image` where it is `None`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<&'static Mode>,
    /// Its settings.
    #[serde(skip_serializing_if = "Settings::is_empty")]
    pub settings: Settings,
    /// Which channel gives the hue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attribute: Option<Attribute>,
    /// From values to colours; the usual one of such values where it is `None`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfer: Option<TransferFunction>,
}

/// A dataset as files have it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DatasetText {
    path: PathBuf,
    #[serde(default)]
    fingerprint: Option<Fingerprint>,
    #[serde(default)]
    families: Option<Vec<FamilyName>>,
    #[serde(default)]
    offset: [f64; 3],
    #[serde(default)]
    scale: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    kind: Option<TakenFor>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    nodata: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    spacing: Option<[f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    xy_unit: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    height_unit: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture_at: Option<[f64; 4]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    before: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    derive: Vec<DerivedText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    look: Option<OwnLook>,
}

/// A derived quantity by its name.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
struct DerivedText(DerivedQuantity);

impl TryFrom<String> for DerivedText {
    type Error = String;

    fn try_from(name: String) -> Result<DerivedText, String> {
        let names = || DerivedQuantity::ALL.map(DerivedQuantity::name).join(", ");
        let found =
            DerivedQuantity::of_name(&name).ok_or_else(|| format!("found {name:?}, expected one of {}", names()));
        found.map(DerivedText)
    }
}

impl From<DerivedText> for String {
    fn from(DerivedText(quantity): DerivedText) -> String {
        quantity.name().to_owned()
    }
}

impl From<DatasetText> for DatasetRef {
    fn from(text: DatasetText) -> DatasetRef {
        let rectangle = text.texture_at;
        let said = HeightsSaid {
            taken_for: text.kind,
            nodata: text.nodata,
            spacing: text.spacing,
            xy_unit: text.xy_unit.map(Unit::new),
            height_unit: text.height_unit.map(Unit::new),
            texture: text.texture.map(|path| PhotoChoice { path, rectangle }),
            before: text.before,
            derive: text.derive.iter().map(|DerivedText(quantity)| *quantity).collect(),
        };
        let DatasetText { path, fingerprint, families, offset, scale, look, .. } = text;
        DatasetRef { path: shown(&path), fingerprint, families, offset, scale, said, own_look: look }
    }
}

impl From<DatasetRef> for DatasetText {
    fn from(dataset: DatasetRef) -> DatasetText {
        let DatasetRef { path, fingerprint, families, offset, scale, said, own_look } = dataset;
        DatasetText {
            path,
            fingerprint,
            families,
            offset,
            scale,
            kind: said.taken_for,
            nodata: said.nodata,
            spacing: said.spacing,
            xy_unit: said.xy_unit.map(|unit| unit.0),
            height_unit: said.height_unit.map(|unit| unit.0),
            texture_at: said.texture.as_ref().and_then(|photo| photo.rectangle),
            texture: said.texture.map(|photo| photo.path),
            before: said.before,
            derive: said.derive.into_iter().map(DerivedText).collect(),
            look: own_look,
        }
    }
}

/// What is said of a member, which lies where it lies.
impl From<Member> for DatasetRef {
    fn from(member: Member) -> DatasetRef {
        let Member { path, offset, scale, families, said, own_look } = member;
        DatasetRef { path, fingerprint: None, families, offset: offset.to_array(), scale, said, own_look }
    }
}

impl DatasetRef {
    /// The data at `path` as a scene beside it, or anywhere else, names it: relative where it lies in the scene's folder or below.
    pub fn of(path: &Path, scene: &Path) -> DatasetRef {
        let fingerprint = Fingerprint::of(path).ok();
        DatasetRef { path: relative_to(path, scene), fingerprint, ..DatasetRef::default() }
    }

    /// The same for what a user says of a member: where it lies, and its heights.
    #[must_use]
    pub fn of_member(member: &Member, scene: &Path) -> DatasetRef {
        let said = member.said.with_files(|file| relative_to(file, scene));
        let (offset, scale, own_look) = (member.offset.to_array(), member.scale, member.own_look.clone());
        DatasetRef { offset, scale, said, own_look, ..DatasetRef::of(&member.path, scene) }
    }

    /// What it says of the data at `path`; other files lie where it says.
    #[must_use]
    pub fn member(self, path: PathBuf) -> Member {
        let DatasetRef { families, offset, scale, said, own_look, .. } = self;
        Member { path, offset: DVec3::from(offset), scale, families, said, own_look }
    }
}
