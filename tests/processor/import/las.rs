//! LAS and LAZ: every point format gives what is written, also by another library; what is damaged is an error.

use super::writers::file;
use super::{message, read_all};
use deepfield::import::{open, summarize};
use laz::laszip::ChunkTable;
use laz::{LasZipCompressor, LazVlr, LazVlrBuilder};
use proptest::prelude::*;
use std::io::Cursor;

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

/// A record between header and points: who has given it its number, the number, and what is in it.
type Record<'a> = (&'a [u8], u16, &'a [u8]);

/// The same points packed by another library, in chunks of so many points; 0: of different numbers.
fn packed(plain: &[u8], format: usize, extra: usize, chunk: u32) -> Vec<u8> {
    packed_behind(plain, format, extra, chunk, (b"another", 1, &[7; 3]))
}

/// The same with this record before LASzip's.
fn packed_behind(plain: &[u8], format: usize, extra: usize, chunk: u32, other: Record<'_>) -> Vec<u8> {
    let builder = LazVlrBuilder::default().with_point_format(format as u8, extra as u16).unwrap();
    let vlr = match chunk {
        0 => builder.with_variable_chunk_size(),
        points => builder.with_fixed_chunk_size(points),
    }
    .build();
    let mut record = Vec::new();
    vlr.write_to(&mut record).unwrap();
    let (header, points) = (&plain[..375], &plain[380..]);
    let mut bytes = header.to_vec();
    bytes[104] |= 0x80;
    for (user, number, content) in [other, (LazVlr::USER_ID.as_bytes(), LazVlr::RECORD_ID, &*record)] {
        let mut about = [0; 54];
        about[2..2 + user.len()].copy_from_slice(user);
        about[18..20].copy_from_slice(&number.to_le_bytes());
        about[20..22].copy_from_slice(&(content.len() as u16).to_le_bytes());
        bytes.extend(about);
        bytes.extend(content);
    }
    let start = bytes.len() as u32;
    bytes[96..100].copy_from_slice(&start.to_le_bytes());
    bytes[100..104].copy_from_slice(&2_u32.to_le_bytes());
    let mut out = Cursor::new(bytes);
    out.set_position(u64::from(start));
    let mut compressor = LasZipCompressor::new(&mut out, vlr).unwrap();
    let stride = FORMATS[format].0 + extra;
    match chunk {
        // 1, 2, 3... points.
        0 => {
            let (mut rest, mut size) = (points, 1);
            while !rest.is_empty() {
                let (now, later) = rest.split_at(rest.len().min(size * stride));
                compressor.compress_many(now).unwrap();
                compressor.finish_current_chunk().unwrap();
                (rest, size) = (later, size + 1);
            }
        }
        _ => compressor.compress_many(points).unwrap(),
    }
    compressor.done().unwrap();
    drop(compressor);
    out.into_inner()
}

/// A COPC file (<https://copc.io>): its record before all others, a chunk for each node of its octree, and behind the points a record of which node is
/// where.
fn copc(plain: &[u8], format: usize) -> Vec<u8> {
    // Whole numbers of 8 bytes follow the middle, half the edge and the spacing of the octree.
    const TREE: usize = 375 + 54 + 40;
    let mut bytes = packed_behind(plain, format, 0, 0, (b"copc", 1, &[0; 160]));
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let start = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let table = ChunkTable::read(&mut Cursor::new(&bytes[word(start) as usize..]), true).unwrap();
    let mut nodes = Vec::new();
    let mut at = start as u64 + 8;
    for (level, chunk) in table.as_ref().iter().enumerate() {
        nodes.extend([level as u32, 0, 0, 0].into_iter().flat_map(u32::to_le_bytes));
        nodes.extend(at.to_le_bytes());
        nodes.extend([chunk.byte_count as u32, chunk.point_count as u32].into_iter().flat_map(u32::to_le_bytes));
        at += chunk.byte_count;
    }
    let mut about = [0; 60];
    about[2..6].copy_from_slice(b"copc");
    about[18..20].copy_from_slice(&1000_u16.to_le_bytes());
    about[20..28].copy_from_slice(&(nodes.len() as u64).to_le_bytes());
    let behind = bytes.len() as u64;
    bytes.extend(about.into_iter().chain(nodes.iter().copied()));
    bytes[235..243].copy_from_slice(&behind.to_le_bytes());
    bytes[243..247].copy_from_slice(&1_u32.to_le_bytes());
    bytes[TREE..TREE + 8].copy_from_slice(&(behind + 60).to_le_bytes());
    bytes[TREE + 8..TREE + 16].copy_from_slice(&(nodes.len() as u64).to_le_bytes());
    bytes
}

/// Points that are much alike, as those of a scan.
fn scan(count: i32) -> Vec<Point> {
    let point =
        |i: i32| ([i * 7, i * i % 1001 - 500, i % 50], (i % 300) as u16, (i % 9) as u8, 1e3 + f64::from(i) * 1e-3);
    (0..count).map(point).collect()
}

#[test]
fn packed_points_are_those_that_were_packed() {
    let folder = tempfile::tempdir().unwrap();
    let points = scan(1000);
    let are_the_same = |plain: &[u8], packed: &[u8], what: &str| {
        let one = file(folder.path(), "plain.las", plain);
        let other = file(folder.path(), "packed.laz", packed);
        let [one, other] = [one, other].map(|path| open(&path).unwrap());
        let fields = &one.description().families[0].fields;
        assert_eq!(fields.len(), other.description().families[0].fields.len(), "{what}");
        for field in fields {
            let [plain, unpacked] = [&one, &other].map(|source| read_all(source.as_ref(), 0, &field.name, 177));
            assert!(plain == unpacked, "{what}: {}", field.name);
        }
    };
    for (format, extra, chunk) in
        [(0, 0, 100), (1, 2, 50_000), (2, 0, 333), (3, 1, 0), (6, 0, 100), (7, 3, 0), (8, 1, 999), (8, 0, 1000)]
    {
        let plain = las(format, extra, &points);
        are_the_same(&plain, &packed(&plain, format, extra, chunk), &format!("format {format}, chunks of {chunk}"));
    }
    for format in 6..9 {
        let plain = las(format, 0, &points);
        are_the_same(&plain, &copc(&plain, format), &format!("COPC of format {format}"));
    }
}

/// Whatever becomes of a packed file, it is points or an error that names it.
#[test]
fn damaged_packed_points_are_errors_or_other_points() {
    let folder = tempfile::tempdir().unwrap();
    for (format, chunk) in [(3, 0), (7, 40)] {
        let whole = packed(&las(format, 0, &scan(100)), format, 0, chunk);
        let check = |bytes: &[u8]| {
            let path = file(folder.path(), "damaged.laz", bytes);
            match open(&path) {
                Ok(source) => {
                    drop(summarize(&path).map_err(|error| message(&error, source.description().path.as_path())))
                }
                Err(error) => drop(message(&error, &path)),
            }
        };
        (0..whole.len()).step_by(37).for_each(|length| check(&whole[..length]));
        for at in (0..whole.len()).filter(|at| at % if *at < 600 { 7 } else { 101 } == 0) {
            for value in [0, 0xff, whole[at] ^ 0x11] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                check(&bytes);
            }
        }
    }
}
