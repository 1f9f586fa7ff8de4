//! What Rust and the shaders that list particles by tiles both need, written as a shader module: one source.

use crate::cpu::screen_spheres::{NEIGHBOUR, WIDEST};
use crate::gpu::splat::layout::{BLOCK, TILE};
use crate::gpu::volume::constants::SORT_BLOCK;
use bevy::shader::ShaderDefVal;

/// Path of the module among the shaders.
pub const PATH: &str = "lib/tile_constants.wgsl";

/// Most levels of bins: the last one's bins are 2^11 tiles wide, and a picture has two of them at most along either side.
pub const MOST_LEVELS: usize = 12;
/// Intervals of depth that slabs are made of, as a power of two.
pub const INTERVAL_BITS: u32 = 14;
/// Intervals of depth that slabs are made of.
pub const INTERVALS: u32 = 1 << INTERVAL_BITS;
/// Invocations of a workgroup.
pub const THREADS: u32 = 256;
/// Numbers of a list, or particles of a block, of one invocation.
const SHARE: u32 = BLOCK / THREADS;
/// Numbers of a list that one workgroup sums.
pub const SCAN_GROUP: u32 = THREADS * SHARE;
/// Bins that a particle may be in.
pub const MOST_BINS: u64 = 4;
/// Rounds of loops that a software driver lets an invocation have in one turn, with some to spare: it ends loops after 65535,
/// without a word.
const ROUNDS: u32 = 40_000;

/// The module `deepfield::tile_constants`.
pub fn wgsl() -> String {
    let numbers = [
        ("MOST_LEVELS", MOST_LEVELS as u32),
        ("TILE_SHIFT", TILE.ilog2()),
        ("INTERVALS", INTERVALS),
        ("SHARE", SHARE),
        ("SORT_BLOCK", SORT_BLOCK),
    ];
    let mut text = String::from("#define_import_path deepfield::tile_constants\n");
    for (name, number) in numbers {
        text += &format!("const {name}: u32 = {number}u;\n");
    }
    for (name, number) in [("NEIGHBOUR", NEIGHBOUR), ("WIDEST", WIDEST)] {
        text += &format!("const {name}: f32 = {number:e};\n");
    }
    text
}

/// Shader definitions of passes that walk over a tile's particles, by a software driver or a graphics card.
pub fn walk_defs(is_software: bool) -> Vec<ShaderDefVal> {
    vec![ShaderDefVal::UInt("ROUNDS".into(), if is_software { ROUNDS } else { u32::MAX })]
}

/// How many turns a walk over at most `particles` of a tile takes, in `levels` levels of bins.
pub fn turns(is_software: bool, particles: u32, levels: u32) -> u32 {
    // Each particle may be a run of its own, whose level is looked for among all; and each turn begins with a search.
    let rounds = u64::from(particles) * u64::from(levels + 2);
    let of_turn = u64::from(ROUNDS - levels * 40);
    if is_software { rounds.div_ceil(of_turn).max(1) as u32 } else { 1 }
}
