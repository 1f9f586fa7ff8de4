//! What settings come to where a volume or its surfaces are of the particles' attributes, not of their density alone
//! ([`crate::cpu::volume::attributes`]).

use super::grid::{self, FIELD, FIELD_SUM, ISOVALUES, Layers, OPACITY, SURFACE_FIELD, TERMINATION};
use crate::color::transfer::{Range, Scale, TransferFunction, UnitLength};
use crate::cpu::field::ValueAxis;
use crate::cpu::volume::attributes::{Column, Columns, Reading, Shown};
use crate::cpu::volume::{Classifier, Scenery, VolumeError, VolumeLevels, VolumeOptions};
use crate::mode::{Job, LightPicture, Settings};

/// The name of densities among columns.
pub const DENSITY: &str = "density";
/// The choice of F12's sum as it is.
pub const PLAIN: &str = "plain";

/// The columns whose fields layers are of, the volume's first; none where all are of the density, which needs no column.
pub fn names(settings: &Settings, layers: &Layers) -> Vec<String> {
    let drawn = [(&FIELD, layers.volume), (&SURFACE_FIELD, !layers.surfaces.is_empty())];
    let mut names: Vec<String> =
        drawn.into_iter().filter(|(_, is_drawn)| *is_drawn).map(|(setting, _)| settings.name(setting)).collect();
    names.dedup();
    if names == [DENSITY] { Vec::new() } else { names }
}

/// What a picture of fields is made of.
pub struct VolumeFields {
    columns: Columns,
    shown: Shown,
    scenery: Scenery,
    options: VolumeOptions,
    /// The ranges of the colours, of values of the volume's field in place of densities.
    pub levels: VolumeLevels,
    isovalues: Vec<f64>,
}

/// Values that a field is spread over.
#[derive(Clone, Copy)]
struct Spread {
    scale: Scale,
    range: [f64; 2],
}

impl Spread {
    /// An axis for them and some others, and a little beyond: what lies there is cut off where it does not show.
    fn axis(&self, others: &[f64]) -> ValueAxis {
        let with = |[low, high]: [f64; 2], value: &f64| [low.min(*value), high.max(*value)];
        let ends = self.scale.usable(others.iter().fold(self.range, with));
        ValueAxis::new(self.scale, [-0.02, 1.02].map(|place| self.scale.value(place, ends)))
    }
}

impl VolumeFields {
    /// What the settings and the transfer function come to for layers of fields of these columns.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the data or each other, for automatic ranges of panoramas, and when nothing is in view.
    pub fn new(job: &Job<'_>, layers: &Layers, names: &[String]) -> Result<VolumeFields, VolumeError> {
        let (terms, settings) = (job.terms(), job.settings);
        // Each face of a panorama would find numbers of its own.
        let alike = |field: &'static str, found: &str, expected: &str| match job.around {
            Some(_) => {
                Err(VolumeError::Setting { field, found: found.into(), expected: format!("{expected} in panoramas") })
            }
            None => Ok(()),
        };
        let options = grid::options(settings, terms.kernel);
        let usual = || TransferFunction::of_volumes(terms.attribute);
        let mut transfer = terms.transfer.cloned().unwrap_or_else(usual).for_volume();
        let has_hue = terms.attribute && transfer.hue.is_some();
        let hue_column = has_hue.then_some(Column::Attribute);
        let wanted: Vec<Column> = (0..names.len()).map(Column::Field).chain(hue_column).collect();
        let columns = Columns::prepare(job.view, job.batches, &wanted, &options)?;
        let is_density = |index: usize| names[index] == DENSITY;
        let measured = |index: usize| match is_density(index) {
            true => columns.range(index, true),
            false => columns.range(index, false).map(Range::apart),
        };

        let range = match transfer.range {
            Range::Fixed(low, high) => [low, high],
            Range::Auto => {
                alike("range", "auto", "numbers for other fields than the density")?;
                measured(0)?
            }
        };
        if range[0] < 0.0 {
            // A logarithm is no scale for them.
            transfer.scale = Scale::Linear;
        }
        let of_volume = Spread { scale: transfer.scale, range: transfer.scale.usable(range) };
        let own = names.len() - 1;
        let of_surfaces = match own {
            0 => of_volume,
            _ => {
                alike(SURFACE_FIELD.name, &names[own], "the same as field")?;
                let range = measured(own)?;
                let scale = if range[0] > 0.0 { Scale::Log } else { Scale::Linear };
                Spread { scale, range: scale.usable(range) }
            }
        };
        let isovalues: Vec<f64> = match settings.numbers(&ISOVALUES) {
            _ if layers.surfaces.is_empty() => Vec::new(),
            [] => layers.surfaces.iter().map(|&(place, _)| of_surfaces.scale.value(place, of_surfaces.range)).collect(),
            set => set.to_vec(),
        };
        if is_density(own) && !layers.surfaces.is_empty() {
            grid::check_densities(settings.numbers(&ISOVALUES), terms.densest)?;
        }

        let is_plain = settings.name(&FIELD_SUM) == PLAIN;
        let reading = |index: usize, spread: Spread, others: &[f64]| match (is_density(index), is_plain) {
            (true, _) => Reading::Density,
            (false, true) => Reading::Sum(spread.axis(others)),
            (false, false) => Reading::Mean(spread.axis(others)),
        };
        let of_both: &[f64] = if own == 0 { &isovalues } else { &[] };
        let shown = Shown {
            volume: reading(0, of_volume, of_both),
            surface: (own > 0).then(|| reading(own, of_surfaces, &isovalues)),
            has_hue,
        };
        let hue = transfer.hue.clone().unwrap_or_default();
        let attribute = match hue.range {
            Range::Fixed(low, high) => [low, high],
            Range::Auto if has_hue => {
                alike("hue: range", "auto", "numbers for other fields than the density")?;
                Range::apart(columns.range(names.len(), false)?)
            }
            Range::Auto => [0.0, 1.0],
        };
        let unit = match transfer.unit_length {
            UnitLength::Auto => 0.01 * terms.diameter,
            UnitLength::Fixed(length) => length,
        };
        let unit_length = unit.max(1e-30) / settings.number(&OPACITY);
        let levels = VolumeLevels { density: of_volume.range, attribute: hue.scale.usable(attribute), unit_length };
        let classifier = match shown.volume.axis() {
            None => Classifier::new(&transfer, levels, has_hue),
            Some(axis) => Classifier::of_values(&transfer, levels, has_hue, axis),
        };
        let gradient = transfer.color_map.sample(256);
        let color =
            |value: f64| grid::color_at(&gradient, f64::from(of_surfaces.scale.place(value as f32, of_surfaces.range)));
        let mut surfaces = grid::surfaces(settings, &isovalues, layers, classifier.has_hues(), color)?;
        if let Some(axis) = shown.surface.unwrap_or(shown.volume).axis() {
            surfaces.iter_mut().for_each(|surface| surface.value = axis.place(surface.value));
        }
        let scenery = Scenery {
            classifier,
            volume: layers.volume,
            surfaces,
            light: grid::light(settings),
            volume_light: grid::volume_light(settings),
            termination: settings.number(&TERMINATION) as f32,
        };
        Ok(VolumeFields { columns, shown, scenery, options, levels, isovalues })
    }

    /// Draws it, with the paths among it that the job has.
    pub fn draw(self, job: &Job<'_>) -> LightPicture {
        let VolumeFields { columns, shown, scenery, options, levels, isovalues } = self;
        let (colors, report) = columns.draw(job.view, &shown, &scenery, &options, job.paths);
        LightPicture { colors, report, levels, isovalues }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::SettingValue;
    use crate::modes::{isosurface, volume, volume_isosurface};

    #[test]
    fn columns_are_those_of_the_layers_that_are_drawn() {
        let of = |mode: &crate::mode::Mode, set: &[(&str, &str)]| {
            let name = |(setting, name): &(&str, &str)| ((*setting).into(), SettingValue::Name((*name).into()));
            mode.technique.fields(&Settings(set.iter().map(name).collect()))
        };
        let (heat, metal) = (("surface-field", "temperature"), ("field", "metallicity"));
        for mode in [&volume::MODE, &isosurface::MODE, &volume_isosurface::MODE] {
            assert!(
                of(mode, &[]).is_empty() && of(mode, &[("field", "density"), ("surface-field", "density")]).is_empty()
            );
        }
        assert_eq!(of(&volume::MODE, &[metal]), ["metallicity"]);
        assert_eq!(of(&isosurface::MODE, &[heat]), ["temperature"]);
        assert_eq!(of(&volume_isosurface::MODE, &[metal]), ["metallicity", "density"]);
        assert_eq!(of(&volume_isosurface::MODE, &[heat]), ["density", "temperature"]);
        assert_eq!(of(&volume_isosurface::MODE, &[heat, ("field", "temperature")]), ["temperature"]);
    }

    #[test]
    fn axes_hold_more_than_what_is_spread() {
        for (scale, range) in [(Scale::Log, [1e-3, 10.0]), (Scale::Linear, [-5.0, 5.0])] {
            let spread = Spread { scale, range };
            let axis = spread.axis(&[20.0]);
            for value in [range[0], 1.0, 20.0] {
                let place = axis.place(value as f32);
                assert!(place > 1.0 && place < 2.0, "{value}: {place}");
            }
        }
    }
}
