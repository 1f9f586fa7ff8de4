//! Small files of VTK, FITS, TIFF and ZIP, made here byte by byte.

use super::files::{Case, big, little, native, text, value, values, volume, zlib};
use crate::model::SampleType;
use std::fmt::Write as _;
use std::io::Write as _;

const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

fn base64(bytes: &[u8]) -> Vec<u8> {
    let mut coded = Vec::new();
    for part in bytes.chunks(3) {
        let bits = part.iter().fold(0_u32, |bits, &byte| bits << 8 | u32::from(byte)) << (8 * (3 - part.len()));
        let letters = (0..4).map(|at| LETTERS[(bits >> (18 - 6 * at) & 63) as usize]);
        coded.extend(letters.take(part.len() + 1).chain(std::iter::repeat_n(b'=', 3 - part.len())));
    }
    coded
}

pub fn vtk(coding: &str, data: &str, body: &[u8]) -> Vec<u8> {
    let head = format!(
        "# vtk DataFile Version 3.0\n\n{coding}\nDATASET STRUCTURED_POINTS\nORIGIN 1 2 3\nSPACING 1.5 2 2.5\n{data}\n"
    );
    [head.as_bytes(), body].concat()
}

/// An XML file; `array` are attributes of its array, `inline` what is in it, `appended` what comes behind.
pub fn vti(more: &str, array: &str, inline: &[u8], appended: &[u8]) -> Vec<u8> {
    let head = format!(
        "<?xml version=\"1.0\"?>\n<!-- <DataArray> -->\n<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"{more}>\n\
        <ImageData WholeExtent=\"0 5 1 5 0 3\" Origin=\"1 0 3\" Spacing=\"1.5 2 2.5\"><Piece Extent=\"0 5 1 5 0 3\">\
        <PointData Scalars=\"v\"><DataArray type=\"Int16\" Name=\"v\" {array}>"
    );
    let tail = b"</DataArray></PointData></Piece></ImageData>\n";
    [head.as_bytes(), inline, tail, appended, b"\n</VTKFile>\n"].concat()
}

/// The samples with their size in front.
fn sized() -> Vec<u8> {
    [&240_u32.to_le_bytes()[..], &little()].concat()
}

/// The same in blocks of 100 bytes.
fn blocks() -> [Vec<u8>; 2] {
    let packed: Vec<Vec<u8>> = little().chunks(100).map(zlib).collect();
    let sizes = [3_u32, 100, 40].into_iter().chain(packed.iter().map(|block| block.len() as u32));
    [sizes.flat_map(u32::to_le_bytes).collect(), packed.concat()]
}

pub fn fits(first: &str, body: &[u8]) -> Vec<u8> {
    let mut text = String::new();
    for card in first.lines().chain(["END"]) {
        write!(text, "{card:<80}").unwrap();
    }
    let mut bytes = text.into_bytes();
    bytes.resize(bytes.len().next_multiple_of(2880), b' ');
    bytes.extend_from_slice(body);
    bytes.resize(bytes.len().next_multiple_of(2880), 0);
    bytes
}

/// Pages of 6 x `heights` samples of 16 bits in big endian, each in strips of two rows.
pub fn tiff(heights: &[u32], samples: &[u8]) -> Vec<u8> {
    described_tiff("", heights, samples)
}

/// The same with a description in the first page, unless it is empty.
pub fn described_tiff(description: &str, heights: &[u32], samples: &[u8]) -> Vec<u8> {
    let mut bytes = b"MM\0*\0\0\0\0".to_vec();
    let (mut link, mut from) = (4, 0);
    for &height in heights {
        let strips: Vec<&[u8]> = samples[from..from + 12 * height as usize].chunks(24).collect();
        from += 12 * height as usize;
        let mut places: Vec<u32> = Vec::new();
        for strip in &strips {
            places.push(bytes.len() as u32);
            bytes.extend_from_slice(strip);
        }
        let lists = [places, strips.iter().map(|strip| strip.len() as u32).collect()].map(|list| {
            let at = bytes.len() as u32;
            bytes.extend(list.iter().flat_map(|number| number.to_be_bytes()));
            (at, list)
        });
        let text = bytes.len() as u32;
        let is_described = link == 4 && !description.is_empty();
        if is_described {
            bytes.extend_from_slice(description.as_bytes());
            bytes.push(0);
        }
        let at = bytes.len() as u32;
        bytes[link..link + 4].copy_from_slice(&at.to_be_bytes());
        let [places, sizes] = lists.map(|(at, list)| if list.len() == 1 { list[0] } else { at });
        let count = strips.len() as u32;
        let tags: [(u16, u32, u32); 10] = [
            (256, 1, 6),
            (257, 1, height),
            (258, 1, 16),
            (259, 1, 1),
            (262, 1, 1),
            (270, description.len() as u32 + 1, text),
            (273, count, places),
            (278, 1, 2),
            (279, count, sizes),
            (339, 1, 2),
        ];
        let tags: Vec<_> = tags.into_iter().filter(|(tag, ..)| *tag != 270 || is_described).collect();
        bytes.extend_from_slice(&(tags.len() as u16).to_be_bytes());
        for (tag, count, number) in tags {
            bytes.extend_from_slice(&tag.to_be_bytes());
            let is_short = matches!(tag, 258 | 259 | 262 | 339);
            let kind = if tag == 270 {
                2_u16
            } else if is_short {
                3
            } else {
                4
            };
            bytes.extend_from_slice(&kind.to_be_bytes());
            bytes.extend_from_slice(&count.to_be_bytes());
            bytes.extend_from_slice(&(if is_short { number << 16 } else { number }).to_be_bytes());
        }
        link = bytes.len();
        bytes.extend_from_slice(&[0; 4]);
    }
    bytes
}

fn npz(name: &str, array: &[u8]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
    archive.write_all(array).unwrap();
    archive.finish().unwrap().into_inner()
}

/// A file of each.
pub fn every() -> Vec<Case> {
    let points = "DIMENSIONS 6 5 4\nPOINT_DATA 120\nSCALARS v short 1\nLOOKUP_TABLE default";
    let cells = "DIMENSIONS 7 6 5\nCELL_DATA 120\nFIELD FieldData 1\nv 1 120 short";
    let [sizes, packed] = blocks();
    let zlib = " compressor=\"vtkZLibDataCompressor\"";
    let appended =
        |coding: &str, body: &[u8]| [format!("<AppendedData encoding=\"{coding}\">_xyz").as_bytes(), body].concat();
    let at = "format=\"appended\" offset=\"3\"";
    let coded = [base64(&sizes), base64(&packed)].concat();
    let cube = "SIMPLE  =                    T\nBITPIX  =                   16\nNAXIS   =                    3\n\
        NAXIS1  =                    6 / a comment\nNAXIS2  =                    5\nNAXIS3  =                    4";
    let extension = format!("XTENSION= 'IMAGE   '\n{}", cube.split_once('\n').unwrap().1);
    let empty = "SIMPLE  =                    T\nBITPIX  =                    8\nNAXIS   =                    0";
    let wide = cube.replace("                  16\n", "                  64\n") + "\nBZERO   =  9223372036854775808";
    let unsigned: Vec<u64> =
        values().into_iter().map(|value| (7_u64 << 60) + u64::from(value.unsigned_abs())).collect();
    let lowered: Vec<u8> = unsigned.iter().flat_map(|value| (*value ^ (1_u64 << 63)).to_be_bytes()).collect();
    let unspaced = |case: Case| Case { spacing: None, ..case };
    vec![
        volume("points.vtk", vtk("BINARY", points, &big())),
        volume("cells.vtk", vtk("BINARY", cells, &big())),
        volume("ascii.vtk", vtk("ASCII", points, &text())),
        volume("ascii.vti", vti("", "format=\"ascii\"", &text(), b"")),
        volume("base64.vti", vti("", "format=\"binary\"", &base64(&sized()), b"")),
        volume("zlib.vti", vti(zlib, "format=\"binary\"", &coded, b"")),
        volume("raw.vti", vti("", at, b"", &appended("raw", &sized()))),
        volume("rawzlib.vti", vti(zlib, at, b"", &appended("raw", &[sizes, packed].concat()))),
        unspaced(volume("cube.fits", fits(cube, &big()))),
        unspaced(volume("second.fits", [fits(empty, b""), fits(&extension, &big())].concat())),
        unspaced(Case {
            sample_type: SampleType::U64,
            samples: unsigned.into_iter().flat_map(u64::to_ne_bytes).collect(),
            ..volume("unsigned.fits", fits(&wide, &lowered))
        }),
        unspaced(volume("stack.tif", tiff(&[5; 4], &big()))),
        Case {
            shape: vec![6, 5],
            sample_type: SampleType::I16,
            samples: native()[..60].to_vec(),
            ..unspaced(volume("one.tif", tiff(&[5], &big())))
        },
        unspaced(volume("a.npz", npz("a.npy", &super::files::npy("<i2", false, "(4, 5, 6)", &little())))),
    ]
}

#[test]
fn values_are_what_they_are_taken_for() {
    assert_eq!(base64(b"hello"), b"aGVsbG8=");
    assert_eq!(native()[..2], value(0, 0, 0).to_ne_bytes());
}
