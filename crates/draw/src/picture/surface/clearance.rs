//! The eye of a picture stays above ground: where it would be nearer to the surface below it than the setting `clearance` says, or under it, it
//! is lifted along the upright direction, and looks the same way from there.

use crate::cpu::surface::placed::{Map, Placed};
use crate::heights::measure::Tiles;
use crate::heights::model::{Globe, HeightError, Heights};
use crate::look::Shot;
use glam::DVec3;

/// A field as it stands in its own world.
pub(super) struct Ground<'a> {
    /// Its samples.
    pub(super) heights: &'a dyn Heights,
    /// Where they are.
    pub(super) placed: &'a Placed,
}

impl Ground<'_> {
    /// Lifts the eye of a shot, whose camera says where it stands and what it looks at, until it is so high above T, exaggeration included.
    /// Tells where it stands then; `None` where it stays: it is high enough, or there is no surface below or above it.
    ///
    /// # Errors
    /// Where the field cannot be read.
    pub(super) fn keep_above(&self, shot: &mut Shot, clearance: f64) -> Result<Option<[f64; 3]>, HeightError> {
        let Some(eye) = shot.camera.eye.filter(|_| clearance > 0.0).map(DVec3::from) else { return Ok(None) };
        let Some(lift) = self.lift(eye, clearance)? else { return Ok(None) };
        Ok(Some(raise(shot, eye, lift)))
    }

    /// What is added to an eye so that it stands so high above T; `None` where it does already.
    ///
    /// # Errors
    /// Where the field cannot be read.
    pub(super) fn lift(&self, eye: DVec3, clearance: f64) -> Result<Option<DVec3>, HeightError> {
        let placed = self.placed;
        let (x, y, height, up) = match placed.map {
            Map::Globe(globe) => {
                let [longitude, latitude, height] = globe.geodetic(eye.to_array());
                (longitude, latitude, height, DVec3::from(Globe::up(longitude, latitude)))
            }
            _ => (eye.x, eye.y, eye.z, DVec3::Z),
        };
        let mut column = (x - placed.origin[0]) / placed.step[0];
        let row = (y - placed.origin[1]) / placed.step[1];
        if !placed.is_flat() {
            column = column.rem_euclid(360.0 / placed.step[0].abs());
        }
        let below = height_on(&mut Tiles::new(self.heights), placed, row, column)?;
        let missing = below.map(|below| placed.lifted(below) + clearance - height);
        Ok(missing.filter(|missing| *missing > 0.0).map(|missing| missing * up))
    }
}

/// T's height at a row and a column with fractions; of a field that goes round a globe also between its last column and its first. `None` where
/// there is no surface.
///
/// # Errors
/// Where the field cannot be read.
pub(super) fn height_on(
    tiles: &mut Tiles<'_>,
    placed: &Placed,
    row: f64,
    column: f64,
) -> Result<Option<f64>, HeightError> {
    let on = match placed.around == Some(tiles.grid().columns) {
        true => tiles.triangle_around(row, column)?,
        false => tiles.triangle(row, column)?,
    };
    Ok(on.map(|on| on.height()))
}

/// Moves a shot's eye, and with it what it looks at; tells where the eye is then.
pub(super) fn raise(shot: &mut Shot, eye: DVec3, lift: DVec3) -> [f64; 3] {
    let eye = (eye + lift).to_array();
    shot.camera.eye = Some(eye);
    shot.camera.target = shot.camera.target.map(|target| (DVec3::from(target) + lift).to_array());
    eye
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heights::model::{HeightField, HeightGrid};
    use crate::look::CameraConfig;
    use crate::model::Unit;

    /// A slope with a hole: heights are `2 x + y` but for the sample in row 2, column 2.
    fn slope() -> HeightField {
        let height = |index: usize| match (index / 6, index % 6) {
            (2, 2) => f64::NAN,
            (row, column) => (2 * column + row) as f64,
        };
        let mut field = HeightField::of(6, 5, (0..30).map(height).collect());
        (field.grid.origin, field.grid.step) = ([10.0, 20.0], [1.0, -1.0]);
        field
    }

    /// Whence a camera that stands at a place and looks aside sees, above ground.
    fn kept(field: &HeightField, placed: &Placed, eye: DVec3, clearance: f64) -> (DVec3, Option<[f64; 3]>) {
        let aside = DVec3::new(3.0, 4.0, -1.0);
        let camera = CameraConfig {
            eye: Some(eye.to_array()),
            target: Some((eye + aside).to_array()),
            ..CameraConfig::default()
        };
        let mut shot = Shot { camera, ..Shot::default() };
        let told = Ground { heights: field, placed }.keep_above(&mut shot, clearance).unwrap();
        let [eye, target] = [shot.camera.eye, shot.camera.target].map(|place| DVec3::from(place.unwrap()));
        assert!((target - eye - aside).length() < 1e-12 * (1.0 + eye.length()));
        (eye, told)
    }

    #[test]
    fn an_eye_that_is_too_low_is_lifted_and_no_other() {
        let field = slope();
        for (exaggeration, base) in [(1.0, 0.0), (3.0, 2.0)] {
            let placed = Placed::new(&field.grid, Map::Plate, exaggeration, base);
            // Between samples, where the surface is a plane: column 3.25, row 0.5.
            let ground = base + exaggeration * (7.0 - base);
            for (z, wanted) in
                [(-50.0, ground + 2.0), (ground, ground + 2.0), (ground + 2.0, ground + 2.0), (90.0, 90.0)]
            {
                let eye = DVec3::new(13.25, 19.5, z);
                let (at, told) = kept(&field, &placed, eye, 2.0);
                assert!((at - DVec3::new(eye.x, eye.y, wanted)).length() < 1e-12, "{at}");
                assert_eq!(told.is_some(), z < wanted);
                assert_eq!(told.map_or(eye, DVec3::from), at);
                assert_eq!(kept(&field, &placed, eye, 0.0), (eye, None));
            }
            // Beside the field, in the hole, and in the half of a cell that it leaves.
            let places = [
                ([9.0, 19.0], false),
                ([12.1, 17.9], false),
                ([12.2, 17.3], false),
                ([12.8, 17.3], true),
                ([11.2, 18.7], true),
            ];
            for (place, is_lifted) in places {
                let (_, told) = kept(&field, &placed, DVec3::new(place[0], place[1], -500.0), 2.0);
                assert_eq!(told.is_some(), is_lifted, "{place:?}");
            }
        }
    }

    #[test]
    fn on_a_globe_eyes_go_up_along_the_vertical_across_the_seam_as_well() {
        let heights = |index: usize| 10.0 + (index % 8) as f64;
        let plain = HeightField::of(8, 5, (0..40).map(heights).collect());
        let grid = HeightGrid {
            origin: [-180.0, -60.0],
            step: [45.0, 30.0],
            xy_unit: Unit::new("deg"),
            height_unit: Unit::new("m"),
            ..plain.grid.clone()
        };
        let field = HeightField { grid, ..plain };
        let globe = Globe { equator: 1000.0, pole: 900.0 };
        let placed = Placed::new(&field.grid, Map::Globe(globe), 2.0, 5.0);
        // Half-way between two columns; the last case is between the last column and the first.
        for (longitude, height) in [(-180.0, 10.0), (-157.5, 10.5), (22.5, 14.5), (157.5, 13.5)] {
            let ground = 5.0 + 2.0 * (height - 5.0);
            for (above, wanted) in [(-300.0, 4.0), (0.0, 4.0), (4.0, 4.0), (100.0, 100.0)] {
                let eye = DVec3::from(globe.place(longitude, 30.0, ground + above));
                let (at, _) = kept(&field, &placed, eye, 4.0);
                let expected = DVec3::from(globe.place(longitude, 30.0, ground + wanted));
                assert!((at - expected).length() < 1e-6, "{longitude} {above}: {at} {expected}");
            }
        }
        // Beyond the last row there is nothing.
        let eye = DVec3::from(globe.place(10.0, 80.0, 0.0));
        assert_eq!(kept(&field, &placed, eye, 4.0), (eye, None));
    }
}
