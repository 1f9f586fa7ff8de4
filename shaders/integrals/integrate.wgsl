// Line integrals of a field's values along each pixel's ray, as crates/draw/src/cpu/field/xray.rs draws them, whose comments say why.
//
// A ray reads the level whose samples lie as close as pixels in the middle of its way through the field. Each dispatch has one level, and
// leaves rays of other levels as they are: holes, and what is outside, count nothing.
#import deepfield::field_samples::{place_of, sample}

/// Where rays lie. A ray is `start + t * step` for `t`, its depth from a plane through the field; both change linearly from pixel to pixel.
struct Rays {
    /// Where the middle line of sight is in that plane, and what a pixel to the right and one down add.
    start: vec4<f32>,
    start_right: vec4<f32>,
    start_down: vec4<f32>,
    /// What a unit of depth adds on the middle line of sight, and what a pixel to the right and one down add to that.
    step: vec4<f32>,
    step_right: vec4<f32>,
    step_down: vec4<f32>,
}

// What stays while the camera moves comes first: an adapter in software has the first word as a constant, and compiles anew where it changes.
struct Integrals {
    /// Samples of the level along each axis.
    shape: vec3<u32>,
    /// The level's own indices for an index.
    scale: f32,
    /// In indices of samples.
    samples: Rays,
    /// In the world, from the middle of the box outside of which nothing is drawn.
    world: Rays,
    /// Half of that box; 1: there is one.
    clip: vec4<f32>,
    /// The last indices that belong to the field.
    ends: vec4<f32>,
    /// Where the middle line of sight meets the picture, pixels.
    middle: vec2<f32>,
    /// Least and largest depth from the plane.
    planes: vec2<f32>,
    /// Pixels.
    size: vec2<u32>,
    /// The level, and the least and the largest one that are drawn.
    level: u32,
    least_level: u32,
    last_level: u32,
    /// 1: the distance of pixels grows with the depth.
    perspective: u32,
    /// Depth of the plane.
    depth: f32,
    /// Distances of samples to a pixel's distance at depth 1 (perspective) or everywhere.
    pixel: f32,
    /// Width of a pixel at depth 1 (perspective), 0 else.
    slope: f32,
    /// Samples of the level to a step.
    stride: f32,
    unused_a: u32,
    unused_b: u32,
}

@group(0) @binding(0) var<uniform> integrals: Integrals;
/// The picture: the integral, and nothing.
@group(0) @binding(1) var<storage, read_write> cells: array<vec2<f32>>;
/// The bits of the level's samples.
@group(0) @binding(2) var shown: texture_3d<u32>;

/// Narrows an interval of depths to where a ray is between two planes along each axis.
fn within(ends: vec2<f32>, start: vec3<f32>, step: vec3<f32>, low: vec3<f32>, high: vec3<f32>) -> vec2<f32> {
    var near = ends.x;
    var far = ends.y;
    for (var axis = 0u; axis < 3u; axis++) {
        if step[axis] == 0.0 {
            if start[axis] < low[axis] || start[axis] > high[axis] {
                far = -3.0e38;
            }
        } else {
            let a = (low[axis] - start[axis]) / step[axis];
            let b = (high[axis] - start[axis]) / step[axis];
            near = max(near, min(a, b));
            far = min(far, max(a, b));
        }
    }
    return vec2(near, far);
}

@compute @workgroup_size(8, 8)
fn integrate(@builtin(global_invocation_id) invocation: vec3<u32>) {
    if any(invocation.xy >= integrals.size) {
        return;
    }
    let away = vec2<f32>(invocation.xy) + 0.5 - integrals.middle;
    let start = integrals.samples.start.xyz + away.x * integrals.samples.start_right.xyz
        + away.y * integrals.samples.start_down.xyz;
    let step = integrals.samples.step.xyz + away.x * integrals.samples.step_right.xyz
        + away.y * integrals.samples.step_down.xyz;
    var ends = within(integrals.planes, start, step, vec3(-0.5), integrals.ends.xyz);
    if integrals.clip.w != 0.0 {
        let world_start = integrals.world.start.xyz + away.x * integrals.world.start_right.xyz
            + away.y * integrals.world.start_down.xyz;
        let world_step = integrals.world.step.xyz + away.x * integrals.world.step_right.xyz
            + away.y * integrals.world.step_down.xyz;
        ends = within(ends, world_start, world_step, -integrals.clip.xyz, integrals.clip.xyz);
    }
    if ends.x >= ends.y {
        return;
    }
    var pixel = integrals.pixel;
    if integrals.perspective != 0u {
        pixel *= integrals.depth + 0.5 * (ends.x + ends.y);
    }
    let octaves = floor(log2(max(pixel, 1.0)) + select(0.0, 0.25, pixel > 1.0));
    if clamp(u32(octaves), integrals.least_level, integrals.last_level) != integrals.level {
        return;
    }
    let way = (ends.y - ends.x) * length(step) * integrals.scale;
    let steps = max(ceil(way / integrals.stride), 1.0);
    let part = (ends.y - ends.x) / steps;
    let first = (start + (ends.x + 0.5 * part) * step + 0.5) * integrals.scale - 0.5;
    let next = part * integrals.scale * step;
    // Sums of a few are added up: in one of all, the last ones would be rounded away.
    var sum = 0.0;
    var few = 0.0;
    for (var i = 0u; i < u32(steps); i++) {
        let found = sample(shown, place_of(first + f32(i) * next, integrals.shape));
        few += select(0.0, found.value, found.known);
        if (i & 31u) == 31u {
            sum += few;
            few = 0.0;
        }
    }
    let length = sqrt(1.0 + integrals.slope * integrals.slope * dot(away, away));
    cells[invocation.y * integrals.size.x + invocation.x] = vec2((sum + few) * part * length, 0.0);
}
