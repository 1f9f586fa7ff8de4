// What the passes share that show a picture in a camera's target: where it lies there, and the picture that it takes the
// place of. Pictures may have another size than what they cover in the target.
//
// Whoever imports this has bindings 0 and 1 of group 0 taken. The Rust twin is `FrameUniform` in src/gpu/target.rs.
#define_import_path deepfield::frame
#import deepfield::srgb::decoded

struct Frame {
    /// What the picture covers in the target, pixels.
    size: vec2<u32>,
    /// Size of the picture before, pixels.
    before_size: vec2<u32>,
    /// Where the picture begins in the target, pixels.
    origin: vec2<f32>,
    /// How much of this picture is seen; the rest is of the one before.
    share: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> before: array<u32>;

/// A vertex of one triangle that holds the whole target.
fn corner(index: u32) -> vec4<f32> {
    return vec4(vec2(f32(index >> 1u), f32(index & 1u)) * 4.0 - 1.0, 0.0, 1.0);
}

/// The pixel of the picture at a fragment's position.
fn pixel_at(position: vec4<f32>) -> vec2<u32> {
    return min(vec2<u32>(position.xy - frame.origin), frame.size - 1u);
}

/// Four texels around a place, and the share of the way from the first to the last.
struct Stretched {
    low: vec2<u32>,
    high: vec2<u32>,
    part: vec2<f32>,
}

/// Where a picture of another size is read for a pixel of this one.
fn stretched(pixel: vec2<u32>, size: vec2<u32>) -> Stretched {
    let place = (vec2<f32>(pixel) + 0.5) * vec2<f32>(size) / vec2<f32>(frame.size) - 0.5;
    let inside = clamp(place, vec2(0.0), vec2<f32>(max(size, vec2(1u)) - 1u));
    let low = vec2<u32>(inside);
    return Stretched(low, min(low + 1u, size - 1u), inside - vec2<f32>(low));
}

fn before_texel(x: u32, y: u32) -> vec4<f32> {
    return unpack4x8unorm(before[y * frame.before_size.x + x]);
}

/// What the picture before shows at a pixel of this one, smoothed where it is stretched.
fn before_at(pixel: vec2<u32>) -> vec4<f32> {
    let at = stretched(pixel, frame.before_size);
    let above = mix(before_texel(at.low.x, at.low.y), before_texel(at.high.x, at.low.y), at.part.x);
    let below = mix(before_texel(at.low.x, at.high.y), before_texel(at.high.x, at.high.y), at.part.x);
    return mix(above, below, at.part.y);
}

/// What the target gets of a pixel's encoded colour.
fn shown(color: vec4<f32>, pixel: vec2<u32>) -> vec4<f32> {
    var seen = color;
    if frame.share < 1.0 {
        // Pictures blend as one sees them: in encoded values.
        seen = mix(before_at(pixel), color, frame.share);
    }
#ifdef LINEAR_TARGET
    seen = vec4(decoded(seen.rgb), seen.a);
#endif
    return seen;
}
