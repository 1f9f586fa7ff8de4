//! Binary formats in gzip and Zstandard: what is in them is what it is without.

use super::hostile::{gadget, tipsy};
use super::writers::file;
use super::{data, las, message, phantom, ply, read_all, vtk_points};
use crate::support::gzip;
use deepfield::import::{LoadOptions, files_of, load, open};

/// The bytes of a file of `tests/data`.
fn stored(name: &str) -> Vec<u8> {
    std::fs::read(data(name)).unwrap()
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
        vtk_points::sample(vtk_points::Coding::LegacyBinary),
        vtk_points::sample(vtk_points::Coding::XmlBase64),
        stored("trajectory.gsd"),
        stored("others/genericio.gio"),
        stored("others/genericio-blocks.gio"),
        stored("gas_sphere_collapse_025.hdf5"),
        stored("others/openpmd.h5"),
        stored("table.parquet"),
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
    // A field of many that belong together is unpacked by its user.
    let path = file(folder.path(), "pos", &gzip(&stored("others/tipsy2salsa/dark/pos")));
    let told = message(&open(&path).err().unwrap(), &path);
    assert!(told.contains("found nchilada snapshot in gzip, expected it unpacked first: gunzip -k "), "{told}");
    for (name, bytes) in
        [("bomb", tipsy()), ("bomb.hdf5", stored("units.hdf5")), ("bomb.parquet", stored("table.parquet"))]
    {
        let path = file(folder.path(), name, &zstandard(&bytes, 128));
        assert!(message(&open(&path).err().unwrap(), &path).contains("at most 1040 times"), "{name}");
    }
}

#[test]
fn tables_are_read_by_many_threads_from_what_was_unpacked() {
    let folder = tempfile::tempdir().unwrap();
    let plain = open(&data("table.parquet")).unwrap();
    let packed = open(&file(folder.path(), "table", &gzip(&stored("table.parquet")))).unwrap();
    let fields = &plain.description().families[0].fields;
    assert_eq!(&packed.description().families[0].fields, fields);
    std::thread::scope(|scope| {
        for field in fields {
            let (plain, packed) = (&*plain, &*packed);
            scope.spawn(move || {
                let bits = |source| -> Vec<u64> {
                    read_all(source, 0, &field.name, 7).into_iter().map(f64::to_bits).collect()
                };
                assert!(bits(plain) == bits(packed), "{}", field.name);
            });
        }
    });
}

#[test]
fn compressed_files_of_one_snapshot_are_found_by_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let mut whole = stored("arepo.0.hdf5");
    // An attribute of a number becomes the flag of a file without particles, which stands for the others.
    let places: Vec<usize> = (0..whole.len() - 7).filter(|&at| &whole[at..at + 7] == b"BoxSize").collect();
    places.iter().for_each(|&at| whole[at..at + 7].copy_from_slice(b"Virtual"));
    let paths = [
        ("snap.hdf5.gz", whole),
        ("snap.0.hdf5.gz", stored("arepo.0.hdf5")),
        ("snap.1.hdf5.gz", stored("arepo.1.hdf5")),
    ]
    .map(|(name, bytes)| file(folder.path(), name, &gzip(&bytes)));
    let plain = open(&data("arepo.0.hdf5")).unwrap();
    let expected = read_all(&*plain, 0, "position", 11);
    for path in paths.iter().chain([&folder.path().to_path_buf()]) {
        let source = open(path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(source.description().files, 2, "{}", path.display());
        assert_eq!(read_all(&*source, 0, "position", 11), expected, "{}", path.display());
        assert!(paths[1..].iter().all(|part| files_of(path).unwrap().contains(part)), "{}", path.display());
    }
    std::fs::remove_file(&paths[2]).unwrap();
    let told = message(&open(&paths[1]).err().unwrap(), &paths[1]);
    assert!(told.contains("snap.1.hdf5.gz: file 1: missing"), "{told}");
}
