// What wide particles add to a tier: the next tier's field, interpolated by cubics through four cells along each axis
// (crates/draw/src/cpu/volume/coarse.rs says why, and how exactly). Coarsest tiers come first, so that each holds all coarser ones.
//
// A brick reads 8 x 8 x 8 cells of the next tier, from four times its place on, for its own 8 x 8 x 8. Cells 2 i along an axis
// lie a quarter of a coarse cell before the third of the four from `i` on, cells 2 i + 1 a quarter behind the second of those
// from `i + 1` on.
//
// One workgroup of 64 invocations for each brick: each reads one column of cells along z; rows along x and then y are
// exchanged through the workgroup's memory, and along z everything is at hand.
//
// With SUBGROUP (subgroups of exactly eight, as on a CPU driver) a workgroup is one subgroup, lanes lie along x, and all else
// is in registers: four coarse slices at a time, of each of which lanes have first four rows and then eight.
#import deepfield::volume_view::{Turn, number_of}
#import deepfield::volume_bricks::{volume, portion, first_brick_of, first_layer_read}
#import deepfield::volume_constants::{BRICK, BRICK_SHIFT, CELLS, CHOSEN, HEADER, WEIGHTS}

@group(0) @binding(2) var<uniform> turn: Turn;
/// How many bricks are listed for each tier; then each brick's index, and which parts of the next tier it reads.
@group(0) @binding(3) var<storage, read> items: array<u32>;
/// The cells of each brick, slice by slice: its densities, then `sum m A W` where there is an attribute.
@group(0) @binding(4) var<storage, read_write> field: array<f32>;
/// The largest amount in each part of each brick.
@group(0) @binding(5) var<storage, read_write> densest: array<f32>;

#ifdef ATTRIBUTE
const VALUES: u32 = 2u;
#else
const VALUES: u32 = 1u;
#endif

/// A brick, and where it reads.
struct Task {
    tier: u32,
    held: u32,
    /// In which half of the bricks of the next tier it begins, along each axis.
    odd: vec3<u32>,
    /// The brick of the next tier at half its place: column, row and layer.
    first: vec3<u32>,
    /// Parts that hold something: see choose.wgsl.
    parts: u32,
}

fn task_of(item: u32) -> Task {
    let tier = turn.number;
    let window = volume.tiers[tier].window;
    let columns = window.x * window.y;
    let index = items[HEADER + 2u * item];
    let layer = first_layer_read(tier) + index / columns;
    let column = index % columns;
    let brick = vec3(first_brick_of(portion.tiers[tier]) + vec2(column % window.x, column / window.x), layer);
    var task: Task;
    task.tier = tier;
    task.held = volume.tiers[tier].first_brick + layer % volume.tiers[tier].ring * columns + column;
    task.odd = brick & vec3(1u);
    task.first = (brick >> vec3(1u)) - vec3(first_brick_of(portion.tiers[tier + 1u]), 0u);
    task.parts = items[HEADER + 2u * item + 1u];
    return task;
}

/// Index among the bricks that are held of the one at a task's first place or next to it.
fn coarse_brick(task: Task, next: vec3<u32>) -> u32 {
    let tier = task.tier + 1u;
    let window = volume.tiers[tier].window;
    let at = task.first + next;
    return volume.tiers[tier].first_brick + (at.z % volume.tiers[tier].ring * window.y + at.y) * window.x + at.x;
}

#ifdef SUBGROUP
/// Four rows of a coarse slice: a lane's cells.
fn load(at: u32, flags: vec4<bool>) -> vec4<f32> {
    var rows = vec4(0.0);
    for (var row = 0u; row < 4u; row++) {
        if flags[row] {
            rows[row] = field[at + row * BRICK];
        }
    }
    return rows;
}

/// Adds rows to every other row of a slice.
fn store(at: u32, rows: vec4<f32>, add: vec4<bool>, positive: bool) -> vec4<f32> {
    var sums = rows;
    for (var row = 0u; row < 4u; row++) {
        let cell = at + 2u * row * BRICK;
        if add[row] {
            sums[row] += field[cell];
        }
        if positive {
            sums[row] = max(sums[row], 0.0);
        }
        field[cell] = sums[row];
    }
    return sums;
}

/// Along x: each lane's sum over all lanes' cells.
fn across(rows: vec4<f32>, low: vec4<f32>, high: vec4<f32>) -> vec4<f32> {
    var sum = low.x * subgroupBroadcast(rows, 0u);
    sum = fma(vec4(low.y), subgroupBroadcast(rows, 1u), sum);
    sum = fma(vec4(low.z), subgroupBroadcast(rows, 2u), sum);
    sum = fma(vec4(low.w), subgroupBroadcast(rows, 3u), sum);
    sum = fma(vec4(high.x), subgroupBroadcast(rows, 4u), sum);
    sum = fma(vec4(high.y), subgroupBroadcast(rows, 5u), sum);
    sum = fma(vec4(high.z), subgroupBroadcast(rows, 6u), sum);
    return fma(vec4(high.w), subgroupBroadcast(rows, 7u), sum);
}

/// A slice's rows 0, 2, 4, 6 and 1, 3, 5, 7.
struct Slice {
    even: vec4<f32>,
    odd: vec4<f32>,
}

/// The sum of four vectors, for even cells; in reverse for odd ones.
fn between(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>) -> vec4<f32> {
    return fma(vec4(WEIGHTS.w), a, fma(vec4(WEIGHTS.z), b, fma(vec4(WEIGHTS.y), c, WEIGHTS.x * d)));
}

/// A coarse slice with rows and columns as close as the brick's.
fn slice_of(task: Task, value: u32, lane: u32, z: u32, low_share: vec4<f32>, high_share: vec4<f32>) -> Slice {
    let x = 4u * task.odd.x + lane;
    let deep = 4u * task.odd.z + z;
    let next = vec3(x >> BRICK_SHIFT, 0u, deep >> BRICK_SHIFT);
    let within = (deep & (BRICK - 1u)) * BRICK * BRICK + (x & (BRICK - 1u));
    // Rows of a part of a brick lie two and two: its parts 0 and 1, or 2 and 3.
    let corner = next.x + 4u * next.z;
    let low_bits = task.parts >> (4u * corner + 2u * task.odd.y);
    let high_bits = select(task.parts >> (4u * corner + 2u), task.parts >> (4u * (corner + 2u)), task.odd.y == 1u);
    let low_flags = (vec4(low_bits) & vec4(1u, 1u, 2u, 2u)) != vec4(0u);
    let high_flags = (vec4(high_bits) & vec4(1u, 1u, 2u, 2u)) != vec4(0u);
    let brick = coarse_brick(task, next);
    let high_brick = coarse_brick(task, next + vec3(0u, task.odd.y, 0u));
    let start = value * CELLS + within;
    let low_rows = load(brick * VALUES * CELLS + start + 4u * task.odd.y * BRICK, low_flags);
    let high_rows = load(high_brick * VALUES * CELLS + start + 4u * (1u - task.odd.y) * BRICK, high_flags);
    let low = across(low_rows, low_share, high_share);
    let high = across(high_rows, low_share, high_share);
    let second = vec4(low.yzw, high.x);
    let third = vec4(low.zw, high.xy);
    let fourth = vec4(low.w, high.xyz);
    return Slice(between(low, second, third, fourth), between(high, fourth, third, second));
}

@compute @workgroup_size(8)
fn interpolate(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let item = number_of(group, groups);
    if item >= items[CHOSEN + turn.number] {
        return;
    }
    let task = task_of(item);
    // The shares of the eight coarse columns in this lane's cells.
    var low_share: vec4<f32>;
    var high_share: vec4<f32>;
    let is_odd = lane & 1u;
    let first_tap = lane / 2u + is_odd;
    for (var i = 0u; i < 4u; i++) {
        let low_tap = i - first_tap;
        let high_tap = i + 4u - first_tap;
        low_share[i] = select(0.0, WEIGHTS[select(3u - low_tap, low_tap, is_odd == 1u) & 3u], low_tap < 4u);
        high_share[i] = select(0.0, WEIGHTS[select(3u - high_tap, high_tap, is_odd == 1u) & 3u], high_tap < 4u);
    }
    // What the brick's own particles have given.
    var add: vec4<bool>;
    for (var part = 0u; part < 4u; part++) {
        add[part] = densest[task.held * #{PARTS}u + part] > 0.0;
    }
    var most = vec4(0.0);
    for (var value = 0u; value < VALUES; value++) {
        var a = slice_of(task, value, lane, 0u, low_share, high_share);
        var b = slice_of(task, value, lane, 1u, low_share, high_share);
        var c = slice_of(task, value, lane, 2u, low_share, high_share);
        var d = slice_of(task, value, lane, 3u, low_share, high_share);
        var at = (task.held * VALUES + value) * CELLS + lane;
        // Cubics overshoot by a little where the field ends; a density is not negative.
        let positive = task.tier == 0u && value == 0u;
        for (var z = 4u; z < 8u; z++) {
            let e = slice_of(task, value, lane, z, low_share, high_share);
            let near_even = store(at, between(a.even, b.even, c.even, d.even), add, positive);
            let near_odd = store(at + BRICK, between(a.odd, b.odd, c.odd, d.odd), add, positive);
            at += BRICK * BRICK;
            let far_even = store(at, between(e.even, d.even, c.even, b.even), add, positive);
            let far_odd = store(at + BRICK, between(e.odd, d.odd, c.odd, b.odd), add, positive);
            at += BRICK * BRICK;
            if value == 0u {
                most = max(most, max(max(abs(near_even), abs(near_odd)), max(abs(far_even), abs(far_odd))));
            }
            a = b;
            b = c;
            c = d;
            d = e;
        }
    }
    let largest = subgroupMax(most);
    if lane < 4u {
        densest[task.held * #{PARTS}u + lane] = largest[lane];
    }
}
#else
/// Cells that are exchanged: slice by slice, row by row.
var<workgroup> cells: array<f32, 512>;
var<workgroup> largest: array<f32, 64>;

/// The sum of four cells, from `first` on and `stride` apart.
fn between(first: u32, stride: u32, is_odd: bool) -> f32 {
    let weights = select(WEIGHTS.wzyx, WEIGHTS, is_odd);
    let four = vec4(cells[first], cells[first + stride], cells[first + 2u * stride], cells[first + 3u * stride]);
    return dot(weights, four);
}

@compute @workgroup_size(64)
fn interpolate(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let item = number_of(group, groups);
    if item >= items[CHOSEN + turn.number] {
        return;
    }
    let task = task_of(item);
    let own = vec2(lane % BRICK, lane / BRICK);
    let begin = 4u * task.odd.xy + own;
    let add = densest[task.held] > 0.0;
    let is_odd = (own & vec2(1u)) == vec2(1u);
    let first_tap = own / 2u + (own & vec2(1u));
    var most = 0.0;
    for (var value = 0u; value < VALUES; value++) {
        for (var z = 0u; z < BRICK; z++) {
            let cell = vec3(begin, 4u * task.odd.z + z);
            let next = cell >> vec3(BRICK_SHIFT);
            let within = cell & vec3(BRICK - 1u);
            var amount = 0.0;
            if ((task.parts >> (next.x + 2u * next.y + 4u * next.z)) & 1u) != 0u {
                let at = (coarse_brick(task, next) * VALUES + value) * CELLS;
                amount = field[at + (within.z * BRICK + within.y) * BRICK + within.x];
            }
            cells[z * 64u + lane] = amount;
        }
        workgroupBarrier();
        var along: array<f32, 8>;
        for (var z = 0u; z < BRICK; z++) {
            along[z] = between(z * 64u + own.y * BRICK + first_tap.x, 1u, is_odd.x);
        }
        workgroupBarrier();
        for (var z = 0u; z < BRICK; z++) {
            cells[z * 64u + lane] = along[z];
        }
        workgroupBarrier();
        for (var z = 0u; z < BRICK; z++) {
            along[z] = between(z * 64u + first_tap.y * BRICK + own.x, BRICK, is_odd.y);
        }
        // Nobody reads a column any more but its own invocation.
        workgroupBarrier();
        for (var z = 0u; z < BRICK; z++) {
            cells[z * 64u + lane] = along[z];
        }
        for (var z = 0u; z < BRICK; z++) {
            let at = (task.held * VALUES + value) * CELLS + z * 64u + lane;
            let odd = z & 1u;
            var sum = between((z / 2u + odd) * 64u + lane, 64u, odd == 1u);
            if add {
                sum += field[at];
            }
            // Cubics overshoot by a little where the field ends; a density is not negative.
            if task.tier == 0u && value == 0u {
                sum = max(sum, 0.0);
            }
            field[at] = sum;
            if value == 0u {
                most = max(most, abs(sum));
            }
        }
        workgroupBarrier();
    }
    largest[lane] = most;
    for (var stride = 32u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if lane < stride {
            largest[lane] = max(largest[lane], largest[lane + stride]);
        }
    }
    if lane == 0u {
        densest[task.held] = largest[0];
    }
}
#endif
