// Classifies each layer's mean density, and blends it under what is in front of it (F12 5.10), as
// crates/draw/src/cpu/layered/mod.rs does. One invocation for each pixel.
#import deepfield::layer_group::{layers, first_of_slab, layers_of_group, is_open}
#import deepfield::layer_view::LayerView
#import deepfield::matter::matter_of
#import deepfield::splat_view::SplatView
#import deepfield::tile_view::{TileView, front_of, line_through}

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<uniform> tiles: TileView;
@group(0) @binding(2) var<uniform> layered: LayerView;
/// Column density, and that times the attribute, of each layer's pyramid: the picture comes first.
@group(0) @binding(3) var<storage, read> cells: array<vec2<f32>>;
/// Light and opacity of each pixel.
@group(0) @binding(4) var<storage, read_write> light: array<vec4<f32>>;
/// Number of the layer with which each pixel becomes opaque, from 1.
@group(0) @binding(5) var<storage, read_write> ends: array<f32>;

/// Blends a layer under a ray, whose way through layers is longer than the middle one's by the secant.
fn under(ray: vec4<f32>, layer: u32, sums: vec2<f32>, secant: f32) -> vec4<f32> {
    let distance = (front_of(tiles, layer + 1u) - front_of(tiles, layer)) * secant;
    let density = sums.x / distance;
    if !(density > layered.least) {
        return ray;
    }
    let matter = matter_of(density, sums.y / sums.x);
    let share = (1.0 - ray.a) * (1.0 - exp(-matter.a * distance));
    return ray + share * vec4(matter.rgb, 1.0);
}

@compute @workgroup_size(8, 8)
fn blend(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if any(pixel.xy >= tiles.size) || is_open() {
        return;
    }
    let at = pixel.y * tiles.size.x + pixel.x;
    var ray = light[at];
    let secant = inverseSqrt(line_through(tiles, pixel.xy).inverse);
    let first = first_of_slab() + layers.first;
    let count = layers_of_group();
    var layer = 0u;
    let was_open = ray.a < layered.termination;
    while layer < count && ray.a < layered.termination {
        ray = under(ray, first + layer, cells[layer * view.cell_count + at], secant);
        layer++;
    }
    light[at] = ray;
    if was_open && ray.a >= layered.termination {
        ends[at] = f32(first + layer);
    }
}
