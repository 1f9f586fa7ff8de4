//! Blobs of Esri's own encoder, and what is left of them after damage.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;

const ROWS: usize = 17;
const COLUMNS: usize = 21;

/// One behind the other: of each type with a mask, two of version 6 without one, and special ones.
const BLOBS: &[u8] = include_bytes!("blobs.bin");

/// A blob with samples as they are, one behind the other, the least significant byte first.
pub(in super::super) fn plain(columns: usize, rows: usize, kind: SampleType, samples: &[u8]) -> Vec<u8> {
    let number = TYPES.iter().position(|known| *known == kind).unwrap() as i32;
    let count = (columns * rows) as i32;
    let length = UNCHECKED + 7 * 4 + 3 * 8 + 4 + 2 * kind.size() + 1 + samples.len();
    let mut blob = [MAGIC, &4_i32.to_le_bytes(), &[0; 4]].concat();
    for field in [rows as i32, columns as i32, 1, count, 8, length as i32, number] {
        blob.extend(field.to_le_bytes());
    }
    for field in [0.5, -1.0, 1.0] {
        blob.extend(f64::to_le_bytes(field));
    }
    // No mask, a range that is none, and no blocks.
    blob.extend([0; 4]);
    blob.extend(vec![0; kind.size()]);
    blob.extend(vec![1; kind.size()]);
    blob.push(1);
    blob.extend(samples);
    let sum = fletcher(&blob[UNCHECKED..]);
    blob[10..14].copy_from_slice(&sum.to_le_bytes());
    blob
}

/// The blobs, by the length that each states.
fn blobs() -> Vec<&'static [u8]> {
    let mut rest = BLOBS;
    let mut all = Vec::new();
    while !rest.is_empty() {
        let version = rest[6];
        let at = if version >= 4 { 34 } else { 30 };
        let (blob, behind) = rest.split_at(u32::from_le_bytes(*rest[at..].first_chunk().unwrap()) as usize);
        all.push(blob);
        rest = behind;
    }
    all
}

fn base(row: usize, column: usize) -> f64 {
    (3 * row * row + 7 * column + row * column % 5 * 11) as f64
}

fn is_valid(row: usize, column: usize) -> bool {
    let away = (row as i64 - 8).pow(2) + (column as i64 - 10).pow(2);
    away > 9 && !(row == 0 && column < 3)
}

fn size() -> [u64; 2] {
    [COLUMNS as u64, ROWS as u64]
}

/// Checks a blob against heights that may be `error` off; not measured where `mask` says so.
fn check(
    blob: &[u8],
    kind: SampleType,
    error: f64,
    mask: impl Fn(usize, usize) -> bool,
    height: impl Fn(usize, usize) -> f64,
) {
    let bytes = unpack(blob, size(), kind).unwrap();
    let mut reader = Reader { bytes: &bytes };
    for (row, column) in (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column))) {
        let found = reader.number(kind).unwrap();
        match mask(row, column) {
            true => assert!((found - height(row, column)).abs() <= error, "{kind} {row} {column}: {found}"),
            false => assert!(found.is_nan() || !kind.is_float() && found == 0.0, "{kind} {row} {column}: {found}"),
        }
    }
    assert!(reader.bytes.is_empty());
}

#[test]
fn blobs_of_another_encoder_are_read() {
    let all = blobs();
    let of = |kind: SampleType| {
        move |row: usize, column: usize| match kind {
            SampleType::I16 | SampleType::I32 => base(row, column) - 300.0,
            SampleType::U8 | SampleType::I8 => base(row, column) % 100.0,
            SampleType::F32 => base(row, column) / 8.0,
            SampleType::F64 => base(row, column) * 0.5 + 1e6,
            _ => base(row, column),
        }
    };
    let error = |kind: SampleType| match kind {
        SampleType::U8 | SampleType::I8 => 1.0,
        SampleType::F32 => 0.0625,
        SampleType::F64 => 0.25,
        _ => 0.0,
    };
    let kinds = [
        SampleType::I16,
        SampleType::I16,
        SampleType::U16,
        SampleType::I32,
        SampleType::U32,
        SampleType::F32,
        SampleType::F32,
        SampleType::F64,
        SampleType::U8,
        SampleType::I8,
    ];
    for (blob, kind) in all.iter().zip(kinds) {
        let is_masked = blob[6] == 4;
        check(blob, kind, error(kind), |row, column| !is_masked || is_valid(row, column), of(kind));
    }
    let [few, noise, level, none, huffman] = *all[10..].first_chunk().unwrap();
    check(
        few,
        SampleType::I32,
        0.0,
        |_, _| true,
        |row, column| match (column % 7, row % 5) {
            (0, _) => 900.0,
            (_, 0) => 400.0,
            _ => 0.0,
        },
    );
    let random = |row: usize, column: usize| {
        f64::from((base(row, column) as u32).wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24)
    };
    check(noise, SampleType::F32, 0.0, |_, _| true, random);
    check(level, SampleType::F32, 0.0, is_valid, |_, _| 12.5);
    check(none, SampleType::I16, 0.0, |_, _| false, |_, _| 0.0);
    assert!(unpack(huffman, size(), SampleType::U8).unwrap_err().contains("Huffman"));
}

#[test]
fn damage_is_told() {
    for blob in blobs() {
        let kind = TYPES[usize::from(blob[38])];
        // A checksum finds every bit behind it, and what is in front is held against what is asked for.
        for at in 0..blob.len() {
            assert!(unpack(&blob[..at], size(), kind).is_err());
            let mut damaged = blob.to_vec();
            damaged[at] ^= 1 << (at % 8);
            // The lowest bits of a version differ in what is read alone.
            assert!(unpack(&damaged, size(), kind).is_err() || (6..10).contains(&at), "{at}");
        }
        assert!(unpack(blob, [COLUMNS as u64 + 1, ROWS as u64], kind).is_err());
        // Damage that the checksum is right for is an answer or an error.
        let mut state = 7_u64;
        for _ in 0..3000 {
            let mut damaged = blob.to_vec();
            for _ in 0..3 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let at = UNCHECKED + (state >> 33) as usize % (blob.len() - UNCHECKED);
                damaged[at] = (state >> 20) as u8;
            }
            let sum = fletcher(&damaged[UNCHECKED..]);
            damaged[10..14].copy_from_slice(&sum.to_le_bytes());
            let _ = unpack(&damaged, size(), kind);
        }
    }
}
