//! nchilada: folders of families with a file for each field, big-endian.

use super::hostile::{mutate, mutations, survives_at};
use super::writers::file;
use super::{data, message, read_all};
use deepfield::import::{FieldKind, open};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// A file of a field: its numbers, so many for each particle, and the code of their type. Where all are the same, they stand in the header
/// alone.
fn field(components: usize, code: u32, values: &[f64]) -> Vec<u8> {
    let word = |value: f64| match code {
        5 => (value as i32).to_be_bytes().to_vec(),
        7 => (value as i64).to_be_bytes().to_vec(),
        9 => (value as f32).to_be_bytes().to_vec(),
        _ => value.to_be_bytes().to_vec(),
    };
    let count = (values.len() / components) as u64;
    let limit = |pick: fn(f64, f64) -> f64| {
        let of = move |axis| values.iter().skip(axis).step_by(components).copied().reduce(pick).unwrap_or(0.0);
        (0..components).flat_map(move |axis| word(of(axis))).collect::<Vec<u8>>()
    };
    let (least, greatest) = (limit(f64::min), limit(f64::max));
    let head = [&1_062_053_u32.to_be_bytes()[..], &0.25f64.to_be_bytes(), &count.to_be_bytes()].concat();
    let mut bytes = [head, (components as u32).to_be_bytes().to_vec(), code.to_be_bytes().to_vec()].concat();
    let is_same = least == greatest && components == 1;
    bytes.extend([least, greatest].concat());
    if !is_same {
        bytes.extend(values.iter().flat_map(|value| word(*value)));
    }
    bytes
}

/// A snapshot with these places of each family.
fn snapshot(folder: &Path, double: bool, families: &[(&str, Vec<[f64; 3]>)]) -> PathBuf {
    let folder = folder.join("run.000100");
    let code = if double { 10 } else { 9 };
    for (name, places) in families {
        let own = folder.join(name);
        std::fs::create_dir_all(&own).unwrap();
        let rows = |value: &dyn Fn(usize) -> f64| (0..places.len()).map(value).collect::<Vec<f64>>();
        file(&own, "pos", &field(3, code, places.as_flattened()));
        file(&own, "vel", &field(3, code, &places.iter().flatten().map(|x| -x).collect::<Vec<_>>()));
        file(&own, "mass", &field(1, code, &rows(&|_| 0.5)));
        file(&own, "iord", &field(1, if double { 7 } else { 5 }, &rows(&|row| 100.0 - row as f64)));
        if *name == "gas" {
            file(&own, "smoothlength", &field(1, code, &rows(&|row| 0.25 * (1 + row) as f64)));
            file(&own, "GasDensity", &field(1, code, &rows(&|row| 1.0 + row as f64)));
        }
        file(&own, "notes.txt", b"no field");
    }
    file(&folder, "description.xml", b"<simulation/>");
    folder
}

/// A small snapshot.
fn sample(folder: &Path) -> PathBuf {
    let places = |count: usize| -> Vec<[f64; 3]> { (0..count).map(|i| [i as f64, (i * i % 7) as f64, 1.0]).collect() };
    snapshot(folder, false, &[("gas", places(9)), ("star", places(4))])
}

proptest! {
    #![proptest_config(crate::cases::cases(32))]

    #[test]
    fn what_is_written_comes_back(
        families in prop::array::uniform3(prop::collection::vec(any::<[i8; 3]>(), 0..9)),
        double in any::<bool>(),
        step in 1..5u64,
    ) {
        prop_assume!(families.iter().any(|family| !family.is_empty()));
        let eighths = |places: Vec<[i8; 3]>| -> Vec<[f64; 3]> {
            places.into_iter().map(|at| at.map(|x| f64::from(x) / 8.0)).collect()
        };
        let named: Vec<(&str, Vec<[f64; 3]>)> =
            ["gas", "dark", "star"].into_iter().zip(families.map(eighths)).collect();
        let folder = tempfile::tempdir().unwrap();
        let source = open(&snapshot(folder.path(), double, &named)).unwrap();
        let about = source.description();
        prop_assert_eq!((&*about.format, about.time), ("nchilada", Some(0.25)));
        let expected: Vec<_> = named.iter().filter(|(_, places)| !places.is_empty()).collect();
        prop_assert_eq!(about.families.len(), expected.len());
        for (family, (info, (name, places))) in about.families.iter().zip(expected).enumerate() {
            let read = |name: &str| read_all(source.as_ref(), family, name, step);
            let known = if *name == "star" { "stars" } else { *name };
            prop_assert_eq!((info.name.as_str(), info.count), (known, places.len() as u64));
            prop_assert_eq!(read("position"), places.concat());
            prop_assert_eq!(read("velocity"), places.iter().flatten().map(|x| -x).collect::<Vec<_>>());
            prop_assert_eq!(read("mass"), vec![0.5; places.len()]);
            // Where there is one particle, its id stands in the header alone.
            if places.len() > 1 {
                let mut ids = vec![0; places.len()];
                source.read_ids(family, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut ids).unwrap();
                prop_assert_eq!(ids, (0..info.count).map(|row| 100 - row).collect::<Vec<_>>());
            }
            if *name == "gas" {
                // Half the support radius is stored.
                prop_assert_eq!(read("smoothing-length"), (1..=places.len()).map(|row| 0.5 * row as f64).collect::<Vec<_>>());
                prop_assert_eq!(read("density"), (1..=places.len()).map(|row| row as f64).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn damage_is_survived(
        name in prop::sample::select(vec!["gas/pos", "gas/smoothlength", "star/mass", "star/iord"]),
        mutations in mutations(),
        at in prop::option::of(0.0..1.0f64),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let snapshot = sample(folder.path());
        let mut bytes = std::fs::read(snapshot.join(name)).unwrap();
        mutate(&mut bytes, &mutations);
        bytes.truncate(at.map_or(bytes.len(), |at| (at * bytes.len() as f64) as usize));
        file(&snapshot, name, &bytes);
        survives_at(&snapshot)?;
    }
}

#[test]
fn shortened_files_and_other_counts_are_errors_that_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let snapshot = sample(folder.path());
    let bytes = std::fs::read(snapshot.join("gas/vel")).unwrap();
    // What does not begin as a field is none.
    for length in 4..bytes.len() {
        file(&snapshot, "gas/vel", &bytes[..length]);
        message(&open(&snapshot).err().unwrap(), &snapshot.join("gas/vel"));
    }
    file(&snapshot, "gas/vel", &std::fs::read(snapshot.join("star/vel")).unwrap());
    let text = message(&open(&snapshot).err().unwrap(), &snapshot.join("gas/vel"));
    assert!(text.contains("found 4") || text.contains("found 9"), "{text}");
}

#[test]
fn fields_whose_limits_were_never_found_are_read() {
    // The tool leaves infinity as the least birth of a star, and its negative as the greatest.
    let source = open(&data("others/tipsy2salsa")).unwrap();
    let births: Vec<f64> = (16..24).map(|row| 10.0 + 1.5 * f64::from(row)).collect();
    assert_eq!(read_all(source.as_ref(), 1, "timeform", 3), births);
}
