// Smoothes the light on isosurfaces in a picture (F12 5.11), step for step what crates/draw/src/cpu/volume/smoothing.rs does, whose
// comments say why.
//
// `place_faces` takes over where the surfaces of a window lie and which way they face, one invocation for each of its pixels. When
// all windows have done so, with one invocation for each pixel of the picture `join` finds which neighbours are of one surface,
// `flow` has directions flow, once for each step, and `relight` gives the surfaces the light that they have then.
#import deepfield::isosurface::{volume, cosine_between, lit_by}
#import deepfield::volume_constants::{APART, FACE_WORDS, FLOW}
#import deepfield::volume_view::Portion

@group(0) @binding(1) var<uniform> portion: Portion;
/// As raycast.wgsl has it: a number for each pixel of the window, and behind them their surfaces. Of those that cover nothing is wanted
/// but what `place_faces` does, and they are lit already.
@group(0) @binding(2) var<storage, read> progress: array<f32>;
/// Where each pixel's surface lies, camera axes, and the cosine by which it was lit.
@group(0) @binding(3) var<storage, read_write> points: array<vec4<f32>>;
/// Its colour as it is before light, and the share of the pixel that it is.
@group(0) @binding(4) var<storage, read_write> tints: array<vec4<f32>>;
/// Which way it faces, away from the eye, of length 1, or 0 where there is none; and with which neighbours it is one.
@group(0) @binding(5) var<storage, read_write> normals: array<vec4<f32>>;
/// The same after a step.
@group(0) @binding(6) var<storage, read_write> flown: array<vec4<f32>>;
/// Light and opacity of the picture.
@group(0) @binding(7) var<storage, read_write> light: array<vec4<f32>>;

/// One with the pixel to the right, and the one below.
const WITH_RIGHT: u32 = 1u;
const WITH_BELOW: u32 = 2u;

/// A pixel's width at a depth, world units.
fn width_at(depth: f32) -> f32 {
    let width = volume.sigma * volume.cells.x / f32(portion.rows);
    return width * select(1.0, depth, volume.perspective != 0u);
}

/// Whether a pixel is of the picture, whose rows are as long as the list of columns.
fn is_of_picture(pixel: vec2<u32>) -> bool {
    return pixel.x < portion.rows && pixel.y < arrayLength(&points) / portion.rows;
}

@compute @workgroup_size(8, 8)
fn place_faces(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let pixel = invocation.xy + portion.first_pixel;
    if any(pixel >= portion.behind_pixel) {
        return;
    }
    let size = portion.behind_pixel - portion.first_pixel;
    let face = size.x * size.y + FACE_WORDS * (invocation.y * size.x + invocation.x);
    let share = progress[face];
    let depth = progress[face + 1u];
    let line = vec3(progress[face + 2u], progress[face + 3u], 1.0);
    let slope = vec3(progress[face + 4u], progress[face + 5u], progress[face + 6u]);
    let color = vec3(progress[face + 7u], progress[face + 8u], progress[face + 9u]);
    let width = width_at(1.0);
    var point = vec3(width * f32(pixel.x), -width * f32(pixel.y), depth);
    if volume.perspective != 0u {
        point = depth * line;
    }
    let length_squared = dot(slope, slope);
    var normal = vec3<f32>(0.0);
    if share > 0.0 && length_squared > 0.0 {
        normal = select(1.0, -1.0, dot(slope, line) < 0.0) * inverseSqrt(length_squared) * slope;
    }
    let at = pixel.y * portion.rows + pixel.x;
    points[at] = vec4(point, cosine_between(slope, normalize(line)));
    tints[at] = vec4(color, share);
    normals[at] = vec4(normal, 0.0);
}

/// Whether two pixels are of one surface: each lies near the plane of the other.
fn meets(first: u32, second: u32) -> bool {
    let way = points[second].xyz - points[first].xyz;
    let most = APART * min(width_at(points[first].z), width_at(points[second].z));
    let here = normals[first].xyz;
    let there = normals[second].xyz;
    let exist = dot(here, here) > 0.0 && dot(there, there) > 0.0;
    return exist && abs(dot(here, way)) <= most && abs(dot(there, way)) <= most;
}

@compute @workgroup_size(8, 8)
fn join(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if !is_of_picture(pixel.xy) {
        return;
    }
    let at = pixel.y * portion.rows + pixel.x;
    var joined = 0u;
    if is_of_picture(pixel.xy + vec2(1u, 0u)) && meets(at, at + 1u) {
        joined |= WITH_RIGHT;
    }
    if is_of_picture(pixel.xy + vec2(0u, 1u)) && meets(at, at + portion.rows) {
        joined |= WITH_BELOW;
    }
    flown[at] = vec4(normals[at].xyz, f32(joined));
}

/// Whether a pixel is one with the neighbour that a bit stands for.
fn is_joined(at: u32, neighbour: u32) -> bool {
    return (u32(normals[at].w) & neighbour) != 0u;
}

@compute @workgroup_size(8, 8)
fn flow(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if !is_of_picture(pixel.xy) {
        return;
    }
    let row = portion.rows;
    let at = pixel.y * row + pixel.x;
    let own = normals[at];
    var sum = vec3<f32>(0.0);
    var count = 0.0;
    if is_joined(at, WITH_RIGHT) {
        sum += normals[at + 1u].xyz;
        count += 1.0;
    }
    if is_joined(at, WITH_BELOW) {
        sum += normals[at + row].xyz;
        count += 1.0;
    }
    if pixel.x > 0u && is_joined(at - 1u, WITH_RIGHT) {
        sum += normals[at - 1u].xyz;
        count += 1.0;
    }
    if pixel.y > 0u && is_joined(at - row, WITH_BELOW) {
        sum += normals[at - row].xyz;
        count += 1.0;
    }
    var normal = own.xyz;
    if count > 0.0 {
        let moved = own.xyz + FLOW * (sum / count - own.xyz);
        let length_squared = dot(moved, moved);
        if length_squared > 0.0 {
            normal = inverseSqrt(length_squared) * moved;
        }
    }
    flown[at] = vec4(normal, own.w);
}

@compute @workgroup_size(8, 8)
fn relight(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if !is_of_picture(pixel.xy) {
        return;
    }
    let at = pixel.y * portion.rows + pixel.x;
    let tint = tints[at];
    if tint.w <= 0.0 {
        return;
    }
    let point = points[at];
    var direction = vec3(0.0, 0.0, 1.0);
    if volume.perspective != 0u {
        direction = normalize(point.xyz);
    }
    let before = lit_by(tint.rgb, point.w);
    let after = lit_by(tint.rgb, cosine_between(normals[at].xyz, direction));
    let seen = light[at];
    light[at] = vec4(max(seen.rgb + tint.w * (after - before), vec3<f32>(0.0)), seen.a);
}
