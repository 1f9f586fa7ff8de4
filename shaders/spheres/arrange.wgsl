// Particles in the order of the depth where their spheres begin, as spheres. One invocation for each.
#import deepfield::tile_reach::tiles_of
#import deepfield::tile_view::{TileView, Spot}

@group(0) @binding(0) var<uniform> tiles: TileView;
/// Number of particles.
@group(0) @binding(1) var<storage, read> work: array<u32>;
@group(0) @binding(2) var<storage, read> spots: array<Spot>;
/// Their numbers in the order of depth.
@group(0) @binding(3) var<storage, read> ranks: array<u32>;
@group(0) @binding(4) var<storage, read_write> arranged: array<Spot>;
/// The tiles that each reaches.
@group(0) @binding(5) var<storage, read_write> reaches: array<vec2<u32>>;

@compute @workgroup_size(256)
fn arrange(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if at < work[0] {
        var spot = spots[ranks[at]];
        spot.place.w *= tiles.extent;
        arranged[at] = spot;
        reaches[at] = tiles_of(tiles, spot.place);
    }
}
