//! Catalogues as FITS tables, VOTable, ECSV, ASCII tables, Parquet and records in HDF5: files that were written from the standards byte by byte, or by another
//! library, hold what they should, plain and compressed, alone and as parts of one table, and damaged ones are errors that name the file.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod ascii;
mod damaged;
mod formats;
mod ids;
mod parquet;
mod parts;
mod records;
mod separated;
mod vectors;

use deepfield_data::import::{FieldKind, Source, open};
use flate2::{Compression, write::GzEncoder};
use std::io::Write as _;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name)
}

fn bytes_of(name: &str) -> Vec<u8> {
    std::fs::read(data(name)).unwrap()
}

fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A frame of Zstandard whose blocks are the bytes themselves (RFC 8878, section 3.1.1).
fn zstandard(bytes: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 0x58];
    let blocks = bytes.chunks(1 << 15);
    let last = blocks.len() - 1;
    for (number, block) in blocks.enumerate() {
        let header = u32::from(number == last) | (block.len() as u32) << 3;
        frame.extend(&header.to_le_bytes()[..3]);
        frame.extend(block);
    }
    frame
}

/// All values of a field, read some rows at a time.
fn values(source: &dyn Source, name: &str) -> Vec<f64> {
    let family = &source.description().families[0];
    let field = family.named(name).unwrap_or_else(|| panic!("no {name}"));
    let components = family.fields[field].components;
    let mut all = Vec::new();
    for start in (0..family.count).step_by(77) {
        let range = start..family.count.min(start + 77);
        let mut some = vec![0.0; (range.end - range.start) as usize * components];
        source.read(0, field, range, &mut some).unwrap();
        all.extend(some);
    }
    all
}

/// The ids of a source, read some rows at a time.
fn ids_of(path: &Path) -> Vec<u64> {
    let source = open(path).unwrap();
    let family = &source.description().families[0];
    let field = family.find(FieldKind::Id).unwrap_or_else(|| panic!("{} has no ids", path.display()));
    let mut all = Vec::new();
    for start in (0..family.count).step_by(7) {
        let range = start..family.count.min(start + 7);
        let mut some = vec![0; (range.end - range.start) as usize];
        source.read_ids(0, field, range, &mut some).unwrap();
        all.extend(some);
    }
    all
}

/// The message about a file, which is one line and names it.
fn refused(path: &Path) -> String {
    let text = open(path).err().unwrap_or_else(|| panic!("{} is opened", path.display())).to_string();
    assert!(!text.contains('\n') && text.contains(&*path.file_name().unwrap().to_string_lossy()), "{text}");
    text
}

/// Whether two lists are the same, where NaN stands for none.
fn assert_same(found: &[f64], expected: impl Iterator<Item = f64>, what: &str) {
    let expected: Vec<f64> = expected.collect();
    assert_eq!(found.len(), expected.len(), "{what}");
    for (row, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(*found == expected || found.is_nan() && expected.is_nan(), "{what} {row}: {found}, {expected}");
    }
}
