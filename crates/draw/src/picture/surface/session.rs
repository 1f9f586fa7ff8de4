//! An open height field, of which pictures are drawn.

use super::painting::{DrawnBy, Field, Painter};
use super::raw::{SurfaceChannels, SurfaceShown};
use crate::annotate::Units;
use crate::color::Image;
use crate::color::transfer::Levels;
use crate::cpu::surface::look::{Attribute, Look};
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::{Map, Placed};
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::{SurfaceOptions, SurfacePicture};
use crate::cpu::volume::{VolumeLevels, VolumeReport};
use crate::heights::build::HeightBuildOptions;
use crate::heights::import::HeightOptions;
use crate::heights::model::HeightGrid;
use crate::heights::store::HeightFile;
use crate::heights::{OpenHeights, is_heights};
use crate::look::{Camera, DataKind, LookPatch, Shot};
use crate::mode::depiction::Coloring;
use crate::mode::{Depiction, LightPicture, Mode, Raw};
use crate::model::{Bounds, Unit};
use crate::modes::surface::{self, SurfaceSettings};
use crate::picture::adapter::Adapter;
use crate::picture::annotation::Annotation;
use crate::picture::left_out::LeftOut;
use crate::picture::level_report::LevelReport;
use crate::picture::projected::Projector;
use crate::picture::ranges::{Format, Measured};
use crate::picture::session::Reporter;
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, SessionOptions};
use crate::view::{Panorama, View};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Memory for decoded chunks unless it is set, bytes.
const CHUNK_MEMORY: u64 = 512 << 20;
/// Largest displacement on screen unless it is set, pixels.
const ERROR_PX: f64 = 0.8;

/// Draws pictures of a height field.
pub struct SurfaceSession {
    path: PathBuf,
    options: SessionOptions,
    reporter: Arc<dyn Reporter>,
    nodes: PagedSurface,
    painter: Painter,
    /// Where the page file of a source lies while it is drawn.
    _folder: Option<tempfile::TempDir>,
}

/// What is drawn of a field, whatever the view.
struct Prepared {
    mode: &'static Mode,
    settings: SurfaceSettings,
    placed: Placed,
    attribute: Attribute,
    look: Look,
}

impl SurfaceSession {
    /// Whether a file is of heights, built or not.
    pub fn is_surface(path: &Path) -> bool {
        matches!(DataKind::of(path), Ok(DataKind::Heights)) || is_heights(path)
    }

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
        let memory = options.chunk_memory.unwrap_or(CHUNK_MEMORY);
        let nodes = PagedSurface::new(Arc::new(file), memory);
        Ok(SurfaceSession { path: path.into(), options, reporter, nodes, painter: Painter::default(), _folder: folder })
    }

    /// The same with an adapter, which draws what it is asked for or is faster at.
    #[must_use]
    pub fn with_adapter(mut self, adapter: Option<Box<dyn Adapter>>) -> SurfaceSession {
        self.painter.adapter = adapter;
        self
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
        let settings = settings.map_err(|why| PictureError::of(&self.path, why))?;
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

    fn prepare(&self, look: &LookPatch) -> Result<Prepared, PictureError> {
        let mode = look.mode.unwrap_or(&surface::MODE);
        let refuse = |why: String| PictureError::of(&self.path, why);
        if !mode.takes_surfaces() {
            return Err(refuse(format!("mode {} does not draw heights, expected surface", mode.name)));
        }
        look.settings.check(mode).map_err(|error| {
            let named = &self.options.named;
            PictureError::of(if named.as_os_str().is_empty() { &self.path } else { named }, error)
        })?;
        let about = self.file().about();
        let settings = SurfaceSettings::new(&look.settings, &about.grid).map_err(refuse)?;
        let attribute = surface::attribute_of(look.attribute_name(), &about.grid).map_err(refuse)?;
        let placed = self.placed(&settings);
        if !placed.is_flat() && settings.contours.is_some() {
            return Err(refuse("contours: not drawn on a globe yet, expected 0, or map plate or local".into()));
        }
        let transfer = look.transfer.clone().unwrap_or_else(|| surface::usual_transfer(attribute));
        let [x, y] = placed.spacing();
        let curvature = placed.true_lift * (about.facts.max - about.facts.min) / (64.0 * x * y).max(1e-300);
        let levels = about.levels.len() as u32;
        let range = surface::range_of(&transfer, attribute, &about.facts, levels, curvature);
        let look = settings.look(attribute, transfer, range);
        Ok(Prepared { mode, settings, placed, attribute, look })
    }

    /// Draws a shot.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, or a setting does not fit it.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        if shot.look.time.is_some() {
            return Err(PictureError::of(&self.path, "--time: heights have no times"));
        }
        if self.options.overdraw.is_some() {
            return Err(PictureError::of(&self.path, "--overdraw: heights have no splats"));
        }
        let prepared = self.prepare(&shot.look)?;
        let is_globe = !prepared.placed.is_flat();
        if self.options.raw && (shot.stereo.is_some() || is_globe && !shot.surround.is_flat()) {
            let why =
                "--raw: expected one picture with rays of its own: no pair for two eyes, and no globe around the eye";
            return Err(PictureError::of(&self.path, why));
        }
        let bounds = bounds_of(&prepared.placed, self.extremes());
        let view = view_of(shot, bounds, &prepared.placed)?;
        self.nodes.place(&prepared.placed);
        let options = SurfaceOptions {
            technique: prepared.settings.technique,
            tau: match self.options.exact {
                Some(_) => 0.0,
                None => shot.look.error_px.map_or(ERROR_PX, f64::from),
            },
            samples: prepared.settings.samples,
            raw: self.options.raw,
            look: Some(prepared.look.clone()),
            ..SurfaceOptions::default()
        };
        let mut times = Times::default();
        let mut drawn = None;
        for _ in 0..self.options.repeat.max(1) {
            let draw = || self.draw_once(shot, &view, &prepared.placed, &options);
            let done = times.frame(|times| times.measure("draw", draw))?;
            times.extend(done.1.milliseconds.clone().into_iter().filter(|(pass, _)| pass != "frame"));
            drawn = Some(done);
        }
        let Some((picture, drawn_by)) = drawn else { return Err(PictureError::Stopped) };
        let SurfacePicture { colors, raw, report, .. } = picture;
        if let Some(error) = self.nodes.error() {
            self.reporter.tell(error);
        }
        let [width, height] = [colors.width, colors.height];
        let channels = (!raw.is_empty()).then_some(SurfaceChannels { width, height, values: raw });
        let Prepared { mode, attribute, look, .. } = prepared;
        let name = shot.look.attribute_name();
        let coloring = name.map(|name| Coloring { name: name.into(), fallback: 0.0, least: look.range[0] });
        let choice = shot.look.budget.level_choice();
        let depiction = Depiction { mode, settings: shot.look.settings.clone(), attribute: coloring, choice };
        let units = self.units(attribute);
        let annotation = Annotation::new(shot, view, bounds, None, units, None, &depiction, &*self.reporter)?;
        let levels = VolumeLevels { density: look.range, attribute: [0.0, 1.0], unit_length: 1.0 };
        let picture = LightPicture { colors, report: VolumeReport::default(), levels, isovalues: Vec::new() };
        Ok(Picture {
            values: Raw::Light(picture),
            annotation,
            transfer: look.transfer,
            converged: report.is_converged && self.nodes.error().is_none(),
            error_px: report.error_px,
            particles: 0,
            nodes: report.nodes_drawn as usize,
            drawn_from: "chunks",
            left_out: LeftOut::default(),
            level_report: LevelReport { levels: "chunks", ..LevelReport::default() },
            drawn_by: drawn_by.names,
            milliseconds: times.medians(),
            moment: None,
            paths: None,
            points: None,
            surface: Some(SurfaceShown { report, channels }),
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
        // A globe has no rays of its own: its panoramas are faces put together.
        if shot.stereo.is_none() && (placed.is_flat() || shot.surround.is_flat()) {
            let sight = match Panorama::around(view, shot.surround)? {
                None => Sight::Flat(*view),
                Some(panorama) => Sight::Around { panorama, eye: view.eye, cut: view.cut },
            };
            return self.drawn(placed, &sight, options);
        }
        let projector = Projector::new(*view, shot.surround, shot.stereo)?;
        let options = SurfaceOptions { raw: false, ..options.clone() };
        let (mut whole, mut drawn_by) = (SurfacePicture::default(), DrawnBy::default());
        whole.report.is_converged = true;
        let values = projector.draw_each(true, |view| {
            let one;
            (one, drawn_by) = self.drawn(placed, &Sight::Flat(*view), &options)?;
            whole.report.error_px = whole.report.error_px.max(one.report.error_px);
            whole.report.is_converged &= one.report.is_converged;
            whole.report.nodes_drawn += one.report.nodes_drawn;
            whole.report.samples_drawn += one.report.samples_drawn;
            whole.report.points += one.report.points;
            whole.report.triangles += one.report.triangles;
            let levels = VolumeLevels { density: [0.0, 1.0], attribute: [0.0, 1.0], unit_length: 1.0 };
            let (colors, report) = (one.colors, VolumeReport::default());
            Ok(Some(Raw::Light(LightPicture { colors, report, levels, isovalues: Vec::new() })))
        })?;
        if let Raw::Light(light) = values {
            whole.colors = light.colors;
        }
        Ok((whole, drawn_by))
    }

    /// Reads what a picture needs, all at once, and draws it.
    fn drawn(
        &mut self,
        placed: &Placed,
        sight: &Sight,
        options: &SurfaceOptions,
    ) -> Result<(SurfacePicture, DrawnBy), PictureError> {
        let field = Field { nodes: &self.nodes, placed, extremes: self.extremes() };
        Ok(self.painter.draw(&field, sight, options, self.options.backend, &*self.reporter)?)
    }

    fn units(&self, attribute: Attribute) -> Units {
        let grid = &self.file().about().grid;
        let value = surface::quantity_of(attribute)
            .map(|(name, unit)| (name.to_owned(), unit.map_or_else(|| grid.height_unit.clone(), Unit::new)));
        Units { mass: Unit::default(), length: grid.xy_unit.clone(), attribute: Unit::default(), value }
    }

    /// A drawn picture in colours, with what the shot's film does to it.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`] for the picture that it is blended with, and where a picture over it cannot be read.
    pub fn finished(&mut self, shot: &Shot, picture: &Picture) -> Result<Image, PictureError> {
        let Some(film) = &shot.film else { return picture.image(shot) };
        let before = film.from.as_deref().map(|from| {
            let mut before = Shot::of_scene(from.clone(), Path::new(""));
            (before.size, before.film, before.look.background) = (shot.size, None, shot.look.background);
            self.draw(&before)?.image(&before)
        });
        picture.filmed(shot, film, before.transpose()?)
    }

    /// A look's picture of a view; its colours have the range `levels`, or their own.
    ///
    /// # Errors
    /// As [`SurfaceSession::draw`].
    pub fn image(&mut self, look: &LookPatch, view: &View, levels: Option<Levels>) -> Result<Image, PictureError> {
        let mut prepared = self.prepare(look)?;
        if let Some(levels) = levels {
            prepared.look.range = levels.p;
        }
        let options = SurfaceOptions {
            technique: prepared.settings.technique,
            tau: look.error_px.map_or(ERROR_PX, f64::from),
            samples: prepared.settings.samples,
            look: Some(prepared.look),
            ..SurfaceOptions::default()
        };
        self.nodes.place(&prepared.placed);
        Ok(self.drawn(&prepared.placed, &Sight::Flat(*view), &options)?.0.colors.image())
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
fn bounds_of(placed: &Placed, heights: [f64; 2]) -> Bounds {
    let ends = heights.map(|height| placed.lifted(height));
    let top = ends[0].max(ends[1]);
    if let Map::Globe { radius } = placed.map {
        let reach = DVec3::splat(radius + top);
        return Bounds { min: -reach, max: reach };
    }
    let [columns, rows] = placed.samples.map(|count| (count - 1) as f64);
    let corners = [(0.0, 0.0), (rows, columns)].map(|(row, column)| placed.world(row, column, heights[0]));
    let (low, high) = (corners[0].min(corners[1]), corners[0].max(corners[1]));
    Bounds { min: DVec3::new(low.x, low.y, ends[0].min(ends[1])), max: DVec3::new(high.x, high.y, top) }
}

/// Where the camera of a shot stands: unless it says otherwise above and in front of the surface, with z up.
fn view_of(shot: &Shot, bounds: Bounds, placed: &Placed) -> Result<View, PictureError> {
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
            // Nearer than a box of the same size would be looked at: a surface is flat.
            true => target + 0.72 * away * from.normalize(),
            // Around the eye there is nothing to see from within the surface.
            false => DVec3::new(target.x, target.y, bounds.max.z + 0.05 * bounds.size().length()),
        };
        shot.camera.eye = Some(eye.to_array());
        if !shot.surround.is_flat() && shot.camera.target.is_none() {
            shot.camera.target = Some((eye + DVec3::Y * bounds.size().length().max(1e-30)).to_array());
        }
    }
    Ok(shot.view(bounds, None)?)
}

impl SurfaceSession {
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
