//! Every format against the grid that was written, and against damage.

mod array_files;
mod arrays;
mod exr_files;
mod files;
mod more_files;
mod pictures;
mod reference;

use super::{GridOptions, GridSource, RawGrid, open_grid, summarize_grid};
use crate::import::ImportError;
use crate::model::{Grid, Region, SampleType, Unit};
use files::{Case, every, gzip, little, metaimage, nifti, npy, nrrd, zlib};
use glam::DVec3;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::path::{Path, PathBuf};

/// Writes a case and the files beside it.
fn write(folder: &Path, case: &Case) -> PathBuf {
    for (name, bytes) in &case.beside {
        std::fs::write(folder.join(name), bytes).unwrap();
    }
    let path = folder.join(case.name);
    std::fs::write(&path, &case.bytes).unwrap();
    path
}

fn open(path: &Path) -> Result<GridSource, ImportError> {
    open_grid(path, &GridOptions::default())
}

/// What is said of a file of these bytes.
fn refusal(name: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let text = open(&path).unwrap_err().to_string();
    assert!(!text.contains('\n'), "{text}");
    text.replace(&format!("{}/", folder.path().display()), "")
}

#[test]
fn every_format_gives_the_grid_that_was_written() {
    let folder = tempfile::tempdir().unwrap();
    for case in every() {
        let source = open(&write(folder.path(), &case)).unwrap_or_else(|error| panic!("{error}"));
        let grid = source.grid();
        assert_eq!(grid.shape[..grid.dimensions], case.shape, "{}", case.name);
        assert_eq!((grid.sample_type, grid.channels.len()), (case.sample_type, case.channels), "{}", case.name);
        let spacing = case.spacing.map_or(vec![1.0; grid.dimensions], |spacing| spacing.to_vec());
        assert_eq!(grid.spacing(), spacing, "{}", case.name);
        let mut samples = vec![0; case.samples.len()];
        source.read(&grid.region(), &mut samples).unwrap();
        assert!(samples == case.samples, "{}: other samples", case.name);
        assert_eq!(
            source.description().files,
            1 + case.beside.iter().filter(|(name, _)| !name.ends_with("ron")).count()
        );
        let stored: usize =
            case.beside.iter().filter(|(name, _)| !name.ends_with("ron")).map(|(_, bytes)| bytes.len()).sum();
        assert_eq!(source.description().bytes, (case.bytes.len() + stored) as u64, "{}", case.name);
    }
}

#[test]
fn boxes_are_parts_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Pcg32::seed_from_u64(1);
    for case in every() {
        let source = open(&write(folder.path(), &case)).unwrap();
        let grid = source.grid();
        let bytes = grid.sample_bytes() as usize;
        for _ in 0..60 {
            let (mut min, mut max) = ([0; 3], [0; 3]);
            for axis in 0..3 {
                let ends = [0, 1].map(|_| u64::from(random.next_u32()) % grid.shape[axis]);
                (min[axis], max[axis]) = (ends[0].min(ends[1]), ends[0].max(ends[1]) + 1);
            }
            let region = Region { min, max };
            let mut part = vec![0; region.shape().iter().product::<u64>() as usize * bytes];
            source.read(&region, &mut part).unwrap();
            let mut wanted = Vec::new();
            for z in min[2]..max[2] {
                for y in min[1]..max[1] {
                    let at = |x: u64| (x + grid.shape[0] * (y + grid.shape[1] * z)) as usize * bytes;
                    wanted.extend_from_slice(&case.samples[at(min[0])..at(max[0])]);
                }
            }
            assert!(part == wanted, "{} {region:?}", case.name);
        }
        let beyond = Region { min: [0; 3], max: [grid.shape[0] + 1, 1, 1] };
        assert!(source.read(&beyond, &mut vec![0; (grid.shape[0] as usize + 1) * bytes]).is_err());
        assert!(source.read(&grid.region(), &mut [0]).is_err());
        for most in [1, 40, 100, 1 << 20] {
            let chunks = source.chunks(most);
            let samples: u64 = chunks.iter().map(|chunk| chunk.shape().iter().product::<u64>()).sum();
            assert_eq!(samples, grid.shape.iter().product::<u64>());
            let largest =
                chunks.iter().map(|chunk| chunk.shape().iter().product::<u64>() * bytes as u64).max().unwrap();
            assert!(largest <= most.max(bytes as u64), "{largest} of {most}");
        }
    }
}

/// Cuts and mutates files of every format: whatever is in them, it is read or refused in one line.
#[test]
fn damaged_files_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Pcg32::seed_from_u64(2);
    let is_said = |path: &Path, name: &str| match open(path).and_then(|source| summarize_grid(&source)) {
        Ok(_) => false,
        Err(error) => {
            let text = error.to_string();
            assert!(!text.contains('\n') && text.contains(&*folder.path().to_string_lossy()), "{name}: {text}");
            true
        }
    };
    for case in every() {
        let path = write(folder.path(), &case);
        for part in 0..64 {
            std::fs::write(&path, &case.bytes[..case.bytes.len() * part / 64]).unwrap();
            // What is behind the samples says nothing about them, and a header that lies beside them has none.
            let must_fail = part < 58 && case.beside.is_empty();
            assert!(is_said(&path, case.name) || !must_fail, "{}: {part} of 64 were enough", case.name);
        }
        for round in 0..100 {
            let mut bytes = case.bytes.clone();
            for _ in 0..1 + random.next_u32() % 20 {
                let among = if round % 2 == 0 { bytes.len() } else { bytes.len().min(600) };
                let at = random.next_u32() as usize % among;
                bytes[at] = random.next_u32() as u8;
            }
            std::fs::write(&path, &bytes).unwrap();
            is_said(&path, case.name);
        }
    }
}

#[test]
fn messages_name_file_field_found_and_expected() {
    let raw = nrrd("endian: little\nencoding: raw\n\n", &little());
    let zeros = |text: &str| [text.as_bytes(), &little()[..]].concat();
    let head = "NRRD0004\ntype: short\ndimension: 3\nencoding: raw\nendian: little\n";
    for (name, bytes, message) in [
        ("c.nrrd", raw[..raw.len() - 9].to_vec(), "c.nrrd: data: found 231 bytes, expected 240 (6 x 5 x 4 of int16)"),
        ("x.nii", nifti(128, b"n+1\0", &[]), "x.nii: datatype: found 128 (RGB24 volumes), expected a scalar type"),
        (
            "v.raw",
            vec![0; 1000],
            "v.raw: shape: missing, expected v.raw.ron beside it, or --shape of info, build or reconstruct",
        ),
        (
            "e.nrrd",
            nrrd("encoding: bzip2\nendian: little\n\n", b""),
            "e.nrrd: encoding: found bzip2, expected raw, ascii or gzip",
        ),
        (
            "v.nrrd",
            zeros(&format!("{head}sizes: 6 5 4\nspace directions: (1,0,0) (2,0,0) (0,0,1)\n\n")),
            "v.nrrd: space directions: singular, expected directions that span the grid",
        ),
        (
            "z.nrrd",
            zeros(&format!("{head}sizes: 6 0 4\n\n")),
            "z.nrrd: sizes: found 6 x 0 x 4, expected at least one sample along each axis",
        ),
        (
            "h.nrrd",
            zeros(&format!("{head}sizes: 4000000000 4000000000 4000000000\n\n")),
            "h.nrrd: sizes: found 4000000000 x 4000000000 x 4000000000, expected fewer than 2^63 bytes of samples",
        ),
        (
            "b.npy",
            npy("<c8", false, "(4, 5)", &[]),
            "b.npy: descr: found '<c8', expected whole numbers or floats of 8 to 64 bits, such as '<f4'",
        ),
        ("t.tif", more_files::tiff(&[5, 5, 3], &files::big()), "t.tif: page 3: found 6 x 3, expected 6 x 5 as page 1"),
        (
            "u.vtk",
            more_files::vtk("BINARY", "DIMENSIONS 6 5 4\nPOINT_DATA 121\nSCALARS v short", b""),
            "u.vtk: POINT_DATA: found 121, expected 120",
        ),
        (
            "p.vti",
            more_files::vti("", "format=\"binary\"", b"8AAAAA==", b""),
            "p.vti: data: found 0 bytes, expected 240",
        ),
        (
            "d.nhdr",
            nrrd("endian: little\nencoding: raw\ndata file: gone.raw\n", b""),
            "d.nhdr: data file: found gone.raw (No such file",
        ),
        (
            "t.fits",
            [
                more_files::fits(
                    "SIMPLE  =                    T\nBITPIX  =                    8\nNAXIS   =                    0",
                    b"",
                ),
                more_files::fits(
                    "XTENSION= 'TABLE   '\nBITPIX  =                    8\nNAXIS   =                    2\n\
                     NAXIS1  =                    3\nNAXIS2  =                    1",
                    b"1 2",
                ),
            ]
            .concat(),
            "t.fits: XTENSION: found TABLE, rows of text, expected an array of 2 or 3 axes, or a BINTABLE",
        ),
        ("t", b"nothing that is known".to_vec(), "t: content: not a known format, expected one of "),
    ] {
        let text = refusal(name, &bytes);
        assert!(text.starts_with(message), "{text}");
    }
    // A little file that unpacks to much more than it says, and one that says much more than it can hold.
    let bomb = gzip(&[nifti(4, b"n+1\0", &little()), vec![0; 10 << 20]].concat());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.nii.gz");
    std::fs::write(&path, bomb).unwrap();
    assert_eq!(open(&path).unwrap().grid().shape, files::SHAPE);
    let said = metaimage("CompressedData = True\nElementDataFile = LOCAL\n", &zlib(&little()));
    let said = String::from_utf8_lossy(&said).replace("DimSize = 6 5 4", "DimSize = 6 5 400000000");
    assert!(refusal("m.mha", said.as_bytes()).contains("data: found at most"));
}

#[test]
fn places_are_those_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let opened = |name: &str| {
        let case = every().into_iter().find(|case| case.name == name).unwrap();
        open(&write(folder.path(), &case)).unwrap().grid().clone()
    };
    let near = |grid: &Grid, index: [f64; 3], place: [f64; 3]| {
        let at = grid.to_world.transform_point3(DVec3::from_array(index));
        assert!((at - DVec3::from_array(place)).length() < 1e-12, "{at}");
    };
    for name in ["points.vtk", "raw.vti"] {
        near(&opened(name), [0.0; 3], [1.0, 2.0, 3.0]);
    }
    near(&opened("cells.vtk"), [0.0; 3], [1.75, 3.0, 4.25]);
    for name in ["raw.nrrd", "local.mha"] {
        near(&opened(name), [0.0; 3], [1.0, 2.0, 3.0]);
        near(&opened(name), [1.0, 0.0, 0.0], [1.0, 3.5, 3.0]);
    }
    near(&opened("raw.nrrd"), [0.0, 1.0, 1.0], [-1.0, 2.0, 5.5]);
    near(&opened("local.mha"), [0.0, 1.0, 1.0], [-1.0, 2.0, 5.5]);
    // NIfTI-2's sform, its scale and its unit.
    let second = opened("two.nii");
    near(&second, [1.0, 1.0, 1.0], [5.0, 9.5, 11.5]);
    assert_eq!((second.channels[0].scale.value(3.0), second.length_unit.clone()), (16.0, Unit::new("m")));
    assert_eq!(opened("one.nii").length_unit, Unit::new("mm"));
    assert_eq!(opened("one.nii").channels[0].scale.value(3.0), 3.0);
}

#[test]
fn a_quaternion_turns_a_volume() {
    let mut bytes = nifti(4, b"n+1\0", &little());
    let half = 0.25 * std::f32::consts::PI;
    bytes[252..254].copy_from_slice(&1_i16.to_le_bytes());
    // 90 degrees about z, z turned round.
    bytes[264..268].copy_from_slice(&half.sin().to_le_bytes());
    bytes[268..272].copy_from_slice(&4.0_f32.to_le_bytes());
    bytes[76..80].copy_from_slice(&(-1.0_f32).to_le_bytes());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("q.nii");
    std::fs::write(&path, bytes).unwrap();
    let at = open(&path).unwrap().grid().to_world.transform_point3(DVec3::ONE);
    assert!((at - DVec3::new(4.0 - 2.0, 1.5, -2.5)).length() < 1e-6, "{at}");
}

#[test]
fn options_say_what_a_file_without_header_holds() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.bin");
    std::fs::write(&path, little()).unwrap();
    let raw = RawGrid {
        shape: vec![6, 5, 4],
        sample_type: SampleType::I16,
        spacing: vec![1.0, 1.0, 2.0],
        big_endian: false,
        channels: 1,
        offset: 0,
        length_unit: Unit::default(),
    };
    let opened = |raw: RawGrid| open_grid(&path, &GridOptions { raw: Some(raw), ..GridOptions::default() });
    assert_eq!(opened(raw.clone()).unwrap().grid().spacing(), [1.0, 1.0, 2.0]);
    let text = |raw: RawGrid| opened(raw).unwrap_err().to_string();
    assert!(
        text(RawGrid { shape: vec![6], ..raw.clone() })
            .ends_with("shape: found 1 axes, expected 2 (an image) or 3 (a volume)")
    );
    assert!(text(RawGrid { spacing: vec![1.0], ..raw.clone() }).contains("spacing: found 1, expected 3 positive"));
    assert!(text(RawGrid { offset: 1, ..raw }).contains("data: found 239 bytes, expected 240"));
}

#[test]
fn statistics_are_those_of_the_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.npy");
    let values = [1.0_f32, f32::NAN, -3.0, f32::INFINITY, 5.0, 0.5];
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(&path, npy("<f4", false, "(2, 3)", &bytes)).unwrap();
    let summary = summarize_grid(&open(&path).unwrap()).unwrap();
    let channel = &summary.channels[0];
    assert_eq!((channel.min, channel.max, channel.mean, channel.sum), (Some(-3.0), Some(5.0), Some(0.875), 3.5));
    assert_eq!((channel.nan, channel.infinite, channel.histogram.iter().sum()), (1, 1, 4_u64));
    assert_eq!((channel.histogram[0], channel.histogram[63], channel.histogram[32]), (1, 1, 1));
    // The same by counting and by value.
    let case = every().into_iter().find(|case| case.name == "two.nii").unwrap();
    let counted = summarize_grid(&open(&write(folder.path(), &case)).unwrap()).unwrap();
    let values = files::values().into_iter().map(|value| 2.0 * f64::from(value) + 10.0);
    assert_eq!(counted.channels[0].sum, values.clone().sum::<f64>());
    assert_eq!(counted.channels[0].min, values.reduce(f64::min));
    assert_eq!(counted.channels[0].histogram.iter().sum::<u64>(), 120);
    let json = serde_json::to_value(&counted).unwrap();
    for key in
        ["kind", "format", "files", "bytes", "shape", "spacing", "axes", "bounds", "memory_bytes", "channels", "notes"]
    {
        assert!(!json[key].is_null(), "{key}");
    }
    for key in ["name", "unit", "type", "min", "max", "mean", "sum", "nan", "histogram"] {
        assert!(!json["channels"][0][key].is_null(), "{key}");
    }
}

#[test]
fn a_volume_is_a_source_of_its_voxels() {
    let folder = tempfile::tempdir().unwrap();
    let case = every().into_iter().next().unwrap();
    let path = write(folder.path(), &case);
    let source = crate::import::open(&path).unwrap();
    assert_eq!(source.description().format, "voxels");
    assert!(source.description().notes.iter().any(|note| note.contains("count as air")));
}
