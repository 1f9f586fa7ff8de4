//! Heights along lines in pictures that are put together: of what two eyes see, and of faces around an eye.
//!
//! Where they stand is found once, in what is seen from the middle between the eyes. Each eye has them at the same places of the surface, and none
//! of which one eye does not see all.

use super::super::rays::Caster;
use super::super::sight::Sight;
use super::{ContourLabel, HALF_HEIGHT, are_apart, each_spared};
use crate::view::Omnidirectional;
use glam::{DVec2, DVec3};

/// What one eye sees of a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EyePart {
    /// Its left upper corner in the picture, pixels.
    pub(crate) corner: [u32; 2],
    /// Who looks; from the middle of a circle, where an eye turns on one.
    pub(crate) sight: Sight,
    /// The circle of an eye that turns with what it sees.
    pub(crate) circle: Option<Omnidirectional>,
}

impl EyePart {
    /// Who sees a place of the world.
    fn toward(&self, place: DVec3) -> Sight {
        let (Sight::Around { panorama, eye, cut }, Some(circle)) = (self.sight, self.circle) else { return self.sight };
        let azimuth = circle.azimuth(place - eye, panorama.right, panorama.forward);
        let eye = eye + circle.eye(azimuth, panorama.right, panorama.forward);
        Sight::Around { panorama, eye, cut }
    }
}

/// A height as one eye sees it.
#[derive(Clone, Debug)]
pub(crate) struct SeenLabel {
    /// In the pixels of what that eye sees.
    pub(crate) label: ContourLabel,
    /// Who looks.
    pub(crate) sight: Sight,
}

impl SeenLabel {
    /// The columns and rows of the eye's pixels that have no lines, as the height stands there.
    pub(crate) fn behind(&self) -> Vec<[usize; 2]> {
        let mut pixels = Vec::new();
        each_spared(&self.label, self.sight.size().map(|side| side as usize), |x, y| pixels.push([x, y]));
        pixels
    }
}

/// The heights, which have been placed in what is seen from the `middle`, as each of the eyes sees them: those that all of them see, and that are
/// over each other for none.
pub(crate) fn for_each(
    eyes: &[EyePart],
    labels: &[ContourLabel],
    middle: &Sight,
    caster: &Caster<'_>,
) -> Vec<Vec<SeenLabel>> {
    let mut kept: Vec<Vec<SeenLabel>> = vec![Vec::new(); eyes.len()];
    for label in labels {
        let Some(place) = place(caster, middle, label.middle) else { continue };
        let seen: Option<Vec<SeenLabel>> =
            eyes.iter().map(|eye| seen_by(eye.toward(place), place, label, middle, caster)).collect();
        let Some(seen) = seen else { continue };
        let is_free =
            seen.iter().zip(&kept).all(|(own, kept)| kept.iter().all(|other| are_apart(&own.label, &other.label, 0.0)));
        if is_free {
            kept.iter_mut().zip(seen).for_each(|(kept, own)| kept.push(own));
        }
    }
    kept
}

/// Where in the world what is seen at a place of a picture is.
fn place(caster: &Caster<'_>, sight: &Sight, at: [f64; 2]) -> Option<DVec3> {
    let hit = caster.cast_pixel(sight, &sight.lens(), at)?;
    let (origin, direction) = sight.ray(at)?;
    Some(origin + hit.t * direction)
}

/// A height at a place of the world as an eye sees it; `None` where a part of it is beside the picture or behind something.
fn seen_by(sight: Sight, at: DVec3, label: &ContourLabel, middle: &Sight, caster: &Caster<'_>) -> Option<SeenLabel> {
    if sight == *middle {
        return Some(SeenLabel { label: label.clone(), sight });
    }
    let (seen, _) = sight.project(at - sight.eye())?;
    let own = ContourLabel { middle: seen, ..label.clone() };
    let ([left, top, right, bottom], [width, height]) = (own.area(), sight.size().map(f64::from));
    if left < 0.0 || top < 0.0 || right > width || bottom > height {
        return None;
    }
    // What is before it is elsewhere for the other eye.
    let (em, along) = (label.half[1] / HALF_HEIGHT, label.half[0] * DVec2::from_angle(label.angle));
    let is_seen = [-1.0, 0.0, 1.0].into_iter().all(|way| {
        let [here, there] = [own.middle, label.middle].map(|middle| DVec2::from(middle) + way * along);
        let from_middle = place(caster, &sight, here.to_array()).and_then(|at| middle.project(at - middle.eye()));
        from_middle.is_some_and(|(at, _)| DVec2::from(at).distance(there) < em)
    });
    is_seen.then_some(SeenLabel { label: own, sight })
}

#[cfg(test)]
mod tests;
