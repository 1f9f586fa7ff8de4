// Shows an accumulated picture in its colours.
#import deepfield::frame::{corner, pixel_at, shown}
#import deepfield::colored::{composite, cells, last_cells, colored}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return corner(index);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = pixel_at(position);
    let cell = pixel.y * composite.stride + pixel.x;
    var color = colored(cells[cell]);
    if composite.share < 1.0 {
        color = mix(colored(last_cells[cell]), color, composite.share);
    }
    return shown(color, pixel);
}
