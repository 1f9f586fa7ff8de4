// Slabs of depth that hold no more particles than there is room for, and how many particles or pairs there are.
#import deepfield::tile_constants::{INTERVALS, SORT_BLOCK}
#import deepfield::tile_view::Portion

@group(0) @binding(0) var<uniform> portion: Portion;
/// For each interval of depths, block or workgroup the number of those before it; behind the last the number of all.
@group(0) @binding(1) var<storage, read> sums: array<u32>;
/// For each slab its first interval and the one behind its last, and how many of their particles belong to the slab before.
@group(0) @binding(2) var<storage, read_write> slabs: array<vec4<u32>>;
/// Number of particles or pairs, and of blocks to be sorted.
@group(0) @binding(3) var<storage, read_write> work: array<u32>;

/// The last interval before which there are at most `most` particles.
fn end_of(most: u32) -> u32 {
    var low = 0u;
    var high = INTERVALS;
    while low < high {
        let middle = (low + high + 1u) / 2u;
        if sums[middle] <= most {
            low = middle;
        } else {
            high = middle - 1u;
        }
    }
    return low;
}

// One invocation. An interval that alone is too many becomes slabs of its own, in the order of the particles: within it depths
// differ by less than a thousandth.
@compute @workgroup_size(1)
fn divide() {
    var first = 0u;
    var skipped = 0u;
    for (var slab = 0u; slab < portion.length; slab++) {
        let end = min(end_of(sums[first] + portion.most), first + portion.intervals);
        if end > first && skipped == 0u {
            slabs[slab] = vec4(first, end, 0u, 0u);
            first = end;
        } else {
            // Behind the last interval nothing is left.
            let behind = min(first + 1u, INTERVALS);
            slabs[slab] = vec4(first, behind, skipped, 0u);
            skipped += portion.most;
            if skipped >= sums[behind] - sums[first] {
                first = behind;
                skipped = 0u;
            }
        }
    }
}

// One invocation: what is drawn of a slab.
@compute @workgroup_size(1)
fn settle() {
    let total = sums[portion.length];
    let count = min(total - min(total, slabs[portion.slab].z), portion.most);
    work[0] = count;
    work[1] = (count + SORT_BLOCK - 1u) / SORT_BLOCK;
}

// One invocation: the pairs of a slab.
@compute @workgroup_size(1)
fn settle_pairs() {
    let count = sums[portion.length];
    work[0] = count;
    work[1] = (count + SORT_BLOCK - 1u) / SORT_BLOCK;
}
