// Which triangle of a flat field's chunk a line of sight meets first, as crates/draw/src/cpu/surface/rays.rs finds it: from cell to cell, between the
// depths at which it is as high as the chunk is. Which cells are asked is reckoned in 32 bits, and so with room to either side.
#define_import_path deepfield::surface_cells
#import deepfield::surface_cast::{ROUNDING, Met, nothing_met, beside, side_of, depth_between}
#import deepfield::surface_constants::{NONE, LAID, FANNED}
#import deepfield::surface_ray::Ray
#import deepfield::surface_seen::number_of
#import deepfield::surface_view::{surface, draws, Draw, sample_at, corner_of, quad_of, half_of}

/// Cells beside those that a ray is in that are asked as well, where nothing is far away.
const ROOM: f32 = 1e-3;
/// How far edges where levels meet reach to either side, samples of the picture: corners of the finer one lie on the coarser one's edges but for
/// rounding.
const HEM: f32 = 1.0 / 256.0;
/// Rays are level, or stand still, below.
const LEAST: f32 = 1e-30;

/// The part of a span of depths in which a ray is between two ends along an axis, and a little more.
fn between(span: vec2<f32>, origin: f32, direction: f32, ends: vec2<f32>) -> vec2<f32> {
    if abs(direction) > LEAST {
        let depths = (ends - origin) / direction;
        let low = min(depths.x, depths.y);
        let high = max(depths.x, depths.y);
        return vec2(max(span.x, low - ROUNDING * abs(low)), min(span.y, high + ROUNDING * abs(high)));
    }
    return select(vec2(1.0, -1.0), span, origin >= ends.x && origin <= ends.y);
}

/// How far edges where levels meet reach to either side at a depth.
fn hem_at(depth: f32) -> f32 {
    let sample = select(1.0, max(depth, 0.0), surface.perspective != 0u) / surface.focal;
    return HEM * sample + 0.25 * ROUNDING * abs(depth);
}

/// The depth at which a ray passes an edge by no more than its hem; negative where it does not.
fn depth_along(a: vec3<f32>, b: vec3<f32>) -> f32 {
    let edge = b.xy - a.xy;
    let square = dot(edge, edge);
    var share = 0.5;
    if square > 0.0 {
        share = clamp(-dot(a.xy, edge) / square, 0.0, 1.0);
    }
    let nearest = mix(a, b, share);
    return select(-1.0, nearest.z, length(nearest.xy) <= hem_at(nearest.z));
}

/// The depth at which a ray meets a triangle; negative where it does not. `has_hem` says which of its edges have one, each by the corner opposite.
fn depth_in(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, has_hem: vec3<bool>) -> f32 {
    // Corners come in the order that they have in their cell, in which both triangles of an edge have them.
    var depth = depth_between(vec3(side_of(b, c), -side_of(a, c), side_of(a, b)), vec3(a.z, b.z, c.z));
    if has_hem.x && depth < 0.0 {
        depth = depth_along(b, c);
    }
    if has_hem.y && depth < 0.0 {
        depth = depth_along(a, c);
    }
    if has_hem.z && depth < 0.0 {
        depth = depth_along(a, b);
    }
    return depth;
}

/// Of the four sides of a chunk those where another level begins and that a cell lies along: a bit each.
fn joined_sides(draw: Draw, cell: vec2<u32>) -> u32 {
    let is_first = cell == vec2(0u);
    let is_last = cell + 2u == vec2(draw.rows, draw.columns);
    let sides = u32(is_first.x) | u32(is_last.x) << 1u | u32(is_first.y) << 2u | u32(is_last.y) << 3u;
    return sides & (draw.flags >> LAID | draw.flags >> FANNED);
}

/// Whether the edge between two of a cell's corners lies on one of these sides.
fn is_on(sides: u32, first: u32, second: u32) -> bool {
    let is_edge = vec4(4u * first + second) == vec4(1u, 11u, 2u, 7u);
    return (dot(select(vec4(0u), vec4(1u, 2u, 4u, 8u), is_edge), vec4(1u)) & sides) != 0u;
}

/// The nearer of what is known of a ray and what it meets in a cell, row and column, at depths of a part of it. `heights` are those that the ray has
/// over the cell at least and at most.
fn nearer_in(node: u32, draw: Draw, cell: vec2<u32>, across: vec2<f32>, part: vec2<f32>, heights: vec2<f32>, known: Met) -> Met {
    let quad = quad_of(draw, cell);
    if all(quad.heights > vec4(heights.y)) || all(quad.heights < vec4(heights.x)) {
        return known;
    }
    var corners: array<vec3<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        corners[k] = beside(corner_of(draw, cell + vec2(k >> 1u, k & 1u)), quad.heights[k], across);
    }
    let joined = joined_sides(draw, cell);
    var best = known;
    for (var slot = 0u; slot < 2u; slot++) {
        let half = half_of(quad, slot);
        if half.exists {
            let at = half.corners;
            let has_hem = vec3(is_on(joined, at.y, at.z), is_on(joined, at.x, at.z), is_on(joined, at.x, at.y));
            let depth = depth_in(corners[at.x], corners[at.y], corners[at.z], has_hem);
            if depth >= part.x && depth <= part.y && depth < best.depth {
                best = Met(depth, number_of(node, cell, slot));
            }
        }
    }
    return best;
}

/// What a ray meets first of a chunk, of what lies at depths of a part of it, walked through between two depths.
fn first_in(node: u32, ray: Ray, across: vec2<f32>, part: vec2<f32>, walked: vec2<f32>) -> Met {
    let draw = draws[node];
    let whole = f32(1u << draw.level);
    let nothing = nothing_met();
    // Columns and rows of the chunk's cells, of which the last ones of a field may be shorter.
    let begin = vec2<f32>(vec2<i32>(sample_at(draw, vec2(0u)).yx) - surface.anchor);
    let origin = (ray.origin.xy - begin) / whole;
    let direction = ray.direction.xy / whole;
    let last = vec2<f32>(vec2(draw.columns, draw.rows) - 2u);
    let aside = ROOM + ROUNDING * max(abs(origin.x), abs(origin.y));
    var span = between(walked, origin.x, direction.x, vec2(-aside, last.x + 1.0 + aside));
    span = between(span, origin.y, direction.y, vec2(-aside, last.y + 1.0 + aside));
    let highest = max(abs(draw.low), abs(draw.high));
    let above = ROUNDING * (abs(ray.origin.z) + highest);
    span = between(span, ray.origin.z, ray.direction.z, vec2(draw.low - above, draw.high + above));
    if !(span.x <= span.y) {
        return nothing;
    }
    // What is left of a ray's direction may be the difference of larger ones.
    let speed = abs(surface.forward) + abs(ray.direction - surface.forward);
    let hem = 2.0 * hem_at(span.y);
    let room = aside + (ROUNDING * span.y * max(speed.x, speed.y) + hem / min(surface.step.x, surface.step.y)) / whole;
    let rise = above + ROUNDING * span.y * speed.z + hem / max(abs(surface.lift), LEAST);
    // Along the axis that it runs along, cells side by side at each step.
    let major = select(1u, 0u, abs(direction.x) >= abs(direction.y));
    let minor = 1u - major;
    let way = select(-1.0, 1.0, direction[major] >= 0.0);
    let is_moving = abs(direction[major]) > LEAST;
    let ends = origin[major] + span * direction[major] + vec2(-way, way) * room;
    var at = i32(clamp(floor(ends.x), 0.0, last[major]));
    let end = i32(clamp(floor(ends.y), 0.0, last[major]));
    let count = abs(end - at);
    for (var step = 0; step <= count; step++) {
        var within = span;
        if is_moving {
            within = between(span, origin[major], direction[major], vec2(f32(at) - room, f32(at) + 1.0 + room));
        }
        let places = origin[minor] + within * direction[minor];
        let first = i32(clamp(floor(min(places.x, places.y) - room), 0.0, last[minor]));
        let behind = i32(clamp(floor(max(places.x, places.y) + room), 0.0, last[minor]));
        let ray_heights = ray.origin.z + within * ray.direction.z;
        let heights = vec2(min(ray_heights.x, ray_heights.y) - rise, max(ray_heights.x, ray_heights.y) + rise);
        var best = nothing;
        for (var other = first; other <= behind; other++) {
            let cell = vec2<u32>(select(vec2(at, other), vec2(other, at), major == 0u));
            best = nearer_in(node, draw, cell, across, part, heights, best);
        }
        if best.number != NONE {
            return best;
        }
        at += select(-1, 1, way > 0.0);
    }
    return nothing;
}
