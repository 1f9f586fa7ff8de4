//! VTK's points: legacy files and XML in every coding give the same.

use super::writers::file;
use super::{message, read_all};
use deepfield::import::{FieldKind, LoadOptions, files_of, load, open, summarize};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use proptest::prelude::*;
use std::io::Write;

/// Position, velocity, mass and id of a point.
type Point = ([f64; 3], [f32; 3], f32, u32);

/// How a file is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    LegacyText,
    LegacyBinary,
    XmlText,
    XmlBase64,
    XmlRaw { wide: bool, big: bool },
    XmlZlib { inline: bool },
}

const CODINGS: [Coding; 9] = [
    Coding::LegacyText,
    Coding::LegacyBinary,
    Coding::XmlText,
    Coding::XmlBase64,
    Coding::XmlRaw { wide: false, big: false },
    Coding::XmlRaw { wide: true, big: false },
    Coding::XmlRaw { wide: true, big: true },
    Coding::XmlZlib { inline: true },
    Coding::XmlZlib { inline: false },
];

fn words(text: impl Iterator<Item = String>) -> String {
    text.collect::<Vec<_>>().join(" ")
}

/// The four arrays: as text, and as bytes, the most significant of a number first where they are to be.
fn arrays(points: &[Point], big: bool) -> [(String, Vec<u8>); 4] {
    let turned = |mut word: Vec<u8>| {
        if big {
            word.reverse();
        }
        word
    };
    let places = points.iter().flat_map(|point| point.0);
    let velocities = points.iter().flat_map(|point| point.1);
    [
        (words(places.clone().map(|x| x.to_string())), places.flat_map(|x| turned(x.to_le_bytes().to_vec())).collect()),
        (
            words(velocities.clone().map(|v| v.to_string())),
            velocities.flat_map(|v| turned(v.to_le_bytes().to_vec())).collect(),
        ),
        (
            words(points.iter().map(|point| point.2.to_string())),
            points.iter().flat_map(|point| turned(point.2.to_le_bytes().to_vec())).collect(),
        ),
        (
            words(points.iter().map(|point| point.3.to_string())),
            points.iter().flat_map(|point| turned(point.3.to_le_bytes().to_vec())).collect(),
        ),
    ]
}

fn legacy(points: &[Point], is_text: bool) -> Vec<u8> {
    let count = points.len();
    let coding = if is_text { "ASCII" } else { "BINARY" };
    let arrays = arrays(points, true);
    let mut bytes = format!("# vtk DataFile Version 3.0\n\n{coding}\nDATASET POLYDATA\n").into_bytes();
    let mut put = |head: String, (text, raw): &(String, Vec<u8>)| {
        bytes.extend(head.into_bytes());
        bytes.extend(if is_text { text.as_bytes() } else { raw });
        bytes.push(b'\n');
    };
    let cell = |raw: Vec<u8>| ("1 0".to_owned(), raw);
    put(format!("POINTS {count} double\n"), &arrays[0]);
    put("VERTICES 1 2\n".into(), &cell([0, 0, 0, 1, 0, 0, 0, 0].to_vec()));
    put("CELL_DATA 1\nSCALARS of_cells short 2\nLOOKUP_TABLE default\n".into(), &cell(vec![0, 1, 0, 0]));
    put(format!("POINT_DATA {count}\nVECTORS Velocity float\n"), &arrays[1]);
    put("METADATA\nINFORMATION 0\n\nSCALARS mass float\nLOOKUP_TABLE default\n".into(), &arrays[2]);
    let whole = if is_text { "unsigned_int" } else { "vtktypeuint32" };
    put(format!("FIELD FieldData 1\nid 1 {count} {whole}\n"), &arrays[3]);
    bytes
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let quartet = |three: &[u8]| {
        let at = |index: usize| u32::from(three.get(index).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        let letter = |place: usize| match place > three.len() {
            true => '=',
            false => char::from(LETTERS[(bits >> (18 - 6 * place) & 63) as usize]),
        };
        [0, 1, 2, 3].map(letter)
    };
    bytes.chunks(3).flat_map(quartet).collect()
}

fn xml(pieces: &[&[Point]], coding: Coding) -> Vec<u8> {
    let (wide, big) = match coding {
        Coding::XmlRaw { wide, big } => (wide, big),
        _ => (false, false),
    };
    let number = |value: usize| match (wide, big) {
        (true, true) => (value as u64).to_be_bytes().to_vec(),
        (true, false) => (value as u64).to_le_bytes().to_vec(),
        (false, _) => (value as u32).to_le_bytes().to_vec(),
    };
    let mut appended: Vec<u8> = b"_".to_vec();
    let mut data = |(text, raw): &(String, Vec<u8>)| match coding {
        Coding::XmlText => format!("format=\"ascii\">{text}</DataArray>"),
        Coding::XmlBase64 => {
            format!("format=\"binary\">{}</DataArray>", base64(&[number(raw.len()), raw.clone()].concat()))
        }
        Coding::XmlZlib { inline } => {
            // Blocks of 16 bytes, the last of which may be shorter.
            let blocks: Vec<Vec<u8>> = raw
                .chunks(16)
                .map(|block| {
                    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
                    encoder.write_all(block).unwrap();
                    encoder.finish().unwrap()
                })
                .collect();
            let head = [blocks.len(), 16, raw.len() % 16].into_iter().chain(blocks.iter().map(Vec::len));
            let head: Vec<u8> = head.flat_map(number).collect();
            let coded = base64(&head) + &base64(&blocks.concat());
            if inline {
                return format!("format=\"binary\">\n{coded}\n</DataArray>");
            }
            let at = appended.len() - 1;
            appended.extend(coded.into_bytes());
            format!("format=\"appended\" offset=\"{at}\"/>")
        }
        _ => {
            let at = appended.len() - 1;
            appended.extend([number(raw.len()), raw.clone()].concat());
            format!("format=\"appended\" offset=\"{at}\"/>")
        }
    };
    let mut piece = |points: &[Point]| {
        let [position, velocity, mass, id] = arrays(points, big);
        let (position, velocity, mass, id) = (data(&position), data(&velocity), data(&mass), data(&id));
        format!(
            "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"0\">\n<PointData>\n\
         <DataArray type=\"Float32\" Name=\"Velocity\" NumberOfComponents=\"3\" {velocity}\n\
         <DataArray type=\"Float32\" Name=\"mass\" {mass}\n<DataArray type=\"UInt32\" Name=\"id\" {id}\n</PointData>\n<CellData/>\n\
         <Points>\n<DataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\" {position}\n</Points>\n\
         <Cells>\n<DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\"></DataArray>\n</Cells>\n</Piece>\n",
            points.len()
        )
    };
    let pieces: String = pieces.iter().map(|points| piece(points)).collect();
    let head = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile header_type=\"{}\" type=\"UnstructuredGrid\" byte_order=\"{}\"{}>\n<UnstructuredGrid>\n\
         {pieces}</UnstructuredGrid>\n",
        if wide { "UInt64" } else { "UInt32" },
        if big { "BigEndian" } else { "LittleEndian" },
        if matches!(coding, Coding::XmlZlib { .. }) { " compressor=\"vtkZLibDataCompressor\"" } else { "" }
    );
    let encoding = if matches!(coding, Coding::XmlRaw { .. }) { "raw" } else { "base64" };
    let tail = format!("<AppendedData encoding=\"{encoding}\">\n").into_bytes();
    [head.into_bytes(), tail, appended, b"\n</AppendedData>\n</VTKFile>\n".to_vec()].concat()
}

fn vtk(points: &[Point], coding: Coding) -> Vec<u8> {
    match coding {
        Coding::LegacyText => legacy(points, true),
        Coding::LegacyBinary => legacy(points, false),
        _ => xml(&[points], coding),
    }
}

/// A small file.
pub fn sample(coding: Coding) -> Vec<u8> {
    let point =
        |i: u8| ([f64::from(i), f64::from(i % 7), f64::from(i % 5)], [1.0, f32::from(i), 0.0], 2.0, u32::from(i));
    vtk(&(0..40).map(point).collect::<Vec<_>>(), coding)
}

proptest! {
    #![proptest_config(crate::cases::cases(32))]

    #[test]
    fn what_is_written_comes_back(
        points in prop::collection::vec(
            (prop::array::uniform3(-1e9..1e9f64), prop::array::uniform3(-1e3..1e3f32), 0.1..9f32, any::<u32>()),
            1..9,
        ),
        step in 1..4u64,
    ) {
        let folder = tempfile::tempdir().unwrap();
        for coding in CODINGS {
            let path = file(folder.path(), "points", &vtk(&points, coding));
            let source = open(&path).unwrap_or_else(|error| panic!("{coding:?}: {error}"));
            prop_assert_eq!(&source.description().format, "vtk-points");
            let read = |name: &str| read_all(source.as_ref(), 0, name, step);
            prop_assert_eq!(read("position"), points.iter().flat_map(|point| point.0).collect::<Vec<_>>());
            prop_assert_eq!(read("velocity"), points.iter().flat_map(|point| point.1.map(f64::from)).collect::<Vec<_>>());
            prop_assert_eq!(read("mass"), points.iter().map(|point| f64::from(point.2)).collect::<Vec<_>>());
            let info = &source.description().families[0];
            prop_assert_eq!(info.fields.len(), 4, "{:?}", info.fields);
            let mut ids = vec![0; points.len()];
            source.read_ids(0, info.find(FieldKind::Id).unwrap(), 0..points.len() as u64, &mut ids).unwrap();
            prop_assert_eq!(ids, points.iter().map(|point| u64::from(point.3)).collect::<Vec<_>>());
        }
    }
}

/// Points by their numbers.
fn numbered(numbers: std::ops::Range<u8>) -> Vec<Point> {
    numbers
        .map(|i| ([f64::from(i), 0.5, 2.0], [1.0, f32::from(i), 0.0], 1.0 + f32::from(i), u32::from(i) + 7))
        .collect()
}

/// A file that names others with the pieces.
fn parallel(sources: &[&str]) -> Vec<u8> {
    let pieces: String = sources.iter().map(|source| format!("<Piece Source=\"{source}\"/>\n")).collect();
    format!("<VTKFile type=\"PUnstructuredGrid\">\n<PUnstructuredGrid>\n{pieces}</PUnstructuredGrid>\n</VTKFile>\n")
        .into_bytes()
}

#[test]
fn pieces_are_read_one_behind_the_other_in_a_file_and_in_those_that_it_names() {
    let folder = tempfile::tempdir().unwrap();
    let all = numbered(0..9);
    for coding in CODINGS.into_iter().filter(|coding| !matches!(coding, Coding::LegacyText | Coding::LegacyBinary)) {
        let pieces = xml(&[&all[..4], &[], &all[4..5], &all[5..]], coding);
        let one = file(folder.path(), "pieces.vtu", &pieces);
        // The second is in another coding, byte order and size of headers.
        let first = xml(&[&all[..4]], coding);
        file(folder.path(), "a & b.vtu", &first);
        file(folder.path(), "second.vtu", &xml(&[&[], &all[4..]], Coding::XmlRaw { wide: true, big: true }));
        let several = file(folder.path(), "points.pvtu", &parallel(&["a &amp; b.vtu", "./second.vtu"]));
        for (path, files) in [(&one, 1), (&several, 3)] {
            let source = open(path).unwrap_or_else(|error| panic!("{coding:?}: {error}"));
            assert_eq!((source.description().files, source.description().particles()), (files, 9));
            for step in [1, 2, 9] {
                let masses: Vec<f64> = (1..10).map(f64::from).collect();
                assert_eq!(read_all(source.as_ref(), 0, "mass", step), masses, "{coding:?}");
                let position: Vec<f64> = all.iter().flat_map(|point| point.0).collect();
                assert_eq!(read_all(source.as_ref(), 0, "position", step), position, "{coding:?}");
            }
            let mut ids = vec![0; 9];
            let id = source.description().families[0].find(FieldKind::Id).unwrap();
            source.read_ids(0, id, 0..9, &mut ids).unwrap();
            assert_eq!(ids, (7..16).collect::<Vec<u64>>());
        }
        assert_eq!(files_of(&several).unwrap().len(), 3);
        // In a folder they are one source.
        let case = folder.path().join("case");
        std::fs::create_dir_all(&case).unwrap();
        file(&case, "case_0.vtu", &first);
        file(&case, "case_1.vtu", &xml(&[&all[4..]], coding));
        file(&case, "case.pvtu", &parallel(&["case_0.vtu", "case_1.vtu"]));
        assert_eq!(open(&case).unwrap().description().particles(), 9);
        // Also where one process wrote all.
        let alone = folder.path().join("alone");
        std::fs::create_dir_all(&alone).unwrap();
        file(&alone, "alone_0.vtu", &pieces);
        file(&alone, "alone.pvtu", &parallel(&["alone_0.vtu"]));
        assert_eq!(open(&alone).unwrap().description().particles(), 9);
        // None of the pieces that a cut file lacks is missing in silence.
        for length in (0..pieces.len()).step_by(5) {
            let path = file(folder.path(), "cut", &pieces[..length]);
            match summarize(&path) {
                Ok(summary) => assert_eq!(summary.particles, 9, "{coding:?}, {length} bytes"),
                Err(error) => drop(message(&error, &path)),
            }
        }
    }
}

#[test]
fn pieces_that_do_not_belong_together_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let coding = Coding::XmlText;
    let points = numbered(0..3);
    let file = |name: &str, bytes: &[u8]| file(folder.path(), name, bytes);
    file("a.vtu", &xml(&[&points], coding));
    file("b.vtu", String::from_utf8_lossy(&xml(&[&points], coding)).replace("\"mass\"", "\"m\"").as_bytes());
    file("c.vti", b"<VTKFile type=\"ImageData\"></VTKFile>");
    let whole = parallel(&["a.vtu"]);
    for (sources, expected) in [
        (&["a.vtu", "b.vtu"][..], "points.pvtu: arrays of piece 2 with points: found"),
        (&["a.vtu", "./a.vtu"][..], "points.pvtu: Source: found ./a.vtu, expected each file once"),
        (&["points.pvtu"][..], "points.pvtu: Source: found points.pvtu, expected a file with"),
        (&["c.vti"][..], "points.pvtu: Source: found c.vti, expected a file with"),
        (&["nothing.vtu"][..], "points.pvtu: Source: found nothing.vtu ("),
        (&["."][..], "points.pvtu: Source: found . (no file), expected"),
        (&[] as &[&str], "points.pvtu"),
    ] {
        let path = file("points.pvtu", &parallel(sources));
        let text = message(&open(&path).err().unwrap(), &path);
        assert!(text.contains(expected), "{text}");
    }
    for length in 0..whole.len() {
        let path = file("points.pvtu", &whole[..length]);
        match open(&path) {
            Ok(source) => assert_eq!(source.description().particles(), 3, "{length} bytes"),
            Err(error) => drop(message(&error, &path)),
        }
    }
}

#[test]
fn a_shortened_file_is_an_error_or_has_fewer_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let points = [([1.0, 2.0, 3.0], [0.5; 3], 1.0, 7), ([4.0, 5.0, 6.0], [0.25; 3], 1.0, 8)];
    for coding in CODINGS {
        let bytes = vtk(&points, coding);
        let mut read = 0;
        for length in (0..bytes.len()).step_by(3) {
            let path = file(folder.path(), "short", &bytes[..length]);
            match summarize(&path) {
                Ok(summary) => {
                    assert_eq!(summary.particles, 2, "{coding:?}, {length} bytes");
                    read += 1;
                }
                Err(error) => drop(message(&error, &path)),
            }
        }
        assert!(read < bytes.len() / 6, "{coding:?}: {read} of {} lengths are read", bytes.len() / 3);
        let path = file(folder.path(), "whole", &bytes);
        assert_eq!(load(&path, &LoadOptions::default(), &()).unwrap().len(), 2);
    }
}

#[test]
fn arrays_that_cannot_be_in_the_file_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    for coding in CODINGS {
        let text = String::from_utf8_lossy(&sample(coding)).replace("\"40\"", "\"4000000000000\"");
        let text = text.replace("POINTS 40", "POINTS 4000000000000").replace("DATA 40", "DATA 4000000000000");
        let path = file(folder.path(), "huge", text.as_bytes());
        message(&open(&path).err().unwrap_or_else(|| panic!("{coding:?}")), &path);
    }
}
