// Which tiles something in the picture reaches, as bins. Level 0 has a bin for each tile, level l one for each 2^l by 2^l tiles.
// What is drawn goes to the finest level where it touches at most two bins along either axis, so to four bins at most.
#define_import_path deepfield::tile_reach
#import deepfield::rectangle::rectangle_of
#import deepfield::tile_constants::TILE_SHIFT
#import deepfield::tile_view::TileView

/// The bins that are touched: first and last along x and y, in one level.
struct Reach {
    low: vec2<u32>,
    high: vec2<u32>,
    level: u32,
    /// How many there are.
    count: u32,
}

/// The tiles between two corners of the picture, pixels: first and last, 16 bits for x and y each. None where the last lies before
/// the first.
fn tiles_between(tiles: TileView, low: vec2<f32>, high: vec2<f32>) -> vec2<u32> {
    let size = vec2<f32>(tiles.size);
    if any(high <= vec2(0.0)) || any(low >= size) {
        return vec2(1u, 0u);
    }
    let first = vec2<u32>(max(low, vec2(0.0))) >> vec2(TILE_SHIFT);
    let last = vec2<u32>(min(high, size - 1.0)) >> vec2(TILE_SHIFT);
    return vec2(first.x | (first.y << 16u), last.x | (last.y << 16u));
}

/// The tiles of a sphere.
fn tiles_of(tiles: TileView, place: vec4<f32>) -> vec2<u32> {
    let around = rectangle_of(tiles.middle, tiles.focal, tiles.perspective != 0u, place);
    // Some room for rounding.
    return tiles_between(tiles, around.low - 0.02, around.high + 0.02);
}

/// The bins of such tiles.
fn reach_of(tiles: TileView, between: vec2<u32>) -> Reach {
    let first = vec2(between.x & 0xffffu, between.x >> 16u);
    let last = vec2(between.y & 0xffffu, between.y >> 16u);
    if any(last < first) {
        return Reach(vec2(0u), vec2(0u), 0u, 0u);
    }
    var level = 0u;
    while level + 1u < tiles.level_count && any((last >> vec2(level)) - (first >> vec2(level)) > vec2(1u)) {
        level += 1u;
    }
    let low = first >> vec2(level);
    let high = last >> vec2(level);
    let span = high - low + 1u;
    return Reach(low, high, level, span.x * span.y);
}
