// Which triangle or point of a surface is seen at each sample of the picture, as crates/draw/src/cpu/surface/raster.rs finds it: corners are
// rounded to 1/256 of a sample, after which all decisions are whole numbers and exact.
//
// Everything is drawn twice: the first time the least depth of each sample is found, the second time the least number among those that have it.
// `cells` draws the triangles that are small and lists the others for `large`; `fans` does so with triangles whose corners are listed.
#import deepfield::surface_constants::{CHUNK, FRACTION, TILE, SMALL, SLICES, SCANNERS, ENTRY, FAN, NONE, POINTS, LAID, FANNED, MARGIN, CAST}
#import deepfield::surface_margin::margin_depth
#import deepfield::surface_seen::{surface_step, put, number_of}
#import deepfield::surface_view::{surface, draws, lists, Draw, Corner, corner_of, has_margin, height_of, is_lone, is_measured, camera_of, snapped, from_eye, is_kept, quad_of, half_of, half_in, NOTHING, AHEAD}
#ifdef FILLED
#import deepfield::surface_view::fill_of
#endif
#ifdef GLOBE
#import deepfield::surface_margin::margin_at
#import deepfield::surface_seen::depth_at
#import deepfield::surface_view::shown_of
#endif

@group(1) @binding(3) var<storage, read_write> large_list: array<u32>;
@group(1) @binding(4) var<storage, read_write> large_counts: array<atomic<u32>>;

const ONE: i32 = 1i << FRACTION;
const SIDE: u32 = TILE + 1u;
const CORNERS: u32 = SIDE * SIDE;

var<workgroup> corners: array<Corner, CORNERS>;
#ifdef FILLED
/// Which of them were measured; others are a membrane's.
var<workgroup> measured: array<u32, CORNERS>;
#endif

fn show(pixel: vec2<i32>, depth: f32, number: u32) {
    if surface.clips != 0u && !is_kept(from_eye(vec2<f32>(pixel) + 0.5, depth)) {
        return;
    }
    put(u32(pixel.y) * surface.stride + u32(pixel.x), depth, number);
}

/// A point, as a square about its place; of a margin where nothing else is.
fn square(corner: Corner, camera: vec3<f32>, side: u32, is_margin: bool, number: u32) {
    let own = select(corner.linear, 1.0 / corner.linear, surface.perspective != 0u);
    let first = (corner.place - vec2((i32(side) - 1) * ONE / 2)) >> vec2(FRACTION);
    let from_pixel = max(first, vec2(0));
    let to_pixel = min(first + vec2(i32(side)), vec2<i32>(surface.size));
    for (var y = from_pixel.y; y < to_pixel.y; y++) {
        for (var x = from_pixel.x; x < to_pixel.x; x++) {
            let index = u32(y) * surface.stride + u32(x);
            var depth = own;
            if is_margin {
                let place = vec2<f32>(vec2(x, y)) + 0.5;
                depth = margin_depth(camera, place);
#ifdef GLOBE
                let known = depth_at(index);
                let shown = shown_of(number);
                if known >= 0.0 && known < depth || !margin_at(shown.node, shown.at, place).exists {
                    continue;
                }
#endif
            }
            put(index, depth, number);
        }
    }
}

/// Twice the area that a point makes with an edge, where corners are not far apart.
fn cross_of(a: vec2<i32>, b: vec2<i32>, point: vec2<i32>) -> i32 {
    let edge = b - a;
    let away = point - a;
    return edge.x * away.y - edge.y * away.x;
}

/// 0 for a top or a left edge, on which a centre is inside; 1 for others.
fn least_of(a: vec2<i32>, b: vec2<i32>) -> i32 {
    let edge = b - a;
    return select(1, 0, edge.y < 0 || edge.y == 0 && edge.x > 0);
}

/// Draws a triangle of `surface_step`, or lists it; `source` is where `lists` has its corners, or `NONE` where its number says them.
fn draw_triangle(a: Corner, b_in: Corner, c_in: Corner, number: u32, source: u32) {
    var b = b_in;
    var c = c_in;
    let ahead = u32(a.state == AHEAD) + u32(b.state == AHEAD) + u32(c.state == AHEAD);
    if ahead == 0u {
        return;
    }
    if ahead == 3u {
        let low = min(min(a.place, b.place), c.place);
        let high = max(max(a.place, b.place), c.place);
        // Samples whose centres lie between.
        let first = max((low + vec2(ONE / 2 - 1)) >> vec2(FRACTION), vec2(0));
        let last = min((high - vec2(ONE / 2)) >> vec2(FRACTION), vec2<i32>(surface.size) - 1);
        if any(first > last) {
            return;
        }
        if all(high - low <= vec2(i32(SMALL) * ONE)) {
            var area = cross_of(a.place, b.place, c.place);
            if area == 0 {
                return;
            }
            if area < 0 {
                let other = b;
                b = c;
                c = other;
                area = -area;
            }
            let least = vec3(least_of(b.place, c.place), least_of(c.place, a.place), least_of(a.place, b.place));
            let linear = vec3(a.linear, b.linear, c.linear) / f32(area);
            for (var y = first.y; y <= last.y; y++) {
                for (var x = first.x; x <= last.x; x++) {
                    let point = vec2(x, y) * ONE + ONE / 2;
                    let at = vec3(
                        cross_of(b.place, c.place, point),
                        cross_of(c.place, a.place, point),
                        cross_of(a.place, b.place, point),
                    );
                    if all(at >= least) {
                        let value = dot(vec3<f32>(at), linear);
                        show(vec2(x, y), select(value, 1.0 / value, surface.perspective != 0u), number);
                    }
                }
            }
            return;
        }
    }
    let index = atomicAdd(&large_counts[surface_step.counter], 1u);
    if index < surface_step.most {
        let at = ENTRY * index;
        large_list[at] = number;
        large_list[at + 1u] = source;
        large_list[at + 2u] = bitcast<u32>(a.place.x);
        large_list[at + 3u] = bitcast<u32>(a.place.y);
        large_list[at + 4u] = bitcast<u32>(b.place.x);
        large_list[at + 5u] = bitcast<u32>(b.place.y);
        large_list[at + 6u] = bitcast<u32>(c.place.x);
        large_list[at + 7u] = bitcast<u32>(c.place.y);
    }
}

/// The number of a sample.
fn number_of_point(node: u32, at: vec2<u32>) -> u32 {
    return node << 18u | (1u << 17u) + at.x * 257u + at.y;
}

/// Of the four sides of a chunk those that a cell lies along: a bit each.
fn sides_of(draw: Draw, cell: vec2<u32>) -> u32 {
    return u32(cell.x == 0u) | u32(cell.x + 2u == draw.rows) << 1u | u32(cell.y == 0u) << 2u | u32(cell.y + 2u == draw.columns) << 3u;
}

/// Draws chunks: a workgroup for a square of cells, whose corners it works out once.
@compute @workgroup_size(256)
fn cells(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = lists[surface_step.first + group.y];
    let draw = draws[node];
    let first = vec2(group.x / 16u, group.x % 16u) * TILE;
    let size = vec2(draw.rows, draw.columns);
    let is_points = (draw.flags & POINTS) != 0u;
    let laid = draw.flags >> LAID & 15u;
    for (var i = local; i < CORNERS; i += 256u) {
        let at = first + vec2(i / SIDE, i % SIDE);
        var corner = Corner(vec2(0), 0.0, NOTHING);
        if all(at < size) {
            let own = height_of(draw, at);
            var height = own;
#ifdef FILLED
            if !is_measured(own) {
                height = fill_of(draw, at);
            }
            measured[i] = u32(is_measured(own));
#endif
            if is_measured(height) {
                let camera = camera_of(corner_of(draw, at), height);
                corner = snapped(camera);
                // The last row and column of a square are the next one's first, but for the chunk's last.
                let is_last = (at + 1u == size) | (at == vec2(CHUNK));
                let is_own = (i / SIDE < TILE || is_last.x) && (i % SIDE < TILE || is_last.y);
                if is_own && corner.state == AHEAD && is_measured(own) {
                    let is_alone = is_lone(draw, at);
                    let on = u32(at.x == 0u) | u32(at.x + 1u == size.x) << 1u | u32(at.y == 0u) << 2u | u32(at.y + 1u == size.y) << 3u;
                    let is_point = is_alone || is_points && (on & laid) == 0u;
                    let margin = draw.flags >> MARGIN & 63u;
                    var is_margin = false;
                    if !is_point && margin > 0u {
                        is_margin = has_margin(draw, at);
                    }
                    if is_point || is_margin {
                        let away = camera.x * surface.world_right + camera.y * surface.world_up + camera.z * surface.world_forward;
                        if surface.clips == 0u || is_kept(away) {
                            let side = select(surface.point_side, surface.lone_side, is_alone);
                            square(corner, camera, select(side, margin, is_margin), is_margin, number_of_point(node, at));
                        }
                    }
                }
            }
        }
        corners[i] = corner;
    }
    workgroupBarrier();
    // What is left of a chunk that rays are cast through.
    if (draw.flags & CAST) != 0u {
        return;
    }
    let within = vec2(local / TILE, local % TILE);
    let cell = first + within;
    if any(cell + 1u >= size) {
        return;
    }
    let sides = sides_of(draw, cell);
    // Points and listed triangles stand for what was measured.
    let is_left = is_points && (sides & laid) == 0u || (sides & (draw.flags >> FANNED)) != 0u;
#ifdef FILLED
    let is_empty = is_left && draw.fill == NONE;
#else
    let is_empty = is_left;
#endif
    if is_empty {
        return;
    }
    let at = within.x * SIDE + within.y;
    let places = vec4(at, at + 1u, at + SIDE, at + SIDE + 1u);
    let states = vec4(corners[places.x].state, corners[places.y].state, corners[places.z].state, corners[places.w].state);
    let there = states != vec4(NOTHING);
#ifdef FILLED
    let own = vec4(measured[places.x], measured[places.y], measured[places.z], measured[places.w]) != vec4(0u);
#else
    let own = there;
#endif
    for (var slot = 0u; slot < 2u; slot++) {
        let half = half_in(there, own, slot);
        if half.exists && (half.is_membrane || !is_left) {
            let of_half = vec3(places[half.corners.x], places[half.corners.y], places[half.corners.z]);
            draw_triangle(corners[of_half.x], corners[of_half.y], corners[of_half.z], number_of(node, cell, slot), NONE);
        }
    }
}

/// A corner of a listed triangle.
fn listed(source: u32, corner: u32) -> vec3<f32> {
    let at = source + 1u + 3u * corner;
    return camera_of(vec2(lists[at], lists[at + 1u]), bitcast<f32>(lists[at + 2u]));
}

/// Draws triangles whose corners are listed: those with corners that a finer neighbour adds.
@compute @workgroup_size(256)
fn fans(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= surface_step.count {
        return;
    }
    let source = surface_step.first + FAN * id.x;
    let a = snapped(listed(source, 0u));
    let b = snapped(listed(source, 1u));
    let c = snapped(listed(source, 2u));
    draw_triangle(a, b, c, lists[source], source);
}

/// A product of whole numbers: low and high word.
fn product(a: i32, b: i32) -> vec2<u32> {
    let x = bitcast<u32>(a);
    let y = bitcast<u32>(b);
    let low = vec2(x & 0xffffu, y & 0xffffu);
    let high = vec2(x >> 16u, y >> 16u);
    let ll = low.x * low.y;
    let middle = high.x * low.y + (ll >> 16u);
    let other = low.x * high.y + (middle & 0xffffu);
    var upper = high.x * high.y + (middle >> 16u) + (other >> 16u);
    // Negative ones count 2^32 too much.
    upper -= select(0u, y, a < 0) + select(0u, x, b < 0);
    return vec2((other << 16u) | (ll & 0xffffu), upper);
}

/// The sign of twice the area that a point makes with an edge, less 1 where `least` is: whether the point is inside.
fn is_inside(a: vec2<i32>, b: vec2<i32>, point: vec2<i32>, least: i32) -> bool {
    let edge = b - a;
    let away = point - a;
    let plus = product(edge.x, away.y);
    let minus = product(edge.y, away.x);
    // plus - minus >= least, as plus >= minus + least: the high words are signed.
    let low = minus.x + u32(least);
    let high = minus.y + u32(low < minus.x);
    let upper = bitcast<i32>(plus.y);
    let other = bitcast<i32>(high);
    return upper > other || upper == other && plus.x >= low;
}

/// The sign of a triangle's area: -1, 0 or 1.
fn turn_of(a: vec2<i32>, b: vec2<i32>, c: vec2<i32>) -> i32 {
    if is_inside(a, b, c, 1) {
        return 1;
    }
    return select(-1, 0, is_inside(a, b, c, 0));
}

/// The furthest of what is drawn of an edge, samples from the middle: so that products of differences stay within 63 bits.
const GUARD: f32 = 16384.0;
/// A triangle that is cut by all planes has so many corners at most.
const MOST_CORNERS: u32 = 9u;

/// How far a place is inside a plane: the near one, and those of the guard.
fn inside_of(camera: vec3<f32>, plane: u32) -> f32 {
    if plane == 0u {
        return camera.z - surface.near;
    }
    let depth = select(1.0, camera.z, surface.perspective != 0u);
    let across = select(camera.x, camera.y, plane > 2u);
    return fma(depth, GUARD / surface.focal, select(-across, across, (plane & 1u) == 0u));
}

/// Draws listed triangles of any size: each by workgroups that take blocks of its rows in turn.
@compute @workgroup_size(8, 8)
fn large(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let count = min(atomicLoad(&large_counts[surface_step.counter]), surface_step.most);
    for (var work = group.x; work < count * SLICES; work += SCANNERS) {
        scan(ENTRY * (work / SLICES), work % SLICES, local.xy);
    }
}

fn scan(at: u32, slice: u32, local: vec2<u32>) {
    let number = large_list[at];
    let source = large_list[at + 1u];
    // Its corners in space.
    var space: array<vec3<f32>, 3>;
    if source == NONE {
        let draw = draws[number >> 18u];
        let within = number & 0x1ffffu;
        let cell = vec2(within / 512u, within / 2u % 256u);
        let quad = quad_of(draw, cell);
        let half = half_of(quad, within & 1u);
        for (var k = 0u; k < 3u; k++) {
            let corner = half.corners[k];
            space[k] = camera_of(corner_of(draw, cell + vec2(corner >> 1u, corner & 1u)), quad.heights[corner]);
        }
    } else {
        for (var k = 0u; k < 3u; k++) {
            space[k] = listed(source, k);
        }
    }
    let normal = cross(space[1] - space[0], space[2] - space[0]);
    let ends = vec2(
        max(min(min(space[0].z, space[1].z), space[2].z), surface.near),
        max(max(space[0].z, space[1].z), space[2].z),
    );
    // Where the corners are in the picture: as they were listed, unless something is cut off.
    var places: array<vec2<i32>, MOST_CORNERS>;
    var length = 3u;
    var is_cut = false;
    for (var k = 0u; k < 3u; k++) {
        places[k] = vec2(bitcast<i32>(large_list[at + 2u + 2u * k]), bitcast<i32>(large_list[at + 3u + 2u * k]));
        for (var plane = 0u; plane < 5u; plane++) {
            is_cut |= inside_of(space[k], plane) < 0.0;
        }
    }
    if is_cut {
        var polygon: array<vec3<f32>, MOST_CORNERS>;
        var from_listed: array<vec2<i32>, MOST_CORNERS>;
        var is_listed: array<bool, MOST_CORNERS>;
        for (var k = 0u; k < 3u; k++) {
            polygon[k] = space[k];
            from_listed[k] = places[k];
            is_listed[k] = true;
        }
        for (var plane = 0u; plane < 5u; plane++) {
            var kept: array<vec3<f32>, MOST_CORNERS>;
            var kept_places: array<vec2<i32>, MOST_CORNERS>;
            var kept_listed: array<bool, MOST_CORNERS>;
            var kept_length = 0u;
            for (var k = 0u; k < length; k++) {
                let next = select(k + 1u, 0u, k + 1u == length);
                let here = inside_of(polygon[k], plane);
                let there = inside_of(polygon[next], plane);
                if here >= 0.0 && kept_length < MOST_CORNERS {
                    kept[kept_length] = polygon[k];
                    kept_places[kept_length] = from_listed[k];
                    kept_listed[kept_length] = is_listed[k];
                    kept_length++;
                }
                if (here >= 0.0) != (there >= 0.0) && kept_length < MOST_CORNERS {
                    // From the end that is inside, and so at the same place for both of an edge's triangles.
                    let is_here = here >= 0.0;
                    let inner = select(polygon[next], polygon[k], is_here);
                    let outer = select(polygon[k], polygon[next], is_here);
                    let far = select(there, here, is_here);
                    let share = far / (far - select(here, there, is_here));
                    var cut = fma(vec3(share), outer - inner, inner);
                    if plane == 0u {
                        cut.z = surface.near;
                    }
                    kept[kept_length] = cut;
                    kept_listed[kept_length] = false;
                    kept_length++;
                }
            }
            polygon = kept;
            from_listed = kept_places;
            is_listed = kept_listed;
            length = kept_length;
        }
        for (var k = 0u; k < length; k++) {
            let corner = snapped(vec3(polygon[k].xy, max(polygon[k].z, surface.near)));
            places[k] = select(corner.place, from_listed[k], is_listed[k]);
        }
    }
    for (var k = 2u; k < length; k++) {
        fill(places[0], places[k - 1u], places[k], number, vec4(normal, dot(normal, space[0])), ends, slice, local);
    }
}

/// Samples of a triangle in a plane of space between two depths, in the blocks of rows of a slice.
fn fill(a: vec2<i32>, b_in: vec2<i32>, c_in: vec2<i32>, number: u32, plane: vec4<f32>, ends: vec2<f32>, slice: u32, local: vec2<u32>) {
    let turn = turn_of(a, b_in, c_in);
    if turn == 0 {
        return;
    }
    let b = select(c_in, b_in, turn > 0);
    let c = select(b_in, c_in, turn > 0);
    let low = min(min(a, b), c);
    let high = max(max(a, b), c);
    let first = max((low + vec2(ONE / 2 - 1)) >> vec2(FRACTION), vec2(0));
    let last = min((high - vec2(ONE / 2)) >> vec2(FRACTION), vec2<i32>(surface.size) - 1);
    if any(first > last) {
        return;
    }
    let least = vec3(least_of(b, c), least_of(c, a), least_of(a, b));
    for (var top = first.y + 8 * i32(slice); top <= last.y; top += 8 * i32(SLICES)) {
        // What the rows of the block hold of the triangle, a little more.
        var span = vec2(1e9, -1e9);
        let rows = vec2(f32(top) - 1.0, f32(top) + 9.0);
        span = spanned(a, b, rows, span);
        span = spanned(b, c, rows, span);
        span = spanned(c, a, rows, span);
        let left = max(first.x, i32(max(span.x, 0.0)) - 2);
        let right = min(last.x, i32(clamp(span.y, -4.0, 65536.0)) + 2);
        let y = top + i32(local.y);
        for (var block = left; block <= right; block += 8) {
            let x = block + i32(local.x);
            if x > right || y > last.y {
                continue;
            }
            let point = vec2(x, y) * ONE + ONE / 2;
            if is_inside(b, c, point, least.x) && is_inside(c, a, point, least.y) && is_inside(a, b, point, least.z) {
                let across = vec2(f32(x) + 0.5 - surface.middle.x, surface.middle.y - f32(y) - 0.5) / surface.focal;
                let over = dot(plane.xy, across);
                let is_perspective = surface.perspective != 0u;
                let numerator = plane.w - select(over, 0.0, is_perspective);
                let denominator = plane.z + select(0.0, over, is_perspective);
                var depth = ends.x;
                if denominator != 0.0 {
                    depth = clamp(numerator / denominator, ends.x, ends.y);
                }
                show(vec2(x, y), depth, number);
            }
        }
    }
}

/// Takes in what an edge has between two rows of the picture.
fn spanned(a: vec2<i32>, b: vec2<i32>, rows: vec2<f32>, span: vec2<f32>) -> vec2<f32> {
    let start = vec2<f32>(a) / f32(ONE);
    let end = vec2<f32>(b) / f32(ONE);
    let low = min(start.y, end.y);
    let high = max(start.y, end.y);
    if high < rows.x || low > rows.y {
        return span;
    }
    let ys = clamp(rows, vec2(low), vec2(high));
    var shares = vec2(0.0, 1.0);
    if high - low > 1e-3 {
        shares = clamp((ys - start.y) / (end.y - start.y), vec2(0.0), vec2(1.0));
    }
    let xs = start.x + shares * (end.x - start.x);
    return vec2(min(span.x, min(xs.x, xs.y)), max(span.y, max(xs.x, xs.y)));
}
