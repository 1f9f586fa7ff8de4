//! The visualization modes: those that come with deepfield, one small file each and a line in [`BUILT_IN`]; and those that
//! another crate has registered.

pub mod cartesian;
pub mod column_density;
pub mod cross_section;
pub mod density_squared;
pub mod grid;
pub mod image;
pub mod isosurface;
pub mod layered;
mod named;
pub mod paths;
pub mod points;
pub mod primitives;
pub mod samples;
pub mod shadowing;
pub mod slice;
pub mod slice_overlay;
pub mod sorted_splats;
pub mod spheres;
pub mod surface;
pub mod volume;
pub mod volume_fields;
pub mod volume_isosurface;
pub mod xray;

use crate::color::transfer::TransferFunction;
use crate::mode::{Mode, lod_budget};
use std::sync::{PoisonError, RwLock};

/// The modes that come with deepfield; the first is the default.
static BUILT_IN: [&Mode; 17] = [
    &column_density::MODE,
    &density_squared::MODE,
    &points::MODE,
    &volume::MODE,
    &isosurface::MODE,
    &volume_isosurface::MODE,
    &layered::MODE,
    &sorted_splats::MODE,
    &spheres::MODE,
    &cartesian::MODE,
    &paths::MODE,
    &primitives::MODE,
    &surface::MODE,
    &image::MODE,
    &slice::MODE,
    &xray::MODE,
    &cross_section::MODE,
];

/// The modes of other crates.
static REGISTERED: RwLock<Vec<&'static Mode>> = RwLock::new(Vec::new());

/// Adds a mode. All that names modes knows it from now on, so this comes before anything is parsed.
///
/// # Errors
/// What is wrong with the mode: a name that another one has, or a setting that is called as one of the budget's, or whose
/// default it does not take, or a tolerance that is no share, or a transfer function that does not exist.
pub fn register(mode: &'static Mode) -> Result<(), String> {
    if find(mode.name).is_some() {
        return Err(format!("mode {}: expected a name that no other mode has", mode.name));
    }
    if let Some(setting) = mode.own_settings().find(|setting| lod_budget::is_common(setting.name)) {
        let common = lod_budget::COMMON.map(|setting| setting.name).join(", ");
        return Err(format!(
            "mode {}, setting {}: expected another name than those of the budget ({common})",
            mode.name, setting.name
        ));
    }
    for setting in mode.all_settings() {
        setting.check(&setting.default()).map_err(|error| format!("mode {}, default of {error}", mode.name))?;
    }
    if !(f64::MIN_POSITIVE..=1.0).contains(&mode.hue_tolerance) {
        let found = mode.hue_tolerance;
        return Err(format!("mode {}, hue_tolerance: found {found}, expected a number above 0, at most 1", mode.name));
    }
    for name in mode.transfer {
        TransferFunction::preset(name).ok_or_else(|| format!("mode {}: no transfer function {name}", mode.name))?;
    }
    REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(mode);
    Ok(())
}

/// Every mode: those that come with deepfield, then those of other crates.
pub fn all() -> Vec<&'static Mode> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    BUILT_IN.iter().chain(registered.iter()).copied().collect()
}

/// The mode where none is named.
pub fn first() -> &'static Mode {
    BUILT_IN[0]
}

/// The mode that images or volumes begin with.
pub fn of_fields(dimensions: usize) -> &'static Mode {
    if dimensions == 2 { &image::MODE } else { &volume::MODE }
}

/// The mode of that name.
pub fn find(name: &str) -> Option<&'static Mode> {
    all().into_iter().find(|mode| mode.name == name)
}

/// The mode to begin with for data that has these fields: the one whose weight is made of fields that the data has
/// (`points` for magnitudes), else the first.
pub fn usual<'a>(fields: impl Iterator<Item = &'a str> + Clone) -> &'static Mode {
    let has = |wanted: &&str| fields.clone().any(|field| field == *wanted);
    let fits = |mode: &&Mode| !mode.weight_attributes.is_empty() && mode.weight_attributes.iter().all(has);
    all().into_iter().find(fits).unwrap_or(first())
}

/// The names of all modes, for messages.
pub fn names() -> String {
    all().iter().map(|mode| mode.name).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::{Columns, Setting, SettingKind};

    #[test]
    fn catalogues_begin_as_points() {
        assert_eq!(usual(["speed", "magnitude"].into_iter()).name, "points");
        assert_eq!(usual(["speed", "temperature"].into_iter()).name, "column-density");
        assert_eq!(usual(std::iter::empty()).name, "column-density");
    }

    #[test]
    fn modes_have_names_of_their_own_and_settings_with_valid_defaults() {
        for (i, mode) in BUILT_IN.iter().enumerate() {
            assert!(BUILT_IN[..i].iter().all(|other| other.name != mode.name));
            assert!(std::ptr::eq(find(mode.name).unwrap(), *mode));
            for setting in mode.all_settings() {
                setting.check(&setting.default()).unwrap();
            }
        }
        assert!(find("no-such-mode").is_none());
    }

    #[test]
    fn registered_modes_are_known_and_names_are_their_own() {
        static SAME: Mode = Mode { name: "volume", ..grid::MODE };
        static OTHER: Mode = Mode { name: "registered-in-a-test", ..grid::MODE };
        assert_eq!(register(&SAME), Err("mode volume: expected a name that no other mode has".to_owned()));
        register(&OTHER).unwrap();
        assert!(std::ptr::eq(find("registered-in-a-test").unwrap(), &OTHER));
        assert!(names().ends_with("registered-in-a-test") && register(&OTHER).is_err());
    }

    #[test]
    fn settings_of_the_budget_are_no_settings_of_a_mode() {
        static TAKEN: [&Setting; 2] = [
            &grid::DETAIL,
            &Setting { name: "presence", unit: "", kind: SettingKind::Flag { default: true }, help: "" },
        ];
        static MODE: Mode = Mode { name: "with-presence", settings: &[&TAKEN], ..grid::MODE };
        let wrong = register(&MODE).unwrap_err();
        assert!(wrong.starts_with("mode with-presence, setting presence: expected another name"), "{wrong}");
        assert!(wrong.contains("(culling, presence, thinning, ") && find(MODE.name).is_none(), "{wrong}");
    }

    #[test]
    fn a_tolerance_is_a_share() {
        static MODE: Mode = Mode { name: "tolerates-nothing", hue_tolerance: 0.0, ..grid::MODE };
        let expected = "mode tolerates-nothing, hue_tolerance: found 0, expected a number above 0, at most 1";
        assert_eq!(register(&MODE), Err(expected.to_owned()));
        assert!(BUILT_IN.iter().all(|mode| mode.hue_tolerance > 0.0 && mode.hue_tolerance <= 1.0));
    }

    #[test]
    fn every_mode_begins_with_a_transfer_function_that_exists() {
        for mode in BUILT_IN {
            let [plain, colored] = mode.transfer.map(|name| TransferFunction::preset(name).unwrap());
            assert!(plain.hue.is_none() && colored.hue.is_some(), "{}", mode.name);
        }
    }

    #[test]
    fn weights_are_those_of_the_paper() {
        let columns = Columns {
            mass: &[2.0, 3.0],
            density: &[5.0, 7.0],
            smoothing_length: &[1.0, 1.0],
            attributes: &[("magnitude", &[0.0, 5.0])],
        };
        assert_eq!((column_density::MODE.weight)(&columns), [2.0, 3.0]);
        assert_eq!((density_squared::MODE.weight)(&columns), [10.0, 21.0]);
        let flux = (points::MODE.weight)(&columns);
        assert!((flux[0] - 1.0).abs() < 1e-6 && (flux[1] - 0.01).abs() < 1e-8, "{flux:?}");
    }
}
