//! Small files of HDF5, FITS and TIFF in tiles, which `tests/data/make_grids.py` wrote, and of classic NetCDF, made here byte by byte.

use super::files::{Case, SHAPE, big, gzip, volume};
use std::path::{Path, PathBuf};

/// A file that `tests/data/make_grids.py` wrote.
pub fn written(name: &str) -> PathBuf {
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
        unspaced(volume("rice.fits", std::fs::read(written("rice.fits")).unwrap())),
        unspaced(volume("tiles.tif", std::fs::read(written("tiles.tif")).unwrap())),
        unspaced(volume("gzip.fits", std::fs::read(written("gzip.fits")).unwrap())),
        unspaced(volume("shuffled.fits", std::fs::read(written("shuffled.fits")).unwrap())),
        volume("fixed.nc", netcdf(1, false)),
        volume("wide.nc", netcdf(5, false)),
        volume("fixed.nc.gz", gzip(&netcdf(2, false))),
        Case { spacing: Some([x, y, 1.0]), ..volume("records.nc", netcdf(2, true)) },
    ]
}
