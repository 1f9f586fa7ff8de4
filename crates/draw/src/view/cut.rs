//! What of the data a picture shows at all: a box outside of which nothing is drawn, a slab across an axis, and particles
//! that fade with their depth. A property of the view, so that every renderer and the selection of nodes mean the same.

use super::{Periodic, View};
use crate::model::{Bounds, PeriodicBox};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What a view leaves out and fades, as renderers use it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Particles whose centres lie outside are not drawn, world units.
    pub bounds: Bounds,
    /// Depth up to which particles keep their weight, world units.
    pub fade_start: f64,
    /// Behind that a particle's weight falls as `exp(-rate (depth - start))`, per world unit; 0: none fades.
    pub fade_rate: f64,
    /// Whether depth is the distance from the eye, as in pictures of all directions, not that from its plane.
    pub around: bool,
}

impl Cut {
    /// Everything is drawn as it is.
    pub const NONE: Cut = Cut { bounds: Bounds::EVERYTHING, fade_start: 0.0, fade_rate: 0.0, around: false };

    /// Whether everything is drawn as it is.
    pub fn is_none(&self) -> bool {
        *self == Cut::NONE
    }

    /// Whether any particle is left out for where it is.
    pub fn clips(&self) -> bool {
        self.bounds != Bounds::EVERYTHING
    }

    /// Whether a particle at this place is drawn.
    pub fn keeps(&self, world: DVec3) -> bool {
        world.cmpge(self.bounds.min).all() && world.cmple(self.bounds.max).all()
    }

    /// Whether a particle in this box may be drawn.
    pub fn reaches(&self, bounds: &Bounds) -> bool {
        bounds.max.cmpge(self.bounds.min).all() && bounds.min.cmple(self.bounds.max).all()
    }

    /// The same in coordinates whose origin is displaced by `-offset`.
    pub fn moved(&self, offset: DVec3) -> Cut {
        Cut { bounds: self.bounds.moved(offset), ..*self }
    }

    /// The factor on the weight of a particle at this depth, from 0 to 1.
    #[inline]
    pub fn fade(&self, depth: f64) -> f64 {
        // Mostly nothing fades, and this is asked of every sample.
        if self.fade_rate == 0.0 { 1.0 } else { (-self.fade_rate * (depth - self.fade_start).max(0.0)).exp() }
    }
}

/// What a user asks to be left out and faded, in world units; checked when it is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CutSettings {
    /// A box outside of which nothing is drawn.
    pub clip: Option<ClipBox>,
    /// A slab outside of which nothing is drawn.
    pub slab: Option<Slab>,
    /// Particles fade with their depth.
    pub fade: Option<Fade>,
    /// How a periodic box is drawn.
    pub periodic: Periodic,
}

/// An axis-aligned box; `min` is not above `max` along any axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, try_from = "ClipText", into = "ClipText")]
pub struct ClipBox {
    /// Smallest coordinates.
    pub min: DVec3,
    /// Largest coordinates.
    pub max: DVec3,
}

/// A box as it is written.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename = "ClipBox")]
struct ClipText {
    min: [f64; 3],
    max: [f64; 3],
}

impl TryFrom<ClipText> for ClipBox {
    type Error = String;

    fn try_from(ClipText { min, max }: ClipText) -> Result<ClipBox, String> {
        let (min, max) = (DVec3::from(min), DVec3::from(max));
        match min.is_finite() && max.is_finite() && min.cmple(max).all() {
            true => Ok(ClipBox { min, max }),
            false => {
                Err(format!("clip is from {min} to {max}, expected finite numbers, none of min above that of max"))
            }
        }
    }
}

impl From<ClipBox> for ClipText {
    fn from(ClipBox { min, max }: ClipBox) -> ClipText {
        ClipText { min: min.to_array(), max: max.to_array() }
    }
}

/// An axis of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// The first coordinate.
    X,
    /// The second coordinate.
    Y,
    /// The third coordinate.
    #[default]
    Z,
}

impl Axis {
    /// Every axis, in the order of coordinates.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// Its number among the coordinates.
    pub const fn index(self) -> usize {
        match self {
            Axis::X => 0,
            Axis::Y => 1,
            Axis::Z => 2,
        }
    }

    /// Its name in RON and in the panel.
    pub const fn as_str(self) -> &'static str {
        match self {
            Axis::X => "x",
            Axis::Y => "y",
            Axis::Z => "z",
        }
    }
}

/// What lies within half of `thickness` from `middle` along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slab {
    /// The axis that it lies across.
    pub axis: Axis,
    /// Where along the axis.
    #[serde(deserialize_with = "finite")]
    pub middle: f64,
    /// How thick it is, above 0.
    #[serde(deserialize_with = "positive")]
    pub thickness: f64,
}

/// How particles fade.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fade {
    /// Depth from the eye's plane up to which particles keep their weight.
    #[serde(deserialize_with = "finite")]
    pub start: f64,
    /// Depth behind that within which the weight falls to 1/e, above 0.
    #[serde(deserialize_with = "positive")]
    pub length: f64,
}

fn finite<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    number(deserializer, "a finite number", f64::is_finite)
}

fn positive<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    number(deserializer, "a finite number above 0", |value| value.is_finite() && value > 0.0)
}

fn number<'de, D: serde::Deserializer<'de>>(
    deserializer: D,
    expected: &str,
    takes: impl Fn(f64) -> bool,
) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    if takes(value) { Ok(value) } else { Err(serde::de::Error::custom(format!("found {value}, expected {expected}"))) }
}

impl CutSettings {
    /// The view with what is left out of it, and with the images of the data's periodic box, where there is one, for one who looks
    /// at `target`.
    pub fn applied(&self, view: &View, target: DVec3, periodic: Option<PeriodicBox>) -> View {
        let (images, window) = self.periodic.images(periodic, target);
        let mut cut = self.cut();
        cut.bounds.min = cut.bounds.min.max(window.min);
        cut.bounds.max = cut.bounds.max.min(window.max);
        View { cut, images, ..*view }
    }

    /// What it comes to, images left aside.
    pub fn cut(&self) -> Cut {
        let mut cut = Cut::NONE;
        if let Some(clip) = self.clip {
            cut.bounds = Bounds { min: clip.min, max: clip.max };
        }
        if let Some(slab) = self.slab {
            let axis = slab.axis.index();
            cut.bounds.min[axis] = cut.bounds.min[axis].max(slab.middle - 0.5 * slab.thickness);
            cut.bounds.max[axis] = cut.bounds.max[axis].min(slab.middle + 0.5 * slab.thickness);
        }
        if let Some(fade) = self.fade {
            (cut.fade_start, cut.fade_rate) = (fade.start, 1.0 / fade.length);
        }
        cut
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ron_file;
    use proptest::prelude::*;

    #[test]
    fn a_slab_narrows_the_box_and_a_fade_falls_to_an_eth() {
        let settings: CutSettings = ron_file::parse(
            "cut.ron",
            "(clip: (min: (0.0, 0.0, 0.0), max: (4.0, 4.0, 4.0)), slab: (axis: y, middle: 3.5, thickness: 2.0),
              fade: (start: 10.0, length: 2.0))",
        )
        .unwrap();
        let cut = settings.cut();
        assert_eq!(cut.bounds, Bounds { min: DVec3::new(0.0, 2.5, 0.0), max: DVec3::splat(4.0) });
        assert_eq!((cut.fade(-5.0), cut.fade(10.0)), (1.0, 1.0));
        assert!((cut.fade(12.0) - (-1.0f64).exp()).abs() < 1e-15);
        assert!(CutSettings::default().cut().is_none() && !Cut::NONE.clips() && cut.clips());
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_its_place() {
        for (text, expected) in [
            ("(\n clip: (min: (0.0, 5.0, 0.0), max: (4.0, 4.0, 4.0)))", "cut.ron:2:"),
            (
                "(slab: (axis: y, middle: 3.5, thickness: -2.0))",
                "thickness: found -2, expected a finite number above 0",
            ),
            ("(slab: (axis: w, middle: 3.5, thickness: 2.0))", "axis"),
            ("(fade: (start: 3.5, length: inf))", "length: found inf, expected a finite number above 0"),
            ("(fade: (start: 3.5, depth: 2.0))", "depth"),
        ] {
            let message = ron_file::parse::<CutSettings>("cut.ron", text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }

    proptest! {
        /// A box that holds a particle that is drawn is reached.
        #[test]
        fn no_node_with_a_kept_particle_is_left_out(
            corner in prop::array::uniform3(-3.0..3.0f64),
            size in prop::array::uniform3(0.0..2.0f64),
            inside in prop::array::uniform3(0.0..=1.0f64),
            clip in prop::array::uniform3(-3.0..3.0f64),
            extent in prop::array::uniform3(0.0..3.0f64),
        ) {
            let (min, clip) = (DVec3::from(corner), DVec3::from(clip));
            let node = Bounds { min, max: min + DVec3::from(size) };
            let particle = (min + DVec3::from(size) * DVec3::from(inside)).min(node.max);
            let cut = Cut { bounds: Bounds { min: clip, max: clip + DVec3::from(extent) }, ..Cut::NONE };
            prop_assert!(!cut.keeps(particle) || cut.reaches(&node));
        }
    }
}
