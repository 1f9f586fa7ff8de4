//! LAS: every point format gives what is written; LAZ and what is cut are errors.

use super::writers::file;
use super::{message, read_all};
use deepfield::import::{open, summarize};
use proptest::prelude::*;

/// Position, intensity, class and time of a point.
type Point = ([i32; 3], u16, u8, f64);

const SCALE: [f64; 3] = [0.01, 0.001, 0.25];
const OFFSET: [f64; 3] = [5e5, -3.0, 0.0];
/// Bytes of a point of each format (LAS 1.4 R15, tables 7 to 18), and whether it has a time and colours.
const FORMATS: [(usize, bool, bool); 11] = [
    (20, false, false),
    (28, true, false),
    (26, false, true),
    (34, true, true),
    (57, true, false),
    (63, true, true),
    (30, true, false),
    (36, true, true),
    (38, true, true),
    (59, true, false),
    (67, true, true),
];

/// The bytes of a file of version 1.4; each point has `extra` bytes more than its format has.
fn las(format: usize, extra: usize, points: &[Point]) -> Vec<u8> {
    let mut header = vec![0_u8; 375];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"LASF");
    put(24, &[1, 4]);
    put(94, &375_u16.to_le_bytes());
    put(96, &380_u32.to_le_bytes());
    put(104, &[format as u8]);
    let (size, has_time, has_colours) = FORMATS[format];
    put(105, &((size + extra) as u16).to_le_bytes());
    if format < 6 {
        put(107, &(points.len() as u32).to_le_bytes());
    }
    put(247, &(points.len() as u64).to_le_bytes());
    for (axis, (scale, offset)) in SCALE.iter().zip(&OFFSET).enumerate() {
        put(131 + 8 * axis, &scale.to_le_bytes());
        put(155 + 8 * axis, &offset.to_le_bytes());
    }
    let mut bytes = header;
    bytes.extend([0xee; 5]);
    for (position, intensity, class, time) in points {
        let mut point = vec![0xff_u8; size + extra];
        let mut put = |at: usize, bytes: &[u8]| point[at..at + bytes.len()].copy_from_slice(bytes);
        for (axis, number) in position.iter().enumerate() {
            put(4 * axis, &number.to_le_bytes());
        }
        put(12, &intensity.to_le_bytes());
        // The flags of the older formats are in the byte of the class.
        put(if format < 6 { 15 } else { 16 }, &[if format < 6 { class | 0xe0 } else { *class }]);
        let at = if format < 6 { 20 } else { 22 };
        if has_time {
            put(at, &time.to_le_bytes());
        }
        if has_colours {
            let at = if has_time { at + 8 } else { at };
            put(at, &[1, 0, 2, 0, 3, 1]);
        }
        bytes.extend(point);
    }
    bytes
}

/// A small file.
pub fn sample() -> Vec<u8> {
    let points: Vec<Point> = (0..40).map(|i| ([i, i * i % 7, i % 5], i as u16, 2, f64::from(i))).collect();
    las(7, 3, &points)
}

proptest! {
    #![proptest_config(crate::cases::cases(48))]

    #[test]
    fn what_is_written_comes_back(
        format in 0..11_usize,
        extra in 0..4_usize,
        points in prop::collection::vec((any::<[i32; 3]>(), any::<u16>(), 0..32_u8, -1e9..1e9f64), 1..9),
        step in 1..4u64,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), "points", &las(format, extra, &points));
        let source = open(&path).unwrap();
        let read = |name: &str| read_all(source.as_ref(), 0, name, step);
        let position: Vec<f64> = points
            .iter()
            .flat_map(|point| [0, 1, 2].map(|axis| SCALE[axis] * f64::from(point.0[axis]) + OFFSET[axis]))
            .collect();
        prop_assert_eq!(read("position"), position);
        prop_assert_eq!(read("intensity"), points.iter().map(|point| f64::from(point.1)).collect::<Vec<_>>());
        prop_assert_eq!(read("classification"), points.iter().map(|point| f64::from(point.2)).collect::<Vec<_>>());
        let (_, has_time, has_colours) = FORMATS[format];
        let info = &source.description().families[0];
        prop_assert_eq!(info.named("gps-time").is_some(), has_time);
        prop_assert_eq!(info.named("blue").is_some(), has_colours);
        prop_assert_eq!(info.named("near-infrared").is_some(), format == 8 || format == 10);
        if has_time {
            prop_assert_eq!(read("gps-time"), points.iter().map(|point| point.3).collect::<Vec<_>>());
        }
        if has_colours {
            prop_assert_eq!(read("red"), vec![1.0; points.len()]);
            prop_assert_eq!(read("blue"), vec![259.0; points.len()]);
        }
        prop_assert_eq!(source.description().notes.len(), usize::from(extra > 0));
    }
}

#[test]
fn a_shortened_file_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = las(3, 1, &[([1, 2, 3], 4, 5, 6.0), ([7, 8, 9], 10, 11, 12.0)]);
    for length in 0..bytes.len() {
        let path = file(folder.path(), "short", &bytes[..length]);
        message(&summarize(&path).err().unwrap_or_else(|| panic!("{length} bytes")), &path);
    }
}

#[test]
fn compressed_points_are_told_with_what_unpacks_them() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = sample();
    bytes[104] |= 0x80;
    let path = file(folder.path(), "points", &bytes);
    let text = message(&open(&path).err().unwrap(), &path);
    assert!(text.contains("LAZ") && text.contains("laszip"), "{text}");
}
