// What a surface looks like at each pixel: the colours of the places that its samples show. One invocation for each pixel.
//
// What a picture does not need is left out, as it takes long to compile: a photo (PHOTO), rims of holes (RIMS), a membrane over them (FILLED), and
// the sides of the field (WALLS).
#import deepfield::surface_constants::{ENDS, NONE, MIXED}
#import deepfield::surface_light::color_of
#import deepfield::surface_look::{look, number_at}
#import deepfield::surface_ray::{no_hit, ray_at, walk, WIDE, ENDLESS}
#import deepfield::surface_view::{surface, draws, fade_at}
#ifdef WALLS
#import deepfield::surface_wall::wall_of
#endif

@group(1) @binding(2) var<storage, read_write> light: array<vec4<f32>>;
/// How much of each pixel is covered by what was measured.
@group(1) @binding(4) var<storage, read_write> measured: array<f32>;

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

/// What a ray is looked for about: what a sample of the picture shows, and where that is.
struct Start {
    number: u32,
    place: vec2<f32>,
}

/// The sample nearest to a place of a pixel that shows something.
fn nearest_to(place: vec2<f32>, corner: vec2<u32>) -> Start {
    let low = max(corner, vec2(1u)) - 1u;
    let high = min(corner + surface.parts + 1u, surface.size);
    var start = Start(NONE, vec2(0.0));
    var best = 1e30;
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let found = number_at(vec2(x, y));
            let middle = vec2(f32(x), f32(y)) + 0.5;
            let away = distance(middle, place);
            if found != NONE && away < best {
                best = away;
                start = Start(found, middle);
            }
        }
    }
    return start;
}

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) pixel: vec3<u32>) {
    let parts = surface.parts;
    let pixels = surface.size / parts;
    if any(pixel.xy >= pixels) {
        return;
    }
    let corner = pixel.xy * parts;
#ifdef GLOBE
    let is_ending = false;
#else
    // Where the surface ends there are more rays, each about the sample nearest to it that shows something.
    let is_ending = parts > 1u && is_end(corner);
#endif
    let along = select(parts, ENDS, is_ending);
    var color = vec4(0.0);
    var share = 0.0;
    for (var ray = 0u; ray < along * along; ray++) {
        let at = vec2(ray % along, ray / along);
        var place = vec2<f32>(corner + at) + 0.5;
        var start: Start;
        if is_ending {
            place = vec2<f32>(corner) + (vec2<f32>(at) + 0.5) / f32(ENDS) * f32(parts);
            start = nearest_to(place, corner);
        } else {
            start = Start(number_at(corner + at), place);
        }
        var hit = no_hit(false);
        if start.number != NONE {
            hit = look(start.number, start.place);
#ifndef GLOBE
            if is_ending && hit.exists {
                hit = walk(hit.node, ray_at(place), hit.depth, WIDE, ENDLESS);
            }
#endif
        }
#ifdef WALLS
        let wall = wall_of(place, select(1e30, hit.depth, hit.exists));
        if wall.exists {
            color += wall.color;
            continue;
        }
#endif
        if hit.exists {
            color += color_of(hit, place);
            share += select(hit.coverage * fade_at(hit.depth), 0.0, hit.is_membrane || hit.is_pole);
        }
    }
    let index = pixel.y * pixels.x + pixel.x;
    light[index] = color / f32(along * along);
    measured[index] = share / f32(along * along);
}
