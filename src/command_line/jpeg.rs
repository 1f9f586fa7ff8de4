//! Pictures as JPEG.

use crate::color::Image;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// A picture as a JPEG file, without its opacity.
///
/// # Errors
/// A sentence, for a picture of more than 65,535 pixels along a side.
pub fn jpeg(image: &Image, quality: u8) -> Result<Vec<u8>, String> {
    let side = |side: u32| u16::try_from(side).map_err(|_| format!("{side} pixels are too many for a JPEG picture"));
    let (width, height) = (side(image.width)?, side(image.height)?);
    let mut jpeg = Vec::new();
    let mut encoder = Encoder::new(&mut jpeg, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder.encode(image.rgba.as_flattened(), width, height, ColorType::Rgba).map_err(|error| error.to_string())?;
    Ok(jpeg)
}
