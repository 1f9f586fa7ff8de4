//! openPMD: particles of several iterations, components with one value for all, offsets and units.

use super::hostile::{mutate, mutations, survives_at};
use super::read_all;
use super::writers::file;
use crate::support::hdf5::{Hdf5, Values};
use deepfield::import::{FieldKind, RunOptions, open, open_run, step_name, steps_in};
use deepfield::model::ReadMethod;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

const MICRON: f64 = 1e-6;
const MASS: f64 = 9.109e-31;
/// Iterations and their times in the file's unit.
const ITERATIONS: [(u32, f64); 2] = [(20, 2.0), (100, 10.0)];

/// A file of electrons in a plane at these places, in the first iteration, and twice as far out in the second. Beside them is a field with so many
/// columns.
fn sample(folder: &Path, places: &[[f64; 2]], columns: usize) -> PathBuf {
    let mut out = Hdf5::default();
    let number = |value: f64| Values::F64(vec![value]);
    for (name, text) in [("openPMD", "1.1.0"), ("basePath", "/data/%T/"), ("particlesPath", "particles/")] {
        out.attribute("", name, Values::Text(text));
    }
    for (index, (iteration, time)) in ITERATIONS.into_iter().enumerate() {
        let base = format!("data/{iteration}");
        out.attribute(&base, "time", number(time));
        out.attribute(&base, "timeUnitSI", number(1e-15));
        out.dataset(&format!("{base}/fields"), "rho", columns, Values::F64(vec![0.0; 8]));
        let own = format!("{base}/particles/electrons");
        for (axis, name) in ["x", "y"].into_iter().enumerate() {
            let values = places.iter().map(|at| at[axis] * f64::from(1 + index as u32)).collect();
            out.dataset(&format!("{own}/position"), name, 1, Values::F64(values));
            out.attribute(&format!("{own}/position/{name}"), "unitSI", number(MICRON));
            let offset = format!("{own}/positionOffset/{name}");
            out.attribute(&offset, "value", number(3.0 + axis as f64));
            out.attribute(&offset, "shape", Values::U64(vec![places.len() as u64]));
            out.attribute(&offset, "unitSI", number(2.0 * MICRON));
        }
        for name in ["x", "y", "z"] {
            out.dataset(&format!("{own}/momentum"), name, 1, Values::F64(vec![1.0; places.len()]));
        }
        out.attribute(
            &format!("{own}/momentum"),
            "unitDimension",
            Values::F64(vec![1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
        );
        let mass = format!("{own}/mass");
        out.attribute(&mass, "value", number(MASS));
        out.attribute(&mass, "shape", Values::U64(vec![places.len() as u64]));
        out.attribute(&mass, "macroWeighted", Values::U32(vec![0]));
        out.attribute(&mass, "weightingPower", number(1.0));
        out.dataset(&own, "weighting", 1, Values::F64((1..=places.len()).map(|row| row as f64).collect()));
        out.dataset(&own, "id", 1, Values::U64((0..places.len() as u64).map(|row| (1 << 60) + row).collect()));
    }
    let path = folder.join("electrons.h5");
    out.write(&path);
    path
}

proptest! {
    #![proptest_config(crate::cases::cases(24))]

    #[test]
    fn what_is_written_comes_back(
        places in prop::collection::vec(any::<[i8; 2]>(), 1..9),
        step in 1..5u64,
    ) {
        let places: Vec<[f64; 2]> = places.into_iter().map(|at| at.map(f64::from)).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = sample(folder.path(), &places, 2);
        prop_assert_eq!(steps_in(&path).unwrap(), 2);
        // The file alone is its first step.
        for (index, named) in [(0, path.clone()), (0, step_name(&path, 0)), (1, step_name(&path, 1))] {
            let source = open(&named).unwrap();
            let about = source.description();
            prop_assert_eq!((&*about.format, about.steps), ("openpmd", 2));
            prop_assert_eq!(about.time, Some(ITERATIONS[index].1 * 1e-15));
            prop_assert_eq!((about.families.len(), about.families[0].name.as_str()), (1, "electrons"));
            let read = |name: &str| read_all(source.as_ref(), 0, name, step);
            let times = (1 + index) as f64;
            let at = |at: &[f64; 2]| {
                [at[0] * times * MICRON + 3.0 * (2.0 * MICRON), at[1] * times * MICRON + 4.0 * (2.0 * MICRON), 0.0]
            };
            prop_assert_eq!(read("position"), places.iter().flat_map(at).collect::<Vec<_>>());
            // Of all the electrons that each stands for.
            prop_assert_eq!(read("mass"), (1..=places.len()).map(|row| MASS * row as f64).collect::<Vec<_>>());
            let info = &about.families[0];
            prop_assert_eq!(&*info.fields[info.named("momentum").unwrap()].unit.0, "m kg/s");
            let mut ids = vec![0; places.len()];
            source.read_ids(0, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut ids).unwrap();
            prop_assert_eq!(ids, (0..places.len() as u64).map(|row| (1 << 60) + row).collect::<Vec<_>>());
        }
        let run = open_run(std::slice::from_ref(&path), &RunOptions::default(), ReadMethod::default()).unwrap();
        prop_assert_eq!(run.steps.len(), 2);
        prop_assert!(open(&step_name(&path, 2)).err().unwrap().to_string().contains("electrons.h5"));
    }

    #[test]
    fn damage_is_survived(mutations in mutations(), at in prop::option::of(0.0..1.0f64)) {
        let folder = tempfile::tempdir().unwrap();
        let path = sample(folder.path(), &[[1.0, 2.0], [3.0, 5.0], [-1.0, 4.0]], 1);
        let mut bytes = std::fs::read(&path).unwrap();
        mutate(&mut bytes, &mutations);
        bytes.truncate(at.map_or(bytes.len(), |at| (at * bytes.len() as f64) as usize));
        survives_at(&file(folder.path(), "electrons.h5", &bytes))?;
    }
}
