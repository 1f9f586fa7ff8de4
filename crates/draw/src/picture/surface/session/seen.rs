//! What is seen of an open height field, view after view: colours, depths, letters, fragments, and what an adapter is to draw.

use super::super::clearance::Ground;
use super::super::depths::SurfaceDepths;
use super::super::letters::ProgramFont;
use super::super::painting::{Field, has_labels, is_beyond_frames};
use super::super::standing::{bounds_of, standing};
use super::{Prepared, SurfaceSession};
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Colors, Image};
use crate::cpu::paths::PathFragments;
use crate::cpu::surface::fragments::{Layer, fragments};
use crate::cpu::surface::lettering;
use crate::cpu::surface::look::Attribute;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::{SurfaceOptions, SurfacePicture, SurfaceReport, draw_lettered};
use crate::heights::model::{HeightError, Heights};
use crate::look::{LookPatch, Shot};
use crate::modes::surface::SurfaceSettings;
use crate::picture::PictureError;
use crate::picture::adapter::{AdapterSurface, Passes};
use crate::view::{Panorama, View};

/// A picture of a view, or what an adapter is to draw of it, and what is known of it.
pub struct SeenSurface<P = SurfacePicture> {
    /// The picture.
    pub picture: P,
    /// What colours it.
    pub attribute: Attribute,
    /// How values become colours.
    pub transfer: TransferFunction,
    /// The values that the first and the last colour stand for.
    pub levels: Levels,
    /// What cannot be read of it.
    pub error: Option<String>,
}

impl SurfaceSession {
    /// A look's picture of a view; its colours have the range `levels`, or their own.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn image(&mut self, look: &LookPatch, view: &View, levels: Option<Levels>) -> Result<Image, PictureError> {
        let seen = self.seen(look, view, levels)?;
        Ok(look.bloom.unwrap_or_default().image(&seen.picture.colors))
    }

    /// The same with what is known of it, for those who draw view after view.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn seen(&mut self, look: &LookPatch, view: &View, levels: Option<Levels>) -> Result<SeenSurface, PictureError> {
        self.seen_by(look, view, levels, |field, sight, options| {
            draw_lettered(field.nodes, field.placed, sight, options, Some(&ProgramFont))
        })
    }

    /// What an adapter is to draw of a look's picture of a view by these passes, and what is known of it; `None` where only the processor draws
    /// such a picture ([`super::super::OpenSurface::is_for_passes`]).
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn asked(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        passes: Passes,
    ) -> Result<SeenSurface<Option<(AdapterSurface, SurfaceReport)>>, PictureError> {
        self.seen_by(look, view, levels, |field, sight, options| match is_beyond_frames(options) {
            true => None,
            false => field.job(sight, options, passes),
        })
    }

    /// How far a look's surface is from the plane of the eye, at the pixels' centres.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn depths(&mut self, look: &LookPatch, view: &View) -> Result<Option<SurfaceDepths>, PictureError> {
        let seen = self.seen_by(look, view, None, |field, sight, options| {
            let places = SurfaceOptions { look: None, raw: true, ..options.clone() };
            draw_lettered(field.nodes, field.placed, sight, &places, None)
        })?;
        Ok(SurfaceDepths::new(*view, seen.picture.depth))
    }

    /// The pixels of a look's picture that heights stand on along its lines, with these, and nothing elsewhere: for whoever shows a picture that has
    /// lines all over it. `None` where no heights are asked for.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn lettering(&mut self, look: &LookPatch, view: &View) -> Result<Option<Colors>, PictureError> {
        let seen = self.seen_by(look, view, None, |field, sight, options| {
            let layer = || lettering::layer((field.nodes, field.placed), sight, options, &ProgramFont);
            has_labels(options).then(layer)
        })?;
        Ok(seen.picture)
    }

    fn seen_by<P>(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        draw: impl FnOnce(&Field<'_>, &Sight, &SurfaceOptions) -> P,
    ) -> Result<SeenSurface<P>, PictureError> {
        let mut prepared = self.prepare(look)?;
        if let Some(levels) = levels {
            prepared.look.range = levels.p;
        }
        self.nodes(&prepared);
        let Prepared { look: own, attribute, .. } = &prepared;
        let (transfer, attribute) = (own.transfer.clone(), *attribute);
        let levels = Levels { p: own.range, s: [0.0, 1.0] };
        let Prepared { settings, look: own, form, placed, .. } = prepared;
        let options = settings.options(own, look.error_px);
        let options = SurfaceOptions { form, shadowing: self.shadowing(&options, &placed), ..options };
        let sight = Sight::Flat(*view);
        self.nodes.prepare(&placed, &sight, &options);
        let field = Field { nodes: &self.nodes, placed: &placed, extremes: self.extremes() };
        let picture = draw(&field, &sight, &options);
        Ok(SeenSurface { picture, attribute, transfer, levels, error: self.nodes.error() })
    }

    /// What each pixel of a view shows of a look, from front to back: colours in linear light, and depths in the view's lengths. For whoever
    /// draws something else in the same view, or asks what hides what.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn fragments(&mut self, look: &LookPatch, view: &View) -> Result<(PathFragments, SurfaceReport), PictureError> {
        let prepared = self.prepare(look)?;
        prepared.among_others().map_err(|why| PictureError::of(self.opened.path(), why))?;
        let options = SurfaceOptions { raw: false, ..self.surface_options(&prepared, look) };
        let (placed, sight) = (prepared.placed, Sight::Flat(*view));
        let source = self.nodes(&prepared);
        source.prepare(&placed, &sight, &options);
        Ok(fragments(&[Layer { source, placed: &placed, sight: &sight, options: &options, scale: 1.0 }]))
    }

    /// From where a shot is seen, and how the field stands there: for those who ask what is under its pixels.
    ///
    /// # Errors
    /// Settings that do not fit the field, and cameras that cannot see anything.
    pub fn sight(heights: &dyn Heights, extremes: [f64; 2], shot: &Shot) -> Result<(Sight, Placed), PictureError> {
        let grid = heights.grid();
        let settings = SurfaceSettings::new(&shot.look.settings, grid).map_err(PictureError::Asked)?;
        let placed = Placed::new(grid, settings.map, settings.exaggeration, settings.base);
        let bounds = bounds_of(&placed, extremes);
        let mut shot = standing(shot, bounds, &placed)?;
        let ground = Ground { heights, placed: &placed };
        let told = |error: HeightError| PictureError::Asked(error.to_string());
        ground.keep_above(&mut shot, settings.clearance).map_err(told)?;
        let view = shot.view(bounds, None)?;
        let sight = match Panorama::around(&view, shot.surround)? {
            None => Sight::Flat(view),
            Some(panorama) => Sight::Around { panorama, eye: view.eye, cut: view.cut },
        };
        Ok((sight, placed))
    }
}
