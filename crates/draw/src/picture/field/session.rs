//! An open image or a volume, of which pictures are drawn.

use super::in_time::{self, InTime};
use super::opened::{OpenField, Shown, Wanted, colors_of};
use super::painting::{Painter, Painting};
use super::perception;
use super::report::PointsReport;
use crate::annotate::Units;
use crate::color::Image;
use crate::color::composite::composite_glowing;
use crate::color::transfer::{Levels, TransferFunction};
use crate::cpu::field::{Field, FieldPoints};
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::Lighting;
use crate::cpu::volume::{Variability, VolumeError, VolumeLevels};
use crate::hierarchy::wavelet::Weighting;
use crate::look::{Camera, LookPatch, Shot};
use crate::mode::{Depiction, FieldJob, FieldPasses, FieldValues, Mode, Output, Raw, Settings, ValueStatistics};
use crate::model::{Bounds, Grid};
use crate::modes;
use crate::modes::grid::Layers;
use crate::modes::samples::{ERROR_VALUE, FieldLook, TRANSFER_SENSITIVITY, WEIGHTING};
use crate::modes::shadowing;
use crate::picture::adapter::Adapter;
use crate::picture::annotation::Annotation;
use crate::picture::left_out::LeftOut;
use crate::picture::level_report::LevelReport;
use crate::picture::projected::Projector;
use crate::picture::ranges::{Format, Measured};
use crate::picture::session::Reporter;
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, SessionOptions};
use crate::view::perspective_grid::GridError;
use crate::view::{Projection, View};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Memory that the samples of an image or a volume take at most unless it is set, bytes.
pub const MEMORY: u64 = 4 << 30;

/// Draws pictures of an image or a volume.
pub struct FieldSession {
    opened: Arc<OpenField>,
    options: SessionOptions,
    reporter: Arc<dyn Reporter>,
    /// What was drawn last.
    prepared: Option<PreparedField>,
    painter: Painter,
}

impl FieldSession {
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
        let memory = options.exact.is_none().then_some(options.memory.unwrap_or(MEMORY));
        let opened = Arc::new(OpenField::open(path, options.read, memory)?);
        for note in opened.notes() {
            reporter.tell(format!("{}: {note}", path.display()));
        }
        progress.advance(1);
        drop(progress);
        Ok(FieldSession { options, ..FieldSession::of(opened, reporter) })
    }

    /// For what is open.
    pub fn of(opened: Arc<OpenField>, reporter: Arc<dyn Reporter>) -> FieldSession {
        FieldSession {
            opened,
            options: SessionOptions::default(),
            reporter,
            prepared: None,
            painter: Painter::default(),
        }
    }

    /// The same with an adapter, which draws what it is asked for or is faster at.
    #[must_use]
    pub fn with_adapter(mut self, adapter: Option<Box<dyn Adapter>>) -> FieldSession {
        self.painter.adapter = adapter;
        self
    }

    /// What is open.
    pub fn opened(&self) -> &Arc<OpenField> {
        &self.opened
    }

    /// Chooses what a shot is drawn from, whatever its view; what was chosen last is chosen again where nothing else is wanted.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, or a setting does not fit it.
    pub fn prepare(&mut self, shot: &Shot) -> Result<PreparedField, PictureError> {
        let dimensions = self.opened.grid().dimensions;
        let mode = shot.look.mode.unwrap_or_else(|| modes::of_fields(dimensions));
        self.check(shot, mode)?;
        let hue = shot.look.attribute_name().map(|name| self.opened.attribute(name)).transpose();
        let hue = hue.map_err(|why| PictureError::of(self.opened.path(), why))?;
        let colors = colors_of(self.opened.grid());
        let output = mode.technique.output();
        // What is shown comes first, then what colours it, then the components of vectors over it.
        let mut channels: Vec<usize> = match (output, &colors[..]) {
            (Output::Light, [_, ..]) if hue.is_none() => colors,
            _ => [0].into_iter().chain(hue).collect(),
        };
        let vector = self.opened.vector(&shot.look.settings, mode);
        channels.extend(vector.map_err(|why| PictureError::of(self.opened.path(), why))?);
        let before = self.prepared.take();
        let known = before.as_ref().filter(|before| before.choice.channels == channels);
        let hue_values = match known {
            Some(known) => known.hue_values.clone(),
            None => hue.map(|attribute| Arc::new(self.opened.statistics_of(attribute))),
        };
        let diameter = self.opened.grid().bounds().size().length();
        let is_volume = self.opened.is_looked_through(mode);
        let values = FieldValues { shown: self.opened.statistics(), hue: hue_values.as_deref(), is_volume };
        let LookPatch { settings, transfer: own, .. } = &shot.look;
        let usual = || FieldLook::usual_of(mode, settings, &values);
        let transfer = own.clone().unwrap_or_else(usual);
        let look = FieldLook::new(&values, settings, Some(&transfer), diameter, &Layers::VOLUME)?;
        let wanted = self.wanted(shot, mode, &look)?;
        // What draws no samples draws points.
        let as_points = !mode.takes_fields_of(dimensions);
        let choice = Choice { wanted, channels, is_sum: output != Output::Light, as_points };
        let Shown { field, points, report, times } = match before.filter(|before| before.choice == choice) {
            Some(PreparedField { field, points, report, .. }) => {
                Shown { field, points, report, times: Default::default() }
            }
            None => {
                let Choice { wanted, channels, is_sum, .. } = &choice;
                match as_points {
                    true => self.opened.shown_as_points(wanted.as_ref(), channels)?,
                    false => self.opened.shown(wanted.as_ref(), channels, *is_sum)?,
                }
            }
        };
        let levels = look.levels;
        let transfer = match (output, own) {
            (Output::Light, _) => look.transfer,
            (_, Some(own)) => own.clone(),
            (_, None) => TransferFunction::preset(mode.transfer[0]).unwrap_or_default(),
        };
        let prepared = PreparedField {
            mode,
            settings: settings.clone(),
            own: own.clone(),
            transfer,
            levels,
            field,
            points,
            report,
            choice,
            opened: Arc::clone(&self.opened),
            hue,
            hue_values,
            diameter,
            camera: None,
            times,
        };
        self.prepared = Some(prepared.clone());
        Ok(prepared)
    }

    /// Draws a shot; where its time is limited, with as many pixels as that leaves time for.
    ///
    /// # Errors
    /// As [`FieldSession::prepare`], and where nothing is in view.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        let mut prepared = self.prepare(shot)?;
        let opened = Arc::clone(&self.opened);
        let (grid, bounds) = (opened.grid(), opened.grid().bounds());
        // Two eyes before a screen have a perspective, straight in front of an image or not.
        let is_pair = shot.surround.is_flat() && shot.stereo.is_some();
        let view = if is_pair { shot.view(bounds, None)? } else { view_of(shot, grid, prepared.mode)? };
        let projector = shot.is_projected().then(|| Projector::new(view, shot.surround, shot.stereo)).transpose()?;
        let view = projector.as_ref().map_or(view, |projector| projector.base);
        prepared.camera = projector.as_ref().map(|projector| projector.base);
        let mut times = Times::default();
        for (pass, time) in ["load", "select", "reconstruct"].into_iter().zip(prepared.times) {
            times.note(pass, time);
        }
        let choice = shot.look.budget.level_choice();
        let repeat = self.options.repeat.max(1);
        let reporter = Arc::clone(&self.reporter);
        let mut painting = Painting::new(&mut self.painter, &prepared, self.options.backend, &*reporter)
            .map_err(PictureError::Asked)?;
        let mut drawn = None;
        if projector.is_none() && choice.frame_ms.is_none() {
            drawn = painting.draw_on_adapter(&view, repeat)?;
            times.extend(std::mem::take(&mut painting.milliseconds));
        }
        let rounds = if drawn.is_none() { repeat } else { 0 };
        for _ in 0..rounds {
            let draw = || match (&projector, choice.frame_ms) {
                (Some(projector), _) => projector.draw_each(prepared.mode.is_light(), prepared.margin_px(), |view| {
                    if reporter.is_stopped() {
                        return Err(PictureError::Stopped);
                    }
                    match painting.draw(view) {
                        Err(VolumeError::Grid(GridError::NothingInView)) => Ok(None),
                        drawn => Ok(Some(drawn?)),
                    }
                }),
                (None, Some(budget)) => {
                    Ok(in_time::within(&view, budget, &mut InTime::default(), |view| painting.draw(view))?)
                }
                (None, None) => Ok(painting.draw(&view)?),
            };
            drawn = Some(times.frame(|times| times.measure("draw", draw))?);
        }
        let Some(values) = drawn else { return Err(PictureError::Stopped) };
        let drawn_by = painting.drawn_by;
        let picture = self.pictured(shot, (view, bounds), &prepared, values, times.medians())?;
        Ok(Picture { drawn_by, ..picture })
    }

    /// What a legend tells of a look: the mode with what colours it, and units.
    pub(in crate::picture) fn told(
        &self,
        prepared: &PreparedField,
        look: &LookPatch,
    ) -> Result<(Depiction, Units), PictureError> {
        let (attribute, choice) = (look.attribute_name(), look.budget.level_choice());
        let depiction = self.opened.depiction(prepared.mode, look.settings.clone(), attribute, choice);
        let depiction = depiction.map_err(|why| PictureError::of(self.opened.path(), why))?;
        let units = self.opened.units(&depiction);
        Ok((depiction, units))
    }

    /// The picture of a shot from a view, with what is in a box, of values that the processor has drawn.
    pub(in crate::picture) fn pictured(
        &self,
        shot: &Shot,
        (view, bounds): (View, Bounds),
        prepared: &PreparedField,
        values: Raw,
        milliseconds: BTreeMap<String, f64>,
    ) -> Result<Picture, PictureError> {
        let (depiction, units) = self.told(prepared, &shot.look)?;
        let annotation = Annotation::new(shot, view, bounds, None, units, None, &depiction, &*self.reporter)?;
        let PreparedField { transfer, report, .. } = prepared;
        let (levels, choice) = (prepared.drawn_from(), shot.look.budget.level_choice());
        let level_report =
            LevelReport { levels, splats: report.points, budget: choice.splats, ..LevelReport::default() };
        Ok(Picture {
            values,
            annotation,
            transfer: transfer.clone(),
            converged: choice.frame_ms.is_none(),
            is_coarser: false,
            error_px: 0.0,
            particles: 0,
            nodes: report.nodes as usize,
            drawn_from: levels,
            left_out: LeftOut::default(),
            level_report,
            drawn_by: ["cpu", "cpu"].map(str::to_owned),
            milliseconds,
            moment: None,
            paths: None,
            ground: None,
            unfiltered: None,
            told: None,
            points: Some(*report),
            surface: None,
        })
    }

    /// A drawn picture in colours, with what the shot's film does to it.
    ///
    /// # Errors
    /// As [`FieldSession::draw`] for the picture that it is blended with, and where a picture over it cannot be read.
    pub fn finished(&mut self, shot: &Shot, picture: &Picture) -> Result<Image, PictureError> {
        let Some(film) = &shot.film else { return picture.image(shot) };
        let before = film.from.as_deref().map(|from| {
            let mut before = Shot::of_scene(from.clone(), Path::new(""));
            (before.size, before.film, before.look.background) = (shot.size, None, shot.look.background);
            self.draw(&before)?.image(&before)
        });
        picture.filmed(shot, film, before.transpose()?)
    }

    /// A look's picture of a view, black where nothing is in view; its colours have the ranges `levels`, or their own.
    ///
    /// # Errors
    /// As [`FieldSession::prepare`].
    pub fn image(&mut self, look: &LookPatch, view: &View, levels: Option<Levels>) -> Result<Image, PictureError> {
        let mut shot = Shot { look: look.clone(), ..Shot::default() };
        let mut prepared = self.prepare(&shot)?;
        if let Some(levels) = levels.filter(|_| prepared.mode.is_light()) {
            shot.look.transfer = Some(prepared.transfer.with_levels(&levels));
            prepared = self.prepare(&shot)?;
        }
        let transfer = &prepared.transfer;
        let bloom = look.bloom.unwrap_or_default();
        let reporter = Arc::clone(&self.reporter);
        let mut painting = Painting::new(&mut self.painter, &prepared, self.options.backend, &*reporter)
            .map_err(PictureError::Asked)?;
        Ok(match painting.draw(view) {
            Ok(Raw::Light(light)) => bloom.image(&light.colors),
            Ok(Raw::Sums(sums, _)) => {
                let levels = levels.unwrap_or_else(|| transfer.levels(&sums));
                composite_glowing(&sums, transfer, &levels, &bloom)
            }
            Err(VolumeError::Grid(GridError::NothingInView)) => Image::black(view.width, view.height),
            Err(error) => return Err(error.into()),
        })
    }

    /// What is known of a look's picture from a camera: its ranges.
    ///
    /// # Errors
    /// As [`FieldSession::draw`].
    pub fn ranges(&mut self, look: &LookPatch, camera: &Camera, format: Format) -> Result<Measured, PictureError> {
        let prepared = self.prepare(&Shot { look: look.clone(), ..Shot::default() })?;
        let PreparedField { mode, transfer, levels, .. } = &prepared;
        let levels = match mode.is_light() {
            true => Levels { p: levels.density, s: levels.attribute },
            false => {
                let (width, height) = format.measured_size(mode.technique.needs(&look.settings).footprint);
                let middle = if format.surround.is_flat() { camera.target } else { camera.eye };
                let view = camera.view(width, height)?;
                let view = look.cut.unwrap_or_default().applied(&view, middle.into(), None);
                let drawn = match format.surround.is_flat() {
                    true => prepared.draw(&view)?,
                    false => {
                        Projector::new(view, format.surround, None)?
                            .draw_each(false, prepared.margin_px(), |view| Ok(Some(prepared.draw(view)?)))?
                    }
                };
                let Raw::Sums(sums, _) = drawn else { return Err(VolumeError::OnlyFields.into()) };
                transfer.levels(&sums)
            }
        };
        let attribute = look.attribute_name().map(str::to_owned);
        Ok(Measured { mode, attribute, transfer: transfer.clone(), levels })
    }

    /// Refuses what images and volumes are not drawn with.
    fn check(&self, shot: &Shot, mode: &'static Mode) -> Result<(), PictureError> {
        let refuse = |why: String| Err(PictureError::of(self.opened.path(), why));
        if !self.opened.is_drawn_by(mode) {
            let names: Vec<&str> = self.opened.modes().iter().map(|mode| mode.name).collect();
            let kind = if self.opened.grid().dimensions == 2 { "an image" } else { "a volume" };
            return refuse(format!("mode {} does not draw {kind}, expected one of {}", mode.name, names.join(", ")));
        }
        shot.look.settings.check(mode).map_err(|error| {
            let named = &self.options.named;
            PictureError::of(if named.as_os_str().is_empty() { self.opened.path() } else { named }, error)
        })?;
        if self.options.overdraw.is_some() {
            return refuse("--overdraw: images and volumes have no splats".into());
        }
        if shot.look.time.is_some() {
            return refuse("--time: an image or a volume has no times".into());
        }
        Ok(())
    }

    /// What a number of points is to keep small.
    fn weighting(&self, shot: &Shot, mode: &Mode) -> Result<Weighting, PictureError> {
        Ok(match &*shot.look.settings.name(&WEIGHTING) {
            "max" => Weighting::Max,
            "perceptual" => {
                let grid = self.opened.grid();
                let view = view_of(shot, grid, mode)?;
                let columns = (0..grid.dimensions).map(|axis| grid.to_world.matrix3.col(axis).length());
                let spacing = columns.fold(f64::INFINITY, f64::min);
                let levels = grid.shape.iter().max().map_or(0, |side| u64::BITS - side.leading_zeros()) as usize;
                let samples = perception::samples_a_degree(&view, grid.bounds(), spacing);
                Weighting::Levels(perception::weights(levels, samples))
            }
            _ => Weighting::Rms,
        })
    }

    /// The points that a shot asks for; `None` for the samples.
    fn wanted(&self, shot: &Shot, mode: &Mode, look: &FieldLook) -> Result<Option<Wanted>, PictureError> {
        let settings = &shot.look.settings;
        let error = Some(settings.number(&ERROR_VALUE)).filter(|error| *error > 0.0);
        let usual = if error.is_none() && self.opened.has_points() { mode.technique.usual_points() } else { None };
        let points = shot.look.budget.level_choice().splats.or(usual);
        Ok(match points {
            _ if self.options.exact.is_some() => None,
            Some(points) => {
                let weighting = self.weighting(shot, mode)?;
                Some(Wanted::Points(usize::try_from(points).unwrap_or(usize::MAX), weighting))
            }
            // Of a source that was not built there is nothing but the samples.
            None if !self.opened.has_points() => None,
            None => {
                let sensitivity = settings.number(&TRANSFER_SENSITIVITY) as f32;
                let is_classified = mode.technique.output() == Output::Light && self.opened.grid().dimensions == 3;
                let seen = (sensitivity > 0.0 && is_classified)
                    .then(|| (Variability::new(&look.classifier, look.axis), sensitivity));
                Some(Wanted::Near { error, seen })
            }
        })
    }
}

/// What is shown of the data, whatever its colours.
#[derive(Clone, Debug, PartialEq)]
struct Choice {
    /// Its points; `None` for the samples.
    wanted: Option<Wanted>,
    /// The attributes, what is shown first.
    channels: Vec<usize>,
    /// Whether their sums are drawn.
    is_sum: bool,
    /// Whether points are drawn, not what they show.
    as_points: bool,
}

/// A field and what is drawn of it, ready for any view.
#[derive(Clone)]
pub struct PreparedField {
    mode: &'static Mode,
    settings: Settings,
    /// The transfer function that was asked for.
    own: Option<TransferFunction>,
    /// The one in use.
    pub transfer: TransferFunction,
    /// The ranges of colours of light.
    pub levels: VolumeLevels,
    /// What is drawn.
    pub field: Arc<Field>,
    /// The points themselves, where these are drawn.
    pub points: Option<Arc<FieldPoints>>,
    /// The points that it is made of.
    pub report: PointsReport,
    choice: Choice,
    opened: Arc<OpenField>,
    /// The attribute that colours it.
    hue: Option<usize>,
    hue_values: Option<Arc<ValueStatistics>>,
    diameter: f64,
    /// The camera of a picture that is put together of several views: lamps beside the eye go with it.
    camera: Option<View>,
    /// How long reading the points, choosing some, and drawing these to a grid took.
    times: [Duration; 3],
}

impl PreparedField {
    /// What it is drawn from, by name.
    pub fn drawn_from(&self) -> &'static str {
        if self.choice.wanted.is_none() { "samples" } else { "wavelet" }
    }

    /// Whether an attribute colours it.
    pub fn has_hue(&self) -> bool {
        self.hue.is_some()
    }

    /// The mode.
    pub(super) fn mode(&self) -> &'static Mode {
        self.mode
    }

    /// The mode's settings.
    pub(super) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// How far its pictures look beyond themselves, pixels.
    fn margin_px(&self) -> u32 {
        self.mode.technique.needs(&self.settings).margin_px
    }

    /// The channel of what is drawn that colours it.
    pub fn hue_channel(&self) -> Option<usize> {
        self.hue.map(|_| 1)
    }

    /// Draws a view on the processor.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the field, and where nothing is in view.
    pub fn draw(&self, view: &View) -> Result<Raw, VolumeError> {
        self.mode.draw_field(&self.job(view))
    }

    /// What a view shows of it in parts from front to back, which something else is drawn among.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the field.
    pub fn parts(&self, view: &View, lighting: &Lighting<'_>) -> Result<PathFragments, VolumeError> {
        self.mode.field_parts(&FieldJob { lighting: *lighting, ..self.job(view) })
    }

    /// Whether its surfaces are darkened, where it has some.
    pub(in crate::picture) fn is_darkened(&self) -> bool {
        shadowing::is_on(&self.settings)
    }

    /// The depths from anywhere of its surfaces in the picture of a view, row by row; `None` where it has none.
    pub(in crate::picture) fn opaque(&self, from: &View, view: &View) -> Option<Vec<f32>> {
        let job = self.job(view);
        let casters = self.mode.technique.field_casters(&job).ok()??;
        casters(from)
    }

    /// What an adapter's passes draw of a view; `None` where the processor draws it.
    ///
    /// # Errors
    /// As [`PreparedField::draw`].
    pub fn passes(&self, view: &View) -> Result<Option<FieldPasses>, VolumeError> {
        self.mode.field_passes(&self.job(view))
    }

    fn job<'a>(&'a self, view: &'a View) -> FieldJob<'a> {
        let hue = self.hue_values.as_deref();
        FieldJob {
            view,
            field: &self.field,
            points: self.points.as_deref(),
            hue: self.hue_channel(),
            values: FieldValues { shown: self.opened.statistics(), hue, is_volume: self.field.dimensions == 3 },
            settings: &self.settings,
            transfer: self.own.as_ref(),
            diameter: self.diameter,
            paths: None,
            lighting: Lighting { camera: self.camera.as_ref(), others: None },
        }
    }

    /// Draws a view on the processor with as many pixels as there is time for: [`in_time::within`].
    ///
    /// # Errors
    /// As [`PreparedField::draw`].
    pub fn draw_within(&self, view: &View, budget: f64, in_time: &mut InTime) -> Result<Raw, VolumeError> {
        in_time::within(view, budget, in_time, |view| self.draw(view))
    }
}

/// The camera of a shot: of an image, or of a plane through a volume, straight in front of it unless it is told otherwise.
fn view_of(shot: &Shot, grid: &Grid, mode: &Mode) -> Result<View, PictureError> {
    let (camera, bounds) = (shot.camera, grid.bounds());
    let toward = match grid.dimensions {
        2 => Some(DVec3::Z),
        _ => mode.technique.facing(&shot.look.settings, &grid.to_world),
    };
    if grid.dimensions == 2 && camera.eye.is_none() && !shot.surround.is_flat() {
        return Ok(before_image(shot, bounds).view(bounds, None)?);
    }
    let is_free = camera.eye.is_none() && camera.fov.is_none() && shot.surround.is_flat();
    let Some(toward) = toward.filter(|_| is_free) else { return Ok(shot.view(bounds, None)?) };
    let (width, height) = match shot.size {
        None if grid.dimensions == 2 => image_size(bounds),
        _ => shot.size(),
    };
    let target = camera.target.map_or(bounds.center(), DVec3::from);
    let size = bounds.size();
    // What is seen from its edge is no way up.
    let usual = if toward.y.abs() > 0.9 { DVec3::Z } else { DVec3::Y };
    let up = camera.up.map_or(usual, DVec3::from);
    let right = up.cross(toward).normalize_or_zero();
    let extent = |axis: DVec3| axis.abs().dot(size);
    let fits = extent(toward.cross(right)).max(extent(right) * f64::from(height) / f64::from(width));
    let projection = Projection::Orthographic { height: camera.ortho.unwrap_or(fits) };
    let view = View::look_at(target + toward * size.length().max(1e-30), target, up, projection, width, height)?;
    let cut = shot.look.cut.unwrap_or_default();
    Ok(cut.applied(&view, target, None))
}

/// A shot around an eye before an image, in whose middle there is nothing to see: the image is where words stand, above the front of a dome.
fn before_image(shot: &Shot, bounds: Bounds) -> Shot {
    let size = bounds.size().length().max(1e-30);
    let eye = bounds.center() + DVec3::Z * size;
    let (sin, cos) = shot.surround.screen().0.sin_cos();
    let mut shot = shot.clone();
    shot.camera.eye = Some(eye.to_array());
    if shot.camera.target.is_none() {
        shot.camera.target = Some((eye - size * DVec3::new(0.0, sin, cos)).to_array());
        shot.camera.up = shot.camera.up.or(Some([0.0, cos, -sin]));
    }
    shot
}

/// As many pixels as an image of pixels of size 1 has, within what a screen shows; else as other pictures, in its proportions.
fn image_size(bounds: Bounds) -> (u32, u32) {
    let [x, y] = [bounds.size().x, bounds.size().y].map(|side| side.max(1e-30));
    let longest = x.max(y);
    let pixels = if (64.0..=1600.0).contains(&longest) { longest } else { 1200.0 };
    let side = |side: f64| (side / longest * pixels).round().clamp(1.0, 1600.0) as u32;
    (side(x), side(y))
}
