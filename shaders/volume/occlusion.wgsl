// What rays need not look at: `find_reach` finds the bricks whose rays may read a cell that shows, `occlude` the columns
// of bricks whose pixels are all opaque, behind which nothing is resampled any more, and `pyramid` the same for the bins
// of all tiers and levels (F12 5.7.2).
#import deepfield::volume_view::number_of
#import deepfield::volume_bricks::{volume, portion, first_brick_of}

@group(0) @binding(2) var<storage, read> densest: array<f32>;
/// For each column of bricks two times one bit for each of 32 layers of the slab: rays may meet something there.
@group(0) @binding(3) var<storage, read_write> reach: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read> rays: array<vec4<f32>>;
/// For each column of bricks of the picture, then for each row, the first and the last pixel whose rays read it.
@group(0) @binding(5) var<storage, read> readers: array<vec2<i32>>;
/// At the index of each level's bins in front: 1 for bins that lie behind opaque pixels only.
@group(0) @binding(6) var<storage, read_write> hidden: array<u32>;
/// Number of columns that somebody sees.
@group(0) @binding(7) var<storage, read_write> visible: array<atomic<u32>>;

// One invocation for each brick of the slab.
@compute @workgroup_size(64)
fn find_reach(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let brick = number_of(group, groups) * 64u + lane;
    let window = volume.window;
    let columns = window.x * window.y;
    if brick >= columns * portion.layers {
        return;
    }
    let x = brick % window.x;
    let y = brick / window.x % window.y;
    let layer = portion.first_layer + brick / columns;
    var found = 0.0;
    for (var z = max(layer, 1u) - 1u; z <= layer; z++) {
        let first = z % volume.ring * columns;
        for (var v = max(y, 1u) - 1u; v <= min(y + 1u, window.y - 1u); v++) {
            for (var u = max(x, 1u) - 1u; u <= min(x + 1u, window.x - 1u); u++) {
                for (var part = 0u; part < #{PARTS}u; part++) {
                    found = max(found, densest[(first + v * window.x + u) * #{PARTS}u + part]);
                }
            }
        }
    }
    if found > volume.least {
        let z = layer - portion.first_layer;
        atomicOr(&reach[2u * (brick % columns) + (z >> 5u)], 1u << (z & 31u));
    }
}

/// Whether some pixel is not opaque yet.
var<workgroup> seen: atomic<u32>;

// One workgroup for each column of bricks.
@compute @workgroup_size(64)
fn occlude(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let column = number_of(group, groups);
    if column >= volume.window.x * volume.window.y {
        return;
    }
    if lane == 0u {
        atomicStore(&seen, 0u);
    }
    workgroupBarrier();
    let brick = portion.origin + vec2(column % volume.window.x, column / volume.window.x);
    let across = readers[brick.x];
    let down = readers[portion.brick_rows + brick.y];
    let low = max(vec2(across.x, down.x), vec2<i32>(portion.first_pixel));
    let high = min(vec2(across.y, down.y) + 1, vec2<i32>(portion.behind_pixel));
    let size = vec2<u32>(max(high - low, vec2(0)));
    let first = vec2<u32>(low) - portion.first_pixel;
    let width = portion.behind_pixel.x - portion.first_pixel.x;
    let termination = volume.termination;
    for (var i = lane; i < size.x * size.y; i += 64u) {
        let pixel = first + vec2(i % size.x, i / size.x);
        if rays[pixel.y * width + pixel.x].w < termination {
            atomicStore(&seen, 1u);
            break;
        }
    }
    workgroupBarrier();
    if lane == 0u {
        let open = atomicLoad(&seen);
        hidden[column] = 1u - open;
        atomicAdd(&visible[0], open);
    }
}

/// Whether all columns of a tier that read one of the next are hidden: those at twice its place, before and behind it.
fn all_hidden(tier: u32, place: vec2<u32>) -> u32 {
    let flags = volume.levels[volume.tiers[tier].first_level].x;
    let window = vec2<i32>(volume.tiers[tier].window);
    let middle = 2 * vec2<i32>(first_brick_of(portion.tiers[tier + 1u]) + place) - vec2<i32>(first_brick_of(portion.tiers[tier]));
    let low = max(middle - 1, vec2(0));
    let high = min(middle + 1, window - 1);
    var every = 1u;
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            every &= hidden[flags + u32(y * window.x + x)];
        }
    }
    return every;
}

// One workgroup: each tier's flags from those of the tier before, and each level's from those of the level below.
@compute @workgroup_size(256)
fn pyramid(@builtin(local_invocation_index) lane: u32) {
    let tier_count = volume.tier_count;
    for (var tier = 0u; tier < tier_count; tier++) {
        let first_level = volume.tiers[tier].first_level;
        let level_count = volume.tiers[tier].level_count;
        if tier > 0u {
            storageBarrier();
            let own = volume.levels[first_level];
            for (var i = lane; i < own.y * own.z; i += 256u) {
                hidden[own.x + i] = all_hidden(tier - 1u, vec2(i % own.y, i / own.y));
            }
        }
        for (var level = first_level + 1u; level < first_level + level_count; level++) {
            storageBarrier();
            let fine = volume.levels[level - 1u];
            let coarse = volume.levels[level];
            for (var i = lane; i < coarse.y * coarse.z; i += 256u) {
                let first = 2u * vec2(i % coarse.y, i / coarse.y);
                let last = min(first + 1u, fine.yz - 1u);
                var every = 1u;
                for (var y = first.y; y <= last.y; y++) {
                    for (var x = first.x; x <= last.x; x++) {
                        every &= hidden[fine.x + y * fine.y + x];
                    }
                }
                hidden[coarse.x + i] = every;
            }
        }
    }
}
