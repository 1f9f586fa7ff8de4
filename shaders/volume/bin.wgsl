// Particles are binned to a slab. `count` finds how many particles a bin has, and how many bins each workgroup's particles
// are in; `pair` writes a pair of bin and particle for each of these, in the order of the particles. sort.wgsl brings
// the pairs into the order of the bins, in which each bin's particles keep theirs: so sums are the same to the last bit in
// every run, whichever workgroup is first.
//
// A particle goes to the coarsest tier in whose cells its kernel is still wide wherever it reaches. There, level 0 has a bin
// for each brick, level l one for each 2^l bricks along every axis. A particle goes to the finest level where it touches
// at most two bins along each axis, so to eight bins at most: near particles of any size cannot make the lists longer
// than eight times the particles, and a brick finds all that may reach it in one bin of each level. Beside the particle a pair
// holds which quarters of the bin it may reach along each axis, so that bricks of coarse bins can turn most of them down by that
// alone.
//
// `count` also counts the particles that the grid has enlarged: each in the slab of its centre, since nodes are looked at in every
// slab that they reach.
//
// With SUBGROUP (subgroups of exactly eight, as on a CPU driver) a workgroup is one subgroup that looks at eight particles
// after the other, and no barrier is needed.
#import deepfield::rectangle::reaches_between
#import deepfield::volume_view::number_of
#import deepfield::volume_bricks::{volume, portion, first_brick_of, first_layer_of, layers_of, scale_of, middle_of}
#import deepfield::volume_constants::{ALL_RAISED, BIN_GROUP, BORDER, BRICK, BRICK_SHIFT, PARTICLE_BITS, WIDE}
#ifndef SUBGROUP
#import deepfield::prefix::sum_up_to
#endif

/// Camera coordinates and smoothing length of each particle.
@group(0) @binding(2) var<storage, read> spots: array<vec4<f32>>;
/// At the index of each level's bins in front: 1 for bins that lie behind opaque pixels only.
@group(0) @binding(3) var<storage, read> hidden: array<u32>;
/// Number of particles of each bin.
@group(0) @binding(4) var<storage, read_write> bins: array<atomic<u32>>;
/// Number of pairs of each workgroup; for `pair` the place of its first one.
@group(0) @binding(5) var<storage, read_write> sums: array<u32>;
/// The bin of each pair; its particle, and above PARTICLE_BITS one bit for each quarter of the bin along x, y and z.
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> candidates: array<u32>;
/// What `count` finds of each particle, for `pair`.
@group(0) @binding(8) var<storage, read_write> reaches: array<Reach>;
/// At ALL_RAISED the number of particles that have been enlarged; see scan.wgsl.
@group(0) @binding(9) var<storage, read_write> work: array<atomic<u32>>;

/// The bins that a particle touches, in one level of those of all tiers: two along each axis at most.
struct Reach {
    /// The first one.
    bin: u32,
    /// One bit for each quarter of the first and the second bin along x, y and z: eight bits an axis. Above them one bit for
    /// each bin that the particle is in, the first along x being the lowest.
    quarters: u32,
    /// Bins of the level along x and, from bit 16 on, along y.
    size: u32,
}

const NOWHERE: Reach = Reach(0u, 0u, 0u);

/// The tier that a particle belongs to, by its width where cells are widest.
fn tier_of(spot: vec4<f32>) -> u32 {
    let cell = volume.sigma * select(1.0, spot.z + spot.w, volume.perspective != 0u);
    let doublings = firstLeadingBit(u32(clamp(spot.w / (WIDE * cell), 1.0, 1.0e9)));
    return min(doublings, volume.tier_count - 1u);
}

fn reach_of(spot: vec4<f32>) -> Reach {
    let h = spot.w;
    if h <= 0.0 {
        return NOWHERE;
    }
    let tier = tier_of(spot);
    let filled = portion.tiers[tier];
    let layers = layers_of(filled);
    if layers == 0u {
        return NOWHERE;
    }
    let nearest = filled.nearest;
    let farthest = filled.farthest;
    let away = max(max(nearest - spot.z, spot.z - farthest), 0.0);
    let square = h * h - away * away;
    if !(square > 0.0) {
        return NOWHERE;
    }
    let radius = sqrt(square);
    // The ends of the particle within what is filled; the end where it covers more cells counts.
    let ends = vec2(max(nearest, spot.z - h), min(farthest, spot.z + h));
    let perspective = volume.perspective != 0u;
    let scale = scale_of(tier);
    let rate = scale / (volume.sigma * select(vec2(1.0), ends, perspective));
    let center = vec2(spot.x, -spot.y);
    let left = center - radius;
    let right = center + radius;
    let slice_rate = scale * volume.slice_rate;
    // Slices begin as stored cells do, but without any before the near plane in the finest tier.
    let along = fma(
        vec2(slice_rate),
        select(ends - volume.near, log(ends / volume.near), perspective),
        vec2(2.0 * f32(BORDER) * (1.0 - scale)),
    );
    // A cell's centre lies at a half. Some room for rounding, and for how well an adapter knows logarithms; what gets into a
    // bin without reaching it is turned down later.
    let rounding = select(5.0e-7 * max(abs(ends.x), abs(ends.y)), 2.0e-5, perspective);
    let room = vec3(0.02, 0.02, 0.02 + rounding * slice_rate);
    let window_low = vec3<f32>(vec3(first_brick_of(filled), first_layer_of(filled)) * BRICK);
    let window_high = window_low + vec3<f32>(vec3(volume.tiers[tier].window, layers) * BRICK - 1u);
    let middle = middle_of(tier);
    let low = ceil(vec3(middle + min(left * rate.x, left * rate.y), along.x) - 0.5 - room);
    let high = floor(vec3(middle + max(right * rate.x, right * rate.y), along.y) - 0.5 + room);
    if any(high < window_low) || any(low > window_high) || any(low > high) {
        return NOWHERE;
    }
    let low_cell = vec3<u32>(max(low, window_low) - window_low);
    let high_cell = vec3<u32>(min(high, window_high) - window_low);
    let first = low_cell >> vec3(BRICK_SHIFT);
    let last = high_cell >> vec3(BRICK_SHIFT);
    // With as many doublings as the widest axis has bricks more than one, two bins are enough, or three.
    let more = last - first;
    var level = firstLeadingBit(max(max(more.x, more.y), max(more.z, 1u)));
    level += select(0u, 1u, any((last >> vec3(level)) - (first >> vec3(level)) > vec3(1u)));
    let grid = volume.levels[volume.tiers[tier].first_level + level];
    let at = first >> vec3(level);
    // Quarters of bins, counted from the first bin.
    let quarter = vec3(level + BRICK_SHIFT - 2u);
    let marks = (vec3(2u) << ((high_cell >> quarter) - 4u * at)) - (vec3(1u) << ((low_cell >> quarter) - 4u * at));
    let second = marks > vec3(15u);
    let inside = select(0x55u, 0xffu, second.x) & select(0x33u, 0xffu, second.y) & select(0x0fu, 0xffu, second.z);
    let column = grid.x + at.y * grid.y + at.x;
    // Bins that are hidden are so in all layers.
    var seen = 0u;
    var left_over = inside & 0x0fu;
    while left_over != 0u {
        let corner = firstTrailingBit(left_over);
        left_over &= left_over - 1u;
        if hidden[column + (corner >> 1u) * grid.y + (corner & 1u)] == 0u {
            seen |= 0x11u << corner;
        }
    }
    return Reach(
        column + at.z * grid.z * grid.y,
        marks.x | (marks.y << 8u) | (marks.z << 16u) | ((inside & seen) << 24u),
        grid.y | (grid.z << 16u),
    );
}

/// One of the eight bins that a particle may be in.
fn bin_of(reach: Reach, corner: u32) -> u32 {
    let row = reach.size & 0xffffu;
    let layer = row * (reach.size >> 16u);
    return reach.bin + (corner & 1u) + ((corner >> 1u) & 1u) * row + (corner >> 2u) * layer;
}

/// The finest tier's layer that a depth lies in.
fn layer_at(depth: f32) -> u32 {
    let inside = max(depth, volume.near);
    let along = select(inside - volume.near, log(inside / volume.near), volume.perspective != 0u);
    return min(u32(volume.slice_rate * along) >> BRICK_SHIFT, volume.last_layer);
}

/// Whether the grid has enlarged a particle that reaches into the picture, and this slab counts it.
fn is_raised_here(spot: vec4<f32>) -> bool {
    let perspective = volume.perspective != 0u;
    let least = volume.smallest * volume.sigma * select(1.0, max(spot.z, 0.0), perspective);
    // Some room for rounding. Windows look at the same particles: the first one counts.
    if spot.w <= 0.0 || spot.w > least * 1.000001 || any(portion.first_pixel > vec2(0u)) {
        return false;
    }
    let layer = layer_at(spot.z);
    let low = (f32(BORDER) - volume.middle) * volume.sigma;
    let high = low + volume.cells * volume.sigma;
    return layer >= portion.first_layer && layer < portion.first_layer + portion.layers
        && reaches_between(low, high, perspective, spot, vec2(0.0));
}

/// Where a number of raised particles begins above the number of pairs: a workgroup has 2^11 of these at most.
const RAISED_SHIFT: u32 = 16u;

/// Counts a particle into its bins; how many they are, and above RAISED_SHIFT whether it counts as enlarged.
fn enter(particle: u32) -> u32 {
    if particle >= portion.candidates {
        return 0u;
    }
    let spot = spots[particle];
    let reach = reach_of(spot);
    reaches[particle] = reach;
    var corners = reach.quarters >> 24u;
    while corners != 0u {
        let corner = firstTrailingBit(corners);
        corners &= corners - 1u;
        atomicAdd(&bins[bin_of(reach, corner)], 1u);
    }
    return countOneBits(reach.quarters >> 24u) | (select(0u, 1u, is_raised_here(spot)) << RAISED_SHIFT);
}

/// Notes what a workgroup's particles have come to.
fn note(number: u32, total: u32) {
    if number < arrayLength(&sums) {
        sums[number] = total & ((1u << RAISED_SHIFT) - 1u);
    }
    let raised = total >> RAISED_SHIFT;
    if raised > 0u {
        atomicAdd(&work[ALL_RAISED], raised);
    }
}

/// What `count` has found of a particle; none behind the last.
fn found(particle: u32) -> Reach {
    if particle >= portion.candidates {
        return NOWHERE;
    }
    return reaches[particle];
}

/// Writes a particle's pairs from a place on.
fn write(particle: u32, reach: Reach, first: u32) {
    var place = first;
    var corners = reach.quarters >> 24u;
    while corners != 0u {
        let corner = firstTrailingBit(corners);
        corners &= corners - 1u;
        let half = (vec3(corner) >> vec3(0u, 1u, 2u)) & vec3(1u);
        let marks = (vec3(reach.quarters) >> (vec3(0u, 8u, 16u) + 4u * half)) & vec3(15u);
        keys[place] = bin_of(reach, corner);
        candidates[place] = particle | ((marks.x | (marks.y << 4u) | (marks.z << 8u)) << PARTICLE_BITS);
        place += 1u;
    }
}

#ifdef SUBGROUP
@compute @workgroup_size(8)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = number_of(group, groups);
    var entered = 0u;
    for (var i = lane; i < BIN_GROUP; i += 8u) {
        entered += enter(number * BIN_GROUP + i);
    }
    let total = subgroupAdd(entered);
    if lane == 0u {
        note(number, total);
    }
}

@compute @workgroup_size(8)
fn pair(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = number_of(group, groups);
    var place = sums[number];
    for (var i = lane; i < BIN_GROUP; i += 8u) {
        let particle = number * BIN_GROUP + i;
        let reach = found(particle);
        let pairs = countOneBits(reach.quarters >> 24u);
        write(particle, reach, place + subgroupExclusiveAdd(pairs));
        place += subgroupAdd(pairs);
    }
}
#else
@compute @workgroup_size(256)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = number_of(group, groups);
    let total = sum_up_to(lane, enter(number * BIN_GROUP + lane));
    if lane == BIN_GROUP - 1u {
        note(number, total);
    }
}

@compute @workgroup_size(256)
fn pair(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = number_of(group, groups);
    let particle = number * BIN_GROUP + lane;
    let reach = found(particle);
    let pairs = countOneBits(reach.quarters >> 24u);
    let behind = sum_up_to(lane, pairs);
    write(particle, reach, sums[number] + behind - pairs);
}
#endif
