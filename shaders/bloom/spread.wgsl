// Spreads bright light as the processor does (`color::bloom`): to ever coarser levels, each pixel to the four around it, and back
// by the same weights, so that none is lost or made.
#import deepfield::bloom::{bloom, lit}

/// Finer columns or rows that give light to a coarser one, with their weights.
struct Givers {
    pixels: vec4<u32>,
    weights: vec4<f32>,
}

/// Coarser columns or rows that a finer one takes light from, with their weights.
struct Takers {
    pixels: vec2<u32>,
    weights: vec2<f32>,
}

@group(0) @binding(2) var<storage, read> givers: array<Givers>;
@group(0) @binding(3) var<storage, read> takers: array<Takers>;
/// The levels' light, one after the other.
@group(0) @binding(4) var<storage, read_write> planes: array<vec4<f32>>;

/// What of a pixel's light spreads where all of what is bright does.
fn bright(light: vec3<f32>) -> vec3<f32> {
    // One that is no number would be everywhere; comparing bits, since compilers may take it that all are numbers.
    let exponent = vec3(0x7f800000u);
    let known = select(light, vec3<f32>(0.0), (bitcast<vec3<u32>>(light) & exponent) == exponent);
    let most = max(known.r, max(known.g, known.b));
    if most <= 0.0 {
        return vec3(0.0);
    }
    return max((most - bloom.threshold) / most, 0.0) * known;
}

/// The light of the finer level that is on its way to coarser ones.
fn given(x: u32, y: u32) -> vec3<f32> {
    let index = y * bloom.fine.x + x;
    if bloom.is_picture != 0u {
        return bright(lit[index].rgb);
    }
    return planes[bloom.fine_start + index].rgb;
}

/// The coarser level's light at a pixel of the finer one.
fn taken(pixel: vec2<u32>) -> vec3<f32> {
    let columns = takers[bloom.takers.x + pixel.x];
    let rows = takers[bloom.takers.y + pixel.y];
    var sum = vec3(0.0);
    for (var row = 0u; row < 2u; row++) {
        let start = bloom.coarse_start + rows.pixels[row] * bloom.coarse.x;
        for (var column = 0u; column < 2u; column++) {
            let weight = rows.weights[row] * columns.weights[column];
            sum += weight * planes[start + columns.pixels[column]].rgb;
        }
    }
    return bloom.coarser * sum;
}

@compute @workgroup_size(#{GROUP}, #{GROUP})
fn down(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= bloom.coarse) {
        return;
    }
    let columns = givers[bloom.givers.x + id.x];
    let rows = givers[bloom.givers.y + id.y];
    var sum = vec3(0.0);
    for (var row = 0u; row < 4u; row++) {
        for (var column = 0u; column < 4u; column++) {
            let weight = rows.weights[row] * columns.weights[column];
            sum += weight * given(columns.pixels[column], rows.pixels[row]);
        }
    }
    planes[bloom.coarse_start + id.y * bloom.coarse.x + id.x] = vec4(sum, 0.0);
}

@compute @workgroup_size(#{GROUP}, #{GROUP})
fn up(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= bloom.fine) {
        return;
    }
    let index = bloom.fine_start + id.y * bloom.fine.x + id.x;
    planes[index] = vec4(bloom.own * planes[index].rgb + taken(id.xy), 0.0);
}

@compute @workgroup_size(#{GROUP}, #{GROUP})
fn spread(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= bloom.fine) {
        return;
    }
    let index = id.y * bloom.fine.x + id.x;
    let before = lit[index];
    var light = before.rgb + bloom.strength * (taken(id.xy) - bright(before.rgb));
    // What is brighter than a screen keeps its hue.
    let most = max(light.r, max(light.g, light.b));
    if most > 1.0 {
        light /= most;
    }
    lit[index] = vec4(light, before.a);
}
