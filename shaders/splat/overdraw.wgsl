// How many splats lie over each pixel: those whose bounding rectangle overlaps it, as the processor counts them
// (crates/draw/src/cpu/overdraw.rs). Only differences of the numbers along x and y are written: a rectangle changes four of them,
// whatever its size, and the program sums them up.
//
// One workgroup for each block of particles.
#import deepfield::particle::{view, nodes, blocks, block_of, camera_axes, load_particle, Particle}
#import deepfield::projection::{Camera, camera, concentration, length_of, magnification_at}
#import deepfield::rectangle::rectangle_of

/// One more along either side than the picture has pixels.
@group(1) @binding(0) var<storage, read_write> differences: array<atomic<i32>>;

/// Counts a particle, unless it is not drawn or no pixel sees it.
fn count_one(camera: Camera, particle: Particle) {
    let p = particle.position;
    let magnification = magnification_at(camera, p.z);
    let h = length_of(camera, particle, magnification);
    if !(p.z > camera.near && h > 0.0) || particle.weight == 0.0 {
        return;
    }
    if camera.faintest > 0.0 && particle.weight * concentration(camera, h, magnification) < camera.faintest {
        return;
    }
    // Discs of fixed size look the same wherever they are.
    let is_sphere = camera.perspective && camera.fixed_radius == 0.0;
    let focal = select(magnification, camera.focal, is_sphere);
    let around = rectangle_of(camera.middle, focal, is_sphere, vec4(p, h));
    if any(around.high <= vec2(0.0)) || any(around.low >= camera.size) {
        return;
    }
    let first = clamp(floor(around.low), vec2(0.0), camera.size);
    let low = vec2<u32>(first);
    let high = vec2<u32>(clamp(ceil(around.high), first, camera.size));
    let stride = view.size.x + 1u;
    atomicAdd(&differences[low.y * stride + low.x], 1);
    atomicAdd(&differences[low.y * stride + high.x], -1);
    atomicAdd(&differences[high.y * stride + low.x], -1);
    atomicAdd(&differences[high.y * stride + high.x], 1);
}

@compute @workgroup_size(64)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = block_of(group, groups);
    let node = nodes[block.node];
    let axes = camera_axes();
    let camera = camera();
    for (var i = lane; i < block.count; i += 64u) {
        count_one(camera, load_particle(axes, node, block.first + i));
    }
}
