//! A picture of any mode, drawn and not yet written: what `render` and `tour` make files of.

use super::CommandResult;
use super::annotate::Stage;
use super::lettering::{self, Sheet};
use super::paint::{self, Outcome};
use super::picture_statistics::write_statistics;
use super::render::{self, Picture};
use super::request::Request;
use super::studio::Studio;
use crate::annotate::overlay::mix_into;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Image, composite, output};
use crate::picture::look::transfer_of;
use std::path::Path;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// A picture's values before they become colours.
pub(super) enum Drawing {
    /// `P` and `S`.
    Splats(Box<Picture>),
    /// Colours in linear light.
    Colors(Box<Outcome>),
}

/// How a picture's values became colours: everything that is found from the picture unless it is set.
#[derive(Clone, Debug)]
pub(super) struct Coloration {
    /// The transfer function in use.
    pub transfer: TransferFunction,
    /// Its ranges.
    pub levels: Levels,
}

impl Drawing {
    /// Draws what the request says; pages that `studio` has are not read again, and it is opened where it is `None`.
    ///
    /// # Errors
    /// When the source cannot be read, a setting does not fit the data, or no adapter draws.
    pub fn new(request: &Request, studio: &mut Option<Studio>) -> Result<Drawing, Failure> {
        if studio.is_none() && request.exact.is_none() {
            *studio = Some(Studio::open(&request.members)?);
        }
        let studio = studio.as_mut().filter(|_| request.exact.is_none());
        Ok(match request.look().mode.filter(|mode| mode.is_light()) {
            Some(mode) => Drawing::Colors(Box::new(paint::draw(request, mode, studio)?)),
            None => Drawing::Splats(Box::new(render::draw(request, studio)?)),
        })
    }

    /// How its values become colours.
    pub fn coloration(&self, request: &Request) -> Coloration {
        let transfer = transfer_of(request.look(), &self.stage().depiction);
        let levels = match self {
            Drawing::Splats(picture) => transfer.levels(&picture.accumulation),
            Drawing::Colors(outcome) => {
                Levels { p: outcome.painted.levels.density, s: outcome.painted.levels.attribute }
            }
        };
        Coloration { transfer, levels }
    }

    /// The finished picture.
    ///
    /// # Errors
    /// Projections and eyes that make no sense.
    pub fn image(&self, request: &Request) -> Result<Image, Failure> {
        let coloration = self.coloration(request);
        let background = request.look().background.unwrap_or_default();
        let stage = self.stage();
        let mut image = match self {
            Drawing::Splats(picture) => {
                let Coloration { transfer, levels } = &coloration;
                composite::composite_on(&picture.accumulation, transfer, levels, background)
            }
            Drawing::Colors(outcome) => outcome.painted.colors.image_on(background),
        };
        stage.mark(&mut image);
        if let Some(annotations) = &request.look().annotations {
            for sheet in self.sheets(request, &image)? {
                sheet.lay(&mut image, |image| {
                    stage.annotate(image, &sheet.view, annotations, &coloration.transfer, &coloration.levels);
                    Ok::<(), Failure>(())
                })?;
            }
        }
        Ok(image)
    }

    fn stage(&self) -> &Stage {
        match self {
            Drawing::Splats(picture) => &picture.stage,
            Drawing::Colors(outcome) => &outcome.stage,
        }
    }

    /// What is written on in the finished picture.
    fn sheets(&self, request: &Request, image: &Image) -> Result<Vec<Sheet>, Failure> {
        let (surround, stereo) = (request.shot.surround, request.shot.stereo);
        Ok(lettering::sheets(&self.stage().view, [image.width, image.height], surround, stereo)?)
    }

    /// [`Drawing::image`] with what the request's film does to it.
    ///
    /// # Errors
    /// As [`Drawing::new`] for the picture that it is blended with, and where a picture over it cannot be read.
    pub fn finished(&self, request: &Request, studio: &mut Option<Studio>) -> Result<Image, Failure> {
        let mut image = self.image(request)?;
        let Some(film) = &request.shot.film else { return Ok(image) };
        if let Some(from) = &film.from {
            let before = request.before(from);
            let mut mixed = Drawing::new(&before, studio)?.image(&before)?;
            mix_into(&mut mixed, &image, film.share);
            image = mixed;
        }
        for sheet in self.sheets(request, &image)? {
            // Paths of pictures are complete by now.
            sheet.lay(&mut image, |image| film.overlay.paint(image, Path::new("")))?;
        }
        Ok(image)
    }

    /// Whether everything that the view needs at its error bound was drawn.
    pub fn is_converged(&self) -> bool {
        match self {
            Drawing::Splats(picture) => picture.converged,
            Drawing::Colors(outcome) => outcome.converged,
        }
    }

    /// Writes the raw channels as EXR.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_exr(&self, path: &Path) -> Result<(), output::OutputError> {
        match self {
            Drawing::Splats(picture) => output::write_exr(path, &picture.accumulation),
            Drawing::Colors(outcome) => output::write_exr_colors(path, &outcome.painted.colors),
        }
    }

    /// Writes the raw channels as a NumPy array.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_npy(&self, path: &Path) -> Result<(), output::OutputError> {
        match self {
            Drawing::Splats(picture) => output::write_npy(path, &picture.accumulation),
            Drawing::Colors(outcome) => output::write_npy_colors(path, &outcome.painted.colors),
        }
    }

    /// Writes statistics as JSON.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_statistics(&self, path: &Path) -> CommandResult {
        match self {
            Drawing::Splats(picture) => write_statistics(path, picture),
            Drawing::Colors(outcome) => paint::write_statistics(path, outcome),
        }
    }
}
