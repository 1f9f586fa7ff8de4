//! Small files of the formats that are written here byte by byte, what is read of them, and what is said of damage.

use super::hostile::hostile;
use super::{file_of, heights, open, plane, refusal, same};
use crate::import::{HeightOptions, height_format, summarize_heights};
use crate::model::Heights;
use deepfield_data::model::Unit;
use std::io::Write;

const NAN: f64 = f64::NAN;

/// A surface of 4 x 3, with a sample that was not measured. `bits` is 16 or 32.
fn sur(bits: i16, is_packed: bool) -> Vec<u8> {
    let mut head = vec![0; 512];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, if is_packed { b"DSCOMPRESSED" } else { b"DIGITAL SURF" });
    put(14, &1_i16.to_le_bytes());
    put(16, &1_i16.to_le_bytes());
    put(18, &2_i16.to_le_bytes());
    put(86, &1_i16.to_le_bytes());
    put(98, &bits.to_le_bytes());
    for (at, value) in [(100, -5_i32), (104, 5), (108, 4), (112, 3), (116, 12)] {
        put(at, &value.to_le_bytes());
    }
    for (at, value) in [(120, 0.5_f32), (124, 250.0), (128, 0.25), (474, 100.0), (466, 3.0), (470, 2000.0)] {
        put(at, &value.to_le_bytes());
    }
    put(180, b"mm              ");
    put(196, b"\xb5m\0\0\0\0\0\0\0\0\0\0\0\0\0\0");
    put(212, b"nm");
    put(228, b"m");
    put(334, &7_i16.to_le_bytes());
    put(336, &3_i16.to_le_bytes());
    let mut samples = Vec::new();
    for value in [-5_i32, -4, -3, -2, -1, -7, 1, 2, 3, 4, 5, 0] {
        match bits {
            16 => samples.extend_from_slice(&(value as i16).to_le_bytes()),
            _ => samples.extend_from_slice(&value.to_le_bytes()),
        }
    }
    head.extend_from_slice(b"comment");
    head.extend_from_slice(b"own");
    if !is_packed {
        head.extend_from_slice(&samples);
        return head;
    }
    // Two streams.
    let parts = samples.split_at(20);
    let packed = [parts.0, parts.1].map(|part| {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(part).unwrap();
        (part.len() as u32, encoder.finish().unwrap())
    });
    head.extend_from_slice(&2_u32.to_le_bytes());
    for (raw, packed) in &packed {
        head.extend_from_slice(&raw.to_le_bytes());
        head.extend_from_slice(&(packed.len() as u32).to_le_bytes());
    }
    packed.iter().for_each(|(_, packed)| head.extend_from_slice(packed));
    head
}

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

/// A depth image of 3 x 4 with planes; rows of 3 floats fill 16 bytes.
fn al3d() -> Vec<u8> {
    let mut file = b"AliconaImaging\0\r\n".to_vec();
    let tags = [
        ("Version", "1"),
        ("TagCount", "9"),
        ("Cols", "3"),
        ("Rows", "4"),
        ("DepthImageOffset", "900"),
        ("TextureImageOffset", "964"),
        ("NumberOfPlanes", "4"),
        ("TexturePtr", "0;1;2"),
        ("DepthImageResPtr", "3"),
        ("PixelSizeXMeter", "1e-6"),
        ("PixelSizeYMeter", "2.5e-06"),
        ("InvalidPixelValue", "3.0000000028082e+15"),
    ];
    for (name, value) in tags {
        let mut tag = vec![0; 52];
        tag[..name.len()].copy_from_slice(name.as_bytes());
        tag[20..20 + value.len()].copy_from_slice(value.as_bytes());
        tag[50..].copy_from_slice(b"\r\n");
        file.extend_from_slice(&tag);
    }
    file.resize(900, 0);
    for row in 0..4 {
        for column in 0..4_u16 {
            let height = if (row, column) == (2, 1) {
                3.000_000_028_082_176e15_f64 as f32
            } else {
                f32::from(row * 10 + column)
            };
            file.extend_from_slice(&height.to_le_bytes());
        }
    }
    for plane in 0..4 {
        for row in 0..4 {
            file.extend((0..8).map(|column| plane * 64 + row * 8 + column));
        }
    }
    file
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

/// A scan of 3 x 2 of 16 bits.
fn frt(bits: i32) -> Vec<u8> {
    let mut file = b"FRTM_GLIDERV1.00\x05\x00".to_vec();
    let mut block = |number: u16, bytes: &[u8]| {
        file.extend_from_slice(&number.to_le_bytes());
        file.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
        file.extend_from_slice(bytes);
    };
    let all = |values: &[i32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    block(101, &[0]);
    block(102, &all(&[3, 2, bits]));
    block(103, &[0.3_f64.to_le_bytes(), 4_f64.to_le_bytes()].concat());
    block(108, &[&all(&[5])[..], &0.5_f64.to_le_bytes()].concat());
    let values: Vec<u8> = match bits {
        16 => [4_u16, 1, 6, 10, 11, 65535].iter().flat_map(|value| value.to_le_bytes()).collect(),
        _ => all(&[4, 1, 6, 10, 11, 65535]),
    };
    block(11, &values);
    block(104, &[0; 36]);
    file
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

/// An archive of these entries.
fn zip(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        writer.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// A surface of 3 x 2 in whole numbers, with a mask; `change` is put in the description in place of what it names.
fn x3p(change: (&str, &str)) -> Vec<u8> {
    let xml = r#"<?xml version="1.0" encoding="UTF-8"?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2"><Record1><Revision>ISO5436 - 2000</Revision><FeatureType>SUR</FeatureType><Axes>
<CX><AxisType>I</AxisType><DataType>D</DataType><Increment>1e-6</Increment><Offset>0.5</Offset></CX>
<CY><AxisType>I</AxisType><DataType>D</DataType><Increment>2e-6</Increment></CY>
<CZ><AxisType>A</AxisType><DataType>I</DataType><Increment>0.5</Increment><Offset>10</Offset></CZ></Axes></Record1>
<Record3><MatrixDimension><SizeX>3</SizeX><SizeY>2</SizeY><SizeZ>1</SizeZ></MatrixDimension>
<DataLink><PointDataLink>bindata/data.bin</PointDataLink><MD5ChecksumPointData>8BC78B4CB7DFE33B9AB7B4AFCA0DDA4B</MD5ChecksumPointData>
<ValidPointsLink>bindata/valid.bin</ValidPointsLink></DataLink></Record3></p:ISO5436_2>"#;
    assert!(xml.contains(change.0));
    let xml = xml.replace(change.0, change.1);
    let data: Vec<u8> = [1_i16, -2, 3, 4, 5, 600].iter().flat_map(|value| value.to_le_bytes()).collect();
    zip(&[("bindata/data.bin", &data), ("bindata/valid.bin", &[0b101_101]), ("main.xml", xml.as_bytes())])
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
