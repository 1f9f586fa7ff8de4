// Colours an accumulated picture through the baked transfer function (F12 4.9, second pass): brightness from P, hue from
// S. The table holds encoded colours and is interpolated between texels, as the CPU's composite does.

struct Composite {
    /// Picture size, pixels.
    size: vec2<u32>,
    /// Table size, texels.
    lut_size: vec2<u32>,
    /// place = value * p_map.x + p_map.y, value being log2 P if p_log is 1.
    p_map: vec2<f32>,
    s_map: vec2<f32>,
    p_log: u32,
    s_log: u32,
    /// Where the picture begins in the target, pixels.
    origin: vec2<f32>,
    /// Cells from a row of the picture to the next.
    stride: u32,
    /// How much of this picture is seen; the rest is of the one before.
    share: f32,
    /// Size of the picture before, pixels.
    before_size: vec2<u32>,
}

const NO_ATTRIBUTE: u32 = 2u;

@group(0) @binding(0) var<uniform> composite: Composite;
@group(0) @binding(1) var<storage, read> cells: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> lut: array<u32>;
@group(0) @binding(3) var<storage, read> before: array<u32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    // One triangle that holds the whole picture.
    let corner = vec2(f32(index >> 1u), f32(index & 1u)) * 4.0 - 1.0;
    return vec4(corner, 0.0, 1.0);
}

fn place(value: f32, log_scale: bool, map: vec2<f32>) -> f32 {
    if log_scale {
        // Zero and below have the lowest place.
        return select(0.0, clamp(fma(log2(value), map.x, map.y), 0.0, 1.0), value > 0.0);
    }
    return clamp(fma(value, map.x, map.y), 0.0, 1.0);
}

fn texel(x: u32, y: u32) -> vec4<f32> {
    return unpack4x8unorm(lut[y * composite.lut_size.x + x]);
}

fn before_texel(x: u32, y: u32) -> vec4<f32> {
    return unpack4x8unorm(before[y * composite.before_size.x + x]);
}

/// What the picture before shows at a pixel of this one, smoothed where it is stretched.
fn before_at(pixel: vec2<u32>) -> vec4<f32> {
    let size = vec2<f32>(composite.before_size);
    let place = (vec2<f32>(pixel) + 0.5) * size / vec2<f32>(composite.size) - 0.5;
    let inside = clamp(place, vec2(0.0), max(size - 1.0, vec2(0.0)));
    let low = vec2<u32>(inside);
    let high = min(low + 1u, composite.before_size - 1u);
    let part = inside - vec2<f32>(low);
    let above = mix(before_texel(low.x, low.y), before_texel(high.x, low.y), part.x);
    let below = mix(before_texel(low.x, high.y), before_texel(high.x, high.y), part.x);
    return mix(above, below, part.y);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = min(vec2<u32>(position.xy - composite.origin), composite.size - 1u);
    let value = cells[pixel.y * composite.stride + pixel.x];
    let last = composite.lut_size - 1u;
    let x = place(value.x, composite.p_log != 0u, composite.p_map) * f32(last.x);
    let left = min(u32(x), max(last.x, 1u) - 1u);
    let u = x - f32(left);
    var color = mix(texel(left, 0u), texel(min(left + 1u, last.x), 0u), u);
    if last.y > 0u {
        var along = 0.5;
        if value.x > 0.0 && composite.s_log != NO_ATTRIBUTE {
            along = place(value.y / value.x, composite.s_log == 1u, composite.s_map);
        }
        let y = along * f32(last.y);
        let low = min(u32(y), last.y - 1u);
        let below = mix(texel(left, low), texel(min(left + 1u, last.x), low), u);
        let above = mix(texel(left, low + 1u), texel(min(left + 1u, last.x), low + 1u), u);
        color = mix(below, above, y - f32(low));
    }
    if composite.share < 1.0 {
        // Pictures blend as one sees them: in encoded values.
        color = mix(before_at(pixel), color, composite.share);
    }
#ifdef LINEAR_TARGET
    let low = color.rgb / 12.92;
    let high = pow((color.rgb + 0.055) / 1.055, vec3(2.4));
    color = vec4(select(high, low, color.rgb <= vec3(0.04045)), color.a);
#endif
    return color;
}
