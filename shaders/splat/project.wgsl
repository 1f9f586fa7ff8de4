// Projects particles, drops those that no pixel sees, and sorts the others' splats by bin, in two passes with a scan of
// the bins' sizes (sort.wgsl) between them.
//
// One workgroup for each block of up to BLOCK candidates of one node. `count` gives each particle that is drawn its bin and
// its place in the bin, and puts them in a row, so that `place` has nothing to do with the others; `place` projects again and
// writes each splat to its place in the order, which costs less than to keep the splats in between.
#import deepfield::particle::{block_of, nodes, blocks, Block, camera_axes, load_particle}
#import deepfield::projection::{camera, project}
#import deepfield::splat_bins::{bin_of, NOWHERE}
#import deepfield::splat_view::Splat

/// Bits of a candidate's number in its block, above its place in the bin: there are at most 2^22 splats.
const PLACE_BITS: u32 = 22u;

/// For each block the number of particles that are drawn; then for each of them its bin, and its place there together with
/// its number in the block.
@group(0) @binding(6) var<storage, read_write> places: array<vec2<u32>>;
/// Number of splats in each bin; then, for `place`, in the bins before it.
@group(0) @binding(7) var<storage, read_write> bins: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> splats: array<Splat>;

/// Particles of the workgroup's block that are drawn.
var<workgroup> live: atomic<u32>;

@compute @workgroup_size(64)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // Bevy's pipelines do not ask for zeros in a workgroup's memory.
    if lane == 0u {
        atomicStore(&live, 0u);
    }
    workgroupBarrier();
    let block = block_of(group, groups);
    let node = nodes[block.node];
    let axes = camera_axes();
    let camera = camera();
    for (var i = lane; i < block.count; i += 64u) {
        let bin = bin_of(project(camera, load_particle(axes, node, block.first + i)));
        if bin != NOWHERE {
            let rank = atomicAdd(&bins[bin], 1u);
            places[block.place + 1u + atomicAdd(&live, 1u)] = vec2(bin, rank | (i << PLACE_BITS));
        }
    }
    workgroupBarrier();
    if lane == 0u && block.count > 0u {
        places[block.place] = vec2(atomicLoad(&live), 0u);
    }
}

@compute @workgroup_size(64)
fn place(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = block_of(group, groups);
    let drawn = select(0u, places[block.place].x, block.count > 0u);
    if drawn == 0u {
        return;
    }
    let node = nodes[block.node];
    let axes = camera_axes();
    let camera = camera();
    for (var i = lane; i < drawn; i += 64u) {
        let place = places[block.place + 1u + i];
        let projected = project(camera, load_particle(axes, node, block.first + (place.y >> PLACE_BITS)));
        splats[atomicLoad(&bins[place.x]) + (place.y & ((1u << PLACE_BITS) - 1u))] = projected.splat;
    }
}
