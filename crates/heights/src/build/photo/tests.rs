//! Photos over random fields with random holes, against sums over their pixels.

use super::super::tests::Noise;
use super::super::{HeightBuildOptions, HeightOrigin, Measured, build_heights};
use crate::hierarchy::photo::TileKey;
use crate::model::light;
use crate::model::photo::{PhotoAbout, PhotoPlace, PhotoRows};
use crate::model::{Cell, HeightError, HeightField, HeightGrid, Heights, Window};
use crate::store::{HeightFile, PhotoOfFile, Tile, verify_heights};
use covered::{Covered, Pixels};
use deepfield_data::model::{ReadMethod, Unit};
use proptest::prelude::*;
use std::path::Path;

#[path = "../../../../../tests/support/covered.rs"]
mod covered;

/// `holes` is the share of samples that were not measured, in lumps.
fn covered(samples: [u64; 2], size: [u64; 2], place: PhotoPlace, is_grey: bool, holes: f64, seed: u64) -> Covered {
    let mut noise = Noise(seed | 1);
    let [rows, columns] = samples;
    let lumps: Vec<bool> = (0..(rows / 5 + 1) * (columns / 7 + 1)).map(|_| noise.share() < holes).collect();
    let height = |at: u64| {
        let (row, column) = (at / columns, at % columns);
        let is_hole = lumps[(row / 5 * (columns / 7 + 1) + column / 7) as usize];
        if is_hole && at > 0 { f64::NAN } else { (row + column) as f64 }
    };
    let field = HeightField::of(columns, rows, (0..rows * columns).map(height).collect());
    let about = PhotoAbout { path: "photo.png".into(), format: "png".into(), bytes: 7, size, is_grey, place };
    let values = (0..size[0] * size[1] * about.planes() as u64).map(|_| (noise.next() >> 40) as u8).collect();
    Covered { field, photo: Pixels { about, values } }
}

fn build(source: &dyn Measured, path: &Path, options: &HeightBuildOptions) -> HeightFile {
    build_heights(source, &HeightOrigin::default(), options, path, &()).unwrap();
    HeightFile::open(path, ReadMethod::default()).unwrap()
}

/// How much of a photo's pixel lies on T: over each cell as much as both have in common, half of it for a triangle.
fn share_by_force(covered: &Covered, period: Option<f64>, [row, column]: [u64; 2]) -> f64 {
    let (field, about) = (&covered.field, &covered.photo.about);
    let edges = |[from, to]: [f64; 2], count: u64, index: u64| {
        [index, index + 1].map(|index| from + (to - from) * index as f64 / count as f64)
    };
    let vertical = edges(about.place.rows, about.size[0], row);
    let horizontal = edges(about.place.columns, about.size[1], column);
    let common = |[from, to]: [f64; 2], cell: u64| (to.min(cell as f64 + 1.0) - from.max(cell as f64)).max(0.0);
    let columns = field.grid.columns;
    let mut sum = 0.0;
    for (r, c) in (0..field.grid.rows - 1).flat_map(|r| (0..columns - 1).map(move |c| (r, c))) {
        let at = |r: u64, c: u64| field.stored[(r * columns + c) as usize];
        let cell = Cell([at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)]);
        let copies = -3..=3;
        let across: f64 = match period {
            None => common(horizontal, c),
            Some(period) => copies.map(|copy| common(horizontal.map(|edge| edge + f64::from(copy) * period), c)).sum(),
        };
        sum += 0.5 * cell.triangles().count() as f64 * common(vertical, r) * across;
    }
    let area = (vertical[1] - vertical[0]) * (horizontal[1] - horizontal[0]);
    (sum / area).min(1.0)
}

/// Every texel against the pixels that it stands for.
fn check(covered: &Covered, file: &HeightFile) -> Result<(), TestCaseError> {
    let stored = file.photo().unwrap();
    let (about, lattice) = (&covered.photo.about, stored.lattice);
    prop_assert_eq!(&stored.about, about);
    let [rows, columns] = about.size;
    let period = about.place.period(&covered.field.grid);
    let shares: Vec<f64> =
        (0..rows * columns).map(|at| share_by_force(covered, period, [at / columns, at % columns])).collect();
    for key in lattice.keys() {
        let Tile { part, texels, .. } = file.tile(key).unwrap();
        let level = u32::from(key.level);
        prop_assert_eq!((part, texels.len()), (lattice.part(key), part.len()));
        for (index, texel) in texels.iter().enumerate() {
            let place = [part.row + (index / part.columns) as u64, part.column + (index % part.columns) as u64];
            let [[top, bottom], [left, right]] = [0, 1].map(|axis| lattice.pixels(axis, level, place[axis]));
            let (mut light, mut on, mut weight, mut share, mut count) = ([0.0; 3], [0.0; 3], 0.0, 0.0, 0.0);
            for at in (top..bottom).flat_map(|row| (left..right).map(move |column| row * columns + column)) {
                let (own, planes) = (shares[at as usize], about.planes());
                for plane in 0..3 {
                    let value = covered.photo.values[at as usize * planes + plane.min(planes - 1)];
                    let value = f64::from(light::table()[usize::from(value)]);
                    light[plane] += value;
                    on[plane] += own * value;
                }
                (weight, share, count) = (weight + own, share + own, count + 1.0);
            }
            // Shares of pixels are kept in 255ths.
            let expected: [f64; 3] =
                std::array::from_fn(|k| if weight > 1e-9 { on[k] / weight } else { light[k] / count });
            let slack = if weight > 1e-9 && weight < 0.999 * count { 400.0 * (count / weight).min(20.0) } else { 4.0 };
            for (own, expected) in texel.iter().zip(expected) {
                let ends = [(expected - slack).max(0.0), expected + slack].map(light::value);
                prop_assert!(
                    (ends[0]..=ends[1]).contains(own),
                    "{key:?} {place:?}: {own}, expected {expected} ({ends:?}), weight {weight} of {count}"
                );
            }
            prop_assert!(
                (f64::from(texel[3]) - 255.0 * share / count).abs() <= 1.2
                    && (texel[3] > 0) == (share > 1e-9)
                    && (texel[3] == 255) == (share > (1.0 - 1e-6) * count),
                "{key:?} {place:?}: {} of {share} of {count}",
                texel[3]
            );
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn texels_are_means_of_what_is_seen(
        samples in [2..30_u64, 2..30_u64],
        rows_of_pixels in 1..90_u64,
        columns_of_pixels in prop_oneof![1..40_u64, 250..620_u64],
        is_grey: bool,
        holes in prop_oneof![Just(0.0), Just(0.3), Just(0.9)],
        kind in 0..3,
        seed: u64,
    ) {
        let mut noise = Noise(seed | 1);
        let size = [rows_of_pixels, columns_of_pixels];
        let [rows, columns] = samples.map(|count| (count - 1) as f64);
        let ends = |noise: &mut Noise, last: f64| {
            let (from, to) = (noise.share() * 1.2 - 0.3, noise.share() * 0.9 + 0.4);
            [from.min(to - 0.1) * last, to * last]
        };
        let mut place = PhotoPlace { rows: [0.0, rows], columns: [0.0, columns] };
        if kind > 0 {
            place = PhotoPlace { rows: ends(&mut noise, rows), columns: ends(&mut noise, columns) };
        }
        let mut covered = covered(samples, size, place, is_grey, holes, seed);
        if kind == 2 {
            // A field that is wider than a turn in the middle of which the photo lies.
            covered.field.grid.xy_unit = Unit::new("deg");
            covered.field.grid.step = [360.0 / (0.8 * columns), -1.0];
        }
        let folder = tempfile::tempdir().unwrap();
        let file = build(&covered, &folder.path().join("covered.df"), &HeightBuildOptions::default());
        check(&covered, &file)?;
        verify_heights(file.path(), &()).unwrap();
        // Another file of it, and its pixels, are the same.
        let again = folder.path().join("again.df");
        build(&file, &again, &HeightBuildOptions::default());
        prop_assert_eq!(std::fs::read(file.path()).unwrap(), std::fs::read(&again).unwrap());
        let photo = PhotoOfFile::of(&file).unwrap();
        let mut values = vec![0; covered.photo.values.len()];
        photo.rows(0, size[0], &mut values).unwrap();
        prop_assert_eq!(&values, &covered.photo.values);
    }
}

/// A photo with several rows and columns of tiles over a field with several bands.
fn large() -> Covered {
    covered([600, 300], [700, 540], PhotoPlace { rows: [-20.0, 599.0], columns: [3.0, 299.0] }, false, 0.3, 5)
}

#[test]
fn photos_are_the_same_with_any_threads_and_memory() {
    let (folder, covered) = (tempfile::tempdir().unwrap(), large());
    let mut files = Vec::new();
    for (threads, memory) in [(1, None), (2, None), (3, Some(100 << 20))] {
        let path = folder.path().join("covered.df");
        let options = HeightBuildOptions { threads: Some(threads), memory, ..HeightBuildOptions::default() };
        let file = build(&covered, &path, &options);
        let lattice = file.photo().unwrap().lattice;
        assert_eq!((lattice.levels(), lattice.tiles_of(0), lattice.tiles()), (3, [3, 3], 9 + 4 + 1));
        files.push(std::fs::read(&path).unwrap());
    }
    assert!(files.iter().all(|file| *file == files[0]));
    let options = HeightBuildOptions { threads: Some(1), memory: Some(30 << 20), ..HeightBuildOptions::default() };
    let error =
        build_heights(&covered, &HeightOrigin::default(), &options, &folder.path().join("a.df"), &()).unwrap_err();
    assert!(error.to_string().contains("and a photo of 540 x 700 take about"), "{error}");
    check_ends(&folder.path().join("covered.df"), &covered);
}

/// Rows in any tile are read back, and there are no others.
fn check_ends(path: &Path, covered: &Covered) {
    let file = HeightFile::open(path, ReadMethod::default()).unwrap();
    let mut row = vec![0; 540 * 3];
    PhotoOfFile::of(&file).unwrap().rows(511, 1, &mut row).unwrap();
    assert_eq!(row, covered.photo.values[511 * 540 * 3..][..540 * 3]);
    assert!(PhotoOfFile::of(&file).unwrap().rows(700, 1, &mut row).is_err());
    assert!(file.tile(TileKey { level: 9, row: 0, column: 0 }).is_err());
}

#[test]
fn damage_of_photos_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let place = PhotoPlace { rows: [0.0, 12.0], columns: [2.0, 9.0] };
    let covered = covered([13, 10], [21, 300], place, false, 0.2, 3);
    let file = build(&covered, &folder.path().join("covered.df"), &HeightBuildOptions::default());
    let bytes = std::fs::read(file.path()).unwrap();
    assert_eq!(u32::from_le_bytes(bytes[8..12].try_into().unwrap()), 5);
    let path = folder.path().join("damaged.df");
    let word = |bytes: &[u8], at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let footer = word(&bytes, 24);
    let mut noise = Noise(7);
    for at in (4096..bytes.len()).step_by(7).chain(footer..bytes.len()) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (noise.next() % 8);
        std::fs::write(&path, &damaged).unwrap();
        assert!(verify_heights(&path, &()).is_err(), "byte {at} of {}", bytes.len());
    }
    // Behind right checksums: no panic, whatever it says, and tiles are refused or have their texels.
    for round in 0..3000 {
        let mut damaged = bytes.clone();
        match round % 3 {
            0 => damaged.truncate(footer + 1 + noise.next() as usize % (bytes.len() - footer - 1)),
            1 => damaged[footer + (noise.next() as usize % (bytes.len() - footer))] = noise.next() as u8,
            // The photo's own part is at the end.
            _ => damaged[bytes.len() - 1 - noise.next() as usize % 110] = noise.next() as u8,
        }
        let len = damaged.len() as u64;
        damaged[16..24].copy_from_slice(&len.to_le_bytes());
        damaged[32..40].copy_from_slice(&(len - footer as u64).to_le_bytes());
        let crc = crc32c::crc32c(&damaged[footer..]);
        damaged[40..44].copy_from_slice(&crc.to_le_bytes());
        let crc = crc32c::crc32c(&damaged[..60]);
        damaged[60..64].copy_from_slice(&crc.to_le_bytes());
        std::fs::write(&path, &damaged).unwrap();
        let _ = verify_heights(&path, &());
        if let Ok(file) = HeightFile::open(&path, ReadMethod::default())
            && let Some(photo) = file.photo()
        {
            for key in photo.lattice.keys().take(50) {
                if let Ok(tile) = file.tile(key) {
                    assert_eq!(tile.texels.len(), tile.part.len());
                }
            }
        }
    }
}
