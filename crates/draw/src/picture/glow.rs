//! Where bright light spreads in a picture: over a flat one, within each eye's, across the seam of a map of all directions and not beyond a
//! dome's rim.

use super::error::PictureError;
use crate::color::Colors;
use crate::color::bloom::{Bloom, Part};
use crate::look::Shot;
use crate::view::Surround;

/// Spreads the light of a whole picture, which is as dark as a screen then.
///
/// # Errors
/// For cubes, where what lies beside an edge is elsewhere in the picture.
pub(super) fn spread(bloom: &Bloom, light: &mut Colors, shot: &Shot) -> Result<(), PictureError> {
    for part in parts([light.width, light.height], shot)? {
        bloom.spread_in(light, &part);
    }
    light.fit_screen();
    Ok(())
}

/// The parts of a shot's picture within which light spreads.
fn parts(size: [u32; 2], shot: &Shot) -> Result<Vec<Part>, PictureError> {
    let (wraps, is_round) = match shot.surround {
        Surround::Flat => (false, false),
        Surround::Dome { .. } => (false, true),
        Surround::Equirectangular => (true, false),
        Surround::Cube { .. } => {
            let why =
                "bloom: light does not spread over the edges of a cube, expected another projection or strength 0";
            return Err(PictureError::Asked(why.into()));
        }
    };
    let areas = shot.stereo.map_or_else(|| vec![[0, 0, size[0], size[1]]], |stereo| stereo.eyes.areas(size));
    Ok(areas.into_iter().map(|area| Part { area, wraps, is_round }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::{CubeLayout, Eyes, Stereo, StereoKind};

    #[test]
    fn each_eye_sees_its_own_light() {
        let stereo = |eyes| Some(Stereo { kind: StereoKind::OffAxis, separation: 0.1, zero_parallax: 1.0, eyes });
        let light = || {
            let mut light = Colors { width: 40, height: 40, rgba: vec![[0.0, 0.0, 0.0, 1.0]; 1600] };
            light.rgba[10 * 40 + 10] = [1.0; 4];
            light
        };
        let bloom = Bloom { strength: 1.0, threshold: 0.0, radius: 0.5 };
        let lit = |shot: &Shot| {
            let mut light = light();
            spread(&bloom, &mut light, shot).unwrap();
            let lit = light.rgba.iter().enumerate().filter(|(_, pixel)| pixel[0] > 0.0);
            lit.fold([0; 2], |[x, y], (i, _)| [x.max(i % 40), y.max(i / 40)])
        };
        let of = |surround, stereo| Shot { surround, stereo, ..Shot::default() };
        assert_eq!(lit(&of(Surround::Flat, stereo(Eyes::SideBySide))), [19, 39]);
        assert_eq!(lit(&of(Surround::Flat, stereo(Eyes::OverUnder))), [39, 19]);
        // Across the seam, to the other edge.
        assert_eq!(lit(&of(Surround::Equirectangular, None))[0], 39);
        let cube = of(Surround::Cube { layout: CubeLayout::Cross }, None);
        assert!(spread(&bloom, &mut light(), &cube).is_err());
    }
}
