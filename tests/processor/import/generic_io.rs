//! GenericIO: arrays of several processes in either byte order, with and without places of arrays, compressed or not, in one file or behind a
//! map.

use super::hostile::survives_at;
use super::writers::file;
use super::{data, message, read_all};
use deepfield::import::{FieldKind, files_of, open};
use proptest::prelude::*;

/// How a file is written.
#[derive(Clone, Copy, Debug)]
struct Style {
    big: bool,
    /// With a table of where arrays are, and of how they are compressed.
    blocks: bool,
    filter: &'static str,
    /// In BLOSC's containers, in blocks of so many rows; 0: without any.
    packed: Option<usize>,
}

impl Style {
    fn new(big: bool, blocks: bool, packed: Option<usize>) -> Style {
        let filter = if packed.is_some() { "BLOSC" } else { "" };
        Style { big, blocks: blocks || packed.is_some(), filter, packed }
    }
}

/// A variable: its name, its flags, its size, and the bytes of a number as they are in memory.
type Variable<'a> = (&'a str, u64, usize, &'a dyn Fn(usize) -> Vec<u8>);

/// The checksum bit by bit.
fn checksum(bytes: &[u8]) -> u64 {
    !bytes.iter().fold(u64::MAX, |sum, byte| {
        (0..8).fold(sum ^ u64::from(*byte), |sum, _| (sum >> 1) ^ if sum & 1 == 1 { 0xc96c_5795_d787_0f42 } else { 0 })
    })
}

fn closed(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend((!checksum(&bytes)).to_le_bytes());
    bytes
}

/// A container of BLOSC for numbers of `size` bytes: what is in it is copied, or in blocks of `rows` numbers, whose bytes are shuffled and not
/// compressed. Its own numbers have the least byte first.
fn container(bytes: &[u8], size: usize, rows: usize) -> Vec<u8> {
    let numbers = |numbers: &[usize]| numbers.iter().flat_map(|n| (*n as u32).to_le_bytes()).collect::<Vec<u8>>();
    let header = |flags: u8, block: usize, length: usize| {
        [vec![2, 1, flags, size as u8], numbers(&[bytes.len(), block, length])].concat()
    };
    if rows == 0 {
        return [header(2, bytes.len(), 16 + bytes.len()), bytes.to_vec()].concat();
    }
    let block = (rows * size).min(bytes.len());
    let count = bytes.len().div_ceil(block);
    let (mut starts, mut streams) = (Vec::new(), Vec::<u8>::new());
    for rows in bytes.chunks(block) {
        starts.push(16 + 4 * count + streams.len());
        streams.extend(numbers(&[rows.len()]));
        (0..size).for_each(|byte| streams.extend(rows.iter().skip(byte).step_by(size)));
    }
    [header(1 | 16, block, 16 + 4 * count + streams.len()), numbers(&starts), streams].concat()
}

/// A file in which processes have `counts` rows of the variables, one process after the other.
fn written(style: Style, variables: &[Variable], counts: &[usize]) -> Vec<u8> {
    let word = |bytes: &[u8]| -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        if style.big {
            bytes.reverse();
        }
        bytes
    };
    let numbers =
        |numbers: &[u64]| -> Vec<u8> { numbers.iter().flat_map(|number| word(&number.to_le_bytes())).collect() };
    let (variable_count, process_count) = (variables.len() as u64, counts.len() as u64);
    let variables_start = 168;
    let processes_start = variables_start + 280 * variable_count;
    let blocks_start = processes_start + 48 * process_count;
    let block_size = if style.blocks { 48 } else { 0 };
    let length = blocks_start + block_size * variable_count * process_count;
    let mut header = if style.big { b"HACC01B\0".to_vec() } else { b"HACC01L\0".to_vec() };
    let total = counts.iter().sum::<usize>() as u64;
    header.extend(numbers(&[length, total, process_count, 1, 1, variable_count, 280, variables_start]));
    header.extend(numbers(&[process_count, 48, processes_start, 168]));
    header.extend(numbers(&[0.0f64, 0.0, 0.0, 64.0, 64.0, 64.0].map(f64::to_bits)));
    header.extend(numbers(&[block_size, if style.blocks { blocks_start } else { 0 }]));
    for (name, flags, size, _) in variables {
        let mut name = name.as_bytes().to_vec();
        name.resize(256, 0);
        header.extend(name);
        header.extend(numbers(&[*flags, *size as u64, *size as u64]));
    }
    let (mut data, mut blocks) = (Vec::new(), Vec::new());
    let mut row = 0;
    for (process, count) in counts.iter().enumerate() {
        header.extend(numbers(&[process as u64, 0, 0, *count as u64, length + 8 + data.len() as u64, process as u64]));
        for (_, _, size, value) in variables {
            let mut array: Vec<u8> = (row..row + count).flat_map(|row| word(&value(row))).collect();
            if let Some(rows) = style.packed.filter(|_| *count > 0) {
                array = [numbers(&[checksum(&array)]), container(&array, *size, rows)].concat();
            }
            let mut filter = style.filter.as_bytes().to_vec();
            filter.resize(32, 0);
            blocks.extend(filter);
            blocks.extend(numbers(&[length + 8 + data.len() as u64, array.len() as u64]));
            data.extend(closed(array));
        }
        row += count;
    }
    if style.blocks {
        header.extend(blocks);
    }
    assert_eq!(header.len() as u64, length);
    [closed(header), data].concat()
}

/// Variables of HACC's particles in places from `first` on.
fn particles(style: Style, counts: &[usize], first: usize) -> Vec<u8> {
    let place = move |factor: f32| move |row: usize| (factor * (first + row) as f32).to_le_bytes().to_vec();
    let id = |row: usize| ((1u64 << 62) + (first + row) as u64).to_le_bytes().to_vec();
    let mask = |row: usize| ((first + row) as u16).to_le_bytes().to_vec();
    let (x, y, z, speed) = (place(1.0), place(0.5), place(0.25), place(-1.0));
    let variables: [Variable; 8] = [
        ("x", 5, 4, &x),
        ("y", 9, 4, &y),
        ("z", 17, 4, &z),
        ("vx", 1, 4, &speed),
        ("vy", 1, 4, &x),
        ("vz", 1, 4, &y),
        ("id", 2, 8, &id),
        ("mask", 0, 2, &mask),
    ];
    written(style, &variables, counts)
}

const STYLE: Style = Style { big: false, blocks: false, filter: "", packed: None };

proptest! {
    #![proptest_config(crate::cases::cases(32))]

    #[test]
    fn what_is_written_comes_back(
        counts in prop::collection::vec(0..7usize, 1..5),
        others in prop::option::of(prop::collection::vec(0..5usize, 1..4)),
        (big, blocks) in any::<(bool, bool)>(),
        packed in prop::option::of(0..4usize),
        step in 1..6u64,
    ) {
        let style = Style::new(big, blocks, packed);
        let folder = tempfile::tempdir().unwrap();
        let total: usize = counts.iter().chain(others.iter().flatten()).sum();
        prop_assume!(total > 0);
        // A map has the file of every process.
        let first: usize = counts.iter().sum();
        let path = match &others {
            None => file(folder.path(), "m000.gio", &particles(style, &counts, 0)),
            Some(others) => {
                file(folder.path(), "m000.gio#0", &particles(style, &counts, 0));
                file(folder.path(), "m000.gio#1", &particles(style, others, first));
                let rank = |row: usize| (row as i32).to_le_bytes().to_vec();
                let partition = |row: usize| i32::from(row >= counts.len()).to_le_bytes().to_vec();
                let variables: [Variable; 2] = [("$rank", 2, 4, &rank), ("$partition", 2, 4, &partition)];
                file(folder.path(), "m000.gio", &written(style, &variables, &[counts.len() + others.len()]))
            }
        };
        prop_assert_eq!(files_of(&path).unwrap().len(), if others.is_some() { 3 } else { 1 });
        let source = open(&path).unwrap();
        let about = source.description();
        prop_assert_eq!((&*about.format, about.box_size, about.particles()), ("generic-io", Some(64.0), total as u64));
        let read = |name: &str| read_all(source.as_ref(), 0, name, step);
        let vectors = |of: fn(f64) -> [f64; 3]| (0..total).flat_map(|row| of(row as f64)).collect::<Vec<_>>();
        prop_assert_eq!(read("position"), vectors(|row| [row, 0.5 * row, 0.25 * row]));
        prop_assert_eq!(read("velocity"), vectors(|row| [-row, row, 0.5 * row]));
        prop_assert_eq!(read("mask"), (0..total).map(|row| row as f64).collect::<Vec<_>>());
        let info = &about.families[0];
        let mut ids = vec![0; total];
        source.read_ids(0, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut ids).unwrap();
        prop_assert_eq!(ids, (0..total as u64).map(|row| (1 << 62) + row).collect::<Vec<_>>());
    }

    /// With the header's checksum made right, as no mutation would get past it.
    #[test]
    fn damage_is_survived(
        mutations in super::hostile::mutations(),
        at in prop::option::of(0.0..1.0f64),
        blocks in any::<bool>(),
        packed in prop::option::of((0..3usize, super::hostile::mutations())),
    ) {
        let style = Style::new(false, blocks, packed.as_ref().map(|(rows, _)| *rows));
        let mut bytes = particles(style, &[5, 0, 3], 0);
        let length = u64::from_le_bytes(bytes[8..16].try_into().unwrap()) as usize;
        // What says how long the header is stays, as the checksum stands behind it.
        let kept = bytes[..16].to_vec();
        super::hostile::mutate(&mut bytes[..length], &mutations);
        if let Some((_, mutations)) = &packed {
            super::hostile::mutate(&mut bytes[length + 8..], mutations);
        }
        bytes[..16].copy_from_slice(&kept);
        let header = closed(bytes[..length].to_vec());
        bytes[..length + 8].copy_from_slice(&header);
        bytes.truncate(at.map_or(bytes.len(), |at| (at * bytes.len() as f64) as usize));
        let folder = tempfile::tempdir().unwrap();
        survives_at(&file(folder.path(), "hostile", &bytes))?;
    }

    #[test]
    fn damaged_containers_are_survived(big in any::<bool>(), mutations in super::hostile::mutations()) {
        let mut bytes = std::fs::read(data("blosc").join(if big { "big.gio" } else { "little.gio" })).unwrap();
        let header = 168 + 8 * 280 + 3 * 48 + 3 * 8 * 48 + 8;
        super::hostile::mutate(&mut bytes[header..], &mutations);
        let folder = tempfile::tempdir().unwrap();
        survives_at(&file(folder.path(), "hostile", &bytes))?;
    }
}

#[test]
fn shortened_altered_and_otherwise_compressed_files_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |bytes: &[u8]| {
        let path = file(folder.path(), "m000", bytes);
        message(&open(&path).err().unwrap(), &path)
    };
    let bytes = particles(STYLE, &[3, 2], 0);
    for length in 0..bytes.len() {
        refused(&bytes[..length]);
    }
    let mut altered = bytes;
    altered[200] ^= 1;
    assert!(refused(&altered).contains("checksum"));
    let packed = particles(Style { blocks: true, filter: "SZ", ..STYLE }, &[3], 0);
    assert!(refused(&packed).contains("numbers compressed with SZ"));
    let packed = particles(Style::new(false, true, Some(2)), &[3, 2], 0);
    for length in 0..packed.len() {
        refused(&packed[..length]);
    }
    // No more than compressed bytes may hold.
    let mut claims = particles(Style::new(false, true, Some(0)), &[3], 0);
    let process = 168 + 8 * 280 + 24;
    let count = 3_000_000_u64.to_le_bytes();
    claims[process..process + 8].copy_from_slice(&count);
    claims[16..24].copy_from_slice(&count);
    let length = u64::from_le_bytes(claims[8..16].try_into().unwrap()) as usize;
    let header = closed(claims[..length].to_vec());
    claims[..length + 8].copy_from_slice(&header);
    assert!(refused(&claims).contains("that they are compressed to"));
}

#[test]
fn errors_of_containers_name_the_variable() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = particles(Style::new(false, true, Some(2)), &[3], 0);
    let length = u64::from_le_bytes(bytes[8..16].try_into().unwrap()) as usize;
    // The version, behind the checksums of the header and of the numbers.
    bytes[length + 8 + 8] = 5;
    let path = file(folder.path(), "m000", &bytes);
    let source = open(&path).unwrap();
    let field = source.description().families[0].named("position").unwrap();
    let error = source.read(0, field, 0..1, &mut [0.0; 3]).unwrap_err();
    let expected = "x in BLOSC's container: found version 5, expected 2, that of Blosc 1";
    assert!(message(&error, &path).contains(expected), "{error}");
}

#[test]
fn what_c_blosc_compressed_is_read() {
    for name in ["little.gio", "big.gio"] {
        let source = open(&data("blosc").join(name)).unwrap();
        let about = source.description();
        assert_eq!((about.particles(), about.box_size), (1505, Some(2048.0)), "{name}");
        for step in [1505, 371] {
            let read = |field: &str| read_all(source.as_ref(), 0, field, step);
            let vectors = |axes: [f64; 3]| -> Vec<f64> {
                (0..1505).flat_map(|row| axes.map(|axis| f64::from(row) * axis / 4.0)).collect()
            };
            assert_eq!(read("position"), vectors([1.0, 2.0, 3.0]), "{name}");
            assert_eq!(read("velocity"), vectors([4.0, 5.0, 6.0]), "{name}");
            assert_eq!(read("mask"), (0..1505).map(|row| f64::from(row % 4)).collect::<Vec<_>>(), "{name}");
        }
        let mut ids = vec![0; 1505];
        let field = about.families[0].find(FieldKind::Id).unwrap();
        source.read_ids(0, field, 0..1505, &mut ids).unwrap();
        assert_eq!(ids, (0..1505).map(|row| (1 << 60) + row).collect::<Vec<u64>>(), "{name}");
    }
}

#[test]
fn the_librarys_map_has_the_box_of_the_files_that_it_names() {
    for (name, files) in [("genericio.gio", 1), ("genericio-map/snapshot.gio", 3)] {
        let path = data("others").join(name);
        assert_eq!(files_of(&path).unwrap().len(), files, "{name}");
        assert_eq!(open(&path).unwrap().description().box_size, Some(32.0), "{name}");
    }
}
