// What a surface looks like at each pixel: the places that its samples show (crates/draw/src/cpu/surface/resolve.rs), and their colours
// (shade.rs there). One invocation for each pixel.
//
// Where the processor casts a ray through all of the surface, this follows it over cells from a little before what the sample shows.
#import deepfield::surface_constants::{CHUNK, FINER, SECANTS, ENDS, MINOR, EDGE, REACH}
#import deepfield::surface_view::{surface, words, draws, lists, Draw, sample_at, height_of, is_lone, is_measured, camera_of, half_of, Half, NONE, LEAF, POINTS, MIXED}

/// What each sample shows, inverted: 0 is nothing.
@group(1) @binding(0) var<storage, read> numbers: array<u32>;
/// Colours over the range of values.
@group(1) @binding(1) var<storage, read> ramp: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> light: array<vec4<f32>>;

/// Rounding may leave a place so far outside of its triangle, in the triangle's own size.
const OUTSIDE: f32 = 1e-4;
/// Cells before what is shown from which on a ray is followed, and behind it: without end.
const WIDE: f32 = 40.0;
const ENDLESS: f32 = 1e20;
/// Most chunks that a ray is followed through.
const CROSSED: u32 = 64u;

/// A line of sight in columns, rows and heights.
struct Ray {
    origin: vec3<f32>,
    direction: vec3<f32>,
}

fn ray_at(place: vec2<f32>) -> Ray {
    let across = vec2(place.x - surface.middle.x, surface.middle.y - place.y) / surface.focal;
    let aside = across.x * surface.right + across.y * surface.up;
    if surface.perspective != 0u {
        return Ray(surface.eye, surface.forward + aside);
    }
    return Ray(surface.eye + aside, surface.forward);
}

/// A place of the surface.
struct Hit {
    node: u32,
    depth: f32,
    /// The first sample of its cell, or a point's sample, row and column of the field, and how many of them it is behind that.
    first: vec2<u32>,
    within: vec2<f32>,
    /// From the reference.
    height: f32,
    /// What a column and a row add to it.
    slope: vec2<f32>,
    coverage: f32,
    exists: bool,
    /// Where there is none: whether there may be one all the same, beyond chunks that are not drawn.
    is_beside: bool,
}

fn no_hit(is_beside: bool) -> Hit {
    return Hit(0u, 0.0, vec2(0u), vec2(0.0), 0.0, vec2(0.0), 0.0, false, is_beside);
}

/// A cell as rays meet it: the heights of its corners, where it begins, and how many rows and columns it is.
struct Cell {
    heights: vec4<f32>,
    first: vec2<u32>,
    size: vec2<f32>,
}

fn cell_of(draw: Draw, at: vec2<u32>) -> Cell {
    let first = sample_at(draw, at);
    let next = sample_at(draw, at + 1u);
    let heights = vec4(
        height_of(draw, at),
        height_of(draw, at + vec2(0u, 1u)),
        height_of(draw, at + vec2(1u, 0u)),
        height_of(draw, at + 1u),
    );
    return Cell(heights, first, vec2<f32>(next - first));
}

/// The height of a triangle at its cell's first corner, and what it adds along columns and along rows.
fn plane_of(heights: vec4<f32>, half: Half) -> vec3<f32> {
    let a = heights.x;
    let b = heights.y;
    let d = heights.z;
    let e = heights.w;
    if half.corners.x == 1u {
        return vec3(b + d - e, e - d, e - b);
    }
    if half.corners.z == 2u {
        return vec3(a, b - a, d - a);
    }
    if half.corners.y == 1u {
        return vec3(a, b - a, e - b);
    }
    return vec3(a, e - d, d - a);
}

/// What each corner of a triangle counts at a place of its cell.
fn weights_of(half: Half, at: vec2<f32>) -> vec3<f32> {
    let u = at.x;
    let v = at.y;
    if half.corners.x == 1u {
        return vec3(1.0 - v, 1.0 - u, u + v - 1.0);
    }
    if half.corners.z == 2u {
        return vec3(1.0 - u - v, u, v);
    }
    if half.corners.y == 1u {
        return vec3(1.0 - u, u - v, v);
    }
    return vec3(1.0 - v, v - u, u);
}

/// The place of a cell where its triangle's corners count so much.
fn place_of(half: Half, weights: vec3<f32>) -> vec2<f32> {
    return vec2(dot(weights, vec3<f32>(half.corners % vec3(2u))), dot(weights, vec3<f32>(half.corners / vec3(2u))));
}

/// Where a ray meets a triangle's plane: the place in the cell, and the depth; and whether it is in the triangle.
struct Meeting {
    at: vec2<f32>,
    depth: f32,
    is_met: bool,
}

fn meeting_of(ray: Ray, cell: Cell, half: Half) -> Meeting {
    let plane = plane_of(cell.heights, half);
    let away = vec2<f32>(vec2<i32>(cell.first.yx) - surface.anchor);
    let size = cell.size.yx;
    let origin = (ray.origin.xy - away) / size;
    let direction = ray.direction.xy / size;
    let depth = (plane.x + dot(plane.yz, origin) - ray.origin.z) / (ray.direction.z - dot(plane.yz, direction));
    let at = origin + depth * direction;
    let is_met = depth >= 0.0 && depth < 1e30 && all(weights_of(half, at) >= vec3(-OUTSIDE));
    return Meeting(at, depth, is_met);
}

/// The share of a sample that is covered.
fn coverage_of(draw: Draw, at: vec2<u32>) -> f32 {
    let count = draw.rows * draw.columns;
    return f32(words[draw.start + 2u * count + at.x * draw.columns + at.y] >> 16u & 255u) / 255.0;
}

/// The hit of a ray that meets a triangle.
fn hit_of(node: u32, at: vec2<u32>, cell: Cell, half: Half, place: vec2<f32>, depth: f32) -> Hit {
    let draw = draws[node];
    let plane = plane_of(cell.heights, half);
    var coverage = 1.0;
    if draw.level > 0u && (draw.flags & MIXED) != 0u {
        let weights = clamp(weights_of(half, place), vec3(0.0), vec3(1.0));
        var shares: vec3<f32>;
        for (var k = 0u; k < 3u; k++) {
            shares[k] = coverage_of(draw, at + vec2(half.corners[k] >> 1u, half.corners[k] & 1u));
        }
        coverage = min(dot(weights, shares), 1.0);
    }
    let height = plane.x + dot(plane.yz, place);
    return Hit(node, depth, cell.first, place.yx * cell.size, height, plane.yz / cell.size.yx, coverage, true, false);
}

/// The place on a triangle that a sample shows.
fn hit_triangle(node: u32, at: vec2<u32>, slot: u32, ray: Ray) -> Hit {
    let cell = cell_of(draws[node], at);
    let half = half_of(cell.heights, slot);
    let met = meeting_of(ray, cell, half);
    if met.is_met {
        return hit_of(node, at, cell, half, met.at, met.depth);
    }
    // The centre is within rounding of an edge, or the triangle is seen from its edge.
    var weights = vec3(1.0 / 3.0);
    if all(abs(met.at) < vec2(1e6)) {
        let inside = max(weights_of(half, met.at), vec3(0.0));
        weights = inside / dot(inside, vec3(1.0));
    }
    let place = place_of(half, weights);
    var depth = met.depth;
    let plane = plane_of(cell.heights, half);
    let camera = camera_at(cell.first, place.yx * cell.size, plane.x + dot(plane.yz, place));
    return hit_of(node, at, cell, half, place, camera.z);
}

/// A place of the surface in the camera's coordinates.
fn camera_at(first: vec2<u32>, within: vec2<f32>, height: f32) -> vec3<f32> {
    return camera_of(first, height) + within.y * surface.per_column + within.x * surface.per_row;
}

/// What has come of a ray in a chunk: a hit, or the depth at which it leaves for the cell of the field that lies beside.
struct Passage {
    hit: Hit,
    leaves: bool,
    depth: f32,
    next: vec2<i32>,
}

/// Follows a ray through a chunk between two depths.
fn pass_through(node: u32, ray: Ray, start: f32, end: f32) -> Passage {
    let draw = draws[node];
    let whole = f32(1u << draw.level);
    let corner = sample_at(draw, vec2(0u));
    let begin = vec2<f32>(vec2<i32>(corner.yx) - surface.anchor);
    // Columns and rows of the chunk's cells, of which the last ones of a field may be shorter.
    let origin = (ray.origin.xy - begin) / whole;
    let direction = ray.direction.xy / whole;
    let cells = vec2<f32>(vec2(draw.columns, draw.rows) - 1u);
    let far_corner = sample_at(draw, vec2(draw.rows, draw.columns) - 1u);
    let size = vec2<f32>(far_corner.yx - corner.yx) / whole;
    let forwards = vec2<i32>(direction >= vec2(0.0));
    // Where it leaves the chunk, and through which sides.
    var first = start;
    var leave = vec2(1e30);
    for (var axis = 0u; axis < 2u; axis++) {
        if abs(direction[axis]) > 1e-30 {
            let sides = (vec2(0.0, size[axis]) - origin[axis]) / direction[axis];
            first = max(first, min(sides.x, sides.y));
            leave[axis] = max(sides.x, sides.y);
        }
    }
    let side = select(1u, 0u, leave.x <= leave.y);
    var last = min(end, leave[side]);
    var passage = Passage(no_hit(false), leave[side] <= end, leave[side], vec2(0));
    let there = ray.origin.xy + leave[side] * ray.direction.xy + vec2<f32>(surface.anchor);
    passage.next = vec2<i32>(floor(there));
    passage.next[side] = select(i32(corner.yx[side]) - 1, i32(far_corner.yx[side]), forwards[side] == 1);
    // The other coordinate is in the chunk.
    let other = 1u - side;
    passage.next[other] = clamp(passage.next[other], i32(corner.yx[other]), i32(far_corner.yx[other]) - 1);
    // Only where it is as high as what is in the chunk there is something to meet.
    if abs(ray.direction.z) > 1e-30 {
        let ends = (vec2(draw.low, draw.high) - ray.origin.z) / ray.direction.z;
        first = max(first, min(ends.x, ends.y));
        last = min(last, max(ends.x, ends.y));
    } else if ray.origin.z < draw.low || ray.origin.z > draw.high {
        return passage;
    }
    if !(first <= last) {
        return passage;
    }
    var at = vec2<i32>(clamp(floor(origin + first * direction), vec2(0.0), cells - 1.0));
    let steps = 2 * forwards - 1;
    for (var count = 0u; count < 2u * CHUNK + 2u; count++) {
        let place = vec2<u32>(at.yx);
        let cell = cell_of(draw, place);
        var best = Meeting(vec2(0.0), 1e30, false);
        var best_half: Half;
        for (var slot = 0u; slot < 2u; slot++) {
            let half = half_of(cell.heights, slot);
            if half.exists {
                let met = meeting_of(ray, cell, half);
                if met.is_met && met.depth < best.depth {
                    best = met;
                    best_half = half;
                }
            }
        }
        if best.is_met {
            passage.hit = hit_of(node, place, cell, best_half, best.at, best.depth);
            return passage;
        }
        // To the cell behind the nearer of the two sides that the ray leaves through.
        var leaves = vec2(1e30);
        for (var axis = 0u; axis < 2u; axis++) {
            if abs(direction[axis]) > 1e-30 {
                leaves[axis] = (f32(at[axis] + forwards[axis]) - origin[axis]) / direction[axis];
            }
        }
        let axis = select(1u, 0u, leaves.x <= leaves.y);
        at[axis] += steps[axis];
        if leaves[axis] > last || at[axis] < 0 || f32(at[axis]) >= cells[axis] {
            return passage;
        }
    }
    return passage;
}

/// The chunk that holds a cell of the field, column and row; `NONE` where none is drawn.
fn chunk_at(cell: vec2<i32>) -> u32 {
    var found = surface.tree;
    for (var level = surface.top; found < LEAF; level--) {
        let below = (vec2<u32>(cell.yx) / CHUNK >> vec2(level - 1u)) & vec2(1u);
        found = lists[found + 2u * below.x + below.y];
    }
    return select(found - LEAF, NONE, found == NONE);
}

/// Where a ray first meets the surface from so many of a chunk's cells before a depth on, to so many behind it.
fn walk(node: u32, ray: Ray, depth: f32, before: f32, behind: f32) -> Hit {
    let whole = f32(1u << draws[node].level);
    let speed = max(max(abs(ray.direction.x), abs(ray.direction.y)) / whole, 1e-30);
    var start = max(depth - before / speed, 0.0);
    let end = min(depth + behind / speed, 1e30);
    var chunk = node;
    let from_cell = vec2<i32>(floor(ray.origin.xy + start * ray.direction.xy)) + surface.anchor;
    if all(from_cell >= vec2(0)) && all(from_cell < vec2<i32>(surface.last)) {
        let found = chunk_at(from_cell);
        chunk = select(found, node, found == NONE);
    }
    for (var count = 0u; count < CROSSED; count++) {
        let passage = pass_through(chunk, ray, start, end);
        if passage.hit.exists || !passage.leaves {
            return passage.hit;
        }
        // Beyond the rim there is nothing.
        if any(passage.next < vec2(0)) || any(passage.next >= vec2<i32>(surface.last)) {
            return no_hit(false);
        }
        chunk = chunk_at(passage.next);
        if chunk == NONE {
            return no_hit(true);
        }
        start = passage.depth;
    }
    return no_hit(true);
}

/// Where a ray first meets the triangles that a sample is in the cells of.
fn around(node: u32, at: vec2<u32>, ray: Ray) -> Hit {
    let draw = draws[node];
    var hit = no_hit(false);
    for (var k = 0u; k < 4u; k++) {
        let place = at - vec2(1u - (k >> 1u), 1u - (k & 1u));
        // What is before the first one is beyond all.
        if any(place > at) || place.x + 1u >= draw.rows || place.y + 1u >= draw.columns {
            continue;
        }
        let cell = cell_of(draw, place);
        for (var slot = 0u; slot < 2u; slot++) {
            let half = half_of(cell.heights, slot);
            if half.exists {
                let met = meeting_of(ray, cell, half);
                if met.is_met && (!hit.exists || met.depth < hit.depth) {
                    hit = hit_of(node, place, cell, half, met.at, met.depth);
                }
            }
        }
    }
    return hit;
}

/// A number's sample or cell.
fn at_of(number: u32) -> vec2<u32> {
    let within = number & 0x1ffffu;
    if (number >> 17u & 1u) == 0u {
        return vec2(within / 512u, within / 2u % 256u);
    }
    return vec2(within / 257u, within % 257u);
}

/// The place of the surface that a sample of the picture shows: of a point, where its ray meets what the point belongs to.
fn look(number: u32, place: vec2<f32>) -> Hit {
    let node = number >> 18u;
    let at = at_of(number);
    let ray = ray_at(place);
    if (number >> 17u & 1u) == 0u {
        return hit_triangle(node, at, number & 1u, ray);
    }
    let draw = draws[node];
    let first = sample_at(draw, at);
    let height = height_of(draw, at);
    let depth = camera_of(first, height).z;
    if !is_lone(draw, at) {
        var hit = around(node, at, ray);
        if !hit.exists {
            hit = walk(node, ray, depth, WIDE, ENDLESS);
        }
        // It may pass by what the point is of, and by all else; where that is not known the point is shown.
        if hit.exists || !hit.is_beside {
            return hit;
        }
    }
    var hit = Hit(node, depth, first, vec2(0.0), height, vec2(0.0), 1.0, true, false);
    hit.slope = slope_of(normal_of(draw.start, draw.rows * draw.columns, at.x * draw.columns + at.y));
    // What lies under the middle of the sample of the picture, unless that plane is seen from its edge.
    let place_of_sample = vec2<f32>(vec2<i32>(first.yx) - surface.anchor);
    let plane = height + dot(hit.slope, ray.origin.xy - place_of_sample);
    let along = (plane - ray.origin.z) / (ray.direction.z - dot(hit.slope, ray.direction.xy));
    let beside = (ray.origin.xy + along * ray.direction.xy - place_of_sample).yx;
    if all(abs(beside) <= vec2(2.0 * exp2(max(level_at(depth), 0.0)))) {
        hit.within = beside;
        hit.height = ray.origin.z + along * ray.direction.z;
    }
    hit.coverage = point_coverage(hit, at);
    return hit;
}

/// What a column and a row add to the height on a plane of this normal.
fn slope_of(normal: vec3<f32>) -> vec2<f32> {
    return -normal.xy / (max(normal.z, 1e-6) * surface.true_lift) * surface.step;
}

fn normal_of(first: u32, count: u32, index: u32) -> vec3<f32> {
    let along = unpack2x16snorm(words[first + count + index]);
    let up = f32(words[first + 2u * count + index] & 0xffffu) / 65535.0;
    return vec3(along, up);
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
    let whole = floor(within);
    let at = vec2<u32>(max(vec2<i32>(first) + vec2<i32>(whole), vec2(0)));
    let index = min(max(at >> vec2(level), begin) - begin, size - 2u);
    let last = surface.last.yx;
    let low = min((begin + index) << vec2(level), last);
    let high = min((begin + index + 1u) << vec2(level), last);
    let apart = vec2<f32>(high - low);
    let share = clamp((vec2<f32>(vec2<i32>(at) - vec2<i32>(low)) + within - whole) / apart, vec2(0.0), vec2(1.0));
    let other = 1.0 - share;
    let weights = vec4(other.x * other.y, other.x * share.y, share.x * other.y, share.x * share.y);
    return Between(start, size.x * size.y, index.x * size.y + index.y, size.y, weights, apart, true);
}

fn index_of(four: Between, k: u32) -> u32 {
    return four.index + (k >> 1u) * four.columns + (k & 1u);
}

fn share_of(four: Between, index: u32) -> f32 {
    return f32(words[four.start + 2u * four.count + index] >> 16u & 255u) / 255.0;
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

/// The share of a sample of the picture that is covered where a point is drawn.
fn point_coverage(hit: Hit, at: vec2<u32>) -> f32 {
    let draw = draws[hit.node];
    let level = level_at(hit.depth);
    var own = coverage_of(draw, at);
    if draw.level == 0u && (level <= 0.0 || is_lone(draw, at)) {
        return 1.0;
    }
    if level <= 0.0 {
        return own;
    }
    let levels = levels_of(draw, level);
    var fine = covered(draw, u32(levels.x), hit);
    if fine < 0.0 {
        fine = own;
    }
    if levels.y > 0.0 {
        let coarse = covered(draw, u32(levels.x) + 1u, hit);
        fine = mix(fine, select(fine, coarse, coarse >= 0.0), levels.y);
    }
    // What of a pixel's size is in the field.
    let side = exp2(level) * surface.spacing / abs(surface.step.yx);
    let place = vec2<f32>(hit.first) + hit.within;
    let inside = clamp((min(place + 0.5 * side, vec2<f32>(surface.last.yx)) - max(place - 0.5 * side, vec2(0.0))) / side, vec2(0.0), vec2(1.0));
    return max(inside.x * inside.y * fine, 1.0 / 255.0);
}

/// What a place looks like.
struct Texel {
    normal: vec3<f32>,
    height: f32,
    planes: vec3<f32>,
    curvature: f32,
    exists: bool,
}

/// Linear light of an encoded colour.
fn decoded(color: vec3<f32>) -> vec3<f32> {
    return select(pow((color + 0.055) / 1.055, vec3(2.4)), color / 12.92, color <= vec3(0.04045));
}

fn texel_at(hit: Hit, level: u32) -> Texel {
    let four = between(draws[hit.node], level, hit.first, hit.within);
    var texel = Texel(vec3(0.0), 0.0, vec3(0.0), 0.0, false);
    if !four.exists {
        return texel;
    }
    var sum = 0.0;
    var leans: array<vec2<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        let index = index_of(four, k);
        let normal = normal_of(four.start, four.count, index);
        leans[k] = normal.xy / max(normal.z, 1e-6);
        let weight = four.weights[k] * share_of(four, index);
        if weight <= 0.0 {
            continue;
        }
        sum += weight;
        texel.normal += weight * normal;
        texel.height += weight * bitcast<f32>(words[four.start + index]);
        if surface.colored_by >= PLANE {
            texel.planes += weight * decoded(unpack4x8unorm(words[four.start + 3u * four.count + index]).xyz);
        }
    }
    if sum <= 0.0 {
        return texel;
    }
    texel.normal /= sum;
    texel.planes /= sum;
    texel.height = select(texel.height / sum, hit.height, level == 0u);
    let across = 0.5 * (leans[1].x + leans[3].x - leans[0].x - leans[2].x) / (surface.step.x * four.apart.y);
    let along = 0.5 * (leans[2].y + leans[3].y - leans[0].y - leans[1].y) / (surface.step.y * four.apart.x);
    texel.curvature = 0.5 * (across + along);
    texel.exists = true;
    return texel;
}

/// What a hit looks like at the distance of its samples.
fn texel_of(hit: Hit) -> Texel {
    let draw = draws[hit.node];
    let wanted = level_at(hit.depth) - FINER;
    let levels = levels_of(draw, wanted);
    var texel = texel_at(hit, u32(levels.x));
    if !texel.exists {
        texel = Texel(vec3(0.0, 0.0, 1.0), hit.height, vec3(0.0), 0.0, true);
    }
    if levels.y > 0.0 {
        let coarse = texel_at(hit, u32(levels.x) + 1u);
        if coarse.exists {
            texel.normal = mix(texel.normal, coarse.normal, levels.y);
            texel.height = mix(texel.height, coarse.height, levels.y);
            texel.planes = mix(texel.planes, coarse.planes, levels.y);
            texel.curvature = mix(texel.curvature, coarse.curvature, levels.y);
        }
    }
    let level = levels.x + levels.y;
    if wanted < level {
        // A sample stands for more than is seen here.
        texel.height = hit.height + exp2(wanted - level) * (texel.height - hit.height);
    }
    return texel;
}

const HEIGHT: u32 = 0u;
const SLOPE: u32 = 1u;
const ASPECT: u32 = 2u;
const CURVATURE: u32 = 3u;
const LEVEL: u32 = 4u;
const PRIMITIVE: u32 = 5u;
const PLANE: u32 = 6u;
const TEXTURE: u32 = 7u;

/// The colour of a value. Heights count from the reference.
fn colored(value: f32) -> vec3<f32> {
    var place = (value - surface.low) * surface.per;
    if surface.is_log != 0u {
        let all = select(value, value + surface.reference, surface.colored_by == HEIGHT);
        place = select(0.0, (log(max(all, 1e-37)) - surface.low) * surface.per, all > 0.0);
    }
    let at = clamp(place, 0.0, 1.0) * f32(surface.ramp_last);
    let index = min(u32(at), max(surface.ramp_last, 1u) - 1u);
    let next = min(index + 1u, surface.ramp_last);
    return mix(ramp[index].rgb, ramp[next].rgb, at - f32(index));
}

/// The complementary error function (Abramowitz and Stegun 7.1.26).
fn erfc(x: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.3275911 * abs(x));
    let tail = ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t * exp(-x * x);
    return select(tail, 2.0 - tail, x < 0.0);
}

/// The mean of a normal distribution's positive part, and the share of it that is positive.
fn positive(mean: f32, deviation: f32) -> vec2<f32> {
    if deviation <= 1e-5 * abs(mean) {
        return vec2(max(mean, 0.0), select(0.0, 1.0, mean > 0.0));
    }
    let place = mean / deviation;
    let share = 0.5 * erfc(-place * 0.70710678);
    return vec2(mean * share + deviation * exp(-0.5 * place * place) * 0.39894228, share);
}

/// The mean light on what is seen of facets of a mean normal (crates/draw/src/cpu/surface/lambert.rs).
fn lit(normal: vec3<f32>, towards: vec3<f32>, eye: vec3<f32>) -> f32 {
    let steeper = surface.steeper;
    var up = max(normal.z, 1e-6);
    let slope = normal.xy / up;
    var variance = max(0.5 * (1.0 / (up * up) - dot(slope, slope) - 1.0), 0.0);
    // Of facets that are alike rounding leaves this.
    variance = select(variance, 0.0, variance * up * up < 1e-4) * steeper * steeper;
    let steep = vec3(slope * steeper, 1.0);
    if steeper != 1.0 {
        up = inverseSqrt(dot(steep, steep) + 2.0 * variance);
    }
    let turned = select(1.0, -1.0, dot(steep, eye) < 0.0);
    let shown = positive(turned * dot(steep, eye), sqrt(variance * dot(eye.xy, eye.xy)));
    if shown.x <= 0.0 {
        return 0.0;
    }
    let mean = turned * dot(steep, towards);
    var bright = vec2(mean, 1.0);
    if surface.is_sun != 0u {
        bright = positive(mean, sqrt(variance * dot(towards.xy, towards.xy)));
    }
    let across = variance * dot(towards.xy, eye.xy);
    return clamp(up * (bright.x + across * shown.y * bright.y / shown.x), 0.0, 1.0);
}

/// How much of a sample is line: see `Contours::share`.
fn line_share(number: f32, away: f32, change: f32) -> f32 {
    if change <= 0.0 {
        return 0.0;
    }
    var strength = 1.0;
    var all_lines = 1.0;
    let major = f32(surface.contour_major);
    if surface.contour_major > 1u {
        all_lines = MINOR + (1.0 - MINOR) / major;
        strength = select(MINOR, 1.0, abs(number - major * round(number / major)) < 0.5);
    }
    let apart = surface.contour_interval / change;
    let size = 1.0 / f32(surface.parts);
    let line = strength * clamp((0.5 * surface.contour_width - away) / (2.0 * EDGE * size) + 0.5, 0.0, 1.0);
    let mean = all_lines * min(surface.contour_width / apart, 0.5);
    let single = clamp(apart / surface.contour_width - 1.0, 0.0, 1.0);
    return mix(mean, line, single);
}

/// The height of a hit's plane where another place's ray meets it, and whether that is in front of the eye.
fn plane_height(hit: Hit, place: vec2<f32>) -> vec2<f32> {
    let ray = ray_at(place);
    let at = vec2<f32>(vec2<i32>(hit.first.yx) - surface.anchor) + hit.within.yx;
    let plane = hit.height + dot(hit.slope, ray.origin.xy - at);
    let depth = (plane - ray.origin.z) / (ray.direction.z - dot(hit.slope, ray.direction.xy));
    let is_ahead = depth > 0.0 && depth < 1e30;
    return vec2(ray.origin.z + depth * ray.direction.z, select(0.0, 1.0, is_ahead));
}

/// How much of a place is a line of equal height.
fn line_at(hit: Hit, place: vec2<f32>) -> f32 {
    let number = round((hit.height - surface.contour_base) / surface.contour_interval);
    let nearest = surface.contour_base + number * surface.contour_interval;
    let right = plane_height(hit, place + vec2(0.25, 0.0));
    let below = plane_height(hit, place + vec2(0.0, 0.25));
    if right.y * below.y == 0.0 {
        return line_share(number, 0.0, 1e30);
    }
    let rise = vec2(right.x - hit.height, below.x - hit.height) / 0.25;
    let steep = length(rise);
    var away = abs(nearest - hit.height) / max(steep, 1e-37);
    let parts = f32(surface.parts);
    let width = surface.contour_width * parts;
    let share = away / width;
    // Where the line is told to be the surface may have another slope: by secants to where it is.
    if surface.contour_interval > width * steep && share >= 0.02 && share < REACH {
        let along = rise / max(steep, 1e-37) * sign(nearest - hit.height);
        var last = vec2(0.0, hit.height);
        var is_found = false;
        for (var k = 0u; k < SECANTS; k++) {
            let there = walk(hit.node, ray_at(place + along * away), hit.depth, WIDE, ENDLESS);
            if !there.exists {
                break;
            }
            let next = away + (nearest - there.height) * (away - last.x) / (there.height - last.y);
            if !(next > 0.0 && next < 1e30) {
                break;
            }
            last = vec2(away, there.height);
            away = clamp(next, 0.25 * away, 4.0 * away);
            if abs(next - last.x) < 0.02 {
                is_found = true;
                break;
            }
        }
        // The surface ends before.
        if !is_found {
            away = 1e30;
        }
    }
    return line_share(number, away / parts, steep * parts);
}

/// The colour of a hit at a place of the picture: linear light, premultiplied.
fn color_of(hit: Hit, place: vec2<f32>) -> vec4<f32> {
    let draw = draws[hit.node];
    let texel = texel_of(hit);
    let normal = texel.normal;
    var plain: vec3<f32>;
    switch surface.colored_by {
        case 1u: { plain = colored(degrees(atan2(length(normal.xy), normal.z))); }
        case 2u: {
            let angle = degrees(atan2(normal.x, normal.y));
            plain = colored(angle + select(0.0, 360.0, angle < 0.0));
        }
        case 3u: { plain = colored(texel.curvature); }
        case 4u: { plain = colored(f32(draw.level)); }
        case 5u: { plain = colored(select(1.0, 0.0, (draw.flags & POINTS) != 0u)); }
        case 6u: { plain = colored(texel.planes.x); }
        case 7u: { plain = texel.planes; }
        default: { plain = colored(texel.height); }
    }
    var toward = -surface.world_forward;
    if surface.perspective != 0u {
        let across = vec2(place.x - surface.middle.x, surface.middle.y - place.y) / surface.focal;
        toward = -normalize(across.x * surface.world_right + across.y * surface.world_up + surface.world_forward);
    }
    let bright = lit(normal, select(toward, surface.sun, surface.is_sun != 0u), toward);
    var color = plain * (surface.ambient + (1.0 - surface.ambient) * bright);
    if surface.contour_interval > 0.0 {
        color = mix(color, surface.contour_color, line_at(hit, place));
    }
    let alpha = hit.coverage * exp(-surface.fade_rate * max(hit.depth - surface.fade_start, 0.0));
    return vec4(color * alpha, alpha);
}

fn number_at(at: vec2<u32>) -> u32 {
    return ~numbers[at.y * surface.stride + at.x];
}

/// Whether a surface without holes ends in a pixel or next to it.
fn is_end(corner: vec2<u32>) -> bool {
    var hits = false;
    var misses = false;
    let low = max(corner, vec2(1u)) - 1u;
    let high = min(corner + surface.parts + 1u, surface.size);
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let number = number_at(vec2(x, y));
            if number == NONE {
                misses = true;
            } else if (draws[number >> 18u].flags & MIXED) != 0u {
                return false;
            } else {
                hits = true;
            }
        }
    }
    return hits && misses;
}

/// The colour of a pixel in which a surface ends: of more rays, each about the sample nearest to it that shows something.
fn end_of(corner: vec2<u32>) -> vec4<f32> {
    let low = max(corner, vec2(1u)) - 1u;
    let high = min(corner + surface.parts + 1u, surface.size);
    var sum = vec4(0.0);
    for (var ray = 0u; ray < ENDS * ENDS; ray++) {
        let share = (vec2(f32(ray % ENDS), f32(ray / ENDS)) + 0.5) / f32(ENDS);
        let place = vec2<f32>(corner) + share * f32(surface.parts);
        var number = NONE;
        var at = vec2(0.0);
        var best = 1e30;
        for (var y = low.y; y < high.y; y++) {
            for (var x = low.x; x < high.x; x++) {
                let found = number_at(vec2(x, y));
                let middle = vec2(f32(x), f32(y)) + 0.5;
                let away = distance(middle, place);
                if found != NONE && away < best {
                    best = away;
                    number = found;
                    at = middle;
                }
            }
        }
        let near = look(number, at);
        if !near.exists {
            continue;
        }
        let hit = walk(near.node, ray_at(place), near.depth, WIDE, ENDLESS);
        if hit.exists {
            sum += color_of(hit, place);
        }
    }
    return sum / f32(ENDS * ENDS);
}

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) pixel: vec3<u32>) {
    let parts = surface.parts;
    let pixels = surface.size / parts;
    if any(pixel.xy >= pixels) {
        return;
    }
    let corner = pixel.xy * parts;
    var color = vec4(0.0);
    if parts > 1u && is_end(corner) {
        color = end_of(corner);
    } else {
        for (var y = corner.y; y < corner.y + parts; y++) {
            for (var x = corner.x; x < corner.x + parts; x++) {
                let number = number_at(vec2(x, y));
                if number != NONE {
                    let place = vec2(f32(x), f32(y)) + 0.5;
                    let hit = look(number, place);
                    if hit.exists {
                        color += color_of(hit, place);
                    }
                }
            }
        }
        color /= f32(parts * parts);
    }
    light[pixel.y * pixels.x + pixel.x] = color;
}
