// What cells show of the fields of particles' columns, as crates/draw/src/cpu/volume/attributes.rs reads them, whose comments say why.
//
// Each column has been resampled by itself: its particles weigh their volumes `V`, and cells hold `sum V W` and `sum V A W`. What a picture
// shows of them is put together here, a column after the other, in cells of four values: the volume's number, that times the attribute that
// colours it, the number that surfaces are of, and what the volume's extinction is multiplied by.
//
// One workgroup for each brick of the slab, one invocation for each of its columns along z.
#import deepfield::volume_view::number_of
#import deepfield::volume_bricks::{volume, portion, brick_of_tier}
#import deepfield::volume_constants::{
    BRICK, CELLS, COLUMN_VALUES, OF_HUE, OF_OPACITY, OF_SURFACES, OF_VOLUME, READ_DENSITY, READ_SUM,
}

/// How a column is read. The Rust twin is `ColumnUniform` in src/gpu/volume/column.rs.
struct ColumnView {
    /// What it is for: one of OF_VOLUME, OF_SURFACES, OF_OPACITY and OF_HUE.
    role: u32,
    /// READ_DENSITY, READ_SUM, or else the mean.
    reading: u32,
    /// 1: the logarithm of values is placed.
    is_log: u32,
    /// 1: surfaces are of the volume's numbers.
    is_alone: u32,
    /// The value, or its base-2 logarithm, at place 1 (of densities for opacity at place 0), and the places for a unit of it.
    low: f32,
    per: f32,
    /// What `sum V W` is multiplied by to be a share of space.
    filling: f32,
    /// The least such share at which the mean is known.
    least_filled: f32,
    /// Points in use.
    point_count: u32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
    /// What the extinction is multiplied by at a density's place: place and factor, in ascending order.
    points: array<vec4<f32>, 8>,
}

@group(0) @binding(2) var<uniform> column: ColumnView;
/// The cells of each brick of the column: `sum V W`, then `sum V A W`.
@group(0) @binding(3) var<storage, read> sums: array<f32>;
/// The largest `sum V W` of each part of each of these bricks.
@group(0) @binding(4) var<storage, read> filled: array<f32>;
/// What the cells of each brick show: all of its numbers, then the other values.
@group(0) @binding(5) var<storage, read_write> field: array<f32>;
/// The largest number in each part of each brick.
@group(0) @binding(6) var<storage, read_write> densest: array<f32>;

/// A value's place, from 0 to 1.
fn place_of_value(value: f32) -> f32 {
    var at = value;
    var known = true;
    if column.is_log != 0u {
        known = value > 0.0;
        at = log2(max(value, 1.0e-37));
    }
    return select(0.0, clamp((at - column.low) * column.per, 0.0, 1.0), known);
}

/// The number that a cell shows of its sums; 0: nothing.
fn number_read(share: f32, sum: f32) -> f32 {
    if column.reading == READ_DENSITY {
        return max(sum, 0.0);
    }
    if column.reading == READ_SUM {
        return select(0.0, 1.0 + place_of_value(sum * column.filling), share > 0.0);
    }
    let is_known = share * column.filling >= column.least_filled;
    return select(0.0, 1.0 + place_of_value(sum / max(share, 1.0e-37)), is_known);
}

/// What the extinction is multiplied by where a density is.
fn factor_of(density: f32) -> f32 {
    if density <= 0.0 {
        return 0.0;
    }
    let place = place_of_value(density);
    var before = column.points[0];
    var factor = before.y;
    for (var i = 1u; i < column.point_count; i++) {
        let after = column.points[i];
        if place >= before.x {
            factor = mix(before.y, after.y, min((place - before.x) / (after.x - before.x), 1.0));
        }
        before = after;
    }
    return factor;
}

var<workgroup> largest: array<f32, 64>;
const LANES_OF_PART: u32 = 64u / #{PARTS}u;

@compute @workgroup_size(64)
fn read_column(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let index = number_of(group, groups);
    let is_there = index < volume.window.x * volume.window.y * portion.layers;
    let held = brick_of_tier(0u, select(0u, index, is_there)).held;
    let part = held * #{PARTS}u + lane / LANES_OF_PART;
    let has_numbers = column.role == OF_VOLUME || column.role == OF_SURFACES;
    var found = 0.0;
    if is_there {
        let is_filled = filled[part] > 0.0;
        for (var z = 0u; z < BRICK; z++) {
            let within = z * BRICK * BRICK + lane;
            var share = 0.0;
            var sum = 0.0;
            // What holds nothing has not been written.
            if is_filled {
                share = sums[held * 2u * CELLS + within];
                sum = sums[(held * 2u + 1u) * CELLS + within];
            }
            let out = held * COLUMN_VALUES * CELLS + within;
            if has_numbers {
                let number = number_read(share, sum);
                found = max(found, number);
                if column.role == OF_VOLUME {
                    field[out] = number;
                    field[out + CELLS] = 0.0;
                    field[out + 3u * CELLS] = 1.0;
                }
                if column.role == OF_SURFACES || column.is_alone != 0u {
                    field[out + 2u * CELLS] = number;
                }
            } else if column.role == OF_HUE {
                field[out + CELLS] = select(0.0, field[out] * sum / max(share, 1.0e-37), share > 0.0);
            } else {
                field[out + 3u * CELLS] = factor_of(sum);
            }
        }
    }
    largest[lane] = found;
    for (var stride = LANES_OF_PART / 2u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if lane % LANES_OF_PART < stride {
            largest[lane] = max(largest[lane], largest[lane + stride]);
        }
    }
    if is_there && has_numbers && lane % LANES_OF_PART == 0u {
        densest[part] = select(max(densest[part], largest[lane]), largest[lane], column.role == OF_VOLUME);
    }
}
