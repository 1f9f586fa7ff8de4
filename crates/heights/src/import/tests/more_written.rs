//! Grids of other programs.

use super::files::{DSAA, INDEX, PLUX, dsbb, dsrb, gwy, plu, plux};
use super::hostile::{hostile, hostile_beside};
use super::{file_of, heights, open, plane, refusal, same};
use crate::import::{HeightOptions, open_heights};
use crate::model::Heights;

const NAN: f64 = f64::NAN;

#[test]
fn surfer_grids_of_all_kinds_are_the_same() {
    for bytes in [DSAA.as_bytes().to_vec(), dsbb(), dsrb()] {
        let (_folder, path) = file_of("a.grd", &bytes);
        let source = open(&path);
        let grid = source.grid();
        assert_eq!((grid.columns, grid.rows, grid.origin, grid.step), (3, 2, [10.0, -1.0], [1.0, 2.0]));
        assert!(same(&heights(&source), &[1.0, 2.5, NAN, 4.0, 5.0, 6.0], 0.0), "{:?}", heights(&source));
    }
    let said = |text: String| refusal("a.grd", text.as_bytes(), &HeightOptions::default());
    assert_eq!(said(DSAA.replace("6e0", "")), "a.grd: heights: found 5, expected 6 (3 x 2 of float64)");
    assert_eq!(said(DSAA.replace("6e0", "6 7")), "a.grd: heights: found more than 6, expected 6 (3 x 2 of float64)");
    assert_eq!(said(DSAA.replace("2.5", "2,5")), "a.grd: height 1: found 2,5, expected a number");
    assert!(said(DSAA.replace("3 2", "2147483648 2147483648")).contains("2147483648 x 2147483648"));
    assert!(said(DSAA.replace("3 2", "30000 20000")).contains("at least 1200000000"));
    assert!(said(DSAA.replace("10 12", "10 10")).contains("x from first to last: found 0"));
    let text = refusal("a.grd", &dsrb()[..140], &HeightOptions::default());
    assert_eq!(text, "a.grd: DATA: found 40 bytes, expected 48 (3 x 2 of float64)");
}

#[test]
fn floats_are_described_by_the_file_beside_them() {
    let floats: Vec<u8> =
        [1.0_f32, 2.0, -9999.0, 4.0, 5.0, 6.0].iter().flat_map(|height| height.to_be_bytes()).collect();
    let (folder, path) = file_of("a.flt", &floats);
    let write = |text: &str| std::fs::write(folder.path().join("a.hdr"), text).unwrap();
    let header = "ncols 3\r\nNROWS  2\r\nxllcorner 10\r\nyllcenter -1\r\ncellsize 2\r\nNODATA_value -9999\r\nbyteorder MSBFIRST\r\n";
    write(header);
    let source = open(&path);
    assert_eq!((source.grid().origin, source.grid().step), ([11.0, 1.0], [2.0, -2.0]));
    assert!(same(&heights(&source), &[1.0, 2.0, NAN, 4.0, 5.0, 6.0], 0.0));
    let said = || open_heights(&path, &HeightOptions::default()).unwrap_err().to_string();
    write(&header.replace("ncols 3", "ncols 4"));
    assert!(said().ends_with("a.flt: samples: found 24 bytes, expected 32 (4 x 2 of float32)"), "{}", said());
    write(&header.replace("cellsize 2", "cellsize nan"));
    assert!(said().ends_with("a.hdr: cellsize: found NaN, expected a number above 0"), "{}", said());
    std::fs::remove_file(folder.path().join("a.hdr")).unwrap();
    assert!(said().ends_with("a.flt: description: missing, expected a file with .hdr in place of .flt"), "{}", said());
}

#[test]
fn gwyddion_fields_are_read() {
    let (_folder, path) = file_of("a.gwy", &gwy());
    let source = open(&path);
    let grid = source.grid();
    assert_eq!((grid.columns, grid.rows, grid.origin, grid.step), (3, 2, [11.0, 0.75], [2.0, 1.5]));
    assert_eq!((&*grid.xy_unit.0, &*grid.height_unit.0), ("m", "m"));
    assert_eq!(heights(&source), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
}

#[test]
fn files_of_sensofar_are_read() {
    // Told by what is in them.
    for (bytes, format) in [(plu(), "plu"), (plux(INDEX, &PLUX), "plux")] {
        let (_folder, path) = file_of("a.dat", &bytes);
        let source = open(&path);
        let grid = source.grid();
        assert_eq!((source.description().format, grid.columns, grid.rows, grid.step), (format, 3, 2, [0.5, 0.25]));
        assert_eq!((&*grid.xy_unit.0, &*grid.height_unit.0), ("um", "um"));
        assert!(same(&heights(&source), &[1.0, 2.0, NAN, 4.0, 5.0, 6.5], 0.0));
        if format == "plu" {
            assert_eq!(grid.planes.iter().map(|plane| &*plane.name).collect::<Vec<_>>(), ["red", "green", "blue"]);
            assert_eq!(plane(&source, 1), [1, 4, 7, 10, 13, 16]);
        }
    }
    let said = |at: usize, number: u32| {
        let mut bytes = plu();
        bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        refusal("a.plu", &bytes, &HeightOptions::default())
    };
    assert!(said(428, 1).contains("found 1, a profile, expected 3, a topography"), "{}", said(428, 1));
    assert!(said(500, 1 << 31).contains("heights: found 50 bytes, expected 25769803776"), "{}", said(500, 1 << 31));
    assert!(said(504, 1).contains("1 x 2, expected at least 2 x 2"), "{}", said(504, 1));
    assert!(said(404, 0).contains("step along x (byte 404): found 0"), "{}", said(404, 0));
    let said = |index: &str, heights: &[f32]| refusal("a.plux", &plux(index, heights), &HeightOptions::default());
    assert_eq!(said(INDEX, &PLUX[..5]), "a.plux: LAYER_0.raw: found 20 bytes, expected 24 (3 x 2 of float32)");
    assert!(said(&INDEX.replace("<FOV_X>0.5", "<FOV_X>-1"), &PLUX).contains("GENERAL/FOV_X: found -1"));
    assert!(said(&INDEX.replace("IMAGE_SIZE_Y>", "Y>"), &PLUX).contains("IMAGE_SIZE_Y"));
    assert!(said("<xml>", &PLUX).contains("index.xml"));
}

#[test]
fn damaged_grids() {
    hostile(&[("hostile.plu", &plu()[..], 0..508)], true);
    let plux = plux(INDEX, &PLUX);
    hostile(&[("hostile.plux", &plux[..], 0..plux.len())], true);
    let (dsbb, dsrb) = (dsbb(), dsrb());
    let name = "hostile.grd";
    hostile(&[(name, DSAA.as_bytes(), 0..40), (name, &dsbb[..], 0..56), (name, &dsrb[..], 0..100)], true);
    let gwy = gwy();
    hostile(&[("hostile.gwy", &gwy[..], 0..gwy.len())], true);
    let header = b"ncols 3\r\nnrows 2\r\nxllcorner 10\r\nyllcenter -1\r\ncellsize 2\r\nNODATA_value -9999\r\nbyteorder MSBFIRST\r\n";
    hostile_beside(("hostile.flt", &[0x40; 24]), ("hostile.hdr", &header[..], 0..header.len()), true);
}
