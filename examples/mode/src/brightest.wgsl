// The brightest particle along each line of sight. `find` writes for each pixel the largest value that any particle has
// there; `color` then the attribute of the one that has it. Positive floats have the order of their bits, so that a
// maximum of whole numbers is theirs. One workgroup for each block of particles.
#import deepfield::particle::{view, nodes, block_of, camera_axes, load_particle, Particle}
#import deepfield::projection::{camera, Camera}
#import deepfield::kernel::{box_profile, evaluate}

struct Brightest {
    /// Pixels from a row of cells to the next.
    stride: u32,
    /// Ripples for each doubling of depth; 0: none.
    ripples: f32,
    /// How many have run past.
    phase: f32,
    unused: u32,
}

@group(1) @binding(0) var<uniform> brightest: Brightest;
/// `P` and `P S` of each pixel.
@group(1) @binding(1) var<storage, read_write> cells: array<atomic<u32>>;

/// The pixels from `low` to below `high` along one axis that a particle may reach: its box, seen at its nearest and at its
/// farthest depth.
fn span(place: f32, h: f32, depths: vec2<f32>, focal: f32, middle: f32, size: f32) -> vec2<u32> {
    let low = (place - h) / depths;
    let high = (place + h) / depths;
    let ends = vec2(min(low.x, low.y), max(high.x, high.y)) * focal + middle;
    return vec2<u32>(clamp(vec2(floor(ends.x), ceil(ends.y)), vec2(0.0), vec2(size)));
}

/// Column density of a particle along the line of sight through a pixel's centre.
fn value_at(camera: Camera, particle: Particle, pixel: vec2<u32>) -> f32 {
    let from_middle = vec2<f32>(pixel) + 0.5 - camera.middle;
    let ray = vec3(from_middle.x, -from_middle.y, camera.focal) / camera.focal;
    let p = particle.position;
    let off = cross(p, ray);
    let beside = p.xy - ray.xy;
    let square = select(dot(beside, beside), dot(off, off) / dot(ray, ray), camera.perspective);
    let h = particle.smoothing_length;
    let kernel = evaluate(box_profile(0.0), vec4(square / (h * h))).x;
    let ripple = 1.0 + 0.5 * cos(6.2831853 * (brightest.ripples * log2(p.z) - brightest.phase));
    return particle.weight / (h * h) * kernel * select(1.0, ripple, brightest.ripples > 0.0);
}

/// Writes a particle's values, or its attribute where it is the brightest.
fn draw(camera: Camera, particle: Particle, colors: bool) {
    let p = particle.position;
    let h = particle.smoothing_length;
    if !(h > 0.0 && p.z > h && particle.weight > 0.0) {
        return;
    }
    let depths = select(vec2(1.0), vec2(p.z - h, p.z + h), camera.perspective);
    let across = span(p.x, h, depths, camera.focal, camera.middle.x, camera.size.x);
    let down = span(-p.y, h, depths, camera.focal, camera.middle.y, camera.size.y);
    for (var y = down.x; y < down.y; y += 1u) {
        for (var x = across.x; x < across.y; x += 1u) {
            let value = value_at(camera, particle, vec2(x, y));
            let cell = 2u * (y * brightest.stride + x);
            if !colors {
                atomicMax(&cells[cell], bitcast<u32>(max(value, 0.0)));
            } else if value > 0.0 && value >= bitcast<f32>(atomicLoad(&cells[cell])) * 0.999999 {
                atomicStore(&cells[cell + 1u], bitcast<u32>(value * particle.quantity));
            }
        }
    }
}

fn draw_block(group: vec3<u32>, groups: vec3<u32>, lane: u32, colors: bool) {
    let block = block_of(group, groups);
    let node = nodes[block.node];
    let axes = camera_axes();
    let camera = camera();
    for (var i = lane; i < block.count; i += 64u) {
        draw(camera, load_particle(axes, node, block.first + i), colors);
    }
}

@compute @workgroup_size(64)
fn find(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    draw_block(group, groups, lane, false);
}

@compute @workgroup_size(64)
fn color(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    draw_block(group, groups, lane, true);
}
