//! How opaque surfaces keep light from each other: ambient occlusion and soft shadows, found from depths.
//!
//! What draws a surface hands over a depth for each pixel; what is darkened are colours, and no value is. [`ambient_occlusion`] looks at the
//! picture's own depths, [`shadows`] at those of the same scene as places of a lamp see it. Both depend on nothing but depths and settings,
//! so that a picture is the same whenever it is drawn. What is beside the picture or behind something hides nothing from [`ambient_occlusion`].
//!
//! Where several kinds of data stand in one picture, each is darkened as what it is, by the nearest depths of all of them: [`Others`].

pub mod ambient_occlusion;
mod depth_picture;
pub mod shadows;

#[cfg(test)]
mod tests;

use crate::color::Colors;
use crate::cpu::paths::{PathFragment, PathFragments};
use crate::view::View;
use depth_picture::DepthPicture;
use glam::DVec3;
use rayon::prelude::*;

/// What is at least as opaque is a surface that others darken.
pub const COVERS: f32 = 0.5;

/// The lamp that casts shadows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// The direction to its middle, in the world's axes, a unit vector. It is far away.
    pub toward: DVec3,
    /// Its diameter as it is seen from the scene, radians; 0: a point.
    pub size: f64,
    /// Whether it is what surfaces are lit by, as steep as they face it (Lambert). Else they are lit from the eye, and it does no more than
    /// cast shadows.
    pub lights: bool,
}

/// How surfaces darken each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadowing {
    /// The share of a colour that is gone where ambient occlusion leaves no light, from 0 (none) to 1.
    pub occlusion: f64,
    /// What is further away occludes nothing, world units.
    pub radius: f64,
    /// The share of a lamp's light that is gone where it does not reach, from 0 (none) to 1.
    pub shadows: f64,
    /// The lamp; without one there are no shadows.
    pub lamp: Option<Lamp>,
    /// The share of light that comes from everywhere, from 0 to 1, which no shadow takes.
    pub ambient: f64,
    /// The diameter of all that is drawn, world units: nothing that casts shadows is further away.
    pub scene: f64,
    /// How far the surface of one picture may be from that of another picture of the same scene, world units.
    pub slack: f64,
    /// Whether depths from elsewhere take as long as a picture: then one of them serves all places of a lamp that are near each other, no finer
    /// than their shadows are soft.
    pub is_costly: bool,
    /// Directions around a pixel in which [`ambient_occlusion`] looks, and places of a lamp that is no point.
    pub samples: u32,
}

/// Draws the depths of what hides light, pixel by pixel, from any view; `None` where there is nothing in it.
pub type Casters<'a> = dyn Fn(&View) -> Option<Vec<f32>> + Sync + 'a;

/// What covers the pixels of a picture: it is darkened, and hides light.
#[derive(Clone, Debug, Default)]
pub struct Covering {
    /// Its depth in each pixel, row by row; infinite where nothing covers.
    pub depths: Vec<f32>,
    /// What it adds to each pixel's colour, linear light; without, pixels that it covers show nothing else.
    pub light: Option<Vec<[f32; 3]>>,
    /// How far it may be from that of another picture of the same scene, world units.
    pub slack: f64,
}

/// Everything else in a picture that hides light from what is drawn.
#[derive(Clone, Copy)]
pub struct Others<'a> {
    /// Its depths.
    pub casters: &'a Casters<'a>,
    /// The diameter of all that the picture shows, with what is drawn, world units.
    pub scene: f64,
    /// The sun that some of it has: what has a lamp of its own has this one, so that all shadows fall to one side.
    pub sun: Option<Lamp>,
}

/// What the light of a picture depends on beside what is drawn and its settings.
#[derive(Clone, Copy, Default)]
pub struct Lighting<'a> {
    /// The camera that a lamp beside the eye goes with, where that is not the view itself: what a panorama's faces are around.
    pub camera: Option<&'a View>,
    /// What else hides light.
    pub others: Option<Others<'a>>,
}

impl Shadowing {
    /// Whether anything is darkened.
    pub fn is_on(&self) -> bool {
        self.occlusion > 0.0 || self.lamp_of_shadows().is_some()
    }

    /// The same for a scene that is so many times as large.
    #[must_use]
    pub fn scaled(self, size: f64) -> Shadowing {
        let [radius, scene, slack] = [self.radius, self.scene, self.slack].map(|length| length * size);
        Shadowing { radius, scene, slack, ..self }
    }

    fn lamp_of_shadows(&self) -> Option<Lamp> {
        self.lamp.filter(|_| self.shadows > 0.0)
    }

    /// The same in a scene with something else.
    fn among(self, others: &Others<'_>) -> Shadowing {
        let larger = if self.scene > 0.0 { others.scene / self.scene } else { 1.0 };
        let lamp = self.lamp.map(|own| others.sun.map_or(own, |sun| Lamp { lights: own.lights, ..sun }));
        Shadowing { radius: self.radius * larger, scene: others.scene, lamp, ..self }
    }

    /// What each pixel's colour is multiplied by, row by row, where a surface has these depths in a view (infinite where there is nothing of it);
    /// `own` draws it from elsewhere. What is behind something else has a factor, too, since that may cover it in part. `None` where there are not as
    /// many depths as pixels.
    pub fn factors(
        &self,
        view: &View,
        depths: &[f32],
        own: &Casters<'_>,
        others: Option<&Others<'_>>,
    ) -> Option<Vec<f32>> {
        let whole = others.map_or(*self, |others| self.among(others));
        let picture = DepthPicture::new(view, depths)?;
        let mut factors = match whole.occlusion > 0.0 {
            true => {
                let beside = others.and_then(|others| (others.casters)(view));
                let scene = beside.and_then(|beside| DepthPicture::new(view, &nearer(depths.to_vec(), Some(beside))));
                ambient_occlusion::open_shares(
                    &picture,
                    scene.as_ref().unwrap_or(&picture),
                    whole.radius,
                    whole.samples,
                )
            }
            false => vec![1.0; depths.len()],
        };
        factors.par_iter_mut().for_each(|share| *share = 1.0 - whole.occlusion as f32 * (1.0 - *share));
        if let Some(lamp) = whole.lamp_of_shadows() {
            let all = |from: &View| nearest(own(from), others.and_then(|others| (others.casters)(from)));
            let reached = shadows::reached_shares(&picture, &lamp, &whole, &all);
            factors.par_iter_mut().zip(&reached).for_each(|(factor, reached)| {
                *factor *= whole.in_shadow(&lamp, *reached);
            });
        }
        Some(factors)
    }

    /// What a colour is multiplied by where so much of a lamp reaches it.
    fn in_shadow(&self, lamp: &Lamp, reached: shadows::Reached) -> f32 {
        let ambient = self.ambient as f32;
        let share = match lamp.lights {
            // Of a colour times `ambient + (1 - ambient) cosine` the lamp's part.
            true => {
                let direct = (1.0 - ambient) * reached.cosine;
                if direct > 0.0 { direct / (ambient + direct) } else { 0.0 }
            }
            false => 1.0 - ambient,
        };
        1.0 - self.shadows as f32 * share * (1.0 - reached.share)
    }

    /// Darkens the colours of a view's picture with these depths.
    pub fn darken(
        &self,
        view: &View,
        depths: &[f32],
        colors: &mut Colors,
        own: &Casters<'_>,
        others: Option<&Others<'_>>,
    ) {
        let Some(factors) = self.factors(view, depths, own, others) else { return };
        colors.rgba.par_iter_mut().zip(&factors).for_each(|([r, g, b, _], factor)| {
            [r, g, b].into_iter().for_each(|channel| *channel *= factor);
        });
    }

    /// Darkens of the colours of a view's picture what covers its pixels.
    pub fn darken_covering(
        &self,
        view: &View,
        covering: &Covering,
        colors: &mut Colors,
        own: &Casters<'_>,
        others: Option<&Others<'_>>,
    ) {
        let whole = Shadowing { slack: covering.slack, ..*self };
        let Some(light) = &covering.light else {
            whole.darken(view, &covering.depths, colors, own, others);
            return;
        };
        let Some(factors) = whole.factors(view, &covering.depths, own, others) else { return };
        colors.rgba.par_iter_mut().zip(&factors).zip(light).for_each(|((pixel, factor), light)| {
            for (channel, light) in pixel.iter_mut().zip(light) {
                *channel = (*channel - (1.0 - factor) * light).max(0.0);
            }
        });
    }

    /// Darkens in each pixel of a view's picture the first fragment that covers it: what is in front of that is seen through, and neither
    /// hides light nor is hidden.
    pub fn darken_fragments(
        &self,
        view: &View,
        fragments: &mut PathFragments,
        own: &Casters<'_>,
        others: Option<&Others<'_>>,
    ) {
        let Some(factors) = self.factors(view, &covering_depths(fragments), own, others) else { return };
        let (size, side) = (fragments.size, fragments.side.max(1));
        let across = size[0].div_ceil(side).max(1);
        for (index, tile) in fragments.tiles.iter_mut().enumerate() {
            let (left, top) = (index % across * side, index / across * side);
            let width = side.min(size[0].saturating_sub(left)).max(1);
            for (pixel, ends) in tile.starts.windows(2).enumerate() {
                let (x, y) = (left + pixel % width, top + pixel / width);
                let factor = factors.get(y * size[0] + x).copied().unwrap_or(1.0);
                let own = tile.fragments.get_mut(ends[0] as usize..ends[1] as usize).unwrap_or_default();
                if let Some(covering) = own.iter_mut().find(|fragment| covers(fragment)) {
                    covering.color.iter_mut().for_each(|channel| *channel *= factor);
                }
            }
        }
    }
}

/// The depths of what is nearest of two things that hide light; `None` where there is neither.
pub fn nearest(one: Option<Vec<f32>>, other: Option<Vec<f32>>) -> Option<Vec<f32>> {
    match one {
        Some(one) => Some(nearer(one, other)),
        None => other,
    }
}

fn nearer(mut one: Vec<f32>, other: Option<Vec<f32>>) -> Vec<f32> {
    // What has another size is of another view.
    if let Some(other) = other.filter(|other| other.len() == one.len()) {
        one.par_iter_mut().zip(other).for_each(|(depth, other)| *depth = depth.min(other));
    }
    one
}

fn covers(fragment: &PathFragment) -> bool {
    fragment.alpha >= COVERS
}

/// The depth of the first fragment of each pixel that covers it, row by row; infinite where none does.
pub fn covering_depths(fragments: &PathFragments) -> Vec<f32> {
    let [width, height] = fragments.size;
    let depth = |index: usize| {
        let covering = fragments.of(index % width, index / width).iter().find(|fragment| covers(fragment));
        covering.map_or(f32::INFINITY, |fragment| fragment.depth)
    };
    (0..width * height).into_par_iter().map(depth).collect()
}
