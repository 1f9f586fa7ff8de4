//! Files of several arrays with names: HDF5, NetCDF of all versions, archives of NumPy.

use super::array_files::{netcdf, written};
use super::files::{SHAPE, native, value};
use super::{open, refusal};
use crate::import::{ImportError, grid_format};
use crate::model::{Region, SampleType, Unit};
use glam::DVec3;

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
    // Where a grid is asked for there is a choice of data sets, and damage is told of.
    let error = open(&written("gas_sphere_collapse_025.hdf5")).unwrap_err().to_string();
    assert!(error.contains("data sets: found PartType0/") && error.contains("expected one; name it"), "{error}");
    let whole = std::fs::read(written("one.h5")).unwrap();
    assert!(refusal("cut.h5", &whole[..60]).starts_with("cut.h5: "));
}

#[test]
fn a_tiff_says_where_it_is_and_what_is_no_value() {
    let source = open(&written("geo.tif")).unwrap();
    let grid = source.grid();
    assert_eq!((grid.spacing(), grid.channels[0].no_data), (vec![0.25, 0.5], Some(-32767.0)));
    // The corner of pixel (1, 0) is at (10, 50).
    assert_eq!(grid.to_world.transform_point3(DVec3::new(0.5, -0.5, 0.0)), DVec3::new(10.0, 50.0, 0.0));
    assert_eq!(super::summarize_grid(&source).unwrap().channels[0].no_data, 1);
}

/// Floats of FITS that were rounded with noise, against what another reader made of them.
#[test]
fn noise_is_taken_away_again() {
    let source = open(&written("dither.fits")).unwrap();
    assert_eq!((source.grid().shape, source.grid().sample_type), ([40, 30, 1], SampleType::F32));
    let at = |x: u64, y: u64| {
        let mut sample = [0; 4];
        source.read(&Region { min: [x, y, 0], max: [x + 1, y + 1, 1] }, &mut sample).unwrap();
        f32::from_ne_bytes(sample)
    };
    for (x, y, wanted) in [(0, 0, 1.785_195_1e-8), (39, 29, 0.835_740_75), (7, 11, -0.466_464_2)] {
        assert!((at(x, y) - wanted).abs() < 1e-7, "{x} {y}: {} for {wanted}", at(x, y));
    }
    assert!(at(4, 3).is_nan());
    let summary = super::summarize_grid(&source).unwrap();
    assert_eq!(summary.channels[0].nan, 1);
    assert!(summary.notes[0].contains("rounded"), "{:?}", summary.notes);
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
