// Colours of accumulated sums through the baked transfer function (F12 4.9, second pass): brightness from P, hue from S. The
// table holds encoded colours and is interpolated between texels, as the CPU's composite does.
//
// Whoever imports this has bindings 2 to 5 of group 0 taken. The Rust twin is `CompositeUniform` in src/gpu/composite.rs.
#define_import_path deepfield::colored

struct Composite {
    /// Table size, texels.
    lut_size: vec2<u32>,
    /// place = value * p_map.x + p_map.y, value being log2 P if p_log is 1.
    p_map: vec2<f32>,
    s_map: vec2<f32>,
    p_log: u32,
    s_log: u32,
    /// Cells from a row of the picture to the next.
    stride: u32,
    /// How much of the picture is seen over the one before it.
    share: f32,
    /// The upper end of P's range.
    high: f32,
    unused: u32,
}

const NO_ATTRIBUTE: u32 = 2u;

@group(0) @binding(2) var<uniform> composite: Composite;
@group(0) @binding(3) var<storage, read> cells: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> lut: array<u32>;
@group(0) @binding(5) var<storage, read> last_cells: array<vec2<f32>>;

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

/// The encoded colour of a pixel's sums.
fn colored(value: vec2<f32>) -> vec4<f32> {
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
    return color;
}
