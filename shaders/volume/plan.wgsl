// Lists the bricks that something may reach and somebody sees, so that the others cost nothing; and those with so many
// particles that they take several turns.
#import deepfield::volume_view::{VolumeView, Portion, number_of}
#import deepfield::volume_constants::{HEADER, TURN}

@group(0) @binding(0) var<uniform> volume: VolumeView;
@group(0) @binding(1) var<uniform> portion: Portion;
/// Where each bin's particles begin.
@group(0) @binding(2) var<storage, read> bins: array<u32>;
@group(0) @binding(3) var<storage, read> hidden: array<u32>;
/// The largest density of each part of each brick that is held; gather.wgsl says what parts are.
@group(0) @binding(4) var<storage, read_write> densest: array<f32>;
/// Number of bricks and of crowded ones; then the bricks, then the crowded ones. Their order does not matter.
@group(0) @binding(5) var<storage, read_write> items: array<atomic<u32>>;
/// Workgroups along x, y and z for the bricks, and for the crowded ones; number of bricks of all slabs.
@group(0) @binding(6) var<storage, read_write> dispatch: array<u32>;

// One invocation for each brick of the slab.
@compute @workgroup_size(64)
fn plan(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let brick = number_of(group, groups) * 64u + lane;
    let columns = volume.window.x * volume.window.y;
    if brick >= columns * portion.layers {
        return;
    }
    let place = vec3(brick % volume.window.x, brick / volume.window.x % volume.window.y, brick / columns);
    if portion.opening != 0u {
        let held = (portion.first_layer + place.z) % volume.ring * columns + brick % columns;
        for (var part = 0u; part < #{PARTS}u; part++) {
            densest[held * #{PARTS}u + part] = 0.0;
        }
    }
    if hidden[brick % columns] != 0u {
        return;
    }
    var total = 0u;
    for (var level = 0u; level < volume.level_count; level++) {
        let grid = volume.levels[level];
        let at = place >> vec3(level);
        let bin = grid.x + (at.z * grid.z + at.y) * grid.y + at.x;
        total += bins[bin + 1u] - bins[bin];
    }
    if total == 0u {
        return;
    }
    let grid = volume.levels[0];
    let room = grid.y * grid.z * grid.w;
    atomicStore(&items[HEADER + atomicAdd(&items[0], 1u)], brick);
    if total > TURN {
        atomicStore(&items[HEADER + room + atomicAdd(&items[1], 1u)], brick);
    }
}

// One invocation.
@compute @workgroup_size(1)
fn dispatch_bricks() {
    for (var list = 0u; list < 2u; list++) {
        let number = atomicLoad(&items[list]) * #{PARTS}u;
        // One dimension holds at most 65535.
        dispatch[3u * list] = min(number, 32768u);
        dispatch[3u * list + 1u] = (number + 32767u) / 32768u;
        dispatch[3u * list + 2u] = 1u;
    }
    dispatch[6] += atomicLoad(&items[0]);
}
