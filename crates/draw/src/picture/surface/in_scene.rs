//! Fields of heights where they stand in a scene: which of them is seen under a pixel, and where their places are drawn.

use super::names::standing;
use super::opened::OpenSurface;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::heights::measure::Pick;
use crate::mode::Settings;
use crate::picture::PictureError;
use crate::picture::placement::FieldPlacement;
use crate::view::View;
use glam::DVec3;
use std::sync::Arc;

/// A field as settings place it in a scene.
#[derive(Clone)]
pub struct FieldInScene {
    /// Which of the datasets it is.
    pub index: usize,
    /// Its samples.
    pub opened: Arc<OpenSurface>,
    /// How it stands in its own world.
    pub placed: Placed,
    /// Where that world is in the scene.
    pub(in crate::picture) placement: FieldPlacement,
}

impl FieldInScene {
    /// A field that is open alone.
    ///
    /// # Errors
    /// A map that does not fit it.
    pub fn alone(opened: &Arc<OpenSurface>, settings: &Settings) -> Result<FieldInScene, PictureError> {
        let placement = FieldPlacement { offset: DVec3::ZERO, scale: 1.0 };
        Ok(FieldInScene { index: 0, placed: opened.placed(settings)?, opened: Arc::clone(opened), placement })
    }

    /// Where a place of it is drawn.
    pub fn in_scene(&self, row: f64, column: f64, height: f64) -> DVec3 {
        self.placement.outside(self.placed.world(row, column, height))
    }

    /// The same without exaggeration.
    pub fn truly_in_scene(&self, row: f64, column: f64, height: f64) -> DVec3 {
        self.placement.outside(self.without_exaggeration().world(row, column, height))
    }

    /// How it would stand in its own world without exaggeration.
    pub fn without_exaggeration(&self) -> Placed {
        Placed { zero: 0.0, lift: self.placed.true_lift, ..self.placed }
    }

    /// Row, column and height of those of numbered places, x and y in its file's coordinates, at which it has a surface.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn standing(&self, places: Vec<(usize, [f64; 2])>) -> Result<Vec<(usize, [f64; 3])>, PictureError> {
        let found = standing(&**self.opened.file(), &self.placed, places);
        found.map_err(|error| PictureError::of(self.opened.path(), error.to_string()))
    }

    /// What of it is under a pixel of a flat picture; `None` where nothing can be seen. A hit's parameter is its depth, in its own lengths.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn pick(&self, view: &View, pixel: [f64; 2]) -> Result<Option<Pick>, PictureError> {
        let sight = Sight::Flat(self.placement.view(view));
        Ok(self.opened.pick(&self.placed, &sight, pixel)?.map(|(pick, _)| pick))
    }
}

/// What of several fields is under a pixel of a flat picture, and the number of the field: the nearest that the line of sight meets, else the first
/// that it passes where nothing was measured.
///
/// # Errors
/// When one of them cannot be read.
pub fn nearest(fields: &[FieldInScene], view: &View, pixel: [f64; 2]) -> Result<Option<(usize, Pick)>, PictureError> {
    let mut best: Option<(usize, Pick)> = None;
    let depth = |found: &Option<(usize, Pick)>| match found {
        Some((number, Pick::Hit(hit))) => Some(hit.t * fields[*number].placement.scale),
        _ => None,
    };
    for (number, field) in fields.iter().enumerate() {
        let found = field.pick(view, pixel)?.map(|pick| (number, pick));
        let is_better = match (depth(&found), depth(&best), &found, &best) {
            (Some(own), Some(other), ..) => own < other,
            (Some(_), None, ..) => true,
            (None, None, Some((_, Pick::NotMeasured { .. })), None | Some((_, Pick::Beside))) => true,
            _ => false,
        };
        if is_better || best.is_none() && found.is_some() {
            best = found;
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::surface::fixtures::opened;
    use crate::view::Projection;

    #[test]
    fn places_stand_on_the_surface_where_there_is_one() {
        let ground = opened("m", [41, 41], [-20.0, -20.0], 1.0, |x, y| 2.0 * x + y);
        let field = FieldInScene::alone(ground.opened(), &Settings::default()).unwrap();
        let mut found = field.standing(vec![(4, [30.0, 0.0]), (7, [2.5, -3.25]), (1, [-20.0, 20.0])]).unwrap();
        found.sort_by_key(|(index, _)| *index);
        let numbers: Vec<usize> = found.iter().map(|(index, _)| *index).collect();
        assert_eq!(numbers, [1, 7]);
        for ((_, [row, column, height]), [x, y]) in found.into_iter().zip([[-20.0, 20.0], [2.5, -3.25]]) {
            let place = field.in_scene(row, column, height);
            assert!((place - DVec3::new(x, y, 2.0 * x + y)).length() < 1e-6, "{place}");
        }
    }

    #[test]
    fn of_two_fields_the_one_in_front_is_asked() {
        // A level field, and a smaller one above its middle that has lengths of its own.
        let ground = opened("m", [41, 41], [-20.0, -20.0], 1.0, |x, y| 0.01 * x * y);
        let table = opened("m", [21, 21], [0.0, 0.0], 1.0, |x, _| 0.5 * x);
        let settings =
            Settings(std::iter::once(("exaggeration".to_owned(), crate::mode::SettingValue::Number(2.0))).collect());
        let mut fields = vec![
            FieldInScene::alone(ground.opened(), &settings).unwrap(),
            FieldInScene { index: 3, ..FieldInScene::alone(table.opened(), &settings).unwrap() },
        ];
        fields[1].placement = FieldPlacement { offset: DVec3::new(-5.0, -5.0, 6.0), scale: 0.5 };
        for (projection, is_turned) in [
            (Projection::Orthographic { height: 44.0 }, false),
            (Projection::Perspective { fov_y: 0.8 }, false),
            (Projection::Perspective { fov_y: 0.8 }, true),
        ] {
            // The order of fields does not matter.
            if is_turned {
                fields.reverse();
            }
            let [ground, table] = [0, 3].map(|index| fields.iter().position(|field| field.index == index).unwrap());
            let eye = DVec3::new(2.0, -18.0, 50.0);
            let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, projection, 300, 300).unwrap();
            let mut met = [0; 2];
            for (row, column) in (0..=20).flat_map(|row| (0..=20).map(move |column| (row, column))) {
                let (r, c) = (f64::from(row), f64::from(column));
                // Every sample of the table is seen where it is drawn.
                let height = 0.5 * c;
                let place = fields[table].in_scene(r, c, height);
                let pixel = view.to_pixels(view.to_camera(place)).unwrap();
                let found = nearest(&fields, &view, pixel).unwrap().unwrap();
                if let (number, Pick::Hit(hit)) = found
                    && number == table
                {
                    assert!((hit.row - r).abs() < 1e-6 && (hit.column - c).abs() < 1e-6, "{hit:?}");
                    met[0] += 1;
                }
                // One of the ground is, or the table is in front of it.
                let [x, y] = [c - 10.0, 10.0 - r];
                let place = fields[ground].in_scene(20.0 - y, x + 20.0, 0.01 * x * y);
                let pixel = view.to_pixels(view.to_camera(place)).unwrap();
                match nearest(&fields, &view, pixel).unwrap().unwrap() {
                    (number, Pick::Hit(hit)) if number == ground => {
                        assert!((hit.row - 20.0 + y).abs() < 1e-6 && (hit.height - 0.01 * x * y).abs() < 1e-4);
                    }
                    (number, Pick::Hit(hit)) => {
                        assert_eq!(number, table);
                        let front = fields[table].in_scene(hit.row, hit.column, hit.height);
                        assert!(view.to_camera(front).z < view.to_camera(place).z);
                        met[1] += 1;
                    }
                    other => panic!("{other:?}"),
                }
            }
            // Rims may be missed by a rounding.
            assert!(met[0] > 19 * 19 && met[1] > 40, "{met:?}");
        }
        let place = fields[0].truly_in_scene(4.0, 5.0, 6.0);
        assert_eq!(fields.iter().filter(|field| field.truly_in_scene(4.0, 5.0, 6.0) == place).count(), 1);
    }
}
