//! A picture that is drawn and not yet written.

use super::annotation::Annotation;
use super::error::PictureError;
use super::field::PointsReport;
use super::glow;
use super::ground::through;
use super::left_out::LeftOut;
use super::lettering::{self, Sheet};
use super::level_report::LevelReport;
use super::paths::PathCounts;
use super::surface::{CHANNELS, SurfaceShown};
use crate::annotate::Legend;
use crate::annotate::overlay::mix_into;
use crate::color::composite::Background;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Accumulation, Colors, Image, composite, output};
use crate::cpu::paths::fragments::lay_over;
use crate::cpu::slice::arrows::ArrowKey;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::{Film, Shot};
use crate::mode::{LightPicture, Raw};
use crate::model::Moment;
use crate::store::RunFile;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// What was drawn, before it becomes colours, and how.
pub struct Picture {
    /// Sums, or colours in linear light.
    pub values: Raw,
    /// What it shows, and what is written into it.
    pub annotation: Annotation,
    /// The colours that sums become; of other pictures, those they were drawn with.
    pub transfer: TransferFunction,
    /// Whether everything that the view needs at its error bound was drawn.
    pub converged: bool,
    /// Whether it is not converged since there is no memory for what is asked for, and is whole in the finest detail that there is memory for: then
    /// it is the same whenever it is drawn with as much. Of heights also where as many chunks are drawn as may be at most.
    pub is_coarser: bool,
    /// Largest displacement of a drawn particle, pixels.
    pub error_px: f64,
    /// Particles of what was selected.
    pub particles: u64,
    /// Nodes of it.
    pub nodes: usize,
    /// What inner nodes it was drawn from, by name; `source` where source particles were drawn.
    pub drawn_from: &'static str,
    /// What of it sums left out.
    pub left_out: LeftOut,
    /// The levels of sums, and how far they may be from what was left out.
    pub level_report: LevelReport,
    /// Backend and adapter that drew.
    pub drawn_by: [String; 2],
    /// Median of each pass, milliseconds.
    pub milliseconds: BTreeMap<String, f64>,
    /// When it is; `None` for data without times.
    pub moment: Option<ShownMoment>,
    /// Paths that lie on top of it; those of modes that take them are among its values.
    pub paths: Option<Arc<Colors>>,
    /// Measured surfaces under sums; those of colours are among its values.
    pub ground: Option<Arc<Colors>>,
    /// Sums as they would be without what they are seen through, such as a volume: their colours are those of these, dimmed by what it takes.
    pub unfiltered: Option<Arc<Accumulation>>,
    /// What a legend tells, where that is not how its values became colours.
    pub told: Option<Coloration>,
    /// Of images and volumes: the points that it was drawn from.
    pub points: Option<PointsReport>,
    /// Of heights: what was drawn, and the raw channels.
    pub surface: Option<SurfaceShown>,
}

/// What pictures of heights are drawn from, by name.
pub(super) const CHUNKS: &str = "chunks";

/// The moment of a run that a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ShownMoment {
    /// Its time, in the unit of the steps' times.
    pub time: f64,
    /// The stored step at or before it.
    pub step: usize,
    /// The interval that it lies in, by the step that begins it; `None` at a stored step.
    pub interval: Option<usize>,
    /// Place within the interval, from 0 to below 1.
    pub u: f64,
    /// What is shown between steps.
    pub interpolation: Interpolation,
    /// Particles that move along tracks, or where there are paths, how many tracks these are of; 0 where a stored step is shown
    /// without paths.
    pub tracks_drawn: u64,
    /// Curves that the paths consist of: one for each track of an interval, or for a long track over several.
    pub curves_drawn: u64,
    /// Mass of what fades from place to place, since its steps are too far apart.
    pub faded_mass: f64,
}

impl ShownMoment {
    /// A moment of a run whose stored steps are shown.
    pub fn of(run: &RunFile, moment: Moment) -> ShownMoment {
        let Moment { step, u } = moment;
        let interval = (u > 0.0).then_some(step);
        let time = run.time(moment);
        let interpolation = Interpolation::Hold;
        ShownMoment { time, step, interval, u, interpolation, tracks_drawn: 0, curves_drawn: 0, faded_mass: 0.0 }
    }

    /// With so many paths.
    pub fn with_paths(self, counts: PathCounts) -> ShownMoment {
        ShownMoment { tracks_drawn: counts.tracks, curves_drawn: counts.curves, ..self }
    }
}

/// How a picture's values became colours: everything that is found from the picture unless it is set.
#[derive(Clone, Debug)]
pub struct Coloration {
    /// The transfer function in use.
    pub transfer: TransferFunction,
    /// Its ranges.
    pub levels: Levels,
}

impl Picture {
    /// The attribute that colours it.
    pub fn attribute(&self) -> Option<&str> {
        self.annotation.depiction.attribute.as_ref().map(|coloring| coloring.name.as_str())
    }

    /// Whether it shows heights and nothing else.
    pub fn is_of_heights_alone(&self) -> bool {
        self.surface.is_some() && self.drawn_from == CHUNKS
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        match &self.values {
            Raw::Sums(sums, _) => [sums.width, sums.height],
            Raw::Light(painted) => [painted.colors.width, painted.colors.height],
        }
    }

    /// How long the arrows of a slice are, where it has some.
    pub fn arrows(&self) -> Option<ArrowKey> {
        match &self.values {
            Raw::Light(painted) => painted.report.arrows.as_deref().copied(),
            Raw::Sums(..) => None,
        }
    }

    /// How its values become colours.
    pub fn coloration(&self) -> Coloration {
        let levels = match &self.values {
            Raw::Sums(sums, _) => self.transfer.levels(self.unfiltered.as_deref().unwrap_or(sums)),
            Raw::Light(painted) => Levels { p: painted.levels.density, s: painted.levels.attribute },
        };
        Coloration { transfer: self.transfer.clone(), levels }
    }

    /// What its colours mean; `None` where no axis tells it.
    pub fn legend(&self) -> Option<Legend> {
        self.annotation.legend(self.told.as_ref().unwrap_or(&self.coloration()))
    }

    /// In colours, with selections and annotations; without what the shot's film does to it
    /// ([`super::Session::finished`]).
    ///
    /// # Errors
    /// Projections and eyes that make no sense.
    pub fn image(&self, shot: &Shot) -> Result<Image, PictureError> {
        let coloration = self.coloration();
        let background = shot.look.background.unwrap_or_default();
        let bloom = shot.look.bloom.unwrap_or_default();
        let mut image = match bloom.is_off() {
            true => self.colored(&coloration.levels, background),
            false => {
                let mut light = self.light(&coloration.levels, background);
                glow::spread(&bloom, &mut light, shot)?;
                light.image_on(background)
            }
        };
        if let Some(paths) = &self.paths {
            lay_over(paths, &mut image);
        }
        self.annotation.mark(&mut image);
        if let Some(annotations) = &shot.look.annotations {
            for sheet in self.sheets(shot, &image)? {
                sheet.lay(&mut image, |image| {
                    let told = self.told.as_ref().unwrap_or(&coloration);
                    self.annotation.write(image, &sheet.view, annotations, told, self.arrows());
                    Ok::<(), PictureError>(())
                })?;
            }
        }
        Ok(image)
    }

    /// Its values in colours before a background.
    fn colored(&self, levels: &Levels, background: Background) -> Image {
        match &self.values {
            Raw::Sums(sums, _) => match &self.ground {
                None => composite::composite_on(sums, &self.transfer, levels, background),
                Some(ground) => {
                    let behind = ground.image_on(background);
                    let whole = self.unfiltered.as_deref();
                    let through = whole.map(|whole| through(sums, whole));
                    let sums = whole.unwrap_or(sums);
                    composite::composite_over(sums, &self.transfer, levels, &behind, through.as_deref())
                }
            },
            Raw::Light(painted) => painted.colors.image_on(background),
        }
    }

    /// Its values as light, which may be brighter than a screen; of sums over surfaces that of the screen.
    fn light(&self, levels: &Levels, background: Background) -> Colors {
        match (&self.values, &self.ground) {
            (Raw::Light(painted), _) => painted.colors.clone(),
            (Raw::Sums(sums, _), None) => composite::light(sums, &self.transfer, levels, background),
            (Raw::Sums(..), Some(_)) => Colors::of_image(&self.colored(levels, background)),
        }
    }

    /// What is written on in the finished picture.
    fn sheets(&self, shot: &Shot, image: &Image) -> Result<Vec<Sheet>, PictureError> {
        Ok(lettering::sheets(&self.annotation.view, [image.width, image.height], shot.surround, shot.stereo)?)
    }

    /// In colours, with what the shot's film does to it; `draw` draws the picture that it is blended with, where there is one.
    ///
    /// # Errors
    /// As `draw`, and where a picture over it cannot be read.
    pub(super) fn finished_by(
        &self,
        shot: &Shot,
        draw: impl FnOnce(&Shot) -> Result<Picture, PictureError>,
    ) -> Result<Image, PictureError> {
        let Some(film) = &shot.film else { return self.image(shot) };
        let before = film.from.as_deref().map(|from| {
            let mut before = Shot::of_scene(from.clone(), Path::new(""));
            (before.size, before.film, before.look.background) = (shot.size, None, shot.look.background);
            draw(&before)?.image(&before)
        });
        self.filmed(shot, film, before.transpose()?)
    }

    /// Its image after what a film does to it: blended with the image `before`, then laid over.
    pub(super) fn filmed(&self, shot: &Shot, film: &Film, before: Option<Image>) -> Result<Image, PictureError> {
        let mut image = self.image(shot)?;
        if let Some(mut mixed) = before {
            mix_into(&mut mixed, &image, film.share);
            image = mixed;
        }
        for sheet in self.sheets(shot, &image)? {
            // Paths of pictures are complete by now.
            sheet.lay(&mut image, |image| film.overlay.paint(image, Path::new("")))?;
        }
        Ok(image)
    }

    /// Writes the raw channels as EXR.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_exr(&self, path: &Path) -> Result<(), output::OutputError> {
        match &self.values {
            Raw::Sums(sums, _) => output::write_exr(path, sums),
            Raw::Light(painted) => match self.surface.as_ref().and_then(|surface| surface.channels.as_ref()) {
                Some(channels) => output::write_exr_with(path, &painted.colors, CHANNELS, &channels.values),
                None => output::write_exr_colors(path, &painted.colors),
            },
        }
    }

    /// Writes the raw channels as a NumPy array.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_npy(&self, path: &Path) -> Result<(), output::OutputError> {
        if let Some(channels) = self.surface.as_ref().and_then(|surface| surface.channels.as_ref()) {
            let shape = [channels.height, channels.width, 7].map(u64::from);
            return output::write_npy_doubles(path, &shape, channels.values.as_flattened());
        }
        match &self.values {
            Raw::Sums(sums, _) => output::write_npy(path, sums),
            Raw::Light(LightPicture { colors, report, .. }) => match &report.values {
                Some(values) => output::write_npy_values(path, [colors.width, colors.height], values),
                None => output::write_npy_colors(path, colors),
            },
        }
    }
}
