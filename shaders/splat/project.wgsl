// Projects particles, drops those that no pixel sees, and sorts the others' splats by bin, in two passes with a scan of
// the bins' sizes (sort.wgsl) between them.
//
// One workgroup for each block of up to BLOCK particles of one node. `count` gives each particle its bin and its place in
// the bin; `place` projects again and writes each splat to its place in the order, which costs less than to keep the
// splats in between.
#import deepfield::constants::TILE
#import deepfield::particle::{view, nodes, blocks, Block, camera_axes, load_particle}
#import deepfield::projection::{camera, project, Projected}
#import deepfield::splat_view::{Splat, SMALL, EVERYWHERE, INVISIBLE}

const NOWHERE: u32 = 0xffffffffu;

/// For each particle its bin and its place there.
@group(0) @binding(6) var<storage, read_write> places: array<vec2<u32>>;
/// Number of splats in each bin; then, for `place`, in the bins before it.
@group(0) @binding(7) var<storage, read_write> bins: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> splats: array<Splat>;

/// The bin of a splat; NOWHERE if it cannot reach the picture. The grid of the small splats' bins is like level 0.
fn bin_of(projected: Projected) -> u32 {
    let grid = view.levels[projected.level];
    let cell = projected.splat.head.xy / grid.scale + f32(grid.pad);
    let bin = floor(cell / f32(TILE)) + f32(grid.margin);
    let inside = all(bin >= vec2(0.0)) && all(bin < vec2(f32(grid.bins_x), f32(grid.bins_y)));
    let at = vec2<u32>(clamp(bin, vec2(0.0), vec2(f32(grid.bins_x - 1u), f32(grid.bins_y - 1u))));
    let first = select(grid.first_bin, view.small_bin, projected.kind == SMALL);
    let found = select(NOWHERE, first + at.y * grid.bins_x + at.x, inside);
    if projected.kind == EVERYWHERE {
        return view.everywhere_bin;
    }
    return select(found, NOWHERE, projected.kind == INVISIBLE);
}

/// A workgroup's block; an empty one beyond the last.
fn block_of(group: vec3<u32>, groups: vec3<u32>) -> Block {
    let at = group.y * groups.x + group.x;
    var block = Block(0u, 0u, 0u, 0u);
    if at < arrayLength(&blocks) {
        block = blocks[at];
    }
    return block;
}

@compute @workgroup_size(64)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = block_of(group, groups);
    let node = nodes[block.node];
    let axes = camera_axes();
    let camera = camera();
    for (var i = lane; i < block.count; i += 64u) {
        let bin = bin_of(project(camera, load_particle(axes, node, block.first + i)));
        var rank = 0u;
        if bin != NOWHERE {
            rank = atomicAdd(&bins[bin], 1u);
        }
        places[block.splat + i] = vec2(bin, rank);
    }
}

@compute @workgroup_size(64)
fn place(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = block_of(group, groups);
    let node = nodes[block.node];
    let axes = camera_axes();
    let camera = camera();
    for (var i = lane; i < block.count; i += 64u) {
        let place = places[block.splat + i];
        if place.x != NOWHERE {
            let projected = project(camera, load_particle(axes, node, block.first + i));
            splats[atomicLoad(&bins[place.x]) + place.y] = projected.splat;
        }
    }
}
