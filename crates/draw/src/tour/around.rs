//! Cameras that look at something: where that is, and where the camera stands for it.

use super::file::{Around, TourError, What};
use super::place::TourPlace;
use crate::explore::region::Shape;
use crate::explore::{Catalogue, ExploreError, Members, Work};
use crate::hierarchy::spacetime::Interpolation;
use crate::look::dataset::named_in;
use crate::look::{Camera, LookPatch, OpenData};
use crate::model::ron_place::Place;
use crate::model::url::shown;
use crate::model::{Bounds, StepTimes, When};
use crate::view::View;
use glam::{DQuat, DVec3};
use std::path::{Path, PathBuf};

/// What a tour is shown with.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// What to call the tour in messages.
    pub file: String,
    /// Its text, to name places in; empty where there is none.
    pub text: String,
    /// The folder that catalogues and pictures are named from.
    pub folder: PathBuf,
    /// The box that shows all of the data but far outliers.
    pub framed: Bounds,
    /// Width over height of the pictures.
    pub aspect: f64,
    /// When the steps of the data are, where it has several.
    pub times: Option<StepTimes>,
    /// The data itself, where it changes with time.
    pub data: Option<OpenData>,
}

/// A moment of the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DataMoment {
    /// When it is.
    pub time: Option<When>,
    /// How particles move there.
    pub interpolation: Interpolation,
}

impl DataMoment {
    /// That of a look.
    pub fn of(look: &LookPatch) -> DataMoment {
        DataMoment { time: look.time, interpolation: look.interpolation.unwrap_or_default() }
    }
}

impl Surroundings {
    /// For messages.
    pub(super) fn place(&self) -> Place<'_> {
        Place { file: &self.file, text: &self.text }
    }

    /// When a keyframe's picture is, as a time of the data; `before`: that of the keyframe before. `None` for data without times.
    ///
    /// # Errors
    /// [`TourError`] where that lies outside.
    pub(super) fn time(
        &self,
        index: usize,
        named: Option<When>,
        before: Option<When>,
    ) -> Result<Option<When>, TourError> {
        let Some(times) = &self.times else { return Ok(None) };
        let Some(named) = named else { return Ok(before.or(times.times.first().copied().map(When::Time))) };
        let refuse =
            |reason: String| self.place().refuse_in(index, &["time"], named, format!("a time of the data: {reason}"));
        let moment = times.moment(named).map_err(refuse)?;
        Ok(Some(When::Time(times.time(moment))))
    }

    /// The box that shows all of the data at a moment.
    fn framed(&self, index: usize, look: &LookPatch) -> Result<Bounds, TourError> {
        let DataMoment { time, interpolation } = DataMoment::of(look);
        let Some((data, time)) = self.data.as_ref().zip(time) else { return Ok(self.framed) };
        let framed = data.moment(Some(time)).and_then(|moment| match moment {
            Some(moment) => data.framed(moment, interpolation, look.families.as_deref()),
            None => Ok(self.framed),
        });
        framed.map_err(|error| self.failed(index, error.into()))
    }

    /// Where the centre of mass of a selection of the data is at a moment; `None` where nobody knows.
    ///
    /// # Errors
    /// When the data cannot be read.
    pub(super) fn center(&self, members: &Members, at: DataMoment) -> Result<Option<DVec3>, ExploreError> {
        center(self.data.as_ref(), members, at)
    }

    pub(super) fn failed(&self, index: usize, source: ExploreError) -> TourError {
        TourError::Object { file: self.file.clone(), keyframe: index + 1, source: Box::new(source) }
    }

    /// The camera that shows all of the data at a keyframe, for the direction that is up: from the front, or where that is another one than
    /// usual, from above and in front.
    ///
    /// # Errors
    /// [`TourError`] when the data cannot be read.
    pub(super) fn usual_camera(&self, index: usize, look: &LookPatch, up: DVec3) -> Result<Camera, TourError> {
        if up != DVec3::Y {
            let above = Around { what: What::Data, distance: 2.4, azimuth: 0.0, elevation: 40.0, fov: 45.0 };
            return self.camera(index, &above, look, up);
        }
        let framed = self.framed(index, look)?;
        let height = 1000;
        let width = (self.aspect * f64::from(height)).round().clamp(1.0, 32768.0) as u32;
        let target = framed.center();
        let fov: f64 = 45.0;
        let eye = match View::around(framed, fov.to_radians(), width, height) {
            Ok(view) => view.eye,
            Err(_) => target + DVec3::Z,
        };
        Ok(Camera { eye: eye.to_array(), target: target.to_array(), up: [0.0, 1.0, 0.0], fov, ortho: None })
    }

    /// The camera of the keyframe number `index`, from 0, with a look, for the direction that is up.
    ///
    /// # Errors
    /// [`TourError`] where there is no such thing.
    pub(super) fn camera(
        &self,
        index: usize,
        around: &Around,
        look: &LookPatch,
        up: DVec3,
    ) -> Result<Camera, TourError> {
        let (middle, radius) = self.ball(index, &around.what, look)?;
        let upright = DQuat::from_rotation_arc(DVec3::Y, up.normalize_or(DVec3::Y));
        let azimuth = around.azimuth.to_radians();
        // Straight above, the front is at the lower edge.
        let elevation = around.elevation.clamp(-89.999, 89.999).to_radians();
        let direction = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
        let eye = middle + radius * around.distance * (upright * direction);
        Ok(Camera { eye: eye.to_array(), target: middle.to_array(), up: up.to_array(), fov: around.fov, ortho: None })
    }

    /// The ball around the members of a selection who stay the same: of that radius, or with nine tenths of them in it.
    fn followed_ball(
        &self,
        members: &Members,
        look: &LookPatch,
        radius: Option<f64>,
    ) -> Result<Option<(DVec3, f64)>, ExploreError> {
        let at = DataMoment::of(look);
        let Some(middle) = self.center(members, at)? else { return Ok(None) };
        let Some((data, following)) = self.data.as_ref().and_then(|data| Some((data, data.following()?))) else {
            return Ok(None);
        };
        let found = following.of(members, Work::quiet())?.zip(data.moment(at.time)?);
        let radius = match (radius, found) {
            (Some(radius), _) => Some(radius),
            (None, Some((followed, moment))) => followed.radius(middle, moment, at.interpolation)?,
            (None, None) => None,
        };
        Ok(radius.map(|radius| (middle, positive(radius))))
    }

    /// Middle and radius of something.
    fn ball(&self, index: usize, what: &What, look: &LookPatch) -> Result<(DVec3, f64), TourError> {
        let selections = look.selections.as_deref().unwrap_or_default();
        let refuse = |found: &str, expected: String| {
            Err(self.place().refuse_in(index, &["around", "what"], found, expected).into())
        };
        match what {
            What::Data => {
                let framed = self.framed(index, look)?;
                Ok((framed.center(), positive(0.5 * framed.size().max_element())))
            }
            What::Ball(middle, radius) => Ok((DVec3::from(*middle), *radius)),
            What::Selection(name) => {
                let Some(set) = selections.iter().find(|set| set.name == *name) else {
                    let names: Vec<&str> = selections.iter().map(|set| set.name.as_str()).collect();
                    return refuse(
                        name,
                        format!("a selection of this keyframe or one before it: {}", names.join(", ")),
                    );
                };
                let shape = set.members.region().and_then(|region| region.shapes.first());
                let ball = match shape {
                    Some(Shape::Sphere { center, radius }) => Some((*center, *radius)),
                    Some(Shape::Box { min, max }) => {
                        Some((0.5 * (*min + *max), positive(0.5 * (*max - *min).length())))
                    }
                    _ => None,
                };
                match (&set.members, ball) {
                    (Members::Region(_), Some(ball)) => Ok(ball),
                    (Members::Region(_), None) => {
                        refuse(name, "a selection whose first shape is a sphere or a box".into())
                    }
                    // Of who stays the same, the centre goes along; a shape keeps its size.
                    (members, ball) => match self.followed_ball(members, look, ball.map(|(_, radius)| radius)) {
                        Ok(Some(ball)) => Ok(ball),
                        Ok(None) => refuse(name, "a selection with a particle in a run with tracks".into()),
                        Err(error) => Err(self.failed(index, error)),
                    },
                }
            }
            What::Object(text) => {
                let Some((path, name)) = text.rsplit_once('#') else {
                    let found = shown(Path::new(text));
                    return refuse(
                        &found.to_string_lossy(),
                        "CATALOGUE#N or CATALOGUE#NAME such as groups.hdf5#0".into(),
                    );
                };
                let wrap = |source| self.failed(index, source);
                let catalogue = Catalogue::read(&named_in(&self.folder, Path::new(path))).map_err(wrap)?;
                let object = match name.parse() {
                    Ok(rank) => catalogue.ranked(rank),
                    Err(_) => catalogue.named(name),
                };
                let object = object.map_err(wrap)?;
                let usual = 0.02 * self.framed.size().max_element();
                Ok((object.position, positive(object.radius.unwrap_or(usual))))
            }
        }
    }
}

/// Where the centre of mass of a selection of the data is at a moment; `None` without data that changes, or without particles.
///
/// # Errors
/// When the data cannot be read.
pub(super) fn center(
    data: Option<&OpenData>,
    members: &Members,
    at: DataMoment,
) -> Result<Option<DVec3>, ExploreError> {
    let Some((data, following)) = data.and_then(|data| Some((data, data.following()?))) else { return Ok(None) };
    let Some(moment) = data.moment(at.time)? else { return Ok(None) };
    let center = following.center(members, moment, at.interpolation, Work::quiet())?;
    Ok(center.map(|center| center.position))
}

fn positive(radius: f64) -> f64 {
    if radius > 0.0 && radius.is_finite() { radius } else { 1.0 }
}
