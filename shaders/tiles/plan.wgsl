// Slabs of depth that hold no more particles than there is room for, and how many particles or pairs there are.
#import deepfield::tile_constants::SORT_BLOCK
#import deepfield::tile_view::Portion

@group(0) @binding(0) var<uniform> portion: Portion;
/// For each interval of depths, block or workgroup the number of those before it; behind the last the number of all.
@group(0) @binding(1) var<storage, read> sums: array<u32>;
/// For each slab its first interval and the one behind its last, and how many of their particles belong to the slab before.
@group(0) @binding(2) var<storage, read_write> slabs: array<vec4<u32>>;
/// Number of particles or pairs, and of blocks to be sorted; workgroups along x, y and z for one invocation each.
@group(0) @binding(3) var<storage, read_write> work: array<u32>;

/// The last interval before which there are at most `most` particles.
fn end_of(most: u32) -> u32 {
    var low = 0u;
    var high = portion.intervals;
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
        let end = min(end_of(sums[first] + portion.most), first + portion.at_once);
        if end > first && skipped == 0u {
            slabs[slab] = vec4(first, end, 0u, 0u);
            first = end;
        } else {
            // Behind the last interval nothing is left.
            let behind = min(first + 1u, portion.intervals);
            slabs[slab] = vec4(first, behind, skipped, 0u);
            skipped += portion.most;
            if skipped >= sums[behind] - sums[first] {
                first = behind;
                skipped = 0u;
            }
        }
    }
}

/// Workgroups in a row: one dimension holds at most 65535.
const ROW: u32 = 32768u;

fn set_work(count: u32) {
    let groups = (count + 255u) / 256u;
    work[0] = count;
    work[1] = (count + SORT_BLOCK - 1u) / SORT_BLOCK;
    work[2] = min(groups, ROW);
    work[3] = (groups + ROW - 1u) / ROW;
    work[4] = 1u;
}

// One invocation: what is drawn of a slab.
@compute @workgroup_size(1)
fn settle() {
    let total = sums[portion.length];
    set_work(min(total - min(total, slabs[portion.slab].z), portion.most));
}

// One invocation: the pairs of a slab.
@compute @workgroup_size(1)
fn settle_pairs() {
    set_work(sums[portion.length]);
}
