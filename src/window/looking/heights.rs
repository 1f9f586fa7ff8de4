//! Measured heights under the mouse: the samples at a click, distances in space and in plan, profiles along a line that is drawn, and
//! ISO 25178 numbers of a rectangle or a disc. Whatever is drawn, all of them are of the file's own samples at their true heights.

use crate::cpu::surface::placed::{Map, Placed};
use crate::cpu::surface::sight::Sight;
use crate::heights::measure::{
    Disc, FormKind, FormNumbers, Part, Pick, Probe, Profile, ProfilePoint, Residual, Roughness, fit, great_circle,
    probe, probe_on, profile_on, roughness_on,
};
use crate::heights::model::lengths::EARTH;
use crate::heights::model::{HeightError, HeightGrid, Heights, Lengths};
use crate::heights::store::HeightFile;
use crate::mode::{SettingValue, Settings};
use crate::modes::surface::radius_of;
use crate::picture::surface::OpenSurface;
use crate::view::View;
use crate::window::state::answer::Answer;
use crate::window::state::notices::Notices;
use crate::window::state::tool::Tool;
use bevy::math::DVec3;
use bevy::prelude::*;
use std::sync::Arc;

/// Points of an outline that lies on the surface.
const OUTLINE: usize = 160;
/// Points of a profile that are kept.
const MOST_POINTS: usize = 4096;
/// Regions of more samples are left to the command line.
const MOST_SAMPLES: u64 = 1 << 28;

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
    /// The region that is looked at.
    pub area: Option<Area>,
    /// What is taken off before its numbers are found.
    pub form: Option<FormKind>,
    /// Its numbers.
    pub numbers: Answer<Numbers>,
}

/// A place on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Where it is drawn, world units.
    pub world: DVec3,
    /// Its x and y in the file.
    pub at: [f64; 2],
    /// Its true height.
    pub height: f64,
    /// The world without exaggeration.
    pub true_world: DVec3,
    /// On a globe: how far the height 0 is from its middle here.
    pub radius: Option<f64>,
}

/// What a click has found.
#[derive(Clone, Debug)]
pub struct Found {
    /// The place, what is measured there or next to it.
    pub probe: Probe,
    /// Where it is drawn, where it was measured.
    pub world: Option<DVec3>,
    /// The samples of the triangle there: row, column and height.
    pub samples: Vec<(u64, u64, f64)>,
}

/// A profile.
#[derive(Clone, Debug)]
pub struct Line {
    /// Its points: distance and height; NaN in a gap.
    pub points: Vec<[f64; 2]>,
    /// Where it is drawn; none in gaps.
    pub drawn: Vec<Option<DVec3>>,
    /// Its length in plan, and how much of that was measured.
    pub lengths: [f64; 2],
}

/// A region in plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Area {
    /// Between two corners.
    Rectangle([[f64; 2]; 2]),
    /// About a middle.
    Disc(Disc),
}

/// Numbers of a region.
#[derive(Clone, Debug)]
pub struct Numbers {
    /// Those of ISO 25178-2, and how much was measured.
    pub roughness: Roughness,
    /// What was taken off before.
    pub form: Option<FormNumbers>,
    /// Its edge on the surface; none where that was not measured.
    pub outline: Vec<Option<DVec3>>,
}

/// What is asked of heights as they are shown.
pub(super) struct Asked<'a> {
    pub opened: &'a OpenSurface,
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
        let picked = asked.pick(mouse.at);
        let (placed, pick) = match picked {
            Ok(found) => found,
            Err(why) => {
                if mouse.clicked || mouse.released {
                    notices.error(why);
                }
                return;
            }
        };
        let grid = &asked.opened.file().about().grid;
        match tool {
            Tool::Inspect if mouse.clicked => self.found = asked.look(placed, pick),
            Tool::Measure if mouse.clicked => match Place::of(&placed, grid, pick) {
                Some(place) => {
                    if self.places.len() >= 2 {
                        self.places.clear();
                    }
                    self.places.push(place);
                }
                None => notices.info("nothing was measured there"),
            },
            Tool::Profile | Tool::Sphere | Tool::Cube if mouse.pressed => {
                self.origin = Place::of(&placed, grid, pick);
            }
            Tool::Profile | Tool::Sphere | Tool::Cube if mouse.released => {
                let (Some(from), Some(to)) = (self.origin.take(), Place::of(&placed, grid, pick)) else {
                    notices.info("a line, a box or a disc begins and ends where something was measured");
                    return;
                };
                self.draw(tool, asked, placed, [from.at, to.at], notices);
            }
            _ => {}
        }
    }

    /// Asks for what was drawn from one place to another.
    fn draw(&mut self, tool: Tool, asked: &Asked<'_>, placed: Placed, ends: [[f64; 2]; 2], notices: &mut Notices) {
        let [from, to] = ends;
        let reach = (to[0] - from[0]).hypot(to[1] - from[1]);
        if reach <= 0.0 {
            notices.info(tool.help());
            return;
        }
        match tool {
            Tool::Profile => {
                let (file, radius) = (Arc::clone(asked.opened.file()), radius(asked.opened, asked.settings));
                self.profile = Answer::ask("profile", move |_| line_of(&file, &placed, radius, ends));
            }
            Tool::Sphere => self.ask(asked.opened, asked.settings, Area::Disc(Disc { center: from, radius: reach })),
            _ => self.ask(asked.opened, asked.settings, Area::Rectangle(ends)),
        }
    }

    /// Asks for the numbers of a region.
    pub fn ask(&mut self, opened: &OpenSurface, settings: &Settings, area: Area) {
        self.area = Some(area);
        let (file, form, on) = (Arc::clone(opened.file()), self.form, radius(opened, settings));
        let placed = match opened.placed(settings) {
            Ok(placed) => placed,
            Err(error) => {
                self.numbers = Answer::Failed(error.to_string());
                return;
            }
        };
        self.numbers = Answer::ask("region", move |_| numbers_of(&file, &placed, on, area, form));
    }

    /// Takes what has been found out.
    pub(super) fn receive(&mut self) {
        self.found.receive();
        self.profile.receive();
        self.numbers.receive();
    }

    /// The two places' distance in space, in plan (on a globe along the great circle at the height 0), the second one's height above the first,
    /// and the angle of the way from the horizontal (on a globe of that along the circle), degrees: in the unit of the world without exaggeration
    /// but the height.
    pub fn apart(&self) -> Option<[f64; 4]> {
        let [from, to] = self.places[..] else { return None };
        let way = to.true_world - from.true_world;
        let (plan, rise) = match (from.radius, to.radius) {
            (Some(one), Some(other)) => {
                let rise = (to.true_world.length() - other) - (from.true_world.length() - one);
                (0.5 * (one + other) * from.true_world.angle_between(to.true_world), rise)
            }
            _ => (way.x.hypot(way.y), way.z),
        };
        Some([way.length(), plan, to.height - from.height, rise.atan2(plan).to_degrees()])
    }

    /// Whether the places are on a globe.
    pub fn is_on_globe(&self) -> bool {
        self.places.iter().any(|place| place.radius.is_some())
    }
}

impl Asked<'_> {
    /// What is under a pixel, and how the field stands in the world.
    fn pick(&self, at: [f64; 2]) -> Result<(Placed, Pick), String> {
        let placed = self.opened.placed(self.settings).map_err(|error| error.to_string())?;
        let found = self.opened.pick(&placed, &Sight::Flat(self.view), at).map_err(|error| error.to_string())?;
        Ok((placed, found.map_or(Pick::Beside, |(pick, _)| pick)))
    }

    /// All that is known of what was clicked.
    fn look(&self, placed: Placed, pick: Pick) -> Answer<Found> {
        let (at, samples) = match pick {
            Pick::Beside => return Answer::Nothing,
            Pick::NotMeasured { x, y, .. } => ([x, y], Vec::new()),
            Pick::Hit(hit) => ([hit.x, hit.y], hit.samples.to_vec()),
        };
        let world = match pick {
            Pick::Hit(hit) => Some(placed.world(hit.row, hit.column, hit.height)),
            Pick::NotMeasured { .. } | Pick::Beside => None,
        };
        let (file, radius) = (Arc::clone(self.opened.file()), radius(self.opened, self.settings));
        Answer::ask("sample", move |_| {
            probe_on(&*file, &Lengths::on(file.grid(), radius), at)
                .map(|probe| Found { probe, world, samples })
                .map_err(|error| error.to_string())
        })
    }
}

impl Place {
    fn of(placed: &Placed, grid: &HeightGrid, pick: Pick) -> Option<Place> {
        let Pick::Hit(hit) = pick else { return None };
        let flat = Placed { zero: 0.0, lift: placed.true_lift, ..*placed };
        let radius = || flat.world(hit.row, hit.column, 0.0).length();
        Some(Place {
            world: placed.world(hit.row, hit.column, hit.height),
            at: grid.place(hit.row, hit.column),
            height: hit.height,
            true_world: flat.world(hit.row, hit.column, hit.height),
            radius: (!placed.is_flat()).then(radius),
        })
    }
}

/// The unit of lengths of the world that a field stands in.
pub fn world_unit<'a>(placed: &Placed, grid: &'a HeightGrid) -> &'a str {
    match placed.map {
        Map::Plate => grid.xy_unit.0.as_str(),
        _ => grid.height_unit.0.as_str(),
    }
}

/// Where places of the surface are drawn; none where nothing was measured.
fn on_surface(file: &HeightFile, placed: &Placed, places: &[[f64; 2]]) -> Result<Vec<Option<DVec3>>, String> {
    let found = |at: &[f64; 2]| {
        let there = probe(file, *at).map_err(|error| error.to_string())?;
        Ok(there.height.map(|height| placed.world(there.row, there.column, height)))
    };
    places.iter().map(found).collect()
}

/// Radius in metres of the body that a field's degrees are on as settings place it: that which they name, else the Earth's.
fn radius(opened: &OpenSurface, settings: &Settings) -> f64 {
    let radius = match settings.0.get("map") {
        Some(SettingValue::Name(map)) => radius_of(map, &opened.file().about().grid).ok().flatten(),
        _ => None,
    };
    radius.unwrap_or(EARTH)
}

/// The profile between two places: along a straight line, on a globe along the great circle.
fn profile_between(
    file: &HeightFile,
    lengths: &Lengths,
    is_flat: bool,
    ends: [[f64; 2]; 2],
) -> Result<Profile, HeightError> {
    if is_flat {
        return profile_on(file, lengths, &ends);
    }
    let mut whole = Profile { points: Vec::new(), length: 0.0, valid_length: 0.0 };
    for piece in great_circle(file.grid(), ends) {
        let found = profile_on(file, lengths, &piece)?;
        let before = whole.length;
        whole
            .points
            .extend(found.points.into_iter().map(|point| ProfilePoint { distance: before + point.distance, ..point }));
        whole.length += found.length;
        whole.valid_length += found.valid_length;
    }
    Ok(whole)
}

fn line_of(file: &HeightFile, placed: &Placed, radius: f64, ends: [[f64; 2]; 2]) -> Result<Line, String> {
    let grid = file.grid();
    let lengths = Lengths::on(grid, radius);
    let found = profile_between(file, &lengths, placed.is_flat(), ends).map_err(|error| error.to_string())?;
    let every = found.points.len().div_ceil(MOST_POINTS).max(1);
    // Gaps and ends stay, however many points there are.
    let last = found.points.len().saturating_sub(1);
    let kept = |(index, point): &(usize, &ProfilePoint)| index % every == 0 || *index == last || point.height.is_nan();
    let points: Vec<&ProfilePoint> = found.points.iter().enumerate().filter(kept).map(|(_, point)| point).collect();
    let drawn = points.iter().map(|point| {
        let [row, column] = grid.row_column([point.x, point.y]);
        (!point.height.is_nan()).then(|| placed.world(row, column, point.height))
    });
    let drawn = drawn.collect();
    let points = points.iter().map(|point| [point.distance, point.height]).collect();
    Ok(Line { points, drawn, lengths: [found.length, found.valid_length] })
}

fn numbers_of(
    file: &HeightFile,
    placed: &Placed,
    radius: f64,
    area: Area,
    form: Option<FormKind>,
) -> Result<Numbers, String> {
    let few = || "the region has fewer than 2 x 2 samples".to_owned();
    let part = |heights| match area {
        Area::Rectangle(corners) => Part::of_rectangle(heights, corners),
        Area::Disc(disc) => Part::of_disc(heights, disc),
    };
    let region = part(file).ok_or_else(few)?;
    if region.grid().samples() > MOST_SAMPLES {
        let found = region.grid().samples();
        return Err(format!(
            "a region of {found} samples takes a while: deepfield probe FILE --rectangle ... asks for it"
        ));
    }
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let form = form.map(|kind| fit(&region, kind).map_err(|error| told(&error))).transpose()?;
    let taken = form.as_ref().map(|form| form.numbers());
    let roughness = match form {
        None => roughness_on(&region, &Lengths::on(region.grid(), radius)),
        Some(form) => {
            let rest = Residual::new(file, form);
            part(&rest).ok_or_else(few).map(|region| roughness_on(&region, &Lengths::on(region.grid(), radius)))?
        }
    };
    let outline = on_surface(file, placed, &edge(area))?;
    Ok(Numbers { roughness: roughness.map_err(|error| told(&error))?, form: taken, outline })
}

/// Places along a region's edge, the first one again at the end.
fn edge(area: Area) -> Vec<[f64; 2]> {
    (0..=OUTLINE)
        .map(|step| {
            let turn = step as f64 / OUTLINE as f64;
            match area {
                Area::Disc(Disc { center, radius }) => {
                    let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
                    [center[0] + radius * cos, center[1] + radius * sin]
                }
                Area::Rectangle([a, b]) => {
                    let corners = [a, [b[0], a[1]], b, [a[0], b[1]], a];
                    let side = ((4.0 * turn) as usize).min(3);
                    let along = 4.0 * turn - side as f64;
                    [0, 1].map(|axis| corners[side][axis] + along * (corners[side + 1][axis] - corners[side][axis]))
                }
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_closed_and_pass_all_corners() {
        let corners = [[1.0, 2.0], [5.0, -3.0]];
        let edge = edge(Area::Rectangle(corners));
        assert_eq!((edge.first(), edge.last()), (Some(&corners[0]), Some(&corners[0])));
        for corner in [[1.0, 2.0], [5.0, 2.0], [5.0, -3.0], [1.0, -3.0]] {
            assert!(edge.contains(&corner), "{corner:?}");
        }
        let round = super::edge(Area::Disc(Disc { center: [1.0, 1.0], radius: 2.0 }));
        assert!(round.iter().all(|[x, y]| ((x - 1.0).hypot(y - 1.0) - 2.0).abs() < 1e-12));
    }
}
