//! Pictures whose splats are not kernels that are added up: what there is none of.

use super::Session;
use crate::cpu::Sprite;
use crate::look::{Backend, Shot};
use crate::mode::{Adapter, Depiction, Output};
use crate::picture::PictureError;

impl Session {
    /// Refuses other footprints than kernels, and splats that lie over each other, where nothing draws them so.
    pub(super) fn check_blend(&self, depiction: &Depiction, shot: &Shot) -> Result<(), PictureError> {
        let (sprite, lies_over) = (depiction.choice.sprite, depiction.choice.order.is_some());
        let asked = match lies_over {
            true => "blend over".to_owned(),
            false if sprite != Sprite::Kernel => format!("footprint {}", sprite.name()),
            false => return Ok(()),
        };
        let technique = depiction.mode.technique;
        let why = match self.options.backend {
            _ if technique.output() != Output::Sums || !technique.on_processor() => {
                format!("the mode {} adds no splats up, expected one that does", depiction.mode.name)
            }
            _ if lies_over && sprite != Sprite::Kernel => {
                format!("lays kernels over each other, found footprint {}", sprite.name())
            }
            Some(Backend::Compute | Backend::Raster) if !lies_over => "only --backend cpu draws it".to_owned(),
            Some(Backend::Raster) => "only --backend compute and cpu draw it".to_owned(),
            Some(Backend::Compute) if depiction.blended().mode.technique.adapter() == Adapter::None => {
                "only --backend cpu draws it".to_owned()
            }
            _ if !lies_over && !shot.surround.is_flat() => "only flat pictures are drawn so".to_owned(),
            _ => return Ok(()),
        };
        Err(PictureError::Asked(format!("{asked}: {why}")))
    }
}
