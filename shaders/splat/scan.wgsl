// The bins' sizes become their first places in the order of splats.
#import deepfield::splat_view::SplatView

const THREADS: u32 = 256u;

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<storage, read_write> starts: array<u32>;

var<workgroup> sums: array<u32, THREADS>;

// One workgroup. In: the number of splats in each bin. Out: the number of splats in the bins before it; one more entry
// holds the total.
@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    let share = (view.bin_count + THREADS - 1u) / THREADS;
    let first = min(lane * share, view.bin_count);
    let last = min(first + share, view.bin_count);
    var sum = 0u;
    for (var i = first; i < last; i++) {
        sum += starts[i];
    }
    sums[lane] = sum;
    // Inclusive sums over the threads by doubling steps.
    for (var stride = 1u; stride < THREADS; stride *= 2u) {
        workgroupBarrier();
        let other = select(0u, sums[max(lane, stride) - stride], lane >= stride);
        workgroupBarrier();
        sums[lane] += other;
    }
    var place = sums[lane] - sum;
    for (var i = first; i < last; i++) {
        let count = starts[i];
        starts[i] = place;
        place += count;
    }
    if lane == THREADS - 1u {
        starts[view.bin_count] = place;
    }
}
