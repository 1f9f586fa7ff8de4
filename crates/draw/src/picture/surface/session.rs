//! An open height field, of which pictures are drawn.

use super::letters::ProgramFont;
use super::opened::OpenSurface;
use super::painting::{DrawnBy, Field, Painter};
use super::raw::{SurfaceChannels, SurfaceShown};
use crate::annotate::{Annotations, Units};
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Colors, Image};
use crate::cpu::paths::PathFragments;
use crate::cpu::surface::fragments::{Layer, fragments};
use crate::cpu::surface::look::{Attribute, Look};
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::{Map, Placed};
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::{SurfaceOptions, SurfacePicture, SurfaceReport, draw_lettered};
use crate::cpu::volume::VolumeLevels;
use crate::heights::OpenHeights;
use crate::heights::build::HeightBuildOptions;
use crate::heights::import::HeightOptions;
use crate::heights::measure::Form;
use crate::heights::model::HeightGrid;
use crate::heights::store::HeightFile;
use crate::look::{Camera, LookPatch, Shot};
use crate::mode::depiction::Coloring;
use crate::mode::{Depiction, LightPicture, Mode, Raw};
use crate::model::Bounds;
use crate::modes::surface::{self, SurfaceSettings};
use crate::picture::adapter::Adapter;
use crate::picture::annotation::Annotation;
use crate::picture::drawn::CHUNKS;
use crate::picture::left_out::LeftOut;
use crate::picture::level_report::LevelReport;
use crate::picture::projected::Projector;
use crate::picture::ranges::{Format, Measured};
use crate::picture::session::Reporter;
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, SessionOptions};
use crate::view::{Panorama, View};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Memory for decoded chunks unless it is set, bytes.
const CHUNK_MEMORY: u64 = 1 << 30;
/// Largest displacement on screen unless it is set, pixels.
const ERROR_PX: f64 = 0.8;
/// Residuals are coloured up to so many times the root of their mean square.
const OUTLIERS: f64 = 3.0;

/// Draws pictures of a height field.
pub struct SurfaceSession {
    options: SessionOptions,
    reporter: Arc<dyn Reporter>,
    opened: Arc<OpenSurface>,
    nodes: PagedSurface,
    painter: Painter,
}

/// A picture of a view, and what is known of it.
pub struct SeenSurface {
    /// The picture.
    pub picture: SurfacePicture,
    /// What colours it.
    pub attribute: Attribute,
    /// How values become colours.
    pub transfer: TransferFunction,
    /// The values that the first and the last colour stand for.
    pub levels: Levels,
    /// What cannot be read of it.
    pub error: Option<String>,
}

/// What is drawn of a field, whatever the view.
pub(super) struct Prepared {
    pub(super) mode: &'static Mode,
    pub(super) settings: SurfaceSettings,
    pub(super) placed: Placed,
    pub(super) attribute: Attribute,
    pub(super) look: Look,
    /// What residuals are what is left of, where they are shown.
    pub(super) form: Option<Arc<Form>>,
}

impl SurfaceSession {
    /// Opens a field; a source's page file is built for it first, and kept as long as the session is.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(
        path: &Path,
        said: &HeightOptions,
        options: SessionOptions,
        reporter: Arc<dyn Reporter>,
    ) -> Result<SurfaceSession, PictureError> {
        let told = |error: &dyn std::fmt::Display| PictureError::Asked(error.to_string());
        let open = OpenHeights::open(path, said).map_err(|error| told(&error))?;
        let (file, folder) = match open {
            OpenHeights::Pages(file) => (*file, None),
            OpenHeights::Source(source) => {
                let progress = reporter.progress();
                let folder = tempfile::tempdir().map_err(|error| told(&error))?;
                let built = folder.path().join("heights.df");
                let open = OpenHeights::Source(source);
                let about = open.build(&HeightBuildOptions::default(), &built, &*progress);
                drop(progress);
                about.map_err(|error| told(&error))?;
                (HeightFile::open(&built, options.read).map_err(|error| told(&error))?, Some(folder))
            }
        };
        file.about().notes.iter().for_each(|note| reporter.tell(format!("{}: {note}", path.display())));
        let opened = OpenSurface::new(path, file)?;
        let opened = match folder {
            Some(folder) => opened.within(folder),
            None => opened,
        };
        Ok(SurfaceSession::of(Arc::new(opened), options, reporter))
    }

    /// A field that is open.
    pub fn of(opened: Arc<OpenSurface>, options: SessionOptions, reporter: Arc<dyn Reporter>) -> SurfaceSession {
        let memory = options.chunk_memory.unwrap_or(CHUNK_MEMORY);
        let nodes = PagedSurface::new(Arc::clone(opened.file()), memory);
        SurfaceSession { options, reporter, opened, nodes, painter: Painter::default() }
    }

    /// The same with an adapter, which draws what it is asked for or is faster at.
    #[must_use]
    pub fn with_adapter(mut self, adapter: Option<Box<dyn Adapter>>) -> SurfaceSession {
        self.painter.adapter = adapter;
        self
    }

    /// The field, and what it is called.
    pub fn opened(&self) -> &Arc<OpenSurface> {
        &self.opened
    }

    /// The field.
    pub fn file(&self) -> &HeightFile {
        self.nodes.file()
    }

    /// The box around the surface as a look has it, its exaggeration included.
    ///
    /// # Errors
    /// Settings that do not fit the field.
    pub fn framed(&self, look: &LookPatch) -> Result<Bounds, PictureError> {
        let settings = SurfaceSettings::new(&look.settings, &self.file().about().grid);
        let settings = settings.map_err(|why| PictureError::of(self.opened.path(), why))?;
        Ok(bounds_of(&self.placed(&settings), self.extremes()))
    }

    /// The least and the largest height.
    fn extremes(&self) -> [f64; 2] {
        let facts = &self.file().about().facts;
        [facts.min, facts.max]
    }

    fn placed(&self, settings: &SurfaceSettings) -> Placed {
        Placed::new(&self.file().about().grid, settings.map, settings.exaggeration, settings.base)
    }

    /// What a look comes to.
    pub(super) fn prepare(&self, look: &LookPatch) -> Result<Prepared, PictureError> {
        let mode = look.mode.unwrap_or(&surface::MODE);
        let refuse = |why: String| PictureError::of(self.opened.path(), why);
        if !mode.takes_surfaces() {
            return Err(refuse(format!("mode {} does not draw heights, expected surface", mode.name)));
        }
        look.settings.check(mode).map_err(|error| {
            let named = &self.options.named;
            PictureError::of(if named.as_os_str().is_empty() { self.opened.path() } else { named }, error)
        })?;
        let about = self.file().about();
        let settings = SurfaceSettings::new(&look.settings, &about.grid).map_err(refuse)?;
        let attribute = surface::attribute_of(look.attribute_name(), about).map_err(refuse)?;
        let placed = self.placed(&settings);
        let transfer = look.transfer.clone().unwrap_or_else(|| surface::usual_transfer(attribute));
        let [x, y] = placed.spacing();
        let curvature = placed.true_lift * (about.facts.max - about.facts.min) / (64.0 * x * y).max(1e-300);
        let levels = about.levels.len() as u32;
        let fitted = match attribute {
            Attribute::Residual => Some(self.opened.fitted(settings.form, &*self.reporter)?),
            _ => None,
        };
        // A few that are far off do not hide all others.
        let most = fitted.as_ref().map_or(curvature, |fitted| fitted.most.min(OUTLIERS * fitted.root_mean_square));
        let range = surface::range_of(&transfer, attribute, &about.facts, levels, most);
        let look = settings.look(attribute, transfer, range);
        let form = fitted.map(|fitted| Arc::new(fitted.form));
        Ok(Prepared { mode, settings, placed, attribute, look, form })
    }

    /// How a look is drawn.
    pub(super) fn surface_options(&self, prepared: &Prepared, look: &LookPatch) -> SurfaceOptions {
        SurfaceOptions {
            technique: prepared.settings.technique,
            tau: match self.options.exact {
                Some(_) => 0.0,
                None => look.error_px.map_or(ERROR_PX, f64::from),
            },
            samples: prepared.settings.samples,
            raw: self.options.raw,
            look: Some(prepared.look.clone()),
            holes: prepared.settings.holes,
            holes_grow: prepared.settings.holes_grow,
            form: prepared.form.clone(),
            walls: prepared.settings.walls.then_some(prepared.settings.base),
            ..SurfaceOptions::default()
        }
    }

    /// What messages name.
    pub(super) fn path(&self) -> &Path {
        self.opened.path()
    }

    /// The chunks, placed as a look has it.
    pub(super) fn nodes(&mut self, placed: &Placed) -> &PagedSurface {
        self.nodes.place(placed);
        &self.nodes
    }

    /// The box around the surface as it is placed.
    pub(super) fn bounds(&self, placed: &Placed) -> Bounds {
        bounds_of(placed, self.extremes())
    }

    /// Draws a shot.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, or a setting does not fit it.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        if shot.look.time.is_some() {
            return Err(PictureError::of(self.opened.path(), "--time: heights have no times"));
        }
        if self.options.overdraw.is_some() {
            return Err(PictureError::of(self.opened.path(), "--overdraw: heights have no splats"));
        }
        let mut prepared = self.prepare(&shot.look)?;
        if self.options.raw && shot.stereo.is_some() {
            let why = "--raw: expected one picture, not a pair for two eyes";
            return Err(PictureError::of(self.opened.path(), why));
        }
        let bounds = bounds_of(&prepared.placed, self.extremes());
        let view = view_of(shot, bounds, &prepared.placed)?;
        self.nodes.place(&prepared.placed);
        if let Some(em) = prepared.look.contours.as_mut().and_then(|contours| contours.labels.as_mut()) {
            let scale = |annotations: &Annotations| annotations.scale_for(view.width, view.height);
            let scale = shot.look.annotations.as_ref().map_or_else(|| scale(&Annotations::NONE), scale);
            *em *= f64::from(scale);
        }
        let options = self.surface_options(&prepared, &shot.look);
        let mut times = Times::default();
        let mut drawn = None;
        for _ in 0..self.options.repeat.max(1) {
            let draw = || self.draw_once(shot, &view, &prepared.placed, &options);
            let done = times.frame(|times| times.measure("draw", draw))?;
            times.extend(done.1.milliseconds.clone().into_iter().filter(|(pass, _)| pass != "frame"));
            drawn = Some(done);
        }
        let Some((picture, drawn_by)) = drawn else { return Err(PictureError::Stopped) };
        let SurfacePicture { colors, raw, labels, report, .. } = picture;
        if let Some(error) = self.nodes.error() {
            self.reporter.tell(error);
        }
        let [width, height] = [colors.width, colors.height];
        let channels = (!raw.is_empty()).then_some(SurfaceChannels { width, height, values: raw });
        let is_labelled = prepared.look.contours.as_ref().is_some_and(|contours| contours.labels.is_some());
        let shown = SurfaceShown { report, channels, labels: is_labelled.then_some(labels) };
        let picture = self.pictured(shot, (view, bounds), prepared, colors, shown, times.medians())?;
        let converged = picture.converged && self.nodes.error().is_none();
        Ok(Picture { converged, drawn_by: drawn_by.names, ..picture })
    }

    /// What a legend tells of a look: the mode with its attribute, and units.
    pub(super) fn told(&self, prepared: &Prepared, look: &LookPatch) -> (Depiction, Units) {
        let name = look.attribute_name();
        let coloring = name.map(|name| Coloring { name: name.into(), fallback: 0.0, least: prepared.look.range[0] });
        let (mode, choice) = (prepared.mode, look.budget.level_choice());
        let depiction = Depiction { mode, settings: look.settings.clone(), attribute: coloring, choice };
        (depiction, self.opened.units_of(prepared.attribute, prepared.settings.form))
    }

    /// A picture in colours of a shot from a view, with what is in a box.
    ///
    /// # Errors
    /// What is wrong with the catalogue of the objects to name.
    pub(super) fn pictured(
        &self,
        shot: &Shot,
        (view, bounds): (View, Bounds),
        prepared: Prepared,
        colors: Colors,
        shown: SurfaceShown,
        milliseconds: BTreeMap<String, f64>,
    ) -> Result<Picture, PictureError> {
        let report = shown.report;
        let (depiction, units) = self.told(&prepared, &shot.look);
        let annotation = Annotation::new(shot, view, bounds, None, units, None, &depiction, &*self.reporter)?;
        let light = LightPicture::of(colors);
        let levels = VolumeLevels { density: prepared.look.range, ..light.levels };
        Ok(Picture {
            values: Raw::Light(LightPicture { levels, ..light }),
            annotation,
            transfer: prepared.look.transfer,
            converged: report.is_converged,
            error_px: report.error_px,
            particles: 0,
            nodes: report.nodes_drawn as usize,
            drawn_from: CHUNKS,
            left_out: LeftOut::default(),
            level_report: LevelReport { levels: CHUNKS, ..LevelReport::default() },
            drawn_by: ["cpu".into(), String::new()],
            milliseconds,
            moment: None,
            paths: None,
            ground: None,
            told: None,
            points: None,
            surface: Some(shown),
        })
    }

    /// Draws a shot once: in one piece, also around the eye; two eyes are two pictures.
    fn draw_once(
        &mut self,
        shot: &Shot,
        view: &View,
        placed: &Placed,
        options: &SurfaceOptions,
    ) -> Result<(SurfacePicture, DrawnBy), PictureError> {
        // Colours of a globe are sooner drawn on faces that are put together than by rays.
        if shot.stereo.is_none() && (placed.is_flat() || shot.surround.is_flat()) {
            let sight = match Panorama::around(view, shot.surround)? {
                None => Sight::Flat(*view),
                Some(panorama) => Sight::Around { panorama, eye: view.eye, cut: view.cut },
            };
            return self.drawn(placed, &sight, options);
        }
        let projector = Projector::new(*view, shot.surround, shot.stereo)?;
        let mut options = SurfaceOptions { raw: false, ..options.clone() };
        // What two eyes see, and faces that are put together, would each have heights at places of their own.
        if let Some(contours) = options.look.as_mut().and_then(|look| look.contours.as_mut()) {
            contours.labels = None;
        }
        let (mut whole, mut drawn_by) = (SurfacePicture::default(), DrawnBy::default());
        whole.report.is_converged = true;
        let values = projector.draw_each(true, |view| {
            let one;
            (one, drawn_by) = self.drawn(placed, &Sight::Flat(*view), &options)?;
            whole.report.add(&one.report);
            Ok(Some(Raw::Light(LightPicture::of(one.colors))))
        })?;
        if let Raw::Light(light) = values {
            whole.colors = light.colors;
        }
        if let (true, Some(panorama)) = (self.options.raw, Panorama::around(view, shot.surround)?) {
            let sight = Sight::Around { panorama, eye: view.eye, cut: view.cut };
            let channels = SurfaceOptions { look: None, raw: true, ..options };
            let one = self.drawn(placed, &sight, &channels)?.0;
            whole.report.error_px = whole.report.error_px.max(one.report.error_px);
            whole.report.is_converged &= one.report.is_converged;
            (whole.raw, whole.depth) = (one.raw, one.depth);
        }
        whole.report.covered = whole.colors.rgba.iter().map(|color| f64::from(color[3])).sum();
        Ok((whole, drawn_by))
    }

    /// Draws a picture with what is asked for, or best.
    fn drawn(
        &mut self,
        placed: &Placed,
        sight: &Sight,
        options: &SurfaceOptions,
    ) -> Result<(SurfacePicture, DrawnBy), PictureError> {
        let field = Field { nodes: &self.nodes, placed, extremes: self.extremes() };
        Ok(self.painter.draw(&field, sight, options, self.options.backend, &*self.reporter)?)
    }

    /// A drawn picture in colours, with what the shot's film does to it.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`] for the picture that it is blended with, and where a picture over it cannot be read.
    pub fn finished(&mut self, shot: &Shot, picture: &Picture) -> Result<Image, PictureError> {
        picture.finished_by(shot, |before| self.draw(before))
    }

    /// A look's picture of a view; its colours have the range `levels`, or their own.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn image(&mut self, look: &LookPatch, view: &View, levels: Option<Levels>) -> Result<Image, PictureError> {
        Ok(self.seen(look, view, levels)?.picture.colors.image())
    }

    /// The same with what is known of it, for those who draw view after view.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn seen(&mut self, look: &LookPatch, view: &View, levels: Option<Levels>) -> Result<SeenSurface, PictureError> {
        let mut prepared = self.prepare(look)?;
        if let Some(levels) = levels {
            prepared.look.range = levels.p;
        }
        let Prepared { look: own, attribute, .. } = &prepared;
        let (transfer, attribute) = (own.transfer.clone(), *attribute);
        let levels = Levels { p: own.range, s: [0.0, 1.0] };
        let options = SurfaceOptions {
            technique: prepared.settings.technique,
            tau: look.error_px.map_or(ERROR_PX, f64::from),
            samples: prepared.settings.samples,
            holes: prepared.settings.holes,
            holes_grow: prepared.settings.holes_grow,
            form: prepared.form,
            walls: prepared.settings.walls.then_some(prepared.settings.base),
            look: Some(prepared.look),
            ..SurfaceOptions::default()
        };
        self.nodes.place(&prepared.placed);
        let sight = Sight::Flat(*view);
        self.nodes.prepare(&prepared.placed, &sight, &options);
        let picture = draw_lettered(&self.nodes, &prepared.placed, &sight, &options, Some(&ProgramFont));
        Ok(SeenSurface { picture, attribute, transfer, levels, error: self.nodes.error() })
    }

    /// What is known of a look's picture: its range.
    ///
    /// # Errors
    /// Settings that do not fit the field.
    pub fn ranges(&mut self, look: &LookPatch, _camera: &Camera, _format: Format) -> Result<Measured, PictureError> {
        let Prepared { mode, look: own, .. } = self.prepare(look)?;
        let attribute = look.attribute_name().map(str::to_owned);
        let levels = Levels { p: own.range, s: [0.0, 1.0] };
        Ok(Measured { mode, attribute, transfer: own.transfer, levels })
    }
}

/// The box around a surface whose heights are between these.
pub(super) fn bounds_of(placed: &Placed, heights: [f64; 2]) -> Bounds {
    let ends = heights.map(|height| placed.lifted(height));
    let top = ends[0].max(ends[1]);
    if let Map::Globe(globe) = placed.map {
        let reach = DVec3::splat(globe.reach() + top);
        return Bounds { min: -reach, max: reach };
    }
    let [columns, rows] = placed.samples.map(|count| (count - 1) as f64);
    let corners = [(0.0, 0.0), (rows, columns)].map(|(row, column)| placed.world(row, column, heights[0]));
    let (low, high) = (corners[0].min(corners[1]), corners[0].max(corners[1]));
    Bounds { min: DVec3::new(low.x, low.y, ends[0].min(ends[1])), max: DVec3::new(high.x, high.y, top) }
}

/// The least distance from a target, of those up to twice `away`, at which all of a box is in the picture with a little room around it.
fn nearest(shot: &Shot, bounds: Bounds, target: DVec3, from: DVec3, away: f64) -> Result<f64, PictureError> {
    let Bounds { min, max } = bounds;
    let corner = |number: usize| DVec3::from_array([0, 1, 2].map(|axis| [min, max][number >> axis & 1][axis]));
    let fits = |distance: f64| -> Result<bool, PictureError> {
        let mut shot = shot.clone();
        (shot.camera.eye, shot.camera.target) = (Some((target + distance * from).to_array()), Some(target.to_array()));
        let view = shot.view(bounds, None)?;
        let [width, height] = [view.width, view.height].map(f64::from);
        let is_in = |at: [f64; 2]| {
            (ROOM..=1.0 - ROOM).contains(&(at[0] / width)) && (ROOM..=1.0 - ROOM).contains(&(at[1] / height))
        };
        Ok((0..8).all(|number| view.to_pixels(view.to_camera(corner(number))).is_some_and(is_in)))
    };
    let (mut near, mut far) = (0.1 * away, 2.0 * away);
    if !fits(far)? {
        return Ok(0.72 * away);
    }
    for _ in 0..12 {
        let middle = 0.5 * (near + far);
        if fits(middle)? { far = middle } else { near = middle }
    }
    Ok(far)
}

/// The share of a picture that is left free at each of its sides around a surface.
const ROOM: f64 = 0.04;

/// From where a shot is seen.
pub(super) fn view_of(shot: &Shot, bounds: Bounds, placed: &Placed) -> Result<View, PictureError> {
    Ok(standing(shot, bounds, placed)?.view(bounds, None)?)
}

/// A shot with a camera that stands, unless it says otherwise, above and in front of the surface, with z up.
pub(super) fn standing(shot: &Shot, bounds: Bounds, placed: &Placed) -> Result<Shot, PictureError> {
    let mut shot = shot.clone();
    let camera = &mut shot.camera;
    camera.up = Some(camera.up.unwrap_or([0.0, 0.0, 1.0]));
    if camera.eye.is_none() {
        let target = camera.target.map_or(bounds.center(), DVec3::from);
        let mut free = shot.clone();
        (free.camera.up, free.surround) = (None, crate::view::Surround::Flat);
        let away = (free.view(bounds, None)?.eye - target).length();
        let from = if placed.is_flat() { DVec3::new(0.0, -1.0, 0.9) } else { DVec3::new(1.0, -0.4, 0.5) };
        let eye = match shot.surround.is_flat() {
            true => target + nearest(&shot, bounds, target, from.normalize(), away)? * from.normalize(),
            // Around the eye there is nothing to see from within the surface.
            false => DVec3::new(target.x, target.y, bounds.max.z + 0.05 * bounds.size().length()),
        };
        shot.camera.eye = Some(eye.to_array());
        if !shot.surround.is_flat() && shot.camera.target.is_none() {
            shot.camera.target = Some((eye + DVec3::Y * bounds.size().length().max(1e-30)).to_array());
        }
    }
    if shot.camera.target.is_none() {
        let center = bounds.center();
        // Around an eye in the middle there is no other way to look than ahead.
        let is_there = shot.camera.eye.is_some_and(|eye| DVec3::from(eye) == center);
        let ahead = if is_there { DVec3::Z * bounds.size().length().max(1e-30) } else { DVec3::ZERO };
        shot.camera.target = Some((center - ahead).to_array());
    }
    Ok(shot)
}

impl SurfaceSession {
    /// What each pixel of a view shows of a look, from front to back: colours in linear light, and depths in the view's lengths. For whoever
    /// draws something else in the same view, or asks what hides what.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn fragments(&mut self, look: &LookPatch, view: &View) -> Result<(PathFragments, SurfaceReport), PictureError> {
        let prepared = self.prepare(look)?;
        let options = SurfaceOptions { raw: false, ..self.surface_options(&prepared, look) };
        let (placed, sight) = (prepared.placed, Sight::Flat(*view));
        let source = self.nodes(&placed);
        source.prepare(&placed, &sight, &options);
        Ok(fragments(&[Layer { source, placed: &placed, sight: &sight, options: &options, scale: 1.0 }]))
    }

    /// From where a shot is seen, and how the field stands there: for those who ask what is under its pixels.
    ///
    /// # Errors
    /// Settings that do not fit the field, and cameras that cannot see anything.
    pub fn sight(grid: &HeightGrid, heights: [f64; 2], shot: &Shot) -> Result<(Sight, Placed), PictureError> {
        let settings = SurfaceSettings::new(&shot.look.settings, grid).map_err(PictureError::Asked)?;
        let placed = Placed::new(grid, settings.map, settings.exaggeration, settings.base);
        let bounds = bounds_of(&placed, heights);
        let view = view_of(shot, bounds, &placed)?;
        let sight = match Panorama::around(&view, shot.surround)? {
            None => Sight::Flat(view),
            Some(panorama) => Sight::Around { panorama, eye: view.eye, cut: view.cut },
        };
        Ok((sight, placed))
    }
}
