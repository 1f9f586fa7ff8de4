// What a surface looks like at each pixel: the colours of the places that its samples show. One invocation for each pixel.
#import deepfield::surface_constants::ENDS
#import deepfield::surface_levels::{level_at, normal_of, point_coverage, slope_of}
#import deepfield::surface_light::color_of
#import deepfield::surface_ray::{Hit, around, hit_triangle, ray_at, walk, WIDE, ENDLESS}
#import deepfield::surface_view::{surface, draws, sample_at, height_of, is_lone, camera_of, NONE, MIXED}

/// What each sample shows, inverted: 0 is nothing.
@group(1) @binding(0) var<storage, read> numbers: array<u32>;
@group(1) @binding(2) var<storage, read_write> light: array<vec4<f32>>;

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
