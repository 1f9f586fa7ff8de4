//! Small files of the formats that are written byte by byte: what is read of them, and what is said of damage.

use super::files::{al3d, frt, sur, x3p, zip};
use super::hostile::hostile;
use super::{file_of, heights, open, plane, refusal, same};
use crate::import::{HeightOptions, height_format, summarize_heights};
use crate::model::Heights;
use deepfield_data::model::Unit;

const NAN: f64 = f64::NAN;

#[test]
fn surfaces_of_digital_surf_are_read() {
    for (bits, is_packed) in [(16, false), (32, false), (16, true), (32, true)] {
        // What is below the least height is none, whatever the flag says; where it says that there is no such sample a note tells.
        let mut unflagged = sur(bits, is_packed);
        unflagged[86] = 0;
        let (_folder, path) = file_of("a.sur", &unflagged);
        let contradicted = open(&path);
        let note = "the header says that every sample was measured: those of -7, below its least one, are not, if any";
        assert!(contradicted.description().notes.iter().any(|told| told == note));
        let (_folder, path) = file_of("a.sur", &sur(bits, is_packed));
        let source = open(&path);
        assert!(source.description().notes.is_empty() && same(&heights(&contradicted), &heights(&source), 0.0));
        let grid = source.grid();
        assert_eq!((grid.columns, grid.rows, grid.step, grid.origin), (4, 3, [0.5, 0.25], [3.0, 2.0]));
        assert_eq!((&*grid.xy_unit.0, &*grid.height_unit.0), ("mm", "nm"));
        let stored = [-5.0, -4.0, -3.0, -2.0, -1.0, NAN, 1.0, 2.0, 3.0, 4.0, 5.0, 0.0];
        assert!(same(&heights(&source), &stored.map(|value| 100.0 + 0.25 * value), 0.0));
        assert_eq!(height_format(&path).unwrap().map(|told| (told.format, told.is_sure)), Some(("sur", true)));
    }
}

#[test]
fn what_is_wrong_with_a_surface_is_named() {
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = sur(32, false);
        file[at..at + bytes.len()].copy_from_slice(bytes);
        refusal("a.sur", &file, &HeightOptions::default())
    };
    assert_eq!(
        changed(108, &0_i32.to_le_bytes()),
        "a.sur: samples of a row: found 0, expected at least 2 (at least 2 x 2 samples)"
    );
    assert_eq!(
        changed(112, &(-5_i32).to_le_bytes()),
        "a.sur: rows: found -5, expected at least 2 (at least 2 x 2 samples)"
    );
    assert_eq!(changed(112, &1_i32.to_le_bytes()), "a.sur: rows: found 4 x 1, expected at least 2 x 2 samples");
    assert_eq!(changed(112, &4_i32.to_le_bytes()), "a.sur: samples: found 48 bytes, expected 64 (4 x 4 of int32)");
    let huge = [i32::MAX.to_le_bytes(), i32::MAX.to_le_bytes()].concat();
    let text = changed(108, &huge);
    assert!(text.contains("2147483647 x 2147483647") && text.contains("found") && text.contains("expected"), "{text}");
    assert_eq!(changed(120, &0_f32.to_le_bytes()), "a.sur: x step: found 0, expected a number above 0");
    assert_eq!(changed(124, &f32::NAN.to_le_bytes()), "a.sur: y step: found NaN, expected a number above 0");
    assert_eq!(changed(98, &8_i16.to_le_bytes()), "a.sur: bits of a sample: found 8, expected 16 or 32");
    let unit = "a.sur: unit of heights: found \"V\" (beside \"mm\"), expected a length: km, m, mm, um or nm, or --height-unit that says it";
    assert_eq!(changed(212, b"V\0"), unit);
    assert!(changed(18, &5_i16.to_le_bytes()).contains("a series of surfaces"));
    assert_eq!(
        refusal("a.sur", &sur(32, false)[..300], &HeightOptions::default()),
        "a.sur: header: found 300 bytes, expected 512"
    );
    let mut file = sur(32, false);
    file[212..214].copy_from_slice(b"V\0");
    let (_folder, path) = file_of("a.sur", &file);
    let options = HeightOptions { height_unit: Some(Unit::new("um")), ..HeightOptions::default() };
    assert_eq!(crate::import::open_heights(&path, &options).unwrap().grid().height_unit.0, "um");
    let mut packed = sur(32, true);
    let at = packed.len() - 3;
    packed.truncate(at);
    assert!(refusal("a.sur", &packed, &HeightOptions::default()).contains("bytes"));
}

#[test]
fn depth_images_are_read_with_their_planes() {
    let (_folder, path) = file_of("a.al3d", &al3d());
    let source = open(&path);
    assert_eq!((source.grid().columns, source.grid().rows, source.grid().step), (3, 4, [1e-6, 2.5e-6]));
    let expected = [0.0, 1.0, 2.0, 10.0, 11.0, 12.0, 20.0, NAN, 22.0, 30.0, 31.0, 32.0];
    assert!(same(&heights(&source), &expected, 0.0));
    assert_eq!(plane(&source, 2), [128, 129, 130, 136, 137, 138, 144, 145, 146, 152, 153, 154]);
    assert_eq!(source.grid().planes.last().map(|plane| &*plane.name), Some("quality"));
    let text = refusal("a.al3d", &al3d()[..950], &HeightOptions::default());
    assert_eq!(text, "a.al3d: depth image: found 50 bytes, expected 60 (3 x 4 of float32)");
    let text = refusal("a.al3d", &al3d()[..1000], &HeightOptions::default());
    assert_eq!(text, "a.al3d: texture plane 1: found 4 bytes, expected 27 (3 x 4 of uint8)");
}

#[test]
fn scans_are_read_from_their_last_row() {
    for bits in [16, 32] {
        let (_folder, path) = file_of("a.frt", &frt(bits));
        let source = open(&path);
        assert!(same(&heights(&source), &[5.0, 5.5, 32767.5, 2.0, NAN, 3.0], 0.0));
        assert!((source.grid().step[0] - 0.1).abs() < 1e-15 && source.grid().step[1] == 2.0);
    }
    let mut short = frt(16);
    short.truncate(18 + 7 + 18 + 22 + 18 + 6 + 5);
    let text = refusal("a.frt", &short, &HeightOptions::default());
    assert_eq!(text, "a.frt: samples (block 11): found 5 bytes, expected 12 (3 x 2 of uint16)");
    assert!(refusal("a.frt", &frt(16)[..40], &HeightOptions::default()).contains("block 102"));
}

#[test]
fn x3p_surfaces_are_read_with_their_mask() {
    let (_folder, path) = file_of("a.x3p", &x3p(("SUR", "SUR")));
    let source = open(&path);
    let grid = source.grid();
    assert_eq!((grid.columns, grid.rows, grid.step, grid.origin), (3, 2, [1e-6, 2e-6], [0.5, 0.0]));
    assert!(same(&heights(&source), &[10.5, NAN, 11.5, 12.0, NAN, 310.0], 0.0));
    let found = summarize_heights(&source).unwrap();
    assert_eq!((found.valid, found.invalid.no_data, found.invalid.nan), (4, 2, 0));
    assert!(found.notes.iter().any(|note| note.contains("MD5")), "{:?}", found.notes);
    let refused = |change: (&str, &str)| refusal("a.x3p", &x3p(change), &HeightOptions::default());
    assert_eq!(
        refused((">SUR<", ">PCL<")),
        "a.x3p: FeatureType: found PCL, a point cloud, expected a surface (SUR): a matrix of heights"
    );
    assert!(refused((">SUR<", ">PRF<")).contains("PRF, a profile"));
    assert_eq!(
        refused(("<SizeX>3", "<SizeX>4")),
        "a.x3p: bindata/data.bin: found 12 bytes, expected 16 (4 x 2 of int16)"
    );
    assert!(refused(("<SizeZ>1", "<SizeZ>3")).contains("3 layers"));
    assert!(refused(("<Increment>2e-6", "<Increment>0")).starts_with("a.x3p: CY/Increment: found 0, expected"));
    assert!(refused(("bindata/data.bin<", "bindata/other.bin<")).contains("bindata/other.bin: missing"));
    let huge = refused(("<SizeX>3</SizeX><SizeY>2", "<SizeX>9223372036854775807</SizeX><SizeY>9223372036854775807"));
    assert!(huge.contains("found") && huge.contains("2^63"), "{huge}");
    let unstated = x3p(("<Increment>2e-6</Increment>", ""));
    let (_folder, path) = file_of("a.x3p", &unstated);
    assert!(open(&path).description().notes.iter().any(|note| note.contains("--spacing")));
    // A name that says nothing, and one of another format's files.
    let (_folder, path) = file_of("a.bin", &x3p(("SUR", "SUR")));
    assert_eq!(height_format(&path).unwrap().map(|told| told.format), Some("x3p"));
    let (_folder, path) = file_of("a.zip", &zip(&[("readme.txt", b"hello")]));
    assert_eq!(height_format(&path).unwrap(), None);
}

/// An entry that holds more than its archive declares.
#[test]
fn archives_that_lie_are_refused() {
    let whole = x3p(("SUR", "SUR"));
    // The stated size of the first entry, in its header and in the directory.
    let mut lying = whole.clone();
    let directory = whole.windows(4).position(|word| word == b"PK\x01\x02").unwrap();
    for at in [22, directory + 24] {
        assert_eq!(lying[at], 12);
        lying[at] = 8;
    }
    let text = refusal("a.x3p", &lying, &HeightOptions::default());
    assert_eq!(text, "a.x3p: bindata/data.bin: found 8 bytes, expected 12 (3 x 2 of int16)");
    // The description asks for as few as the archive states.
    let whole = x3p(("<SizeX>3</SizeX><SizeY>2", "<SizeX>2</SizeX><SizeY>2"));
    let mut lying = whole.clone();
    let directory = whole.windows(4).position(|word| word == b"PK\x01\x02").unwrap();
    for at in [22, directory + 24] {
        lying[at] = 8;
    }
    let text = refusal("a.x3p", &lying, &HeightOptions::default());
    assert!(text.contains("bindata/data.bin") && text.contains("8 (2 x 2 of int16)"), "{text}");
}

#[test]
fn damaged_surfaces_of_digital_surf() {
    hostile(&[("hostile.sur", &sur(16, false)[..], 0..512), ("hostile.sur", &sur(32, true)[..], 0..522)], true);
}

#[test]
fn damaged_depth_images() {
    hostile(&[("hostile.al3d", &al3d()[..], 0..17 + 12 * 52)], true);
}

#[test]
fn damaged_scans() {
    hostile(&[("hostile.frt", &frt(16)[..], 0..100)], true);
}

#[test]
fn damaged_x3p() {
    let whole = x3p(("SUR", "SUR"));
    hostile(&[("hostile.x3p", &whole[..], 0..whole.len())], true);
}
