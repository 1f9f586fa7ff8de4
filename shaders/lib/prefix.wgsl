// Sums over the invocations of a workgroup.
#define_import_path deepfield::prefix

/// Invocations of a workgroup that sums.
const THREADS: u32 = 256u;

var<workgroup> shared_sums: array<u32, 256>;

/// The sum of this invocation's value and those before it, by doubling steps. All of the workgroup's must ask.
fn sum_up_to(lane: u32, value: u32) -> u32 {
    shared_sums[lane] = value;
    for (var stride = 1u; stride < THREADS; stride *= 2u) {
        workgroupBarrier();
        let other = select(0u, shared_sums[max(lane, stride) - stride], lane >= stride);
        workgroupBarrier();
        shared_sums[lane] += other;
    }
    return shared_sums[lane];
}
