//! A picture as a user writes it in RON: the file that `deepfield render --config` reads.

use super::{Attribute, LookPatch, OfRun, define_look_text, of_json, with_look_fields};
use crate::color::transfer::TransferFunction;
use crate::model::FamilyName;
use crate::model::ron_file::{self, RonError};
use crate::model::ron_place::Place;
use crate::view::{Stereo, Surround};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// A picture's settings; what is left out keeps its default, and what the command line names overrides it.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(from = "PictureText")]
pub struct PictureConfig {
    /// What it looks like.
    pub look: LookPatch,
    /// The family to draw.
    pub family: Option<FamilyName>,
    /// What volumes emit and absorb, for the modes that draw them.
    pub volume: Option<TransferFunction>,
    /// Width and height, pixels.
    pub size: Option<(u32, u32)>,
    /// What draws.
    pub backend: Option<Backend>,
    /// Where the camera stands.
    pub camera: CameraConfig,
    /// How directions become a picture: flat, dome(aperture: 180.0, tilt: 0.0), equirectangular or cube(layout: cross).
    pub projection: Option<Surround>,
    /// A picture for each eye.
    pub stereo: Option<Stereo>,
    /// A catalogue whose objects are named in the picture.
    pub catalogue: Option<PathBuf>,
    /// Memory for what is read.
    pub residency: Residency,
}

/// Memory for what is read, as presets of the window have it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Residency {
    /// For pages of particles, with what is decoded of them at a time, and for decoded chunks of heights, mebibytes.
    pub budget_mib: Option<u64>,
}

with_look_fields!(
    define_look_text! { read [serde::Deserialize] PictureText of PictureConfig, attribute AttributeName, {
        #[serde(default)]
        family: Option<FamilyName>,
        #[serde(default)]
        volume: Option<TransferFunction>,
        #[serde(default)]
        size: Option<(u32, u32)>,
        #[serde(default)]
        backend: Option<Backend>,
        #[serde(default)]
        camera: CameraConfig,
        #[serde(default)]
        projection: Option<Surround>,
        #[serde(default)]
        stereo: Option<Stereo>,
        #[serde(default)]
        catalogue: Option<PathBuf>,
        #[serde(default)]
        residency: Residency,
    }}
);

/// The attribute that colours the picture, by its name alone.
#[derive(Deserialize)]
#[serde(transparent)]
struct AttributeName(String);

impl From<AttributeName> for Attribute {
    fn from(AttributeName(name): AttributeName) -> Attribute {
        Attribute::Named(name)
    }
}

/// Where the camera stands, in world units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
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

/// What draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// Compute passes.
    Compute,
    /// Blended quads, for adapters without compute shaders; needs blending of 32-bit floats.
    Raster,
    /// The processor.
    Cpu,
}

impl PictureConfig {
    /// Reads a RON file.
    ///
    /// # Errors
    /// [`RonError`] with file, line, column and field.
    pub fn read(path: &Path) -> Result<PictureConfig, RonError> {
        let (file, text) = ron_file::read_text(path)?;
        PictureConfig::parse(&file, &text)
    }

    /// Reads RON text; `file` is what errors call it.
    ///
    /// # Errors
    /// [`RonError`] with file, line, column and field.
    pub fn parse(file: &str, text: &str) -> Result<PictureConfig, RonError> {
        let config: PictureConfig = ron_file::parse(file, text)?;
        let place = Place { file, text };
        config.check(&|path: &[&str], found: String, expected: String| place.refuse(path, found, expected))?;
        Ok(config)
    }

    /// Reads fields in JSON. Of a variant whose fields are all left out the name is enough.
    ///
    /// # Errors
    /// A sentence that begins with the field.
    pub fn of_json(fields: &Map<String, Value>) -> Result<PictureConfig, String> {
        let mut said = Value::Object(fields.clone());
        let of_run = OfRun::take(&mut said)?;
        let mut config = PictureConfig::default();
        for (name, value) in said.as_object().into_iter().flatten() {
            let read: Result<PictureConfig, String> = of_json(&json!({ name: value })).or_else(|error| match value {
                Value::String(variant) => of_json(&json!({ name: { variant: {} } })).map_err(|_| error),
                _ => Err(error),
            });
            config = config.then(read?);
        }
        of_run.give(&mut config.look);
        config.check(&|path: &[&str], found: String, expected: String| {
            format!("{}: found {found}, expected {expected}", path.join(": "))
        })?;
        Ok(config)
    }

    /// What both say, `next` last.
    pub fn then(self, next: PictureConfig) -> PictureConfig {
        PictureConfig {
            look: self.look.then(&next.look),
            family: next.family.or(self.family),
            volume: next.volume.or(self.volume),
            size: next.size.or(self.size),
            backend: next.backend.or(self.backend),
            camera: self.camera.then(next.camera),
            projection: next.projection.or(self.projection),
            stereo: next.stereo.or(self.stereo),
            catalogue: next.catalogue.or(self.catalogue),
            residency: Residency { budget_mib: next.residency.budget_mib.or(self.residency.budget_mib) },
        }
    }

    /// Checks what types cannot. `refuse` makes the error of a field by its path, of what was found and what is expected.
    fn check<E>(&self, refuse: &dyn Fn(&[&str], String, String) -> E) -> Result<(), E> {
        self.look.check(self.look.mode_of_settings(), f64::MIN_POSITIVE..=f64::MAX, refuse)?;
        for (field, value) in [("fov", self.camera.fov), ("ortho", self.camera.ortho)] {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(refuse(&["camera", field], value.to_string(), "a number greater than 0".into()));
            }
        }
        if let Some((field, found, expected)) = self.projection.as_ref().and_then(Surround::mistake) {
            return Err(refuse(&["projection", field], found.to_string(), expected.into()));
        }
        if let Some((_, found, expected)) = self.stereo.as_ref().and_then(Stereo::mistake) {
            return Err(refuse(&["stereo"], found.to_string(), expected.into()));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mistakes_are_named_with_their_place() {
        for (text, expected) in [
            ("(\n  moed: \"points\",\n)", "p.ron:2:"),
            ("(size: \"big\")", "size: "),
            ("(mode: \"points\", settings: {\"radios\": 9.0})", "radios, expected a setting of points: radius"),
            ("(camera: (eye: (0.0, 0.0)))", "p.ron:1:"),
            ("(mode: \"pionts\")", "mode: found pionts, expected one of column-density"),
            (
                "(mode: \"points\", settings: {\"radius\": 99.0})",
                "p.ron:1:30: radius: found 99, expected a number from",
            ),
            (
                "(volume: (opacity: [(0.5, 0.1), (0.2, 0.4)], brightness: [(0.0, 1.0)]))",
                "p.ron:1:43: opacity: points are not sorted: 0.5 comes before 0.2",
            ),
            ("(mode: \"isosurface\", settings: {\"kernel\": \"gauss\"})", "kernel: found gauss, expected one of data"),
            ("(projection: dome(aperture: 361.0))", "aperture: found 361, expected above 0 and at most 360 degrees"),
            ("(error_px: -1.0)", "error_px: found -1, expected a number greater than 0"),
        ] {
            let message = PictureConfig::parse("p.ron", text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }

    #[test]
    fn settings_without_a_mode_are_those_of_some_mode() {
        let modes = |text: &str| PictureConfig::parse("p.ron", text).map(|config| config.look.mode_of_settings().name);
        assert_eq!(modes("(settings: {\"contours\": 100.0})").unwrap(), "surface");
        assert_eq!(modes("(settings: {})").unwrap(), crate::modes::first().name);
        for wrong in ["{\"contorus\": 100.0}", "{\"contours\": true}", "{\"contours\": 100.0, \"kernel\": \"data\"}"] {
            assert!(modes(&format!("(settings: {wrong})")).is_err(), "{wrong}");
        }
    }
}
