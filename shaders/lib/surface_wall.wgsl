// The sides of what is drawn of a flat field, down or up to a base (crates/draw/src/cpu/surface/walls.rs).
#define_import_path deepfield::surface_wall
#import deepfield::surface_constants::{NONE, WALL}
#import deepfield::surface_ray::{OUTSIDE, cell_of, chunk_at, plane_of, ray_at, weights_of}
#import deepfield::surface_view::{surface, draws, fade_at, half_of, sample_at}

/// The colour of a wall: linear light, premultiplied; and whether there is one.
struct Wall {
    color: vec4<f32>,
    exists: bool,
}

/// The height of the drawn surface over a column and a row of the field, and whether there is any.
fn top_at(place: vec2<f32>) -> vec2<f32> {
    let last = vec2<i32>(surface.last);
    let at = clamp(place, vec2<f32>(-surface.anchor), vec2<f32>(last - surface.anchor));
    let cell = clamp(vec2<i32>(floor(at)) + surface.anchor, vec2(0), last - 1);
    let node = chunk_at(cell);
    if node == NONE {
        return vec2(0.0);
    }
    let draw = draws[node];
    let within = vec2<u32>(cell.yx - vec2<i32>(sample_at(draw, vec2(0u)))) >> vec2(draw.level);
    let found = cell_of(draw, min(within, vec2(draw.rows, draw.columns) - 2u));
    let inside = (at - vec2<f32>(vec2<i32>(found.first.yx) - surface.anchor)) / found.size.yx;
    for (var slot = 0u; slot < 2u; slot++) {
        let half = half_of(found.quad, slot);
        if half.exists && !half.is_membrane && all(weights_of(half, inside) >= vec3(-OUTSIDE)) {
            let plane = plane_of(found.quad.heights, half);
            return vec2(plane.x + dot(plane.yz, inside), 1.0);
        }
    }
    return vec2(0.0);
}

/// The first wall that is seen at a place of the picture before a depth.
fn wall_of(place: vec2<f32>, before: f32) -> Wall {
    let ray = ray_at(place);
    // Columns and rows that there are in the box.
    let low = vec3(max(vec2<f32>(-surface.anchor), surface.box_min.xy), surface.box_min.z);
    let high = vec3(min(vec2<f32>(vec2<i32>(surface.last) - surface.anchor), surface.box_max.xy), surface.box_max.z);
    if any(low.xy >= high.xy) {
        return Wall(vec4(0.0), false);
    }
    var nearest = before;
    var side = 2u;
    for (var k = 0u; k < 4u; k++) {
        let axis = k >> 1u;
        let at = select(low[axis], high[axis], (k & 1u) == 1u);
        if abs(ray.direction[axis]) < 1e-30 {
            continue;
        }
        let depth = (at - ray.origin[axis]) / ray.direction[axis];
        if !(depth > 0.0 && depth < nearest) {
            continue;
        }
        var there = ray.origin + depth * ray.direction;
        there[axis] = at;
        // Where two walls meet rounding leaves no gap.
        let hair = 1e-6 * depth * abs(ray.direction);
        if any(there < low - hair) || any(there > high + hair) {
            continue;
        }
        let top = top_at(there.xy);
        if top.y > 0.0 && there.z >= min(top.x, surface.wall_base) && there.z <= max(top.x, surface.wall_base) {
            nearest = depth;
            side = axis;
        }
    }
    if side > 1u {
        return Wall(vec4(0.0), false);
    }
    let across = vec2(place.x - surface.middle.x, surface.middle.y - place.y) / surface.focal;
    var way = surface.world_forward;
    if surface.perspective != 0u {
        way += across.x * surface.world_right + across.y * surface.world_up;
    }
    let toward = select(-normalize(way), surface.sun, surface.is_sun != 0u);
    let bright = max(-sign(way[side]) * toward[side], 0.0);
    let alpha = fade_at(nearest);
    return Wall(vec4(WALL * (surface.ambient + (1.0 - surface.ambient) * bright) * alpha, alpha), true);
}
