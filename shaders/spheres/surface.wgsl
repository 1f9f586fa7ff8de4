// From the spheres that pixels show to one smooth surface and its light, as crates/draw/src/cpu/screen_spheres.rs has it, whose comments say
// why. One invocation for each pixel.
#import deepfield::tile_constants::{NEIGHBOUR, WIDEST}
#import deepfield::sphere_view::{SphereView, Hit, FAR}
#import deepfield::tile_view::{TileView, Portion}

@group(0) @binding(0) var<uniform> tiles: TileView;
/// Number of the round: along x if even, along y if odd.
@group(0) @binding(1) var<uniform> round: Portion;
@group(0) @binding(2) var<uniform> spheres: SphereView;
@group(0) @binding(3) var<storage, read> hits: array<Hit>;
@group(0) @binding(4) var<storage, read_write> smoothed: array<Hit>;
/// Colours of attributes or densities, linear light.
@group(0) @binding(5) var<storage, read> gradient: array<vec4<f32>>;
/// Light and opacity of each pixel.
@group(0) @binding(6) var<storage, read_write> light: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn smooth_hits(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if any(pixel.xy >= tiles.size) {
        return;
    }
    let width = tiles.size.x;
    let here = pixel.y * width + pixel.x;
    let center = hits[here];
    if center.depth >= FAR {
        smoothed[here] = center;
        return;
    }
    let pixels = center.radius * tiles.focal / select(1.0, center.depth, tiles.perspective != 0u);
    let reach = clamp(pixels * spheres.smoothing, 1.0, WIDEST);
    let along_x = (round.length & 1u) == 0u;
    let at = select(pixel.y, pixel.x, along_x);
    let size = select(tiles.size.y, width, along_x);
    let stride = select(width, 1u, along_x);
    let base = here - at * stride;
    let steps = u32(ceil(reach));
    var sum = vec3(0.0);
    var total = 0.0;
    for (var k = at - min(at, steps); k < min(at + steps + 1u, size); k++) {
        let hit = hits[base + k * stride];
        let away = (hit.depth - center.depth) / (NEIGHBOUR * center.radius);
        if abs(away) < 1.0 {
            let share = abs(f32(k) - f32(at)) / (reach + 1.0);
            let root = max(1.0 - share * share, 0.0) * (1.0 - away * away);
            let weight = root * root;
            sum += weight * vec3(hit.depth - center.depth, hit.density, hit.quantity);
            total += weight;
        }
    }
    let mean = sum / max(total, 1.0e-37);
    smoothed[here] = Hit(center.depth + mean.x, center.radius, mean.y, mean.z);
}

/// Where a pixel's line of sight is at a depth.
fn place_of(pixel: vec2<u32>, depth: f32) -> vec3<f32> {
    let slope = (vec2<f32>(pixel) + 0.5 - tiles.middle) / tiles.focal * vec2(1.0, -1.0);
    return vec3(slope * select(1.0, depth, tiles.perspective != 0u), depth);
}

/// A step on the surface to a neighbour, and how much deeper or nearer that is; FAR where it is of another surface.
fn step_to(pixel: vec2<u32>, center: Hit, here: vec3<f32>, sign: f32) -> vec4<f32> {
    let depth = hits[pixel.y * tiles.size.x + pixel.x].depth;
    let away = abs(depth - center.depth);
    if away < NEIGHBOUR * center.radius {
        return vec4((place_of(pixel, depth) - here) * sign, away);
    }
    return vec4(0.0, 0.0, 0.0, FAR);
}

/// The step along an axis: to the neighbour before or behind whose depth is nearer, for the other one may be another surface.
fn step_along(pixel: vec2<u32>, axis: vec2<u32>, center: Hit, here: vec3<f32>) -> vec4<f32> {
    var before = vec4(0.0, 0.0, 0.0, FAR);
    var behind = before;
    if dot(pixel, axis) > 0u {
        before = step_to(pixel - axis, center, here, -1.0);
    }
    if all(pixel + axis < tiles.size) {
        behind = step_to(pixel + axis, center, here, 1.0);
    }
    if before.w < behind.w {
        return before;
    }
    return behind;
}

/// The cosine between a pixel's line of sight and the surface's normal.
fn cosine_at(pixel: vec2<u32>, center: Hit) -> f32 {
    let here = place_of(pixel, center.depth);
    let across = step_along(pixel, vec2(1u, 0u), center, here);
    let down = step_along(pixel, vec2(0u, 1u), center, here);
    if max(across.w, down.w) >= FAR {
        // A surface of one pixel's width: its edge.
        return 0.0;
    }
    // Of a pixel's width, so that squares do not vanish.
    let scale = tiles.focal / select(1.0, center.depth, tiles.perspective != 0u);
    let normal = cross(across.xyz * scale, down.xyz * scale);
    let ray = normalize(select(vec3(0.0, 0.0, 1.0), place_of(pixel, 1.0), tiles.perspective != 0u));
    let length_squared = dot(normal, normal);
    return select(0.0, abs(dot(normal, ray)) * inverseSqrt(length_squared), length_squared > 0.0);
}

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if any(pixel.xy >= tiles.size) {
        return;
    }
    let at = pixel.y * tiles.size.x + pixel.x;
    let hit = hits[at];
    if hit.depth >= FAR {
        light[at] = vec4(0.0);
        return;
    }
    var value = select(hit.density, hit.quantity, spheres.of_attribute != 0u);
    var known = true;
    if spheres.log_scale != 0u {
        known = value > 0.0;
        value = log2(max(value, 1.0e-37));
    }
    let place = select(0.0, clamp(fma(value, spheres.color_map.x, spheres.color_map.y), 0.0, 1.0), known);
    var color = gradient[u32(floor(place * spheres.last_color + 0.5))].rgb;
    if spheres.lit != 0u {
        let cosine = min(cosine_at(pixel.xy, hit), 1.0);
        let highlight = spheres.specular * pow(cosine, spheres.shininess);
        color = color * (spheres.ambient + (1.0 - spheres.ambient) * cosine) + highlight;
    }
    light[at] = vec4(color, 1.0);
}
