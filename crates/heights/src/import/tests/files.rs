//! Small files of the formats that tests write byte by byte. Nothing here names the package, so that tests beside it have them, too.

use std::io::Write;

/// A surface of 4 x 3, with a sample that was not measured. `bits` is 16 or 32.
pub fn sur(bits: i16, is_packed: bool) -> Vec<u8> {
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

/// A depth image of 3 x 4 with planes; rows of 3 floats fill 16 bytes.
pub fn al3d() -> Vec<u8> {
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

/// A scan of 3 x 2 of 16 bits.
pub fn frt(bits: i32) -> Vec<u8> {
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

/// An archive of these entries.
pub fn zip(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        writer.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// A surface of 3 x 2 in whole numbers, with a mask; `change` is put in the description in place of what it names.
pub fn x3p(change: (&str, &str)) -> Vec<u8> {
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

/// A grid of 3 x 2 of text.
pub const DSAA: &str = "DSAA\n3 2\n10 12\r\n-1 1\n0 6\n1 2.5 1.70141e+38\n\n4\n5 6e0\n";

/// The same in single precision.
pub fn dsbb() -> Vec<u8> {
    let mut file = b"DSBB".to_vec();
    file.extend([3_i16, 2].iter().flat_map(|count| count.to_le_bytes()));
    file.extend([10.0_f64, 12.0, -1.0, 1.0, 0.0, 6.0].iter().flat_map(|place| place.to_le_bytes()));
    file.extend([1.0_f32, 2.5, 1.70141e38, 4.0, 5.0, 6.0].iter().flat_map(|height| height.to_le_bytes()));
    file
}

/// The same in blocks.
pub fn dsrb() -> Vec<u8> {
    let mut file = b"DSRB\x04\0\0\0\x01\0\0\0GRID\x48\0\0\0\x02\0\0\0\x03\0\0\0".to_vec();
    let numbers = [10.0, -1.0, 1.0, 2.0, 0.0, 6.0, 0.0, 1.70141e38];
    file.extend(numbers.iter().flat_map(|number: &f64| number.to_le_bytes()));
    file.extend(b"DATA\x30\0\0\0");
    file.extend([1.0, 2.5, 1.70141e38, 4.0, 5.0, 6.0].iter().flat_map(|height: &f64| height.to_le_bytes()));
    file
}

/// A container of a field of 3 x 2.
pub fn gwy() -> Vec<u8> {
    let object = |name: &str, values: &[Vec<u8>]| {
        let values = values.concat();
        [name.as_bytes(), b"\0", &(values.len() as u32).to_le_bytes(), &values].concat()
    };
    let value = |name: &str, kind: u8, bytes: &[u8]| [name.as_bytes(), &[0, kind], bytes].concat();
    let unit = |name: &str| value(name, b'o', &object("GwySIUnit", &[value("unitstr", b's', b"m\0")]));
    let heights: Vec<u8> = (1..7).flat_map(|height| f64::from(height).to_le_bytes()).collect();
    let field = object(
        "GwyDataField",
        &[
            value("xres", b'i', &3_i32.to_le_bytes()),
            value("yres", b'i', &2_i32.to_le_bytes()),
            value("xreal", b'd', &6_f64.to_le_bytes()),
            value("yreal", b'd', &3_f64.to_le_bytes()),
            value("xoff", b'd', &10_f64.to_le_bytes()),
            unit("si_unit_xy"),
            unit("si_unit_z"),
            value("data", b'D', &[&6_u32.to_le_bytes()[..], &heights].concat()),
        ],
    );
    let all = [
        value("/0/data/title", b's', b"Heights\0"),
        value("/0/base/range-type", b'i', &1_i32.to_le_bytes()),
        value("names", b'S', b"\x02\0\0\0a\0b\0"),
        value("/0/data", b'o', &field),
        value("/0/show", b'b', &[1]),
    ];
    [b"GWYP".to_vec(), object("GwyContainer", &all)].concat()
}

/// A topography of 3 x 2 with a picture.
pub fn plu() -> Vec<u8> {
    let mut file = vec![0; 508];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"Thu Oct 11 07:59:01 2007");
    for (at, number) in [(388, 2_u32), (392, 3), (428, 3), (500, 2), (504, 3)] {
        put(at, &number.to_le_bytes());
    }
    for (at, step) in [(404, 0.5_f32), (408, 0.25)] {
        put(at, &step.to_le_bytes());
    }
    put(492, &[1]);
    file.extend([1.0_f32, 2.0, 1_000_001.0, 4.0, 5.0, 6.5].iter().flat_map(|height| height.to_le_bytes()));
    file.extend([6.5_f32, 1.0].iter().flat_map(|height| height.to_le_bytes()));
    file.extend(0..18);
    file
}

/// The same as a newer file, of this description and these heights.
pub fn plux(index: &str, heights: &[f32]) -> Vec<u8> {
    let bytes: Vec<u8> = heights.iter().flat_map(|height| height.to_le_bytes()).collect();
    zip(&[("index.xml", index.as_bytes()), ("LAYER_0.raw", &bytes), ("LAYER_0.stack.raw", &[7; 18])])
}

/// Such a description.
pub const INDEX: &str = "<xml><GENERAL><IMAGE_SIZE_X>3</IMAGE_SIZE_X><IMAGE_SIZE_Y>2</IMAGE_SIZE_Y><FOV_X>0.5</FOV_X>\
     <FOV_Y>0.25</FOV_Y></GENERAL><LAYER_0><FILENAME_Z>LAYER_0.raw</FILENAME_Z></LAYER_0></xml>";
/// Such heights.
pub const PLUX: [f32; 6] = [1.0, 2.0, f32::NAN, 4.0, 5.0, 6.5];
