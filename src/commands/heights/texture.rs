//! A photo over heights, as the user names it.

use crate::heights::import::PhotoChoice;
use crate::look::HeightsSaid;

/// A photo over heights.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Height fields")]
pub struct TextureOptions {
    /// A picture (PNG, JPEG, TIFF) that is laid over the heights: over all of them, so that the first and the last sample are at its outer
    /// corners, or over the rectangle between two corners in the unit of x and y.
    #[arg(long, value_name = "PHOTO[@X0,Y0,X1,Y1]", value_parser = PhotoChoice::parse)]
    pub texture: Option<PhotoChoice>,
}

impl TextureOptions {
    /// What is said of heights, with the photo.
    pub fn with(&self, said: HeightsSaid) -> HeightsSaid {
        HeightsSaid { texture: self.texture.clone(), ..said }
    }

    /// Refuses a photo where there are no heights.
    ///
    /// # Errors
    /// Where there is one.
    pub fn refuse(&self) -> Result<(), String> {
        match &self.texture {
            None => Ok(()),
            Some(photo) => {
                Err(format!("{}: --texture: found no heights to lay it over, expected some", photo.path.display()))
            }
        }
    }
}
