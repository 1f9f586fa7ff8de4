// Which triangle of a chunk on a globe a line of sight meets first.
//
// Blocks of cells are looked at from the whole chunk down to such of a few cells, those that the ray comes by first before others. The corners of a block
// are about the line that stands in its middle, between the chunk's least and greatest height: each is no farther from the place of its own height there
// than the way along rows and columns is long. So is all between corners, as triangles are flat. What passes by that line farther away meets nothing.
//
// Where finer chunks add corners to edges, and where the globe is closed, triangles are listed by their corners, and stand for those of their cells.
#define_import_path deepfield::surface_blocks
#import deepfield::surface_cast::{ROUNDING, Met, nothing_met, aside, beside, side_of, depth_between}
#import deepfield::surface_constants::{CHUNK, FAN, NONE, ROW_WORDS}
#import deepfield::surface_seen::number_of
#import deepfield::surface_view::{surface, draws, lists, Draw, camera_of, corner_of, quad_of, half_of}

/// The smallest blocks are of 4 x 4 cells: the logarithm of that.
const SMALLEST: u32 = 2u;
/// By how much more than is reckoned corners may be away: more than what rounding takes from lengths.
const SLACK: f32 = 1.0001;

/// Some corners: none is farther than `reach` from the line between two places.
struct Hull {
    low: vec3<f32>,
    high: vec3<f32>,
    reach: f32,
}

/// Rounding moves places by parts of how far they are away.
fn hull_between(low: vec3<f32>, high: vec3<f32>, reach: f32) -> Hull {
    return Hull(low, high, SLACK * reach + 2.0 * ROUNDING * (length(low) + length(high)));
}

/// How far from the globe's axis a row of a chunk is at most, between the chunk's least and greatest height.
fn from_axis(draw: Draw, row: u32) -> f32 {
    let away = bitcast<f32>(lists[draw.rows_at + ROW_WORDS * row + 1u]);
    let level = bitcast<f32>(lists[draw.rows_at + ROW_WORDS * row + 2u]);
    let lifted = surface.lift * vec2(draw.low, draw.high);
    return max(abs(fma(lifted.x, level, away)), abs(fma(lifted.y, level, away)));
}

/// The corners of a block, from the first to the last one.
fn hull_of(draw: Draw, first: vec2<u32>, last: vec2<u32>) -> Hull {
    let middle = (first + last) / 2u;
    let corner = corner_of(draw, middle);
    // It is farther from the middle to the last corner than from the first one.
    let half = vec2<f32>(last - middle);
    let down = half.x * draw.row_length;
    let radius = max(from_axis(draw, first.x), from_axis(draw, last.x)) + down;
    let right = half.y * f32(1u << draw.level) * abs(surface.turn.x) * radius;
    return hull_between(camera_of(corner, draw.low), camera_of(corner, draw.high), length(vec2(down, right)));
}

/// Whether a ray may meet what is between corners, between two depths.
fn may_meet(hull: Hull, across: vec2<f32>, depths: vec2<f32>) -> bool {
    if min(hull.low.z, hull.high.z) - hull.reach > depths.y || max(hull.low.z, hull.high.z) + hull.reach < depths.x {
        return false;
    }
    let start = aside(hull.low, across).xy;
    let edge = aside(hull.high, across).xy - start;
    let square = dot(edge, edge);
    var share = 0.0;
    if square > 0.0 {
        share = clamp(-dot(start, edge) / square, 0.0, 1.0);
    }
    let nearest = start + share * edge;
    // Beside a ray that runs aslant lengths are longer.
    let longer = select(1.0, length(vec3(across, 1.0)), surface.perspective != 0u);
    return length(nearest) <= longer * hull.reach;
}

/// On which side of an edge the ray is, to the bit but for the sign whichever end is named first: triangles that are listed name them in any order.
fn turned_side(a: vec3<f32>, b: vec3<f32>) -> f32 {
    let is_turned = a.x > b.x || a.x == b.x && a.y > b.y;
    let side = side_of(select(a, b, is_turned), select(b, a, is_turned));
    return select(side, -side, is_turned);
}

/// The nearer of what is known of a ray and a triangle, at depths of a part of it.
fn nearer(known: Met, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, number: u32, part: vec2<f32>) -> Met {
    let sides = vec3(turned_side(b, c), turned_side(c, a), turned_side(a, b));
    let depth = depth_between(sides, vec3(a.z, b.z, c.z));
    if depth >= part.x && depth <= part.y && depth < known.depth {
        return Met(depth, number);
    }
    return known;
}

/// The same of triangles whose corners are listed: where the first one is, and how many there are.
fn nearer_listed(known: Met, fans: vec2<u32>, across: vec2<f32>, part: vec2<f32>) -> Met {
    var best = known;
    for (var k = 0u; k < fans.y; k++) {
        let source = fans.x + FAN * k;
        var corners: array<vec3<f32>, 3>;
        for (var corner = 0u; corner < 3u; corner++) {
            let at = source + 1u + 3u * corner;
            corners[corner] = beside(vec2(lists[at], lists[at + 1u]), bitcast<f32>(lists[at + 2u]), across);
        }
        best = nearer(best, corners[0], corners[1], corners[2], lists[source], part);
    }
    return best;
}

/// Where the triangles of an entry are listed, and how many there are (`entry_of` in src/gpu/surface/list.rs).
fn entry_at(draw: Draw, entry: u32) -> vec2<u32> {
    if draw.fans == NONE {
        return vec2(0u);
    }
    return vec2(lists[draw.fans + 2u * entry], lists[draw.fans + 2u * entry + 1u]);
}

/// Those of a cell: poles come before cells along the first and the last row, and these before cells along the first and the last column.
fn fans_of(draw: Draw, cell: vec2<u32>) -> vec2<u32> {
    let cells = vec2(draw.rows, draw.columns) - 1u;
    if cell.x == 0u {
        return entry_at(draw, 2u + cell.y);
    }
    if cell.x + 1u == cells.x {
        return entry_at(draw, 2u + cells.y + cell.y);
    }
    if cell.y == 0u {
        return entry_at(draw, 2u + 2u * cells.y + cell.x);
    }
    if cell.y + 1u == cells.y {
        return entry_at(draw, 2u + 2u * cells.y + cells.x + cell.x);
    }
    return vec2(0u);
}

/// The nearer of what is known and what a ray meets in a cell, row and column.
fn nearer_in(node: u32, draw: Draw, cell: vec2<u32>, across: vec2<f32>, part: vec2<f32>, known: Met) -> Met {
    let fans = fans_of(draw, cell);
    var best = nearer_listed(known, fans, across, part);
    // What closes a globe behind all other columns of its chunk is listed alone.
    if cell.y == CHUNK {
        return best;
    }
    let quad = quad_of(draw, cell);
    var corners: array<vec3<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        corners[k] = beside(corner_of(draw, cell + vec2(k >> 1u, k & 1u)), quad.heights[k], across);
    }
    for (var slot = 0u; slot < 2u; slot++) {
        let half = half_of(quad, slot);
        // Listed triangles stand for what was measured.
        if half.exists && (half.is_membrane || fans.y == 0u) {
            let at = half.corners;
            best = nearer(best, corners[at.x], corners[at.y], corners[at.z], number_of(node, cell, slot), part);
        }
    }
    return best;
}

/// The same of the triangles between a chunk and a pole beyond its first row (0) or its last one (1).
fn nearer_pole(draw: Draw, end: u32, across: vec2<f32>, part: vec2<f32>, depths: vec2<f32>, known: Met) -> Met {
    let fans = entry_at(draw, end);
    if fans.y == 0u {
        return known;
    }
    let height = surface.pole_height[end];
    let pole = vec2(surface.pole_at[end], draw.columns_at);
    // It is a spacing away at most, and a little more.
    let low = camera_of(pole, min(draw.low, height));
    let high = camera_of(pole, max(draw.high, height));
    if !may_meet(hull_between(low, high, 1.01 * draw.row_length), across, depths) {
        return known;
    }
    return nearer_listed(known, fans, across, part);
}

/// Every other one of 24 bits, from the lowest one on.
fn every_other(bits: u32) -> u32 {
    var left = bits & 0x555555u;
    left = (left | left >> 1u) & 0x333333u;
    left = (left | left >> 2u) & 0x0f0f0fu;
    left = (left | left >> 4u) & 0xff00ffu;
    return (left | left >> 8u) & 0xffffu;
}

/// Whether rows and columns of a chunk count away from the eye along a ray, or towards it.
fn is_backwards(draw: Draw, cells: vec2<u32>, across: vec2<f32>) -> vec2<bool> {
    let way = select(vec3(0.0, 0.0, 1.0), vec3(across, 1.0), surface.perspective != 0u);
    let middle = cells / 2u;
    let down = camera_of(corner_of(draw, vec2(cells.x, middle.y)), 0.0) - camera_of(corner_of(draw, vec2(0u, middle.y)), 0.0);
    let right = camera_of(corner_of(draw, vec2(middle.x, cells.y)), 0.0) - camera_of(corner_of(draw, vec2(middle.x, 0u)), 0.0);
    return vec2(dot(down, way) < 0.0, dot(right, way) < 0.0);
}

/// What a ray meets first of a chunk, of what lies at depths of a part of it, between two depths.
fn first_in(node: u32, across: vec2<f32>, part: vec2<f32>, walked: vec2<f32>) -> Met {
    let draw = draws[node];
    var best = nearer_pole(draw, 0u, across, part, walked, nothing_met());
    best = nearer_pole(draw, 1u, across, part, walked, best);
    let cells = vec2(draw.rows, draw.columns) - 1u;
    if !may_meet(hull_of(draw, vec2(0u), cells), across, walked) {
        return best;
    }
    // The smallest square of blocks that holds all cells: what closes a globe may be one more than a chunk has.
    let top = max(32u - countLeadingZeros(max(cells.x, cells.y) - 1u), SMALLEST);
    let count = 1u << (2u * (top - SMALLEST));
    let turned = select(vec2(0u), vec2((1u << (top - SMALLEST)) - 1u), is_backwards(draw, cells, across));
    // Blocks are numbered as the smallest ones are, along a curve that goes through one after the other of four.
    var code = 0u;
    var level = top;
    while code < count {
        let along = vec2(every_other(code >> 1u), every_other(code)) ^ turned;
        let first = (along >> vec2(level - SMALLEST)) << vec2(level);
        let last = min(first + (1u << level), cells);
        if all(first < cells) && may_meet(hull_of(draw, first, last), across, vec2(walked.x, min(walked.y, best.depth))) {
            if level > SMALLEST {
                level--;
                continue;
            }
            for (var row = first.x; row < last.x; row++) {
                for (var column = first.y; column < last.y; column++) {
                    best = nearer_in(node, draw, vec2(row, column), across, part, best);
                }
            }
        }
        // The largest one that begins where this one ends.
        code += 1u << (2u * (level - SMALLEST));
        level = SMALLEST + min(firstTrailingBit(code) / 2u, top - SMALLEST);
    }
    return best;
}
