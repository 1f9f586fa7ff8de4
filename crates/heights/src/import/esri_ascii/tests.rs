#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use crate::import::tests::hostile::hostile;
use crate::import::tests::{file_of, heights, open, refusal, same};
use crate::import::{HeightOptions, height_format, summarize_heights};
use crate::model::Heights;
use deepfield_data::model::SampleType;
use std::fmt::Write;
use std::path::PathBuf;

fn grid(columns: i64, rows: i64, more: &str, count: usize) -> String {
    format!("ncols {columns}\nnrows {rows}\nxllcorner 0\nyllcorner 0\n{more}\n{}\n", "7 ".repeat(count))
}

#[test]
fn headers_in_any_case_and_rows_of_any_length_are_read() {
    let (_folder, path) = file_of(
        "a.asc",
        b"\xef\xbb\xbfNCOLS 3\r\nNROWS\t2\r\nXLLCENTER 10.5\r\nYLLCENTER 20\r\nCELLSIZE 2\r\nNODATA_VALUE -1\r\nZUNIT m\r\n1 2\r\n3 nan -1\n\n  1e2",
    );
    let source = open(&path);
    let grid = source.grid();
    assert_eq!((grid.columns, grid.rows, grid.origin, grid.step), (3, 2, [10.5, 22.0], [2.0, -2.0]));
    assert!(same(&heights(&source), &[1.0, 2.0, 3.0, f64::NAN, f64::NAN, 100.0], 0.0));
    assert!(source.description().notes.iter().any(|note| note.contains("zunit m")), "{:?}", source.description().notes);
    let found = summarize_heights(&source).unwrap();
    assert_eq!((found.invalid.nan, found.invalid.no_data), (1, 1));
    // Corners, one step an axis, and -9999 for no data.
    let (_folder, path) = file_of("a.asc", b"ncols 2 nrows 2 xllcorner 1 yllcorner 2 dx 1 dy 4 -9999 2.5 3 4");
    let source = open(&path);
    assert_eq!((source.grid().origin, source.grid().step), ([1.5, 8.0], [1.0, -4.0]));
    assert!(same(&heights(&source), &[f64::NAN, 2.5, 3.0, 4.0], 0.0));
    // A height of 0 is no data where the header says so.
    let (_folder, path) = file_of("a.asc", b"ncols 2 nrows 2 cellsize 1 nodata_value 0 0 2.5 3 4");
    assert!(same(&heights(&open(&path)), &[f64::NAN, 2.5, 3.0, 4.0], 0.0));
    // No distance.
    let (_folder, path) = file_of("a.asc", b"ncols 2\nnrows 2\n1 2 3 4");
    let source = open(&path);
    assert!(source.description().notes.iter().any(|note| note.contains("--spacing")));
    assert!(height_format(&path).unwrap().unwrap().is_sure);
}

#[test]
fn types_are_the_least_that_hold_all_values() {
    for (values, kind) in [
        ("1 2 3 -32768", SampleType::I16),
        ("1 2.0 3e1 32768", SampleType::I32),
        ("1 2 3 4.5", SampleType::F64),
        ("1 2 3 1e10", SampleType::F64),
        ("1 2 3 nan", SampleType::F64),
        ("1 2 3 -0", SampleType::F64),
    ] {
        let (_folder, path) = file_of("a.asc", format!("ncols 2\nnrows 2\n{values}").as_bytes());
        assert_eq!(open(&path).grid().sample_type, kind, "{values}");
    }
}

#[test]
fn values_over_many_pieces_are_read() {
    let (columns, rows) = (1500, 1400);
    let value = |place: usize| (place % 100_003) as f64 / 16.0 - 1000.0;
    let mut text = format!("ncols {columns}\nnrows {rows}\ncellsize 1\n");
    for place in 0..columns * rows {
        write!(text, "{}{}", value(place), if place % 777 == 0 { "\n" } else { " " }).unwrap();
    }
    let (_folder, path) = file_of("a.asc", text.as_bytes());
    let expected: Vec<f64> = (0..columns * rows).map(value).collect();
    assert!(same(&heights(&open(&path)), &expected, 0.0));
    let wrong = text.replacen(&format!(" {} ", value(1_000_000)), " 12,5 ", 1);
    let text = refusal("a.asc", wrong.as_bytes(), &HeightOptions::default());
    assert!(text.contains("\"12,5\" in row"), "{text}");
}

#[test]
fn what_is_wrong_is_named_with_both_numbers() {
    let says = |text: &str, expected: &[&str]| {
        let found = refusal("a.asc", text.as_bytes(), &HeightOptions::default());
        assert!(found.starts_with("a.asc: ") && expected.iter().all(|part| found.contains(part)), "{found}");
    };
    let cell = "cellsize 1";
    says(&grid(4, 3, cell, 11), &["values: found 11, the last in line 6, expected 12 (4 x 3)"]);
    says(&grid(4, 3, cell, 5), &["values: found 5, the last in line 6, expected 12 (4 x 3)"]);
    says(&grid(4, 3, cell, 13), &["values: found 13, the last in line 6, expected 12 (4 x 3)"]);
    says(&grid(4, 3, cell, 130), &["values: found 130", "12 (4 x 3)"]);
    says(&grid(4, 3, cell, 0), &["values: found 0, expected 12 (4 x 3)"]);
    // One value short with blanks as short as can be, and behind the last value lines without any.
    says("ncols 3\nnrows 3\n1 2 3\n4 5 6\n7 8", &["values: found 8, the last in line 5, expected 9 (3 x 3)"]);
    says("ncols 3\r\nnrows 3\r\n1 2 3\r\n4 5 6\r\n7 8\r\n\r\n\r\n", &["values: found 8, the last in line 5"]);
    says("ncols 3\nnrows 3\n1 2 3\n4 5 6\n7 8 9\n\n10\n", &["values: found 10, the last in line 7, expected 9"]);
    let long = format!("ncols 3000\nnrows 1000\n{}", "12\n".repeat(2_999_999));
    says(&long, &["values: found 2999999, the last in line 3000001, expected 3000000"]);
    says(&grid(0, 3, cell, 12), &["ncols: found 0"]);
    says(&grid(4, -5, cell, 12), &["nrows: found -5"]);
    says(&grid(1, 12, cell, 12), &["ncols", "2 x 2"]);
    says(&grid(1 << 31, 1 << 31, cell, 12), &["found", "expected"]);
    says(&grid(1 << 20, 1 << 20, cell, 12), &["values: found 12", "1099511627776"]);
    says(&grid(4, 3, "cellsize 0", 12), &["cellsize: found 0"]);
    says(&grid(4, 3, "cellsize nan", 12), &["cellsize: found NaN"]);
    says(&grid(4, 3, "cellsize x", 12), &["cellsize: found x"]);
    says("ncols 2\n1 2 3 4", &["nrows: missing"]);
    says("ncols 2\nnrows 2.5\n1 2 3 4", &["nrows: found 2.5"]);
    says("ncols 2\nnrows 2\n1 2 x 4", &["\"x\" in row 1, column 0"]);
    says("ncols", &["ncols"]);
    says(&"ncols 2 ".repeat(10_000), &["header"]);
    says(&format!("ncols 2\nnrows 2\n{}", "1".repeat(20_000_000)), &["found"]);
}

#[test]
fn damage_is_an_answer_or_one_line() {
    let text = format!("ncols 9\nnrows 8\ncellsize 1\nnodata_value 3\n{}", "1 2.5 3 -4e1 5 6 7 8 9\n".repeat(8));
    hostile(&[("hostile.asc", text.as_bytes(), 0..80)], true);
}

#[test]
fn real_files_are_as_stated() {
    let Some(folder) = std::env::var_os("DEEPFIELD_DATA") else { return };
    let first = |corner: f64, step: f64, rows: f64| corner + (rows - 0.5) * step;
    let step = 0.000_833_333_3;
    for (name, [columns, rows, valid], range, origin) in [
        (
            "srtm_colorado.asc",
            [144, 144, 144 * 144],
            [2186.0, 3345.0, 2727.39],
            [first(-105.5604, step, 1.0), first(40.09042, step, 144.0)],
        ),
        ("hugo_site.asc", [76, 55, 76 * 55 - 2028], [1660.0, 1711.0, 1689.57], [5.0, 545.0]),
    ] {
        let path = PathBuf::from(&folder).join("heightfields").join(name);
        if !path.is_file() {
            continue;
        }
        let source = open(&path);
        let found = summarize_heights(&source).unwrap();
        assert_eq!((found.columns, found.rows, found.valid), (columns, rows, valid), "{name}");
        assert_eq!((found.min, found.max), (range[0], range[1]), "{name}");
        assert!((found.mean - range[2]).abs() < 0.005, "{name}: {}", found.mean);
        assert!((0..2).all(|axis| (found.origin[axis] - origin[axis]).abs() < 1e-4), "{name}: {:?}", found.origin);
        assert!(found.spacing[1] < 0.0 && found.sample_type == "i16", "{name}: {}", found.sample_type);
    }
}
