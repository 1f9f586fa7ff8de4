//! What a form leaves of a field that is drawn: the form fitted once, of huge fields to a coarse level, and how far heights are from it.

use super::bands::map_bands;
use super::fit::{FormError, fit};
use super::form::{Form, FormKind, Residual};
use crate::hierarchy::chunks::ChunkKey;
use crate::model::{HeightError, HeightField, HeightGrid, Heights};
use crate::store::HeightFile;
use deepfield_data::model::{SampleType, Scale};

/// Most samples that a form is fitted to: of larger fields those of the finest level that has no more.
const MOST: u64 = 1 << 22;

/// A form, and what it leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedForm {
    /// The form, in the field's coordinates.
    pub form: Form,
    /// The level whose samples it was fitted to; 0 has all.
    pub level: u8,
    /// The largest distance of any of these from it, and the root of their mean square, in the unit of heights.
    pub most: f64,
    /// The root of the mean square distance of these samples.
    pub root_mean_square: f64,
}

/// Fits a form to the measured samples of a page file, or of the finest of its levels that has at most some four millions. The level's last
/// row and column are left out where they are nearer to the others than these are to each other.
///
/// # Errors
/// Where the file cannot be read, or its samples do not determine the form.
pub fn fitted(file: &HeightFile, kind: FormKind) -> Result<FittedForm, FormError> {
    fitted_to(file, kind, MOST)
}

fn fitted_to(file: &HeightFile, kind: FormKind, most: u64) -> Result<FittedForm, FormError> {
    let lattice = file.lattice();
    let top = (lattice.levels() - 1) as u8;
    let samples = |level: u8| lattice.samples.map(|samples| (samples - 1) >> level).iter().product::<u64>();
    let level = (0..top).find(|level| samples(*level) <= most).unwrap_or(top);
    match level {
        0 => of(file, kind, 0),
        level => of(&read_level(file, level)?, kind, level),
    }
}

fn of(heights: &dyn Heights, kind: FormKind, level: u8) -> Result<FittedForm, FormError> {
    let form = fit(heights, kind)?;
    let left = Residual::new(heights, form);
    let bands = map_bands(&left, 0, |band| {
        let values = band.rows().flat_map(|(_, row)| row).filter(|value| !value.is_nan());
        values.fold((0.0_f64, 0.0, 0_u64), |(most, sum, count), value| {
            (most.max(value.abs()), sum + value * value, count + 1)
        })
    })?;
    let (most, sum, count) = bands.into_iter().fold((0.0_f64, 0.0, 0), |a, b| (a.0.max(b.0), a.1 + b.1, a.2 + b.2));
    let root_mean_square = (sum / count.max(1) as f64).sqrt();
    Ok(FittedForm { form: left.form().clone(), level, most, root_mean_square })
}

/// The samples of a level as a field of their own; those of which less than half was measured count as not measured.
fn read_level(file: &HeightFile, level: u8) -> Result<HeightField, HeightError> {
    let (lattice, about) = (file.lattice(), file.about());
    // Even steps only.
    let [rows, columns] = lattice.samples.map(|samples| ((samples - 1) >> level) + 1);
    let step = about.grid.step.map(|step| step * (1_u64 << level) as f64);
    let grid =
        HeightGrid { rows, columns, step, sample_type: SampleType::F64, scale: Scale::NONE, ..about.grid.clone() };
    let mut stored = vec![f64::NAN; (rows * columns) as usize];
    let [down, across] = lattice.chunks_of(u32::from(level));
    for (row, column) in (0..down).flat_map(|row| (0..across).map(move |column| (row, column))) {
        let Some(chunk) = file.chunk(ChunkKey { level, row, column })? else { continue };
        for r in 0..chunk.part.rows {
            for c in 0..chunk.part.columns {
                let (at_row, at_column) = (chunk.part.row + r as u64, chunk.part.column + c as u64);
                if at_row < rows && at_column < columns && chunk.coverage_at(r, c) > 127 {
                    stored[(at_row * columns + at_column) as usize] = about.grid.scale.value(chunk.stored_at(r, c));
                }
            }
        }
    }
    Ok(HeightField { grid: HeightGrid { planes: Vec::new(), ..grid }, stored, planes: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{HeightBuildOptions, HeightOrigin, build_heights};

    /// The plane of a large field is found in a coarse level of it, and what is left are the waves on it; of a small one by all samples.
    #[test]
    fn forms_of_large_fields_come_from_a_coarse_level() {
        // Whole waves, even about the middle: their own plane is 0.
        let side = 640_u64;
        for (most, expected) in [(MOST, 0), (110_000, 1), (10_000, 2)] {
            let height = |index: u64| {
                let (x, y) = ((index % side) as f64, (index / side) as f64);
                3.0 + 0.25 * x - 0.5 * y + ((x - 319.5) * std::f64::consts::TAU / 64.0).cos()
            };
            let field = HeightField::of(side, side, (0..side * side).map(height).collect());
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("field.df");
            build_heights(&field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
            let file = HeightFile::open(&path, Default::default()).unwrap();
            let found = fitted_to(&file, FormKind::Plane, most).unwrap();
            assert_eq!(found.level, expected);
            for place in [[0.0, 0.0], [100.0, 50.0], [10.0, 630.0]] {
                let plane = 3.0 + 0.25 * place[0] - 0.5 * place[1];
                assert!((found.form.height(place) - plane).abs() < 0.02, "{}", found.form.height(place) - plane);
            }
            assert!((found.root_mean_square - 0.5_f64.sqrt()).abs() < 0.01 && (found.most - 1.0).abs() < 0.05);
        }
    }
}
