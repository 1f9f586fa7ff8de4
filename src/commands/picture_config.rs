//! What a picture looks like, as RON: the file that `render --config` reads.

use super::annotate::AnnotateOptions;
use super::arguments::PictureSize;
use super::render_arguments::{Arguments, Backend};
use crate::annotate::Annotations;
use crate::color::composite::Background;
use crate::color::transfer::TransferFunction;
use crate::mode::Settings;
use crate::mode::setting::SettingError;
use crate::model::FamilyName;
use crate::model::ron_file::{self, RonError};
use crate::modes;
use crate::view::{CutSettings, Stereo, Surround};
use glam::DVec3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A picture's settings; what is left out keeps its default, and what the command line names overrides it.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PictureConfig {
    /// Visualization mode.
    pub mode: Option<String>,
    /// Settings of the mode that differ from their defaults.
    pub settings: Settings,
    /// The family to draw.
    pub family: Option<FamilyName>,
    /// The attribute that colours the picture.
    pub attribute: Option<String>,
    /// From the accumulation to colours.
    pub transfer: Option<TransferFunction>,
    /// What volumes emit and absorb, for the modes that draw them.
    pub volume: Option<TransferFunction>,
    /// Width and height, pixels.
    pub size: Option<(u32, u32)>,
    /// What draws.
    pub backend: Option<Backend>,
    /// Largest displacement of a particle on screen, pixels.
    pub error_px: Option<f64>,
    /// Where the camera stands.
    pub camera: CameraConfig,
    /// How directions become a picture: flat, dome(aperture: 180.0, tilt: 0.0), equirectangular or cube(layout: cross).
    pub projection: Surround,
    /// A picture for each eye.
    pub stereo: Option<Stereo>,
    /// What is left out of the data and faded.
    pub cut: CutSettings,
    /// What is behind the picture.
    pub background: Option<Background>,
    /// A catalogue whose objects are named in the picture.
    pub catalogue: Option<PathBuf>,
    /// What is written into the picture.
    pub annotations: Option<Annotations>,
}

/// Where the camera stands, in world units.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraConfig {
    /// Position.
    pub eye: Option<[f64; 3]>,
    /// The point looked at.
    pub target: Option<[f64; 3]>,
    /// The direction that points up.
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    pub fov: Option<f64>,
    /// Height of an orthographic picture.
    pub ortho: Option<f64>,
}

impl PictureConfig {
    /// Reads a RON file.
    ///
    /// # Errors
    /// [`RonError`] with the file, and with line, column and field where the text is wrong.
    pub fn read(path: &Path) -> Result<PictureConfig, RonError> {
        ron_file::read::<PictureConfig>(path)?.checked(&path.display().to_string())
    }

    /// The configuration, if all its values make sense.
    fn checked(self, file: &str) -> Result<PictureConfig, RonError> {
        let mode = match &self.mode {
            Some(name) => modes::find(name)
                .ok_or_else(|| RonError::value(file, "mode", name, format!("one of {}", modes::names())))?,
            None => modes::first(),
        };
        self.settings.check(mode).map_err(|error| match error {
            SettingError::Unknown { name, expected, .. } => {
                let expected = format!("a setting of {}: {expected}", mode.name);
                RonError::value(file, "a name in settings", name, expected)
            }
            SettingError::Value { name, found, expected } => {
                RonError::value(file, &format!("settings.{name}"), found, expected)
            }
        })?;
        let numbers =
            [("error_px", self.error_px), ("camera.fov", self.camera.fov), ("camera.ortho", self.camera.ortho)];
        for (field, value) in numbers {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(RonError::value(file, field, value, "a number greater than 0"));
            }
        }
        let wrong = self.projection.mistake().map(|wrong| ("projection", wrong));
        let wrong = wrong.or(self.stereo.as_ref().and_then(Stereo::mistake).map(|wrong| ("stereo", wrong)));
        if let Some((field, (name, found, expected))) = wrong {
            return Err(RonError::value(file, &format!("{field}: {name}"), found, expected));
        }
        Ok(self)
    }

    /// The arguments, with this configuration where they say nothing.
    pub fn complete(self, arguments: &Arguments) -> Arguments {
        let camera = self.camera;
        let has_projection = arguments.fov.is_some() || arguments.ortho.is_some();
        let own = arguments.clone();
        Arguments {
            size: own.size.or(self.size.map(|(width, height)| PictureSize { width, height })),
            backend: own.backend.or(self.backend),
            mode: own.mode.or(self.mode.as_deref().and_then(modes::find)),
            family: own.family.or(self.family),
            attribute: own.attribute.or(self.attribute),
            eye: own.eye.or(camera.eye.map(DVec3::from)),
            target: own.target.or(camera.target.map(DVec3::from)),
            up: own.up.or(camera.up.map(DVec3::from)),
            fov: if has_projection { own.fov } else { camera.fov },
            ortho: if has_projection { own.ortho } else { camera.ortho },
            error_px: own.error_px.or(self.error_px),
            settings: {
                // The mode's own settings go with the mode that the file names.
                let mut settings = if own.mode.is_some() { self.settings.common() } else { self.settings };
                settings.0.extend(own.settings.0.clone());
                settings
            },
            // One named on the command line is for whatever is drawn.
            volume: own.transfer.clone().or(self.volume),
            transfer: own.transfer.clone().or(self.transfer),
            annotations: self.annotations,
            annotate: AnnotateOptions {
                labels: own.annotate.labels.clone().or(self.catalogue),
                ..own.annotate.clone()
            },
            background: own.background.or(self.background),
            surround: self.projection,
            stereo_pair: self.stereo,
            cut: self.cut,
            ..own
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str, file: &str) -> Result<PictureConfig, RonError> {
        ron_file::parse::<PictureConfig>(file, text)?.checked(file)
    }

    #[test]
    fn the_example_is_read_and_the_command_line_overrides_it() {
        let config = parse(include_str!("../../configs/picture.ron"), "picture.ron").unwrap();
        let mut arguments = Arguments::new("a".into(), "b.png".into());
        arguments.error_px = Some(3.0);
        arguments.fov = Some(20.0);
        let complete = config.complete(&arguments);
        assert_eq!(complete.mode.map(|mode| mode.name), Some("density-squared"));
        assert_eq!((complete.error_px, complete.fov, complete.ortho), (Some(3.0), Some(20.0), None));
        assert!(complete.transfer.is_some());
    }

    #[test]
    fn the_example_of_a_volume_is_read() {
        let config = parse(include_str!("../../configs/volume.ron"), "volume.ron").unwrap();
        let complete = config.complete(&Arguments::new("a".into(), "b.png".into()));
        assert!(complete.volume.is_some() && complete.mode.is_some_and(|mode| mode.is_light()));
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        for (text, expected) in [
            ("(\n  moed: \"points\",\n)", "p.ron:2:"),
            ("(size: \"big\")", "size: "),
            ("(mode: \"points\", settings: {\"radios\": 9.0})", "radios, expected a setting of points: radius"),
            ("(camera: (eye: (0.0, 0.0)))", "p.ron:1:"),
            ("(mode: \"pionts\")", "mode is pionts, expected one of column-density"),
            ("(mode: \"points\", settings: {\"radius\": 99.0})", "radius is 99, expected a number from"),
            (
                "(volume: (opacity: [(0.5, 0.1), (0.2, 0.4)], brightness: [(0.0, 1.0)]))",
                "p.ron:1:43: opacity: points are not sorted: 0.5 comes before 0.2",
            ),
            (
                "(mode: \"isosurface\", settings: {\"kernel\": \"gauss\"})",
                "settings.kernel is gauss, expected one of data",
            ),
            ("(projection: dome(aperture: 361.0))", "aperture is 361, expected above 0 and at most 360 degrees"),
            ("(error_px: -1.0)", "error_px is -1, expected a number greater than 0"),
        ] {
            let message = parse(text, "p.ron").unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
