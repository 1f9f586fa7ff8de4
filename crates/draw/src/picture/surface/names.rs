//! Names of a table that says where things are but not how high: they stand on the surface.

use super::clearance::height_on;
use super::placement::FieldPlacement;
use crate::annotate::Label;
use crate::cpu::surface::horizon::Horizon;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::explore::Catalogue;
use crate::heights::measure::Tiles;
use crate::heights::model::{HeightError, Heights, units};
use crate::look::Shot;
use crate::picture::PictureError;
use crate::picture::session::Reporter;
use crate::view::View;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Samples along an edge of a part of a field whose names are looked at together, so that it is read once.
const PART: f64 = 256.0;

/// A field that names may stand on, as it is drawn.
#[derive(Clone, Copy)]
pub(super) struct Floor {
    /// How it stands in its own world.
    pub(super) placed: Placed,
    /// Where that world is in the scene.
    pub(super) placement: FieldPlacement,
    /// Its least height.
    pub(super) lowest: f64,
}

/// The names of a table, and where they stand on fields.
pub(super) struct Names {
    path: PathBuf,
    /// Where the fields are the same again: there T depends on the map.
    around: Vec<Option<u64>>,
    spots: Arc<Vec<Spot>>,
}

/// A name on a field.
struct Spot {
    name: String,
    radius: Option<f64>,
    on: Place,
}

/// A place on T.
#[derive(Clone, Copy)]
struct Place {
    /// Which of the fields.
    field: usize,
    row: f64,
    column: f64,
    height: f64,
}

/// The names of one picture.
pub(super) struct NamesShown {
    floors: Vec<Floor>,
    spots: Arc<Vec<Spot>>,
}

/// Takes the table of names from a shot, if it says where things are in a plane alone: x and y in the coordinates of the fields, of which the first
/// that has a surface there bears a name. `known` keeps them from one picture to the next. Any other catalogue stays with the shot.
///
/// # Errors
/// What is wrong with the table, and fields that cannot be read.
pub(super) fn take(
    known: &mut Option<Names>,
    shot: &mut Shot,
    fields: &[(&dyn Heights, Floor)],
    reporter: &dyn Reporter,
) -> Result<Option<NamesShown>, PictureError> {
    let Some(path) = &shot.labels else { return Ok(None) };
    let around: Vec<Option<u64>> = fields.iter().map(|(_, floor)| floor.placed.around).collect();
    if known.as_ref().is_none_or(|names| names.path != *path || names.around != around) {
        *known = Names::read(path, fields, around, reporter)?;
    }
    let Some(names) = known else { return Ok(None) };
    let floors = fields.iter().map(|(_, floor)| *floor).collect();
    let shown = NamesShown { floors, spots: Arc::clone(&names.spots) };
    shot.labels = None;
    Ok(Some(shown))
}

impl Names {
    /// Reads a table; `None` of a catalogue that says where things are in space. Names that stand nowhere are left out, which is told.
    fn read(
        path: &Path,
        fields: &[(&dyn Heights, Floor)],
        around: Vec<Option<u64>>,
        reporter: &dyn Reporter,
    ) -> Result<Option<Names>, PictureError> {
        let Some(catalogue) = Catalogue::in_plane(path)? else { return Ok(None) };
        let unit = fields.first().map(|(heights, _)| &heights.grid().xy_unit);
        unit.and_then(|unit| catalogue.unlike(unit)).into_iter().for_each(|why| reporter.tell(why));
        let Catalogue { objects, left_out, .. } = catalogue;
        let mut places: Vec<Option<Place>> = vec![None; objects.len()];
        for (field, (heights, floor)) in fields.iter().enumerate() {
            let free = objects.iter().enumerate().filter(|(index, _)| places[*index].is_none());
            let mut free: Vec<(usize, f64, f64)> = free
                .map(|(index, object)| {
                    let Placed { file_origin, file_step, .. } = floor.placed;
                    let [x, y] = [object.position.x, object.position.y];
                    (index, (y - file_origin[1]) / file_step[1], (x - file_origin[0]) / file_step[0])
                })
                .collect();
            free.sort_by_key(|(_, row, column)| [*row, *column].map(|at| (at / PART) as i64));
            let mut tiles = Tiles::new(*heights);
            for (index, row, column) in free {
                let place = place_on(&mut tiles, floor, row, column);
                let place = place.map_err(|error| PictureError::Asked(error.to_string()))?;
                places[index] = place.map(|(column, height)| Place { field, row, column, height });
            }
        }
        let all = objects.len() as u64 + left_out;
        let each = objects.into_iter().zip(places);
        let spots: Vec<Spot> =
            each.filter_map(|(object, on)| Some(Spot { name: object.name, radius: object.radius, on: on? })).collect();
        let missing = all - spots.len() as u64;
        if missing > 0 {
            let path = path.display();
            reporter.tell(format!(
                "{path}: {missing} of {all} names are left out: there is no surface where they are, or they are nowhere"
            ));
        }
        Ok(Some(Names { path: path.into(), around, spots: Arc::new(spots) }))
    }
}

/// T's height at a row and a column, and that column: in degrees it may be some turns further. `None` where there is no surface.
fn place_on(tiles: &mut Tiles<'_>, floor: &Floor, row: f64, column: f64) -> Result<Option<(f64, f64)>, HeightError> {
    let turn = 360.0 / floor.placed.file_step[0].abs();
    let turned = units::is_degrees(&tiles.grid().xy_unit).then(|| column.rem_euclid(turn));
    for column in std::iter::once(column).chain(turned) {
        if let Some(height) = height_on(tiles, &floor.placed, row, column)? {
            return Ok(Some((column, height)));
        }
    }
    Ok(None)
}

impl NamesShown {
    /// Those that a globe's own horizon does not hide from a view, the most important one first.
    pub(super) fn seen(&self, view: &View) -> Vec<Label> {
        let horizon = |floor: &Floor| {
            let sight = Sight::Flat(floor.placement.view(view));
            Horizon::new(&floor.placed, &sight, floor.placed.lifted(floor.lowest))
        };
        let floors: Vec<(Floor, Option<Horizon>)> = self.floors.iter().map(|floor| (*floor, horizon(floor))).collect();
        let label = |spot: &Spot| {
            let Place { field, row, column, height } = spot.on;
            let (Floor { placed, placement, .. }, horizon) = floors[field];
            let ends = |at: f64| [at.floor() as u64, at.ceil() as u64];
            let top = placed.lifted(height);
            let is_hidden = horizon.is_some_and(|horizon| horizon.hides([ends(row), ends(column)], top));
            let position = placement.outside(placed.world(row, column, height));
            (!is_hidden).then(|| Label { name: spot.name.clone(), position, radius: spot.radius })
        };
        self.spots.iter().filter_map(label).collect()
    }
}

#[cfg(test)]
mod tests;
