// Sorts pairs by one digit of their bins; those of equal digits keep their order. From the last digit to the first that sorts
// by bins. `tally` counts each block's digits, scan.wgsl finds where each digit of each block begins, `move_pairs` moves.
//
// A block is 1024 pairs, 16 successive ones for each of 64 invocations.
#import deepfield::volume_view::{Turn, number_of}
#import deepfield::volume_constants::{DIGITS, DIGIT_BITS, SORT_BLOCK}

@group(0) @binding(0) var<uniform> turn: Turn;
/// Number of pairs, and of blocks.
@group(0) @binding(1) var<storage, read> work: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> particles: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_particles: array<u32>;
/// For each digit and block the number of pairs; for `move_pairs` the place of the first.
@group(0) @binding(6) var<storage, read_write> table: array<u32>;

const SHARE: u32 = 16u;

/// For each digit and invocation: how many pairs have it; then the place within the block of the next one.
var<workgroup> counters: array<u32, 1024>;
var<workgroup> sums: array<u32, 64>;
/// From a place within the block to one among all pairs, for each digit.
var<workgroup> bases: array<u32, 16>;

fn digit_of(at: u32) -> u32 {
    return (keys[at] >> (turn.number * DIGIT_BITS)) & (DIGITS - 1u);
}

/// Counts an invocation's pairs by digit.
fn count_own(block: u32, lane: u32) {
    for (var digit = 0u; digit < DIGITS; digit++) {
        counters[digit * 64u + lane] = 0u;
    }
    let first = block * SORT_BLOCK + lane * SHARE;
    let behind = min(first + SHARE, work[0]);
    for (var at = first; at < behind; at++) {
        counters[digit_of(at) * 64u + lane] += 1u;
    }
}

@compute @workgroup_size(64)
fn tally(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = number_of(group, groups);
    if block >= work[1] {
        return;
    }
    count_own(block, lane);
    workgroupBarrier();
    if lane < DIGITS {
        var sum = 0u;
        for (var other = 0u; other < 64u; other++) {
            sum += counters[lane * 64u + other];
        }
        table[lane * work[1] + block] = sum;
    }
}

@compute @workgroup_size(64)
fn move_pairs(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = number_of(group, groups);
    if block >= work[1] {
        return;
    }
    count_own(block, lane);
    workgroupBarrier();
    // Counters become places: sixteen successive ones for each invocation.
    var total = 0u;
    for (var i = 0u; i < SHARE; i++) {
        total += counters[lane * SHARE + i];
    }
    sums[lane] = total;
    for (var stride = 1u; stride < 64u; stride *= 2u) {
        workgroupBarrier();
        let other = select(0u, sums[max(lane, stride) - stride], lane >= stride);
        workgroupBarrier();
        sums[lane] += other;
    }
    var place = sums[lane] - total;
    for (var i = 0u; i < SHARE; i++) {
        let number = counters[lane * SHARE + i];
        counters[lane * SHARE + i] = place;
        place += number;
    }
    workgroupBarrier();
    if lane < DIGITS {
        bases[lane] = table[lane * work[1] + block] - counters[lane * 64u];
    }
    workgroupBarrier();
    let first = block * SORT_BLOCK + lane * SHARE;
    let behind = min(first + SHARE, work[0]);
    for (var at = first; at < behind; at++) {
        let digit = digit_of(at);
        let next = counters[digit * 64u + lane];
        counters[digit * 64u + lane] = next + 1u;
        sorted_keys[bases[digit] + next] = keys[at];
        sorted_particles[bases[digit] + next] = particles[at];
    }
}
