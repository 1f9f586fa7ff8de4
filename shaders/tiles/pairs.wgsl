// Which tiles a particle reaches, as pairs of bin and particle (tile_reach.wgsl): four at most, so near particles of any size
// cannot make the list longer than four times the particles.
//
// `number_spots` gives each particle its key to be sorted by depth. Then, for particles front to back, `count_pairs` counts
// the bins that each workgroup's particles are in, and `write_pairs` writes them, so that pairs are in the order of their
// particles; sort.wgsl brings them into the order of the bins, in which each bin's keep theirs. `find_ranges` finds where each
// bin's begin and end.
#import deepfield::prefix::sum_up_to
#import deepfield::tile_reach::{Reach, reach_of}
#import deepfield::tile_view::{TileView, Spot}

@group(0) @binding(0) var<uniform> tiles: TileView;
/// Number of particles, or pairs.
@group(0) @binding(1) var<storage, read> work: array<u32>;
@group(0) @binding(2) var<storage, read> spots: array<Spot>;
/// Number of pairs of each workgroup; for `write_pairs` the place of its first one.
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;
/// What is sorted by: depth, or the bin of each pair.
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
/// The particle of each.
@group(0) @binding(5) var<storage, read_write> ranks: array<u32>;
/// First pair of each bin, and the one behind its last.
@group(0) @binding(6) var<storage, read_write> ranges: array<vec2<u32>>;
/// The tiles that each particle reaches.
@group(0) @binding(7) var<storage, read> reaches: array<vec2<u32>>;

/// A particle's reach; none behind the last.
fn reach_at(at: u32) -> Reach {
    if at >= work[0] {
        return Reach(vec2(0u), vec2(0u), 0u, 0u);
    }
    return reach_of(tiles, reaches[at]);
}

// One invocation for each particle, as in all that follows.
@compute @workgroup_size(256)
fn number_spots(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if at < work[0] {
        keys[at] = spots[at].key;
        ranks[at] = at;
    }
}

@compute @workgroup_size(256)
fn count_pairs(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.y * groups.x + group.x;
    let total = sum_up_to(lane, reach_at(number * 256u + lane).count);
    if lane == 255u && number < arrayLength(&sums) {
        sums[number] = total;
    }
}

@compute @workgroup_size(256)
fn write_pairs(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.y * groups.x + group.x;
    let rank = number * 256u + lane;
    let reach = reach_at(rank);
    let behind = sum_up_to(lane, reach.count);
    if reach.count == 0u {
        return;
    }
    var place = sums[number] + behind - reach.count;
    let grid = tiles.levels[reach.level];
    for (var y = reach.low.y; y <= reach.high.y; y++) {
        for (var x = reach.low.x; x <= reach.high.x; x++) {
            keys[place] = grid.x + y * grid.y + x;
            ranks[place] = rank;
            place += 1u;
        }
    }
}

// One invocation for each pair.
@compute @workgroup_size(256)
fn find_ranges(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    let count = work[0];
    if at >= count {
        return;
    }
    let bin = keys[at];
    if at == 0u || keys[at - 1u] != bin {
        ranges[bin].x = at;
    }
    if at + 1u == count || keys[at + 1u] != bin {
        ranges[bin].y = at + 1u;
    }
}
