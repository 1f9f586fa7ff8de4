//! Names of a table that says where things are but not how high: they stand on the surface.

use super::clearance::height_on;
use crate::annotate::Label;
use crate::cpu::surface::horizon::Horizon;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::explore::Catalogue;
use crate::heights::measure::Tiles;
use crate::heights::model::{HeightError, Heights, units};
use crate::look::Shot;
use crate::picture::PictureError;
use crate::picture::placement::FieldPlacement;
use crate::picture::session::Reporter;
use crate::view::View;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Samples along an edge of a part of a field whose names are looked at together, so that it is read once.
const PART: f64 = 256.0;

/// A field that names may stand on, as it is drawn.
#[derive(Clone, Copy)]
pub(in crate::picture) struct Floor {
    /// How it stands in its own world.
    pub(in crate::picture) placed: Placed,
    /// Where that world is in the scene.
    pub(in crate::picture) placement: FieldPlacement,
    /// Its least height.
    pub(in crate::picture) lowest: f64,
}

/// The names of a table, and where they stand on fields.
pub(in crate::picture) struct Names {
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
pub(in crate::picture) struct NamesShown {
    floors: Vec<Floor>,
    spots: Arc<Vec<Spot>>,
}

/// Takes the table of names from a shot, if it says where things are in a plane alone: x and y in the coordinates of the fields, of which the first
/// that has a surface there bears a name. `known` keeps them from one picture to the next. Any other catalogue stays with the shot.
///
/// # Errors
/// What is wrong with the table, and fields that cannot be read.
pub(in crate::picture) fn take(
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
            let free = free.map(|(index, object)| (index, [object.position.x, object.position.y])).collect();
            let found = standing(*heights, &floor.placed, free);
            for (index, [row, column, height]) in found.map_err(|error| PictureError::Asked(error.to_string()))? {
                places[index] = Some(Place { field, row, column, height });
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

/// Row, column and T's height of those of numbered places, x and y in the file's coordinates, at which there is a surface.
///
/// # Errors
/// Where the field cannot be read.
pub(super) fn standing(
    heights: &dyn Heights,
    placed: &Placed,
    places: Vec<(usize, [f64; 2])>,
) -> Result<Vec<(usize, [f64; 3])>, HeightError> {
    let Placed { file_origin, file_step, .. } = *placed;
    let cell = |(index, [x, y]): (usize, [f64; 2])| {
        (index, (y - file_origin[1]) / file_step[1], (x - file_origin[0]) / file_step[0])
    };
    let mut cells: Vec<(usize, f64, f64)> = places.into_iter().map(cell).collect();
    cells.sort_by_key(|(_, row, column)| [*row, *column].map(|at| (at / PART) as i64));
    let mut tiles = Tiles::new(heights);
    let mut found = Vec::new();
    for (index, row, column) in cells {
        if let Some((column, height)) = place_on(&mut tiles, placed, row, column)? {
            found.push((index, [row, column, height]));
        }
    }
    Ok(found)
}

/// T's height at a row and a column, and that column: in degrees it may be some turns further. `None` where there is no surface.
fn place_on(tiles: &mut Tiles<'_>, placed: &Placed, row: f64, column: f64) -> Result<Option<(f64, f64)>, HeightError> {
    let turn = 360.0 / placed.file_step[0].abs();
    let turned = units::is_degrees(&tiles.grid().xy_unit).then(|| column.rem_euclid(turn));
    for column in std::iter::once(column).chain(turned) {
        if let Some(height) = height_on(tiles, placed, row, column)? {
            return Ok(Some((column, height)));
        }
    }
    Ok(None)
}

impl NamesShown {
    /// Those that a globe's own horizon does not hide from a view, the most important one first.
    pub(in crate::picture) fn seen(&self, view: &View) -> Vec<Label> {
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
