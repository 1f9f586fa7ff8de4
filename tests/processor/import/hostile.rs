//! Damaged files of every format: no panic, no particle that cannot be drawn, an error of one line.

use super::writers::file;
use super::{data, las, light_cones, message, phantom, ply, vtk_points};
use crate::support::gzip;
use deepfield::import::{LoadOptions, files_of, load, summarize};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// Opens and loads whatever the bytes are, and looks at what comes out.
fn survives(folder: &Path, bytes: &[u8]) -> Result<(), TestCaseError> {
    survives_at(&file(folder, "hostile", bytes))
}

/// The same of whatever is at `path`, a file or a folder.
pub(super) fn survives_at(path: &Path) -> Result<(), TestCaseError> {
    let summary = match summarize(path) {
        Ok(summary) => summary,
        Err(error) => {
            message(&error, path);
            return Ok(());
        }
    };
    match load(path, &LoadOptions::default(), &()) {
        Ok(dataset) => {
            let skipped: u64 = dataset.skipped.iter().map(|skipped| skipped.count).sum();
            prop_assert_eq!(dataset.len() as u64 + skipped, summary.particles);
            prop_assert_eq!(&dataset.skipped, &summary.skipped);
            prop_assert!(dataset.provenance.notes.starts_with(&summary.about.notes), "{:?}", summary.about.notes);
            for family in &dataset.families {
                prop_assert!(family.positions.iter().flatten().all(|x| x.is_finite()));
                for column in [&family.mass, &family.smoothing_length, &family.density] {
                    prop_assert_eq!(column.len(), family.len());
                    prop_assert!(column.iter().all(|value| *value > 0.0 && value.is_finite()));
                }
                prop_assert!(family.attributes.iter().all(|attribute| attribute.values.len() == family.len()));
            }
        }
        Err(error) => {
            message(&error, path);
        }
    }
    Ok(())
}

/// Overwrites some bytes, most of them near the beginning, where headers are.
pub(super) fn mutations() -> impl Strategy<Value = Vec<(f64, u8)>> {
    let place = prop_oneof![0.0..1.0f64, (0.0..1.0f64).prop_map(|x| x.powi(4)), (0.0..1.0f64).prop_map(|x| x.powi(12))];
    let value = prop_oneof![any::<u8>(), Just(0), Just(0xff), Just(0x7f), Just(1)];
    prop::collection::vec((place, value), 1..40)
}

pub(super) fn mutate(bytes: &mut [u8], mutations: &[(f64, u8)]) {
    let length = bytes.len();
    for (place, value) in mutations {
        bytes[(place * length as f64) as usize] = *value;
    }
}

macro_rules! hostile {
    ($($name:ident: $bytes:expr;)*) => {$(
        mod $name {
            use super::*;

            proptest! {
                #![proptest_config(crate::cases::cases(256))]

                #[test]
                fn overwritten(mutations in mutations()) {
                    let folder = tempfile::tempdir().unwrap();
                    let mut bytes: Vec<u8> = $bytes;
                    mutate(&mut bytes, &mutations);
                    survives(folder.path(), &bytes)?;
                }

                #[test]
                fn shortened(at in 0.0..1.0f64, mutations in prop::option::of(mutations())) {
                    let folder = tempfile::tempdir().unwrap();
                    let mut bytes: Vec<u8> = $bytes;
                    mutate(&mut bytes, &mutations.unwrap_or_default());
                    bytes.truncate((at * bytes.len() as f64) as usize);
                    survives(folder.path(), &bytes)?;
                }
            }
        }
    )*};
}

/// Names and bytes of the files of one source.
type Files = Vec<(&'static str, Vec<u8>)>;

/// Writes files into a folder and gives its path.
fn written(folder: &Path, files: &[(&str, Vec<u8>)]) -> PathBuf {
    let source = folder.join("hostile");
    for (name, bytes) in files {
        let path = source.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    source
}

/// Sources of several files, any one of which is damaged.
macro_rules! hostile_files {
    ($($name:ident: $files:expr;)*) => {$(
        mod $name {
            use super::*;

            #[test]
            fn undamaged() {
                let folder = tempfile::tempdir().unwrap();
                let files: Files = $files;
                let source = written(folder.path(), &files);
                assert!(files_of(&source).unwrap().len() > 1);
                load(&source, &LoadOptions::default(), &()).unwrap();
            }

            proptest! {
                #![proptest_config(crate::cases::cases(128))]

                #[test]
                fn overwritten(which in any::<prop::sample::Index>(), mutations in mutations()) {
                    let folder = tempfile::tempdir().unwrap();
                    let mut files: Files = $files;
                    let which = which.index(files.len());
                    mutate(&mut files[which].1, &mutations);
                    survives_at(&written(folder.path(), &files))?;
                }

                #[test]
                fn shortened(
                    which in any::<prop::sample::Index>(),
                    at in 0.0..1.0f64,
                    mutations in prop::option::of(mutations()),
                ) {
                    let folder = tempfile::tempdir().unwrap();
                    let mut files: Files = $files;
                    let which = which.index(files.len());
                    let bytes = &mut files[which].1;
                    mutate(bytes, &mutations.unwrap_or_default());
                    bytes.truncate((at * bytes.len() as f64) as usize);
                    survives_at(&written(folder.path(), &files))?;
                }
            }
        }
    )*};
}

fn bytes_of(name: &str) -> Vec<u8> {
    std::fs::read(data(name)).unwrap()
}

pub(super) fn gadget(format: u32) -> Vec<u8> {
    gadget_file(format, 1)
}

/// One of several files, which are all alike.
fn gadget_file(format: u32, files: u32) -> Vec<u8> {
    use crate::import::writers::{GadgetStyle, Particles, gadget};
    const COUNTS: [usize; 6] = [60, 40, 0, 0, 20, 1];
    let style = GadgetStyle {
        big_endian: format == 1,
        format,
        double: false,
        long_ids: true,
        table: [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    };
    let particles = |count: usize| Particles {
        positions: (0..count).map(|i| [i as f64, (i * i % 7) as f64, (i % 5) as f64]).collect(),
        velocities: vec![[1.0; 3]; count],
        ids: (0..count as u64).collect(),
        masses: vec![1.5; count],
    };
    gadget(style, &COUNTS.map(particles), COUNTS.map(|count| count as u32 * files), files)
}

pub(super) fn tipsy() -> Vec<u8> {
    let records = |width: usize, count: usize| -> Vec<Vec<f32>> {
        (0..count).map(|row| (0..width).map(|column| (row * 31 % 17 + column + 1) as f32).collect()).collect()
    };
    super::writers::tipsy(true, true, [&records(12, 30), &records(9, 40), &records(11, 20)])
}

fn table() -> Vec<u8> {
    let rows: String = (0..80).map(|row| format!("{},{},{row},{}\n", row % 7, row * row % 11, 1 + row % 3)).collect();
    format!("x,y,z,mass\n{rows}").into_bytes()
}

hostile! {
    gadget_1: gadget(1);
    gadget_2: gadget(2);
    tipsy_standard: tipsy();
    csv: table();
    ply_text: ply::sample(ply::Coding::Text);
    ply_binary: ply::sample(ply::Coding::Big);
    las_points: las::sample();
    las_copc: bytes_of("others/copclib.copc.laz");
    phantom_dump: phantom::sample();
    vtk_text: vtk_points::sample(vtk_points::Coding::LegacyText);
    vtk_binary: vtk_points::sample(vtk_points::Coding::LegacyBinary);
    vtk_compressed: vtk_points::sample(vtk_points::Coding::XmlZlib { inline: false });
    vtk_raw: vtk_points::sample(vtk_points::Coding::XmlRaw { wide: true, big: true });
    vtk_lz4: bytes_of("others/vtk-lz4.vtp");
    hdf5_contiguous: bytes_of("gas_sphere_collapse_025.hdf5");
    hdf5_deflated: bytes_of("emitter_000.hdf5");
    hdf5_newest: bytes_of("gizmo.hdf5");
    hdf5_swift: bytes_of("swift.hdf5");
    hdf5_columns: bytes_of("velociraptor.hdf5");
    hdf5_light_cone: light_cones::sample(1);
    hdf5_records: bytes_of("others/h5py-records.hdf5");
    hdf5_table: bytes_of("others/pandas-blocks.h5");
    parquet_lists: bytes_of("others/pyarrow-plain.parquet");
}

hostile_files! {
    gadget_files: vec![("snap.0", gadget_file(2, 2)), ("snap.1", gadget_file(2, 2))];
    hdf5_files: ["arepo.0.hdf5", "arepo.1.hdf5"].map(|name| (name, bytes_of(name))).into();
    light_cone_files: ["cone.0.hdf5", "cone.1.hdf5"].map(|name| (name, light_cones::sample(2))).into();
    csv_files: vec![("a.csv", table()), ("b.csv.gz", gzip(&table())), ("c.csv", table())];
    ecsv_files: ["a.ecsv", "b.ecsv"].map(|name| (name, bytes_of("others/astropy.ecsv"))).into();
    fits_files: ["a.fits", "b.fits"].map(|name| (name, bytes_of("others/astropy.fits"))).into();
    votable_files: ["a.vot", "b.vot"].map(|name| (name, bytes_of("others/astropy-binary2.vot"))).into();
    parquet_files: ["a.parquet", "b.parquet"].map(|name| (name, bytes_of("table.parquet"))).into();
    hats_files: [
        ("properties", "hats/properties"),
        ("dataset/Norder=0/Dir=0/Npix=4.parquet", "hats/dataset/Norder=0/Dir=0/Npix=4.parquet"),
        ("dataset/Norder=1/Dir=0/Npix=20/part0.parquet", "hats/dataset/Norder=1/Dir=0/Npix=20/part0.parquet"),
    ]
    .map(|(name, from)| (name, bytes_of(from)))
    .into();
}

/// One mass of the header's table that is finite in double precision and infinite in single precision, which particles have.
#[test]
fn a_mass_beyond_single_precision_is_told_by_a_load_and_by_a_summary() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = gadget(1);
    mutate(&mut bytes, &[(0.006993925369804253, 71)]);
    survives(folder.path(), &bytes).unwrap();
    let path = folder.path().join("hostile");
    let by_load = load(&path, &LoadOptions::default(), &()).unwrap_err().to_string();
    let by_summary = summarize(&path).unwrap_err().to_string();
    for told in [&by_load, &by_summary] {
        assert!(told.contains("hostile: mass of dark: found 3.4028"), "{told}");
    }
    assert_eq!(by_load, by_summary);
}

/// Windows refuses to cut a file that is mapped.
#[cfg(unix)]
#[test]
fn sources_that_are_cut_while_they_are_open_give_errors_however_they_are_read() {
    use deepfield::import::open_with;
    use deepfield::model::ReadMethod;
    let folder = tempfile::tempdir().unwrap();
    for bytes in [gadget(1), tipsy(), bytes_of("gas_sphere_collapse_025.hdf5"), bytes_of("emitter_000.hdf5")] {
        for method in [ReadMethod::Positioned, ReadMethod::Mapped] {
            let path = file(folder.path(), "hostile", &bytes);
            let source = open_with(&path, method).unwrap();
            let about = source.description();
            let field = about.families[0].named("position").unwrap();
            let read = || {
                let mut values = vec![0.0; 3 * about.families[0].count as usize];
                source.read(0, field, 0..about.families[0].count, &mut values).map(|()| values)
            };
            std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(40).unwrap();
            let error = read().err().unwrap_or_else(|| panic!("{} is read, {method:?}", about.format));
            message(&error, &path);
            // A file that is whole again is read again.
            std::fs::write(&path, &bytes).unwrap();
            assert!(read().is_ok());
        }
    }
}

#[test]
fn files_that_hold_nothing_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for bytes in [&b""[..], b"\x89HDF\r\n\x1a\n", b"hello", &[0u8; 300], &[8, 0, 0, 0, b'H', b'E', b'A', b'D']] {
        let path = file(folder.path(), "nothing", bytes);
        message(&summarize(&path).err().unwrap(), &path);
    }
    let text = summarize(&folder.path().join("absent")).err().unwrap().to_string();
    assert!(text.contains("absent"), "{text}");
}
