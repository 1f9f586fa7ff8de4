//! PLY: text and both byte orders give what is written, whatever the types; what is cut is an error.

use super::writers::file;
use super::{message, read_all};
use deepfield::import::{FieldKind, LoadOptions, load, open, summarize};
use proptest::prelude::*;

/// x, y, z, intensity and id of a vertex.
type Vertex = (i16, f64, f32, u8, u32);

/// How a file is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    Text,
    Little,
    Big,
}

/// The bytes of a file with cameras in front of its vertices and a face behind them; and the length of all up to the last vertex.
fn ply(coding: Coding, vertices: &[Vertex]) -> (Vec<u8>, usize) {
    let name = match coding {
        Coding::Text => "ascii",
        Coding::Little => "binary_little_endian",
        Coding::Big => "binary_big_endian",
    };
    let mut bytes = format!(
        "ply\nformat {name} 1.0\ncomment by hand\nelement camera 2\nproperty short angle\nelement vertex {}\nproperty short x\n\
         property double y\nproperty float z\nproperty uchar intensity\nproperty uint id\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n",
        vertices.len()
    )
    .into_bytes();
    if coding == Coding::Text {
        bytes.extend(b"7\n-7\n");
        for (x, y, z, intensity, id) in vertices {
            bytes.extend(format!("{x} {y} {z}  {intensity}\t{id}\r\n").into_bytes());
        }
        let length = bytes.len();
        bytes.extend(b"3 0 0 0\n");
        return (bytes, length);
    }
    let mut put = |mut word: Vec<u8>| {
        if coding == Coding::Big {
            word.reverse();
        }
        bytes.extend(word);
    };
    put(7_i16.to_le_bytes().to_vec());
    put((-7_i16).to_le_bytes().to_vec());
    for (x, y, z, intensity, id) in vertices {
        put(x.to_le_bytes().to_vec());
        put(y.to_le_bytes().to_vec());
        put(z.to_le_bytes().to_vec());
        put(vec![*intensity]);
        put(id.to_le_bytes().to_vec());
    }
    let length = bytes.len();
    bytes.extend([3; 13]);
    (bytes, length)
}

/// A small file.
pub fn sample(coding: Coding) -> Vec<u8> {
    let vertices: Vec<Vertex> =
        (0..40_u8).map(|i| (i16::from(i), f64::from(i % 7), f32::from(i % 5), i, u32::from(i))).collect();
    ply(coding, &vertices).0
}

proptest! {
    #![proptest_config(crate::cases::cases(48))]

    #[test]
    fn what_is_written_comes_back(
        vertices in prop::collection::vec((any::<i16>(), -1e9..1e9f64, -1e3..1e3f32, any::<u8>(), any::<u32>()), 1..9), step in 1..4u64,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let positions: Vec<f64> =
            vertices.iter().flat_map(|(x, y, z, ..)| [f64::from(*x), *y, f64::from(*z)]).collect();
        let intensities: Vec<f64> = vertices.iter().map(|vertex| f64::from(vertex.3)).collect();
        let ids: Vec<u64> = vertices.iter().map(|vertex| u64::from(vertex.4)).collect();
        for coding in [Coding::Text, Coding::Little, Coding::Big] {
            let path = file(folder.path(), "points", &ply(coding, &vertices).0);
            let source = open(&path).unwrap();
            prop_assert_eq!(&source.description().format, "ply");
            prop_assert_eq!(read_all(source.as_ref(), 0, "position", step), &positions[..]);
            prop_assert_eq!(read_all(source.as_ref(), 0, "intensity", step), &intensities[..]);
            let field = source.description().families[0].find(FieldKind::Id).unwrap();
            let mut read = vec![0; ids.len()];
            source.read_ids(0, field, 0..ids.len() as u64, &mut read).unwrap();
            prop_assert_eq!(&read, &ids);
            prop_assert!(source.description().notes.iter().any(|note| note.contains("face")));
        }
    }
}

#[test]
fn a_shortened_file_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    for coding in [Coding::Text, Coding::Little, Coding::Big] {
        let (bytes, vertices) = ply(coding, &[(1, 2.0, 3.0, 4, 5), (6, 7.0, 8.0, 9, 10)]);
        // Of text, a number that is cut may be another number.
        let last = if coding == Coding::Text { vertices - 4 } else { vertices };
        for length in 0..last {
            let path = file(folder.path(), "short", &bytes[..length]);
            message(&summarize(&path).err().unwrap_or_else(|| panic!("{coding:?}, {length} bytes")), &path);
        }
        let path = file(folder.path(), "whole", &bytes[..vertices]);
        assert_eq!(load(&path, &LoadOptions::default(), &()).unwrap().len(), 2);
    }
}

#[test]
fn what_cannot_be_read_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("property list uchar float x\nproperty float y", "one number for each property"),
        ("property half x", "a type such as"),
        ("property float x\nproperty float y", "properties x, y and z"),
        ("property float x\nproperty float y\nproperty float z", "1000000000 vertices"),
    ];
    for (properties, expected) in cases {
        let text =
            format!("ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\n{properties}\nend_header\n");
        let text = if expected.starts_with("properties") { text.replace("1000000000", "1") + "12345678" } else { text };
        let path = file(folder.path(), "wrong", text.as_bytes());
        let found = message(&open(&path).err().unwrap(), &path);
        assert!(found.contains(expected), "{found}");
    }
}

#[test]
fn numbers_of_one_name_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let properties =
        ["x", "y", "z", "a", "a", "mass", "m", "m"].map(|name| format!("property float {name}\n")).concat();
    let text = format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n1 2 3 4 5 6 7 8\n");
    let source = open(&file(folder.path(), "points", text.as_bytes())).unwrap();
    for (name, expected) in [("a", 4.0), ("a-2", 5.0), ("mass", 6.0), ("m", 7.0), ("m-2", 8.0)] {
        assert_eq!(read_all(source.as_ref(), 0, name, 1), [expected], "{name}");
    }
}
