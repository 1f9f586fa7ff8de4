// The particles of a batch in camera space, as the other passes of a slab read them: loaded from the arena, enlarged to what the
// grid can hold.
//
// One workgroup for each block of particles. What a block leaves open behind its particles, and particles without extent or
// mass, have no smoothing length: they reach nothing.
#import deepfield::particle::{block_of, nodes, camera_axes, load_particle}
#import deepfield::volume_view::{VolumeView, Portion}

@group(1) @binding(0) var<uniform> volume: VolumeView;
/// Camera coordinates and smoothing length of each particle.
@group(1) @binding(1) var<storage, read_write> spots: array<vec4<f32>>;
/// Mass, and mass times attribute, with the kernel's factor over h^3.
@group(1) @binding(2) var<storage, read_write> amounts: array<vec2<f32>>;
/// Number of columns of bricks that somebody sees.
@group(1) @binding(3) var<storage, read> visible: array<u32>;

@compute @workgroup_size(64)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = block_of(group, groups);
    if block.count == 0u {
        return;
    }
    if lane == 0u {
        spots[block.place + block.count] = vec4(0.0);
    }
    let seen = visible[0] > 0u;
    let node = nodes[block.node];
    let axes = camera_axes();
    let cell = volume.smallest * volume.sigma;
    let perspective = volume.perspective != 0u;
    for (var i = lane; i < block.count; i += 64u) {
        var spot = vec4(0.0);
        var amount = vec2(0.0);
        if seen {
            let particle = load_particle(axes, node, (block.first + i) * volume.stride);
            let place = particle.position;
            let least = cell * select(1.0, max(place.z, 0.0), perspective);
            let h = max(particle.smoothing_length * volume.growth, least);
            let mass = particle.weight * f32(volume.stride);
            if particle.smoothing_length > 0.0 && mass != 0.0 && (place.z + h > 0.0 || !perspective) {
                let factor = volume.kernel_factor / (h * h * h);
                spot = vec4(place, h);
                amount = vec2(mass * factor, mass * particle.quantity * factor);
            }
        }
        spots[block.place + i] = spot;
        amounts[block.place + i] = amount;
    }
}
