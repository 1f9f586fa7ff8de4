// Splats that lie over each other, in the order of their distance, each with its colour: what crates/draw/src/cpu/over.rs blends. One invocation for
// each. shaders/sorted/blend.wgsl blends them.
#import deepfield::tile_reach::tiles_of
#import deepfield::tile_view::{TileView, Spot}

/// A splat, ready to be blended.
struct Splat {
    /// Camera coordinates, and smoothing length.
    place: vec4<f32>,
    /// Colour, linear light; and the optical depth where the kernel's integral along the line of sight is `1 / h^2`.
    matter: vec4<f32>,
}

/// How own columns and attributes become colours.
struct SplatLook {
    /// Factor and offset from a column, or its base-2 logarithm, to its place in the table's rows.
    column_map: vec2<f32>,
    /// The same from an attribute to the row.
    attribute_map: vec2<f32>,
    /// Columns and rows of the table.
    size: vec2<u32>,
    /// 1: columns count by their logarithm.
    column_log: u32,
    /// 1: attributes do.
    attribute_log: u32,
    /// 1: hues follow the attribute.
    has_hue: u32,
    /// Optical depth of a column of 1.
    depth: f32,
    unused_a: u32,
    unused_b: u32,
}

@group(0) @binding(0) var<uniform> tiles: TileView;
/// Number of particles.
@group(0) @binding(1) var<storage, read> work: array<u32>;
@group(0) @binding(2) var<storage, read> spots: array<Spot>;
/// Their numbers in the order of distance.
@group(0) @binding(3) var<storage, read> ranks: array<u32>;
@group(0) @binding(4) var<storage, read_write> arranged: array<Splat>;
/// The tiles that each reaches.
@group(0) @binding(5) var<storage, read_write> reaches: array<vec2<u32>>;
@group(1) @binding(0) var<uniform> look: SplatLook;
/// Colours by columns, row by row.
@group(1) @binding(1) var<storage, read> table: array<vec4<f32>>;

/// Where a value lies in its range.
fn place_of(value: f32, factors: vec2<f32>, is_log: bool) -> f32 {
    let logarithm = log2(max(value, 1.0e-37));
    let place = clamp(fma(select(value, logarithm, is_log), factors.x, factors.y), 0.0, 1.0);
    return select(place, 0.0, is_log && value <= 0.0);
}

/// A column's colour in a row of the table.
fn color_in(row: u32, along: f32) -> vec3<f32> {
    let at = along * f32(look.size.x - 1u);
    let first = min(row, look.size.y - 1u) * look.size.x;
    let column = u32(at);
    let left = table[first + column].rgb;
    return left + (table[first + min(column + 1u, look.size.x - 1u)].rgb - left) * fract(at);
}

@compute @workgroup_size(256)
fn arrange(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if at >= work[0] {
        return;
    }
    let spot = spots[ranks[at]];
    let along = place_of(spot.density, look.column_map, look.column_log != 0u);
    let across = select(0.5, place_of(spot.quantity, look.attribute_map, look.attribute_log != 0u), look.has_hue != 0u);
    let down = across * f32(look.size.y - 1u);
    let upper = color_in(u32(down), along);
    let color = upper + (color_in(u32(down) + 1u, along) - upper) * fract(down);
    let h = spot.place.w;
    reaches[at] = tiles_of(tiles, spot.place);
    arranged[at] = Splat(spot.place, vec4(color, look.depth * spot.mass / (h * h)));
}
