//! Who sees what of pictures that are put together: of faces around an eye, or for two eyes.

use crate::cpu::surface::labels::eyes::EyePart;
use crate::cpu::surface::sight::Sight;
use crate::look::Shot;
use crate::picture::PictureError;
use crate::view::{Eye, Eyes, Panorama, View, ViewError};

/// Who looks from the middle of the eyes that a shot has, and what each of them sees.
///
/// # Errors
/// Projections and eyes that make no sense.
pub(super) fn eyes_of(view: &View, shot: &Shot) -> Result<(Sight, Vec<EyePart>), PictureError> {
    let panorama = Panorama::around(view, shot.surround)?;
    let around = |panorama| Sight::Around { panorama, eye: view.eye, cut: view.cut };
    let middle = panorama.map_or(Sight::Flat(*view), around);
    let Some(stereo) = shot.stereo else {
        return Ok((middle, vec![EyePart { corner: [0; 2], sight: middle, circle: None }]));
    };
    let [width, height] = middle.size();
    let part = |(number, eye): (u32, Eye)| -> Result<EyePart, ViewError> {
        let corner = if stereo.eyes == Eyes::OverUnder { [0, number * height] } else { [number * width, 0] };
        Ok(match panorama {
            None => EyePart { corner, sight: Sight::Flat(stereo.off_axis(view, eye)?), circle: None },
            Some(panorama) => {
                let circle = Some(stereo.omnidirectional(eye, panorama.pixel_angle())?);
                EyePart { corner, sight: middle, circle }
            }
        })
    };
    let parts = (0..).zip(stereo.eyes.each().iter().copied()).map(part).collect::<Result<_, ViewError>>()?;
    Ok((middle, parts))
}
