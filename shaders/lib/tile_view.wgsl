// What the passes share that list particles by tiles of the picture: the camera, the tiles, and the bins of pairs of bin and
// particle. The Rust twins are in src/gpu/tiles/layout.rs; a test in src/gpu/shaders/ compares the layouts.
#define_import_path deepfield::tile_view
#import deepfield::tile_constants::MOST_LEVELS

struct TileView {
    /// Picture size, pixels.
    size: vec2<u32>,
    /// Where the middle line of sight meets the picture, pixels.
    middle: vec2<f32>,
    /// Depths of the first and the last particle that is listed.
    planes: vec2<f32>,
    /// Pixels per world unit (at depth 1 in perspective).
    focal: f32,
    /// 1: perspective.
    perspective: u32,
    /// Densities up to this are left out.
    least: f32,
    /// Factor on densities.
    density_scale: f32,
    /// Radius of what is drawn of a particle, in smoothing lengths.
    extent: f32,
    /// Particles are sorted by the depth of their centre less this share of their radius.
    lead: f32,
    /// Least smoothing length at depth 1 (perspective) or everywhere: smaller particles are enlarged.
    smallest: f32,
    /// Key of the smallest depth.
    first_key: u32,
    /// Leading bits of a key name its interval of depths.
    interval_shift: u32,
    /// Levels of bins.
    level_count: u32,
    /// Layers of depth, which are sorted by in place of depths; 0: none.
    layers: u32,
    /// Layers for a factor of e in depth (perspective) or a unit of depth.
    layer_rate: f32,
    /// 1: a particle counts in each layer that it reaches.
    spread: u32,
    /// 1: particles lie over each other, are sorted by their distance from the eye and have their own columns in place of densities.
    over: u32,
    /// Radius of the kernel that blurs them, pixels.
    blur: f32,
    /// The own column of the density 1 (0: densities tell nothing), and the power of the density by which it changes.
    column_factor: f32,
    column_power: f32,
    /// What the column through a particle's middle is divided by, and by its squared smoothing length.
    column_area: f32,
    /// For each level its first bin, and its bins along x and y. A bin of level `l` is `2^l` tiles wide.
    levels: array<vec4<u32>, MOST_LEVELS>,
}

/// What differs between the dispatches of a pass.
struct Portion {
    /// Length of a list, or the number of a digit.
    length: u32,
    /// Which of the slabs of depth.
    slab: u32,
    /// Number of the first block of particles.
    first_block: u32,
    /// The most that there may be.
    most: u32,
    /// Number of intervals of depth, and the most of a slab.
    intervals: u32,
    at_once: u32,
    unused_a: u32,
    unused_b: u32,
}

/// A particle in camera space.
struct Spot {
    /// Right, up, depth; and the smoothing length, or once sorted the radius of what is drawn.
    place: vec4<f32>,
    mass: f32,
    density: f32,
    quantity: f32,
    /// What it is sorted by, front to back: its depth, or its layer.
    key: u32,
}

/// A line of sight.
struct Line {
    origin: vec3<f32>,
    direction: vec3<f32>,
    /// Inverse of the direction's squared length.
    inverse: f32,
}

/// The line of sight through a pixel's centre.
fn line_through(tiles: TileView, pixel: vec2<u32>) -> Line {
    let slope = (vec2<f32>(pixel) + 0.5 - tiles.middle) / tiles.focal * vec2(1.0, -1.0);
    if tiles.perspective != 0u {
        return Line(vec3(0.0), vec3(slope, 1.0), 1.0 / (1.0 + dot(slope, slope)));
    }
    return Line(vec3(slope, 0.0), vec3(0.0, 0.0, 1.0), 1.0);
}

/// The squared distance of a particle from a line of sight in units of its radius; 2 where the particle is behind the eye.
fn square_from(tiles: TileView, line: Line, place: vec4<f32>) -> f32 {
    let away = place.xyz - line.origin;
    let across = cross(away, line.direction);
    let radius = place.w * place.w;
    let square = dot(across, across) * line.inverse / radius;
    // Rays whose nearest point to the particle lies behind the eye do not see it, unless the eye is in it.
    let seen = tiles.perspective == 0u || dot(away, line.direction) > 0.0 || dot(away, away) <= radius;
    return select(2.0, square, seen);
}

/// Whole numbers in the order of the numbers themselves.
fn ordered(value: f32) -> u32 {
    let bits = bitcast<u32>(value);
    return select(~bits, bits | 0x80000000u, bits < 0x80000000u);
}

/// The key of a depth.
fn key_of(tiles: TileView, depth: f32) -> u32 {
    let key = ordered(depth);
    return key - min(key, tiles.first_key);
}

/// The layer that a depth is in.
fn layer_of(tiles: TileView, depth: f32) -> u32 {
    let near = tiles.planes.x;
    let inside = clamp(depth, near, tiles.planes.y);
    let along = select(inside - near, log(inside / near), tiles.perspective != 0u);
    return min(u32(max(along * tiles.layer_rate, 0.0)), tiles.layers - 1u);
}

/// The depth where a layer begins.
fn front_of(tiles: TileView, layer: u32) -> f32 {
    let along = f32(layer) / tiles.layer_rate;
    return select(tiles.planes.x + along, tiles.planes.x * exp(along), tiles.perspective != 0u);
}
