//! An open height field, of which pictures are drawn.

mod seen;

pub use seen::SeenSurface;

use super::clearance::{Ground, raise};
use super::eyes::eyes_of;
use super::letters::ProgramFont;
use super::names::{Floor, Names, take};
use super::opened::OpenSurface;
use super::painting::{DrawnBy, Field, Painter, has_labels};
use super::raw::{SurfaceChannels, SurfaceShown};
use super::standing::{bounds_of, standing};
use crate::annotate::{Annotations, Shown, Units};
use crate::color::transfer::{Levels, Range};
use crate::color::{Colors, Image};
use crate::cpu::shadowing::Shadowing;
use crate::cpu::shadowing::ambient_occlusion::FARTHEST;
use crate::cpu::surface::lettering;
use crate::cpu::surface::look::{Attribute, Look};
use crate::cpu::surface::means;
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::select::{Coarse, MOST_NODES};
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::since::Since;
use crate::cpu::surface::{SurfaceOptions, SurfacePicture};
use crate::cpu::volume::VolumeLevels;
use crate::heights::OpenHeights;
use crate::heights::build::HeightBuildOptions;
use crate::heights::import::HeightOptions;
use crate::heights::measure::Form;
use crate::heights::model::Heights;
use crate::heights::store::HeightFile;
use crate::look::{Camera, HeightsSaid, LookPatch, Shot};
use crate::mode::depiction::Coloring;
use crate::mode::{Depiction, LightPicture, Mode, Raw};
use crate::model::Bounds;
use crate::modes::surface::{self, SurfaceSettings};
use crate::picture::adapter::Adapter;
use crate::picture::annotation::Annotation;
use crate::picture::drawn::CHUNKS;
use crate::picture::left_out::LeftOut;
use crate::picture::level_report::LevelReport;
use crate::picture::placement::FieldPlacement;
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
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Memory for decoded chunks unless it is set, bytes.
const CHUNK_MEMORY: u64 = 1 << 30;
/// Residuals are coloured up to so many times the root of their mean square.
const OUTLIERS: f64 = 3.0;

/// Draws pictures of a height field.
pub struct SurfaceSession {
    options: SessionOptions,
    reporter: Arc<dyn Reporter>,
    opened: Arc<OpenSurface>,
    nodes: PagedSurface,
    /// What changes are counted from.
    since: Option<Arc<Since>>,
    painter: Painter,
    /// Names that stand on it.
    names: Option<Names>,
    shortage: Shortage,
}

/// What is drawn of a field, whatever the view.
pub(in crate::picture) struct Prepared {
    pub(in crate::picture) mode: &'static Mode,
    pub(in crate::picture) settings: SurfaceSettings,
    pub(in crate::picture) placed: Placed,
    pub(in crate::picture) attribute: Attribute,
    pub(in crate::picture) look: Look,
    /// What residuals are what is left of, where they are shown.
    pub(in crate::picture) form: Option<Arc<Form>>,
}

impl Prepared {
    /// Refuses what is not drawn where surfaces hide other things.
    pub(in crate::picture) fn among_others(&self) -> Result<(), &'static str> {
        match self.settings.coarse {
            Coarse::Nested => Ok(()),
            Coarse::Means => Err("pyramid: found means among other data, expected nested"),
        }
    }
}

impl SurfaceSession {
    /// Opens a field, and the earlier one that it is compared with if one is named; a source's page file is built for it first, and kept as long as
    /// the session is.
    ///
    /// # Errors
    /// When it cannot be read, or both do not fit together.
    pub fn open(
        path: &Path,
        said: &HeightsSaid,
        options: SessionOptions,
        reporter: Arc<dyn Reporter>,
    ) -> Result<SurfaceSession, PictureError> {
        let (file, folder) = page_file(path, &said.options(options.read), &*reporter)?;
        let mut opened = OpenSurface::new(path, file)?;
        if let Some(folder) = folder {
            opened = opened.within(folder);
        }
        if let Some(before) = &said.before {
            let (file, folder) = page_file(before, &said.of_before().options(options.read), &*reporter)?;
            opened = opened.since(before, file, folder)?;
        }
        Ok(SurfaceSession::of(Arc::new(opened), options, reporter))
    }

    /// A field that is open.
    pub fn of(opened: Arc<OpenSurface>, options: SessionOptions, reporter: Arc<dyn Reporter>) -> SurfaceSession {
        let memory = memory_of(&options);
        // Of both fields about as many samples are read.
        let since = opened.earlier().map(|earlier| earlier.since(memory / 2));
        let own = if since.is_some() { memory / 2 } else { memory };
        let nodes = PagedSurface::new(Arc::clone(opened.file()), own);
        let (painter, shortage) = (Painter::default(), Shortage::default());
        SurfaceSession { options, reporter, opened, nodes, since, painter, names: None, shortage }
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

    /// Bytes that decoded chunks may take.
    pub fn chunk_memory(&self) -> u64 {
        memory_of(&self.options)
    }

    /// Whether the picture that was drawn last has coarser chunks than it asks for, for want of room alone.
    pub fn lacks_memory(&self) -> bool {
        self.shortage.is_coarser
    }

    /// What is to be told of the field's pages since the last call, one sentence each, where a picture was not told of by [`SurfaceSession::draw`].
    pub fn take_messages(&self) -> Vec<String> {
        self.nodes.take_messages()
    }

    /// When another picture may have what the last one does without.
    pub fn again(&self) -> Option<Instant> {
        self.nodes.again()
    }

    /// Pages that the disk does not give are waited for so long from now on.
    pub fn wait_for(&mut self, stall: Duration) {
        self.nodes.wait_for(stall);
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
    pub(in crate::picture) fn extremes(&self) -> [f64; 2] {
        let facts = &self.file().about().facts;
        [facts.min, facts.max]
    }

    /// How a surface of these options darkens itself where it is as large as it is.
    fn shadowing(&self, options: &SurfaceOptions, placed: &Placed) -> Option<Shadowing> {
        let size = bounds_of(placed, self.extremes()).size().length();
        options.shadowing.map(|shadowing| shadowing.scaled(size))
    }

    fn placed(&self, settings: &SurfaceSettings) -> Placed {
        Placed::new(&self.file().about().grid, settings.map, settings.exaggeration, settings.base)
    }

    /// What a look comes to.
    pub(in crate::picture) fn prepare(&self, look: &LookPatch) -> Result<Prepared, PictureError> {
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
        let attribute = self.opened.attribute(look.attribute_name()).map_err(refuse)?;
        let placed = self.placed(&settings);
        let transfer = look.transfer.clone().unwrap_or_else(|| surface::usual_transfer(attribute));
        let transfer = self.opened.suited_transfer(transfer, attribute);
        let [x, y] = placed.spacing();
        let curvature = placed.true_lift * (about.facts.max - about.facts.min) / (64.0 * x * y).max(1e-300);
        let levels = match settings.coarse {
            Coarse::Nested => about.levels.len() as u32,
            Coarse::Means => means::LEVELS,
        };
        let fitted = match attribute {
            Attribute::Residual => Some(self.opened.fitted(settings.form, &*self.reporter)?),
            _ => None,
        };
        // A few that are far off do not hide all others.
        let residual = fitted.as_ref().map(|fitted| fitted.most.min(OUTLIERS * fitted.root_mean_square));
        let change = self.opened.earlier().filter(|_| attribute == Attribute::Difference).map(|earlier| earlier.most);
        let most = residual.or(change).unwrap_or(curvature);
        let is_by_height = attribute == Attribute::Height && transfer.range == Range::Auto;
        let heights = if is_by_height { self.opened.usual_heights(&*self.reporter) } else { self.extremes() };
        let range = surface::range_of(&transfer, attribute, heights, levels, most);
        let look = settings.look(attribute, transfer, range);
        let form = fitted.map(|fitted| Arc::new(fitted.form));
        Ok(Prepared { mode, settings, placed, attribute, look, form })
    }

    /// How a look is drawn.
    pub(in crate::picture) fn surface_options(&self, prepared: &Prepared, look: &LookPatch) -> SurfaceOptions {
        let (own, form) = (prepared.look.clone(), prepared.form.clone());
        let options = SurfaceOptions { form, ..prepared.settings.options(own, look.error_px) };
        let tau = if self.options.exact.is_some() { 0.0 } else { options.tau };
        let shadowing = self.shadowing(&options, &prepared.placed);
        SurfaceOptions { tau, raw: self.options.raw, shadowing, ..options }
    }

    /// The chunks, placed and compared as a look has it.
    pub(in crate::picture) fn nodes(&mut self, prepared: &Prepared) -> &PagedSurface {
        self.nodes.place(&prepared.placed);
        self.nodes.compare(self.since.as_ref().filter(|_| prepared.attribute == Attribute::Difference));
        &self.nodes
    }

    /// Keeps the eye of a shot above the surface, which lies somewhere in the shot's world; tells where it stands then, if it was lifted.
    pub(in crate::picture) fn keep_above(
        &self,
        shot: &mut Shot,
        prepared: &Prepared,
        placement: &FieldPlacement,
    ) -> Result<Option<[f64; 3]>, PictureError> {
        let (clearance, scale) = (prepared.settings.clearance, placement.scale);
        let Some(eye) = shot.camera.eye.filter(|_| clearance > 0.0).map(DVec3::from) else { return Ok(None) };
        let ground = Ground { heights: self.file(), placed: &prepared.placed };
        let lift = ground.lift(placement.inside(eye), clearance / scale);
        let lift = lift.map_err(|error| PictureError::Asked(error.to_string()))?;
        Ok(lift.map(|lift| raise(shot, eye, scale * lift)))
    }

    /// What names stand on, where the field lies somewhere in a scene.
    pub(in crate::picture) fn floor(&self, prepared: &Prepared, placement: FieldPlacement) -> Floor {
        Floor { placed: prepared.placed, placement, lowest: self.extremes()[0] }
    }

    /// The box around the surface as it is placed.
    pub(in crate::picture) fn bounds(&self, placed: &Placed) -> Bounds {
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
        if self.options.raw && prepared.settings.coarse == Coarse::Means && !shot.surround.is_flat() {
            let why = "--raw: found a pyramid of means around the eye, expected pyramid nested";
            return Err(PictureError::of(self.opened.path(), why));
        }
        let bounds = bounds_of(&prepared.placed, self.extremes());
        let mut shot = standing(shot, bounds, &prepared.placed)?;
        let lifted = self.keep_above(&mut shot, &prepared, &FieldPlacement::NONE)?;
        let floor = self.floor(&prepared, FieldPlacement::NONE);
        let fields: [(&dyn Heights, Floor); 1] = [(self.nodes.file(), floor)];
        let names = take(&mut self.names, &mut shot, &fields, &*self.reporter)?;
        let shot = &shot;
        let view = shot.view(bounds, None)?;
        self.nodes(&prepared);
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
        self.take_messages().into_iter().for_each(|message| self.reporter.tell(message));
        let [width, height] = [colors.width, colors.height];
        let channels = (!raw.is_empty()).then_some(SurfaceChannels { width, height, values: raw });
        let is_labelled = prepared.look.contours.as_ref().is_some_and(|contours| contours.labels.is_some());
        let shown = SurfaceShown { report, channels, labels: is_labelled.then_some(labels), lifted };
        let picture = self.pictured(shot, (view, bounds), prepared, colors, shown, times.medians())?;
        let is_readable = self.nodes.error().is_none();
        let (converged, is_coarser) = (picture.converged && is_readable, picture.is_coarser && is_readable);
        self.note_shortage(is_coarser);
        let annotation = picture.annotation.naming(names.map(|names| names.seen(&view)));
        Ok(Picture { converged, is_coarser, annotation, drawn_by: drawn_by.names, ..picture })
    }

    /// Notes whether a picture is coarser for want of room, and tells once that there are such.
    pub(in crate::picture) fn note_shortage(&mut self, is_coarser: bool) {
        self.shortage.is_coarser = is_coarser;
        if !is_coarser || std::mem::replace(&mut self.shortage.is_told, true) {
            return;
        }
        self.reporter.tell(format!(
            "{}: what is in view does not fit into the {} MiB, or the {MOST_NODES} chunks, that heights may take and is drawn coarser; --memory sets how \
             much a command has, and a larger --error-px takes less",
            self.opened.path().display(),
            self.chunk_memory() >> 20
        ));
    }

    /// What a legend tells of a look: the mode with its attribute, and units.
    pub(in crate::picture) fn told(&self, prepared: &Prepared, look: &LookPatch) -> (Depiction, Units) {
        let name = look.attribute_name();
        let coloring = name.map(|name| Coloring { name: name.into(), fallback: 0.0, least: prepared.look.range[0] });
        let (mode, choice) = (prepared.mode, look.budget.level_choice());
        let depiction = Depiction { mode, settings: look.settings.clone(), attribute: coloring, choice };
        let SurfaceSettings { form, map, exaggeration, .. } = prepared.settings;
        let mut units = self.opened.units_of(prepared.attribute, form, map, exaggeration);
        if let Shown::Named(name, _) = &mut units.value
            && prepared.attribute == Attribute::Height
            && prepared.look.transfer.range == Range::Auto
            && let Some(beyond) = self.opened.beyond()
        {
            *name = format!("{name}, {beyond}");
        }
        (depiction, units)
    }

    /// A picture in colours of a shot from a view, with what is in a box.
    ///
    /// # Errors
    /// What is wrong with the catalogue of the objects to name.
    pub(in crate::picture) fn pictured(
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
            is_coarser: report.is_coarser,
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
            unfiltered: None,
            told: None,
            points: None,
            surface: Some(shown),
        })
    }

    /// Draws a shot once: in one piece, by the processor also around the eye; two eyes are two pictures. Heights along lines are written over what
    /// is put together.
    fn draw_once(
        &mut self,
        shot: &Shot,
        view: &View,
        placed: &Placed,
        options: &SurfaceOptions,
    ) -> Result<(SurfacePicture, DrawnBy), PictureError> {
        // Colours of a globe are sooner drawn on faces that are put together than in all directions at once, and an adapter draws faces alone.
        // Heights along lines are written into whole pictures.
        let is_whole = has_labels(options) || !self.painter.is_by_adapter(self.options.backend);
        // What darkens what is found in flat pictures, and means are drawn in these alone.
        let is_one = placed.is_flat() && is_whole && options.shadowing.is_none() && options.coarse == Coarse::Nested;
        let margin = if options.shadowing.is_some() { FARTHEST } else { 0 };
        if shot.stereo.is_none() && (is_one || shot.surround.is_flat()) {
            let sight = match Panorama::around(view, shot.surround)? {
                None => Sight::Flat(*view),
                Some(panorama) => Sight::Around { panorama, eye: view.eye, cut: view.cut },
            };
            return self.drawn(placed, &sight, options);
        }
        let projector = Projector::new(*view, shot.surround, shot.stereo)?;
        let mut own = SurfaceOptions { raw: false, ..options.clone() };
        // What two eyes see, and faces that are put together, would each have heights at places of their own.
        if let Some(contours) = own.look.as_mut().and_then(|look| look.contours.as_mut()) {
            contours.labels = None;
        }
        let (mut whole, mut drawn_by) = (SurfacePicture::default(), DrawnBy::default());
        whole.report.is_converged = true;
        let values = projector.draw_each(true, margin, |view| {
            if self.reporter.is_stopped() {
                return Err(PictureError::Stopped);
            }
            let one;
            (one, drawn_by) = self.drawn(placed, &Sight::Flat(*view), &own)?;
            whole.report.add(&one.report);
            Ok(Some(Raw::Light(LightPicture::of(one.colors))))
        })?;
        if let Raw::Light(light) = values {
            whole.colors = light.colors;
        }
        if has_labels(options) {
            let (middle, eyes) = eyes_of(view, shot)?;
            self.nodes.prepare(placed, &middle, options);
            lettering::over(&mut whole, (&self.nodes, placed), (&middle, &eyes), options, &ProgramFont);
        }
        if let (true, Some(panorama)) = (self.options.raw, Panorama::around(view, shot.surround)?) {
            let sight = Sight::Around { panorama, eye: view.eye, cut: view.cut };
            let channels = SurfaceOptions { look: None, raw: true, ..own };
            let one = self.drawn(placed, &sight, &channels)?.0;
            whole.report.bound(&one.report);
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

/// What pictures have no room for.
#[derive(Clone, Copy, Debug, Default)]
struct Shortage {
    /// Whether the last one is coarser therefore.
    is_coarser: bool,
    /// Whether it was told of any.
    is_told: bool,
}

/// Bytes that decoded chunks may take.
fn memory_of(options: &SessionOptions) -> u64 {
    options.chunk_memory.unwrap_or(CHUNK_MEMORY)
}

/// The page file of what a user names; a source's is built in a folder that goes when nobody needs it any more.
fn page_file(
    path: &Path,
    said: &HeightOptions,
    reporter: &dyn Reporter,
) -> Result<(HeightFile, Option<TempDir>), PictureError> {
    let told = |error: &dyn std::fmt::Display| PictureError::Asked(error.to_string());
    let (open, _) = OpenHeights::for_pictures(path, said).map_err(|error| told(&error))?;
    let (file, folder) = match open {
        OpenHeights::Pages(file) => (*file, None),
        open @ OpenHeights::Source(_) => {
            let progress = reporter.progress();
            let folder = tempfile::tempdir().map_err(|error| told(&error))?;
            let built = folder.path().join("heights.df");
            let options = HeightBuildOptions { is_temporary: true, ..HeightBuildOptions::default() };
            let about = open.build(&options, &built, &*progress);
            drop(progress);
            about.map_err(|error| told(&error))?;
            (HeightFile::open(&built, said.read).map_err(|error| told(&error))?, Some(folder))
        }
    };
    // The others were told when it was built, and are told by `info`: these name an option that changes what is seen.
    let asking = file.about().notes.iter().filter(|note| note.contains(": --"));
    asking.for_each(|note| reporter.tell(format!("{}: {note}", path.display())));
    Ok((file, folder))
}

#[cfg(test)]
mod tests;
