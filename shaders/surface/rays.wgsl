// Which triangle of a surface the line of sight through each sample of the picture meets first: chunk by chunk, in the squares of the picture that each
// may be seen in. Near chunks are listed first, so that rays end early in those behind them. How a ray goes through a chunk is another matter on a
// globe (GLOBE) than in a flat field.
//
// Whether a triangle is met its edges say in the camera's coordinates, each by the same operations for both triangles that share it, so that no ray
// slips between two.
//
// All is walked twice, as visible.wgsl draws all twice.
#import deepfield::surface_cast::ROUNDING
#import deepfield::surface_constants::{TILE, NONE}
#import deepfield::surface_seen::{surface_step, put, depth_at}
#import deepfield::surface_view::{surface, lists}
#ifdef GLOBE
#import deepfield::surface_blocks::first_in
#import deepfield::surface_ray::kept_at
#else
#import deepfield::surface_cells::first_in
#import deepfield::surface_ray::{ray_at, kept_of}
#endif

/// Walks the rays of a square of the picture through a chunk: a workgroup for each of these.
@compute @workgroup_size(16, 16)
fn rays(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let entry = surface_step.first + 2u * group.x;
    let corner = lists[entry + 1u];
    let pixel = vec2(corner & 0xffffu, corner >> 16u) * TILE + local.xy;
    if any(pixel >= surface.size) {
        return;
    }
    let index = pixel.y * surface.stride + pixel.x;
    let place = vec2<f32>(pixel) + 0.5;
    let across = vec2(place.x - surface.middle.x, surface.middle.y - place.y) / surface.focal;
#ifdef GLOBE
    var part = kept_at(place);
#else
    let ray = ray_at(place);
    var part = kept_of(ray);
#endif
    part.x = max(part.x, surface.near);
    // Behind what is known nothing is seen, and the second time before it, either.
    var walked = part;
    let known = depth_at(index);
    if known >= 0.0 {
        let room = 4.0 * ROUNDING * known;
        walked.y = min(walked.y, known + room);
        walked.x = select(walked.x, max(walked.x, known - room), surface_step.is_second != 0u);
    } else if surface_step.is_second != 0u {
        return;
    }
#ifdef GLOBE
    let met = first_in(lists[entry], across, part, walked);
#else
    let met = first_in(lists[entry], ray, across, part, walked);
#endif
    if met.number != NONE {
        put(index, met.depth, met.number);
    }
}
