// Samples of the levels around a place of measured heights, and how much of them is covered (resolve.rs and coverage.rs in crates/draw/src/cpu/surface).
#define_import_path deepfield::surface_levels
#import deepfield::surface_constants::{CHUNK, NONE}
#import deepfield::surface_ray::{Hit, coverage_of}
#import deepfield::surface_view::{surface, words, draws, lists, Draw, cell_of_level, is_lone, place_of_sample}

/// What a column and a row add to the height on a plane of this normal.
fn slope_of(normal: vec3<f32>) -> vec2<f32> {
    return -normal.xy / (max(normal.z, 1e-6) * surface.true_lift) * surface.lengths;
}

fn normal_of(first: u32, count: u32, index: u32) -> vec3<f32> {
    let along = unpack2x16snorm(words[first + count + index]);
    let up = f32(words[first + 2u * count + index] & 0xffffu) / 65535.0;
    return vec3(along, up);
}

/// Where a line of sight meets the plane of a sample's mean normal: how many rows and columns behind the sample, and the height.
struct Met {
    beside: vec2<f32>,
    height: f32,
    exists: bool,
}

/// The level, with a fraction, whose samples are as far apart as the picture's at a depth.
fn level_at(depth: f32) -> f32 {
    var pixels = surface.focal;
    if surface.perspective != 0u {
        pixels /= max(depth, 1e-37);
    }
    return -log2(pixels * surface.spacing);
}

/// Four samples around a place in a level: the chunk's first word and samples, the first of the four, and what each counts.
struct Between {
    start: u32,
    count: u32,
    index: u32,
    columns: u32,
    weights: vec4<f32>,
    /// Rows and columns that they are apart.
    apart: vec2<f32>,
    exists: bool,
}

fn between(draw: Draw, level: u32, first: vec2<u32>, within: vec2<f32>) -> Between {
    let up = level - draw.level;
    let entry = draw.chain + 3u * up;
    let start = lists[entry];
    if start == NONE {
        return Between(0u, 0u, 0u, 0u, vec4(0.0), vec2(1.0), false);
    }
    let size = vec2(lists[entry + 1u], lists[entry + 2u]);
    let begin = (vec2(draw.key_row, draw.key_column) >> vec2(up)) * CHUNK;
    // Beyond a globe's first row there may be a pole.
    let whole = floor(within);
    let cell = vec2<i32>(first) + vec2<i32>(whole);
    let wanted = cell_of_level(vec2<u32>(max(cell, vec2(0))), level);
    let index = min(max(wanted, begin) - begin, size - 2u);
    let low = place_of_sample(begin + index, level);
    let high = place_of_sample(begin + index + 1u, level);
    let apart = vec2<f32>(high - low);
    let share = clamp((vec2<f32>(cell - vec2<i32>(low)) + within - whole) / apart, vec2(0.0), vec2(1.0));
    let other = 1.0 - share;
    let weights = vec4(other.x * other.y, other.x * share.y, share.x * other.y, share.x * share.y);
    return Between(start, size.x * size.y, index.x * size.y + index.y, size.y, weights, apart, true);
}

fn index_of(four: Between, k: u32) -> u32 {
    return four.index + (k >> 1u) * four.columns + (k & 1u);
}

/// The share of one of so many samples of a chunk that begins with a word.
fn share_in(start: u32, count: u32, index: u32) -> f32 {
    return f32(words[start + 2u * count + index] >> 16u & 255u) / 255.0;
}

fn share_of(four: Between, index: u32) -> f32 {
    return share_in(four.start, four.count, index);
}

/// How much of a level is covered around a place; below 0 where that is not known.
fn covered(draw: Draw, level: u32, hit: Hit) -> f32 {
    let four = between(draw, level, hit.first, hit.within);
    if !four.exists {
        return -1.0;
    }
    var sum = 0.0;
    for (var k = 0u; k < 4u; k++) {
        sum += four.weights[k] * share_of(four, index_of(four, k));
    }
    return sum;
}

/// The levels between which a place is looked at: the finer one, and the share of the other.
fn levels_of(draw: Draw, wanted: f32) -> vec2<f32> {
    let level = clamp(wanted, f32(draw.level), f32(draw.level + draw.chain_length - 1u));
    return vec2(floor(level), fract(level));
}

/// The share of a sample of the picture that is covered where a point is drawn: by `mean`, or as levels tell it where that is below 0.
fn point_coverage(hit: Hit, at: vec2<u32>, mean: f32) -> f32 {
    let draw = draws[hit.node];
    let level = level_at(hit.depth);
    let own = coverage_of(draw, at);
    if draw.level == 0u && (level <= 0.0 || is_lone(draw, at)) {
        return 1.0;
    }
    if level <= 0.0 {
        return own;
    }
    var share = mean;
    if mean < 0.0 {
        let levels = levels_of(draw, level);
        let fine = covered(draw, u32(levels.x), hit);
        share = select(own, fine, fine >= 0.0);
        if levels.y > 0.0 {
            let coarse = covered(draw, u32(levels.x) + 1u, hit);
            share = mix(share, select(share, coarse, coarse >= 0.0), levels.y);
        }
    }
    // What of a pixel's size is in the field, which has no end where it goes round.
    let side = exp2(level) * surface.spacing / surface.step.yx;
    let place = vec2<f32>(hit.first) + hit.within;
    var inside = clamp((min(place + 0.5 * side, vec2<f32>(surface.last.yx)) - max(place - 0.5 * side, vec2(0.0))) / side, vec2(0.0), vec2(1.0));
    if surface.goes_round != 0u {
        inside.y = 1.0;
    }
    return max(inside.x * inside.y * share, 1.0 / 255.0);
}
