//! What Rust and the surface's shaders both need, written as a shader module: one source, and constants that a shader's compiler sees.

use crate::cpu::surface::coverage::{MIDDLE, MOST_SAMPLES};
use crate::cpu::surface::look::{EDGE, MINOR};
use crate::cpu::surface::photo::{MOST_TEXELS, nothing};
use crate::cpu::surface::raster::{BEFORE_POINTS, BEFORE_POLES, BEFORE_SEAM, BEHIND};
use crate::cpu::surface::resolve::PLANE_STEPS;
use crate::cpu::surface::rims;
use crate::cpu::surface::shade::{BESIDE, ENDS, FINER, HATCH, MOST_LONGER, REACH, RIM, SECANTS, WALL};
use crate::heights::hierarchy::chunks::lattice::SIDE_BITS;
use crate::heights::hierarchy::photo;

/// Path of the module among the shaders.
pub const PATH: &str = "lib/surface_constants.wgsl";

/// Cells along a chunk's side.
pub const CHUNK: u32 = 1 << SIDE_BITS;
/// Heights from here on were not measured.
pub const UNMEASURED: f32 = 3e38;
/// Bits of a part of one of the picture's samples.
const FRACTION: u32 = 8;
/// Cells, or samples of the picture, along the side of what a workgroup draws.
pub const TILE: u32 = 16;
/// Triangles that are at most so many samples wide and high are drawn by one invocation, others by workgroups.
pub const SMALL: u32 = 16;
/// Workgroups among which the rows of a large triangle are dealt out.
const SLICES: u32 = 8;
/// Workgroups that draw large triangles.
pub const SCANNERS: u32 = 1024;
/// Words of a large triangle: its number, where its corners are listed, and their places.
pub const ENTRY: u32 = 8;
/// Words of a triangle whose corners are listed: its number, and row, column and height of each.
pub const FAN: u32 = 10;
/// Words of a row of a globe: how much further from the axis than the anchor a place of it at the reference height is, how far that is, the
/// cosine of its latitude, how far it is to the north of the anchor, and the sine of its latitude.
pub const ROW_WORDS: u32 = 5;
/// Words of a column of a globe: the sine of the angle from the anchor, and what its cosine is less than 1.
pub const COLUMN_WORDS: u32 = 2;
/// Nothing.
pub const NONE: u32 = u32::MAX;
/// A branch of the tree of chunks that is a chunk: its number follows from here.
pub const LEAF: u32 = 1 << 31;
/// A flag of a chunk: drawn as points.
pub const POINTS: u32 = 1;
/// A flag of a chunk: has samples that are not whole.
pub const MIXED: u32 = 2;
/// The first bit of four flags of a chunk: a side that lies on a coarser chunk's.
pub const LAID: u32 = 2;
/// The first bit of four flags of a chunk: a side whose cells' triangles are listed.
pub const FANNED: u32 = 6;
/// The first bit of six flags of a chunk: the side of the square about a sample in which its margin is, samples of the picture; 0 where there are
/// no margins.
pub const MARGIN: u32 = 10;
/// A flag of a chunk: rays find its triangles.
pub const CAST: u32 = 1 << 16;
/// Cells, or samples, along the side of a square of what only parts of a chunk have.
pub const SQUARE: u32 = rims::SQUARE as u32;
/// Invocations of a workgroup.
pub const GROUP: u32 = 256;

/// Texels along the side of a photo's tile.
const PHOTO_TILE: u32 = photo::TILE as u32;

/// What a surface is coloured by.
pub const BY_HEIGHT: u32 = 0;
/// By how steep it is.
pub const BY_SLOPE: u32 = 1;
/// By the way down.
pub const BY_ASPECT: u32 = 2;
/// By how it is curved.
pub const BY_CURVATURE: u32 = 3;
/// By the level that is drawn.
pub const BY_LEVEL: u32 = 4;
/// By what it is drawn as.
pub const BY_PRIMITIVE: u32 = 5;
/// By what a form leaves.
pub const BY_RESIDUAL: u32 = 6;
/// By how much higher it is than an earlier field.
pub const BY_DIFFERENCE: u32 = 7;
/// By a plane's values.
pub const BY_PLANE: u32 = 8;
/// As three planes have it.
pub const BY_TEXTURE: u32 = 9;
/// As the photo that lies over it has it.
pub const BY_PHOTO: u32 = 10;

/// The module `deepfield::surface_constants`.
pub fn wgsl() -> String {
    let numbers = [
        ("CHUNK", CHUNK),
        ("FRACTION", FRACTION),
        ("TILE", TILE),
        ("SMALL", SMALL),
        ("SLICES", SLICES),
        ("SCANNERS", SCANNERS),
        ("ENTRY", ENTRY),
        ("FAN", FAN),
        ("ROW_WORDS", ROW_WORDS),
        ("COLUMN_WORDS", COLUMN_WORDS),
        ("NONE", NONE),
        ("LEAF", LEAF),
        ("POINTS", POINTS),
        ("MIXED", MIXED),
        ("LAID", LAID),
        ("FANNED", FANNED),
        ("MARGIN", MARGIN),
        ("CAST", CAST),
        ("SECANTS", SECANTS),
        ("ENDS", ENDS),
        ("BEFORE_POINTS", BEFORE_POINTS),
        ("BEFORE_POLES", BEFORE_POLES),
        ("BEFORE_SEAM", BEFORE_SEAM),
        ("BY_HEIGHT", BY_HEIGHT),
        ("BY_SLOPE", BY_SLOPE),
        ("BY_ASPECT", BY_ASPECT),
        ("BY_CURVATURE", BY_CURVATURE),
        ("BY_LEVEL", BY_LEVEL),
        ("BY_PRIMITIVE", BY_PRIMITIVE),
        ("BY_RESIDUAL", BY_RESIDUAL),
        ("BY_DIFFERENCE", BY_DIFFERENCE),
        ("BY_PLANE", BY_PLANE),
        ("BY_TEXTURE", BY_TEXTURE),
        ("BY_PHOTO", BY_PHOTO),
        ("PHOTO_TILE", PHOTO_TILE),
        ("SQUARE", SQUARE),
        ("PLANE_STEPS", PLANE_STEPS),
    ];
    let shares = [
        ("UNMEASURED", f64::from(UNMEASURED)),
        ("FARTHER", BEHIND),
        ("MIDDLE", MIDDLE),
        ("MOST_SAMPLES", MOST_SAMPLES),
        ("FINER", FINER),
        ("REACH", REACH),
        ("MINOR", MINOR),
        ("EDGE", EDGE),
        ("MOST_TEXELS", MOST_TEXELS),
        ("MOST_LONGER", MOST_LONGER),
        ("HATCH", HATCH),
        ("RIM_CELLS", rims::MOST),
        ("RIM_AROUND", rims::AROUND),
        ("RIM_CROWDED", rims::CROWDED[0]),
        ("RIM_ALL", rims::CROWDED[1]),
        ("RIM_EDGE", rims::EDGE),
    ];
    let mut text = String::from("#define_import_path deepfield::surface_constants\n");
    for (name, number) in numbers {
        text += &format!("const {name}: u32 = {number}u;\n");
    }
    for (name, share) in shares {
        text += &format!("const {name}: f32 = {share:e};\n");
    }
    let colors = [("BESIDE", BESIDE), ("NO_PHOTO", nothing()), ("RIM", RIM), ("WALL", WALL)];
    for (name, [red, green, blue]) in colors {
        text += &format!("const {name}: vec3<f32> = vec3({red:e}, {green:e}, {blue:e});\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chunk_is_whole_tiles() {
        assert!(CHUNK.is_multiple_of(TILE) && TILE * TILE == GROUP);
    }
}
