//! What strokes look like, in pixels and shares.

use super::palette::Palette;
use serde::{Deserialize, Serialize};

/// What a path looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathShape {
    /// A ball with a tail.
    #[default]
    Comet,
    /// A line.
    Line,
    /// A lit tube.
    Tube,
    /// A line with a head.
    Arrow,
}

impl PathShape {
    /// Every shape.
    pub const ALL: [PathShape; 4] = [PathShape::Comet, PathShape::Line, PathShape::Tube, PathShape::Arrow];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            PathShape::Comet => "comet",
            PathShape::Line => "line",
            PathShape::Tube => "tube",
            PathShape::Arrow => "arrow",
        }
    }
}

/// How paths are drawn.
#[derive(Clone, Debug)]
pub struct Style {
    /// What a path looks like.
    pub shape: PathShape,
    /// Width of a path of the mass [`Style::mean_mass`], pixels.
    pub width: f32,
    /// The largest width, pixels.
    pub widest: f32,
    /// The mass that has the width.
    pub mean_mass: f64,
    /// Opacity where nothing fades.
    pub opacity: f32,
    /// Width of the dark rim, pixels.
    pub halo: f32,
    /// Colours.
    pub palette: Palette,
    /// Where highlights are, intervals behind each step; none without.
    pub highlights: Option<f32>,
    /// Whether what leaves a periodic box within an interval is drawn in one piece, not cut at the faces.
    pub unwrapped: bool,
    /// The angle of a pixel that sizes are in, radians, where the view is a face of a panorama: they are the same in every direction. In
    /// flat pictures they are in the view's own pixels.
    pub around: Option<f64>,
}

impl Style {
    /// Half the width of a path of some mass, pixels, and the factor on its opacity: the cross-section's area grows with the mass, and
    /// what would be narrower than a pixel is fainter instead.
    #[inline]
    pub fn half_width(&self, mass: f32) -> [f32; 2] {
        let ratio = if self.mean_mass > 0.0 { (f64::from(mass) / self.mean_mass) as f32 } else { 1.0 };
        let width = (self.width * ratio.max(0.0).sqrt()).min(self.widest);
        [0.5 * width.max(1.0), width.min(1.0)]
    }
}
