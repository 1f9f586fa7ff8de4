// Blends the particles of each tile front to back (F12 5.9), as crates/draw/src/cpu/sorted.rs does. One invocation for each pixel.
#import deepfield::kernel::{box_profile, evaluate}
#import deepfield::tile_view::{line_through, square_from}
#import deepfield::tile_walk::{tiles, progress, Walk, begin_walk, head_of, advance, is_spent, NONE}

struct Splat {
    place: vec4<f32>,
    matter: vec4<f32>,
}

struct Sorted {
    /// Rays that are as opaque end.
    termination: f32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

@group(0) @binding(4) var<storage, read> arranged: array<Splat>;
@group(1) @binding(0) var<uniform> sorted: Sorted;
/// Light and opacity of each pixel.
@group(1) @binding(1) var<storage, read_write> light: array<vec4<f32>>;
/// Depth of the particle with which each pixel becomes opaque.
@group(1) @binding(2) var<storage, read_write> ends: array<f32>;

/// `1 - exp(-depth)`.
fn opacity(depth: f32) -> f32 {
    return select(1.0 - exp(-depth), depth * (1.0 - 0.5 * depth * (1.0 - depth / 3.0)), depth < 0.02);
}

@compute @workgroup_size(8, 8)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(global_invocation_id) pixel: vec3<u32>) {
    let tile = group.y * ((tiles.size.x + 7u) / 8u) + group.x;
    let first = progress[tile];
    workgroupBarrier();
    if any(pixel.xy >= tiles.size) || first == NONE {
        return;
    }
    let at = pixel.y * tiles.size.x + pixel.x;
    var ray = light[at];
    let termination = sorted.termination;
    if ray.a >= termination {
        return;
    }
    let profile = box_profile(0.0);
    let line = line_through(tiles, pixel.xy);
    var walk: Walk;
    begin_walk(&walk, group.xy, first);
    var head = head_of(&walk);
    while head != NONE && !is_spent(&walk) {
        let splat = arranged[head];
        let square = square_from(tiles, line, splat.place);
        if square < 1.0 {
            let integral = evaluate(profile, vec4(square)).x;
            let share = (1.0 - ray.a) * opacity(splat.matter.a * integral);
            ray += share * vec4(splat.matter.rgb, 1.0);
        }
        if ray.a >= termination {
            ends[at] = splat.place.z;
            break;
        }
        advance(&walk);
        head = head_of(&walk);
    }
    light[at] = ray;
    // All pixels that go on have come equally far.
    if ray.a < termination {
        progress[tile] = head;
    }
}
