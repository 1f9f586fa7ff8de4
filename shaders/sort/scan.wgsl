// The numbers of a list become the sums of those before them, in three steps: the sum of every 1024 (`sum_list`), the sums
// before each of these sums (`scan_parts`), and both together (`spread_list`).
#import deepfield::prefix::{sum_up_to, THREADS}
#import deepfield::tile_constants::SHARE
#import deepfield::tile_view::Portion

@group(0) @binding(0) var<uniform> portion: Portion;
@group(0) @binding(1) var<storage, read_write> list: array<u32>;
@group(0) @binding(2) var<storage, read_write> parts: array<u32>;

fn sum_of_share(first: u32) -> u32 {
    var sum = 0u;
    for (var i = first; i < min(first + SHARE, portion.length); i++) {
        sum += list[i];
    }
    return sum;
}

// One workgroup for each 1024 numbers.
@compute @workgroup_size(256)
fn sum_list(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let total = sum_up_to(lane, sum_of_share((group.x * THREADS + lane) * SHARE));
    if lane == THREADS - 1u {
        parts[group.x] = total;
    }
}

// One workgroup.
@compute @workgroup_size(256)
fn scan_parts(@builtin(local_invocation_index) lane: u32) {
    let count = (portion.length + THREADS * SHARE - 1u) / (THREADS * SHARE);
    let share = (count + THREADS - 1u) / THREADS;
    let first = min(lane * share, count);
    let last = min(first + share, count);
    var total = 0u;
    for (var i = first; i < last; i++) {
        total += parts[i];
    }
    var place = sum_up_to(lane, total) - total;
    for (var i = first; i < last; i++) {
        let number = parts[i];
        parts[i] = place;
        place += number;
    }
}

// One workgroup for each 1024 numbers.
@compute @workgroup_size(256)
fn spread_list(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = (group.x * THREADS + lane) * SHARE;
    let total = sum_of_share(first);
    var place = parts[group.x] + sum_up_to(lane, total) - total;
    for (var i = first; i < min(first + SHARE, portion.length); i++) {
        let number = list[i];
        list[i] = place;
        place += number;
    }
}
