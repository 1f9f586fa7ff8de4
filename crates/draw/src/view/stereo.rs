//! Two eyes: beside each other before a flat screen, or on a circle for pictures of all directions.
//!
//! Off-axis: both eyes look in parallel, and each one's picture is shifted so that what is at the distance `zero_parallax`
//! appears at the same place in both: in the plane of the screen.
//!
//! Omnidirectional: the eye from which a direction of azimuth `a` (around the panorama's zenith) is seen stands on a circle of
//! the diameter `separation`, where a head turned to `a` has it: at `+-separation/2` along `right(a) = d forward(a) / da`. A
//! picture is put together from slices of azimuth, each seen from the eye of its middle. Within a slice, at `da` from its
//! middle, the eye is displaced by `separation/2 (2 sin(da/2))`, nearly along the horizontal line of sight: across a line of
//! sight at elevation `e` by at most `separation/2 (da |sin e| + da^2/2)`. At a distance `d` that is an error of
//! [`Omnidirectional::slice_error`] radians.

use super::{Scope, Surround, View, ViewError};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Which eye's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eye {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

impl Eye {
    /// -1 for the left eye, 1 for the right one.
    pub fn sign(self) -> f64 {
        match self {
            Eye::Left => -1.0,
            Eye::Right => 1.0,
        }
    }
}

/// Which eyes a picture holds, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Eyes {
    /// The left one.
    Left,
    /// The right one.
    Right,
    /// Both, the left one at the left: a picture of twice the width.
    #[default]
    #[value(alias = "both")]
    SideBySide,
    /// Both, the left one above: a picture of twice the height.
    OverUnder,
}

impl Eyes {
    /// The eyes, in their order in the picture.
    pub fn each(self) -> &'static [Eye] {
        match self {
            Eyes::Left => &[Eye::Left],
            Eyes::Right => &[Eye::Right],
            Eyes::SideBySide | Eyes::OverUnder => &[Eye::Left, Eye::Right],
        }
    }

    /// The part of a picture of `width` by `height` pixels that each of them sees: left, top, width and height.
    pub fn areas(self, [width, height]: [u32; 2]) -> Vec<[u32; 4]> {
        match self {
            Eyes::Left | Eyes::Right => vec![[0, 0, width, height]],
            Eyes::SideBySide => vec![[0, 0, width / 2, height], [width / 2, 0, width / 2, height]],
            Eyes::OverUnder => vec![[0, 0, width, height / 2], [0, height / 2, width, height / 2]],
        }
    }
}

/// How two eyes see.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stereo {
    /// How the eyes stand: in parallel before a flat picture, or on a circle.
    pub kind: StereoKind,
    /// Distance of the eyes, world units.
    pub separation: f64,
    /// Distance of the screen, world units: what is there is at the same place for both eyes. For omnidirectional pictures, the
    /// distance of the nearest thing that is worth looking at: it decides how fine the slices are.
    pub zero_parallax: f64,
    /// Which eyes the picture holds.
    #[serde(default)]
    pub eyes: Eyes,
}

/// How the eyes stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum StereoKind {
    /// Beside each other, before a flat screen.
    OffAxis,
    /// On a circle, for a dome or an equirectangular picture.
    Omnidirectional,
}

impl Stereo {
    /// What is wrong with the numbers, if anything: field, value, and what is expected.
    pub fn mistake(&self) -> Option<(&'static str, f64, &'static str)> {
        let fields = [("eye separation", self.separation), ("zero-parallax distance", self.zero_parallax)];
        let wrong = fields.into_iter().find(|(_, length)| !(*length > 0.0 && length.is_finite()));
        wrong.map(|(name, length)| (name, length, "a positive length"))
    }

    /// Checks that eyes that stand like this see such a picture.
    ///
    /// # Errors
    /// What goes with what, where they do not.
    pub fn check_for(&self, surround: Surround) -> Result<(), &'static str> {
        let fits = match self.kind {
            StereoKind::OffAxis => surround.is_flat(),
            StereoKind::Omnidirectional => matches!(surround, Surround::Dome { .. } | Surround::Equirectangular),
        };
        match fits {
            true => Ok(()),
            false => Err("stereo: off-axis is for flat pictures, omnidirectional for dome and equirectangular"),
        }
    }

    /// How far an eye is to the right of the middle, world units.
    fn offset(&self, eye: Eye) -> Result<f64, ViewError> {
        match self.mistake() {
            Some((name, value, expected)) => Err(ViewError::OutOfRange { name, value, expected }),
            None => Ok(0.5 * eye.sign() * self.separation),
        }
    }

    /// The view of one eye before a flat screen.
    ///
    /// # Errors
    /// [`ViewError::OutOfRange`] for lengths that make no sense.
    pub fn off_axis(&self, view: &View, eye: Eye) -> Result<View, ViewError> {
        let offset = self.offset(eye)?;
        let shift = offset * view.focal_pixels() / self.zero_parallax;
        Ok(View { eye: view.eye + offset * view.right, shift: [view.shift[0] + shift, view.shift[1]], ..*view })
    }

    /// A view with all that both eyes see before a flat screen, and for whom a selection by it is.
    ///
    /// # Errors
    /// As [`Stereo::off_axis`].
    pub fn both(&self, view: &View) -> Result<(View, Scope), ViewError> {
        let away = self.offset(Eye::Right)?;
        // Beyond the screen an eye sees what another slope shows, before it no more than what is as far beside.
        let beyond = away * view.focal_pixels() / self.zero_parallax;
        Ok((view.padded(beyond.ceil().min(1e6) as u32), Scope::Beside { away }))
    }

    /// The slices of one eye's picture of all directions, whose pixels are `pixel` radians wide: fine enough that the error
    /// stays below half a pixel for what is as far as `zero_parallax`, but no more than [`Omnidirectional::MOST_SLICES`].
    ///
    /// # Errors
    /// [`ViewError::OutOfRange`] for lengths that make no sense.
    pub fn omnidirectional(&self, eye: Eye, pixel: f64) -> Result<Omnidirectional, ViewError> {
        let offset = self.offset(eye)?;
        let half_slice = 0.5 * pixel * self.zero_parallax / offset.abs();
        let slices = (PI / half_slice).ceil().clamp(8.0, f64::from(Omnidirectional::MOST_SLICES));
        Ok(Omnidirectional { offset, slices: slices as u32 })
    }
}

/// One eye's picture of all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Omnidirectional {
    /// The eye's way to the right of the middle, world units.
    pub offset: f64,
    /// Slices of azimuth, all of the same width.
    pub slices: u32,
}

impl Omnidirectional {
    /// Most slices: each is a picture of its own.
    pub const MOST_SLICES: u32 = 360;

    /// The slice of an azimuth (radians, 0 at the front, growing to the right).
    pub fn slice(&self, azimuth: f64) -> u32 {
        let turn = (azimuth / TAU + 0.5).rem_euclid(1.0);
        ((turn * f64::from(self.slices)) as u32).min(self.slices - 1)
    }

    /// The azimuth of a slice's middle.
    pub fn middle(&self, slice: u32) -> f64 {
        ((f64::from(slice) + 0.5) / f64::from(self.slices) - 0.5) * TAU
    }

    /// Where the eye of an azimuth stands, from the circle's middle, for one whose front is `forward`, and to whose right is
    /// `right`.
    pub fn eye(&self, azimuth: f64, right: DVec3, forward: DVec3) -> DVec3 {
        self.offset * (azimuth.cos() * right - azimuth.sin() * forward)
    }

    /// The azimuth in which its eye sees a place that is so far from the circle's middle.
    pub fn azimuth(&self, place: DVec3, right: DVec3, forward: DVec3) -> f64 {
        let [x, z] = [place.dot(right), place.dot(forward)];
        // Lines of sight touch the circle: beside the middle they pass it at the eye's offset.
        x.atan2(z) - (self.offset / x.hypot(z)).clamp(-1.0, 1.0).asin()
    }

    /// The most that slices displace what is seen at a distance (large against the separation) and an elevation, radians.
    pub fn slice_error(&self, distance: f64, elevation: f64) -> f64 {
        let most = PI / f64::from(self.slices);
        self.offset.abs() * (most * elevation.sin().abs() + 0.5 * most * most) / distance
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CubeLayout, Projection};
    use super::*;
    use proptest::prelude::*;

    fn view() -> View {
        let projection = Projection::Perspective { fov_y: 1.0 };
        View::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 1.0, 0.5), DVec3::Z, projection, 300, 200).unwrap()
    }

    const PAIR: Stereo =
        Stereo { kind: StereoKind::OffAxis, separation: 0.1, zero_parallax: 4.0, eyes: Eyes::SideBySide };

    #[test]
    fn eyes_stand_as_the_picture_is_seen() {
        let circle = Stereo { kind: StereoKind::Omnidirectional, ..PAIR };
        let dome = Surround::Dome { aperture: 180.0, tilt: 0.0 };
        let cube = Surround::Cube { layout: CubeLayout::Cross };
        for (surround, fits) in [
            (Surround::Flat, [true, false]),
            (dome, [false, true]),
            (Surround::Equirectangular, [false, true]),
            (cube, [false, false]),
        ] {
            assert_eq!([PAIR, circle].map(|stereo| stereo.check_for(surround).is_ok()), fits, "{surround:?}");
        }
    }

    #[test]
    fn what_is_in_the_plane_of_the_screen_has_no_parallax() {
        let view = view();
        let [left, right] = [Eye::Left, Eye::Right].map(|eye| PAIR.off_axis(&view, eye).unwrap());
        assert!(((right.eye - left.eye).dot(view.right) - 0.1).abs() < 1e-12);
        for pixel in [[10.0, 20.0], [150.0, 100.0], [299.0, 3.0]] {
            let at = |depth: f64| {
                let place = view.at_depth(pixel, depth);
                [left, right].map(|eye| eye.to_pixels(eye.to_camera(place)).unwrap())
            };
            let [a, b] = at(4.0);
            assert!((0..2).all(|k| (a[k] - pixel[k]).abs() < 1e-9 && (b[k] - pixel[k]).abs() < 1e-9));
            // Before the screen the right eye sees it further left; far away the parallax is that of parallel eyes.
            let ([near_left, near_right], [far_left, far_right]) = (at(2.0), at(1e9));
            assert!(near_right[0] < near_left[0] && far_right[0] > far_left[0]);
            let infinity = 0.1 * view.focal_pixels() / 4.0;
            assert!(
                (far_right[0] - far_left[0] - infinity).abs() < 1e-6 && (near_left[1] - near_right[1]).abs() < 1e-9
            );
        }
        for wrong in [Stereo { separation: 0.0, ..PAIR }, Stereo { zero_parallax: f64::INFINITY, ..PAIR }] {
            assert!(wrong.off_axis(&view, Eye::Left).is_err() && wrong.omnidirectional(Eye::Left, 1e-3).is_err());
        }
    }

    proptest! {
        /// What a slice's eye sees is where the exact eye sees it, to the bound; all azimuths belong to the nearest slice.
        #[test]
        fn slices_are_as_exact_as_they_say(
            azimuth in -PI..PI,
            elevation in -1.5..1.5f64,
            distance in 1.0..50.0f64,
            slices in 8u32..300,
        ) {
            let circle = Omnidirectional { offset: 0.03, slices };
            let slice = circle.slice(azimuth);
            let middle = circle.middle(slice);
            prop_assert!((azimuth - middle).abs() <= PI / f64::from(slices) + 1e-12);
            let [exact, used] = [azimuth, middle].map(|azimuth| circle.eye(azimuth, DVec3::X, DVec3::Z));
            prop_assert!((exact.length() - 0.03).abs() < 1e-15);
            let forward = DVec3::new(azimuth.sin(), 0.0, azimuth.cos());
            let sight = elevation.cos() * forward + elevation.sin() * DVec3::Y;
            prop_assert!(exact.dot(sight).abs() < 1e-15, "lines of sight touch the circle");
            let found = circle.azimuth(exact + distance * sight, DVec3::X, DVec3::Z);
            prop_assert!((found - azimuth).sin().abs() < 1e-9, "{found} {azimuth}");
            let place = exact + distance * sight;
            let error = (place - used).angle_between(sight);
            let bound = circle.slice_error(distance, elevation);
            prop_assert!(error <= bound * (1.0 + 0.1 / distance) + 1e-9, "{error} {bound}");
        }
    }
}
