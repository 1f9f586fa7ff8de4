//! Pictures whose splats lie over each other: what there is none of.

use super::Session;
use crate::look::{Backend, Shot};
use crate::mode::{Depiction, Output};
use crate::picture::PictureError;

impl Session {
    /// Refuses splats that lie over each other where nothing draws them so.
    pub(super) fn check_blend(&self, depiction: &Depiction, shot: &Shot) -> Result<(), PictureError> {
        if depiction.choice.order.is_none() {
            return Ok(());
        }
        let technique = depiction.mode.technique;
        let why = match self.options.backend {
            _ if technique.output() != Output::Sums || !technique.on_processor() => {
                format!("the mode {} has its own order, expected add", depiction.mode.name)
            }
            Some(Backend::Compute | Backend::Raster) => "only --backend cpu draws it".to_owned(),
            _ if !shot.surround.is_flat() => "only flat pictures are drawn so, expected add".to_owned(),
            _ => return Ok(()),
        };
        Err(PictureError::Asked(format!("blend over: {why}")))
    }
}
