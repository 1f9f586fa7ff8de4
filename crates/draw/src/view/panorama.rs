//! Pictures of all directions around an eye, as planetariums and headsets want them: pure maps between pixels and
//! directions, each with its exact inverse and the solid angle of a pixel.
//!
//! A panorama has a frame like a camera's: `forward` is the front, `up` the zenith, and `right` is `forward x up`.
//!
//! - Dome master: azimuthal equidistant. The angle from the dome's axis grows evenly with the distance from the picture's
//!   middle, up to half of `aperture` at the rim of the largest circle. With `tilt` 0 the axis is the zenith, the front is at
//!   the bottom, right is right. `tilt` leans the dome towards the front: with 90 degrees the axis is the front and the
//!   zenith is at the top.
//! - Equirectangular: the front in the middle, longitude to the right over 360 degrees, latitude upwards over 180.
//! - Cube: six square faces of 90 degrees.

use super::{View, ViewError};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// How directions become a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Surround {
    /// The camera's own projection: perspective or orthographic.
    #[default]
    Flat,
    /// Dome master: azimuthal equidistant.
    Dome {
        /// Angle from rim to rim, degrees, above 0 and at most 360.
        #[serde(default = "half")]
        aperture: f64,
        /// How far the dome leans towards the front, degrees, from -180 to 180.
        #[serde(default)]
        tilt: f64,
    },
    /// Longitude and latitude.
    Equirectangular,
    /// Six faces.
    Cube {
        /// How they lie in the picture.
        #[serde(default)]
        layout: CubeLayout,
    },
}

/// The least angle between a dome's rim and the screen with words, degrees.
const RIM: f64 = 4.0;

fn half() -> f64 {
    180.0
}

/// How a cube's faces lie in the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum CubeLayout {
    /// Four columns and three rows: left, front, right and back in the middle row, up above the front and down below it.
    #[default]
    Cross,
    /// One row: right, left, up, down, back, front (+x, -x, +y, -y, +z, -z of a frame that looks along -z).
    Strip,
    /// As the strip, each face in a file of its own.
    Files,
}

impl Surround {
    /// Whether it is the camera's own projection.
    pub fn is_flat(&self) -> bool {
        *self == Surround::Flat
    }

    /// The flat screen among the panorama's directions that words stand on: its middle's angle above the front, radians, and the
    /// tangents of half its width and height: 60 degrees high and 16:9, around the front, in a dome as low as its rim allows.
    pub fn screen(&self) -> (f64, [f64; 2]) {
        let half = 30f64.to_radians();
        let elevation = match *self {
            Surround::Dome { aperture, tilt } => {
                let rim = (90.0 - tilt - 0.5 * aperture).to_radians();
                // Not beyond the zenith of a small dome, which has no room for a screen.
                (rim + RIM.to_radians() + half).clamp(0.0, (90.0 - tilt).max(0.0).to_radians())
            }
            _ => 0.0,
        };
        (elevation, [half.tan() * 16.0 / 9.0, half.tan()])
    }

    /// What is wrong with the numbers, if anything: field, value, and what is expected.
    pub fn mistake(&self) -> Option<(&'static str, f64, &'static str)> {
        let Surround::Dome { aperture, tilt } = *self else { return None };
        if !(aperture > 0.0 && aperture <= 360.0) {
            return Some(("aperture", aperture, "above 0 and at most 360 degrees"));
        }
        (!(-180.0..=180.0).contains(&tilt)).then_some(("tilt", tilt, "from -180 to 180 degrees"))
    }
}

/// The six faces of a cube, in the order of a strip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// To the right of the front.
    Right,
    /// To its left.
    Left,
    /// The zenith.
    Up,
    /// The nadir.
    Down,
    /// Behind.
    Back,
    /// The front.
    Front,
}

impl Side {
    /// Every side, in the order of a strip.
    pub const ALL: [Side; 6] = [Side::Right, Side::Left, Side::Up, Side::Down, Side::Back, Side::Front];

    /// Its name in file names.
    pub const fn as_str(self) -> &'static str {
        match self {
            Side::Right => "right",
            Side::Left => "left",
            Side::Up => "up",
            Side::Down => "down",
            Side::Back => "back",
            Side::Front => "front",
        }
    }

    /// Right, up and forward of the camera that sees it, for a frame whose vectors these are.
    pub fn axes(self, [right, up, forward]: [DVec3; 3]) -> [DVec3; 3] {
        match self {
            Side::Right => [-forward, up, right],
            Side::Left => [forward, up, -right],
            Side::Up => [right, -forward, up],
            Side::Down => [right, forward, -up],
            Side::Back => [-right, up, -forward],
            Side::Front => [right, up, forward],
        }
    }

    /// The side that a direction meets (components along right, up and forward of the frame), and where: tangents to the
    /// right and upwards, from -1 to 1.
    pub fn of(direction: DVec3) -> (Side, [f64; 2]) {
        let [x, y, z] = direction.to_array();
        let size = direction.abs();
        let side = match (size.z >= size.x.max(size.y), size.x >= size.y) {
            (true, _) if z >= 0.0 => Side::Front,
            (true, _) => Side::Back,
            (false, true) if x > 0.0 => Side::Right,
            (false, true) => Side::Left,
            (false, false) if y > 0.0 => Side::Up,
            (false, false) => Side::Down,
        };
        let [u, v] = match side {
            Side::Right => [-z, y],
            Side::Left => [z, y],
            Side::Up => [x, -z],
            Side::Down => [x, z],
            Side::Back => [-x, y],
            Side::Front => [x, y],
        };
        let depth = size.max_element();
        (side, [u / depth, v / depth])
    }

    /// Column and row in a cube's picture.
    fn cell(self, layout: CubeLayout) -> [u32; 2] {
        match (layout, self) {
            (CubeLayout::Strip | CubeLayout::Files, side) => [side as u32, 0],
            (CubeLayout::Cross, Side::Up) => [1, 0],
            (CubeLayout::Cross, Side::Left) => [0, 1],
            (CubeLayout::Cross, Side::Front) => [1, 1],
            (CubeLayout::Cross, Side::Right) => [2, 1],
            (CubeLayout::Cross, Side::Back) => [3, 1],
            (CubeLayout::Cross, Side::Down) => [1, 2],
        }
    }
}

/// A picture of the directions around an eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panorama {
    /// Unit vector to the right of the front.
    pub right: DVec3,
    /// Unit vector to the zenith.
    pub up: DVec3,
    /// Unit vector to the front.
    pub forward: DVec3,
    /// How directions become a picture; not [`Surround::Flat`].
    pub surround: Surround,
    /// Picture width, pixels; of a cube, its layout's columns times the face's edge.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
}

impl Panorama {
    /// The panorama around the eye of `view`, whose line of sight is the front and whose up is the zenith. Its size is the
    /// picture's; of a cube it is one face's, whose edge is the shorter side. `None` for [`Surround::Flat`].
    ///
    /// # Errors
    /// [`ViewError`] for an aperture or tilt out of range, or a picture that is too large.
    pub fn around(view: &View, surround: Surround) -> Result<Option<Panorama>, ViewError> {
        if let Some((name, value, expected)) = surround.mistake() {
            return Err(ViewError::OutOfRange { name, value, expected });
        }
        let edge = view.width.min(view.height);
        let [width, height] = match surround {
            Surround::Flat => return Ok(None),
            Surround::Dome { .. } | Surround::Equirectangular => [view.width, view.height],
            Surround::Cube { layout: CubeLayout::Cross } => [edge.saturating_mul(4), edge.saturating_mul(3)],
            Surround::Cube { .. } => [edge.saturating_mul(6), edge],
        };
        if width > 65536 || height > 65536 {
            return Err(ViewError::Size(width, height));
        }
        let View { right, up, forward, .. } = *view;
        Ok(Some(Panorama { right, up, forward, surround, width, height }))
    }

    /// The edge of a cube's face, pixels; `None` for other panoramas.
    pub fn face_edge(&self) -> Option<u32> {
        match self.surround {
            Surround::Cube { layout: CubeLayout::Cross } => Some(self.width / 4),
            Surround::Cube { .. } => Some(self.height),
            _ => None,
        }
    }

    /// The angle that a pixel stands for, radians: along the radius of a dome master, in the middle of an equirectangular
    /// picture (the smaller of its two sides), and of a cube its edge's share of 90 degrees.
    pub fn pixel_angle(&self) -> f64 {
        let [width, height] = [self.width, self.height].map(f64::from);
        match self.surround {
            Surround::Dome { aperture, .. } => aperture.to_radians() / width.min(height),
            Surround::Equirectangular | Surround::Flat => (TAU / width).min(PI / height),
            Surround::Cube { .. } => 0.5 * PI / self.face_edge().map_or(1.0, f64::from),
        }
    }

    /// The largest angle between what it shows and the last of [`Panorama::frame`], radians.
    pub fn half_angle(&self) -> f64 {
        match self.surround {
            Surround::Dome { aperture, .. } => 0.5 * aperture.to_radians(),
            _ => PI,
        }
    }

    /// The frame whose faces show the panorama with the fewest pixels: right, up and forward. That of a dome looks along its
    /// axis.
    pub fn frame(&self) -> [DVec3; 3] {
        match self.surround {
            Surround::Dome { tilt, .. } => {
                let (sin, cos) = tilt.to_radians().sin_cos();
                [self.right, sin * self.up - cos * self.forward, cos * self.up + sin * self.forward]
            }
            _ => [self.right, self.up, self.forward],
        }
    }

    /// The direction (a unit vector in the world) that a point of the picture shows; `None` where it shows none.
    pub fn direction(&self, [x, y]: [f64; 2]) -> Option<DVec3> {
        let [right, up, forward] = self.frame();
        let [width, height] = [self.width, self.height].map(f64::from);
        match self.surround {
            Surround::Dome { aperture, .. } => {
                let [dx, dy] = [x - 0.5 * width, 0.5 * height - y];
                let radius = dx.hypot(dy);
                if radius > 0.5 * width.min(height) {
                    return None;
                }
                if radius == 0.0 {
                    return Some(forward);
                }
                let (sin, cos) = (radius * aperture.to_radians() / width.min(height)).sin_cos();
                Some(cos * forward + sin / radius * (dx * right + dy * up))
            }
            Surround::Equirectangular | Surround::Flat => {
                if !((0.0..=width).contains(&x) && (0.0..=height).contains(&y)) {
                    return None;
                }
                let (sin, cos) = ((x / width - 0.5) * TAU).sin_cos();
                let (above, level) = ((0.5 - y / height) * PI).sin_cos();
                Some(level * (sin * right + cos * forward) + above * up)
            }
            Surround::Cube { layout } => {
                let edge = f64::from(self.face_edge()?);
                let cell = [x, y].map(|at| (at / edge).floor());
                let inside = |side: &Side| side.cell(layout).map(f64::from) == cell;
                let side = Side::ALL.into_iter().find(inside)?;
                let [right, up, forward] = side.axes([right, up, forward]);
                let [u, v] = [2.0 * (x / edge - cell[0]) - 1.0, 1.0 - 2.0 * (y / edge - cell[1])];
                Some((forward + u * right + v * up).normalize())
            }
        }
    }

    /// Where a direction (of any length above 0) appears; `None` where the picture does not show it.
    pub fn pixel(&self, direction: DVec3) -> Option<[f64; 2]> {
        let [right, up, forward] = self.frame();
        let local = DVec3::new(direction.dot(right), direction.dot(up), direction.dot(forward));
        if !(local.length_squared() > 0.0 && local.is_finite()) {
            return None;
        }
        let [width, height] = [self.width, self.height].map(f64::from);
        match self.surround {
            Surround::Dome { aperture, .. } => {
                let across = local.x.hypot(local.y);
                let radius = across.atan2(local.z) * width.min(height) / aperture.to_radians();
                if radius > 0.5 * width.min(height) {
                    return None;
                }
                let [dx, dy] = if across > 0.0 { [local.x / across, local.y / across] } else { [1.0, 0.0] };
                Some([0.5 * width + radius * dx, 0.5 * height - radius * dy])
            }
            Surround::Equirectangular | Surround::Flat => {
                let longitude = local.x.atan2(local.z);
                let latitude = local.y.atan2(local.x.hypot(local.z));
                Some([(longitude / TAU + 0.5) * width, (0.5 - latitude / PI) * height])
            }
            Surround::Cube { layout } => {
                let edge = f64::from(self.face_edge()?);
                let (side, [u, v]) = Side::of(local);
                let [column, row] = side.cell(layout).map(f64::from);
                Some([(column + 0.5 * (1.0 + u)) * edge, (row + 0.5 * (1.0 - v)) * edge])
            }
        }
    }

    /// The solid angle that a square pixel's area covers at a point of the picture, steradians; 0 where nothing is shown.
    pub fn solid_angle(&self, point: [f64; 2]) -> f64 {
        let Some(direction) = self.direction(point) else { return 0.0 };
        let [_, up, forward] = self.frame();
        let [width, height] = [self.width, self.height].map(f64::from);
        match self.surround {
            Surround::Dome { .. } => {
                let angle = self.pixel_angle() * (point[0] - 0.5 * width).hypot(point[1] - 0.5 * height);
                let squeeze = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
                self.pixel_angle().powi(2) * squeeze.max(0.0)
            }
            Surround::Equirectangular | Surround::Flat => {
                let above = direction.dot(up);
                TAU / width * PI / height * (1.0 - above * above).max(0.0).sqrt()
            }
            Surround::Cube { .. } => {
                let local = DVec3::new(direction.dot(self.right), direction.dot(up), direction.dot(forward));
                let side = 2.0 / self.face_edge().map_or(1.0, f64::from);
                side * side * local.abs().max_element().powi(3)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Projection;
    use super::*;
    use proptest::prelude::*;

    fn view(width: u32, height: u32) -> View {
        let projection = Projection::Perspective { fov_y: 1.0 };
        View::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 1.0, 0.5), DVec3::Z, projection, width, height)
            .unwrap()
    }

    fn panorama(surround: Surround, width: u32, height: u32) -> Panorama {
        Panorama::around(&view(width, height), surround).unwrap().unwrap()
    }

    fn surrounds() -> impl Strategy<Value = Surround> {
        prop_oneof![
            (1.0..=360.0f64, -180.0..=180.0f64).prop_map(|(aperture, tilt)| Surround::Dome { aperture, tilt }),
            Just(Surround::Equirectangular),
            Just(Surround::Cube { layout: CubeLayout::Cross }),
            Just(Surround::Cube { layout: CubeLayout::Strip }),
        ]
    }

    proptest! {
        /// A point of the picture shows a direction that appears at that point, and a direction appears where it is shown.
        #[test]
        fn pixels_and_directions_are_inverse(
            surround in surrounds(),
            place in prop::array::uniform2(0.001..0.999f64),
            direction in prop::array::uniform3(-1.0..1.0f64),
            size in 8u32..3000,
        ) {
            let panorama = panorama(surround, size, size + 3);
            let point = [place[0] * f64::from(panorama.width), place[1] * f64::from(panorama.height)];
            if let Some(shown) = panorama.direction(point) {
                prop_assert!((shown.length() - 1.0).abs() < 1e-12);
                let found = panorama.pixel(7.0 * shown);
                // On the rim rounding decides, and at the antipode of the axis every point shows the same.
                let near = |found: [f64; 2]| (0..2).all(|k| (found[k] - point[k]).abs() < 1e-4);
                let away = panorama.direction(point).map(|shown| shown.angle_between(-panorama.frame()[2]));
                prop_assert!(found.is_none_or(near) || away.is_some_and(|away| away < 1e-3), "{point:?} {found:?}");
            }
            let direction = DVec3::from(direction);
            prop_assume!(direction.length() > 1e-3);
            if let Some(point) = panorama.pixel(direction) {
                let shown = panorama.direction(point);
                let near = |shown: DVec3| shown.angle_between(direction) < 1e-7;
                // A cube's last column may be rounded into the next face or out of the picture.
                prop_assert!(shown.is_none_or(near) || panorama.face_edge().is_some(), "{direction} {shown:?}");
            }
        }

        /// The solid angle of a pixel is the area that the map's derivatives give.
        #[test]
        fn solid_angles_are_those_of_the_map(surround in surrounds(), place in prop::array::uniform2(0.01..0.99f64)) {
            let panorama = panorama(surround, 400, 300);
            let point = [place[0] * f64::from(panorama.width), place[1] * f64::from(panorama.height)];
            let step = 1e-3;
            let at = |dx: f64, dy: f64| panorama.direction([point[0] + dx, point[1] + dy]);
            let around = [at(step, 0.0), at(-step, 0.0), at(0.0, step), at(0.0, -step), at(0.0, 0.0)];
            if let [Some(a), Some(b), Some(c), Some(d), Some(middle)] = around {
                let jump = (a - b).length().max((c - d).length()) > 0.5;
                let along = (a - b) / (2.0 * step);
                let area = along.cross((c - d) / (2.0 * step)).dot(middle).abs();
                let found = panorama.solid_angle(point);
                prop_assert!(jump || (found - area).abs() < 1e-5 * panorama.pixel_angle().powi(2).max(area), "{found} {area}");
            }
        }
    }

    #[test]
    fn whole_spheres_have_their_solid_angle() {
        for (surround, expected) in [
            (Surround::Dome { aperture: 180.0, tilt: 20.0 }, TAU),
            (Surround::Dome { aperture: 360.0, tilt: 0.0 }, 2.0 * TAU),
            (Surround::Equirectangular, 2.0 * TAU),
            (Surround::Cube { layout: CubeLayout::Cross }, 2.0 * TAU),
            (Surround::Cube { layout: CubeLayout::Files }, 2.0 * TAU),
        ] {
            let panorama = panorama(surround, 300, 300);
            let places = (0..panorama.height).flat_map(|y| (0..panorama.width).map(move |x| [x, y]));
            let sum: f64 = places.map(|place| panorama.solid_angle(place.map(|at| f64::from(at) + 0.5))).sum();
            assert!((sum / expected - 1.0).abs() < 1e-3, "{surround:?}: {sum} of {expected}");
        }
    }

    /// The conventions that docs/dome.md states.
    #[test]
    fn front_zenith_and_right_are_where_planetariums_expect_them() {
        let view = view(200, 200);
        let near = |point: Option<[f64; 2]>, expected: [f64; 2]| {
            point.is_some_and(|point| (0..2).all(|k| (point[k] - expected[k]).abs() < 1e-6))
        };
        let dome = panorama(Surround::Dome { aperture: 180.0, tilt: 0.0 }, 200, 200);
        assert!(near(dome.pixel(view.up), [100.0, 100.0]));
        assert!(near(dome.pixel(view.forward + 1e-12 * view.up), [100.0, 200.0]), "the front is at the bottom");
        assert!(near(dome.pixel(view.right + 1e-12 * view.up), [200.0, 100.0]));
        let leaning = panorama(Surround::Dome { aperture: 180.0, tilt: 30.0 }, 200, 200);
        let at_30 = 60f64.to_radians().cos() * view.forward + 60f64.to_radians().sin() * view.up;
        assert!(near(leaning.pixel(at_30), [100.0, 100.0]), "the axis leans to the front");
        let ahead = panorama(Surround::Dome { aperture: 180.0, tilt: 90.0 }, 200, 200);
        assert!(near(ahead.pixel(view.forward), [100.0, 100.0]));
        assert!(near(ahead.pixel(view.up + 1e-12 * view.forward), [100.0, 0.0]));
        let map = panorama(Surround::Equirectangular, 200, 100);
        assert!(near(map.pixel(view.forward), [100.0, 50.0]) && near(map.pixel(view.right), [150.0, 50.0]));
        let cross = panorama(Surround::Cube { layout: CubeLayout::Cross }, 10, 10);
        assert!(near(cross.pixel(view.forward), [15.0, 15.0]) && near(cross.pixel(view.up), [15.0, 5.0]));
        assert!(near(cross.pixel(view.right), [25.0, 15.0]) && near(cross.pixel(-view.forward), [35.0, 15.0]));
        // Faces of a cross that touch go on into each other.
        for (a, b) in
            [([15.0, 9.999], [15.0, 10.001]), ([19.999, 13.0], [20.001, 13.0]), ([12.0, 19.999], [12.0, 20.001])]
        {
            let [a, b] = [a, b].map(|point| cross.direction(point).unwrap());
            assert!(a.angle_between(b) < 1e-3);
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for surround in
            [Surround::Dome { aperture: 0.0, tilt: 0.0 }, Surround::Dome { aperture: 180.0, tilt: f64::NAN }]
        {
            assert!(Panorama::around(&view(9, 9), surround).is_err());
        }
        assert!(Panorama::around(&view(20_000, 20_000), Surround::Cube { layout: CubeLayout::Cross }).is_err());
        assert!(Panorama::around(&view(9, 9), Surround::Flat).unwrap().is_none());
        let dome: Surround = ron::from_str("dome(tilt: 20.0)").unwrap();
        assert_eq!(dome, Surround::Dome { aperture: 180.0, tilt: 20.0 });
        assert_eq!(
            ron::from_str::<Surround>("cube(layout: strip)").unwrap(),
            Surround::Cube { layout: CubeLayout::Strip }
        );
        assert_eq!(ron::from_str::<Surround>("equirectangular").unwrap(), Surround::Equirectangular);
        assert!(ron::from_str::<Surround>("dome(apperture: 20.0)").is_err());
    }
}
