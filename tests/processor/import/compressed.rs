//! Binary formats in gzip and Zstandard: what is in them is what it is without.

use super::hostile::{gadget, tipsy};
use super::writers::file;
use super::{data, las, message, phantom, ply};
use deepfield::import::{LoadOptions, load, open};
use flate2::{Compression, write::GzEncoder};
use std::io::Write;

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A frame of a block that is stored as it is, and of others that are a run of zeros each (RFC 8878, 3.1.1).
fn zstandard(bytes: &[u8], runs: u32) -> Vec<u8> {
    const LONGEST: u32 = 1 << 17;
    let stored = bytes.len() as u32;
    assert!(stored <= LONGEST);
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0xa0];
    frame.extend((stored + runs * LONGEST).to_le_bytes());
    let header = |size: u32, kind: u32, is_last: bool| size << 3 | kind << 1 | u32::from(is_last);
    frame.extend(&header(stored, 0, runs == 0).to_le_bytes()[..3]);
    frame.extend(bytes);
    for run in 1..=runs {
        frame.extend(&header(LONGEST, 1, run == runs).to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

#[test]
fn what_is_compressed_is_what_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let samples = [
        ply::sample(ply::Coding::Text),
        ply::sample(ply::Coding::Big),
        las::sample(),
        phantom::sample(),
        gadget(1),
        gadget(2),
        tipsy(),
        std::fs::read(data("trajectory.gsd")).unwrap(),
    ];
    for (index, bytes) in samples.iter().enumerate() {
        let read = |name: &str, bytes: &[u8]| {
            let path = file(folder.path(), &format!("{name}-{index}"), bytes);
            let format = open(&path).unwrap().description().format.clone();
            let families = load(&path, &LoadOptions::default(), &()).unwrap().families;
            let families = families.into_iter().map(|family| (family.positions, family.mass, family.smoothing_length));
            (format, families.collect::<Vec<_>>())
        };
        let plain = read("plain", bytes);
        assert_eq!(read("gzip", &gzip(bytes)), plain);
        assert_eq!(read("zstandard", &zstandard(bytes, 0)), plain);
        let cut = gzip(bytes);
        let cut = file(folder.path(), "cut", &cut[..cut.len() * 9 / 10]);
        message(&open(&cut).err().unwrap(), &cut);
    }
    // What a library reads by itself is unpacked by its user.
    let hdf5 = std::fs::read(data("gas_sphere_collapse_025.hdf5")).unwrap();
    let path = file(folder.path(), "hdf5", &gzip(&hdf5));
    let told = message(&open(&path).err().unwrap(), &path);
    assert!(told.contains("found HDF5 snapshot in gzip, expected it unpacked first: gunzip -k "), "{told}");
    let path = file(folder.path(), "parquet", &zstandard(&std::fs::read(data("table.parquet")).unwrap(), 0));
    let told = message(&open(&path).err().unwrap(), &path);
    assert!(told.contains("found Parquet table in Zstandard, expected it unpacked first: zstd -d "), "{told}");
    let path = file(folder.path(), "bomb", &zstandard(&tipsy(), 64));
    assert!(message(&open(&path).err().unwrap(), &path).contains("at most 1040 times"));
}
