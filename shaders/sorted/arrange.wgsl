// Particles in the order of their depth, classified each on its own: what crates/draw/src/cpu/sorted.rs blends. One invocation for each.
#import deepfield::matter::matter_of
#import deepfield::tile_reach::tiles_of
#import deepfield::tile_view::{TileView, Spot}

/// A particle, ready to be blended.
struct Splat {
    /// Camera coordinates, and smoothing length.
    place: vec4<f32>,
    /// Colour, linear light; and the optical depth where the kernel's integral along the line of sight is `1 / h^2`.
    matter: vec4<f32>,
}

@group(0) @binding(0) var<uniform> tiles: TileView;
/// Number of particles.
@group(0) @binding(1) var<storage, read> work: array<u32>;
@group(0) @binding(2) var<storage, read> spots: array<Spot>;
/// Their numbers in the order of depth.
@group(0) @binding(3) var<storage, read> ranks: array<u32>;
@group(0) @binding(4) var<storage, read_write> arranged: array<Splat>;
/// The tiles that each reaches.
@group(0) @binding(5) var<storage, read_write> reaches: array<vec2<u32>>;

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
    let matter = matter_of(spot.density, spot.quantity);
    let h = spot.place.w;
    reaches[at] = tiles_of(tiles, spot.place);
    arranged[at] = Splat(spot.place, vec4(matter.rgb, matter.a / spot.density * spot.mass / (h * h)));
}
