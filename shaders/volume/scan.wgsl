// Numbers become the sums of those before them: sizes of bins become the places of their first particles, and so on.
//
// The bins are some 100000, so they take three steps: the sum of every 1024 (`sum_bins`), the sums before each of these sums
// (`scan_parts`), the places (`spread_bins`). Shorter lists are done by one workgroup: `scan_pairs` the pairs of each
// workgroup of bin.wgsl, `scan_table` the digits of each block of sort.wgsl.
#import deepfield::volume_view::{VolumeView, Portion}
#import deepfield::volume_constants::{ALL_PAIRS, BIN_GROUP, DIGITS, SORT_BLOCK}
#import deepfield::prefix::{sum_up_to, THREADS}

/// Bins of an invocation.
const SHARE: u32 = 4u;

@group(0) @binding(0) var<uniform> volume: VolumeView;
@group(0) @binding(1) var<uniform> portion: Portion;
/// What is summed.
@group(0) @binding(2) var<storage, read_write> list: array<u32>;
/// For each 1024 bins their sum; then the sum of those before.
@group(0) @binding(3) var<storage, read_write> parts: array<u32>;
/// Number of pairs, and of blocks of pairs; workgroups along x, y and z for these blocks; number of pairs of
/// all slabs, and of particles that the grid has enlarged.
@group(0) @binding(4) var<storage, read_write> work: array<u32>;

/// The bins and an end behind them.
fn bin_places() -> u32 {
    return volume.bin_count + 1u;
}

fn sum_of_share(first: u32) -> u32 {
    var sum = 0u;
    for (var i = first; i < min(first + SHARE, bin_places()); i++) {
        sum += list[i];
    }
    return sum;
}

// One workgroup for each 1024 bins.
@compute @workgroup_size(256)
fn sum_bins(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let total = sum_up_to(lane, sum_of_share((group.x * THREADS + lane) * SHARE));
    if lane == THREADS - 1u {
        parts[group.x] = total;
    }
}

// One workgroup.
@compute @workgroup_size(256)
fn scan_parts(@builtin(local_invocation_index) lane: u32) {
    let count = (bin_places() + THREADS * SHARE - 1u) / (THREADS * SHARE);
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

// One workgroup for each 1024 bins.
@compute @workgroup_size(256)
fn spread_bins(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = (group.x * THREADS + lane) * SHARE;
    let total = sum_of_share(first);
    var place = parts[group.x] + sum_up_to(lane, total) - total;
    for (var i = first; i < min(first + SHARE, bin_places()); i++) {
        let number = list[i];
        list[i] = place;
        place += number;
    }
}

/// The first `count` numbers of the list, by one workgroup; returns their sum to the last invocation.
fn scan_list(lane: u32, count: u32) -> u32 {
    let share = (count + THREADS - 1u) / THREADS;
    let first = min(lane * share, count);
    let last = min(first + share, count);
    var total = 0u;
    for (var i = first; i < last; i++) {
        total += list[i];
    }
    let behind = sum_up_to(lane, total);
    var place = behind - total;
    for (var i = first; i < last; i++) {
        let number = list[i];
        list[i] = place;
        place += number;
    }
    return behind;
}

// One workgroup. The list: pairs of each workgroup of 256 particles.
@compute @workgroup_size(256)
fn scan_pairs(@builtin(local_invocation_index) lane: u32) {
    let pairs = scan_list(lane, (portion.candidates + BIN_GROUP - 1u) / BIN_GROUP);
    if lane == THREADS - 1u {
        let blocks = (pairs + SORT_BLOCK - 1u) / SORT_BLOCK;
        work[0] = pairs;
        work[1] = blocks;
        // One dimension holds at most 65535.
        work[2] = min(blocks, 32768u);
        work[3] = (blocks + 32767u) / 32768u;
        work[4] = 1u;
        work[ALL_PAIRS] += pairs;
    }
}

// One workgroup. The list: for each digit the number of pairs in each block that have it.
@compute @workgroup_size(256)
fn scan_table(@builtin(local_invocation_index) lane: u32) {
    scan_list(lane, DIGITS * work[1]);
}
