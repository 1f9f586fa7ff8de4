//! Measured surfaces, images and volumes in a picture of something else: one depth for all of it.

use crate::color::Accumulation;
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Casters, Lamp, Lighting, Others};
use crate::view::View;
use rayon::prelude::*;
use std::borrow::Cow;

/// What particles, paths and volumes are drawn among.
pub trait Ground: Sync {
    /// What each pixel of a view shows of it, from front to back, in colours and with depths in the view's lengths.
    fn fragments(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments;

    /// How light is in the picture.
    fn light(&self) -> SceneLight;

    /// The depths from anywhere of what of it hides light in the picture of a view; `None` where nothing does.
    fn opaque(&self, from: &View, view: &View) -> Option<Vec<f32>>;

    /// Whether some of it is seen through, as a volume is: what is added up behind that has its own colours, and less light.
    fn is_filter(&self) -> bool {
        false
    }

    /// What of it is not seen through.
    fn solid(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments {
        self.fragments(view, lighting)
    }
}

/// How light is in a picture of a ground.
#[derive(Clone, Copy, Debug)]
pub struct SceneLight {
    /// The diameter of all that it shows, world units.
    pub scene: f64,
    /// The sun of what has one.
    pub sun: Option<Lamp>,
    /// Whether any of the ground is darkened.
    pub is_darkened: bool,
    /// How far beyond the picture darkening looks, pixels.
    pub margin_px: u32,
}

/// What light has that is among a ground, which hides it as `casters` draw.
pub(super) fn lighting<'a>(ground: Option<&dyn Ground>, casters: &'a Casters<'a>) -> Lighting<'a> {
    let others = ground.map(|ground| {
        let SceneLight { scene, sun, .. } = ground.light();
        Others { casters, scene, sun }
    });
    Lighting { camera: None, others }
}

/// What of a ground is not seen through.
pub(super) struct Solid<'a>(pub &'a dyn Ground);

impl Ground for Solid<'_> {
    fn fragments(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments {
        self.0.solid(view, lighting)
    }

    fn light(&self) -> SceneLight {
        self.0.light()
    }

    fn opaque(&self, from: &View, view: &View) -> Option<Vec<f32>> {
        self.0.opaque(from, view)
    }
}

/// The share of each pixel's sums that comes through what is before them; `whole` is what there would be without that.
pub(super) fn through(seen: &Accumulation, whole: &Accumulation) -> Vec<f32> {
    let share = |(seen, whole): (&f32, &f32)| if *whole > 0.0 { (seen / whole).clamp(0.0, 1.0) } else { 1.0 };
    seen.p.par_iter().zip(&whole.p).map(share).collect()
}

/// What something is drawn among: paths, surfaces or both.
pub(super) fn among(paths: Option<PathFragments>, surfaces: Option<&PathFragments>) -> Option<Cow<'_, PathFragments>> {
    match (paths, surfaces) {
        (Some(paths), Some(surfaces)) => Some(Cow::Owned(surfaces.merged(&paths))),
        (Some(paths), None) => Some(Cow::Owned(paths)),
        (None, surfaces) => surfaces.map(Cow::Borrowed),
    }
}
