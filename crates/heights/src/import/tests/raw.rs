//! Samples that lie in a file in every order.

use super::super::content::Content;
use super::super::in_memory::InMemory;
use super::super::raw::{Layout, RawSamples};
use super::super::source::Samples;
use super::super::{HeightOptions, open_heights};
use super::file_of;
use crate::model::Window;
use deepfield_data::import::ByteOrder;
use deepfield_data::model::SampleType;
use proptest::prelude::*;

/// The bytes of a number in a type.
fn stored(value: i64, kind: SampleType, order: ByteOrder) -> Vec<u8> {
    let mut bytes = Vec::new();
    assert!(kind.parse_into(&value.to_string(), &mut bytes));
    if cfg!(target_endian = "big") != (order == ByteOrder::Big) {
        bytes.reverse();
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn windows_are_what_lies_there(
        columns in 2_u64..9,
        rows in 2_u64..9,
        kind in 0_usize..10,
        is_big: bool,
        is_reversed: bool,
        by_columns: bool,
        gaps in (0_u64..5, 0_u64..9),
        offset in 0_u64..20,
        window in (0_u64..9, 0_u64..9, 1_u64..9, 1_u64..9),
        in_memory: bool,
    ) {
        let kind = SampleType::ALL[kind];
        let order = if is_big { ByteOrder::Big } else { ByteOrder::Little };
        let size = kind.size() as u64;
        let mut layout = if by_columns {
            Layout { column_stride: rows * size + gaps.1, ..Layout::by_columns([columns, rows], offset, kind, order) }
        } else {
            let stride = size + gaps.0;
            Layout { column_stride: stride, row_stride: columns * stride + gaps.1, ..Layout::packed([columns, rows], offset, kind, order) }
        };
        layout.is_reversed = is_reversed;
        let value = |row: u64, column: u64| (row * 10 + column) as i64;
        let end = offset + (rows - 1) * layout.row_stride + (columns - 1) * layout.column_stride + size;
        let mut file = vec![0xee; end as usize];
        for row in 0..rows {
            for column in 0..columns {
                let there = if is_reversed { rows - 1 - row } else { row };
                let at = (offset + there * layout.row_stride + column * layout.column_stride) as usize;
                file[at..at + size as usize].copy_from_slice(&stored(value(row, column), kind, order));
            }
        }
        let (_folder, path) = file_of("a.raw", &file);
        let content = Content::open(&path, &HeightOptions::default()).unwrap();
        let samples = if in_memory {
            RawSamples::in_memory(&content, "samples", layout, file.clone()).unwrap()
        } else {
            RawSamples::new(&content, "samples", layout).unwrap()
        };
        let (row, column) = (window.0 % rows, window.1 % columns);
        let window = Window { row, column, rows: window.2.min(rows - row), columns: window.3.min(columns - column) };
        let mut out = vec![0.0; window.samples() as usize];
        samples.read(window, &mut out).unwrap();
        let expected: Vec<f64> = (0..window.rows)
            .flat_map(|r| (0..window.columns).map(move |c| (r, c)))
            .map(|(r, c)| value(row + r, column + c) as f64)
            .collect();
        prop_assert_eq!(&out, &expected);

        let all: Vec<i64> = (0..rows).flat_map(|r| (0..columns).map(move |c| value(r, c))).collect();
        InMemory::new(columns, all).read(window, &mut out).unwrap();
        prop_assert_eq!(&out, &expected);

        // One byte less, and there are too few.
        std::fs::write(&path, &file[..file.len() - 1]).unwrap();
        let content = Content::open(&path, &HeightOptions::default()).unwrap();
        let refused = RawSamples::new(&content, "samples", layout).err().map(|error| error.to_string()).unwrap_or_default();
        prop_assert!(refused.contains(&format!("found {} bytes, expected {}", end - offset - 1, end - offset)), "{}", refused);
    }
}

#[test]
fn files_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let said = |name: &str| open_heights(&folder.path().join(name), &HeightOptions::default()).unwrap_err().to_string();
    assert!(said("").contains("a folder"));
    assert!(said("nothing.sur").contains("nothing.sur: file: "));
    std::fs::write(folder.path().join("other"), b"neither heights nor anything else").unwrap();
    assert!(said("other").contains("not a known format, expected one of sur"));
    let wrong = |options: HeightOptions| open_heights(&folder.path().join("other"), &options).unwrap_err().to_string();
    for (spacing, found) in [([1.0, 0.0], "1,0"), ([f64::NAN; 2], "no two numbers")] {
        let told = wrong(HeightOptions { spacing: Some(spacing), ..HeightOptions::default() });
        assert!(told.contains(&format!("--spacing: found {found}, expected two numbers above 0, DX,DY")), "{told}");
    }
    let unit = HeightOptions { height_unit: Some(deepfield_data::model::Unit::new("deg")), ..HeightOptions::default() };
    assert!(wrong(unit).contains("--height-unit: found deg, expected km, m, mm, um or nm"));
}
