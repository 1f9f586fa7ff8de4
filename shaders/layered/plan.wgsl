// How many layers each group of a slab's layers has, as workgroups along z of the passes that sum and blend them: slabs are found by
// the adapter, and what is not there costs nothing.
#import deepfield::layer_group::{layers, layers_of_group}

/// Workgroups along x, y and z of one dispatch after the other.
@group(0) @binding(0) var<storage, read_write> dispatches: array<u32>;

// One invocation for each group. The last dispatch blends all layers of its pixels.
@compute @workgroup_size(1)
fn plan() {
    let count = layers_of_group();
    for (var i = 0u; i < layers.dispatches; i++) {
        let is_last = i + 1u == layers.dispatches;
        dispatches[3u * (layers.dispatch + i) + 2u] = select(count, min(count, 1u), is_last);
    }
}
