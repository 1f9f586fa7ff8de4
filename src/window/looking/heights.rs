//! Measured heights under the mouse: the samples at a click, distances in space and in plan, profiles along a line that is drawn, and
//! ISO 25178 numbers of a rectangle or a disc. Whatever is drawn, all of them are of the file's own samples at their true heights. Of several
//! fields that one is asked which is seen under the mouse. What was found is kept by rows and columns, so that it is drawn where the field stands
//! now.

mod profiles;
mod regions;

pub use profiles::Line;
pub use regions::{Area, Numbers};

use crate::cpu::surface::placed::{Map, Placed};
use crate::heights::measure::{Disc, FormKind, Pick, Probe, probe, probe_on};
use crate::heights::model::lengths::EARTH;
use crate::heights::model::{HeightGrid, Heights, Lengths};
use crate::heights::store::HeightFile;
use crate::mode::{SettingValue, Settings};
use crate::modes::surface::radius_of;
use crate::picture::surface::{FieldInScene, nearest};
use crate::view::View;
use crate::window::state::answer::Answer;
use crate::window::state::notices::Notices;
use crate::window::state::tool::Tool;
use bevy::math::DVec3;
use bevy::prelude::*;
use std::sync::Arc;

/// What is known of the heights that are open.
#[derive(Resource, Default)]
pub struct OnHeights {
    /// What was clicked.
    pub found: Answer<Found>,
    /// The places whose distance is measured, two at most.
    pub places: Vec<Place>,
    /// Where the stroke that is being drawn began.
    pub origin: Option<Place>,
    /// The profile along the last line.
    pub profile: Answer<Line>,
    /// The region that is looked at, and the dataset whose it is.
    pub area: Option<(usize, Area)>,
    /// What is taken off before its numbers are found.
    pub form: Option<FormKind>,
    /// Its numbers.
    pub numbers: Answer<Numbers>,
    /// Whether among particles heights were asked last.
    pub is_asked: bool,
}

/// A place of a field by its rows and columns, and its true height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Row, with fraction.
    pub row: f64,
    /// Column, with fraction.
    pub column: f64,
    /// T's height there.
    pub height: f64,
}

/// A place that distances are measured from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Which of the datasets its field is.
    pub field: usize,
    /// Where it is on it.
    pub spot: Spot,
    /// Its x and y in the file.
    pub at: [f64; 2],
    /// Where it is in the field's own world without exaggeration.
    own: DVec3,
    /// The same in the scene.
    in_scene: DVec3,
    /// On a globe: how far the height 0 is from its middle here.
    radius: Option<f64>,
}

/// What a click has found.
#[derive(Clone, Debug)]
pub struct Found {
    /// Which of the datasets the field is.
    pub field: usize,
    /// The place, what is measured there or next to it.
    pub probe: Probe,
    /// Where that was measured.
    pub spot: Option<Spot>,
    /// The samples of the triangle there: row, column and height.
    pub samples: Vec<(u64, u64, f64)>,
}

/// How far two places are apart, without exaggeration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Apart {
    /// In space.
    pub space: f64,
    /// In plan: on a globe along the great circle at the height 0; not known between two globes.
    pub plan: Option<f64>,
    /// The second one's height above the first: of one field in its unit of heights, else as the other lengths.
    pub rise: Option<f64>,
    /// The angle of the way from the horizontal (on a globe of that along the circle), degrees.
    pub angle: Option<f64>,
    /// The field of both; lengths are in the unit of its world, else in the scene's.
    pub field: Option<usize>,
}

/// What is asked of heights as they are shown.
pub(super) struct Asked<'a> {
    pub fields: &'a [FieldInScene],
    pub settings: &'a Settings,
    pub view: View,
}

/// What the mouse does in this frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strokes {
    /// Where it is, picture pixels.
    pub at: [f64; 2],
    /// A button went down.
    pub pressed: bool,
    /// It went up after having been held.
    pub released: bool,
    /// It was clicked.
    pub clicked: bool,
}

impl OnHeights {
    /// Does with the mouse what the tool in hand does.
    pub(super) fn use_tool(&mut self, tool: Tool, asked: &Asked<'_>, mouse: Strokes, notices: &mut Notices) {
        if !(mouse.clicked || mouse.pressed && tool.takes_drags() || mouse.released) {
            return;
        }
        // A stroke stays on the field that it began on.
        let origin = self.origin.filter(|_| mouse.released);
        let (field, pick) = match asked.pick(mouse.at, origin.map(|origin| origin.field)) {
            Ok(Some(found)) => found,
            Ok(None) => return,
            Err(why) => {
                if mouse.clicked || mouse.released {
                    notices.error(why);
                }
                return;
            }
        };
        match tool {
            Tool::Inspect if mouse.clicked => self.found = asked.look(field, pick),
            Tool::Measure if mouse.clicked => match Place::of(field, pick) {
                Some(place) => {
                    if self.places.len() >= 2 {
                        self.places.clear();
                    }
                    self.places.push(place);
                }
                None => notices.info("nothing was measured there"),
            },
            Tool::Profile | Tool::Sphere | Tool::Cube if mouse.pressed => self.origin = Place::of(field, pick),
            Tool::Profile | Tool::Sphere | Tool::Cube if mouse.released => {
                let (Some(from), Some(to)) = (self.origin.take(), Place::of(field, pick)) else {
                    notices.info("a line, a box or a disc begins and ends where something was measured");
                    return;
                };
                self.draw(tool, asked, field, [from.at, to.at], notices);
            }
            _ => {}
        }
    }

    /// Asks for what was drawn from one place to another.
    fn draw(
        &mut self,
        tool: Tool,
        asked: &Asked<'_>,
        field: &FieldInScene,
        ends: [[f64; 2]; 2],
        notices: &mut Notices,
    ) {
        let [from, to] = ends;
        let reach = (to[0] - from[0]).hypot(to[1] - from[1]);
        if reach <= 0.0 {
            notices.info(tool.help());
            return;
        }
        match tool {
            Tool::Profile => {
                let (file, index, is_flat) = (Arc::clone(field.opened.file()), field.index, field.placed.is_flat());
                let radius = radius(field, asked.settings);
                self.profile = Answer::ask("profile", move |_| profiles::line_of(&file, index, is_flat, radius, ends));
            }
            Tool::Sphere => self.ask(field, asked.settings, Area::Disc(Disc { center: from, radius: reach })),
            _ => self.ask(field, asked.settings, Area::Rectangle(ends)),
        }
    }

    /// Asks for the numbers of a region.
    pub fn ask(&mut self, field: &FieldInScene, settings: &Settings, area: Area) {
        self.area = Some((field.index, area));
        let (file, index) = (Arc::clone(field.opened.file()), field.index);
        let (form, radius) = (self.form, radius(field, settings));
        self.numbers = Answer::ask("region", move |_| regions::numbers_of(&file, index, radius, area, form));
    }

    /// Takes what has been found out.
    pub(super) fn receive(&mut self) {
        self.found.receive();
        self.profile.receive();
        self.numbers.receive();
    }

    /// How far the two places are apart.
    pub fn apart(&self) -> Option<Apart> {
        let [from, to] = self.places[..] else { return None };
        Some(Apart::of(&from, &to))
    }

    /// Whether the places are on a globe.
    pub fn is_on_globe(&self) -> bool {
        self.places.iter().any(|place| place.radius.is_some())
    }

    /// Whether a tool shows what is known of heights, where pictures are about these or about particles among them.
    pub fn is_shown(&self, tool: Tool, is_about_heights: bool) -> bool {
        is_about_heights || self.is_asked && matches!(tool, Tool::Inspect | Tool::Profile)
    }
}

impl Apart {
    fn of(from: &Place, to: &Place) -> Apart {
        let field = (from.field == to.field).then_some(from.field);
        let way = match field {
            Some(_) => to.own - from.own,
            None => to.in_scene - from.in_scene,
        };
        let space = way.length();
        let (plan, up) = match (from.radius, to.radius, field) {
            (Some(one), Some(other), Some(_)) => {
                let up = (to.own.length() - other) - (from.own.length() - one);
                (0.5 * (one + other) * from.own.angle_between(to.own), up)
            }
            (None, None, _) => (way.x.hypot(way.y), way.z),
            _ => return Apart { space, plan: None, rise: None, angle: None, field },
        };
        let rise = if field.is_some() { to.spot.height - from.spot.height } else { up };
        Apart { space, plan: Some(plan), rise: Some(rise), angle: Some(up.atan2(plan).to_degrees()), field }
    }
}

impl Asked<'_> {
    /// What is under a pixel, and of which field; of one alone where it is named.
    pub(super) fn pick(&self, at: [f64; 2], only: Option<usize>) -> Result<Option<(&FieldInScene, Pick)>, String> {
        let told = |error: crate::picture::PictureError| error.to_string();
        match only {
            Some(index) => {
                let Some(field) = self.fields.iter().find(|field| field.index == index) else { return Ok(None) };
                Ok(field.pick(&self.view, at).map_err(told)?.map(|pick| (field, pick)))
            }
            None => {
                let found = nearest(self.fields, &self.view, at).map_err(told)?;
                Ok(found.and_then(|(number, pick)| Some((self.fields.get(number)?, pick))))
            }
        }
    }

    /// The place that is seen under a pixel, where something was measured.
    pub(super) fn place(&self, at: [f64; 2]) -> Option<DVec3> {
        let (field, pick) = self.pick(at, None).ok()??;
        Spot::of(pick).map(|spot| spot.in_scene(field))
    }

    /// All that is known of what was clicked.
    fn look(&self, field: &FieldInScene, pick: Pick) -> Answer<Found> {
        let (at, samples) = match pick {
            Pick::Beside => return Answer::Nothing,
            Pick::NotMeasured { x, y, .. } => ([x, y], Vec::new()),
            Pick::Hit(hit) => ([hit.x, hit.y], hit.samples.to_vec()),
        };
        let (index, spot) = (field.index, Spot::of(pick));
        let (file, radius) = (Arc::clone(field.opened.file()), radius(field, self.settings));
        Answer::ask("sample", move |_| {
            probe_on(&*file, &Lengths::on(file.grid(), radius), at)
                .map(|probe| Found { field: index, probe, spot, samples })
                .map_err(|error| error.to_string())
        })
    }
}

impl Spot {
    fn of(pick: Pick) -> Option<Spot> {
        let Pick::Hit(hit) = pick else { return None };
        Some(Spot { row: hit.row, column: hit.column, height: hit.height })
    }

    /// Where it is drawn.
    pub fn in_scene(self, field: &FieldInScene) -> DVec3 {
        field.in_scene(self.row, self.column, self.height)
    }
}

impl Place {
    fn of(field: &FieldInScene, pick: Pick) -> Option<Place> {
        let spot = Spot::of(pick)?;
        let Spot { row, column, height } = spot;
        let plain = field.without_exaggeration();
        Some(Place {
            field: field.index,
            spot,
            at: field.opened.file().about().grid.place(row, column),
            own: plain.world(row, column, height),
            in_scene: field.truly_in_scene(row, column, height),
            radius: (!plain.is_flat()).then(|| plain.world(row, column, 0.0).length()),
        })
    }
}

/// The unit of lengths of the world that a field stands in: degrees become metres where heights have no unit.
pub fn world_unit<'a>(placed: &Placed, grid: &'a HeightGrid) -> &'a str {
    match placed.map {
        Map::Plate => grid.xy_unit.0.as_str(),
        _ if grid.height_unit.is_unknown() => "m",
        _ => grid.height_unit.0.as_str(),
    }
}

/// Places of the surface; none where nothing was measured.
fn on_surface(file: &HeightFile, places: &[[f64; 2]]) -> Result<Vec<Option<Spot>>, String> {
    let found = |at: &[f64; 2]| {
        let there = probe(file, *at).map_err(|error| error.to_string())?;
        Ok(there.height.map(|height| Spot { row: there.row, column: there.column, height }))
    };
    places.iter().map(found).collect()
}

/// Radius in metres of the body that a field's degrees are on as settings place it: that which they name, else the Earth's.
fn radius(field: &FieldInScene, settings: &Settings) -> f64 {
    let radius = match settings.0.get("map") {
        Some(SettingValue::Name(map)) => radius_of(map, &field.opened.file().about().grid).ok().flatten(),
        _ => None,
    };
    radius.unwrap_or(EARTH)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(field: usize, own: [f64; 3], scene: [f64; 3], radius: Option<f64>) -> Place {
        let spot = Spot { row: 0.0, column: 0.0, height: own[2] };
        Place { field, spot, at: [own[0], own[1]], own: own.into(), in_scene: scene.into(), radius }
    }

    #[test]
    fn places_of_one_field_are_apart_in_its_lengths_and_of_two_in_the_scenes() {
        let one = place(0, [0.0, 0.0, 1.0], [100.0, 0.0, 1.0], None);
        let same = Apart::of(&one, &place(0, [3.0, 4.0, 13.0], [9.0, 9.0, 9.0], None));
        assert_eq!((same.space, same.plan, same.rise, same.field), (13.0, Some(5.0), Some(12.0), Some(0)));
        let other = Apart::of(&one, &place(2, [0.0; 3], [103.0, 4.0, 1.0], None));
        assert_eq!((other.space, other.plan, other.rise, other.angle), (5.0, Some(5.0), Some(0.0), Some(0.0)));
        // A quarter of a globe.
        let on_globe = |own| place(0, own, own, Some(10.0));
        let quarter = Apart::of(&on_globe([10.0, 0.0, 0.0]), &on_globe([0.0, 10.0, 0.0]));
        assert!((quarter.plan.unwrap() - 5.0 * std::f64::consts::PI).abs() < 1e-12 && quarter.angle == Some(0.0));
        let mixed = Apart::of(&on_globe([10.0, 0.0, 0.0]), &one);
        assert!(mixed.plan.is_none() && mixed.space > 9.0);
    }
}
