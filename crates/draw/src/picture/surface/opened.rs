//! A built height field that is open: what its attributes are called, what its pictures mean, and a look at all of it at once.

use super::clearance::Ground;
use super::earlier::Earlier;
use super::painting::is_beyond_frames;
use crate::annotate::number::{quantity, stepped};
use crate::annotate::{Shown, Units};
use crate::color::transfer::TransferFunction;
use crate::cpu::surface::look::Attribute as Coloured;
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::{Map, Placed};
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::source::{NodeSamples, SurfaceNodes};
use crate::heights::measure::{FittedForm, FormKind, Pick, Ray, fitted, pick_all};
use crate::heights::model::HeightError;
use crate::heights::store::HeightFile;
use crate::look::{CameraConfig, Shot};
use crate::mode::{Coloring, Depiction, LevelChoice, Mode, Settings};
use crate::model::{Attribute, Bounds, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use crate::modes::surface::{self, SurfaceSettings};
use crate::picture::PictureError;
use crate::picture::session::Reporter;
use crate::view::View;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tempfile::TempDir;

/// Memory for the chunk that all of a field is, bytes.
const ONE_CHUNK: u64 = 16 << 20;

/// A built height field.
pub struct OpenSurface {
    /// What the user named.
    path: PathBuf,
    file: Arc<HeightFile>,
    /// The chunk that all of the field is.
    coarse: Coarse,
    /// The heights that colours are spread over where nothing else is said.
    usual_heights: [f64; 2],
    /// Whether it was told that they are not all.
    has_told_heights: AtomicBool,
    /// Forms that were fitted to it.
    forms: Mutex<Vec<FittedForm>>,
    /// The field that it is compared with.
    pub(super) earlier: Option<Earlier>,
    /// Where its page file lies as long as anybody may read it.
    folder: Option<TempDir>,
}

/// The chunk that all of a field is: its samples, where they are, and how far T is from it at most.
struct Coarse {
    samples: Arc<NodeSamples>,
    /// Rows and columns of the field's samples.
    positions: [Vec<u64>; 2],
    delta: f64,
}

impl Coarse {
    /// The heights of samples around which most is surface, of all where there are none: what lies about singly is no part of T, and a coarse sample
    /// stands for it as for any other.
    fn heights(&self) -> Vec<f64> {
        let known = || self.samples.heights.iter().enumerate().filter(|(_, height)| !height.is_nan());
        let of_surface = known().filter(|(index, _)| self.samples.coverage_at(*index) > u8::MAX / 2);
        let heights: Vec<f64> = of_surface.map(|(_, height)| height).collect();
        if heights.is_empty() { known().map(|(_, height)| height).collect() } else { heights }
    }
}

impl OpenSurface {
    /// A page file, of a field that a user calls `path`.
    ///
    /// # Errors
    /// When the chunk that all of it is cannot be read.
    pub fn new(path: &Path, file: HeightFile) -> Result<OpenSurface, PictureError> {
        let file = Arc::new(file);
        let nodes = PagedSurface::new(Arc::clone(&file), ONE_CHUNK);
        let root = nodes.lattice().root();
        let (Some(samples), Some(facts)) = (nodes.samples(root), nodes.facts(root)) else {
            let why = nodes.error().unwrap_or_else(|| "the coarsest level: missing".into());
            return Err(PictureError::of(path, why));
        };
        let positions = [0, 1].map(|axis| nodes.lattice().places(root, axis));
        let coarse = Coarse { samples, positions, delta: facts.delta };
        Ok(OpenSurface {
            usual_heights: surface::usual_heights(&file.about().facts, coarse.heights().into_iter()),
            path: path.into(),
            file,
            coarse,
            has_told_heights: AtomicBool::new(false),
            forms: Mutex::default(),
            earlier: None,
            folder: None,
        })
    }

    /// The same with the folder that its page file lies in, which goes when nobody needs it any more.
    #[must_use]
    pub fn within(self, folder: TempDir) -> OpenSurface {
        OpenSurface { folder: Some(folder), ..self }
    }

    /// What the user named.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its page file.
    pub fn file(&self) -> &Arc<HeightFile> {
        &self.file
    }

    /// Whether its page file goes with it.
    pub fn is_temporary(&self) -> bool {
        self.folder.is_some()
    }

    /// Whether a mode draws it.
    pub fn is_drawn_by(&self, mode: &Mode) -> bool {
        mode.takes_surfaces()
    }

    /// What colours it, by the name of an attribute.
    ///
    /// # Errors
    /// The names that there are.
    pub(super) fn attribute(&self, name: Option<&str>) -> Result<Coloured, String> {
        surface::attribute_of(name, self.file.about(), self.earlier.is_some())
    }

    /// The names of what can colour its pictures.
    pub fn attributes(&self) -> Vec<String> {
        let grid = &self.file.about().grid;
        let has_colors = self.attribute(Some("texture")).is_ok();
        let planes = grid.planes.iter().map(|plane| plane.name.as_str());
        surface::ATTRIBUTES
            .into_iter()
            .chain(self.earlier.as_ref().map(|_| "difference"))
            .chain(has_colors.then_some("texture"))
            .chain(planes)
            .map(str::to_owned)
            .collect()
    }

    /// What colours it where nothing is named.
    pub fn usual_attribute(&self) -> &'static str {
        match self.attribute(None) {
            Ok(Coloured::Difference) => "difference",
            Ok(Coloured::Texture(_) | Coloured::Photo) => "texture",
            _ => "height",
        }
    }

    /// What a depiction colours.
    fn coloured(&self, depiction: &Depiction) -> Coloured {
        let name = depiction.attribute.as_ref().map(|coloring| coloring.name.as_str());
        self.attribute(name).unwrap_or(Coloured::Height)
    }

    /// Whether an adapter's passes draw flat pictures of it with these settings, coloured by an attribute.
    pub fn is_for_passes(&self, settings: &Settings, attribute: Option<&str>) -> bool {
        let about = self.file.about();
        let Ok(settings) = SurfaceSettings::new(settings, &about.grid) else { return false };
        let Ok(attribute) = self.attribute(attribute) else { return false };
        let look = settings.look(attribute, surface::usual_transfer(attribute), [0.0, 1.0]);
        !is_beyond_frames(&settings.options(look, None))
    }

    /// A mode of its pictures, coloured by an attribute where one is named.
    ///
    /// # Errors
    /// The names of the attributes that there are.
    pub fn depiction(
        &self,
        mode: &'static Mode,
        settings: Settings,
        attribute: Option<&str>,
        choice: LevelChoice,
    ) -> Result<Depiction, String> {
        self.attribute(attribute)?;
        let coloring = |name: &str| Coloring { name: name.into(), fallback: 0.0, least: self.file.about().facts.min };
        Ok(Depiction { mode, settings, attribute: attribute.map(coloring), choice })
    }

    /// The transfer function that a depiction of it has where none is chosen.
    pub fn usual_transfer(&self, depiction: &Depiction) -> TransferFunction {
        surface::usual_transfer(self.coloured(depiction))
    }

    /// A transfer function as a depiction of it has it.
    pub fn shown_transfer(&self, depiction: &Depiction, transfer: &TransferFunction) -> TransferFunction {
        self.suited_transfer(transfer.clone(), self.coloured(depiction))
    }

    /// A transfer function as an attribute of it has it.
    pub(super) fn suited_transfer(&self, transfer: TransferFunction, attribute: Coloured) -> TransferFunction {
        surface::suited_transfer(transfer, attribute, &self.file.about().grid, self.usual_heights)
    }

    /// The heights that colours are spread over where nothing else is said: without a few that are far from all others, which `reporter` is told once.
    pub(super) fn usual_heights(&self, reporter: &dyn Reporter) -> [f64; 2] {
        let (about, [low, high]) = (self.file.about(), self.usual_heights);
        let [min, max] = [about.facts.min, about.facts.max];
        if [low, high] != [min, max] && !self.has_told_heights.swap(true, Ordering::Relaxed) {
            let shown = |height: f64| stepped(height, 0.01 * (high - low), min.abs().max(max.abs()));
            let [low, high, min, max] = [low, high, min, max].map(shown);
            let (path, beyond) = (self.path.display(), self.beyond().unwrap_or_default());
            reporter.tell(format!(
                "{path}: colours are spread over heights from {low} to {high}, not over all, from {min} to {max} ({beyond}): a transfer function with \
                 a range of its own says otherwise"
            ));
        }
        [low, high]
    }

    /// In words the share of heights that colours are not spread over where nothing else is said; `None` where they are over all.
    pub(super) fn beyond(&self) -> Option<String> {
        let (facts, [low, high]) = (&self.file.about().facts, self.usual_heights);
        let heights = self.coarse.heights();
        let beyond = heights.iter().filter(|height| !(low..=high).contains(*height)).count();
        let percent = 100.0 * beyond as f64 / heights.len().max(1) as f64;
        // Of few the coarse samples may have none.
        let share = if percent < 0.1 { "< 0.1".to_owned() } else { format!("{percent:.1}") };
        ([low, high] != [facts.min, facts.max]).then(|| format!("{share} % beyond"))
    }

    /// What a legend calls the values of a depiction.
    pub fn units(&self, depiction: &Depiction) -> Units {
        let settings = SurfaceSettings::new(&depiction.settings, &self.file.about().grid);
        let (form, map, exaggeration) = settings.map_or((FormKind::Plane, Map::Plate, 1.0), |settings| {
            (settings.form, settings.map, settings.exaggeration)
        });
        self.units_of(self.coloured(depiction), form, map, exaggeration)
    }

    pub(super) fn units_of(&self, attribute: Coloured, form: FormKind, map: Map, exaggeration: f64) -> Units {
        let grid = &self.file.about().grid;
        let named = |name: &str| {
            let name = match attribute {
                Coloured::Residual => format!("{name} from {form}"),
                _ => name.to_owned(),
            };
            // Values are true ones, however high the surface stands.
            if exaggeration == 1.0 { name } else { format!("{name}, drawn {} × as high", quantity(exaggeration)) }
        };
        let plane = |number: usize| match grid.planes.get(number) {
            Some(plane) => Shown::Named(named(&plane.name), Unit::default()),
            None => Shown::Colors,
        };
        let value = match (surface::quantity_of(attribute), attribute) {
            (Some((name, unit)), _) => {
                Shown::Named(named(name), unit.map_or_else(|| grid.height_unit.clone(), Unit::new))
            }
            (None, Coloured::Plane(number)) => plane(number),
            (None, _) => Shown::Colors,
        };
        Units { length: self.length_unit(map), value, ..Units::default() }
    }

    /// A form that is fitted to its samples, once for all pictures; `reporter` is told where these are not all.
    ///
    /// # Errors
    /// Where samples cannot be read, or do not determine the form.
    pub(super) fn fitted(&self, kind: FormKind, reporter: &dyn Reporter) -> Result<FittedForm, PictureError> {
        let mut forms = self.forms.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = forms.iter().find(|known| known.form.kind() == kind) {
            return Ok(known.clone());
        }
        let fitted = fitted(&self.file, kind).map_err(|error| PictureError::of(&self.path, error.to_string()))?;
        if fitted.level > 0 {
            let every = 1_u64 << fitted.level;
            let path = self.path.display();
            let level = fitted.level;
            reporter.tell(format!(
                "{path}: residual: the {kind} is fitted to level {level}, a sample of {every} x {every}"
            ));
        }
        forms.push(fitted.clone());
        Ok(fitted)
    }

    /// The unit of lengths of the world that a map places it in. Bodies are as large as they are in metres where heights have no unit.
    pub fn length_unit(&self, map: Map) -> Unit {
        let grid = &self.file.about().grid;
        match map {
            Map::Plate => grid.xy_unit.clone(),
            Map::Globe(_) | Map::Local { .. } if grid.height_unit.is_unknown() => Unit::new("m"),
            Map::Globe(_) | Map::Local { .. } => grid.height_unit.clone(),
        }
    }

    /// How settings place it in the world.
    ///
    /// # Errors
    /// A map that does not fit it.
    pub fn placed(&self, settings: &Settings) -> Result<Placed, PictureError> {
        let grid = &self.file.about().grid;
        let settings = SurfaceSettings::new(settings, grid).map_err(|why| PictureError::of(&self.path, why))?;
        Ok(Placed::new(grid, settings.map, settings.exaggeration, settings.base))
    }

    /// The box around it as settings place it.
    ///
    /// # Errors
    /// As [`OpenSurface::placed`].
    pub fn bounds(&self, settings: &Settings) -> Result<Bounds, PictureError> {
        let facts = &self.file.about().facts;
        Ok(super::standing::bounds_of(&self.placed(settings)?, [facts.min, facts.max]))
    }

    /// The view that shows all of it, as pictures have it whose camera nobody has placed, and what it looks at.
    ///
    /// # Errors
    /// As [`OpenSurface::placed`], and sizes and fields of view that are none.
    pub fn home(&self, settings: &Settings, fov_deg: f64, size: (u32, u32)) -> Result<(View, DVec3), PictureError> {
        let camera = CameraConfig { fov: Some(fov_deg), ..CameraConfig::default() };
        let shot = Shot { camera, size: Some(size), ..Shot::default() };
        super::standing::view_of(&shot, self.bounds(settings)?, &self.placed(settings)?)
    }

    /// The heights of an even share of its samples, and of its rims.
    pub fn coarse_heights(&self) -> impl Iterator<Item = f64> {
        self.coarse.samples.heights.iter().filter(|height| !height.is_nan())
    }

    /// The height that T has at most about a place, rows and columns with fractions; `None` beside the field, and where nothing was measured
    /// far and wide.
    pub fn most_at(&self, row: f64, column: f64) -> Option<f64> {
        let index = |axis: usize, at: f64| {
            let positions = &self.coarse.positions[axis];
            let is_in = at >= 0.0 && at <= *positions.last()? as f64;
            is_in.then(|| positions.partition_point(|position| *position as f64 <= at).clamp(1, positions.len() - 1))
        };
        let (down, right) = (index(0, row)?, index(1, column)?);
        let samples = &self.coarse.samples;
        let corners = [[1, 1], [1, 0], [0, 1], [0, 0]]
            .map(|[up, left]| samples.heights.at((down - up) * samples.columns + right - left));
        let most = corners.into_iter().filter(|height| !height.is_nan()).reduce(f64::max)?;
        Some(most + self.coarse.delta)
    }

    /// What is added to an eye so that it stands so high above the surface; `None` where it does, or there is no surface that can be read.
    pub fn lift(&self, placed: &Placed, eye: DVec3, clearance: f64) -> Option<DVec3> {
        Ground { heights: &*self.file, placed }.lift(eye, clearance).ok().flatten()
    }

    /// A few of its samples as particles, `most` about: what stands in for it where particles are asked for. The corners of the box around it are
    /// among them.
    pub fn sketch(&self, most: usize) -> Dataset {
        let (coarse, grid) = (&self.coarse, &self.file.about().grid);
        let NodeSamples { rows, columns, heights, .. } = &*coarse.samples;
        let every = (((rows * columns) as f64 / most.max(1) as f64).sqrt().ceil() as usize).max(1);
        // Settings that nobody has touched fit every field.
        let placed = self
            .placed(&Settings::default())
            .unwrap_or_else(|_| Placed::new(grid, crate::cpu::surface::placed::Map::Plate, 1.0, 0.0));
        let bounds = super::standing::bounds_of(&placed, [self.file.about().facts.min, self.file.about().facts.max]);
        let low = self.file.about().facts.min;
        let (mut positions, mut shown) = (vec![bounds.min.to_array(), bounds.max.to_array()], vec![low as f32; 2]);
        for row in (0..*rows).step_by(every) {
            for column in (0..*columns).step_by(every) {
                let height = heights.at(row * columns + column);
                if !height.is_nan() {
                    let [at_row, at_column] = [coarse.positions[0][row], coarse.positions[1][column]];
                    positions.push(placed.world(at_row as f64, at_column as f64, height).to_array());
                    shown.push(height as f32);
                }
            }
        }
        let apart = bounds.size().length() / (positions.len() as f64).sqrt();
        let family = Family {
            name: FamilyName::Gas,
            mass: vec![1.0; positions.len()],
            smoothing_length: vec![(2.0 * apart).max(1e-30) as f32; positions.len()],
            density: vec![1.0; positions.len()],
            attributes: vec![Attribute { name: "height".into(), unit: grid.height_unit.clone(), values: shown }],
            positions,
        };
        Dataset {
            families: vec![family],
            length_unit: grid.xy_unit.clone(),
            mass_unit: Unit::default(),
            kernel: Kernel::default(),
            skipped: Vec::new(),
            provenance: Provenance { path: self.path.clone(), format: "heights".into(), ..Provenance::default() },
        }
    }

    /// What is under a pixel of a flat picture, and where that is in the world. `None` where nothing can be seen.
    ///
    /// # Errors
    /// When the field cannot be read.
    pub fn pick(
        &self,
        placed: &Placed,
        sight: &Sight,
        pixel: [f64; 2],
    ) -> Result<Option<(Pick, Option<DVec3>)>, PictureError> {
        let Some((origin, direction)) = sight.ray(pixel) else { return Ok(None) };
        let (origin, direction) = placed.in_file(origin, direction);
        let ray = Ray::new(origin.to_array(), direction.to_array());
        let told = |error: HeightError| PictureError::of(&self.path, error.to_string());
        let found = pick_all(&self.path, &*self.file, Some(&self.file), &placed.stands(), &[ray]).map_err(told)?;
        Ok(found.into_iter().next().map(|pick| {
            let place = match &pick {
                Pick::Hit(hit) => Some(placed.world(hit.row, hit.column, hit.height)),
                Pick::NotMeasured { .. } | Pick::Beside => None,
            };
            (pick, place)
        }))
    }
}
