//! From a point of an output to the direction that it displays.
//!
//! Directions have the components right, up and forward of the show's camera.

use super::mesh::CELL;
use super::mpcdi::{self, Geometry};
use super::pfm::Pfm;
use super::{Area, Frustum, Mask, Output, OutputError, Shows};
use crate::annotate::overlay::read_png;
use crate::view::{Panorama, Surround};
use glam::DVec3;
use std::path::Path;

/// How far beyond a dome's rim its map goes on, in cells of the mesh: meshes end outside of what is seen.
const BEYOND: f64 = 1.5;

/// An output with everything that it needs.
#[derive(Clone, Debug)]
pub struct Projector {
    /// Its name.
    pub name: String,
    screen: Screen,
    warp: Option<Pfm>,
    mask: Option<Mask>,
    notes: Vec<String>,
}

/// What there is before a warp.
#[derive(Clone, Debug)]
enum Screen {
    Flat {
        aspect: f64,
        part: Area,
    },
    Frustum {
        axes: [DVec3; 3],
        edges: [f64; 4],
    },
    Dome {
        panorama: Panorama,
        part: Area,
        /// How far from the middle it goes, in sides of the whole.
        reach: f64,
    },
    /// A point for each point of the output, seen from the origin.
    Points(Pfm),
}

impl Projector {
    /// Opens an output of so many pixels, with the files that it names, from `folder` where they are relative.
    ///
    /// # Errors
    /// [`OutputError`] for files that cannot be used.
    pub fn open(output: &Output, folder: &Path, size: [u32; 2]) -> Result<Projector, OutputError> {
        let own = f64::from(size[0].max(1)) / f64::from(size[1].max(1));
        let (mut warp, mut mask, mut notes) = (None, None, Vec::new());
        let screen = match &output.shows {
            Shows::Flat { aspect, part } => {
                let part_aspect = (part.2 - part.0) / (part.3 - part.1);
                Screen::Flat { aspect: aspect.unwrap_or(own / part_aspect), part: *part }
            }
            Shows::Frustum(frustum) => Screen::of_frustum(frustum),
            Shows::Dome { aperture, tilt, part } => Screen::of_dome(*aperture, *tilt, *part, size),
            Shows::Mpcdi { file, region, rows } => {
                let path = folder.join(file);
                let region = mpcdi::read(&path, region.as_deref(), *rows)?;
                (mask, notes) = (region.mask, region.notes);
                match region.geometry {
                    Geometry::Frustum(frustum, warped) => {
                        warp = warped;
                        Screen::of_frustum(&frustum)
                    }
                    Geometry::Flat { aspect, part, warp: warped } => {
                        warp = warped;
                        Screen::Flat { aspect, part }
                    }
                    Geometry::Points(points) => Screen::Points(points),
                }
            }
        };
        if let Some(path) = &output.warp {
            let path = folder.join(path);
            warp = Some(Pfm::read(&path).map_err(|message| OutputError::Data { path, message })?);
        }
        if let Some(path) = &output.blend {
            mask = Some(Mask::of(&read_png(&folder.join(path))?, output.blend_gamma));
        }
        if let Screen::Dome { panorama, part, .. } = &screen {
            mask = Some(Mask::of_dome(panorama, *part, size, mask.as_ref()));
        }
        Ok(Projector { name: output.name.clone(), screen, warp, mask, notes })
    }

    /// The direction at a point of the output (shares of its width from the left and of its height from the top), where
    /// `fov_y` radians are the height of the show's flat picture; `None` where nothing is displayed.
    pub fn direction(&self, at: [f64; 2], fov_y: f64) -> Option<DVec3> {
        let at = match &self.warp {
            None => at,
            Some(warp) => {
                let [u, v, _] = warp.at(at)?;
                [u, v]
            }
        };
        self.screen.direction(at, fov_y)
    }

    /// Whether it displays a part of the show's flat picture, whose directions depend on the field of view.
    pub fn is_flat(&self) -> bool {
        matches!(self.screen, Screen::Flat { .. })
    }

    /// The screen that words stand on: the show's flat picture, or one among the directions of a panorama.
    pub fn sheet(&self, fov_y: f64) -> Sheet {
        let (elevation, half) = match &self.screen {
            Screen::Flat { aspect, .. } => (0.0, [(0.5 * fov_y).tan() * aspect, (0.5 * fov_y).tan()]),
            Screen::Dome { panorama, .. } => panorama.surround.screen(),
            Screen::Frustum { .. } | Screen::Points(_) => Surround::Equirectangular.screen(),
        };
        let (sin, cos) = elevation.sin_cos();
        Sheet { up: DVec3::new(0.0, cos, -sin), forward: DVec3::new(0.0, sin, cos), half }
    }

    /// What its files say and is left out.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// By how much light is multiplied.
    pub fn mask(&self) -> Option<&Mask> {
        self.mask.as_ref()
    }
}

/// A flat screen among the directions around the show's camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    up: DVec3,
    forward: DVec3,
    /// Tangents of half its width and height.
    half: [f64; 2],
}

impl Sheet {
    /// Its width for its height.
    pub fn aspect(&self) -> f64 {
        self.half[0] / self.half[1]
    }

    /// Where a direction meets it: shares of its width from the left and of its height from the top, outside beyond 0 and 1; `None`
    /// behind it.
    pub fn place(&self, direction: DVec3) -> Option<[f64; 2]> {
        let depth = direction.dot(self.forward);
        let [x, y] = [direction.x, direction.dot(self.up)];
        (depth > 1e-3).then(|| [0.5 + 0.5 * x / (depth * self.half[0]), 0.5 - 0.5 * y / (depth * self.half[1])])
    }
}

impl Screen {
    fn of_frustum(frustum: &Frustum) -> Screen {
        let [yaw, pitch, roll] = [frustum.yaw, frustum.pitch, frustum.roll].map(|angle| angle.to_radians().sin_cos());
        let (right, ahead) = (DVec3::new(yaw.1, 0.0, -yaw.0), DVec3::new(yaw.0, 0.0, yaw.1));
        let forward = pitch.1 * ahead + pitch.0 * DVec3::Y;
        let up = pitch.1 * DVec3::Y - pitch.0 * ahead;
        let axes = [roll.1 * right - roll.0 * up, roll.1 * up + roll.0 * right, forward];
        let edges = [frustum.left, frustum.right, frustum.up, frustum.down].map(|angle| angle.to_radians().tan());
        Screen::Frustum { axes, edges }
    }

    fn of_dome(aperture: f64, tilt: f64, part: Area, size: [u32; 2]) -> Screen {
        let surround = Surround::Dome { aperture, tilt };
        // In units of the picture's side, so that pixels are shares.
        let panorama = Panorama { right: DVec3::X, up: DVec3::Y, forward: DVec3::Z, surround, width: 1, height: 1 };
        let pixel = ((part.2 - part.0) / f64::from(size[0].max(1))).max((part.3 - part.1) / f64::from(size[1].max(1)));
        Screen::Dome { panorama, part, reach: 0.5 + BEYOND * f64::from(CELL) * pixel }
    }

    fn direction(&self, at: [f64; 2], fov_y: f64) -> Option<DVec3> {
        match self {
            Screen::Flat { aspect, part } => {
                let [x, y] = part.at(at);
                let half = (0.5 * fov_y).tan();
                Some(DVec3::new((2.0 * x - 1.0) * half * aspect, (1.0 - 2.0 * y) * half, 1.0).normalize())
            }
            Screen::Frustum { axes: [right, up, forward], edges: [left, far, top, bottom] } => {
                let [x, y] = [left + at[0] * (far - left), top + at[1] * (bottom - top)];
                Some((*forward + x * *right + y * *up).normalize())
            }
            Screen::Dome { panorama, part, reach } => {
                let at = part.at(at);
                let from = [at[0] - 0.5, at[1] - 0.5];
                let radius = from[0].hypot(from[1]);
                let Surround::Dome { aperture, .. } = panorama.surround else { return None };
                let angle = radius * aperture.to_radians();
                if radius > *reach || angle > std::f64::consts::PI {
                    return None;
                }
                let [right, up, forward] = panorama.frame();
                let (sin, cos) = angle.sin_cos();
                let across = if radius > 0.0 { sin / radius } else { 0.0 };
                Some(cos * forward + across * (from[0] * right - from[1] * up))
            }
            Screen::Points(points) => DVec3::from_array(points.at(at)?).try_normalize(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projector(shows: Shows) -> Projector {
        let output =
            Output { name: "a".into(), monitor: None, window: None, shows, warp: None, blend: None, blend_gamma: 1.0 };
        Projector::open(&output, Path::new(""), [400, 300]).unwrap()
    }

    #[test]
    fn frusta_turn_as_a_pilot_does() {
        let straight = Frustum { yaw: 0.0, pitch: 0.0, roll: 0.0, left: -30.0, right: 20.0, down: -10.0, up: 15.0 };
        let at = |frustum: Frustum, point| projector(Shows::Frustum(frustum)).direction(point, 1.0).unwrap();
        let edge = at(straight, [0.0, 0.0]);
        assert!((edge.x / edge.z - (-30f64).to_radians().tan()).abs() < 1e-12);
        assert!((edge.y / edge.z - 15f64.to_radians().tan()).abs() < 1e-12);
        let middle = Frustum { left: -20.0, down: -15.0, ..straight };
        let near = |found: DVec3, expected: DVec3| found.distance(expected) < 1e-12;
        assert!(near(at(Frustum { yaw: 90.0, ..middle }, [0.5; 2]), DVec3::X), "to the right");
        assert!(near(at(Frustum { pitch: 90.0, ..middle }, [0.5; 2]), DVec3::Y), "up");
        let rolled = at(Frustum { roll: 90.0, ..middle }, [1.0, 0.5]);
        assert!(near(rolled, DVec3::new(0.0, -20f64.to_radians().sin(), 20f64.to_radians().cos())), "{rolled}");
        let all = at(Frustum { yaw: 90.0, pitch: 45.0, roll: 90.0, ..middle }, [0.5; 2]);
        assert!(near(all, DVec3::new(0.5f64.sqrt(), 0.5f64.sqrt(), 0.0)), "{all}");
    }

    /// Of the flat picture the screen is the picture itself; in a dome it stands above the rim at the front.
    #[test]
    fn words_stand_where_recordings_have_them() {
        let flat = projector(Shows::Flat { aspect: Some(2.0), part: Area(0.5, 0.0, 1.0, 1.0) });
        let place = flat.sheet(0.8).place(flat.direction([0.5, 0.9], 0.8).unwrap()).unwrap();
        assert!((place[0] - 0.75).abs() < 1e-12 && (place[1] - 0.9).abs() < 1e-12, "{place:?}");
        let dome = projector(Shows::Dome { aperture: 180.0, tilt: 0.0, part: Area::default() });
        let sheet = dome.sheet(0.8);
        // Its lower edge is 4 degrees above the rim, which is the horizon.
        let low = 4f64.to_radians();
        let [x, y] = sheet.place(DVec3::new(0.0, low.sin(), low.cos())).unwrap();
        assert!((x - 0.5).abs() < 1e-12 && (y - 1.0).abs() < 1e-12, "{x} {y}");
        assert!(sheet.place(DVec3::NEG_Z).is_none() && (sheet.aspect() - 16.0 / 9.0).abs() < 1e-12);
    }

    #[test]
    fn parts_are_where_the_whole_has_them() {
        let whole = projector(Shows::Dome { aperture: 200.0, tilt: 30.0, part: Area::default() });
        let part = projector(Shows::Dome { aperture: 200.0, tilt: 30.0, part: Area(0.5, 0.25, 1.0, 0.75) });
        assert_eq!(part.direction([0.2, 0.6], 1.0), whole.direction([0.6, 0.55], 1.0));
        // The middle is where the dome leans to; the front is 60 degrees below it.
        let middle = whole.direction([0.5; 2], 1.0).unwrap();
        assert!(middle.distance(DVec3::new(0.0, 60f64.to_radians().sin(), 60f64.to_radians().cos())) < 1e-12);
        let front = whole.direction([0.5, 0.5 + 60.0 / 200.0], 1.0).unwrap();
        assert!(front.distance(DVec3::Z) < 1e-12, "{front}");
        let flat = projector(Shows::Flat { aspect: Some(4.0), part: Area(0.0, 0.0, 0.25, 1.0) });
        let corner = flat.direction([0.0, 1.0], 0.8).unwrap();
        assert!(
            (corner.x / corner.z + 4.0 * 0.4f64.tan()).abs() < 1e-12
                && (corner.y / corner.z + 0.4f64.tan()).abs() < 1e-12
        );
    }
}
