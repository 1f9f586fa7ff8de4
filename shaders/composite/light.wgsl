// Shows light that passes have drawn: linear and premultiplied, before black, encoded as the processor's pictures are
// (`Colors::image`). A picture of fewer pixels is stretched.
#import deepfield::frame::{frame, corner, pixel_at, stretched, shown}
#import deepfield::srgb::encoded

struct LightPicture {
    /// Size of the picture, pixels.
    size: vec2<u32>,
}

@group(0) @binding(2) var<uniform> picture: LightPicture;
/// Light and opacity of each pixel.
@group(0) @binding(3) var<storage, read> light: array<vec4<f32>>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return corner(index);
}

fn cell(x: u32, y: u32) -> vec3<f32> {
    return light[y * picture.size.x + x].rgb;
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = pixel_at(position);
    var seen: vec3<f32>;
    if all(picture.size == frame.size) {
        seen = cell(pixel.x, pixel.y);
    } else {
        let at = stretched(pixel, picture.size);
        let above = mix(cell(at.low.x, at.low.y), cell(at.high.x, at.low.y), at.part.x);
        let below = mix(cell(at.low.x, at.high.y), cell(at.high.x, at.high.y), at.part.x);
        seen = mix(above, below, at.part.y);
    }
    return shown(vec4(encoded(clamp(seen, vec3(0.0), vec3(1.0))), 1.0), pixel);
}
