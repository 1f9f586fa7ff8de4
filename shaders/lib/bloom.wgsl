// What the passes of bloom share: a level that light goes through and the next coarser one, and the light of the picture.
//
// Whoever imports this has bindings 0 and 1 of group 0 taken. The Rust twin is `LevelUniform` in src/gpu/bloom/levels.rs.
#define_import_path deepfield::bloom

struct Bloom {
    /// Size of the level, pixels.
    fine: vec2<u32>,
    /// Size of the next coarser one.
    coarse: vec2<u32>,
    /// Where the coarser level's columns and rows begin among those that are given light.
    givers: vec2<u32>,
    /// Where the level's columns and rows begin among those that take light back.
    takers: vec2<u32>,
    /// Where the level's pixels begin among the planes.
    fine_start: u32,
    /// Where the coarser level's do.
    coarse_start: u32,
    /// 1: the level is the picture itself, which is no plane.
    is_picture: u32,
    /// Share of the level's own light in what spreads.
    own: f32,
    /// The same of the coarser level's.
    coarser: f32,
    /// Share of bright light that spreads.
    strength: f32,
    /// Light that stays where it is.
    threshold: f32,
    /// How many times brighter than the brightest of a screen light counts at most.
    most_light: f32,
}

@group(0) @binding(0) var<uniform> bloom: Bloom;
/// Light and opacity of each of the picture's pixels.
@group(0) @binding(1) var<storage, read_write> lit: array<vec4<f32>>;
