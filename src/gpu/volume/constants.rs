//! What Rust and the volume shaders both need, written as a shader module: one source, and constants that a shader's
//! compiler sees.

use super::column;
use crate::cpu::cartesian::march;
use crate::cpu::field;
use crate::cpu::shadowing::COVERS;
use crate::cpu::volume::bricks::{self, BORDER};
use crate::cpu::volume::classify::{BRIGHTNESSES, HIDDEN_BITS, HUES, VALUES};
use crate::cpu::volume::coarse;
use crate::cpu::volume::range;
use crate::cpu::volume::raycast::SURFACE_BRIGHTNESS;
use crate::cpu::volume::smoothing;

/// Path of the module among the shaders.
pub const PATH: &str = "lib/volume_constants.wgsl";

/// Cells along a brick's side, as a power of two; and slices of a layer.
const BRICK_SHIFT: u32 = 3;
/// Cells along a brick's side.
pub const BRICK: u32 = 1 << BRICK_SHIFT;
/// Cells of a brick.
pub const CELLS: u32 = BRICK * BRICK * BRICK;
/// Where the list of bricks has the numbers of those that are interpolated, one for each tier.
const CHOSEN: u32 = 4;
/// Words before the list of bricks.
pub const HEADER: u32 = 12;
/// Cells along the side of a room of a Cartesian grid: rays leave those in one step in which nothing shows, and where a ray has samples
/// depends on that. The processor's rooms are its bricks.
pub const ROOM: u32 = bricks::BRICK as u32;
const _: () = assert!(ROOM.is_multiple_of(BRICK));
/// Most levels of bins, of all tiers together: the finest tier's last one has bins that are 2^13 bricks wide, and each
/// tier has half the bricks of the one before.
pub const MOST_LEVELS: usize = 80;
/// Bits of a particle's place in its batch, beside which pairs hold three times four bits.
pub const PARTICLE_BITS: u32 = 20;
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

/// The number in `work` that is the pairs of all slabs.
pub const ALL_PAIRS: u32 = 5;
/// The number in `work` that is the particles that the grid has enlarged.
pub const ALL_RAISED: u32 = 6;

/// Numbers that are kept of a pixel's surface.
pub const FACE_WORDS: u32 = 10;

/// The module `deepfield::volume_constants`.
pub fn wgsl() -> String {
    let numbers = [
        ("BRICK_SHIFT", BRICK_SHIFT),
        ("BRICK", BRICK),
        ("CELLS", CELLS),
        ("BORDER", BORDER as u32),
        ("CHOSEN", CHOSEN),
        ("HEADER", HEADER),
        ("PARTICLE_BITS", PARTICLE_BITS),
        ("BIN_GROUP", BIN_GROUP),
        ("SORT_BLOCK", SORT_BLOCK),
        ("DIGIT_BITS", DIGIT_BITS),
        ("DIGITS", DIGITS),
        ("ALL_PAIRS", ALL_PAIRS),
        ("ALL_RAISED", ALL_RAISED),
        ("HIDDEN_BITS", HIDDEN_BITS),
        ("HUES", HUES as u32),
        ("BRIGHTNESSES", BRIGHTNESSES as u32),
        ("VALUE_ENTRIES", VALUES as u32),
        ("SAMPLE_BLOCK", field::BLOCK as u32),
        ("AROUND", field::bricks::AROUND as u32),
        ("ROOM", ROOM),
        ("RANGE_CLASSES", range::CLASSES as u32),
        ("RANGE_HIDDEN_BITS", range::HIDDEN_BITS),
        ("COLUMN_VALUES", column::VALUES),
        ("OF_VOLUME", column::OF_VOLUME),
        ("OF_SURFACES", column::OF_SURFACES),
        ("OF_OPACITY", column::OF_OPACITY),
        ("OF_HUE", column::OF_HUE),
        ("READ_DENSITY", column::READ_DENSITY),
        ("READ_SUM", column::READ_SUM),
        ("EVEN_TABLE", column::EVEN_TABLE),
        ("HOLES_OF_VOLUME", column::HOLES_OF_VOLUME),
        ("HOLES_OF_SURFACES", column::HOLES_OF_SURFACES),
        ("DIMMED", column::DIMMED),
        ("FACE_WORDS", FACE_WORDS),
    ];
    let mut text = String::from("#define_import_path deepfield::volume_constants\n");
    for (name, number) in numbers {
        text += &format!("const {name}: u32 = {number}u;\n");
    }
    let shares = [
        ("STEP", march::STEP),
        ("FLOW", smoothing::STEP),
        ("APART", smoothing::APART),
        ("SURFACE_BRIGHTNESS", SURFACE_BRIGHTNESS),
        ("COVERS", COVERS),
        ("WIDE", coarse::WIDE),
        ("OVERSHOOT", coarse::OVERSHOOT),
    ];
    for (name, share) in shares {
        text += &format!("const {name}: f32 = {share:e};\n");
    }
    let [a, b, c, d] = coarse::WEIGHTS;
    text + &format!("const WEIGHTS: vec4<f32> = vec4<f32>({a:e}, {b:e}, {c:e}, {d:e});\n")
}
