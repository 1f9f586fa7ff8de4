// What a surface looks like at each pixel: the colours of the places that its samples show. One invocation for each pixel.
#import deepfield::surface_constants::{ENDS, NONE, MIXED}
#import deepfield::surface_light::color_of
#import deepfield::surface_look::{look, number_at}
#import deepfield::surface_ray::{ray_at, walk, WIDE, ENDLESS}
#import deepfield::surface_view::{surface, draws}

@group(1) @binding(2) var<storage, read_write> light: array<vec4<f32>>;

/// Whether a flat surface without holes ends in a pixel or next to it.
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
#ifdef GLOBE
    let is_ending = false;
#else
    let is_ending = parts > 1u && is_end(corner);
    if is_ending {
        color = end_of(corner);
    }
#endif
    if !is_ending {
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
