//! Files of several arrays with names: HDF5, NetCDF of all versions, archives of NumPy.

use super::files::{Case, SHAPE, big, native, value, volume};
use super::{open, refusal};
use crate::import::{ImportError, grid_format};
use crate::model::{Region, SampleType, Unit};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// A file that `tests/data/make_grids.py` wrote.
fn written(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name)
}

/// A name of a classic NetCDF file; counts of `wide` ones have 8 bytes.
fn name(text: &str, wide: bool) -> Vec<u8> {
    let mut bytes = [&count(text.len() as u64, wide)[..], text.as_bytes()].concat();
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

fn count(number: u64, wide: bool) -> Vec<u8> {
    if wide { number.to_be_bytes().to_vec() } else { (number as u32).to_be_bytes().to_vec() }
}

/// A volume with coordinates along all axes, of which the slowest grows where `grows`; another variable that grows stands beside it then.
pub fn netcdf(version: u8, grows: bool) -> Vec<u8> {
    let wide = version == 5;
    let word = |number: u32| number.to_be_bytes().to_vec();
    let axes = [("z", SHAPE[2], 2.5_f64), ("y", SHAPE[1], 2.0), ("x", SHAPE[0], 1.5)];
    let mut dimensions = [word(10), count(3, wide)].concat();
    for (at, (axis, length, _)) in axes.iter().enumerate() {
        let length = if grows && at == 0 { 0 } else { *length };
        dimensions.extend([name(axis, wide), count(length, wide)].concat());
    }
    let nothing = [word(0), count(0, wide)].concat();
    let units = [word(12), count(1, wide), name("units", wide), word(2), count(2, wide), b"km\0\0".to_vec()].concat();
    // Values begin at 2048: coordinates of 64 bytes each, then records or the volume.
    let variable = |text: &str, numbers: &[u64], attributes: &[u8], kind: u32, begin: u64| {
        let numbers: Vec<u8> = numbers.iter().flat_map(|&number| count(number, wide)).collect();
        let axes = numbers.len() as u64 / if wide { 8 } else { 4 };
        let begin = if version == 1 { (begin as u32).to_be_bytes().to_vec() } else { begin.to_be_bytes().to_vec() };
        [name(text, wide), count(axes, wide), numbers, attributes.to_vec(), word(kind), count(0, wide), begin].concat()
    };
    let mut variables: Vec<Vec<u8>> = Vec::new();
    for (at, (axis, ..)) in axes.iter().enumerate().filter(|(at, _)| !grows || *at > 0) {
        variables.push(variable(axis, &[at as u64], &units, 6, 2048 + 64 * at as u64));
    }
    variables.push(variable("v", &[0, 1, 2], &nothing, 3, 2304));
    if grows {
        // One byte for each record, which is filled up to four.
        variables.push(variable("flag", &[0], &nothing, 1, 2304 + 60));
    }
    let head = [b"CDF".to_vec(), vec![version], count(if grows { SHAPE[2] } else { 0 }, wide)].concat();
    let mut bytes =
        [head, dimensions, nothing.clone(), word(11), count(variables.len() as u64, wide), variables.concat()].concat();
    assert!(bytes.len() <= 2048);
    for (at, (_, length, step)) in axes.iter().enumerate() {
        bytes.resize(2048 + 64 * at, 0);
        bytes.extend((0..*length).flat_map(|index| (7.0 + step * index as f64).to_be_bytes()));
    }
    bytes.resize(2304, 0);
    match grows {
        false => bytes.extend(big()),
        true => bytes.extend(big().chunks_exact(60).flat_map(|record| [record, &[1, 0, 0, 0]].concat())),
    }
    bytes
}

/// Files of each kind.
pub fn every() -> Vec<Case> {
    let unspaced = |case: Case| Case { spacing: None, ..case };
    let [x, y, _] = [1.5, 2.0, 2.5];
    vec![
        unspaced(volume("one.h5", std::fs::read(written("one.h5")).unwrap())),
        volume("fixed.nc", netcdf(1, false)),
        volume("wide.nc", netcdf(5, false)),
        volume("fixed.nc.gz", super::gzip(&netcdf(2, false))),
        Case { spacing: Some([x, y, 1.0]), ..volume("records.nc", netcdf(2, true)) },
    ]
}

#[test]
fn fields_have_the_place_unit_and_scale_of_the_conventions() {
    for file in ["field.nc", "field3.nc", "field2.nc", "field5.nc"] {
        let source = open(&written(file)).unwrap_or_else(|error| panic!("{error}"));
        let grid = source.grid();
        assert_eq!(
            (grid.kind(), &grid.shape[..2], grid.sample_type),
            ("image", &[6, 5][..], SampleType::I16),
            "{file}"
        );
        let channel = &grid.channels[0];
        assert_eq!((&*channel.name, channel.unit.clone(), channel.no_data), ("t2m", Unit::new("K"), Some(-32767.0)));
        assert_eq!(channel.scale.value(4.0), 202.0);
        assert_eq!((grid.spacing(), grid.length_unit.clone()), (vec![0.25, 0.5], Unit::new("degrees")), "{file}");
        assert_eq!(grid.to_world.transform_point3(DVec3::new(5.0, 4.0, 0.0)), DVec3::new(11.25, 48.0, 0.0));
        let mut samples = vec![0; 60];
        source.read(&grid.region(), &mut samples).unwrap();
        let wanted: Vec<u8> =
            (0..30_u64).flat_map(|at| if at == 15 { -32767 } else { value(at % 6, at / 6, 0) }.to_ne_bytes()).collect();
        assert_eq!(samples, wanted, "{file}");
        assert_eq!(source.description().format, "netcdf");
        assert_eq!(grid_format(&written(file)).unwrap(), Some(if file == "field.nc" { "hdf5" } else { "netcdf" }));
        assert!(super::summarize_grid(&source).unwrap().channels[0].no_data == 1);
    }
}

#[test]
fn an_array_is_named_behind_its_file() {
    let opened = |name: &str| open(&written("several.h5").with_file_name(format!("several.h5#{name}")));
    for name in ["v", "/v", "deep/loop/../v"] {
        let source = opened(name);
        if name.contains("..") {
            assert!(source.is_err());
            continue;
        }
        let source = source.unwrap();
        let mut samples = vec![0; 240];
        source.read(&source.grid().region(), &mut samples).unwrap();
        assert!(samples == native());
        assert!(source.description().path.to_string_lossy().ends_with(&format!("several.h5#{name}")));
    }
    let image = opened("deep/image").unwrap();
    assert_eq!((image.grid().kind(), image.grid().sample_type), ("image", SampleType::F64));
    let mut last = [0; 8];
    image.read(&Region { min: [5, 4, 0], max: [6, 5, 1] }, &mut last).unwrap();
    assert_eq!(f64::from_ne_bytes(last), f64::from(value(5, 4, 0)));
    assert_eq!(opened("time").unwrap().grid().shape, SHAPE);
    let text = |result: Result<super::GridSource, ImportError>| {
        let text = result.unwrap_err().to_string();
        text[text.find("several.h5: ").unwrap() + 12..].to_owned()
    };
    let all = "v (6 x 5 x 4 of int16), time (6 x 5 x 4 of float32), deep/image (6 x 5 of float64)";
    let sorted = |text: &str| {
        let mut words: Vec<String> = text.split(", ").map(str::to_owned).collect();
        words.sort();
        words
    };
    let several = text(open(&written("several.h5")));
    let listed = several.strip_prefix("data sets: found ").unwrap();
    let (listed, expected) = listed.split_once(", expected ").unwrap();
    assert_eq!(sorted(listed), sorted(all));
    assert!(expected.starts_with("one; name it behind the file, as several.h5#"), "{expected}");
    assert!(text(opened("none")).starts_with("none: missing, expected one of "));
    assert_eq!(text(opened("line")), "line: found 1 axes (5), expected 2 axes (an image) or 3 (a volume)");
    assert_eq!(
        text(opened("five")),
        "five: found 5 axes (2 x 2 x 2 x 2 x 2), expected 2 axes (an image) or 3 (a volume)"
    );
    assert_eq!(
        text(opened("half")),
        "half: found floats of 16 bits, expected whole numbers of 8 to 64 bits, or floats of 32 or 64"
    );
    // What has no arrays with names.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.nrrd"), super::nrrd("endian: little\nencoding: raw\n\n", &super::little()))
        .unwrap();
    let error = open(&folder.path().join("a.nrrd#v")).unwrap_err().to_string();
    assert!(
        error.ends_with("a.nrrd: #: found v (nrrd), expected a format whose files have arrays with names"),
        "{error}"
    );
}

#[test]
fn files_of_particles_stay_files_of_particles() {
    for name in ["gas_sphere_collapse_025.hdf5", "swift.hdf5", "units.hdf5", "groups.0.hdf5", "eagle.hdf5"] {
        assert_eq!(grid_format(&written(name)).unwrap(), None, "{name}");
        assert!(crate::import::open(&written(name)).is_ok(), "{name}");
    }
    // Unless a data set is named.
    let named = written("swift.hdf5#PartType0/Coordinates");
    assert_eq!(open(&named).unwrap().grid().shape[0], 3);
    let error = crate::import::open(&written("field.nc")).map(|_| ()).unwrap_err().to_string();
    assert!(error.ends_with("field.nc: content: found an image or a volume (hdf5), expected particles"), "{error}");
}

#[test]
fn headers_of_netcdf_are_not_trusted() {
    let whole = netcdf(1, false);
    let cut = |length: usize| refusal("v.nc", &whole[..length]);
    assert_eq!(cut(whole.len() - 1), "v.nc: data: found 239 bytes, expected 240 (6 x 5 x 4 of int16)");
    assert!(cut(40).starts_with("v.nc: header: dimensions: found an end at byte 40, expected "), "{}", cut(40));
    // As many dimensions as can be said, and a name as long as that.
    for at in [12, 16] {
        let mut bytes = whole.clone();
        bytes[at..at + 4].fill(0xff);
        let text = refusal("v.nc", &bytes);
        assert!(text.starts_with("v.nc: header: dimensions: found "), "{text}");
    }
    // Records by the file's length where it was being written, whether or not that suffices.
    let mut bytes = netcdf(2, true);
    bytes[4..8].fill(0xff);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.nc");
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(open(&path).unwrap().grid().shape, SHAPE);
    bytes.truncate(bytes.len() - 70);
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(open(&path).unwrap().grid().shape, [6, 5, 2]);
}
