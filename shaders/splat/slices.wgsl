// What follows where crowded tiles have been cut into slices (see accumulate.wgsl): the number of slices becomes a
// dispatch, and the slices' patches are added to the cells.
#import deepfield::splat_view::SplatView

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<storage, read> slice_count: array<u32>;
/// Workgroups along x, y and z that sum the slices.
@group(0) @binding(2) var<storage, read_write> dispatch: array<u32>;
/// For each tile of each layer the first of its slices, and their number.
@group(0) @binding(3) var<storage, read> tile_slices: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> patches: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> cells: array<vec2<f32>>;

/// Cells of a patch.
const PATCH: u32 = 64u;

// One invocation.
@compute @workgroup_size(1)
fn finish() {
    let slices = min(slice_count[0], arrayLength(&patches) / PATCH);
    dispatch[0] = (slices + #{TILES_PER_GROUP}u - 1u) / #{TILES_PER_GROUP}u;
    dispatch[1] = 1u;
    dispatch[2] = 1u;
}

// One row of eight invocations for each tile: a column each. Workgroups along z are layers.
@compute @workgroup_size(8, 8)
fn merge(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let tile = (group.y * groups.x + group.x) * 8u + local.y;
    let layer = group.z;
    if tile >= view.tile_count {
        return;
    }
    let slices = tile_slices[layer * view.tile_count + tile];
    if slices.y == 0u {
        return;
    }
    var level = view.level_count - 1u;
    while level > 0u && view.levels[level].first_tile > tile {
        level -= 1u;
    }
    let grid = view.levels[level];
    let index = tile - grid.first_tile;
    let corner = vec2(index % grid.tiles_x, index / grid.tiles_x) * 8u;
    let x = corner.x + local.x;
    if x >= grid.width {
        return;
    }
    for (var row = 0u; row < min(8u, grid.height - min(corner.y, grid.height)); row++) {
        var sum = vec2(0.0);
        for (var slice = slices.x; slice < slices.x + slices.y; slice++) {
            sum += patches[slice * PATCH + row * 8u + local.x];
        }
        cells[layer * view.cell_count + grid.first_cell + (corner.y + row) * grid.width + x] += sum;
    }
}
