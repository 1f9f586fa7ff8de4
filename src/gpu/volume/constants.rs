//! What Rust and the volume shaders both need, written as a shader module: one source, and constants that a shader's
//! compiler sees.

use crate::cpu::volume::bricks::BORDER;
use crate::cpu::volume::classify::{BRIGHTNESSES, HIDDEN_BITS, HUES};
use crate::cpu::volume::range;
use crate::cpu::volume::raycast::SURFACE_BRIGHTNESS;

/// Path of the module among the shaders.
pub const PATH: &str = "lib/volume_constants.wgsl";

/// Cells along a brick's side, as a power of two; and slices of a layer.
const BRICK_SHIFT: u32 = 3;
/// Cells along a brick's side.
pub const BRICK: u32 = 1 << BRICK_SHIFT;
/// Cells of a brick.
pub const CELLS: u32 = BRICK * BRICK * BRICK;
/// Words before the list of bricks.
pub const HEADER: u32 = 4;
/// Particles that a brick gathers in one turn: a software driver ends an invocation's loops after 65535 rounds.
pub const TURN: u32 = 1 << 15;
/// Most levels of bins: the last one's bins are 2^13 bricks wide.
pub const MOST_LEVELS: usize = 14;
/// Particles of a workgroup that bins them.
pub const BIN_GROUP: u32 = 256;
/// Bins of a workgroup that sums them.
pub const SCAN_GROUP: u32 = 1024;
/// Pairs of a workgroup that sorts them.
pub const SORT_BLOCK: u32 = 1024;
/// Bits that pairs are sorted by at a time.
pub const DIGIT_BITS: u32 = 4;
/// Different digits.
pub const DIGITS: u32 = 1 << DIGIT_BITS;

/// The module `deepfield::volume_constants`.
pub fn wgsl() -> String {
    let numbers = [
        ("BRICK_SHIFT", BRICK_SHIFT),
        ("BRICK", BRICK),
        ("CELLS", CELLS),
        ("BORDER", BORDER as u32),
        ("HEADER", HEADER),
        ("TURN", TURN),
        ("BIN_GROUP", BIN_GROUP),
        ("SORT_BLOCK", SORT_BLOCK),
        ("DIGIT_BITS", DIGIT_BITS),
        ("DIGITS", DIGITS),
        ("HIDDEN_BITS", HIDDEN_BITS),
        ("HUES", HUES as u32),
        ("BRIGHTNESSES", BRIGHTNESSES as u32),
        ("RANGE_CLASSES", range::CLASSES as u32),
        ("RANGE_HIDDEN_BITS", range::HIDDEN_BITS),
    ];
    let mut text = String::from("#define_import_path deepfield::volume_constants\n");
    for (name, number) in numbers {
        text += &format!("const {name}: u32 = {number}u;\n");
    }
    text + &format!("const SURFACE_BRIGHTNESS: f32 = {SURFACE_BRIGHTNESS:e};\n")
}
