//! What settings and a transfer function come to for a volume: how it is sampled, its tables, its surfaces and its light.

use super::Layers;
use super::settings::{
    AMBIENT, FAR, ISO_COLORS, ISO_OPACITIES, ISOVALUES, KERNEL, LAMBDA, LIGHTING, NEAR, OCCLUSION, OPACITY, RESOLUTION,
    SHININESS, SLAB_MEMORY, SMALLEST_CELLS, SPECULAR, SURFACE_SMOOTHING, TERMINATION, VOLUME_LIGHTING,
};
use crate::color::colors::to_linear;
use crate::color::transfer::{Range, TransferFunction, UnitLength};
use crate::cpu::volume::{
    Classifier, FieldRange, Light, Scenery, Supply, Surface, VolumeError, VolumeLevels, VolumeOptions, range,
};
use crate::mode::{Job, Setting, Settings, Terms};
use crate::model::Kernel;
use crate::view::perspective_grid::GridOptions;

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
    pub(super) fn of_supplied<'a>(job: &Job<'a>, supply: &mut dyn Supply) -> Result<(Terms<'a>, Look), VolumeError> {
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
