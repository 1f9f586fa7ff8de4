// Which way surfaces of a sampled field face, as crates/draw/src/cpu/field/mod.rs has it (`FieldLevel::slope`), whose comments say why.
#define_import_path deepfield::field_slope
#import deepfield::field_samples::is_hole

/// The finest level that the grid is filled from, in camera axes. The Rust twin is `SlopeUniform` in src/gpu/volume/field/layout.rs.
// What stays while the camera moves comes first: an adapter in software has the first word as a constant, and compiles anew where it changes.
struct SlopeView {
    /// Samples of the level along each axis.
    shape: vec3<u32>,
    /// Its own indices for an index.
    scale: f32,
    /// What a unit of length to the right adds to indices of samples.
    right: vec4<f32>,
    /// What one upwards adds.
    up: vec4<f32>,
    /// What one of depth adds.
    forward: vec4<f32>,
    /// Indices on the middle line of sight at a depth, and that depth.
    start: vec4<f32>,
    /// Slices that are filled from it.
    slices: u32,
    /// 1: the logarithm of values is placed.
    is_log: u32,
    /// The value, or its base-2 logarithm, at place 1, and the places for a unit of it.
    low: f32,
    per: f32,
}

@group(1) @binding(0) var<uniform> slopes: SlopeView;
/// The bits of its samples.
@group(1) @binding(1) var sloping: texture_3d<u32>;

/// What four samples along an axis count for in a cubic B-spline, and in its slope.
struct Spline {
    samples: vec4<u32>,
    shares: vec4<f32>,
    slopes: vec4<f32>,
}

/// What they count for where one that is missing lies on the line of its neighbours.
fn within(given: vec4<f32>, first: u32, last: u32) -> vec4<f32> {
    var weights = given;
    if first == 0u {
        weights = vec4(0.0, weights.y + 2.0 * weights.x, weights.z - weights.x, weights.w);
    }
    if first + 2u > last {
        weights = vec4(weights.x, weights.y - weights.w, weights.z + 2.0 * weights.w, 0.0);
    }
    return weights;
}

/// The spline at one of the level's own indices.
fn spline(index: f32, last: u32) -> Spline {
    let at = clamp(index, 0.0, f32(last));
    let first = min(u32(at), max(last, 1u) - 1u);
    let t = at - f32(first);
    let s = 1.0 - t;
    let t2 = t * t;
    let t3 = t2 * t;
    let shares = vec4(s * s * s, 3.0 * t3 - 6.0 * t2 + 4.0, 3.0 * (t + t2 - t3) + 1.0, t3) / 6.0;
    let slopes = vec4(-0.5 * s * s, 1.5 * t2 - 2.0 * t, 0.5 + t - 1.5 * t2, 0.5 * t2);
    let samples = min(max(first + vec4(0u, 1u, 2u, 3u), vec4(1u)) - 1u, vec4(last));
    return Spline(samples, within(shares, first, last), within(slopes, first, last));
}

/// Places of values from that of the surface; of holes 0, so that they turn none.
fn above(bits: vec4<u32>, surface: f32) -> vec4<f32> {
    let holes = is_hole(bits);
    var at = bitcast<vec4<f32>>(select(bits, vec4(0u), holes));
    var known = vec4(true);
    if slopes.is_log != 0u {
        known = at > vec4(0.0);
        at = log2(max(at, vec4(1.0e-37)));
    }
    let places = 1.0 + select(vec4(0.0), clamp((at - slopes.low) * slopes.per, vec4(0.0), vec4(1.0)), known);
    return select(places - surface, vec4(0.0), holes);
}

/// Whether samples say which way a surface faces in a step: behind, differences of cells do.
fn has_slope(step: u32) -> bool {
    return step < slopes.slices;
}

/// Which way the surface of a place of values rises in camera axes, so far to the right of the middle line of sight and below it, at a depth.
fn slope_at(away: vec2<f32>, depth: f32, surface: f32) -> vec3<f32> {
    let index = slopes.start.xyz + (depth - slopes.start.w) * slopes.forward.xyz + away.x * slopes.right.xyz
        - away.y * slopes.up.xyz;
    let own = (index + 0.5) * slopes.scale - 0.5;
    let last = slopes.shape - 1u;
    let x = spline(own.x, last.x);
    var y = spline(own.y, last.y);
    var z = spline(own.z, last.z);
    var sum = vec3(0.0);
    for (var k = 0u; k < 4u; k++) {
        for (var j = 0u; j < 4u; j++) {
            let row = vec2(y.samples[j], z.samples[k]);
            let bits = vec4(
                textureLoad(sloping, vec3(x.samples.x, row), 0).x,
                textureLoad(sloping, vec3(x.samples.y, row), 0).x,
                textureLoad(sloping, vec3(x.samples.z, row), 0).x,
                textureLoad(sloping, vec3(x.samples.w, row), 0).x,
            );
            let places = above(bits, surface);
            let value = dot(x.shares, places);
            let slope = dot(x.slopes, places);
            sum += vec3(
                y.shares[j] * z.shares[k] * slope,
                y.slopes[j] * z.shares[k] * value,
                y.shares[j] * z.slopes[k] * value,
            );
        }
    }
    return vec3(dot(sum, slopes.right.xyz), dot(sum, slopes.up.xyz), dot(sum, slopes.forward.xyz));
}
