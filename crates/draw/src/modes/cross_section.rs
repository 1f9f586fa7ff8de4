//! `cross-section`: the fields of particles on a plane through them, nothing of which is integrated.

use super::slice::{AT, AXIS, NORMAL, axis};
use super::volume_fields::DENSITY;
use super::{grid, samples, slice_overlay};
use crate::color::transfer::{Range, Scale, TransferFunction};
use crate::cpu::Splats;
use crate::cpu::slice::particles::{self, Summed, Sums, WorldPlane};
use crate::cpu::slice::{Slice, SlicePixel};
use crate::cpu::volume::attributes::LEAST_FILLED;
use crate::cpu::volume::particles::density_scale;
use crate::cpu::volume::{VolumeError, VolumeLevels, VolumeReport};
use crate::mode::{
    InView, Job, LightPicture, Mode, Output, Raw, Setting, SettingKind, Settings, Technique, ValueStatistics,
};
use crate::view::perspective_grid::GridError;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// A place of the plane.
pub static THROUGH: Setting = Setting {
    name: "through",
    unit: "",
    kind: SettingKind::Numbers { min: -1e30, max: 1e30, most: 3 },
    help: "a place that the slice goes through, three numbers, in place of at",
};

/// The share of values on the plane that lie below the ends of automatic ranges.
const ENDS: [f64; 2] = [0.02, 0.998];
/// The same of what colours them.
const HUE_ENDS: [f64; 2] = [0.02, 0.98];
/// Densities on a logarithmic scale reach so far down at most, of the highest: around the data a few supports end in next to nothing.
const LEAST_DENSITY: f64 = 1e-5;

/// The columns that are interpolated: what is shown, then the components of a vector. None where that is the density alone.
fn names(settings: &Settings) -> Vec<String> {
    let (shown, vector) = (settings.name(&grid::FIELD), slice_overlay::columns(settings));
    if shown == DENSITY && vector.is_none() {
        return Vec::new();
    }
    std::iter::once(shown).chain(vector.into_iter().flatten()).collect()
}

/// The plane that settings mean.
fn plane(job: &Job<'_>) -> Result<WorldPlane, VolumeError> {
    let settings = job.settings;
    let three = |setting: &'static Setting, expected: &str| match *settings.numbers(setting) {
        [] => Ok(None),
        [x, y, z] => Ok(Some(DVec3::new(x, y, z))),
        ref found => {
            let (field, found) = (setting.name, format!("{found:?}"));
            Err(VolumeError::Setting { field, found, expected: expected.into() })
        }
    };
    let normal = three(&NORMAL, "three numbers, not all 0")?.unwrap_or_else(|| axis(settings));
    let normal = normal.try_normalize().ok_or_else(|| VolumeError::Setting {
        field: NORMAL.name,
        found: format!("[{}, {}, {}]", normal.x, normal.y, normal.z),
        expected: "three numbers, not all 0".into(),
    })?;
    let distance = match three(&THROUGH, "three numbers")? {
        Some(place) => normal.dot(place),
        None => {
            let (middle, half) = (normal.dot(job.bounds.center()), 0.5 * normal.abs().dot(job.bounds.size()));
            middle + (2.0 * settings.number(&AT) - 1.0) * half
        }
    };
    Ok(WorldPlane { normal, distance })
}

/// What a pixel shows of the sums on the plane.
#[derive(Clone, Copy, PartialEq)]
enum Shown {
    /// The sum of weights, which are masses.
    Weights,
    /// The sum of the densities, weighted with volumes.
    Density,
    /// The mean of a column, where particles fill enough of space; this is what the sum of weights is multiplied by to be a share of space.
    Mean(f32),
}

impl Shown {
    fn of(names: &[String], batches: &[Splats<'_>]) -> Shown {
        match names.first() {
            None => Shown::Weights,
            Some(name) if name == DENSITY => Shown::Density,
            Some(_) => {
                // With volumes `m / rho` this is `rho h^3 / m`.
                let ratios = batches.iter().flat_map(|batch| {
                    let ratio = move |(i, volume): (usize, &f32)| Some(batch.ball(i)?.powi(3) / volume);
                    batch.weight().iter().enumerate().filter_map(ratio)
                });
                Shown::Mean(1.0 / density_scale(ratios))
            }
        }
    }

    /// The value; NaN where there is none.
    fn value(self, sums: &Sums) -> f32 {
        let positive = |sum: f32| if sum > 0.0 { sum } else { f32::NAN };
        match self {
            Shown::Weights => positive(sums.weight()),
            Shown::Density => positive(sums.column()),
            Shown::Mean(filling) if sums.column_weight() * filling >= LEAST_FILLED => {
                sums.column() / sums.column_weight()
            }
            Shown::Mean(_) => f32::NAN,
        }
    }
}

/// What is known of a plane in a view before it is coloured.
struct Section {
    plane: WorldPlane,
    sums: Vec<Sums>,
    shown: Shown,
    /// NaN where there is none.
    values: Vec<f32>,
    /// Of what colours them, where something does.
    hues: Option<Vec<f32>>,
    transfer: TransferFunction,
    /// Particles that the plane cuts.
    particles: u64,
}

impl Section {
    /// The plane that settings mean, with its values.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the data, and where nothing of the plane is in view.
    fn new(job: &Job<'_>) -> Result<Section, VolumeError> {
        let view = job.view;
        let (names, plane) = (names(job.settings), plane(job)?);
        let vector = slice_overlay::of(job.settings).vectors.map(|_| 1);
        let summed = Summed { column: (!names.is_empty()).then_some(0), vector };
        let (sums, particles) = particles::sum(view, job.batches, &plane, job.options.kernel, summed);
        let shown = Shown::of(&names, job.batches);
        let is_kept = |at: usize| {
            !view.cut.clips()
                || plane.meets(view, middle(view.width, at)).is_some_and(|(place, _)| view.cut.keeps(place))
        };
        let value = |(at, sums): (usize, &Sums)| if is_kept(at) { shown.value(sums) } else { f32::NAN };
        let values: Vec<f32> = sums.par_iter().enumerate().map(value).collect();
        if !values.iter().any(|value| value.is_finite()) {
            return Err(GridError::NothingInView.into());
        }
        let has_attribute = job.terms().attribute;
        let usual = || TransferFunction::of_volumes(has_attribute);
        let transfer = job.transfer.cloned().unwrap_or_else(usual).for_volume();
        let hues = (has_attribute && transfer.hue.is_some()).then(|| {
            let of_pixel = |(sums, value): (&Sums, &f32)| {
                // Where nothing is shown nothing is coloured.
                let shown = sums.attribute().filter(|_| value.is_finite());
                shown.unwrap_or(f32::NAN)
            };
            sums.iter().zip(&values).map(of_pixel).collect()
        });
        Ok(Section { plane, sums, shown, values, hues, transfer, particles })
    }

    /// What its ranges are found by.
    fn in_view(self) -> InView {
        let finite = |values: Vec<f32>| values.into_iter().filter(|value| value.is_finite()).collect();
        InView::Pixels([self.values, self.hues.unwrap_or_default()].map(finite))
    }

    /// The ranges of its colours, by what it shows itself where it is not one view of several. Values below zero have a linear scale from now on.
    fn levels(&mut self, in_views: Option<&InView>) -> VolumeLevels {
        let statistics = |index: usize, own: &[f32]| match in_views {
            Some(InView::Pixels(all)) => ValueStatistics::of(&all[index]),
            _ => ValueStatistics::of(own),
        };
        let Section { shown, values, hues, transfer, .. } = self;
        let range = match transfer.range {
            Range::Fixed(low, high) => [low, high],
            Range::Auto => {
                let found = statistics(0, values);
                let [low, high] = ENDS.map(|share| found.percentile(share));
                match shown {
                    Shown::Weights | Shown::Density if transfer.scale == Scale::Log => {
                        [low.max(LEAST_DENSITY * high), high]
                    }
                    Shown::Weights | Shown::Density => [low, high],
                    Shown::Mean(_) => Range::apart([low, high]),
                }
            }
        };
        if range[0] < 0.0 {
            // A logarithm is no scale for them.
            transfer.scale = Scale::Linear;
        }
        let attribute = match (&transfer.hue, hues) {
            (Some(hue), Some(hues)) => {
                let ends = match hue.range {
                    Range::Fixed(low, high) => [low, high],
                    Range::Auto => {
                        let found = statistics(1, hues);
                        Range::apart(HUE_ENDS.map(|share| found.percentile(share)))
                    }
                };
                hue.scale.usable(ends)
            }
            _ => [0.0, 1.0],
        };
        VolumeLevels { density: transfer.scale.usable(range), attribute, unit_length: 1.0 }
    }

    /// Coloured over these ranges, with the vectors that there are.
    fn slice(&self, job: &Job<'_>, levels: VolumeLevels) -> Slice {
        let view = job.view;
        let color = samples::colors_at(&self.transfer, levels);
        let mut slice = Slice::new(view);
        slice.pixels.par_iter_mut().enumerate().for_each(|(at, out)| {
            let value = self.values[at];
            let Some((place, depth)) = self.plane.meets(view, middle(view.width, at)) else { return };
            if value.is_nan() {
                return;
            }
            let color = color(value, self.hues.as_ref().map(|hues| hues[at]));
            *out = SlicePixel { depth: depth as f32, color, alpha: 1.0, value, ..SlicePixel::NOTHING };
            if let Some(vector) = self.sums[at].vector() {
                *out = out.with_vector(view, self.plane.normal, place, vector);
            }
        });
        slice
    }
}

/// The middle of a pixel of a picture of that width.
fn middle(width: u32, at: usize) -> [f64; 2] {
    let width = width as usize;
    [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5]
}

struct CrossSection;

impl Technique for CrossSection {
    fn output(&self) -> Output {
        Output::Light
    }

    fn fields(&self, settings: &Settings) -> Vec<String> {
        names(settings)
    }

    fn own_levels(&self, job: &Job<'_>) -> Option<VolumeLevels> {
        Section::new(job).ok().map(|mut section| section.levels(job.in_views))
    }

    fn looks_in_view(&self, _: &Settings, transfer: &TransferFunction) -> bool {
        transfer.numbers().is_none()
    }

    fn in_view(&self, job: &Job<'_>) -> Result<Option<InView>, VolumeError> {
        Ok(Some(Section::new(job)?.in_view()))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let mut section = Section::new(job)?;
        let levels = section.levels(job.in_views);
        let mut slice = section.slice(job, levels);
        let arrows = slice.decorate(&slice_overlay::of(job.settings));
        let (particles, grid) = (section.particles, [job.view.width, job.view.height, 1]);
        let (arrows, values) = (arrows.map(Box::new), Some(Arc::new(section.values)));
        let report = VolumeReport { particles, grid, arrows, values, ..VolumeReport::default() };
        Ok(Raw::Light(LightPicture { colors: slice.colors(), report, levels, isovalues: Vec::new() }))
    }
}

/// The density on a plane, or another field.
pub static MODE: Mode = Mode {
    name: "cross-section",
    help: "what particles come to on a plane through them: the density there or another field, with lines of equal value and vectors in the plane \
           if wanted",
    settings: &[&[&grid::FIELD, &AXIS, &AT, &NORMAL, &THROUGH], slice_overlay::OVERLAY],
    technique: &CrossSection,
    ..grid::MODE
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::over::Order;
    use crate::cpu::shadowing::Lighting;
    use crate::cpu::{Extent, Positions, SplatOptions};
    use crate::mode::SettingValue;
    use crate::model::Bounds;
    use crate::view::{Projection, View};

    /// Pictures of a lattice of particles of density 1 and a column that is `10 + x`, 0.5 apart around the origin.
    fn drawn(
        set: &[(&'static Setting, SettingValue)],
        transfer: &TransferFunction,
    ) -> Result<LightPicture, VolumeError> {
        const SIDE: usize = 12;
        let place = |i: usize| 0.5 * (i as f64 - 5.5);
        let positions: Vec<[f64; 3]> = (0..SIDE * SIDE * SIDE)
            .map(|i| [place(i % SIDE), place(i / SIDE % SIDE), place(i / (SIDE * SIDE))])
            .collect();
        let mut settings = Settings::default();
        set.iter().for_each(|(setting, value)| settings.set(setting, value.clone()));
        // Masses are volumes: the density is 1.
        let (h, weights) = (vec![1.2f32; positions.len()], vec![0.125f32; positions.len()]);
        let column = |name: &String| -> Vec<f32> {
            let value = |at: &[f64; 3]| match name.as_str() {
                "velocity-x" => -at[1],
                "velocity-y" => at[0],
                "velocity-z" => 0.0,
                DENSITY => 1.0,
                _ => 10.0 + at[0],
            };
            positions.iter().map(|at| value(at) as f32).collect()
        };
        let columns: Vec<Vec<f32>> = names(&settings).iter().map(column).collect();
        let batch =
            Splats::new(Positions::World(&positions), Extent::World(&h), &weights, None)?.with_fields(&columns)?;
        let projection = Projection::Orthographic { height: 4.0 };
        let view = View::look_at(9.0 * DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 80, 80).expect("a view");
        let job = Job {
            view: &view,
            batches: &[batch],
            options: SplatOptions::default(),
            settings: &settings,
            transfer: Some(transfer),
            bounds: Bounds { min: DVec3::splat(-3.0), max: DVec3::splat(3.0) },
            diameter: 10.0,
            densest: 1.0,
            density_scale: 1.0,
            mean_mass: 1.0,
            paths: None,
            around: None,
            in_views: None,
            lighting: Lighting::default(),
            order: Order::default(),
        };
        MODE.draw(&job).and_then(|raw| raw.light(&MODE))
    }

    fn grey(range: Range) -> TransferFunction {
        TransferFunction { range, scale: Scale::Linear, ..TransferFunction::preset("grey").expect("a preset") }
    }

    #[test]
    fn a_field_is_what_its_particles_say_and_lines_lie_where_it_has_their_values() {
        let field = (&grid::FIELD, SettingValue::Name("heat".into()));
        let plain = drawn(std::slice::from_ref(&field), &grey(Range::Auto)).expect("a slice");
        let values = plain.report.values.as_ref().expect("values");
        let is_value = |(at, value): (usize, &f32)| (value - (8.025 + 0.05 * (at % 80) as f32)).abs() < 0.002;
        assert!(values.len() == 80 * 80 && values.iter().enumerate().all(is_value), "{:?}", &values[..80]);
        // 80 pixels of 0.05 from x = -2 on.
        let ends = ENDS.map(|share| 8.025 + 3.95 * share);
        let off = |(found, expected): (&f64, f64)| (found - expected).abs();
        assert!(
            plain.levels.density.iter().zip(ends).map(off).fold(0.0, f64::max) < 0.03,
            "{:?}",
            plain.levels.density
        );
        let set = [field, (&super::super::surface::CONTOURS, SettingValue::Number(1.0))];
        let lined = drawn(&set, &grey(Range::Auto)).expect("a slice");
        let is_line = |x: usize| (0..80).all(|y| plain.colors.rgba[80 * y + x] != lined.colors.rgba[80 * y + x]);
        let is_none = |x: usize| (0..80).all(|y| plain.colors.rgba[80 * y + x] == lined.colors.rgba[80 * y + x]);
        // Values 9, 10 and 11 are at pixels 20, 40 and 60, between two of them.
        for line in [20, 40, 60] {
            assert!(is_line(line - 1) || is_line(line), "line {line}");
            assert!(is_none(line - 5) && is_none(line + 4), "beside {line}");
        }
    }

    #[test]
    fn the_density_is_the_same_with_vectors_and_without() {
        let range = Range::Fixed(0.5, 1.5);
        let vectors = (&slice_overlay::VECTORS, SettingValue::Name("arrows".into()));
        let [plain, with] = [&[][..], &[vectors]].map(|set| drawn(set, &grey(range)).expect("a slice"));
        let expected = samples::colors_at(&grey(range).for_volume(), plain.levels)(1.0, None)[0];
        let near = plain.colors.rgba.iter().filter(|pixel| (pixel[0] - expected).abs() < 0.02).count();
        assert_eq!(near, 80 * 80, "the density of the lattice is 1 within");
        let changed =
            plain.colors.rgba.iter().zip(&with.colors.rgba).filter(|(a, b)| (a[0] - b[0]).abs() > 0.01).count();
        assert!((100..3000).contains(&changed), "{changed} pixels have arrows");
    }

    #[test]
    fn planes_that_are_none_are_refused() {
        let numbers = |setting: &'static Setting, numbers: &[f64]| (setting, SettingValue::Numbers(numbers.to_vec()));
        for (wrong, expected) in [
            (numbers(&NORMAL, &[0.0; 3]), "normal is [0, 0, 0], expected three numbers, not all 0"),
            (numbers(&NORMAL, &[1.0]), "normal is [1.0], expected three numbers, not all 0"),
            (numbers(&THROUGH, &[1.0, 2.0]), "through is [1.0, 2.0], expected three numbers"),
        ] {
            let refused = drawn(&[wrong], &grey(Range::Auto)).map(|_| ()).unwrap_err().to_string();
            assert_eq!(refused, expected);
        }
        let beside = drawn(&[numbers(&THROUGH, &[0.0, 0.0, 30.0])], &grey(Range::Auto)).map(|_| ());
        assert!(matches!(beside, Err(VolumeError::Grid(GridError::NothingInView))));
    }
}
