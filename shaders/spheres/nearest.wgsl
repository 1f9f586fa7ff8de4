// The first sphere along each line of sight, as crates/draw/src/cpu/screen_spheres.rs finds it. One invocation for each pixel.
#import deepfield::sphere_view::{SphereView, Hit, FAR}
#import deepfield::tile_view::{Spot, line_through, square_from}
#import deepfield::tile_walk::{tiles, progress, Walk, begin_walk, head_of, advance, is_spent, NONE}

@group(0) @binding(4) var<storage, read> arranged: array<Spot>;
@group(1) @binding(0) var<uniform> spheres: SphereView;
@group(1) @binding(1) var<storage, read_write> hits: array<Hit>;
/// Their depths; 0 where there is none.
@group(1) @binding(2) var<storage, read_write> ends: array<f32>;

@compute @workgroup_size(8, 8)
fn nearest(@builtin(workgroup_id) group: vec3<u32>, @builtin(global_invocation_id) pixel: vec3<u32>) {
    let tile = group.y * ((tiles.size.x + 7u) / 8u) + group.x;
    let first = progress[tile];
    workgroupBarrier();
    if any(pixel.xy >= tiles.size) || first == NONE {
        return;
    }
    let at = pixel.y * tiles.size.x + pixel.x;
    var hit = hits[at];
    if hit.radius == 0.0 {
        // Nothing yet.
        hit.depth = FAR;
    }
    let line = line_through(tiles, pixel.xy);
    var walk: Walk;
    begin_walk(&walk, group.xy, first);
    var head = head_of(&walk);
    var is_hidden = false;
    while head != NONE && !is_spent(&walk) {
        let sphere = arranged[head];
        // Spheres come in the order of the depths where they begin.
        if sphere.place.z - sphere.place.w > hit.depth {
            is_hidden = true;
            break;
        }
        let square = square_from(tiles, line, sphere.place);
        if square < 1.0 {
            let middle = dot(sphere.place.xyz - line.origin, line.direction) * line.inverse;
            let depth = middle - sphere.place.w * sqrt((1.0 - square) * line.inverse);
            if depth >= spheres.near && depth < hit.depth {
                hit = Hit(depth, sphere.place.w, sphere.density, sphere.quantity);
            }
        }
        advance(&walk);
        head = head_of(&walk);
    }
    hits[at] = hit;
    ends[at] = select(0.0, hit.depth, hit.depth < FAR);
    // All pixels that go on have come equally far.
    if !is_hidden {
        progress[tile] = head;
    }
}
