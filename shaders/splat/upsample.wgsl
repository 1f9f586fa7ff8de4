// Interpolates a pyramid level at the next finer one's cell centres, by the filter of reconstruct.wgsl, in two passes:
// along x into a texture as wide as the finer level, then along y, where the finer level's own splats are added.
#import deepfield::constants as constants
#import deepfield::splat_view::{SplatView, Pass, atlas_corner}

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<uniform> batch: Pass;
/// The coarser level, or what the first pass made of it.
@group(0) @binding(2) var source: texture_2d<f32>;
/// The splats of all levels.
@group(0) @binding(3) var atlas: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    // One triangle that holds the whole target.
    let corner = vec2(f32(index >> 1u), f32(index & 1u)) * 4.0 - 1.0;
    return vec4(corner, 0.0, 1.0);
}

/// The first of the coarser cells around a finer one, the step to the next, for the taps in their order; see
/// reconstruct.wgsl for the geometry.
fn taps(fine: i32, fine_pad: u32, coarse_pad: u32) -> vec2<i32> {
    let cell = fine - i32(fine_pad);
    // The finer cell lies a quarter before the coarser cell `middle`, or behind it.
    let middle = (cell >> 1u) + i32(coarse_pad);
    return select(vec2(middle - 4, 1), vec2(middle + 4, -1), (cell & 1) == 1);
}

/// Weight of tap `i`.
fn tap(i: i32) -> f32 {
    return select(constants::TAPS_LOW, constants::TAPS_HIGH, i > 3)[i & 3];
}

@fragment
fn along_x(@builtin(position) position: vec4<f32>) -> @location(0) vec2<f32> {
    let coarse = view.levels[batch.level];
    let fine = view.levels[batch.level - 1u];
    let cell = vec2<i32>(position.xy);
    let walk = taps(cell.x, fine.pad, coarse.pad);
    let last = i32(coarse.width) - 1;
    var sum = vec2(0.0);
    for (var i = 0; i < 8; i++) {
        let x = clamp(walk.x + i * walk.y, 0, last);
        sum += tap(i) * textureLoad(source, vec2(x, cell.y) + vec2<i32>(batch.source), 0).xy;
    }
    return sum;
}

@fragment
fn along_y(@builtin(position) position: vec4<f32>) -> @location(0) vec2<f32> {
    let coarse = view.levels[batch.level];
    let fine = view.levels[batch.level - 1u];
    let cell = vec2<i32>(position.xy);
    let walk = taps(cell.y, fine.pad, coarse.pad);
    let last = i32(coarse.height) - 1;
    let own = atlas_corner(view.levels[0], batch.level - 1u, fine);
    var sum = textureLoad(atlas, cell + vec2<i32>(own), 0).xy;
    for (var i = 0; i < 8; i++) {
        let y = clamp(walk.x + i * walk.y, 0, last);
        sum += tap(i) * textureLoad(source, vec2(cell.x, y), 0).xy;
    }
    return sum;
}
