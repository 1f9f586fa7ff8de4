//! Small files of every format, made here byte by byte.

use crate::model::SampleType;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use std::io::Write;

/// A file that is to be opened, those beside it, and the grid in it.
pub struct Case {
    pub name: &'static str,
    pub bytes: Vec<u8>,
    pub beside: Vec<(&'static str, Vec<u8>)>,
    pub shape: Vec<u64>,
    pub sample_type: SampleType,
    pub channels: usize,
    /// Samples in this machine's byte order: channels, x, y, z.
    pub samples: Vec<u8>,
    /// Spacing, where the format has one.
    pub spacing: Option<[f64; 3]>,
}

/// The volume in most files.
pub const SHAPE: [u64; 3] = [6, 5, 4];
const SPACING: [f64; 3] = [1.5, 2.0, 2.5];

pub fn value(x: u64, y: u64, z: u64) -> i16 {
    (x + 10 * y + 300 * z) as i16 - 500
}

pub fn values() -> Vec<i16> {
    let [nx, ny, nz] = SHAPE;
    (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| value(x, y, z)))).collect()
}

pub fn little() -> Vec<u8> {
    values().into_iter().flat_map(i16::to_le_bytes).collect()
}

pub fn big() -> Vec<u8> {
    values().into_iter().flat_map(i16::to_be_bytes).collect()
}

pub fn native() -> Vec<u8> {
    values().into_iter().flat_map(i16::to_ne_bytes).collect()
}

pub fn text() -> Vec<u8> {
    values().iter().map(i16::to_string).collect::<Vec<_>>().join(" ").into_bytes()
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::default());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

pub fn volume(name: &'static str, bytes: Vec<u8>) -> Case {
    Case {
        name,
        bytes,
        beside: Vec::new(),
        shape: SHAPE.to_vec(),
        sample_type: SampleType::I16,
        channels: 1,
        samples: native(),
        spacing: Some(SPACING),
    }
}

pub fn nrrd(more: &str, body: &[u8]) -> Vec<u8> {
    let head = "NRRD0004\n# a comment\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 6 5 4\n\
        space directions: (0,1.5,0) (-2,0,0) (0,0,2.5)\nspace origin: (1,2,3)\n";
    [head.as_bytes(), more.as_bytes(), body].concat()
}

pub fn npy(descr: &str, is_fortran: bool, shape: &str, body: &[u8]) -> Vec<u8> {
    let order = if is_fortran { "True" } else { "False" };
    let mut head = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    while (head.len() + 11) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    [b"\x93NUMPY\x01\0", &(head.len() as u16).to_le_bytes()[..], head.as_bytes(), body].concat()
}

/// A header of NIfTI-1 in little endian, its samples behind it from byte 352 on.
pub fn nifti(datatype: i16, magic: &[u8; 4], body: &[u8]) -> Vec<u8> {
    let mut head = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    for (index, size) in [3_i16, 6, 5, 4, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * index, &size.to_le_bytes());
    }
    put(70, &datatype.to_le_bytes());
    put(72, &16_i16.to_le_bytes());
    for (index, step) in [1.0_f32, 1.5, 2.0, 2.5].into_iter().enumerate() {
        put(76 + 4 * index, &step.to_le_bytes());
    }
    put(108, &(if magic == b"n+1\0" { 352.0_f32 } else { 0.0 }).to_le_bytes());
    put(112, &f32::NAN.to_le_bytes());
    put(123, &[2]);
    put(344, magic);
    if magic == b"n+1\0" { [head, body.to_vec()].concat() } else { head }
}

/// NIfTI-2 in big endian, with an sform.
pub fn nifti2(body: &[u8]) -> Vec<u8> {
    let mut head = vec![0; 544];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &540_i32.to_be_bytes());
    put(4, b"n+2\0\r\n\x1a\n");
    put(12, &4_i16.to_be_bytes());
    for (index, size) in [3_i64, 6, 5, 4, 1, 1, 1, 1].into_iter().enumerate() {
        put(16 + 8 * index, &size.to_be_bytes());
    }
    put(168, &544_i64.to_be_bytes());
    put(176, &2.0_f64.to_be_bytes());
    put(184, &10.0_f64.to_be_bytes());
    put(348, &1_i32.to_be_bytes());
    for (index, number) in [0.0, -2.0, 0.0, 7.0, 1.5, 0.0, 0.0, 8.0, 0.0, 0.0, 2.5, 9.0_f64].into_iter().enumerate() {
        put(400 + 8 * index, &number.to_be_bytes());
    }
    put(500, &1_i32.to_be_bytes());
    [head, body.to_vec()].concat()
}

pub fn metaimage(more: &str, body: &[u8]) -> Vec<u8> {
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 6 5 4\nElementType = MET_SHORT\nElementSpacing = 1.5 2 2.5\n\
        TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 1 2 3\n";
    [head.as_bytes(), more.as_bytes(), body].concat()
}

pub fn png(width: u32, height: u32, color: png::ColorType, depth: png::BitDepth, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(pixels).unwrap();
    writer.finish().unwrap();
    bytes
}

/// A file of every format and coding.
pub fn every() -> Vec<Case> {
    let rgb: Vec<u8> = (0..6 * 5 * 3).map(|i| (i * 7 % 251) as u8).collect();
    let planar: Vec<u8> = (0..3).flat_map(|c| rgb.iter().skip(c).step_by(3).copied().collect::<Vec<u8>>()).collect();
    let colours = |name, bytes: Vec<u8>| Case {
        shape: vec![6, 5],
        sample_type: SampleType::U8,
        channels: 3,
        samples: rgb.clone(),
        spacing: None,
        ..volume(name, bytes)
    };
    // z fastest, then y, then x.
    let [nx, ny, nz] = SHAPE;
    let fortran: Vec<u8> = (0..nx)
        .flat_map(|x| (0..ny).flat_map(move |y| (0..nz).flat_map(move |z| value(x, y, z).to_be_bytes())))
        .collect();
    let nhdr = nrrd("endian: little\nencoding: raw\ndata file: other.raw\nbyte skip: 3\n", b"");
    let packed_nhdr = nrrd("endian: little\nencoding: gzip\ndata file: other.raw.gz\n", b"");
    let raw_ron = b"(shape: [6, 5, 4], type: \"i16\", spacing: [1.5, 2, 2.5], big_endian: true, offset: 7)".to_vec();
    let grey16: Vec<u8> = (0..20_u16).flat_map(|i| (i * 3000).to_be_bytes()).collect();
    let unspaced = |case: Case| Case { spacing: None, ..case };
    let mut cases = vec![
        volume("raw.nrrd", nrrd("endian: little\nencoding: raw\n\n", &little())),
        volume("big.nrrd", nrrd("endian: big\r\nencoding: raw\r\n\r\n", &big())),
        volume("gzip.nrrd", nrrd("endian: big\nencoding: gzip\n\n", &gzip(&big()))),
        volume("ascii.nrrd", nrrd("encoding: ascii\n\n", &text())),
        volume("whole.nrrd.gz", gzip(&nrrd("endian: little\nencoding: raw\n\n", &little()))),
        Case { beside: vec![("other.raw", [b"abc", &little()[..]].concat())], ..volume("detached.nhdr", nhdr) },
        Case { beside: vec![("other.raw.gz", gzip(&little()))], ..volume("packed.nhdr", packed_nhdr) },
        unspaced(volume("c.npy", npy("<i2", false, "(4, 5, 6)", &little()))),
        unspaced(volume("fortran.npy", npy(">i2", true, "(4, 5, 6)", &fortran))),
        unspaced(volume("packed.npy", gzip(&npy("<i2", false, "(4, 5, 6)", &little())))),
        volume("one.nii", nifti(4, b"n+1\0", &little())),
        volume("one.nii.gz", gzip(&nifti(4, b"n+1\0", &little()))),
        volume("two.nii", nifti2(&big())),
        Case { beside: vec![("pair.img", little())], ..volume("pair.hdr", nifti(4, b"ni1\0", b"")) },
        volume("local.mha", metaimage("ElementDataFile = LOCAL\n", &little())),
        volume("big.mha", metaimage("BinaryDataByteOrderMSB = True\nElementDataFile = LOCAL\n", &big())),
        volume("zlib.mha", metaimage("CompressedData = True\nElementDataFile = LOCAL\n", &zlib(&little()))),
        volume("ascii.mha", metaimage("BinaryData = False\nElementDataFile = LOCAL\n", &text())),
        Case {
            beside: vec![("detached.raw", little())],
            ..volume("detached.mhd", metaimage("ElementDataFile = detached.raw\n", b""))
        },
        Case { beside: vec![("s.raw.ron", raw_ron)], ..volume("s.raw", [b"1234567", &big()[..]].concat()) },
        colours("rgb.png", png(6, 5, png::ColorType::Rgb, png::BitDepth::Eight, &rgb)),
        Case {
            shape: vec![5, 4],
            sample_type: SampleType::U16,
            channels: 1,
            samples: (0..20_u16).flat_map(|i| (i * 3000).to_ne_bytes()).collect(),
            ..colours("grey.png", png(5, 4, png::ColorType::Grayscale, png::BitDepth::Sixteen, &grey16))
        },
    ];
    let flat = "NRRD0004\ntype: uchar\ndimension: 3\nencoding: raw\n";
    let interleaved = format!("{flat}sizes: 3 6 5\nkinds: RGB-color domain domain\n\n");
    let planes = format!("{flat}sizes: 6 5 3\nkinds: domain domain RGB-color\n\n");
    cases.push(colours("interleaved.nrrd", [interleaved.as_bytes(), &rgb].concat()));
    cases.push(colours("planar.nrrd", [planes.as_bytes(), &planar].concat()));
    cases.extend(super::more_files::every());
    cases.extend(super::array_files::every());
    cases.extend(super::exr_files::every());
    cases
}
