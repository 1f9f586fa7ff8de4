//! What settings come to where a volume or its surfaces are of the particles' attributes, not of their density alone
//! ([`crate::cpu::volume::attributes`]).

use super::grid::{self, FIELD, ISOVALUES, Layers, OPACITY, TERMINATION};
use super::shadowing;
use crate::color::transfer::{Range, Scale, TransferFunction, UnitLength};
use crate::cpu::field::ValueAxis;
use crate::cpu::shadowing::{Casters, Shadowing};
use crate::cpu::volume::attributes::{ByDensity, Column, ColumnMarch, Columns, Reading, Shown};
use crate::cpu::volume::range::Histogram;
use crate::cpu::volume::{Classifier, Scenery, Supply, VolumeError, VolumeLevels, VolumeOptions};
use crate::mode::{InView, Job, LightPasses, LightPicture, LightPlan, Setting, SettingKind, Settings, Terms};
use crate::view::View;

/// The name of densities among columns.
pub const DENSITY: &str = "density";
/// The choice of F12's sum as it is.
pub const PLAIN: &str = "plain";

/// Whose values are the same on a surface.
pub static SURFACE_FIELD: Setting = Setting {
    name: "surface-field",
    unit: "",
    kind: SettingKind::Column { default: DENSITY },
    help: "what isosurfaces are drawn of, and isovalues are of: the particles' density, or an attribute between them",
};
/// How attributes are read between particles.
pub static FIELD_SUM: Setting = Setting {
    name: "field-sum",
    unit: "",
    kind: SettingKind::Choice { options: &["normalised", PLAIN] },
    help: "an attribute between particles: normalised, the mean weighted with volume; or plain, the sum over m A / rho W (F12 3.2), \
           which falls to 0 where the gas ends",
};
/// What the opacity of a volume of an attribute goes by.
pub static FIELD_OPACITY: Setting = Setting {
    name: "field-opacity",
    unit: "",
    kind: SettingKind::Choice { options: &[DENSITY, "field"] },
    help: "how opaque a volume of an attribute is: as its values say and as dense as it is there, so that thin gas hides nothing; or field, by \
           its values alone",
};

/// Whether the opacity of a volume of something else goes by the density.
fn is_dimmed(settings: &Settings, layers: &Layers) -> bool {
    layers.volume && settings.name(&FIELD) != DENSITY && settings.name(&FIELD_OPACITY) == DENSITY
}

/// The columns whose fields layers are of: the volume's first, then that of surfaces of their own, then the density where the volume's opacity
/// goes by it. None where all are of the density, which needs no column.
pub fn names(settings: &Settings, layers: &Layers) -> Vec<String> {
    let drawn = [(&FIELD, layers.volume), (&SURFACE_FIELD, !layers.surfaces.is_empty())];
    let mut names: Vec<String> =
        drawn.into_iter().filter(|(_, is_drawn)| *is_drawn).map(|(setting, _)| settings.name(setting)).collect();
    names.dedup();
    if is_dimmed(settings, layers) && names.iter().all(|name| name != DENSITY) {
        names.push(DENSITY.to_owned());
    }
    if names == [DENSITY] { Vec::new() } else { names }
}

/// The transfer function of a picture of fields, whether it has a hue, and the columns that are resampled: those with these names first.
fn colors_and_columns(terms: &Terms<'_>, names: &[String]) -> (TransferFunction, bool, Vec<Column>) {
    let usual = || TransferFunction::of_volumes(terms.attribute);
    let transfer = terms.transfer.cloned().unwrap_or_else(usual).for_volume();
    let has_hue = terms.attribute && transfer.hue.is_some();
    let hue_column = has_hue.then_some(Column::Attribute);
    (transfer, has_hue, (0..names.len()).map(Column::Field).chain(hue_column).collect())
}

fn is_density(names: &[String], column: usize) -> bool {
    names.get(column).is_some_and(|name| name == DENSITY)
}

/// What the ranges of fields of columns with these names are found by in a view.
///
/// # Errors
/// [`VolumeError`] when nothing is in view.
pub fn in_view(job: &Job<'_>, names: &[String]) -> Result<InView, VolumeError> {
    let columns = prepare(job, names)?;
    let histogram = |column: usize| columns.histogram(column, is_density(names, column));
    Ok(InView::Columns((0..columns.wanted.len()).map(histogram).collect()))
}

/// The columns with these names, and the one that colours them.
fn prepare(job: &Job<'_>, names: &[String]) -> Result<Columns, VolumeError> {
    let (_, _, wanted) = colors_and_columns(&job.terms(), names);
    Columns::prepare(job.view, job.batches, &wanted, &grid::options(job.settings, job.options.kernel))
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
    /// [`VolumeError`] for settings that do not fit the data or each other, and when nothing is in view.
    pub fn new(job: &Job<'_>, layers: &Layers, names: &[String]) -> Result<VolumeFields, VolumeError> {
        VolumeFields::of(&job.terms(), layers, names, prepare(job, names)?, in_views(job))
    }

    /// The same of particles that are not all there at once, which are no batches of the job: for [`VolumeFields::draw_supplied`].
    ///
    /// # Errors
    /// As [`VolumeFields::new`].
    pub fn of_supplied(
        job: &Job<'_>,
        supply: &mut dyn Supply,
        layers: &Layers,
        names: &[String],
    ) -> Result<VolumeFields, VolumeError> {
        let terms = Terms { attribute: supply.has_attribute(), ..job.terms() };
        let (_, _, wanted) = colors_and_columns(&terms, names);
        let densities: Vec<bool> = (0..wanted.len()).map(|column| is_density(names, column)).collect();
        let options = grid::options(job.settings, terms.kernel);
        let (columns, found) = Columns::prepare_supplied(job.view, supply, &wanted, &densities, &options)?;
        VolumeFields::of(&terms, layers, names, columns, in_views(job).or(Some(found.as_slice())))
    }

    /// The same of columns, and what is known of their values in view.
    fn of(
        terms: &Terms<'_>,
        layers: &Layers,
        names: &[String],
        columns: Columns,
        in_view: Option<&[Histogram]>,
    ) -> Result<VolumeFields, VolumeError> {
        let settings = terms.settings;
        let options = grid::options(settings, terms.kernel);
        let (mut transfer, has_hue, _) = colors_and_columns(terms, names);
        let is_density = |index: usize| is_density(names, index);
        let measured = |index: usize| {
            let found = match in_view.and_then(|all| all.get(index)) {
                Some(all) => Columns::range(all, is_density(index))?,
                None => Columns::range(&columns.histogram(index, is_density(index)), is_density(index))?,
            };
            Ok::<_, VolumeError>(if is_density(index) { found } else { Range::apart(found) })
        };

        let range = match transfer.range {
            Range::Fixed(low, high) => [low, high],
            Range::Auto => measured(0)?,
        };
        if range[0] < 0.0 {
            // A logarithm is no scale for them.
            transfer.scale = Scale::Linear;
        }
        let of_volume = Spread { scale: transfer.scale, range: transfer.scale.usable(range) };
        // The column of surfaces.
        let is_apart = settings.name(&FIELD) != settings.name(&SURFACE_FIELD);
        let own = usize::from(layers.volume && !layers.surfaces.is_empty() && is_apart);
        let of_surfaces = match own {
            0 => of_volume,
            _ => {
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
        let density = names.iter().position(|name| name == DENSITY).filter(|_| is_dimmed(settings, layers));
        let by_density = |index: usize| measured(index).map(|range| ByDensity { range });
        let shown = Shown {
            volume: reading(0, of_volume, of_both),
            surface: (own > 0).then(|| reading(own, of_surfaces, &isovalues)),
            opacity: density.map(by_density).transpose()?,
            has_hue,
        };
        let hue = transfer.hue.clone().unwrap_or_default();
        let attribute = match hue.range {
            Range::Fixed(low, high) => [low, high],
            Range::Auto if has_hue => measured(names.len())?,
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

    /// What an adapter draws of it.
    pub fn plan(self) -> LightPlan {
        let VolumeFields { columns, shown, scenery, options, levels, isovalues } = self;
        let Columns { wanted, filling, .. } = columns;
        let march = ColumnMarch { columns: wanted, shown, scenery, options, filling };
        LightPlan { passes: LightPasses::Columns(Box::new(march)), levels, isovalues }
    }

    /// Draws it with surfaces that darken each other, and the paths among it that the job has.
    pub fn draw_darkened(self, job: &Job<'_>, shadowing: &Shadowing) -> LightPicture {
        let VolumeFields { columns, shown, scenery, options, .. } = &self;
        let (mut parts, report) = columns.draw_in_parts(job.view, shown, scenery, options);
        shadowing.darken_fragments(job.view, &mut parts, &*self.casters(job), job.lighting.others.as_ref());
        let colors = shadowing::colors_among(&parts, job.paths);
        LightPicture { colors, report, levels: self.levels, isovalues: self.isovalues }
    }

    /// How its surfaces hide light in a job's picture.
    pub fn casters<'j>(&self, job: &'j Job<'j>) -> Box<Casters<'j>> {
        let VolumeFields { columns, shown, scenery, options, .. } = self;
        let (wanted, shown, options) = (columns.wanted.clone(), *shown, *options);
        shadowing::casters_of(scenery, move |from: &View, casting: &Scenery| {
            let options = options.seen_from(from == job.view);
            let columns = Columns::prepare(from, job.batches, &wanted, &options)?;
            Ok(columns.draw_in_parts(from, &shown, casting, &options))
        })
    }

    /// Draws it, with the paths among it that the job has.
    pub fn draw(self, job: &Job<'_>) -> LightPicture {
        let VolumeFields { columns, shown, scenery, options, levels, isovalues } = self;
        let (colors, report) = columns.draw(job.view, &shown, &scenery, &options, job.paths);
        LightPicture { colors, report, levels, isovalues }
    }

    /// Draws it of particles that are not all there at once.
    pub fn draw_supplied(self, view: &View, supply: &mut dyn Supply) -> LightPicture {
        let VolumeFields { columns, shown, scenery, options, levels, isovalues } = self;
        let (colors, report) = columns.draw_supplied(view, supply, &shown, &scenery, &options);
        LightPicture { colors, report, levels, isovalues }
    }
}

/// How much of what all views of a job's picture show has which values of each column, where that is known.
fn in_views<'a>(job: &Job<'a>) -> Option<&'a [Histogram]> {
    match job.in_views {
        Some(InView::Columns(all)) => Some(all.as_slice()),
        _ => None,
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
        let by_values = ("field-opacity", "field");
        assert_eq!(of(&volume::MODE, &[metal]), ["metallicity", "density"]);
        assert_eq!(of(&volume::MODE, &[metal, by_values]), ["metallicity"]);
        assert_eq!(of(&isosurface::MODE, &[heat]), ["temperature"]);
        assert_eq!(of(&volume_isosurface::MODE, &[metal]), ["metallicity", "density"]);
        assert_eq!(of(&volume_isosurface::MODE, &[heat]), ["density", "temperature"]);
        let both = [heat, ("field", "temperature"), by_values];
        assert_eq!(of(&volume_isosurface::MODE, &both[..2]), ["temperature", "density"]);
        assert_eq!(of(&volume_isosurface::MODE, &both), ["temperature"]);
        assert_eq!(of(&volume_isosurface::MODE, &[heat, metal]), ["metallicity", "temperature", "density"]);
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
