//! What particles are drawn among: heights, images and volumes, which hide light from each other.

use super::fields::FieldsAmong;
use super::heights::HeightsAmong;
use crate::color::Colors;
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::ambient_occlusion::FARTHEST;
use crate::cpu::shadowing::{Casters, Lighting, Others, nearest};
use crate::look::Shot;
use crate::mode::{LightPicture, Raw};
use crate::picture::PictureError;
use crate::picture::ground::{Ground, SceneLight};
use crate::picture::projected::Projector;
use crate::picture::surface::SurfaceDepths;
use crate::view::View;
use std::sync::{Mutex, PoisonError};

/// What particles are drawn among.
pub(super) struct Among<'a> {
    pub(super) heights: HeightsAmong<'a>,
    pub(super) fields: FieldsAmong,
    /// The diameter of all that the picture shows.
    pub(super) scene: f64,
    /// How far what covers pixels is away in the last picture.
    pub(super) depths: Mutex<Option<SurfaceDepths>>,
}

impl Among<'_> {
    /// Why something could not be read or drawn.
    pub(super) fn error(&self) -> Option<String> {
        self.heights.error().or_else(|| self.fields.error())
    }

    /// The light of one kind, from which others hide some as `casters` draw.
    fn lit<'l>(&self, lighting: &Lighting<'l>, casters: &'l Casters<'l>) -> Lighting<'l> {
        let SceneLight { scene, sun, .. } = self.light();
        Lighting { others: Some(Others { casters, scene, sun }), ..*lighting }
    }

    /// The heights of a view, from which fields and all else hide light.
    fn lit_heights(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments {
        let casters = |from: &View| nearest(self.fields.opaque(from, view, None), beside(lighting, from));
        self.heights.fragments(view, &self.lit(lighting, &casters))
    }
}

/// The depths of what else hides light than what a ground shows.
fn beside(lighting: &Lighting<'_>, from: &View) -> Option<Vec<f32>> {
    (lighting.others?.casters)(from)
}

impl Ground for Among<'_> {
    fn fragments(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments {
        let heights = (!self.heights.is_empty()).then(|| self.lit_heights(view, lighting));
        let casters = |from: &View| nearest(self.heights.opaque(from), beside(lighting, from));
        let fields = self.fields.fragments(view, &self.lit(lighting, &casters));
        let found = match heights {
            None => fields,
            Some(heights) => heights.merged(&fields),
        };
        *self.depths.lock().unwrap_or_else(PoisonError::into_inner) = SurfaceDepths::of_fragments(view, &found);
        found
    }

    fn is_filter(&self) -> bool {
        !self.fields.is_empty()
    }

    fn solid(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments {
        if self.heights.is_empty() { PathFragments::nothing(view) } else { self.lit_heights(view, lighting) }
    }

    fn light(&self) -> SceneLight {
        let shadowing = self.heights.shadowing();
        let is_darkened = shadowing.is_some() || self.fields.are_darkened();
        SceneLight {
            scene: self.scene,
            sun: shadowing.and_then(|shadowing| shadowing.lamp),
            is_darkened,
            margin_px: if is_darkened { FARTHEST } else { 0 },
        }
    }

    fn opaque(&self, from: &View, view: &View) -> Option<Vec<f32>> {
        nearest(self.heights.opaque(from), self.fields.opaque(from, view, None))
    }
}

/// What there is without particles, in colours.
pub(super) fn alone(ground: &Among<'_>, shot: &Shot, view: &View) -> Result<Colors, PictureError> {
    if !shot.is_projected() {
        return Ok(ground.fragments(view, &Lighting::default()).colors());
    }
    let projector = Projector::new(*view, shot.surround, shot.stereo)?;
    let lighting = Lighting { camera: Some(&projector.base), others: None };
    let each = |view: &View| Ok(Some(Raw::Light(LightPicture::of(ground.fragments(view, &lighting).colors()))));
    match projector.draw_each(true, ground.light().margin_px, each)? {
        Raw::Light(light) => Ok(light.colors),
        Raw::Sums(..) => Err(PictureError::Stopped),
    }
}
