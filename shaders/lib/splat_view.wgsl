// What a camera's splat passes share: the camera, the image pyramid's grids and the bins that particles are sorted
// into. The Rust twin is `SplatUniform` in src/gpu/splat/layout.rs; a test in src/gpu/shaders/ compares the two
// layouts.
#define_import_path deepfield::splat_view

/// One level of the image pyramid. Cell `(i, j)` of level `l` covers the pixels from `(i - pad) 2^l` to
/// `(i - pad + 1) 2^l`. Bin `(i, j)` covers cells `8 (i - margin)` to `8 (i - margin) + 7`, both relative to the first cell.
struct Level {
    width: u32,
    height: u32,
    pad: u32,
    /// Index of the level's first cell in the pyramid.
    first_cell: u32,
    tiles_x: u32,
    /// Number of tiles in all levels before this one.
    first_tile: u32,
    bins_x: u32,
    bins_y: u32,
    /// Index of the level's first bin.
    first_bin: u32,
    margin: u32,
    /// Pixels per cell.
    scale: f32,
    /// First row in the atlas of the blended technique.
    atlas_row: u32,
    /// First bin of the ellipses that are sampled, and of those that are integrated: bins as fine as tiles, then of twice the edge, and so on
    /// to a single one for all tiles, each of these with a margin around, and one more for what reaches further than any margin.
    ellipse_bins: vec2<u32>,
    /// Splats with a radius of at least this many cells are sampled; the same in every level.
    sampled_radius: f32,
    unused: u32,
}

/// What differs between the passes of a picture.
struct Pass {
    /// 1: add to what is there; 0: overwrite.
    add: u32,
    /// 1: further slices of crowded tiles; 0: every tile's first.
    further: u32,
    /// The coarser level of a reconstruction.
    level: u32,
    unused: u32,
    /// Where the coarser level begins in the texture that holds it.
    source: vec2<u32>,
    unused_a: u32,
    unused_b: u32,
}

// What stays while the camera moves comes first: an adapter in software has the first word as a constant, and compiles anew where it changes.
struct SplatView {
    /// Picture size, pixels.
    size: vec2<u32>,
    /// Size of the atlas that the blended technique draws all levels into.
    atlas: vec2<u32>,
    /// Where the middle line of sight meets the picture, pixels: outside of a part that does not hold it.
    middle: vec2<f32>,
    /// Tiles and cells of all levels.
    tile_count: u32,
    cell_count: u32,
    /// Pixels per world unit (at depth 1 in perspective).
    focal: f32,
    near: f32,
    /// 1: perspective, 0: orthographic.
    perspective: u32,
    /// Radius of every particle in pixels, or 0: smoothing lengths count.
    fixed_radius: f32,
    /// Most splats of a range of bins that one invocation sums.
    slice: u32,
    level_count: u32,
    /// First of the bins for splats below the sampled radius; their grid is that of level 0.
    small_bin: u32,
    /// The bin for splats that can reach every tile.
    everywhere_bin: u32,
    /// Number of bins.
    bin_count: u32,
    /// Variance of the kernel along an axis, for h = 1.
    moment: f32,
    /// Particles that add less than this to every pixel are dropped; 0: none.
    faintest: f32,
    /// The projected kernel's value in its middle, for h = 1.
    peak: f32,
    /// 1: particles outside the picture are dropped; 0: they are sorted into a bin that no tile looks at.
    culling: u32,
    /// 1: particles are left out and faded as the next fields say.
    cut: u32,
    /// Depth up to which particles keep their weight.
    fade_start: f32,
    /// Rate of the exponential by which weights fall behind that.
    fade_rate: f32,
    /// Camera axes in world coordinates.
    right: vec4<f32>,
    up: vec4<f32>,
    forward: vec4<f32>,
    /// Corners of the box that is drawn, relative to the eye in world axes.
    clip_min: vec4<f32>,
    clip_max: vec4<f32>,
    /// Camera coordinates of the direction that depth is measured in for what fades.
    fade_along: vec4<f32>,
    levels: array<Level, 16>,
}

/// A particle in the picture, in two vectors:
/// - `head.xy`: centre, pixels.
/// - `head.zw`, `tail.x`: for sampled splats the quadratic form q^2 = head.z dx^2 + 2 head.w dx dy + tail.x dy^2 (see
///   `oblique`); for small ones 1/radius along x and along y (1/pixel), and the correlation of x and y; for small ellipses 1/half the
///   width of a row and 1/half the height (1/pixel), and by how much a row lies further on than the one before it, the axis with the
///   greater extent taken as the height.
/// - `tail.yz`: factor of P and of P S.
/// - `tail.w`: no pixel further from the centre than this is touched, pixels; negative if the eye is inside the kernel, and of small ellipses
///   if their height is along x.
struct Splat {
    head: vec4<f32>,
    tail: vec4<f32>,
}

/// Where a level begins in the atlas: the finest on the left, the others in a column on the right of it.
fn atlas_corner(finest: Level, level: u32, grid: Level) -> vec2<u32> {
    return vec2(select(finest.width, 0u, level == 0u), grid.atlas_row);
}

/// Kinds of splats.
const SAMPLED: u32 = 0u;
const SMALL: u32 = 1u;
const EVERYWHERE: u32 = 2u;
/// Seen by no pixel.
const INVISIBLE: u32 = 3u;
/// Not to be drawn.
const DROPPED: u32 = 4u;
/// Ellipses: sampled, and integrated over pixels.
const ELLIPSE: u32 = 5u;
const SMALL_ELLIPSE: u32 = 6u;

/// 1 / |ray|^2 for the ray through a pixel position, where |ray| = 1 along the axis: turns a particle's quadratic
/// form into the squared distance between the ray and the particle's centre (F12 4.9.1).
fn oblique(middle: vec2<f32>, focal: f32, perspective: u32, pixel: vec2<f32>) -> f32 {
    let offset = (pixel - middle) / focal;
    return select(1.0, 1.0 / (1.0 + dot(offset, offset)), perspective != 0u);
}
