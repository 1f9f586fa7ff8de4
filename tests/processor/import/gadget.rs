//! Gadget 1 and 2: whatever the byte order, precision, files and mass table, what is written comes back.

use super::writers::{GadgetStyle, Particles, file, gadget};
use super::{message, read_all};
use deepfield::import::{LoadOptions, files_of, load, open, summarize};
use deepfield::model::FamilyName;
use proptest::prelude::*;

fn style() -> impl Strategy<Value = GadgetStyle> {
    let table = prop::array::uniform6(prop_oneof![Just(0.0), 0.5..2.0f64]);
    (any::<bool>(), 1..=2u32, any::<bool>(), any::<bool>(), table).prop_map(
        |(big_endian, format, double, long_ids, table)| GadgetStyle { big_endian, format, double, long_ids, table },
    )
}

/// Particles of six types in each of some files. Values are small multiples of 1/8, so that single precision holds them.
fn files() -> impl Strategy<Value = Vec<[Particles; 6]>> {
    let number = || (-800..800i32).prop_map(|eighths| eighths as f64 / 8.0);
    let one = move || {
        let vector = || prop::array::uniform3(number());
        (vector(), vector(), any::<u32>(), (1..800i32).prop_map(|eighths| eighths as f64 / 8.0))
    };
    let family = prop::collection::vec(one(), 0..5).prop_map(|list| Particles {
        positions: list.iter().map(|one| one.0).collect(),
        velocities: list.iter().map(|one| one.1).collect(),
        ids: list.iter().map(|one| one.2 as u64).collect(),
        masses: list.iter().map(|one| one.3).collect(),
    });
    let file = prop::collection::vec(family, 6).prop_map(|families| families.try_into().unwrap());
    prop::collection::vec(file, 1..4)
}

fn flat(vectors: &[[f64; 3]]) -> Vec<f64> {
    vectors.as_flattened().to_vec()
}

proptest! {
    #![proptest_config(crate::cases::cases(128))]

    #[test]
    fn what_is_written_comes_back(style in style(), files in files(), step in 1..7u64, named in 0..3usize) {
        let folder = tempfile::tempdir().unwrap();
        let mut totals = [0u32; 6];
        for (kind, total) in totals.iter_mut().enumerate() {
            *total = files.iter().map(|families| families[kind].positions.len() as u32).sum();
        }
        let paths: Vec<_> = files.iter().enumerate().map(|(number, families)| {
            let bytes = gadget(style, families, totals, files.len() as u32);
            file(folder.path(), &format!("snap_7.{number}"), &bytes)
        }).collect();
        let path = &paths[named % paths.len()];
        if totals.iter().sum::<u32>() == 0 {
            let text = message(&open(path).err().unwrap(), path);
            prop_assert!(text.contains("no particles"), "{}", text);
            return Ok(());
        }
        let source = open(path).unwrap();
        let description = source.description();
        prop_assert_eq!(&description.format, "gadget");
        prop_assert_eq!(description.time, Some(0.25));
        prop_assert_eq!(description.redshift, Some(3.0));
        prop_assert_eq!(description.box_size, Some(100.0));
        prop_assert_eq!(description.files, files.len());
        prop_assert_eq!(&files_of(path).unwrap(), &paths);
        let kinds: Vec<usize> = (0..6).filter(|kind| totals[*kind] > 0).collect();
        prop_assert_eq!(description.families.len(), kinds.len());
        for (family, kind) in kinds.into_iter().enumerate() {
            prop_assert_eq!(description.families[family].name, FamilyName::GADGET[kind]);
            prop_assert_eq!(description.families[family].count, totals[kind] as u64);
            let all = |pick: fn(&Particles) -> Vec<f64>| -> Vec<f64> {
                files.iter().flat_map(|families| pick(&families[kind])).collect()
            };
            let positions = all(|family| flat(&family.positions));
            prop_assert_eq!(read_all(source.as_ref(), family, "position", step), positions);
            prop_assert_eq!(read_all(source.as_ref(), family, "velocity", step), all(|family| flat(&family.velocities)));
            let ids = all(|family| family.ids.iter().map(|id| *id as f64).collect());
            prop_assert_eq!(read_all(source.as_ref(), family, "id", step), ids);
            let masses = all(|family| family.masses.clone());
            let tabled = if style.table[kind] > 0.0 { vec![style.table[kind]; masses.len()] } else { masses.clone() };
            prop_assert_eq!(read_all(source.as_ref(), family, "mass", step), tabled);
            if kind == 0 {
                for (name, plus) in [("internal-energy", 1.0), ("density", 2.0), ("smoothing-length", 3.0)] {
                    let values: Vec<f64> = masses.iter().map(|mass| mass + plus).collect();
                    prop_assert_eq!(read_all(source.as_ref(), family, name, step), values);
                }
            }
        }
    }

}

proptest! {
    // Each case tries every length of a file.
    #![proptest_config(crate::cases::cases(4))]

    /// Every shortened file is an error, but for one that ends where an optional block of gas begins.
    #[test]
    fn a_shortened_file_is_an_error(style in style(), mut files in files()) {
        files.truncate(1);
        let totals = std::array::from_fn(|kind| files[0][kind].positions.len() as u32);
        prop_assume!(totals.iter().sum::<u32>() > 0);
        let whole = gadget(style, &files[0], totals, 1);
        let width = if style.double { 8 } else { 4 };
        let block = totals[0] as usize * width + if style.format == 2 { 24 } else { 8 };
        let optional: Vec<usize> = if totals[0] == 0 { vec![] } else { (1..=3).map(|n| whole.len() - n * block).collect() };
        let folder = tempfile::tempdir().unwrap();
        for length in 0..whole.len() {
            let path = file(folder.path(), "short", &whole[..length]);
            match summarize(&path) {
                Ok(_) => prop_assert!(optional.contains(&length), "{} of {} bytes", length, whole.len()),
                Err(error) => prop_assert!(message(&error, &path).contains("expected")),
            }
        }
    }
}

fn two_gas_particles() -> [Particles; 6] {
    let gas = Particles {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        velocities: vec![[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]],
        ids: vec![1, 2],
        masses: vec![1.0, 1.0],
    };
    [gas, Particles::default(), Particles::default(), Particles::default(), Particles::default(), Particles::default()]
}

const PLAIN: GadgetStyle =
    GadgetStyle { big_endian: false, format: 2, double: false, long_ids: false, table: [0.0; 6] };

#[test]
fn one_of_several_files_may_be_empty() {
    let folder = tempfile::tempdir().unwrap();
    for format in [1, 2] {
        let (some, none) = (two_gas_particles(), std::array::from_fn(|_| Particles::default()));
        for (number, families) in [&none, &some, &none].into_iter().enumerate() {
            let bytes = gadget(GadgetStyle { format, ..PLAIN }, families, [2, 0, 0, 0, 0, 0], 3);
            file(folder.path(), &format!("snap{format}_7.{number}"), &bytes);
        }
        for named in 0..3 {
            let source = open(&folder.path().join(format!("snap{format}_7.{named}"))).unwrap();
            let expected = flat(&some[0].positions);
            assert_eq!(read_all(source.as_ref(), 0, "position", 1), expected, "format {format}, file {named}");
        }
    }
}

#[test]
fn particles_that_cannot_be_drawn_are_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut particles = two_gas_particles();
    for (position, mass) in
        [([f64::NAN, 0.0, 0.0], 1.0), ([2.0, f64::INFINITY, 0.0], -1.0), ([3.0; 3], 0.0), ([4.0; 3], -3.0)]
    {
        particles[0].positions.push(position);
        particles[0].velocities.push([0.0; 3]);
        particles[0].ids.push(9);
        particles[0].masses.push(mass);
    }
    let path = file(folder.path(), "flawed", &gadget(PLAIN, &particles, [6, 0, 0, 0, 0, 0], 1));
    let summary = summarize(&path).unwrap();
    assert_eq!(summary.particles, 6);
    assert_eq!(summary.families[0].mass, 2.0);
    let counts: Vec<(&str, u64)> = summary.skipped.iter().map(|one| (one.reason.as_str(), one.count)).collect();
    assert_eq!(counts, [("non-finite position", 2), ("mass not positive, or beyond single precision", 2)]);
    assert_eq!(summary.bounds.unwrap().max.to_array(), [1.0, 0.0, 0.0]);
    let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
    assert_eq!(loaded.len(), 2);
    assert_eq!(loaded.skipped, summary.skipped);
    assert_eq!(loaded.families[0].smoothing_length, [4.0, 4.0]);
    assert_eq!(loaded.families[0].density, [3.0, 3.0]);
}

#[test]
fn counts_that_the_file_cannot_hold_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = gadget(PLAIN, &two_gas_particles(), [2, 0, 0, 0, 0, 0], 1);
    bytes[20..24].copy_from_slice(&u32::MAX.to_le_bytes());
    let path = file(folder.path(), "counts", &bytes);
    let text = message(&open(&path).err().unwrap(), &path);
    assert!(text.contains("block POS") && text.contains("expected 12884901885 values"), "{text}");
}

#[test]
fn a_missing_file_of_several_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "part.0", &gadget(PLAIN, &two_gas_particles(), [4, 0, 0, 0, 0, 0], 2));
    let text = message(&open(&path).err().unwrap(), &path);
    assert!(text.contains("part.1") && text.contains("missing"), "{text}");
}
