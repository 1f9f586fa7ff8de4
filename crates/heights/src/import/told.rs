//! What the user says in place of the source, and what nobody says.

use super::{HeightOptions, HeightSource, NoData};
use deepfield_data::model::SampleType;

/// What is noted of a source that does not say how far samples are apart.
pub(crate) const NO_SPACING: &str =
    "the distance of samples is not stated: it counts as 1, --spacing DX,DY says otherwise";

/// Puts the options in place of what the source says, and notes what is not stated.
pub(super) fn overrule(source: &mut HeightSource, options: &HeightOptions) {
    if let Some(no_data) = options.no_data {
        // As the file can hold it.
        let is_single = source.description().grid.sample_type == SampleType::F32;
        source.set_no_data(NoData::Value(if is_single { f64::from(no_data as f32) } else { no_data }));
    }
    let about = source.description_mut();
    let grid = &mut about.grid;
    if let Some(spacing) = options.spacing {
        for (step, told) in grid.step.iter_mut().zip(spacing) {
            *step = told.copysign(*step);
        }
        about.has_spacing = true;
    }
    if let Some(unit) = &options.xy_unit {
        grid.xy_unit = unit.clone();
    }
    if let Some(unit) = &options.height_unit {
        grid.height_unit = unit.clone();
    }
    if !about.has_spacing {
        about.notes.push(NO_SPACING.into());
    }
}
