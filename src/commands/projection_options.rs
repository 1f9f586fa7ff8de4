//! Projections on the command line: domes, cube maps, maps of all directions, and pictures for two eyes.

use super::arguments::positive;
use crate::view::{CubeLayout, Eyes, Stereo, StereoKind, Surround};

/// How directions become a picture.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct ProjectionOptions {
    /// flat (perspective, or orthographic with --ortho), dome (dome master: azimuthal equidistant), cube or equirectangular
    /// [default: flat]: around the camera's eye, with its target as the front. The size of a cube's picture is one face's.
    #[arg(long, value_name = "NAME")]
    pub projection: Option<ProjectionName>,
    /// Angle from rim to rim of a dome master, degrees, up to 360 [default: 180].
    #[arg(long, value_name = "DEG", value_parser = positive)]
    pub aperture: Option<f64>,
    /// How far the dome leans towards the front, degrees: 0 has the zenith in the middle, 90 the front [default: 0].
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub tilt: Option<f64>,
    /// A cube's faces in one picture (cross or strip), or files: OUT.right.png and five more [default: cross].
    #[arg(long, value_name = "HOW")]
    pub layout: Option<CubeLayout>,
    /// A picture for each eye: off-axis (flat), or omnidirectional (dome and equirectangular).
    #[arg(long, value_name = "HOW", requires = "eye_separation", requires = "zero_parallax")]
    pub stereo: Option<StereoKind>,
    /// Distance of the eyes, world units.
    #[arg(long, value_name = "LENGTH", value_parser = positive)]
    pub eye_separation: Option<f64>,
    /// Distance of the screen, world units; omnidirectional: of the nearest thing that matters.
    #[arg(long, value_name = "LENGTH", value_parser = positive)]
    pub zero_parallax: Option<f64>,
    /// Whose picture: left, right, side-by-side or over-under [default: side-by-side].
    #[arg(long, value_name = "WHOSE")]
    pub eyes: Option<Eyes>,
}

/// A projection's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ProjectionName {
    /// Perspective or orthographic.
    Flat,
    /// Azimuthal equidistant.
    Dome,
    /// Six faces.
    Cube,
    /// Longitude and latitude.
    Equirectangular,
}

impl ProjectionOptions {
    /// The projection's name, where a file says `own`.
    fn named(&self, own: Surround) -> ProjectionName {
        self.projection.unwrap_or(match own {
            Surround::Flat => ProjectionName::Flat,
            Surround::Dome { .. } => ProjectionName::Dome,
            Surround::Cube { .. } => ProjectionName::Cube,
            Surround::Equirectangular => ProjectionName::Equirectangular,
        })
    }

    /// The projection and the eyes, where a file says `surround` and `stereo`.
    ///
    /// # Errors
    /// Options that do not belong together, and numbers out of range.
    pub fn over(&self, surround: Surround, stereo: Option<Stereo>) -> Result<(Surround, Option<Stereo>), String> {
        let (aperture, tilt) = match surround {
            Surround::Dome { aperture, tilt } => (aperture, tilt),
            _ => (180.0, 0.0),
        };
        let layout = match surround {
            Surround::Cube { layout } => layout,
            _ => CubeLayout::default(),
        };
        let named = self.named(surround);
        if named != ProjectionName::Dome && (self.aperture.is_some() || self.tilt.is_some()) {
            return Err("--aperture and --tilt are for --projection dome".into());
        }
        if named != ProjectionName::Cube && self.layout.is_some() {
            return Err("--layout is for --projection cube".into());
        }
        let surround = match named {
            ProjectionName::Flat => Surround::Flat,
            ProjectionName::Dome => {
                Surround::Dome { aperture: self.aperture.unwrap_or(aperture), tilt: self.tilt.unwrap_or(tilt) }
            }
            ProjectionName::Cube => Surround::Cube { layout: self.layout.unwrap_or(layout) },
            ProjectionName::Equirectangular => Surround::Equirectangular,
        };
        if let Some((name, found, expected)) = surround.mistake() {
            return Err(format!("--{name}: found {found}, expected {expected}"));
        }
        let stereo = match (self.stereo, stereo) {
            (Some(kind), own) => Some(Stereo {
                kind,
                separation: self.eye_separation.unwrap_or(0.0),
                zero_parallax: self.zero_parallax.unwrap_or(0.0),
                eyes: self.eyes.or(own.map(|own| own.eyes)).unwrap_or_default(),
            }),
            (None, Some(own)) => Some(Stereo {
                separation: self.eye_separation.unwrap_or(own.separation),
                zero_parallax: self.zero_parallax.unwrap_or(own.zero_parallax),
                eyes: self.eyes.unwrap_or(own.eyes),
                ..own
            }),
            (None, None) if self.eyes.is_some() || self.eye_separation.is_some() || self.zero_parallax.is_some() => {
                return Err("--eyes, --eye-separation and --zero-parallax are for --stereo".into());
            }
            (None, None) => None,
        };
        if let Some((name, found, expected)) = stereo.as_ref().and_then(Stereo::mistake) {
            return Err(format!("{name}: found {found}, expected {expected}"));
        }
        stereo.map_or(Ok(()), |stereo| stereo.check_for(surround))?;
        Ok((surround, stereo))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAIR: Stereo =
        Stereo { kind: StereoKind::OffAxis, separation: 0.1, zero_parallax: 4.0, eyes: Eyes::OverUnder };

    #[test]
    fn options_override_the_file_and_must_fit() {
        let none = ProjectionOptions::default();
        let file = Surround::Dome { aperture: 210.0, tilt: 15.0 };
        assert_eq!(none.over(file, None), Ok((file, None)));
        let tilt = ProjectionOptions { tilt: Some(-5.0), ..none.clone() };
        assert_eq!(tilt.over(file, None), Ok((Surround::Dome { aperture: 210.0, tilt: -5.0 }, None)));
        assert!(tilt.over(Surround::Flat, None).is_err(), "a tilt without a dome");
        let flat = ProjectionOptions { projection: Some(ProjectionName::Flat), ..none.clone() };
        let left = ProjectionOptions { eyes: Some(Eyes::Left), ..flat.clone() };
        assert_eq!(flat.over(file, Some(PAIR)), Ok((Surround::Flat, Some(PAIR))));
        assert_eq!(left.over(file, Some(PAIR)), Ok((Surround::Flat, Some(Stereo { eyes: Eyes::Left, ..PAIR }))));
        assert!(left.over(file, None).is_err() && none.over(file, Some(PAIR)).is_err());
        let wide = ProjectionOptions { aperture: Some(400.0), ..none.clone() };
        assert!(wide.over(file, None).unwrap_err().contains("aperture: found 400"));
        let cube = Surround::Cube { layout: CubeLayout::Strip };
        let circle = Stereo { kind: StereoKind::Omnidirectional, ..PAIR };
        assert!(none.over(cube, Some(circle)).is_err() && none.over(file, Some(circle)).is_ok());
    }
}
