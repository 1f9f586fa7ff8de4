//! Outputs as a user describes them: RON, of which a misspelled field is an error that names the place.

use super::mpcdi::{self, MpcdiError};
use crate::annotate::overlay::OverlayError;
use crate::model::ron_file::{self, RonError};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The version of output files that this program reads.
pub const VERSION: u32 = 1;

/// The outputs of a show.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputsFile {
    /// [`VERSION`].
    pub version: u32,
    /// The outputs.
    pub outputs: Vec<Output>,
}

/// A window for the audience.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// What it is called; each name once.
    pub name: String,
    /// The monitor that it fills; a window on the desktop where it is `None`.
    #[serde(default)]
    pub monitor: Option<Monitor>,
    /// Left, top, width and height, physical pixels from the monitor's corner (the desktop's without one); all of the monitor
    /// where it is `None`.
    #[serde(default)]
    pub window: Option<(i32, i32, u32, u32)>,
    /// What it displays.
    #[serde(default)]
    pub shows: Shows,
    /// A PFM file: for each point of the output, rows from the top, the point of the picture that appears there: shares of its
    /// width from the left and of its height from the top.
    #[serde(default)]
    pub warp: Option<PathBuf>,
    /// A PNG file by which the picture's light is multiplied.
    #[serde(default)]
    pub blend: Option<PathBuf>,
    /// Values of `blend` to this power are shares of light.
    #[serde(default = "gamma")]
    pub blend_gamma: f64,
}

fn gamma() -> f64 {
    1.0
}

/// A monitor.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Monitor {
    /// Its number in the system's order, from 1.
    Number(u32),
    /// Its name as the system has it.
    Named(String),
}

/// What an output displays of the directions around the show's camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shows {
    /// A part of the flat picture whose width is `aspect` times its height, and whose height the camera's field of view spans.
    Flat {
        /// Width for height of the whole picture; the output's own where it is `None`.
        #[serde(default)]
        aspect: Option<f64>,
        /// The part.
        #[serde(default)]
        part: Area,
    },
    /// What a projector or screen at the eye's place sees.
    Frustum(Frustum),
    /// A part of a dome master.
    Dome {
        /// Angle from rim to rim, degrees.
        #[serde(default = "half")]
        aperture: f64,
        /// How far the dome leans towards the front, degrees.
        #[serde(default)]
        tilt: f64,
        /// The part; of a picture that is as wide as it is high.
        #[serde(default)]
        part: Area,
    },
    /// A region of an MPCDI file, with its own warp and blend.
    Mpcdi {
        /// The file.
        file: PathBuf,
        /// The region's id; the only one where it is `None`.
        #[serde(default)]
        region: Option<String>,
        /// The order of the rows of its warp, where what is found from the warp is wrong.
        #[serde(default)]
        rows: Option<Rows>,
    },
}

/// Where the first row of a map is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "the names say it")]
pub enum Rows {
    Top,
    Bottom,
}

fn half() -> f64 {
    180.0
}

impl Default for Shows {
    fn default() -> Shows {
        Shows::Flat { aspect: None, part: Area::default() }
    }
}

/// Left, top, right and bottom as shares of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Area(pub f64, pub f64, pub f64, pub f64);

impl Default for Area {
    fn default() -> Area {
        Area(0.0, 0.0, 1.0, 1.0)
    }
}

impl Area {
    /// The point of the whole that a point of the part is.
    pub fn at(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.0 + x * (self.2 - self.0), self.1 + y * (self.3 - self.1)]
    }

    /// Whether it is a part of a whole from 0 to 1, and not too narrow.
    pub fn is_part(self) -> bool {
        let inside = [self.0, self.1, self.2, self.3].iter().all(|share| (0.0..=1.0).contains(share));
        inside && self.2 - self.0 >= 1e-3 && self.3 - self.1 >= 1e-3
    }
}

/// A frustum from the eye, degrees, as MPCDI has it: first turned to the right by `yaw`, then up by `pitch`, then clockwise by
/// `roll`; its edges are at angles from its axis, to the left and down negative.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Frustum {
    #[serde(default)]
    pub yaw: f64,
    #[serde(default)]
    pub pitch: f64,
    #[serde(default)]
    pub roll: f64,
    pub left: f64,
    pub right: f64,
    pub down: f64,
    pub up: f64,
}

impl Frustum {
    /// What is wrong with it: the field, its value, what was expected.
    pub fn mistake(&self) -> Option<(&'static str, f64, &'static str)> {
        for (name, angle) in [("yaw", self.yaw), ("pitch", self.pitch), ("roll", self.roll)] {
            if !(-360.0..=360.0).contains(&angle) {
                return Some((name, angle, "-360 to 360 degrees"));
            }
        }
        let edges = [("left", self.left), ("right", self.right), ("down", self.down), ("up", self.up)];
        for (name, angle) in edges {
            if !(-85.0..=85.0).contains(&angle) {
                return Some((name, angle, "-85 to 85 degrees"));
            }
        }
        if self.right - self.left < 0.01 {
            return Some(("right", self.right, "an angle to the right of `left`"));
        }
        (self.up - self.down < 0.01).then_some(("up", self.up, "an angle above `down`"))
    }
}

/// Outputs that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The text is refused.
    #[error(transparent)]
    Ron(#[from] RonError),
    /// No output has that name.
    #[error("{file}: no output is called {name}; there are {names}")]
    Unknown {
        /// The file.
        file: String,
        /// What was asked for.
        name: String,
        /// What there is.
        names: String,
    },
    /// A warp or blend file cannot be used.
    #[error("{}: {message}", path.display())]
    Data {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what was expected.
        message: String,
    },
    /// A blend picture cannot be used.
    #[error(transparent)]
    Picture(#[from] OverlayError),
    /// A rig cannot be used.
    #[error(transparent)]
    Mpcdi(#[from] MpcdiError),
    /// No flat picture covers it.
    #[error("{name}: {source}")]
    Cover {
        /// The output.
        name: String,
        /// Why not.
        source: super::CoverError,
    },
}

impl OutputsFile {
    /// Reads a file of outputs, or makes one of an MPCDI rig: its regions in their order on the system's monitors.
    ///
    /// # Errors
    /// [`OutputError::Ron`] and [`OutputError::Mpcdi`].
    pub fn read(path: &Path) -> Result<OutputsFile, OutputError> {
        let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        if name.ends_with(".mpcdi") || name.ends_with(".mpcdi.xml") {
            return OutputsFile::of_rig(path);
        }
        let file: OutputsFile = ron_file::read(path)?;
        file.check(&path.display().to_string())?;
        Ok(file)
    }

    fn of_rig(path: &Path) -> Result<OutputsFile, OutputError> {
        let file = PathBuf::from(path.file_name().unwrap_or_default());
        let output = |(i, id): (usize, String)| Output {
            name: id.replace(['#', '/', '\\'], "_"),
            monitor: Some(Monitor::Number(i as u32 + 1)),
            window: None,
            shows: Shows::Mpcdi { file: file.clone(), region: Some(id), rows: None },
            warp: None,
            blend: None,
            blend_gamma: gamma(),
        };
        let outputs = mpcdi::regions(path)?.into_iter().enumerate().map(output).collect();
        let outputs = OutputsFile { version: VERSION, outputs };
        outputs.check(&path.display().to_string())?;
        Ok(outputs)
    }

    /// The output of that name.
    ///
    /// # Errors
    /// [`OutputError::Unknown`].
    pub fn output(&self, file: &Path, name: &str) -> Result<&Output, OutputError> {
        self.outputs.iter().find(|output| output.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.outputs.iter().map(|output| output.name.as_str()).collect();
            OutputError::Unknown { file: file.display().to_string(), name: name.to_owned(), names: names.join(", ") }
        })
    }

    fn check(&self, file: &str) -> Result<(), RonError> {
        if self.version != VERSION {
            return Err(RonError::value(file, "version", self.version, VERSION.to_string()));
        }
        if !(1..=64).contains(&self.outputs.len()) {
            return Err(RonError::value(
                file,
                "outputs",
                format!("a list of {}", self.outputs.len()),
                "1 to 64 outputs",
            ));
        }
        for (i, output) in self.outputs.iter().enumerate() {
            let refuse = |field: &str, found: &dyn ToString, expected: &str| {
                let field = format!("outputs[{i}] ({}).{field}", output.name);
                Err(RonError::value(file, &field, found.to_string(), expected))
            };
            if output.name.is_empty() || output.name.len() > 64 || output.name.contains(['#', '/', '\\']) {
                return refuse("name", &output.name, "1 to 64 letters without #, / and \\");
            }
            if self.outputs[..i].iter().any(|other| other.name == output.name) {
                return refuse("name", &output.name, "each name once");
            }
            if let Some((left, top, width, height)) = output.window
                && !((1..=16384).contains(&width)
                    && (1..=16384).contains(&height)
                    && left.abs() <= 65536
                    && top.abs() <= 65536)
            {
                let found = format!("({left}, {top}, {width}, {height})");
                return refuse("window", &found, "left, top, width and height, up to 16384 pixels");
            }
            if output.monitor == Some(Monitor::Number(0)) {
                return refuse("monitor", &"number(0)", "numbers from 1");
            }
            if !(0.1..=10.0).contains(&output.blend_gamma) {
                return refuse("blend_gamma", &output.blend_gamma, "0.1 to 10");
            }
            let part = match &output.shows {
                Shows::Flat { part, aspect } => {
                    if let Some(aspect) = aspect.filter(|aspect| !(0.01..=100.0).contains(aspect)) {
                        return refuse("shows.aspect", &aspect, "0.01 to 100");
                    }
                    *part
                }
                Shows::Dome { aperture, tilt, part } => {
                    let dome = crate::view::Surround::Dome { aperture: *aperture, tilt: *tilt };
                    if let Some((field, found, expected)) = dome.mistake() {
                        return refuse(&format!("shows.{field}"), &found, expected);
                    }
                    *part
                }
                Shows::Frustum(frustum) => {
                    if let Some((field, found, expected)) = frustum.mistake() {
                        return refuse(&format!("shows.{field}"), &found, expected);
                    }
                    Area::default()
                }
                Shows::Mpcdi { .. } => {
                    if output.warp.is_some() || output.blend.is_some() {
                        return refuse("warp, blend", &"a file", "none beside shows: mpcdi, which has its own");
                    }
                    Area::default()
                }
            };
            if !part.is_part() {
                return refuse("shows.part", &format!("{part:?}"), "left, top, right, bottom from 0 to 1");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<OutputsFile, String> {
        let file: OutputsFile = ron_file::parse("rig.ron", text).map_err(|error| error.to_string())?;
        file.check("rig.ron").map_err(|error| error.to_string())?;
        Ok(file)
    }

    #[test]
    fn rigs_are_read_and_every_mistake_is_named() {
        let file = parse(
            r#"(version: 1, outputs: [
                (name: "wall", monitor: number(2), shows: flat(aspect: 3.2, part: (0.0, 0.0, 0.5, 1.0))),
                (name: "dome", window: (0, 0, 800, 600), shows: dome(tilt: 20.0, part: (0.5, 0.5, 1.0, 1.0)), blend: "soft.png"),
                (name: "left", monitor: named("HDMI-1"), shows: frustum((yaw: -40.0, left: -25.0, right: 20.0, down: -15.0, up: 18.0)), warp: "left.pfm"),
                (name: "measured", shows: mpcdi(file: "rig.mpcdi", region: "projector 1", rows: top)),
                (name: "plain"),
            ])"#,
        )
        .unwrap();
        assert_eq!(file.outputs.len(), 5);
        assert!(matches!(file.outputs[1].shows, Shows::Dome { aperture: 180.0, tilt: 20.0, .. }));
        let one = |rest: &str| parse(&format!("(version: 1, outputs: [(name: \"a\", {rest})])")).unwrap_err();
        for (rest, part) in [
            ("shows: flat(part: (0.0, 0.0, 0.0, 1.0))", "shows.part"),
            ("shows: dome(aperture: 400.0)", "shows.aperture"),
            ("shows: frustum((left: -10.0, right: -20.0, down: -1.0, up: 1.0))", "shows.right"),
            ("shows: frustum((left: -10.0, right: 89.0, down: -1.0, up: 1.0))", "shows.right"),
            ("shows: mpcdi(file: \"a\"), blend: \"b\"", "warp, blend"),
            ("window: (0, 0, 0, 10)", "window"),
            ("monitor: number(0)", "monitor"),
            ("blend_gamma: 0.0", "blend_gamma"),
            ("wrap: \"a\"", "wrap"),
        ] {
            let message = one(rest);
            assert!(message.starts_with("rig.ron") && message.contains(part), "{rest}: {message}");
        }
        assert!(parse("(version: 2, outputs: [(name: \"a\")])").unwrap_err().contains("version is 2"));
        assert!(parse("(version: 1, outputs: [(name: \"a\"), (name: \"a\")])").unwrap_err().contains("each name once"));
        assert!(parse("(version: 1, outputs: [])").unwrap_err().contains("1 to 64"));
    }
}
