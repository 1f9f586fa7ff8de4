//! Cameras that look at something: where that is, and where the camera stands for it.

use super::file::{Around, TourError, What};
use super::place::TourPlace;
use crate::explore::region::Shape;
use crate::explore::{Catalogue, Members, SelectionSet};
use crate::look::Camera;
use crate::model::ron_place::Place;
use crate::model::{Bounds, StepTimes, When};
use crate::view::View;
use glam::{DQuat, DVec3};
use std::path::PathBuf;

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

    /// The camera that shows all of the data.
    pub(super) fn usual_camera(&self) -> Camera {
        let height = 1000;
        let width = (self.aspect * f64::from(height)).round().clamp(1.0, 32768.0) as u32;
        let target = self.framed.center();
        let fov: f64 = 45.0;
        let eye = match View::around(self.framed, fov.to_radians(), width, height) {
            Ok(view) => view.eye,
            Err(_) => target + DVec3::Z,
        };
        Camera { eye: eye.to_array(), target: target.to_array(), up: [0.0, 1.0, 0.0], fov, ortho: None }
    }

    /// The camera of the keyframe number `index`, from 0, with these selections, for the direction that is up.
    ///
    /// # Errors
    /// [`TourError`] where there is no such thing.
    pub(super) fn camera(
        &self,
        index: usize,
        around: &Around,
        selections: &[SelectionSet],
        up: DVec3,
    ) -> Result<Camera, TourError> {
        let (middle, radius) = self.ball(index, &around.what, selections)?;
        let upright = DQuat::from_rotation_arc(DVec3::Y, up.normalize_or(DVec3::Y));
        let azimuth = around.azimuth.to_radians();
        // Straight above, the front is at the lower edge.
        let elevation = around.elevation.clamp(-89.999, 89.999).to_radians();
        let direction = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
        let eye = middle + radius * around.distance * (upright * direction);
        Ok(Camera { eye: eye.to_array(), target: middle.to_array(), up: up.to_array(), fov: around.fov, ortho: None })
    }

    /// Middle and radius of something.
    fn ball(&self, index: usize, what: &What, selections: &[SelectionSet]) -> Result<(DVec3, f64), TourError> {
        let refuse = |found: &str, expected: String| {
            Err(self.place().refuse_in(index, &["around", "what"], found, expected).into())
        };
        match what {
            What::Data => Ok((self.framed.center(), positive(0.5 * self.framed.size().max_element()))),
            What::Ball(middle, radius) => Ok((DVec3::from(*middle), *radius)),
            What::Selection(name) => {
                let Some(set) = selections.iter().find(|set| set.name == *name) else {
                    let names: Vec<&str> = selections.iter().map(|set| set.name.as_str()).collect();
                    return refuse(
                        name,
                        format!("a selection of this keyframe or one before it: {}", names.join(", ")),
                    );
                };
                let Members::Region(region) = &set.members else {
                    return refuse(name, "a selection of a region, not of ids".into());
                };
                match region.shapes.first() {
                    Some(Shape::Sphere { center, radius }) => Ok((*center, *radius)),
                    Some(Shape::Box { min, max }) => Ok((0.5 * (*min + *max), positive(0.5 * (*max - *min).length()))),
                    _ => refuse(name, "a selection whose first shape is a sphere or a box".into()),
                }
            }
            What::Object(text) => {
                let Some((path, name)) = text.rsplit_once('#') else {
                    return refuse(text, "CATALOGUE#N or CATALOGUE#NAME such as groups.hdf5#0".into());
                };
                let wrap = |source| TourError::Object {
                    file: self.file.clone(),
                    keyframe: index + 1,
                    source: Box::new(source),
                };
                let catalogue = Catalogue::read(&self.folder.join(path)).map_err(wrap)?;
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

fn positive(radius: f64) -> f64 {
    if radius > 0.0 && radius.is_finite() { radius } else { 1.0 }
}
