// Sums each layer's splats for each pixel, classifies the layer's mean density, and blends it under what is in front of it (F12
// 5.10), as src/cpu/layered/mod.rs does. One invocation for each pixel.
#import deepfield::layer_view::{LayerView, Part, KIND_BITS, INSIDE}
#import deepfield::matter::matter_of
#import deepfield::splat_pixel::{Lens, integrated, sampled}
#import deepfield::splat_view::{Splat, SMALL}
#import deepfield::tile_view::{front_of, line_through}
#import deepfield::tile_walk::{tiles, progress, Walk, begin_walk, head_of, advance, is_spent, NONE}

/// What a pixel has of the layer that is being summed.
struct Pending {
    layer: u32,
    /// Column density, and that times the attribute.
    sums: vec2<f32>,
}

@group(0) @binding(4) var<storage, read> arranged: array<Part>;
@group(1) @binding(2) var<uniform> layered: LayerView;
/// Layer, and the bits of both sums, of each pixel.
@group(1) @binding(3) var<storage, read_write> pending: array<vec4<u32>>;
/// Light and opacity of each pixel.
@group(1) @binding(4) var<storage, read_write> light: array<vec4<f32>>;

/// Blends a layer under a ray, whose way through layers is longer than the middle one's by the secant.
fn under(ray: vec4<f32>, layer: Pending, secant: f32) -> vec4<f32> {
    let distance = (front_of(tiles, layer.layer + 1u) - front_of(tiles, layer.layer)) * secant;
    let density = layer.sums.x / distance;
    if !(density > layered.least) {
        return ray;
    }
    let matter = matter_of(density, layer.sums.y / layer.sums.x);
    let share = (1.0 - ray.a) * (1.0 - exp(-matter.a * distance));
    return ray + share * vec4(matter.rgb, 1.0);
}

fn pending_at(at: u32) -> Pending {
    let bits = pending[at];
    return Pending(bits.x, bitcast<vec2<f32>>(bits.yz));
}

@compute @workgroup_size(8, 8)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(global_invocation_id) pixel: vec3<u32>) {
    let tile = group.y * ((tiles.size.x + 7u) / 8u) + group.x;
    let start = progress[tile];
    workgroupBarrier();
    if any(pixel.xy >= tiles.size) || start == NONE {
        return;
    }
    let at = pixel.y * tiles.size.x + pixel.x;
    var ray = light[at];
    let termination = layered.termination;
    if ray.a >= termination {
        return;
    }
    let secant = inverseSqrt(line_through(tiles, pixel.xy).inverse);
    let lens = Lens(tiles.middle, tiles.focal, tiles.perspective);
    let place = vec2<f32>(pixel.xy) + 0.5;
    var layer = pending_at(at);
    var walk: Walk;
    begin_walk(&walk, group.xy, start);
    var head = head_of(&walk);
    while head != NONE && !is_spent(&walk) {
        let part = arranged[head];
        let own = part.tag >> KIND_BITS;
        if own != layer.layer {
            ray = under(ray, layer, secant);
            layer = Pending(own, vec2(0.0));
            if ray.a >= termination {
                break;
            }
        }
        let kind = part.tag & (INSIDE - 1u);
        let splat = Splat(part.head, vec4(part.tail, select(1.0, -1.0, (part.tag & INSIDE) != 0u)));
        if kind == SMALL {
            layer.sums += integrated(splat, place) * splat.tail.yz;
        } else {
            layer.sums += sampled(splat, lens, place, kind) * splat.tail.yz;
        }
        advance(&walk);
        head = head_of(&walk);
    }
    light[at] = ray;
    pending[at] = vec4(layer.layer, bitcast<vec2<u32>>(layer.sums), 0u);
    // All pixels that go on have come equally far.
    if ray.a < termination {
        progress[tile] = head;
    }
}

// Behind the last slab: what is still pending.
@compute @workgroup_size(8, 8)
fn finish(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if any(pixel.xy >= tiles.size) {
        return;
    }
    let at = pixel.y * tiles.size.x + pixel.x;
    let ray = light[at];
    if ray.a < layered.termination {
        light[at] = under(ray, pending_at(at), inverseSqrt(line_through(tiles, pixel.xy).inverse));
    }
}
