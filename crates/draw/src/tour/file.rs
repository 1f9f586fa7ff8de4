//! A tour as a user writes it: RON, of which a misspelled field is an error that names the place.

use crate::annotate::overlay::Picture;
use crate::explore::ExploreError;
use crate::look::dataset::located;
use crate::look::{Attribute, Camera, DatasetRef, LookPatch, define_look_text, with_look_fields};
use crate::model::new_file;
use crate::model::ron_file::{self, RonError};
use crate::view::{Stereo, Surround};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The version of tour files without times of the data.
pub const VERSION: u32 = 1;

/// The version of tour files with times of the data, and the last one that this program reads.
pub const VERSION_TIME: u32 = 2;

/// A tour.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TourFile {
    /// [`VERSION`] or [`VERSION_TIME`]; what is written is told by what there is.
    pub version: u32,
    /// What it is called.
    #[serde(default)]
    pub title: String,
    /// The data that it was made for; whatever is open where it is `None`.
    #[serde(default)]
    pub dataset: Option<DatasetRef>,
    /// Size of recorded pictures, pixels.
    #[serde(default = "size")]
    pub size: (u32, u32),
    /// How directions become a picture: flat, a dome master, a cube or a map.
    #[serde(default)]
    pub projection: Surround,
    /// A picture for each eye.
    #[serde(default)]
    pub stereo: Option<Stereo>,
    /// Recorded pictures per second.
    #[serde(default = "rate")]
    pub rate: f64,
    /// Whether it begins again at its end.
    #[serde(default, rename = "loop")]
    pub repeats: bool,
    /// The direction that is up: orbits turn about it, and the horizon keeps level to it; the data's where it says none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// What eyes are to bear.
    #[serde(default)]
    pub comfort: Comfort,
    /// Labels to go to on a presenter's keys.
    #[serde(default)]
    pub keys: BTreeMap<char, String>,
    /// The keyframes in their order.
    pub keyframes: Vec<Keyframe>,
}

/// What eyes are to bear.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Comfort {
    /// Degrees that the camera may turn in a second.
    pub turn: f64,
    /// Whether ways that are too fast take longer than they say.
    pub stretch: bool,
}

impl Default for Comfort {
    fn default() -> Comfort {
        Comfort { turn: 40.0, stretch: false }
    }
}

fn size() -> (u32, u32) {
    (1920, 1080)
}

fn rate() -> f64 {
    30.0
}

/// A moment of a tour. What it does not say stays as it was.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "KeyframeText", into = "KeyframeText")]
pub struct Keyframe {
    /// A name to go to.
    pub label: Option<String>,
    /// When it is reached, seconds from the beginning.
    pub at: Option<f64>,
    /// How long the way from the keyframe before takes, seconds; a comfortable time where neither is said.
    pub after: Option<f64>,
    /// How long everything stays, seconds.
    pub pause: f64,
    /// Whether a presenter says when it goes on; recordings do not wait.
    pub hold: bool,
    /// Whether the camera comes to rest here even without a pause.
    pub rest: bool,
    /// How the camera comes here.
    pub motion: Move,
    /// How numbers other than the camera's change on the way here.
    pub easing: Easing,
    /// How the data's time changes on the way here.
    pub time_easing: TimeEasing,
    /// Seconds in which the picture blends from what was to what is from here on.
    pub fade: f64,
    /// Where the camera stands.
    pub camera: Option<Camera>,
    /// Where the camera stands, around something.
    pub around: Option<Around>,
    /// Degrees that the camera turns around what it looks at on the way here, to the right.
    pub orbit: f64,
    /// What it looks like from here on.
    pub look: LookPatch,
    /// Words at the foot of the picture; none for an empty text.
    pub caption: Option<String>,
    /// Pictures that are laid over it: logos.
    pub images: Option<Vec<Picture>>,
}

with_look_fields!(define_look_text! { written KeyframeText of Keyframe, attribute Attribute, {
    #[serde(default)]
    label: Option<String>,
    #[serde(default)]
    at: Option<f64>,
    #[serde(default)]
    after: Option<f64>,
    #[serde(default)]
    pause: f64,
    #[serde(default)]
    hold: bool,
    #[serde(default)]
    rest: bool,
    #[serde(default, rename = "move")]
    motion: Move,
    #[serde(default)]
    easing: Easing,
    #[serde(default, skip_serializing_if = "TimeEasing::is_usual")]
    time_easing: TimeEasing,
    #[serde(default)]
    fade: f64,
    #[serde(default)]
    camera: Option<Camera>,
    #[serde(default)]
    around: Option<Around>,
    #[serde(default)]
    orbit: f64,
    #[serde(default)]
    caption: Option<String>,
    #[serde(default)]
    images: Option<Vec<Picture>>,
}});

/// How a camera comes to a keyframe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Move {
    /// On a curve through the keyframes, without stopping at them.
    #[default]
    Glide,
    /// Out, across and in again: between places that are far apart for their scales.
    Flight,
    /// Not at all: it stays where it was, and then is here.
    Cut,
}

/// How numbers change between keyframes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Easing {
    /// Slow, fast, slow.
    #[default]
    Smooth,
    /// Evenly.
    Linear,
    /// Slow, then fast.
    In,
    /// Fast, then slow.
    Out,
    /// Not before the keyframe is reached.
    Hold,
}

impl Easing {
    /// The share of the change at a share of the time.
    pub fn at(self, u: f64) -> f64 {
        match self {
            Easing::Smooth => u * u * (3.0 - 2.0 * u),
            Easing::Linear => u,
            Easing::In => u * u,
            Easing::Out => u * (2.0 - u),
            Easing::Hold => 0.0,
        }
    }

    /// The area under [`Easing::at`] from 0 to a share of the time.
    pub fn area(self, u: f64) -> f64 {
        match self {
            Easing::Smooth => u * u * u * (1.0 - 0.5 * u),
            Easing::Linear => 0.5 * u * u,
            Easing::In => u * u * u / 3.0,
            Easing::Out => u * u * (1.0 - u / 3.0),
            Easing::Hold => 0.0,
        }
    }
}

/// How the data's time changes between keyframes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeEasing {
    /// Evenly.
    #[default]
    Linear,
    /// Slow, fast, slow.
    Smooth,
    /// Not before the keyframe is reached.
    Hold,
}

impl TimeEasing {
    /// The share of the change at a share of the time.
    pub fn at(self, u: f64) -> f64 {
        match self {
            TimeEasing::Linear => u,
            TimeEasing::Smooth => Easing::Smooth.at(u),
            TimeEasing::Hold => 0.0,
        }
    }

    fn is_usual(&self) -> bool {
        *self == TimeEasing::default()
    }
}

/// A camera that looks at something from around it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Around {
    /// What it looks at.
    pub what: What,
    /// How far away it is, in radii of that.
    #[serde(default = "radii")]
    pub distance: f64,
    /// To the right of the front, degrees.
    #[serde(default)]
    pub azimuth: f64,
    /// Above the front, degrees.
    #[serde(default)]
    pub elevation: f64,
    /// Vertical field of view, degrees.
    #[serde(default = "fov")]
    pub fov: f64,
}

fn radii() -> f64 {
    2.5
}

fn fov() -> f64 {
    45.0
}

/// What a camera looks at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum What {
    /// All of the data but far outliers.
    Data,
    /// The selection of that name, as it is at the keyframe; one of a sphere or a box.
    Selection(String),
    /// An object of a catalogue: `file#rank` or `file#name`, from the tour's folder where the path is relative.
    Object(String),
    /// A ball: its middle and its radius, world units.
    Ball([f64; 3], f64),
}

/// A tour that cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum TourError {
    /// Its text is refused.
    #[error(transparent)]
    Ron(#[from] RonError),
    /// It was written by a later version of the program.
    #[error("{file}: version is {found}, expected at most {VERSION_TIME}: a later deepfield has written it")]
    Version {
        /// The tour file.
        file: String,
        /// Its version.
        found: u32,
    },
    /// It cannot be written.
    #[error("{file}: {source}")]
    Write {
        /// The tour file.
        file: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// A catalogue that a keyframe looks for an object in.
    #[error("{file}: keyframe {keyframe}: {source}")]
    Object {
        /// The tour file.
        file: String,
        /// The keyframe's number, from 1.
        keyframe: usize,
        /// What is wrong with it.
        source: Box<ExploreError>,
    },
}

impl TourFile {
    /// Has the exposure and the bloom that a patch says, from its first keyframe on, also where keyframes say others.
    pub fn expose(&mut self, light: &LookPatch) {
        for (index, keyframe) in self.keyframes.iter_mut().enumerate() {
            let says = keyframe.look.exposure.is_some() || keyframe.look.bloom.is_some();
            if index == 0 || says {
                keyframe.look = keyframe.look.then(light);
            }
        }
    }

    /// A tour of these keyframes with everything else as it is by default.
    pub fn new(keyframes: Vec<Keyframe>) -> TourFile {
        TourFile {
            version: VERSION,
            title: String::new(),
            dataset: None,
            size: size(),
            projection: Surround::Flat,
            stereo: None,
            rate: rate(),
            repeats: false,
            up: None,
            comfort: Comfort::default(),
            keys: BTreeMap::new(),
            keyframes,
        }
    }

    /// The direction that is up: y where nobody says another one.
    pub fn upward(&self) -> DVec3 {
        self.up.map_or(DVec3::Y, DVec3::from)
    }

    /// The files that this tour, which is the file `tour`, names: data, catalogues and pictures.
    pub fn files(&self, tour: &Path) -> Vec<PathBuf> {
        let data = self.dataset.iter().flat_map(|dataset| dataset.files(tour));
        let named = self.keyframes.iter().flat_map(|Keyframe { around, images, .. }| {
            let object = around.as_ref().and_then(|around| match &around.what {
                What::Object(named) => named.rsplit_once('#').map(|(file, _)| Path::new(file)),
                _ => None,
            });
            images.iter().flatten().map(|image| image.path.as_path()).chain(object)
        });
        data.chain(named.map(|path| located(path, tour))).collect()
    }

    /// Reads a tour file.
    ///
    /// # Errors
    /// [`TourError::Ron`] and [`TourError::Version`].
    pub fn read(path: &Path) -> Result<TourFile, TourError> {
        let (file, text) = ron_file::read_text(path)?;
        TourFile::parse(&file, &text)
    }

    /// Reads a tour from text; `file` is what errors call it.
    ///
    /// # Errors
    /// [`TourError::Ron`] and [`TourError::Version`].
    pub fn parse(file: &str, text: &str) -> Result<TourFile, TourError> {
        if let Some(found) = ron_file::later_version(text, VERSION_TIME) {
            return Err(TourError::Version { file: file.to_owned(), found });
        }
        let tour: TourFile = ron_file::parse(file, text)?;
        super::check::check(&tour, file, text)?;
        Ok(tour)
    }

    /// Writes it as a tour file, whole or not at all.
    ///
    /// # Errors
    /// [`TourError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), TourError> {
        let written = new_file::write(path, &self.to_ron());
        written.map_err(|source| TourError::Write { file: path.display().to_string(), source })
    }

    /// RON that reads back as this tour.
    pub fn to_ron(&self) -> String {
        // Plain numbers, names, lists and options always have a RON form.
        let style = ron::ser::PrettyConfig::new().depth_limit(4).struct_names(false);
        let has_time = self.keyframes.iter().any(|keyframe| keyframe.look.is_of_runs());
        let version = if has_time { VERSION_TIME } else { VERSION };
        ron::ser::to_string_pretty(&TourFile { version, ..self.clone() }, style).unwrap_or_default()
    }
}
