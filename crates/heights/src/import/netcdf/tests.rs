//! Files of other programs' writers.

use crate::import::tests::hostile::hostile;
use crate::import::tests::{file_of, heights, open, refusal, same};
use crate::import::{HeightOptions, height_format, open_heights};
use crate::model::{Heights, Window};

/// As GEBCO's grids are: NetCDF 4, packed, from north to south.
const GEBCO: &[u8] = include_bytes!("gebco.nc");
/// As GMT's are: classic, with another array.
const GMT: &[u8] = include_bytes!("gmt.grd");

#[test]
fn grids_of_heights_are_told_and_read() {
    let (_folder, path) = file_of("a.nc", GEBCO);
    assert!(height_format(&path).unwrap().is_some_and(|told| told.is_sure && told.format == "netcdf"));
    let source = open(&path);
    let grid = source.grid();
    assert_eq!((grid.columns, grid.rows, grid.origin, grid.step), (7, 5, [10.0, 60.0], [0.25, -0.5]));
    assert_eq!((grid.sample_type.name(), &*grid.xy_unit.0, &*grid.height_unit.0), ("int16", "deg", "m"));
    let expected: Vec<f64> =
        (0..35).map(|index| if index == 17 { f64::NAN } else { f64::from(index) * 10.0 - 100.0 }).collect();
    assert!(same(&heights(&source), &expected, 0.0) && source.description().has_spacing);
    let mut part = [0.0; 6];
    source.heights(Window { row: 1, column: 4, rows: 2, columns: 3 }, &mut part).unwrap();
    assert_eq!(part, [10.0, 20.0, 30.0, 80.0, 90.0, 100.0]);

    let (_folder, path) = file_of("a.grd", GMT);
    assert!(height_format(&path).unwrap().is_some_and(|told| told.is_sure));
    let source = open(&path);
    let grid = source.grid();
    assert_eq!((grid.columns, grid.rows, grid.origin, grid.step), (7, 5, [0.0, -1.0], [2.0, 3.0]));
    assert_eq!((grid.sample_type.name(), &*grid.xy_unit.0, &*grid.height_unit.0), ("float32", "m", ""));
    let expected: Vec<f64> = (0..35).map(|index| if index == 8 { f64::NAN } else { f64::from(index) * 0.5 }).collect();
    assert!(same(&heights(&source), &expected, 0.0));
    assert!(source.description().notes.iter().any(|note| note == "other arrays are left out: quality"));
}

#[test]
fn other_arrays_are_heights_where_that_is_asked_for() {
    // The same under a name that says nothing.
    let mut bytes = GMT.to_vec();
    let at = bytes.windows(8).rposition(|part| part == b"\0\0\0\x01z\0\0\0").unwrap();
    bytes[at + 4] = b'q';
    let (_folder, path) = file_of("a.nc", &bytes);
    assert!(height_format(&path).unwrap().is_some_and(|told| !told.is_sure));
    let asked = HeightOptions { is_asked: true, ..HeightOptions::default() };
    assert_eq!(open_heights(&path, &asked).unwrap().grid().columns, 7);
    // A length of an axis that the bytes cannot hold.
    let mut bytes = GMT.to_vec();
    let at = bytes.windows(12).position(|part| part == b"\0\0\0\x01x\0\0\0\0\0\0\x07").unwrap();
    bytes[at + 8..at + 12].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff]);
    let text = refusal("a.nc", &bytes, &HeightOptions::default());
    assert!(text.ends_with("found 252 bytes, expected 42949672940 (2147483647 x 5 of float32)"), "{text}");
}

#[test]
fn damage_is_an_answer_or_one_line() {
    hostile(&[("hostile.grd", GMT, 0..GMT.len()), ("hostile.nc", GEBCO, 0..600)], false);
}
