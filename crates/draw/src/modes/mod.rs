//! The visualization modes that come with deepfield, one small file each. A new mode is a file here and a line in
//! [`MODES`].

pub mod cartesian;
pub mod column_density;
pub mod density_squared;
pub mod grid;
pub mod isosurface;
pub mod layered;
pub mod points;
pub mod sorted_splats;
pub mod spheres;
pub mod volume;
pub mod volume_isosurface;

use crate::mode::Mode;

/// Every registered mode; the first is the default.
pub static MODES: [&Mode; 10] = [
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
];

/// The mode of that name.
pub fn find(name: &str) -> Option<&'static Mode> {
    MODES.iter().copied().find(|mode| mode.name == name)
}

/// The mode to begin with for data that has these fields: the one whose weight is made of fields that the data has
/// (`points` for magnitudes), else the first.
pub fn usual<'a>(fields: impl Iterator<Item = &'a str> + Clone) -> &'static Mode {
    let has = |wanted: &&str| fields.clone().any(|field| field == *wanted);
    let fits = |mode: &&Mode| !mode.weight_attributes.is_empty() && mode.weight_attributes.iter().all(has);
    MODES.iter().copied().find(|mode| fits(mode)).unwrap_or(MODES[0])
}

/// The names of all modes, for messages.
pub fn names() -> String {
    MODES.map(|mode| mode.name).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::Columns;

    #[test]
    fn catalogues_begin_as_points() {
        assert_eq!(usual(["speed", "magnitude"].into_iter()).name, "points");
        assert_eq!(usual(["speed", "temperature"].into_iter()).name, "column-density");
        assert_eq!(usual(std::iter::empty()).name, "column-density");
    }
    use crate::color::transfer::TransferFunction;

    #[test]
    fn modes_have_names_of_their_own_and_settings_with_valid_defaults() {
        for (i, mode) in MODES.iter().enumerate() {
            assert!(MODES[..i].iter().all(|other| other.name != mode.name));
            assert!(std::ptr::eq(find(mode.name).unwrap(), *mode));
            for setting in mode.all_settings() {
                setting.check(&setting.default()).unwrap();
            }
        }
        assert!(find("no-such-mode").is_none());
    }

    #[test]
    fn every_mode_begins_with_a_transfer_function_that_exists() {
        for mode in MODES {
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
