// Where lines of sight meet measured heights that are flat (crates/draw/src/cpu/surface/rays.rs).
//
// Where the processor casts a ray through all of the surface, these follow it over cells from a little before what a sample shows.
#define_import_path deepfield::surface_ray
#import deepfield::surface_constants::{CHUNK, NONE, LEAF, MIXED}
#import deepfield::surface_view::{surface, draws, lists, Draw, coverage_at, sample_at, camera_of, from_eye, quad_of, half_of, Half, Quad}

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
    /// A point: how far from the middle of the sample of the picture it is seen.
    aside: vec2<f32>,
    exists: bool,
    /// Where there is none: whether there may be one all the same, beyond chunks that are not drawn.
    is_beside: bool,
    /// Whether it is a sample's own place.
    is_point: bool,
    /// Whether it is of a membrane over a hole, and no data.
    is_membrane: bool,
    /// Whether it is between the field and a pole of its globe, and no data.
    is_pole: bool,
}

fn no_hit(is_beside: bool) -> Hit {
    return Hit(0u, 0.0, vec2(0u), vec2(0.0), 0.0, vec2(0.0), 0.0, vec2(0.0), false, is_beside, false, false, false);
}

/// A cell as rays meet it: its corners, where it begins, and how many rows and columns it is.
struct Cell {
    quad: Quad,
    first: vec2<u32>,
    size: vec2<f32>,
}

fn cell_of(draw: Draw, at: vec2<u32>) -> Cell {
    let first = sample_at(draw, at);
    let next = sample_at(draw, at + 1u);
    return Cell(quad_of(draw, at), first, vec2<f32>(next - first));
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
    let plane = plane_of(cell.quad.heights, half);
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
    return f32(coverage_at(draw, at)) / 255.0;
}

/// The share of a place of a coarse chunk's cell that is covered (crates/draw/src/cpu/surface/coverage.rs): columns, rows, and how many rows and columns
/// the cell is.
fn share_between(draw: Draw, at: vec2<u32>, place: vec2<f32>, size: vec2<f32>) -> f32 {
    let upper = vec2(coverage_of(draw, at), coverage_of(draw, at + vec2(0u, 1u)));
    let lower = vec2(coverage_of(draw, at + vec2(1u, 0u)), coverage_of(draw, at + vec2(1u, 1u)));
    let within = clamp(place, vec2(0.0), vec2(1.0));
    if min(min(upper.x, upper.y), min(lower.x, lower.y)) <= 0.0 {
        let beyond = within * size.yx >= vec2(0.5 * f32(1u << draw.level));
        let nearest = select(upper, lower, beyond.y);
        return select(nearest.x, nearest.y, beyond.x);
    }
    let sides = mix(vec2(upper.x, lower.x), vec2(upper.y, lower.y), vec2(within.x));
    return mix(sides.x, sides.y, within.y);
}

/// The hit of a ray that meets a triangle.
fn hit_of(node: u32, at: vec2<u32>, cell: Cell, half: Half, place: vec2<f32>, depth: f32) -> Hit {
    let draw = draws[node];
    let plane = plane_of(cell.quad.heights, half);
    var coverage = 1.0;
    if !half.is_membrane && draw.level > 0u && (draw.flags & MIXED) != 0u {
        coverage = max(share_between(draw, at, place, cell.size), 1.0 / 255.0);
    }
    let height = plane.x + dot(plane.yz, place);
    let slope = plane.yz / cell.size.yx;
    let within = place.yx * cell.size;
    return Hit(node, depth, cell.first, within, height, slope, coverage, vec2(0.0), true, false, false, half.is_membrane, false);
}

/// The place on a triangle that a sample shows.
fn hit_triangle(node: u32, at: vec2<u32>, slot: u32, ray: Ray) -> Hit {
    let cell = cell_of(draws[node], at);
    let half = half_of(cell.quad, slot);
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
    let plane = plane_of(cell.quad.heights, half);
    let camera = camera_at(cell.first, place.yx * cell.size, plane.x + dot(plane.yz, place));
    return hit_of(node, at, cell, half, place, camera.z);
}

/// A place of a flat surface in the camera's coordinates.
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

/// Follows a ray through a chunk between two depths, as far as it is in a part of it.
fn pass_through(node: u32, ray: Ray, start: f32, end: f32, part: vec2<f32>) -> Passage {
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
            let half = half_of(cell.quad, slot);
            if half.exists {
                let met = meeting_of(ray, cell, half);
                if met.is_met && met.depth < best.depth && met.depth >= part.x && met.depth <= part.y {
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
    var at = vec2<u32>(cell.yx);
#ifdef GLOBE
    // What closes a globe is in the same chunk as the column before it.
    at.y = min(at.y, surface.open - 1u);
#endif
    var found = surface.tree;
    for (var level = surface.top; found < LEAF; level--) {
        let below = (at / CHUNK >> vec2(level - 1u)) & vec2(1u);
        found = lists[found + 2u * below.x + below.y];
    }
    return select(found - LEAF, NONE, found == NONE);
}

/// The depths between which a ray is in the box outside of which nothing is drawn.
fn kept_of(ray: Ray) -> vec2<f32> {
    return kept_in(ray, surface.box_min, surface.box_max);
}

/// The same of the line of sight through a place of the picture, whatever the surface stands on.
fn kept_at(place: vec2<f32>) -> vec2<f32> {
    let origin = from_eye(place, 0.0);
    return kept_in(Ray(origin, from_eye(place, 1.0) - origin), surface.clip_min, surface.clip_max);
}

/// The same of a ray and a box that have the same coordinates.
fn kept_in(ray: Ray, low: vec3<f32>, high: vec3<f32>) -> vec2<f32> {
    var part = vec2(0.0, 1e30);
    if surface.clips == 0u {
        return part;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        let away = vec2(low[axis], high[axis]) - ray.origin[axis];
        if abs(ray.direction[axis]) > 1e-30 {
            let ends = away / ray.direction[axis];
            part = vec2(max(part.x, min(ends.x, ends.y)), min(part.y, max(ends.x, ends.y)));
        } else if away.x > 0.0 || away.y < 0.0 {
            part.y = -1.0;
        }
    }
    return part;
}

/// Where a ray first meets the surface from so many of a chunk's cells before a depth on, to so many behind it.
fn walk(node: u32, ray: Ray, depth: f32, before: f32, behind: f32) -> Hit {
    let whole = f32(1u << draws[node].level);
    let speed = max(max(abs(ray.direction.x), abs(ray.direction.y)) / whole, 1e-30);
    let part = kept_of(ray);
    var start = max(depth - before / speed, part.x);
    let end = min(depth + behind / speed, part.y);
    var chunk = node;
    let from_cell = vec2<i32>(floor(ray.origin.xy + start * ray.direction.xy)) + surface.anchor;
    if all(from_cell >= vec2(0)) && all(from_cell < vec2<i32>(surface.last)) {
        let found = chunk_at(from_cell);
        chunk = select(found, node, found == NONE);
    }
    for (var count = 0u; count < CROSSED; count++) {
        let passage = pass_through(chunk, ray, start, end, part);
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
            let half = half_of(cell.quad, slot);
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
