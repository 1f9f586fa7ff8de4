#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::import::{HeightOptions, HeightSource, open_heights};
use crate::model::HeightField;
use deepfield_data::model::{SampleType, Scale, Unit};
use proptest::prelude::*;
use std::path::PathBuf;

fn open(path: &Path) -> HeightSource {
    let options = HeightOptions { is_asked: true, ..HeightOptions::default() };
    open_heights(path, &options).unwrap_or_else(|error| panic!("{error}"))
}

fn read(heights: &dyn Heights, window: Window) -> Vec<f64> {
    let mut out = vec![0.0; window.samples() as usize];
    heights.heights(window, &mut out).unwrap();
    out
}

fn all(heights: &dyn Heights) -> Vec<f64> {
    read(heights, Window::all(heights.grid()))
}

fn same(found: &[f64], expected: &[f64], relative: f64) -> bool {
    let close = |(a, b): (&f64, &f64)| (a.is_nan() && b.is_nan()) || (a - b).abs() <= relative * b.abs();
    found.len() == expected.len() && found.iter().zip(expected).all(close)
}

fn write(heights: &dyn Heights, window: Window, path: &Path) -> Result<Exported, ExportError> {
    export_heights(heights, window, path, &ExportOptions::default(), &())
}

/// Whether the field that was read back lies where the window does.
fn is_there(source: &HeightSource, grid: &HeightGrid, window: Window, factor: f64, is_turned: bool) -> bool {
    let own = source.grid();
    let step = if is_turned { -grid.step[1] } else { grid.step[1] };
    let row = if is_turned { window.row + window.rows - 1 } else { window.row };
    let origin = grid.place(row as f64, window.column as f64);
    let near = |a: f64, b: f64, size: f64| (a - b).abs() <= 1e-12 * (b.abs() + size.abs());
    near(own.step[0], grid.step[0] * factor, 0.0)
        && near(own.step[1], step * factor, 0.0)
        && (0..2).all(|axis| near(own.origin[axis], origin[axis] * factor, grid.step[axis] * factor))
}

/// Rows from the last to the first.
fn turned(values: &[f64], width: u64) -> Vec<f64> {
    values.chunks(width as usize).rev().flatten().copied().collect()
}

#[derive(Clone, Debug)]
struct Case {
    field: HeightField,
    window: Window,
}

fn cases() -> impl Strategy<Value = Case> {
    let shape = (2_u64..30, 2_u64..30, 0.0..1.0, 0.0..1.0, 0.0..1.0, 0.0..1.0);
    let kinds = (0_usize..10, any::<bool>(), any::<bool>(), 0_usize..4, any::<bool>(), any::<u64>());
    (shape, kinds).prop_map(|((columns, rows, a, b, c, d), (kind, has_holes, is_scaled, unit, is_down, seed))| {
        let kind = SampleType::ALL[kind];
        let mut state = seed | 1;
        let mut values = Vec::new();
        for _ in 0..columns * rows {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let bits = (state >> 32) as u32;
            let value = match kind {
                SampleType::I8 => f64::from(bits as i8),
                SampleType::U8 => f64::from(bits as u8),
                SampleType::I16 => f64::from(bits as i16),
                SampleType::U16 => f64::from(bits as u16),
                SampleType::I32 => f64::from(bits as i32),
                SampleType::U32 | SampleType::I64 | SampleType::U64 => f64::from(bits),
                SampleType::F32 => f64::from(bits as f32 * 1e-3 - 1e6),
                SampleType::F64 => f64::from(bits).sqrt() - 1000.0,
            };
            values.push(if has_holes && bits.is_multiple_of(5) { f64::NAN } else { value });
        }
        let mut field = HeightField::of(columns, rows, values);
        field.grid.sample_type = kind;
        if is_scaled {
            field.grid.scale = Scale { slope: 0.37, intercept: -3.0 };
        }
        field.grid.step = [0.7, if is_down { -0.7 } else { 0.3 }];
        field.grid.origin = [1234.5, -0.1];
        let unit = ["um", "m", "mm", "km"][unit];
        (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("mm"), Unit::new(unit));
        let part = |count: u64, at: f64, size: f64| {
            let first = ((count - 1) as f64 * at) as u64;
            (first, 2.max((count - first) * (size * 8.0) as u64 / 8).min(count - first))
        };
        let ((row, high), (column, wide)) = (part(rows, a, b), part(columns, c, d));
        let (row, column) = (row.min(rows - 2), column.min(columns - 2));
        Case { field, window: Window { row, column, rows: high.max(2), columns: wide.max(2) } }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    /// What is written is read back: the same numbers in the same places.
    #[test]
    fn files_are_read_back(Case { field, window } in cases()) {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (grid, expected) = (&field.grid, read(&field, window));
        let valid = expected.iter().filter(|height| !height.is_nan()).count() as u64;
        let all_valid = field.stored.iter().all(|height| !height.is_nan());

        let done = write(&field, window, &path("a.npy")).unwrap();
        prop_assert_eq!((done.samples, done.valid), (window.samples(), valid));
        let source = open(&path("a.npy"));
        let kind = match grid.sample_type {
            _ if grid.scale != Scale::NONE => SampleType::F64,
            kind if kind.is_float() || all_valid => kind,
            _ => SampleType::F64,
        };
        prop_assert_eq!(source.grid().sample_type, kind);
        prop_assert!(same(&all(&source), &expected, 0.0));

        let done = write(&field, window, &path("a.tif")).unwrap();
        prop_assert_eq!(done.valid, valid);
        let source = open(&path("a.tif"));
        prop_assert!(same(&all(&source), &expected, 0.0));
        prop_assert!(is_there(&source, grid, window, 1.0, false), "{:?} {:?}", source.grid(), grid);
        prop_assert_eq!((&source.grid().xy_unit, &source.grid().height_unit), (&grid.xy_unit, &grid.height_unit));

        let is_down = grid.step[1] < 0.0;
        write(&field, window, &path("a.asc")).unwrap();
        let source = open(&path("a.asc"));
        let found = all(&source);
        let found = if is_down { found } else { turned(&found, window.columns) };
        prop_assert!(same(&found, &expected, 0.0));
        prop_assert!(is_there(&source, grid, window, 1.0, !is_down), "{:?} {:?}", source.grid(), grid);

        write(&field, window, &path("a.x3p")).unwrap();
        let source = open(&path("a.x3p"));
        prop_assert!(source.description().notes.is_empty(), "{:?}", source.description().notes);
        let metres = crate::model::units::metres(&grid.height_unit).unwrap();
        let found: Vec<f64> = all(&source).into_iter().map(|height| height / metres).collect();
        // Heights that cancel against the offset keep what the sum has.
        let near = |(a, b): (&f64, &f64)| a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-14 * (b.abs() + 3.0);
        let found = if is_down { turned(&found, window.columns) } else { found };
        prop_assert!(found.iter().zip(&expected).all(near), "{found:?} {expected:?}");
        prop_assert!(is_there(&source, grid, window, 1e-3, is_down), "{:?} {:?}", source.grid(), grid);

        let done = write(&field, window, &path("a.png"));
        if matches!(kind, SampleType::U8 | SampleType::U16) {
            done.unwrap();
            prop_assert!(same(&all(&open(&path("a.png"))), &expected, 0.0));
        } else {
            prop_assert!(done.unwrap_err().to_string().contains("a.png: samples: found"));
        }

        write(&field, window, &path("a.csv")).unwrap();
        let text = std::fs::read_to_string(path("a.csv")).unwrap();
        let mut lines = text.lines();
        let head = lines.next().unwrap().to_owned();
        prop_assert_eq!(head, format!("x [mm],y [mm],height [{}]", grid.height_unit.0));
        let heights: Vec<f64> = lines.map(|line| line.rsplit(',').next().unwrap().parse().unwrap()).collect();
        prop_assert_eq!(heights, expected.into_iter().filter(|height| !height.is_nan()).collect::<Vec<_>>());
    }
}

/// Many bands and strips, of long rows and of many.
#[test]
fn large_fields_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    for (columns, rows) in [(4_300_000, 2), (3, 1_500_000)] {
        let mut field =
            HeightField::of(columns, rows, (0..columns * rows).map(|place| (place % 30_011) as f64 - 9000.0).collect());
        field.grid.sample_type = SampleType::I16;
        field.grid.step[1] = -1.0;
        (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("m"), Unit::new("m"));
        for (name, is_turned) in [("a.npy", false), ("a.tif", false), ("a.asc", false), ("a.x3p", true)] {
            let path = folder.path().join(name);
            export_heights(&field, Window::all(&field.grid), &path, &ExportOptions { all_valid: Some(true) }, &())
                .unwrap();
            let source = open(&path);
            let found = all(&source);
            let found = if is_turned { turned(&found, columns) } else { found };
            assert!(found == field.stored, "{name} {columns} x {rows}");
            assert_eq!(source.grid().sample_type, SampleType::I16);
        }
    }
}

#[test]
fn no_data_of_ascii_is_no_height() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.asc");
    let mut field = HeightField::of(2, 3, vec![-9999.0, f64::NAN, -20_000.5, 7.0, f64::NAN, 1e15]);
    field.grid.step[1] = -1.0;
    let done = write(&field, Window::all(&field.grid), &path).unwrap();
    assert_eq!((done.samples, done.valid), (6, 4));
    assert!(same(&all(&open(&path)), &field.stored, 0.0), "{}", std::fs::read_to_string(&path).unwrap());
}

#[test]
fn what_cannot_be_written_is_named_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let field = HeightField::of(3, 3, vec![1.0; 9]);
    let whole = Window::all(&field.grid);
    let says = |field: &HeightField, name: &str, window: Window, expected: &[&str]| {
        let text = write(field, window, &path(name)).unwrap_err().to_string();
        assert!(
            !text.contains('\n') && text.contains(name) && expected.iter().all(|part| text.contains(part)),
            "{text}"
        );
    };
    says(&field, "a.obj", whole, &["ending: found .obj", ".npy", ".tif", ".asc", ".x3p", ".png", ".csv"]);
    says(&field, "a", whole, &["ending: found none"]);
    says(&field, "a.npy", Window { rows: 4, ..whole }, &["window", "3 x 3 of float64"]);
    says(&field, "a.x3p", whole, &["unit of places: found none", "--xy-unit"]);
    let mut degrees = field.clone();
    degrees.grid.xy_unit = Unit::new("deg");
    says(&degrees, "a.x3p", whole, &["found deg"]);
    let mut mirrored = field.clone();
    mirrored.grid.step[0] = -1.0;
    says(&mirrored, "a.asc", whole, &["spacing: found -1"]);
    let mut huge = field.clone();
    (huge.grid.columns, huge.grid.rows) = (1 << 20, 1 << 12);
    says(&huge, "a.tif", Window::all(&huge.grid), &["1048576 x 4096 of float64", "4032 MiB"]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let text = write(&field, whole, &folder.path().join("missing/a.npy")).unwrap_err().to_string();
    assert!(
        text.contains("a.npy: cannot be written: ") && !text.contains(" at path ") && !text.contains('\n'),
        "{text}"
    );
}

/// Fields of every kind as files, with what is in them, for readers of other programs.
#[test]
fn written_for_other_readers() {
    let Some(folder) = std::env::var_os("DEEPFIELD_EXPORTS").map(PathBuf::from) else { return };
    for kind in SampleType::ALL {
        for has_holes in [false, true] {
            let value = |place: u64| if has_holes && place.is_multiple_of(7) { f64::NAN } else { (place % 120) as f64 };
            let mut field = HeightField::of(70, 50, (0..3500).map(value).collect());
            field.grid.sample_type = kind;
            (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("m"), Unit::new("m"));
            (field.grid.origin, field.grid.step) = ([5.0, 700.0], [0.5, -0.5]);
            for ending in ["npy", "tif", "asc", "x3p"] {
                // Increments of x3p are above 0.
                field.grid.step[1] = if ending == "x3p" { 0.5 } else { -0.5 };
                let path = folder.join(format!("{kind}-{}.{ending}", if has_holes { "holes" } else { "whole" }));
                write(&field, Window::all(&field.grid), &path).unwrap();
            }
        }
    }
}
