//! What browsers may ask: a picture or what is at a place. They name no files, and their pictures have a size that is drawn in a moment.

use super::shown::Shown;
use crate::color::ColorMap;
use crate::color::transfer::{Scale, TransferFunction};
use crate::explore::{Region, Shape};
use crate::look::CameraConfig;
use crate::picture::asked::{Asked, AskedProbe, Question};
use glam::DVec3;
use serde::Deserialize;

/// The most pixels of a picture, and along a side.
const PIXELS: u64 = 4 << 20;
const SIDE: u32 = 8192;
/// Width and height where none are said: a scene's and a tour's own may be those of a dome.
const USUAL: (u32, u32) = (960, 540);
/// The smallest error that pictures are drawn with, pixels.
const LEAST_ERROR: f64 = 0.25;

/// How a picture comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum FrameFormat {
    /// As it is.
    #[default]
    Png,
    /// Smaller, and not quite as it is.
    Jpeg,
}

/// A picture.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct FrameAsked {
    /// Where the camera stands; as the scene says, or around the data, where it says nothing.
    camera: CameraConfig,
    /// Width and height, pixels; 960 and 540 where nothing is said.
    size: Option<(u32, u32)>,
    /// Visualization mode.
    mode: Option<String>,
    /// The attribute that gives the hue.
    attribute: Option<String>,
    /// Name of a transfer function.
    colors: Option<String>,
    /// Colour map in place of its own.
    color_map: Option<ColorMap>,
    /// How values are placed along it.
    color_scale: Option<Scale>,
    /// When, of a run.
    time: Option<f64>,
    /// Largest displacement of a particle on screen, pixels.
    error_px: Option<f64>,
    /// How the picture comes.
    pub(super) format: FrameFormat,
    /// The moment of the tour in place of all this but for the size, seconds.
    pub(super) tour: Option<f64>,
}

/// What is at a place of the last picture.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct PickAsked {
    /// Where in the picture: shares of its width from the left, and of its height from above.
    pub(super) at: [f64; 2],
    /// What is there at the target's distance, world units, and the radius of what is asked about around it.
    pub(super) place: Option<[f64; 3]>,
    pub(super) radius: Option<f64>,
    /// When, of a run.
    time: Option<f64>,
}

impl FrameAsked {
    /// Width and height, pixels.
    ///
    /// # Errors
    /// A sentence, for a picture that is not drawn in a moment.
    pub(super) fn size(&self) -> Result<(u32, u32), String> {
        let (width, height) = self.size.unwrap_or(USUAL);
        let is_side = |side: u32| (1..=SIDE).contains(&side);
        match is_side(width) && is_side(height) && u64::from(width) * u64::from(height) <= PIXELS {
            true => Ok((width, height)),
            false => Err(format!("size: found {width} x {height}, expected 1 to {SIDE} and at most {PIXELS} pixels")),
        }
    }

    /// What that is of the data that is shown.
    ///
    /// # Errors
    /// A sentence that names the field.
    pub(super) fn asked(&self, shown: &Shown) -> Result<Asked, String> {
        if let Some(name) =
            self.colors.as_deref().filter(|name| TransferFunction::presets().all(|known| known != *name))
        {
            let names: Vec<&str> = TransferFunction::presets().collect();
            return Err(format!("colors: found {name:?}, expected one of {}", names.join(", ")));
        }
        let size = Some(self.size()?);
        Ok(Asked {
            scene: shown.scene.as_ref().map(|(_, text)| text.clone()),
            scene_file: shown.scene.as_ref().map(|(file, _)| file.clone()),
            mode: self.mode.clone(),
            attribute: self.attribute.clone(),
            size,
            camera: self.camera,
            error_px: self.error_px.map(|error| error.max(LEAST_ERROR)),
            transfer: self.colors.clone(),
            color_map: self.color_map.clone(),
            color_scale: self.color_scale,
            time: self.time.map(|time| time.to_string()),
            memory: Some(shown.memory),
            ..Asked::default()
        })
    }
}

impl PickAsked {
    /// The question about particles around the place; nothing where no place is said.
    pub(super) fn probe(&self) -> Option<AskedProbe> {
        let (center, radius) = (DVec3::from(self.place?), self.radius?);
        let region = Region { shapes: vec![Shape::Sphere { center, radius }], ..Region::default() };
        let of = Question { region, time: self.time.map(|time| time.to_string()), ..Question::default() };
        // Their number and mass are enough.
        Some(AskedProbe { of, fields: Some(Vec::new()), ..AskedProbe::default() })
    }
}
