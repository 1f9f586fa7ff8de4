//! What the modes of the perspective grid (F12 chapter 5) share: their settings, and how these become a picture.

use super::samples;
use super::shadowing;
use super::volume_fields::{self, VolumeFields};
use crate::color::colors::to_linear;
use crate::color::transfer::{Range, TransferFunction, UnitLength};
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Casters, Lighting, Shadowing};
use crate::cpu::volume::particles::SMALLEST;
use crate::cpu::volume::{
    self, Classifier, FieldRange, Light, Scenery, Supply, Surface, VolumeError, VolumeLevels, VolumeOptions, range,
};
use crate::hierarchy::Purpose;
use crate::mode::{
    Adapter, Columns, Conserved, FieldJob, FieldPasses, FindRanges, InView, Job, LightPasses, LightPicture, LightPlan,
    Mode, Needs, Output, Raw, Setting, SettingKind, Settings, Technique, Terms,
};
use crate::model::{Bounds, Kernel, Unit};
use crate::view::perspective_grid::GridOptions;
use crate::view::{Detail, PerspectiveGrid, View};
use glam::DVec3;

/// Cells per pixel.
pub static RESOLUTION: Setting = Setting {
    name: "resolution",
    unit: "cells/px",
    kind: SettingKind::Number { min: 0.1, max: 2.0, default: 1.0 },
    help: "resolution of the grid: 1 is that of the picture; 0.5 costs an eighth of the cells",
};
/// How wide the cells of merged particles may be.
pub static DETAIL: Setting = Setting {
    name: "detail",
    unit: "cells",
    kind: SettingKind::Number { min: 0.0, max: 16.0, default: 1.0 },
    help: "merged particles stand for what lies within so many cells of the grid (F12 5.5.2), in files with levels for volumes; \
           smaller is finer, 0: source particles only",
};
/// Whether slices are as dense on the edges as in the middle.
pub static LAMBDA: Setting = Setting {
    name: "lambda",
    unit: "",
    kind: SettingKind::Flag { default: true },
    help: "slices are so dense that rays at the picture's corners are sampled as finely as the middle one (F12 5.4)",
};
/// Memory for the cells of a slab.
pub static SLAB_MEMORY: Setting = Setting {
    name: "slab-memory",
    unit: "MiB",
    kind: SettingKind::Number { min: 1.0, max: 65_536.0, default: 256.0 },
    help: "memory for the part of the grid that is resampled at once; decides how thick slabs are, not what is seen",
};
/// Depth of the near plane.
pub static NEAR: Setting = Setting {
    name: "near",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "depth where the volume begins, in the data's length unit; 0: in front of the data",
};
/// Depth of the far plane.
pub static FAR: Setting = Setting {
    name: "far",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "depth where the volume ends, in the data's length unit; 0: behind the data",
};
/// Opacity at which rays end.
pub static TERMINATION: Setting = Setting {
    name: "termination",
    unit: "",
    kind: SettingKind::Number { min: 0.5, max: 1.0, default: 0.999 },
    help: "rays end when they are as opaque",
};
/// Whether hidden bricks are left out.
pub static OCCLUSION: Setting = Setting {
    name: "occlusion",
    unit: "",
    kind: SettingKind::Flag { default: true },
    help: "what lies behind opaque pixels is left out; off only to measure what that saves",
};
/// Least size of particles.
pub static SMALLEST_CELLS: Setting = Setting {
    name: "smallest",
    unit: "cells",
    kind: SettingKind::Number { min: 0.0, max: 8.0, default: SMALLEST },
    help: "least smoothing length: smaller particles are enlarged to it, with their mass (F12 5.5); 0: none",
};
/// The data's own kernel, and those of [`Kernel::ALL`] by name.
const KERNELS: &[&str] = &{
    let mut names = ["data"; Kernel::ALL.len() + 1];
    let mut index = 0;
    while index < Kernel::ALL.len() {
        names[index + 1] = Kernel::ALL[index].name();
        index += 1;
    }
    names
};
/// The kernel.
pub static KERNEL: Setting = Setting {
    name: "kernel",
    unit: "",
    kind: SettingKind::Choice { options: KERNELS },
    help: "the kernel that densities are summed with: the data's own, or another",
};
/// What all modes of volumes share; each has its own name, help, settings and technique. Particles weigh their mass, so that their
/// sum with the kernel is the density.
pub const MODE: Mode = Mode {
    name: "",
    help: "",
    settings: &[],
    technique: &Marched(Layers::VOLUME),
    quantity: "density",
    unit: density_unit,
    weight: masses,
    conserves: Conserved::Mass,
    usual_attributes: &[],
    weight_attributes: &[],
    transfer: ["volume", "volume-hue"],
};
/// Factor on the extinction.
pub static OPACITY: Setting = Setting {
    name: "opacity",
    unit: "",
    kind: SettingKind::Number { min: 0.001, max: 2000.0, default: 1.0 },
    help: "how opaque the volume is: 2 is twice as much matter",
};
/// Whose values a volume shows.
pub static FIELD: Setting = Setting {
    name: "field",
    unit: "",
    kind: SettingKind::Column { default: volume_fields::DENSITY },
    help: "what the volume shows of particles, and the transfer function's range is of: their density, or an attribute between them",
};
/// Densities of the surfaces.
pub static ISOVALUES: Setting = Setting {
    name: "isovalues",
    unit: "",
    kind: SettingKind::Numbers { min: -1e38, max: 1e38, most: volume::surface::MOST_SURFACES },
    help: "densities of the isosurfaces (values of another surface-field, of images and volumes), in the data's units; without any they are \
           chosen from the data",
};
/// Their opacities.
pub static ISO_OPACITIES: Setting = Setting {
    name: "iso-opacities",
    unit: "",
    kind: SettingKind::Numbers { min: 0.0, max: 1.0, most: volume::surface::MOST_SURFACES },
    help: "opacity of each isosurface; without any the densest is opaque and the others are not",
};
/// Their colours.
pub static ISO_COLORS: Setting = Setting {
    name: "iso-colors",
    unit: "",
    kind: SettingKind::Colors { most: volume::surface::MOST_SURFACES },
    help: "colour of each isosurface; without any the attribute's, or the colour map's at its density",
};
/// Whether surfaces are lit.
pub static LIGHTING: Setting = Setting {
    name: "lighting",
    unit: "",
    kind: SettingKind::Flag { default: true },
    help: "isosurfaces are lit by a lamp at the eye",
};
/// Smoothing of surfaces.
pub static SURFACE_SMOOTHING: Setting = Setting {
    name: "surface-smoothing",
    unit: "steps",
    kind: SettingKind::Number { min: 0.0, max: 200.0, default: 0.0 },
    help: "the light on the surface that adds most to a pixel follows the larger forms: directions flow to those around up to silhouettes (F12 5.11); not with shadows or ambient occlusion, nor of sampled volumes among other data",
};
/// Whether the volume itself is lit.
pub static VOLUME_LIGHTING: Setting = Setting {
    name: "volume-lighting",
    unit: "",
    kind: SettingKind::Flag { default: false },
    help: "the volume itself is lit by a lamp at the eye, by the gradients of its values (F12 5.6)",
};
/// Light from everywhere.
pub static AMBIENT: Setting = Setting {
    name: "ambient",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.12 },
    help: "share of a lit colour that is seen without light",
};
/// The highlight.
pub static SPECULAR: Setting = Setting {
    name: "specular",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.15 },
    help: "strength of the highlight where surfaces and gradients face the eye",
};
/// The highlight's exponent.
pub static SHININESS: Setting = Setting {
    name: "shininess",
    unit: "",
    kind: SettingKind::Number { min: 1.0, max: 500.0, default: 40.0 },
    help: "how narrow the highlight is",
};

/// Where a volume begins and ends, where rays end, and what is summed: every mode that draws a volume has these.
pub static COMMON: &[&Setting] = &[&NEAR, &FAR, &TERMINATION, &SMALLEST_CELLS, &KERNEL];
/// How the perspective grid is laid and held.
pub static GRID: &[&Setting] = &[&RESOLUTION, &DETAIL, &LAMBDA, &SLAB_MEMORY, &OCCLUSION];
/// The isosurfaces.
pub static SURFACES: &[&Setting] = &[&ISOVALUES, &ISO_OPACITIES, &ISO_COLORS];
/// The light on surfaces.
pub static LIGHT: &[&Setting] = &[&LIGHTING, &AMBIENT, &SPECULAR, &SHININESS];
/// The light in a volume without surfaces.
pub static LIGHT_OF_VOLUME: &[&Setting] = &[&VOLUME_LIGHTING, &AMBIENT, &SPECULAR, &SHININESS];

/// What is drawn of a volume.
#[derive(Clone, Copy, Debug)]
pub struct Layers {
    /// The volume itself.
    pub volume: bool,
    /// Isosurfaces: places in the logarithmic range of densities where they are unless set, and their opacities.
    pub surfaces: &'static [(f32, f32)],
}

impl Layers {
    /// The volume alone.
    pub const VOLUME: Layers = Layers { volume: true, surfaces: &[] };
    /// Surfaces alone.
    pub const SURFACES: Layers = Layers { volume: false, surfaces: &[(0.3, 0.22), (0.62, 0.4), (0.9, 1.0)] };
    /// Surfaces in the volume.
    pub const BOTH: Layers = Layers { volume: true, surfaces: &[(0.55, 0.25), (0.9, 0.9)] };
}

/// The unit of densities.
pub fn density_unit(mass: &Unit, length: &Unit) -> Unit {
    match mass.is_unknown() || length.is_unknown() {
        true => Unit::default(),
        false => Unit::new(format!("{mass} / ({length})^3")),
    }
}

/// Masses: what densities are sums of.
pub fn masses(columns: &Columns<'_>) -> Vec<f32> {
    columns.mass.to_vec()
}

/// What every picture of a volume is made with.
pub struct Look {
    /// How the field is sampled.
    pub options: VolumeOptions,
    /// The transfer function in use.
    pub transfer: TransferFunction,
    /// Numbers for its ranges.
    pub levels: VolumeLevels,
    /// Its tables for these ranges.
    pub classifier: Classifier,
}

impl Look {
    /// What the settings and the transfer function come to for the particles in view.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the data or each other, and when nothing is in view.
    pub fn new(job: &Job<'_>) -> Result<Look, VolumeError> {
        Look::of(&job.terms(), |options| range::measure(job.view, job.batches, options))
    }

    /// The same where `measure` finds ranges of the field.
    ///
    /// # Errors
    /// As [`Look::new`].
    pub fn of(
        terms: &Terms<'_>,
        measure: impl FnMut(&VolumeOptions) -> Result<FieldRange, VolumeError>,
    ) -> Result<Look, VolumeError> {
        let options = options(terms.settings, terms.kernel);
        let attribute = terms.attribute;
        let transfer = terms.transfer.cloned().unwrap_or_else(|| TransferFunction::of_volumes(attribute)).for_volume();
        let levels = levels(terms, &transfer, &options, measure)?;
        let classifier = Classifier::new(&transfer, levels, attribute);
        Ok(Look { options, transfer, levels, classifier })
    }

    /// The same of particles that are not all there at once, which are no batches of the job; with what else the picture depends on.
    fn of_supplied<'a>(job: &Job<'a>, supply: &mut dyn Supply) -> Result<(Terms<'a>, Look), VolumeError> {
        let terms = Terms { attribute: supply.has_attribute(), ..job.terms() };
        let look = Look::of(&terms, |options| range::measure_supplied(job.view, supply, options))?;
        Ok((terms, look))
    }

    /// The density at a place of the range, 0 to 1.
    pub fn density_at(&self, place: f32) -> f64 {
        let [min, max] = self.levels.density;
        min * (max / min).powf(f64::from(place))
    }

    /// The colour map's colour of a surface at a density, linear light. The map's dark end is no colour for a surface.
    pub fn surface_color(&self, gradient: &[[f32; 3]], density: f64) -> [f32; 3] {
        let [min, max] = self.levels.density;
        color_at(gradient, ((density / min).ln() / (max / min).ln()).clamp(0.0, 1.0))
    }

    /// What is drawn, and the isosurfaces' densities.
    ///
    /// # Errors
    /// [`VolumeError`] for surfaces that cannot be there, and lists that do not fit each other.
    pub fn scenery(&self, terms: &Terms<'_>, layers: Layers) -> Result<(Scenery, Vec<f64>), VolumeError> {
        let settings = terms.settings;
        let isovalues = settings.numbers(&ISOVALUES);
        check_densities(isovalues, terms.densest)?;
        let chosen: Vec<f64> = match isovalues {
            _ if layers.surfaces.is_empty() => Vec::new(),
            [] => layers.surfaces.iter().map(|&(place, _)| self.density_at(place)).collect(),
            set => set.to_vec(),
        };
        let gradient = self.transfer.color_map.sample(256);
        let color = |value: f64| self.surface_color(&gradient, value);
        let scenery = Scenery {
            classifier: self.classifier.clone(),
            volume: layers.volume,
            surfaces: surfaces(settings, &chosen, &layers, self.classifier.has_hues(), color)?,
            light: light(settings),
            volume_light: volume_light(settings),
            termination: settings.number(&TERMINATION) as f32,
        };
        Ok((scenery, chosen))
    }
}

/// The colour of a colour map, of which there are some, for a surface at a place of its range, linear light. The map's dark end is none.
pub fn color_at(gradient: &[[f32; 3]], place: f64) -> [f32; 3] {
    let index = (55.0 + 200.0 * place) / 255.0 * gradient.len().saturating_sub(1) as f64;
    gradient.get(index.round() as usize).map_or([1.0; 3], |color| color.map(to_linear))
}

/// Whether there are surfaces of densities at these values.
///
/// # Errors
/// [`VolumeError::IsoValue`] for the first at which there can be none.
pub fn check_densities(isovalues: &[f64], largest: f64) -> Result<(), VolumeError> {
    let is_possible = |value: f64| value > 0.0 && value <= largest;
    match isovalues.iter().enumerate().find(|(_, value)| !is_possible(**value)) {
        Some((index, &value)) => Err(VolumeError::IsoValue { index, value, largest }),
        None => Ok(()),
    }
}

/// Isosurfaces of these values with the colours and opacities that settings say; `color` is that of a value where they say nothing and
/// no `hues` of an attribute do.
///
/// # Errors
/// [`VolumeError::Setting`] for lists that do not fit each other.
pub fn surfaces(
    settings: &Settings,
    isovalues: &[f64],
    layers: &Layers,
    hues: bool,
    color: impl Fn(f64) -> [f32; 3],
) -> Result<Vec<Surface>, VolumeError> {
    let (opacities, colors) = (settings.numbers(&ISO_OPACITIES), settings.colors(&ISO_COLORS));
    for (field, found) in [("iso-opacities", opacities.len()), ("iso-colors", colors.len())] {
        if found > 0 && found != isovalues.len() {
            let expected = format!("as many as isovalues, {}", isovalues.len());
            return Err(VolumeError::Setting { field, found: format!("a list of {found}"), expected });
        }
    }
    let highest = isovalues.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let surface = |(index, &value): (usize, &f64)| {
        let usual = match layers.surfaces.get(index).filter(|_| settings.numbers(&ISOVALUES).is_empty()) {
            Some(&(_, opacity)) => opacity,
            None if value >= highest => 1.0,
            None => 0.3,
        };
        Surface {
            value: value as f32,
            color: colors.get(index).map(|color| color.map(to_linear)).or_else(|| (!hues).then(|| color(value))),
            opacity: opacities.get(index).map_or(usual, |&opacity| opacity as f32),
        }
    };
    Ok(isovalues.iter().enumerate().map(surface).collect())
}

/// The light on surfaces; `None` where they are not lit.
pub fn light(settings: &Settings) -> Option<Light> {
    settings.flag(&LIGHTING).then(|| lamp(settings))
}

/// The light in the volume itself; `None` where it is not lit.
pub fn volume_light(settings: &Settings) -> Option<Light> {
    settings.flag(&VOLUME_LIGHTING).then(|| lamp(settings))
}

fn lamp(settings: &Settings) -> Light {
    Light {
        ambient: settings.number(&AMBIENT) as f32,
        specular: settings.number(&SPECULAR) as f32,
        shininess: settings.number(&SHININESS) as f32,
    }
}

/// The detail in which the nodes of data within these bounds are drawn. An automatic near plane is not known before nodes
/// are selected: it is taken to be where it is for data of which all is in view.
fn sampling(view: &View, settings: &Settings, bounds: Bounds) -> Detail {
    let corner = |index: usize| {
        let pick = |axis: usize| if index >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
        view.to_camera(DVec3::new(pick(0), pick(1), pick(2))).z
    };
    let far = (0..8).map(corner).fold(0.0, f64::max);
    let near = match settings.number(&NEAR) {
        near if near > 0.0 => near,
        _ => PerspectiveGrid::NEAREST * far,
    };
    let sigma = PerspectiveGrid::sigma_of(view, settings.number(&RESOLUTION));
    Detail::Sampling { sigma: settings.number(&DETAIL) * sigma, near }
}

/// Layers of a volume, by marching along rays through the perspective grid.
pub struct Marched(pub Layers);

impl Marched {
    /// How its surfaces darken each other in a view of data of this diameter; `None` where they do not.
    fn shadowing(&self, settings: &Settings, view: &View, lighting: &Lighting<'_>, diameter: f64) -> Option<Shadowing> {
        match self.0.surfaces {
            [] => None,
            _ => {
                let own = shadowing::beside_eye(settings, view, lighting, diameter);
                own.map(|shadowing| Shadowing { is_costly: true, ..shadowing })
            }
        }
    }

    fn field_shadowing(&self, job: &FieldJob<'_>) -> Option<Shadowing> {
        self.shadowing(job.settings, job.view, &job.lighting, job.diameter)
    }
}

/// How what is marched of a job's particles hides light.
fn casters<'j>(job: &'j Job<'j>, scenery: &Scenery, options: VolumeOptions) -> Box<Casters<'j>> {
    shadowing::casters_of(scenery, move |from: &View, casting: &Scenery| {
        volume::draw_in_parts(from, job.batches, casting, &options.seen_from(from == job.view))
    })
}

impl Technique for Marched {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, settings: &Settings) -> Needs {
        let steps = settings.number(&SURFACE_SMOOTHING).round() as u32;
        let margin_px = Needs::default().margin_px.max(volume::smoothing::reach(steps));
        let own = Needs { purpose: Purpose::Samples, slices: true, margin_px, hides: true, ..Needs::default() };
        shadowing::needs(own, settings)
    }

    fn is_processors(&self, settings: &Settings) -> bool {
        !self.0.surfaces.is_empty() && shadowing::is_on(settings)
    }

    fn detail(&self, view: &View, settings: &Settings, bounds: Bounds, _: f64) -> Detail {
        sampling(view, settings, bounds)
    }

    fn takes_clusters(&self) -> bool {
        true
    }

    fn fields(&self, settings: &Settings) -> Vec<String> {
        volume_fields::names(settings, &self.0)
    }

    fn adapter(&self) -> Adapter {
        Adapter::Light
    }

    fn own_levels(&self, job: &Job<'_>) -> Option<VolumeLevels> {
        let names = self.fields(job.settings);
        let fields = || VolumeFields::new(job, &self.0, &names).ok();
        (!names.is_empty()).then(fields).flatten().map(|fields| fields.levels)
    }

    fn looks_in_view(&self, settings: &Settings, transfer: &TransferFunction) -> bool {
        let names = self.fields(settings);
        // The transfer function has a range for the first one alone.
        !names.is_empty() && (names.len() > 1 || transfer.numbers().is_none())
    }

    fn in_view(&self, job: &Job<'_>) -> Result<Option<InView>, VolumeError> {
        let names = self.fields(job.settings);
        (!names.is_empty()).then(|| volume_fields::in_view(job, &names)).transpose()
    }

    fn takes_paths(&self) -> bool {
        true
    }

    fn light(&self, terms: &Terms<'_>, ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        if !self.fields(terms.settings).is_empty() {
            return Ok(None);
        }
        let look = Look::of(terms, ranges)?;
        let (scenery, isovalues) = look.scenery(terms, self.0)?;
        Ok(Some(LightPlan { passes: LightPasses::March(scenery, look.options), levels: look.levels, isovalues }))
    }

    fn light_of_fields(&self, job: &Job<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let names = self.fields(job.settings);
        if names.is_empty() {
            return Ok(None);
        }
        Ok(Some(VolumeFields::new(job, &self.0, &names)?.plan()))
    }

    fn field_dimensions(&self) -> &'static [usize] {
        &[3]
    }

    fn has_field_passes(&self) -> bool {
        true
    }

    fn field_passes(&self, job: &FieldJob<'_>) -> Result<Option<FieldPasses>, VolumeError> {
        Ok(Some(FieldPasses::March(Box::new(samples::plan(job, &self.0)?))))
    }

    fn draw_field(&self, job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        Ok(Raw::Light(match self.field_shadowing(job) {
            Some(shadowing) => samples::march_darkened(job, &self.0, &shadowing)?,
            None => samples::march(job, &self.0)?,
        }))
    }

    fn has_field_parts(&self) -> bool {
        true
    }

    fn field_parts(&self, job: &FieldJob<'_>) -> Result<PathFragments, VolumeError> {
        samples::march_in_parts(job, &self.0, self.field_shadowing(job).as_ref())
    }

    fn field_casters<'j>(&'j self, job: &'j FieldJob<'j>) -> Result<Option<Box<Casters<'j>>>, VolumeError> {
        Ok((!self.0.surfaces.is_empty()).then(|| samples::casters(job, &self.0)))
    }

    fn casters<'j>(&'j self, job: &'j Job<'j>) -> Result<Option<Box<Casters<'j>>>, VolumeError> {
        if self.0.surfaces.is_empty() {
            return Ok(None);
        }
        let names = self.fields(job.settings);
        if !names.is_empty() {
            return Ok(Some(VolumeFields::new(job, &self.0, &names)?.casters(job)));
        }
        let look = Look::new(job)?;
        let (scenery, _) = look.scenery(&job.terms(), self.0)?;
        Ok(Some(casters(job, &scenery, look.options)))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let names = self.fields(job.settings);
        let shadowing = self.shadowing(job.settings, job.view, &job.lighting, job.diameter);
        if !names.is_empty() {
            let fields = VolumeFields::new(job, &self.0, &names)?;
            return Ok(Raw::Light(match shadowing {
                Some(shadowing) => fields.draw_darkened(job, &shadowing),
                None => fields.draw(job),
            }));
        }
        let look = Look::new(job)?;
        let (scenery, isovalues) = look.scenery(&job.terms(), self.0)?;
        let (colors, report) = match shadowing {
            Some(shadowing) => {
                let (mut parts, report) = volume::draw_in_parts(job.view, job.batches, &scenery, &look.options)?;
                let (casters, others) = (casters(job, &scenery, look.options), job.lighting.others.as_ref());
                shadowing.darken_fragments(job.view, &mut parts, &*casters, others);
                (shadowing::colors_among(&parts, job.paths), report)
            }
            None => volume::draw_with_paths(job.view, job.batches, &scenery, &look.options, job.paths)?,
        };
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues }))
    }

    fn takes_supply(&self, settings: &Settings) -> bool {
        self.0.surfaces.is_empty() || !shadowing::is_on(settings)
    }

    fn draw_supplied(&self, job: &Job<'_>, supply: &mut dyn Supply) -> Result<Raw, VolumeError> {
        let names = self.fields(job.settings);
        if !names.is_empty() {
            let fields = VolumeFields::of_supplied(job, supply, &self.0, &names)?;
            return Ok(Raw::Light(fields.draw_supplied(job.view, supply)));
        }
        let (terms, look) = Look::of_supplied(job, supply)?;
        let (scenery, isovalues) = look.scenery(&terms, self.0)?;
        let (colors, report) = volume::supply::draw(job.view, supply, &scenery, &look.options)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues }))
    }

    fn supplied_levels(&self, job: &Job<'_>, supply: &mut dyn Supply) -> Result<Option<VolumeLevels>, VolumeError> {
        let names = self.fields(job.settings);
        if !names.is_empty() {
            return VolumeFields::of_supplied(job, supply, &self.0, &names).map(|fields| Some(fields.levels));
        }
        Look::of_supplied(job, supply).map(|(_, look)| Some(look.levels))
    }
}

/// How a volume is sampled; `kernel` is the data's own.
pub fn options(settings: &Settings, kernel: Kernel) -> VolumeOptions {
    let plane = |setting: &Setting| Some(settings.number(setting)).filter(|&depth| depth > 0.0);
    let kernel = Kernel::of_name(settings.name(&KERNEL).as_str()).unwrap_or(kernel);
    VolumeOptions {
        grid: GridOptions { resolution: settings.number(&RESOLUTION), lambda: settings.flag(&LAMBDA) },
        near: plane(&NEAR),
        far: plane(&FAR),
        memory: (settings.number(&SLAB_MEMORY) * f64::from(1 << 20)) as u64,
        smallest: settings.number(&SMALLEST_CELLS),
        occlusion: settings.flag(&OCCLUSION),
        kernel,
        smoothing: settings.number(&SURFACE_SMOOTHING).round() as u32,
    }
}

/// Numbers for the ranges that are automatic.
fn levels(
    terms: &Terms<'_>,
    transfer: &TransferFunction,
    options: &VolumeOptions,
    mut measure: impl FnMut(&VolumeOptions) -> Result<FieldRange, VolumeError>,
) -> Result<VolumeLevels, VolumeError> {
    let hue = transfer.hue.clone().unwrap_or_default();
    let needs = transfer.range == Range::Auto || transfer.hue.as_ref().is_some_and(|hue| hue.range == Range::Auto);
    let measured = match needs {
        true => Some(measure(options)?),
        false => None,
    };
    let fixed = |range: Range, measured: Option<[f64; 2]>| match range {
        Range::Fixed(min, max) => [min, max],
        Range::Auto => measured.unwrap_or([0.0, 1.0]),
    };
    let density = fixed(transfer.range, measured.map(|range| range.density));
    if !(density[0] > 0.0 && density[0] < density[1]) {
        return Err(VolumeError::Setting {
            field: "range",
            found: format!("from {} to {}", density[0], density[1]),
            expected: "two positive densities in ascending order".into(),
        });
    }
    let unit = match transfer.unit_length {
        UnitLength::Auto => 0.01 * terms.diameter,
        UnitLength::Fixed(length) => length,
    };
    let attribute = hue.scale.usable(fixed(hue.range, measured.map(|range| Range::apart(range.attribute))));
    let unit_length = unit.max(1e-30) / terms.settings.number(&OPACITY);
    Ok(VolumeLevels { density, attribute, unit_length })
}
