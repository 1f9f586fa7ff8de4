// Lists the bricks that something may reach and somebody sees, so that the others cost nothing; and those with so many
// particles that they take several turns.
#import deepfield::volume_view::number_of
#import deepfield::volume_bricks::{volume, portion, brick_of_tier, first_bin, layers_of}
#import deepfield::volume_constants::HEADER

/// Where each bin's particles begin.
@group(0) @binding(2) var<storage, read> bins: array<u32>;
@group(0) @binding(3) var<storage, read> hidden: array<u32>;
/// The largest density of each part of each brick that is held; gather.wgsl says what parts are.
@group(0) @binding(4) var<storage, read_write> densest: array<f32>;
/// Number of bricks and of crowded ones; then, behind a header, the bricks, then the crowded ones. Their order does not
/// matter.
@group(0) @binding(5) var<storage, read_write> items: array<atomic<u32>>;
/// Workgroups along x, y and z for the bricks, and for the crowded ones; number of bricks of all slabs.
@group(0) @binding(6) var<storage, read_write> dispatch: array<u32>;

// One invocation for each brick that the slab fills.
@compute @workgroup_size(64)
fn plan(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = number_of(group, groups) * 64u + lane;
    if number >= portion.bricks {
        return;
    }
    // Tier by tier.
    var tier = 0u;
    var index = number;
    loop {
        let window = volume.tiers[tier].window;
        let filled = window.x * window.y * layers_of(portion.tiers[tier]);
        if index < filled || tier + 1u == volume.tier_count {
            break;
        }
        index -= filled;
        tier += 1u;
    }
    let brick = brick_of_tier(tier, index);
    if portion.opening != 0u {
        for (var part = 0u; part < #{PARTS}u; part++) {
            densest[brick.held * #{PARTS}u + part] = 0.0;
        }
    }
    if hidden[first_bin(tier) + brick.column] != 0u {
        return;
    }
    let first_level = volume.tiers[tier].first_level;
    let level_count = volume.tiers[tier].level_count;
    var total = 0u;
    for (var level = 0u; level < level_count; level++) {
        let grid = volume.levels[first_level + level];
        let at = brick.place >> vec3(level);
        let bin = grid.x + (at.z * grid.z + at.y) * grid.y + at.x;
        total += bins[bin + 1u] - bins[bin];
    }
    if total == 0u {
        return;
    }
    let name = first_bin(tier) + index;
    atomicStore(&items[HEADER + atomicAdd(&items[0], 1u)], name);
    if total > #{TURN}u {
        atomicStore(&items[HEADER + volume.brick_room + atomicAdd(&items[1], 1u)], name);
    }
}

// One invocation.
@compute @workgroup_size(1)
fn dispatch_bricks() {
    for (var list = 0u; list < 2u; list++) {
        let number = atomicLoad(&items[list]);
        // One dimension holds at most 65535.
        dispatch[3u * list] = min(number, 32768u);
        dispatch[3u * list + 1u] = (number + 32767u) / 32768u;
        dispatch[3u * list + 2u] = 1u;
    }
    dispatch[6] += atomicLoad(&items[0]);
}
