//! Scene files: everything that a picture or a window shows, as RON that can be read, edited and opened again.
//!
//! A scene names its data by a path beside itself and by a fingerprint, so that data that has moved is found and data that has
//! changed is told ([`dataset`]). Fields that are left out keep their defaults; what is unknown, of the wrong type or out of range
//! is refused with file, line, column and field.

pub mod dataset;
pub mod members;
pub mod page_cache;

mod check;
mod film;
mod json;
mod mix;
mod open_data;
mod overwriting;
mod patch;
pub mod picture_config;
mod said;
mod shot;
mod text;

pub(crate) use check::check_dataset;
pub use dataset::{DatasetRef, Fingerprint, Located, OwnLook};
pub use film::Film;
pub use json::{OfRun, of_json};
pub use members::{Member, MemberKind, check_derived, said_of_particles, say, shown_families};
pub use mix::{mix, mix_time};
pub use open_data::{DataKind, OpenData, data_file, is_field, one_snapshot};
pub use overwriting::{file_among, is_file_of};
pub use patch::{ERROR_PX, ERRORS_PX, Look, LookPatch};
pub(crate) use patch::{define_look_text, with_look_fields};
pub use picture_config::{Backend, CameraConfig, PictureConfig};
pub use said::{HeightsSaid, TakenFor};
pub use shot::Shot;
pub use text::{SceneError, is_scene_file};

use crate::explore::PlotSettings;
use crate::view::{Projection, Stereo, Surround, View, ViewError};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The version of scene files without a time and without paths.
pub const VERSION: u32 = 1;

/// The version of scene files with a time or with paths, and the last one that this program reads.
pub const VERSION_TIME: u32 = 2;

/// A scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "SceneText", into = "SceneText")]
pub struct SceneFile {
    /// [`VERSION`] or [`VERSION_TIME`]; what is written is told by what there is.
    pub version: u32,
    /// What is shown, in the units of the first.
    pub datasets: Vec<DatasetRef>,
    /// What it looks like; the program's own where it says nothing.
    pub look: LookPatch,
    /// Size of the picture, pixels.
    pub size: Option<(u32, u32)>,
    /// Where the camera stands; around the data where it is `None`.
    pub camera: Option<Camera>,
    /// How directions become a picture.
    pub projection: Surround,
    /// A picture for each eye.
    pub stereo: Option<Stereo>,
    /// Viewpoints on number keys.
    pub bookmarks: Vec<Bookmark>,
    /// A catalogue of named objects; where it is relative, from the scene file's folder.
    pub labels: Option<PathBuf>,
    /// The window's panels.
    pub panels: Panels,
    /// What the window plots; the usual where it is `None`.
    pub plot: Option<PlotSettings>,
    /// What a tour's picture has beyond a scene.
    pub film: Option<Film>,
}

with_look_fields!(define_look_text! { written SceneText of SceneFile, attribute Attribute, {
    version: u32,
    datasets: Vec<DatasetRef>,
    #[serde(default)]
    size: Option<(u32, u32)>,
    #[serde(default)]
    camera: Option<Camera>,
    #[serde(default)]
    projection: Surround,
    #[serde(default)]
    stereo: Option<Stereo>,
    #[serde(default)]
    bookmarks: Vec<Bookmark>,
    #[serde(default)]
    labels: Option<PathBuf>,
    #[serde(default)]
    panels: Panels,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    plot: Option<PlotSettings>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    film: Option<Film>,
}});

/// Which attribute gives the hue.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Attribute {
    /// The mode's usual one, where the data has it.
    #[default]
    Automatic,
    /// None: the colour follows the brightness.
    None,
    /// The attribute of that name.
    Named(String),
}

/// Where a camera stands, in the data's length unit; numbers come back from a file exactly as they were.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position.
    pub eye: [f64; 3],
    /// The point looked at, which an orbit turns around.
    pub target: [f64; 3],
    /// The direction that points up in the picture.
    #[serde(default = "up")]
    pub up: [f64; 3],
    /// Vertical field of view, degrees.
    #[serde(default = "fov")]
    pub fov: f64,
    /// Height of an orthographic picture; perspective where it is `None`.
    #[serde(default)]
    pub ortho: Option<f64>,
}

fn up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

fn fov() -> f64 {
    45.0
}

/// A viewpoint on a number key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bookmark {
    /// The key, 0 to 9.
    pub key: u8,
    /// What it is called.
    #[serde(default)]
    pub name: String,
    /// The viewpoint.
    pub camera: Camera,
}

/// Which of the window's panels are shown.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Panels {
    /// Whether there are any.
    pub shown: bool,
    /// Names of the sections that are closed; the program's choice where it is `None`.
    pub closed: Option<Vec<String>>,
}

impl Default for Panels {
    fn default() -> Panels {
        Panels { shown: true, closed: None }
    }
}

impl SceneFile {
    /// A scene of these datasets with everything as it is by default.
    pub fn new(datasets: Vec<DatasetRef>) -> SceneFile {
        SceneFile {
            version: VERSION,
            datasets,
            look: LookPatch::default(),
            size: None,
            camera: None,
            projection: Surround::Flat,
            stereo: None,
            bookmarks: Vec::new(),
            labels: None,
            panels: Panels::default(),
            plot: None,
            film: None,
        }
    }
}

impl Camera {
    /// The view onto a picture of that many pixels.
    ///
    /// # Errors
    /// [`ViewError`] for a camera that cannot see anything.
    pub fn view(&self, width: u32, height: u32) -> Result<View, ViewError> {
        let [eye, target, up] = [self.eye, self.target, self.up].map(DVec3::from);
        let projection = match self.ortho {
            Some(height) => Projection::Orthographic { height },
            None => Projection::Perspective { fov_y: self.fov.to_radians() },
        };
        View::look_at(eye, target, up, projection, width, height)
    }
}
