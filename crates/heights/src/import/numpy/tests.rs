#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use crate::import::tests::hostile::hostile;
use crate::import::tests::{file_of, heights, open, refusal, same};
use crate::import::{HeightOptions, height_format, open_heights, summarize_heights};
use crate::model::Heights;
use deepfield_data::model::SampleType;
use std::io::Write;
use std::path::PathBuf;
use zip::write::SimpleFileOptions;

/// An array's file.
fn npy(descr: &str, is_fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if is_fortran { "True" } else { "False" };
    let text = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    let head = format!("{text:<117}\n");
    [b"\x93NUMPY\x01\0".as_slice(), &(head.len() as u16).to_le_bytes(), head.as_bytes(), data].concat()
}

fn f64s(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// An archive of arrays.
fn npz(arrays: &[(&str, Vec<u8>)], is_packed: bool) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let method = if is_packed { zip::CompressionMethod::Deflated } else { zip::CompressionMethod::Stored };
    for (name, bytes) in arrays {
        archive.start_file(format!("{name}.npy"), SimpleFileOptions::default().compression_method(method)).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

#[test]
fn arrays_of_every_type_and_order_are_read() {
    let expected = [1.0, 2.0, 3.0, 4.0, 5.0, 100.0];
    // Rows of three; by columns they are 1, 4, 2, 5, 3, 100.
    for kind in SampleType::ALL {
        for is_big in [false, true] {
            for is_fortran in [false, true] {
                let order = if is_fortran { [0, 3, 1, 4, 2, 5] } else { [0, 1, 2, 3, 4, 5] };
                let mut data = Vec::new();
                for place in order {
                    let value: f64 = expected[place];
                    let mut bytes = match kind {
                        SampleType::F32 => (value as f32).to_le_bytes().to_vec(),
                        SampleType::F64 => value.to_le_bytes().to_vec(),
                        kind => (value as i64).to_le_bytes()[..kind.size()].to_vec(),
                    };
                    if is_big {
                        bytes.reverse();
                    }
                    data.append(&mut bytes);
                }
                let letter = if kind.is_float() { 'f' } else { kind.name().chars().next().unwrap() };
                let sign = if kind.size() == 1 {
                    '|'
                } else if is_big {
                    '>'
                } else {
                    '<'
                };
                let bytes = npy(&format!("{sign}{letter}{}", kind.size()), is_fortran, "(2, 3)", &data);
                let (_folder, path) = file_of("a.npy", &bytes);
                let options = HeightOptions { is_asked: true, ..HeightOptions::default() };
                let source = open_heights(&path, &options).unwrap_or_else(|error| panic!("{error}"));
                assert_eq!((source.grid().columns, source.grid().rows, source.grid().sample_type), (3, 2, kind));
                assert!(same(&heights(&source), &expected, 0.0), "{kind} {is_big} {is_fortran}");
                assert_eq!(height_format(&path).unwrap().unwrap().is_sure, kind.size() > 1);
                assert_eq!(open_heights(&path, &HeightOptions::default()).is_ok(), kind.size() > 1);
            }
        }
    }
}

#[test]
fn what_is_no_field_is_named() {
    let options = HeightOptions::default();
    let says = |bytes: &[u8], expected: &[&str]| {
        let text = refusal("a.npy", bytes, &options);
        assert!(text.starts_with("a.npy: ") && expected.iter().all(|part| text.contains(part)), "{text}");
    };
    says(&npy("<f8", false, "(3, 4, 5)", &[0; 480]), &["3 axes (3, 4, 5)", "expected 2 axes"]);
    says(&npy("<f8", false, "(9,)", &[0; 72]), &["1 axes (9,)"]);
    says(&npy("<f8", false, "(1, 9)", &[0; 72]), &["9 x 1", "2 x 2"]);
    says(&npy("<i2", false, "(2147483648, 2147483648)", &[0; 64]), &["found", "expected"]);
    says(&npy("<i2", false, "(1000, 1000)", &[0; 64]), &["found 64 bytes", "2000000 (1000 x 1000 of int16)"]);
    says(&npy("<c8", false, "(3, 3)", &[0; 72]), &["descr", "<c8"]);
    says(&npy("<f2", false, "(3, 3)", &[0; 72]), &["descr", "<f2"]);
    says(&npy("|O", false, "(3, 3)", &[0; 72]), &["descr"]);
    says(&npy("<f8", false, "(-3, 3)", &[0; 72]), &["shape", "(-3, 3)"]);
    says(b"\x93NUMPY\x09\0", &["version 9"]);
    let bytes = npy("<f8", false, "(3, 3)", &f64s(&[1.0; 10]));
    let (_folder, path) = file_of("a.npy", &bytes);
    assert!(open(&path).description().notes.iter().any(|note| note.starts_with("8 bytes behind")));
}

#[test]
fn damage_is_an_answer_or_one_line() {
    let doubles = |shape: &str, count: usize| npy("<f8", false, shape, &f64s(&vec![1.0; count]));
    hostile(&[("hostile.npy", &doubles("(3, 3)", 10)[..], 0..128)], true);
    let archive = npz(&[("z", doubles("(20, 20)", 400)), ("x", doubles("(20,)", 20)), ("dy", doubles("()", 1))], true);
    hostile(&[("hostile.npz", &archive[..], 0..600)], false);
}

#[test]
fn archives_tell_places() {
    let heights_of = |columns: usize, rows: usize| {
        npy("<f8", false, &format!("({rows}, {columns})"), &f64s(&vec![7.0; columns * rows]))
    };
    let axis = |values: &[f64]| npy("<f8", false, &format!("({},)", values.len()), &f64s(values));
    let scalar = |value: f64| npy("<f8", false, "()", &f64s(&[value]));
    for is_packed in [false, true] {
        // South to north, past 360 degrees.
        let bytes = npz(
            &[
                ("mask", npy("|u1", false, "(2, 2)", &[0; 4])),
                ("elevation", heights_of(4, 3)),
                ("lat", axis(&[-90.0, 0.0, 90.0])),
                ("lon", axis(&[20.0, 140.0, 260.0, 380.0])),
            ],
            is_packed,
        );
        let (_folder, path) = file_of("a.npz", &bytes);
        let source = open(&path);
        let grid = source.grid();
        assert_eq!((grid.origin, grid.step, &*grid.xy_unit.0), ([20.0, -90.0], [120.0, 90.0], "deg"));
        assert!(source.description().has_spacing);
        assert!(
            source.description().notes.iter().any(|note| note.contains("mask (2, 2)")),
            "{:?}",
            source.description().notes
        );
        // Steps and corners: of cells, with the labels of y swapped.
        let bytes = npz(
            &[
                ("elevation", heights_of(4, 3)),
                ("dx", scalar(0.5)),
                ("xmin", scalar(10.0)),
                ("xmax", scalar(12.0)),
                ("dy", scalar(0.25)),
                ("ymin", scalar(50.0)),
                ("ymax", scalar(49.25)),
            ],
            is_packed,
        );
        let (_folder, path) = file_of("a.npz", &bytes);
        let source = open(&path);
        assert_eq!((source.grid().origin, source.grid().step), ([10.25, 49.875], [0.5, -0.25]));
        assert!(
            source.description().notes.iter().any(|note| note.contains("ymin 50 is above ymax 49.25")),
            "{:?}",
            source.description().notes
        );
        // Of samples.
        let bytes = npz(
            &[
                ("z", heights_of(4, 3)),
                ("xmin", scalar(1.0)),
                ("xmax", scalar(4.0)),
                ("ymin", scalar(0.0)),
                ("ymax", scalar(4.0)),
            ],
            is_packed,
        );
        let (_folder, path) = file_of("a.npz", &bytes);
        assert_eq!((open(&path).grid().origin, open(&path).grid().step), ([1.0, 0.0], [1.0, 2.0]));
        // Uneven places, and such that stand still.
        let bytes =
            npz(&[("z", heights_of(3, 3)), ("x", axis(&[0.0, 1.0, 4.0])), ("y", axis(&[0.0, 1.0, 2.0]))], is_packed);
        let (_folder, path) = file_of("a.npz", &bytes);
        assert!(open(&path).description().notes.iter().any(|note| note.contains("x is not evenly spaced")));
        let bytes =
            npz(&[("z", heights_of(3, 3)), ("x", axis(&[0.0, 1.0, 0.0])), ("y", axis(&[0.0, 1.0, 2.0]))], is_packed);
        let text = refusal("a.npz", &bytes, &HeightOptions::default());
        assert!(text.contains("a.npz: x: found 0 to 0"), "{text}");
        // Places as arrays of two axes are no heights.
        let bytes = npz(&[("x", heights_of(3, 3)), ("y", heights_of(3, 3)), ("z", heights_of(3, 3))], is_packed);
        let (_folder, path) = file_of("a.npz", &bytes);
        assert!(open(&path).description().notes[0] == "array z");
        let bytes = npz(&[("volume", npy("<f8", false, "(2, 2, 2)", &[0; 64]))], is_packed);
        let text = refusal("a.npz", &bytes, &HeightOptions::default());
        assert!(text.contains("volume (2, 2, 2)") && text.contains("2 axes"), "{text}");
        let bytes = npz(&[("z", npy("<f8", false, "(300, 300)", &[0; 64]))], is_packed);
        let text = refusal("a.npz", &bytes, &HeightOptions::default());
        assert!(text.contains("300 x 300"), "{text}");
    }
}

/// Name, columns, rows, least, largest, mean, first place and steps.
type Stated = (&'static str, [u64; 2], [f64; 3], [f64; 2], [f64; 2]);

#[test]
fn real_files_are_as_stated() {
    let Some(folder) = std::env::var_os("DEEPFIELD_DATA") else { return };
    let third = 1.0 / 3.0;
    let stated: [Stated; 3] = [
        (
            "jacksboro_fault_dem.npz",
            [403, 344],
            [236.0, 1076.0, 531.0312],
            [-84.41375 + 0.000_416_667, 36.73292 - 0.000_416_667],
            [0.000_833_333_3, -0.000_833_333_3],
        ),
        ("topobathy.npz", [120, 91], [-1437.0, 2205.0, 273.6473], [234.0167, 48.01637], [0.033_333_3, 0.021_864_6]),
        ("etopo20_global.npz", [1081, 540], [-9026.625, 6228.812, -1894.699], [20.166_67, -89.833_33], [third, third]),
    ];
    for (name, [columns, rows], range, origin, step) in stated {
        let path = PathBuf::from(&folder).join("heightfields").join(name);
        if !path.is_file() {
            continue;
        }
        let source = open(&path);
        let found = summarize_heights(&source).unwrap();
        assert_eq!((found.columns, found.rows, found.valid), (columns, rows, columns * rows), "{name}");
        for (found, stated) in [found.min, found.max, found.mean].into_iter().zip(range) {
            assert!((found - stated).abs() <= 1e-6 * range[1].max(-range[0]), "{name}: {found}, not {stated}");
        }
        for axis in 0..2 {
            assert!((found.origin[axis] - origin[axis]).abs() < 1e-4, "{name}: {:?}", found.origin);
            assert!((found.spacing[axis] / step[axis] - 1.0).abs() < 1e-4, "{name}: {:?}", found.spacing);
        }
        assert!(height_format(&path).unwrap().unwrap().is_sure);
        eprintln!("{name}: {:?} {:?}", found.notes, found.xy_unit);
    }
}
