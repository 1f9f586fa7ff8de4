//! An open image or volume, of which pictures are drawn.

use super::in_time::{self, InTime};
use super::opened::{OpenField, Shown, Wanted, colors_of};
use super::report::PointsReport;
use crate::annotate::Units;
use crate::color::transfer::TransferFunction;
use crate::cpu::field::Field;
use crate::cpu::volume::{Variability, VolumeError};
use crate::import::grid_format;
use crate::look::{Backend, DataKind, LookPatch, Shot};
use crate::mode::{
    Coloring, Depiction, FieldJob, FieldValues, LightPicture, Mode, Output, Raw, Settings, ValueStatistics,
};
use crate::model::{Bounds, Unit};
use crate::modes;
use crate::modes::grid::Layers;
use crate::modes::samples::{ERROR_VALUE, FieldLook, TRANSFER_SENSITIVITY};
use crate::picture::annotation::Annotation;
use crate::picture::left_out::LeftOut;
use crate::picture::level_report::LevelReport;
use crate::picture::session::Reporter;
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, SessionOptions};
use crate::view::{Projection, View};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Draws pictures of an image or a volume, on the processor.
pub struct FieldSession {
    opened: OpenField,
    options: SessionOptions,
    reporter: Arc<dyn Reporter>,
}

impl FieldSession {
    /// Whether a file is of an image or a volume, built or not.
    pub fn is_field(path: &Path) -> bool {
        match DataKind::of(path) {
            Ok(DataKind::Grid) => true,
            Ok(DataKind::Source) => matches!(grid_format(path), Ok(Some(_))),
            _ => false,
        }
    }

    /// Opens an image or a volume.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(
        path: &Path,
        options: SessionOptions,
        reporter: Arc<dyn Reporter>,
    ) -> Result<FieldSession, PictureError> {
        let progress = reporter.progress();
        progress.begin("reading", 1);
        let opened = OpenField::open(path, options.read)?;
        progress.advance(1);
        drop(progress);
        Ok(FieldSession { opened, options, reporter })
    }

    /// What is open.
    pub fn opened(&self) -> &OpenField {
        &self.opened
    }

    /// Chooses what a shot is drawn from, whatever its view.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, or a setting does not fit it.
    pub fn prepare(&mut self, shot: &Shot) -> Result<PreparedField, PictureError> {
        let dimensions = self.opened.grid().dimensions;
        let mode = shot.look.mode.unwrap_or_else(|| modes::of_fields(dimensions));
        self.check(shot, mode)?;
        let hue = self.hue(shot)?;
        let colors = colors_of(self.opened.grid());
        // What is shown comes first, what colours it last.
        let channels: Vec<usize> = match (mode.technique.output(), &colors[..]) {
            (Output::Light, [_, ..]) if hue.is_none() => colors,
            _ => [0].into_iter().chain(hue).collect(),
        };
        let shown = self.opened.statistics().clone();
        let hue_values = hue.map(|channel| self.opened.statistics_of(channel));
        let diameter = self.opened.grid().bounds().size().length();
        let values = FieldValues { shown: &shown, hue: hue_values.as_ref(), is_volume: dimensions == 3 };
        let LookPatch { settings, transfer, .. } = &shot.look;
        let look = FieldLook::new(&values, settings, transfer.as_ref(), diameter, &Layers::VOLUME)?;
        let wanted = self.wanted(shot, mode, &look);
        let levels = if wanted.is_none() { "samples" } else { "wavelet" };
        let Shown { field, report, times } =
            self.opened.shown(wanted.as_ref(), &channels, mode.technique.output() != Output::Light)?;
        let transfer = match mode.technique.output() {
            Output::Light => look.transfer,
            _ => transfer.clone().or_else(|| TransferFunction::preset(mode.transfer[0])).unwrap_or_default(),
        };
        let (own, settings) = (shot.look.transfer.clone(), settings.clone());
        Ok(PreparedField {
            mode,
            settings,
            own,
            transfer,
            field,
            report,
            levels,
            shown,
            hue,
            hue_values,
            diameter,
            times,
        })
    }

    /// Draws a shot; where its time is limited, with as many pixels as that leaves time for.
    ///
    /// # Errors
    /// As [`FieldSession::prepare`], and where nothing is in view.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        let (bounds, dimensions) = (self.opened.grid().bounds(), self.opened.grid().dimensions);
        let prepared = self.prepare(shot)?;
        let view = view_of(shot, bounds, dimensions)?;
        let mut times = Times::default();
        for (pass, time) in ["load", "select", "reconstruct"].into_iter().zip(prepared.times) {
            times.note(pass, time);
        }
        let choice = shot.look.budget.level_choice();
        let mut drawn = None;
        for _ in 0..self.options.repeat.max(1) {
            drawn = Some(times.frame(|times| {
                times.measure("draw", || match choice.frame_ms {
                    Some(budget) => prepared.draw_within(&view, budget, &mut InTime::default()),
                    None => prepared.draw(&view),
                })
            })?);
        }
        let Some(values) = drawn else { return Err(PictureError::Stopped) };
        let PreparedField { mode, transfer, report, levels, hue, hue_values, .. } = prepared;
        let depiction = self.depiction(shot, mode, hue, hue_values.as_ref());
        let units = self.units(mode, hue);
        let annotation = Annotation::new(shot, view, bounds, None, units, None, &depiction, &*self.reporter)?;
        let level_report =
            LevelReport { levels, splats: report.points, budget: choice.splats, ..LevelReport::default() };
        Ok(Picture {
            values,
            annotation,
            transfer,
            converged: choice.frame_ms.is_none(),
            error_px: 0.0,
            particles: 0,
            nodes: report.nodes as usize,
            drawn_from: levels,
            left_out: LeftOut::default(),
            level_report,
            drawn_by: ["cpu", "cpu"].map(str::to_owned),
            milliseconds: times.medians(),
            moment: None,
            paths: None,
            points: Some(report),
        })
    }

    /// Refuses what images and volumes are not drawn with.
    fn check(&self, shot: &Shot, mode: &'static Mode) -> Result<(), PictureError> {
        let refuse = |why: String| Err(PictureError::of(self.opened.path(), why));
        if !mode.takes_fields() {
            let all = modes::all();
            let names: Vec<&str> = all.iter().filter(|mode| mode.takes_fields()).map(|mode| mode.name).collect();
            let kind = if self.opened.grid().dimensions == 2 { "an image" } else { "a volume" };
            return refuse(format!(
                "mode {} draws particles, found {kind}, expected one of {}",
                mode.name,
                names.join(", ")
            ));
        }
        shot.look.settings.check(mode).map_err(|error| {
            let named = &self.options.named;
            PictureError::of(if named.as_os_str().is_empty() { self.opened.path() } else { named }, error)
        })?;
        if shot.is_projected() {
            return refuse(
                "images and volumes are drawn flat and for one eye, not as domes, panoramas or in stereo".into(),
            );
        }
        if self.options.backend.is_some_and(|backend| backend != Backend::Cpu) {
            return refuse("--backend: images and volumes are drawn by the processor, expected cpu".into());
        }
        if self.options.overdraw.is_some() {
            return refuse("--overdraw: images and volumes have no splats".into());
        }
        if shot.look.time.is_some() {
            return refuse("--time: an image or a volume has no times".into());
        }
        Ok(())
    }

    /// The channel that colours the picture, where one is named.
    fn hue(&self, shot: &Shot) -> Result<Option<usize>, PictureError> {
        let Some(name) = shot.look.attribute_name() else { return Ok(None) };
        let channels = &self.opened.grid().channels;
        match channels.iter().position(|channel| channel.name == name) {
            Some(channel) => Ok(Some(channel)),
            None => {
                let names: Vec<&str> = channels.iter().map(|channel| channel.name.as_str()).collect();
                let why = format!("attribute {name} is not in the data, expected one of {}", names.join(", "));
                Err(PictureError::of(self.opened.path(), why))
            }
        }
    }

    /// The points that a shot asks for; `None` for the samples.
    fn wanted(&self, shot: &Shot, mode: &Mode, look: &FieldLook) -> Option<Wanted> {
        let settings = &shot.look.settings;
        let points = shot.look.budget.level_choice().splats;
        let error = Some(settings.number(&ERROR_VALUE)).filter(|error| *error > 0.0);
        match points {
            _ if self.options.exact.is_some() => None,
            Some(points) => Some(Wanted::Points(usize::try_from(points).unwrap_or(usize::MAX))),
            // Of a source that was not built there is nothing but the samples.
            None if !self.opened.has_points() => None,
            None => {
                let sensitivity = settings.number(&TRANSFER_SENSITIVITY) as f32;
                let is_classified = mode.technique.output() == Output::Light && self.opened.grid().dimensions == 3;
                let seen = (sensitivity > 0.0 && is_classified)
                    .then(|| (Variability::new(&look.classifier, look.axis), sensitivity));
                Some(Wanted::Near { error, seen })
            }
        }
    }

    fn depiction(
        &self,
        shot: &Shot,
        mode: &'static Mode,
        hue: Option<usize>,
        values: Option<&ValueStatistics>,
    ) -> Depiction {
        let coloring = |channel: usize| Coloring {
            name: self.opened.grid().channels[channel].name.clone(),
            fallback: 0.0,
            least: values.map_or(0.0, |values| values.range()[0]),
        };
        Depiction {
            mode,
            settings: shot.look.settings.clone(),
            attribute: hue.map(coloring),
            choice: shot.look.budget.level_choice(),
        }
    }

    /// What a legend calls the values.
    fn units(&self, mode: &Mode, hue: Option<usize>) -> Units {
        let grid = self.opened.grid();
        let shown = &grid.channels[0];
        let length = grid.length_unit.clone();
        let value = match mode.technique.output() {
            Output::Light => (shown.name.clone(), shown.unit.clone()),
            _ => {
                let unit = match (shown.unit.is_unknown(), length.is_unknown()) {
                    (false, false) => Unit::new(format!("{} {length}", shown.unit)),
                    _ => Unit::default(),
                };
                (format!("{} of {}", mode.quantity, shown.name), unit)
            }
        };
        let attribute = hue.map(|channel| grid.channels[channel].unit.clone()).unwrap_or_default();
        Units { mass: Unit::default(), length, attribute, value: Some(value) }
    }
}

/// A field and what is drawn of it, ready for any view.
pub struct PreparedField {
    mode: &'static Mode,
    settings: Settings,
    /// The transfer function that was asked for.
    own: Option<TransferFunction>,
    /// The one in use.
    transfer: TransferFunction,
    field: Field,
    /// The points that it is made of.
    pub report: PointsReport,
    levels: &'static str,
    shown: ValueStatistics,
    hue: Option<usize>,
    hue_values: Option<ValueStatistics>,
    diameter: f64,
    /// How long reading the points, choosing some, and drawing these to a grid took.
    times: [Duration; 3],
}

impl PreparedField {
    /// Draws a view.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the field, and where nothing is in view.
    pub fn draw(&self, view: &View) -> Result<Raw, VolumeError> {
        let values =
            FieldValues { shown: &self.shown, hue: self.hue_values.as_ref(), is_volume: self.field.dimensions == 3 };
        self.mode.draw_field(&FieldJob {
            view,
            field: &self.field,
            hue: self.hue.map(|_| 1),
            values,
            settings: &self.settings,
            transfer: self.own.as_ref(),
            diameter: self.diameter,
            paths: None,
        })
    }

    /// Draws a view of light with as many pixels as there is time for, enlarged to its size; what pictures take is learned from those before,
    /// or else from a few that are not shown. Sums are drawn as they are.
    ///
    /// # Errors
    /// As [`PreparedField::draw`].
    pub fn draw_within(&self, view: &View, budget: f64, in_time: &mut InTime) -> Result<Raw, VolumeError> {
        let full = (view.width, view.height);
        let tries = if in_time.is_new() { 3 } else { 0 };
        let mut attempt = |budget: f64| {
            let size = in_time.size(full, budget);
            let start = Instant::now();
            let drawn = self.draw(&view.resized(size.0, size.1))?;
            in_time.drew(size, 1e3 * start.elapsed().as_secs_f64());
            Ok::<Raw, VolumeError>(drawn)
        };
        for number in 0..tries {
            attempt(budget * f64::from(number) / f64::from(tries))?;
        }
        match attempt(budget)? {
            Raw::Light(light) => {
                Ok(Raw::Light(LightPicture { colors: in_time::enlarged(&light.colors, full), ..light }))
            }
            Raw::Sums(..) => self.draw(view),
        }
    }
}

/// The camera of a shot: of an image straight in front of it unless it is told otherwise.
fn view_of(shot: &Shot, bounds: Bounds, dimensions: usize) -> Result<View, PictureError> {
    let camera = shot.camera;
    let is_free = camera.eye.is_none() && camera.fov.is_none();
    if dimensions == 3 || !is_free {
        return Ok(shot.view(bounds, None)?);
    }
    let (width, height) = match shot.size {
        Some(size) => size,
        None => image_size(bounds),
    };
    let target = camera.target.map_or(bounds.center(), DVec3::from);
    let size = bounds.size();
    let fits = size.y.max(size.x * f64::from(height) / f64::from(width));
    let projection = Projection::Orthographic { height: camera.ortho.unwrap_or(fits) };
    let up = camera.up.map_or(DVec3::Y, DVec3::from);
    let view = View::look_at(target + DVec3::Z * size.length().max(1e-30), target, up, projection, width, height)?;
    let cut = shot.look.cut.unwrap_or_default();
    Ok(cut.applied(&view, target, None))
}

/// As many pixels as an image of pixels of size 1 has, within what a screen shows; else as other pictures, in its proportions.
fn image_size(bounds: Bounds) -> (u32, u32) {
    let [x, y] = [bounds.size().x, bounds.size().y].map(|side| side.max(1e-30));
    let longest = x.max(y);
    let pixels = if (64.0..=1600.0).contains(&longest) { longest } else { 1200.0 };
    let side = |side: f64| (side / longest * pixels).round().clamp(1.0, 1600.0) as u32;
    (side(x), side(y))
}
