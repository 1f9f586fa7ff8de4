//! What draws shots of data, whatever it is: particles, an image or a volume, measured heights, or these among other things.

use super::field::FieldSession;
use super::mixed::MixedSession;
use super::ranges::{Format, Measured};
use super::surface::SurfaceSession;
use super::{Picture, PictureError, Session};
use crate::color::Image;
use crate::color::transfer::{Levels, TransferFunction};
use crate::look::{Camera, LookPatch, Shot};
use crate::model::Bounds;
use crate::view::View;

/// What draws shots of open data.
pub enum AnySession {
    /// Of particles.
    Particles(Box<Session>),
    /// Of an image or a volume.
    Field(Box<FieldSession>),
    /// Of measured heights.
    Surface(Box<SurfaceSession>),
    /// Of several kinds of data, or of several of one that is no particles.
    Mixed(Box<MixedSession>),
}

impl AnySession {
    /// What draws particles, where these are open.
    pub fn particles(&mut self) -> Option<&mut Session> {
        match self {
            AnySession::Particles(session) => Some(session),
            AnySession::Mixed(session) => session.particles(),
            AnySession::Field(_) | AnySession::Surface(_) => None,
        }
    }

    /// What draws an image or a volume, where one is open.
    pub fn field(&mut self) -> Option<&mut FieldSession> {
        match self {
            AnySession::Field(session) => Some(session),
            AnySession::Particles(_) | AnySession::Surface(_) | AnySession::Mixed(_) => None,
        }
    }

    /// Whether z is up in the world: in that of heights.
    pub fn has_z_up(&self) -> bool {
        match self {
            AnySession::Particles(_) | AnySession::Field(_) => false,
            AnySession::Surface(_) => true,
            AnySession::Mixed(session) => session.begins_with_heights(),
        }
    }

    /// The box that a look's pictures are framed by.
    ///
    /// # Errors
    /// When the data has nothing of it, or cannot be opened.
    pub fn framed(&mut self, look: &LookPatch) -> Result<Bounds, PictureError> {
        match self {
            AnySession::Particles(session) => session.framed(look),
            AnySession::Field(session) => Ok(session.opened().grid().bounds()),
            AnySession::Surface(session) => session.framed(look),
            AnySession::Mixed(session) => session.framed(look),
        }
    }

    /// The transfer function of a shot: its own, or the usual one of what it is about.
    ///
    /// # Errors
    /// When its look does not fit the data.
    pub fn transfer(&mut self, shot: &Shot) -> Result<TransferFunction, PictureError> {
        match self {
            AnySession::Particles(session) => Ok(session.show(&shot.look)?.2),
            AnySession::Field(session) => Ok(session.prepare(shot)?.transfer),
            AnySession::Surface(session) => Ok(session.prepare(&shot.look)?.look.transfer),
            AnySession::Mixed(session) => session.transfer(shot),
        }
    }

    /// Refuses a look that names what the data does not have, before anything is drawn.
    ///
    /// # Errors
    /// What was found, and what was expected.
    pub fn check(&self, look: &LookPatch) -> Result<(), PictureError> {
        match self {
            AnySession::Particles(session) => session.check(look),
            AnySession::Field(session) => {
                let opened = session.opened();
                let attribute = look.attribute_name().map(|name| opened.attribute(name)).transpose();
                attribute.map(|_| ()).map_err(|why| PictureError::of(opened.path(), why))
            }
            AnySession::Surface(session) => session.prepare(look).map(|_| ()),
            AnySession::Mixed(_) => Ok(()),
        }
    }

    /// Bytes that what pictures are drawn from may take, where that may make them coarser.
    pub fn memory(&self) -> Option<u64> {
        match self {
            AnySession::Particles(session) => session.page_memory(),
            AnySession::Field(_) => None,
            AnySession::Surface(session) => Some(session.chunk_memory()),
            AnySession::Mixed(session) => session.memory(),
        }
    }

    /// Whether the picture that was drawn last, or what was found of a view since, needed more than these.
    pub fn lacks_memory(&self) -> bool {
        match self {
            AnySession::Particles(session) => session.lacks_memory(),
            AnySession::Field(_) => false,
            AnySession::Surface(session) => session.lacks_memory(),
            AnySession::Mixed(session) => session.lacks_memory(),
        }
    }

    /// Draws a shot.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, a setting does not fit it, or nothing draws the mode.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        match self {
            AnySession::Particles(session) => session.draw(shot),
            AnySession::Field(session) => session.draw(shot),
            AnySession::Surface(session) => session.draw(shot),
            AnySession::Mixed(session) => session.draw(shot),
        }
    }

    /// A drawn picture in colours, with what the shot's film does to it.
    ///
    /// # Errors
    /// As [`AnySession::draw`] for the picture that it is blended with, and where a picture over it cannot be read.
    pub fn finished(&mut self, shot: &Shot, picture: &Picture) -> Result<Image, PictureError> {
        match self {
            AnySession::Particles(session) => session.finished(shot, picture),
            AnySession::Field(session) => session.finished(shot, picture),
            AnySession::Surface(session) => session.finished(shot, picture),
            AnySession::Mixed(session) => session.finished(shot, picture),
        }
    }

    /// A look's picture of a view, of about `limit` particles at most, black where nothing is in view; its colours have the ranges `levels`, or
    /// their own. And how many particles it took.
    ///
    /// # Errors
    /// As [`AnySession::draw`].
    pub fn image(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        diameter: f64,
        limit: u64,
    ) -> Result<(Image, u64), PictureError> {
        match self {
            AnySession::Particles(session) => session.image(look, view, levels, diameter, limit),
            AnySession::Field(session) => Ok((session.image(look, view, levels)?, 0)),
            AnySession::Surface(session) => Ok((session.image(look, view, levels)?, 0)),
            AnySession::Mixed(session) => session.image(look, view, levels, diameter, limit),
        }
    }

    /// What is known of a look's picture from a camera: its ranges.
    ///
    /// # Errors
    /// As [`AnySession::draw`].
    pub fn ranges(&mut self, look: &LookPatch, camera: &Camera, format: Format) -> Result<Measured, PictureError> {
        match self {
            AnySession::Particles(session) => session.ranges(look, camera, format),
            AnySession::Field(session) => session.ranges(look, camera, format),
            AnySession::Surface(session) => session.ranges(look, camera, format),
            AnySession::Mixed(session) => session.ranges(look, camera, format),
        }
    }
}
