//! What files of grids for other programs begin with: NumPy arrays and NRRD, whose samples follow as they are.

use crate::model::{Grid, SampleType};
use std::fmt::Write as _;

/// The head of a NumPy array in format 1.0, of shape (y, x) or (z, y, x), and of several channels one axis more, the last; its length is a
/// multiple of 64.
pub fn npy_head(grid: &Grid, little_endian: bool) -> Vec<u8> {
    let order = match (grid.sample_type.size(), little_endian) {
        (1, _) => '|',
        (_, true) => '<',
        (_, false) => '>',
    };
    let kind = if grid.sample_type.is_float() { 'f' } else { grid.sample_type.name().chars().next().unwrap_or('u') };
    let channels = (grid.channels.len() > 1).then_some(grid.channels.len() as u64);
    let sides = grid.shape[..grid.dimensions].iter().rev().copied().chain(channels);
    let shape: String = sides.map(|side| format!("{side}, ")).collect();
    let size = grid.sample_type.size();
    let text = format!("{{'descr': '{order}{kind}{size}', 'fortran_order': False, 'shape': ({}), }}", shape.trim_end());
    let len = (10 + text.len() + 1).next_multiple_of(64) - 10;
    let mut head = b"\x93NUMPY\x01\x00".to_vec();
    head.extend_from_slice(&(len as u16).to_le_bytes());
    head.extend_from_slice(text.as_bytes());
    head.resize(10 + len - 1, b' ');
    head.push(b'\n');
    head
}

/// The head of an uncompressed NRRD, with axes and units.
pub fn nrrd_head(grid: &Grid, little_endian: bool) -> String {
    let kind = match grid.sample_type {
        SampleType::F32 => "float",
        SampleType::F64 => "double",
        whole => whole.name(),
    };
    let several = grid.channels.len() > 1;
    let mut sizes: Vec<u64> = grid.shape[..grid.dimensions].to_vec();
    if several {
        sizes.insert(0, grid.channels.len() as u64);
    }
    let sizes: Vec<String> = sizes.iter().map(u64::to_string).collect();
    let vector = |column: glam::DVec3| -> String {
        let parts: Vec<String> = column.to_array()[..grid.dimensions].iter().map(|part| format!("{part:?}")).collect();
        format!("({})", parts.join(","))
    };
    let mut directions: Vec<String> =
        (0..grid.dimensions).map(|axis| vector(grid.to_world.matrix3.col(axis))).collect();
    let mut kinds = vec!["domain"; grid.dimensions];
    if several {
        directions.insert(0, "none".into());
        kinds.insert(0, "vector");
    }
    let mut text = String::from("NRRD0004\n");
    // Writing to a string cannot fail.
    let _ = writeln!(text, "type: {kind}\ndimension: {}\nsizes: {}", sizes.len(), sizes.join(" "));
    let _ = writeln!(text, "space dimension: {}\nspace directions: {}", grid.dimensions, directions.join(" "));
    let _ = writeln!(text, "space origin: {}\nkinds: {}", vector(grid.to_world.translation), kinds.join(" "));
    if !grid.length_unit.is_unknown() {
        let unit = format!("\"{}\"", grid.length_unit.to_string().replace('"', "'"));
        let _ = writeln!(text, "space units: {}", vec![unit; grid.dimensions].join(" "));
    }
    if grid.sample_type.size() > 1 {
        let _ = writeln!(text, "endian: {}", if little_endian { "little" } else { "big" });
    }
    text + "encoding: raw\n\n"
}
