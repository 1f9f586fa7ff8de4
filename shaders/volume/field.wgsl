// The bricks of a perspective grid from a sampled field, as crates/draw/src/cpu/field/bricks.rs fills them, whose comments say why:
// each cell has the value at its centre, placed between 1 and 2, and 0 outside of the field and in its holes.
//
// `plan_field` lists the bricks around which something may show, by the largest values of blocks of samples; `fill` fills them. Layers
// that are filled from the same level of the field are taken together.
#import deepfield::field_samples::{place_of, sample}
#import deepfield::volume_view::number_of
#import deepfield::volume_bricks::{volume, portion, brick_of_tier, first_brick_of}
#import deepfield::volume_constants::{AROUND, BRICK, CELLS, HEADER, SAMPLE_BLOCK}

/// A level of a field. Indices are those of the finest level unless they are called the level's own.
// What stays while the camera moves comes first: an adapter in software has the first word as a constant, and compiles anew where it changes.
struct FieldView {
    /// Samples of the level along each axis.
    shape: vec3<u32>,
    /// Its own indices for an index.
    scale: f32,
    /// What a unit of length to the right adds to indices.
    right: vec4<f32>,
    /// What one upwards adds.
    up: vec4<f32>,
    /// The same of places in the world.
    world_right: vec4<f32>,
    world_up: vec4<f32>,
    /// Half of the box outside of which nothing is drawn; 1: there is one.
    clip: vec4<f32>,
    /// The last indices that belong to the field.
    ends: vec4<f32>,
    /// Blocks of its samples along each axis.
    blocks: vec3<u32>,
    /// 1: the logarithm of values is placed.
    is_log: u32,
    /// The value, or its base-2 logarithm, at place 1, and the places for a unit of it.
    low: f32,
    per: f32,
    unused_a: u32,
    unused_b: u32,
}

/// Where a slice of the grid lies, on the middle line of sight.
struct FieldLine {
    /// Its indices, and the width of cells.
    start: vec4<f32>,
    /// Its place in the world, from the middle of the box outside of which nothing is drawn.
    world: vec4<f32>,
}

@group(0) @binding(2) var<uniform> samples: FieldView;
@group(0) @binding(3) var<storage, read> lines: array<FieldLine>;
/// At the index of each column of bricks: 1 for those that lie behind opaque pixels only.
@group(0) @binding(4) var<storage, read> hidden: array<u32>;
/// Where the largest value of each block of samples is placed; 0 of holes alone.
@group(0) @binding(5) var<storage, read> most: array<f32>;
/// Number of bricks that are listed; then, behind a header, the bricks.
@group(0) @binding(6) var<storage, read_write> items: array<atomic<u32>>;
/// The cells of each brick, slice by slice: places of values, then these times the hue where there is one.
@group(0) @binding(7) var<storage, read_write> field: array<f32>;
/// The largest place in each part of each brick.
@group(0) @binding(8) var<storage, read_write> densest: array<f32>;
/// The bits of samples: of the channel that is shown, and of the one that colours it.
@group(0) @binding(9) var shown: texture_3d<u32>;
@group(0) @binding(10) var hues: texture_3d<u32>;

#ifdef ATTRIBUTE
const VALUES: u32 = 2u;
#else
const VALUES: u32 = 1u;
#endif

/// The level's own indices.
fn own_index(index: vec3<f32>) -> vec3<f32> {
    return (index + 0.5) * samples.scale - 0.5;
}

// One invocation for each brick of the layers.
@compute @workgroup_size(64)
fn plan_field(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let index = number_of(group, groups) * 64u + lane;
    if index >= portion.bricks {
        return;
    }
    let brick = brick_of_tier(0u, index);
    for (var part = 0u; part < #{PARTS}u; part++) {
        densest[brick.held * #{PARTS}u + part] = 0.0;
    }
    if hidden[brick.column] != 0u {
        return;
    }
    // The box of indices around the brick's cells and those beside it.
    let corner = vec3(first_brick_of(portion.tiers[0]) + brick.place.xy, brick.layer) * BRICK;
    let first_cell = vec2<f32>(corner.xy) + 0.5 - f32(AROUND) - volume.middle;
    let last_cell = first_cell + f32(BRICK - 1u + 2u * AROUND);
    let first_slice = max(corner.z, AROUND) - AROUND;
    let last_slice = min(corner.z + BRICK - 1u + AROUND, volume.slices - 1u);
    var low = vec3(3.0e38);
    var high = vec3(-3.0e38);
    for (var end = 0u; end < 8u; end++) {
        let is_last = (vec3(end, end >> 1u, end >> 2u) & vec3(1u)) == vec3(1u);
        let line = lines[select(first_slice, last_slice, is_last.z)];
        let away = select(first_cell, last_cell, is_last.xy) * line.start.w;
        let at = line.start.xyz + away.x * samples.right.xyz - away.y * samples.up.xyz;
        low = min(low, at);
        high = max(high, at);
    }
    low = own_index(low);
    high = own_index(high);
    let last = vec3<f32>(samples.shape - 1u);
    if any(high < vec3(-1.0)) || any(low > last + 1.0) {
        return;
    }
    let first_block = vec3<u32>(clamp(floor(low), vec3(0.0), last)) / SAMPLE_BLOCK;
    let last_block = vec3<u32>(clamp(ceil(high), vec3(0.0), last)) / SAMPLE_BLOCK;
    var found = 0.0;
    for (var z = first_block.z; z <= last_block.z; z++) {
        for (var y = first_block.y; y <= last_block.y; y++) {
            let row = (z * samples.blocks.y + y) * samples.blocks.x;
            for (var x = first_block.x; x <= last_block.x; x++) {
                found = max(found, most[row + x]);
            }
        }
    }
    if found > volume.least {
        atomicStore(&items[HEADER + atomicAdd(&items[0], 1u)], index);
    }
}

/// A value's place between 1 and 2.
fn placed(value: f32) -> f32 {
    var at = value;
    var known = true;
    if samples.is_log != 0u {
        known = value > 0.0;
        at = log2(max(value, 1.0e-37));
    }
    return 1.0 + select(0.0, clamp((at - samples.low) * samples.per, 0.0, 1.0), known);
}

var<workgroup> largest: array<f32, 64>;
const LANES_OF_PART: u32 = 64u / #{PARTS}u;

// One workgroup for each brick that is listed, one invocation for each of its columns along z.
@compute @workgroup_size(64)
fn fill(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = number_of(group, groups);
    let is_listed = at < atomicLoad(&items[0]);
    var held = 0u;
    var found = 0.0;
    if is_listed {
        let brick = brick_of_tier(0u, atomicLoad(&items[HEADER + at]));
        held = brick.held;
        let corner = vec3(first_brick_of(portion.tiers[0]) + brick.place.xy, brick.layer) * BRICK;
        let cell = vec2<f32>(corner.xy + vec2(lane % BRICK, lane / BRICK)) + 0.5 - volume.middle;
        var out = held * VALUES * CELLS + lane;
        for (var slice = corner.z; slice < corner.z + BRICK; slice++) {
            let line = lines[min(slice, volume.slices - 1u)];
            let away = cell * line.start.w;
            let index = line.start.xyz + away.x * samples.right.xyz - away.y * samples.up.xyz;
            var inside = slice < volume.slices && all(index >= vec3(-0.5)) && all(index <= samples.ends.xyz);
            if samples.clip.w != 0.0 {
                let world = line.world.xyz + away.x * samples.world_right.xyz - away.y * samples.world_up.xyz;
                inside = inside && all(abs(world) <= samples.clip.xyz);
            }
            var value = 0.0;
            var weighted = 0.0;
            if inside {
                let place = place_of(own_index(index), samples.shape);
                let own = sample(shown, place);
                value = select(0.0, placed(own.value), own.known);
#ifdef ATTRIBUTE
                let hue = sample(hues, place);
                weighted = select(0.0, value * hue.value, hue.known);
#endif
            }
            field[out] = value;
#ifdef ATTRIBUTE
            field[out + CELLS] = weighted;
#endif
            found = max(found, value);
            out += BRICK * BRICK;
        }
    }
    largest[lane] = found;
    for (var stride = LANES_OF_PART / 2u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if lane % LANES_OF_PART < stride {
            largest[lane] = max(largest[lane], largest[lane + stride]);
        }
    }
    if is_listed && lane % LANES_OF_PART == 0u {
        densest[held * #{PARTS}u + lane / LANES_OF_PART] = largest[lane];
    }
}
