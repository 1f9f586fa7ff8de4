// Particles are binned to a slab. `count` finds how many particles a bin has, and how many bins each workgroup's particles
// are in; `pair` writes a pair of bin and particle for each of these, in the order of the particles. sort.wgsl brings
// the pairs into the order of the bins, in which each bin's particles keep theirs: so sums are the same to the last bit in
// every run, whichever workgroup is first.
//
// A particle goes to the coarsest tier in whose cells its kernel is still wide wherever it reaches. There, level 0 has a bin
// for each brick, level l one for each 2^l bricks along every axis. A particle goes to the finest level where it touches
// at most two bins along each axis, so to eight bins at most: near particles of any size cannot make the lists longer
// than eight times the particles, and a brick finds all that may reach it in one bin of each level.
#import deepfield::volume_view::{VolumeView, Portion, number_of}
#import deepfield::volume_constants::{BIN_GROUP, BRICK, BRICK_SHIFT, WIDE}
#import deepfield::prefix::sum_up_to

@group(0) @binding(0) var<uniform> volume: VolumeView;
@group(0) @binding(1) var<uniform> portion: Portion;
/// Camera coordinates and smoothing length of each particle.
@group(0) @binding(2) var<storage, read> spots: array<vec4<f32>>;
/// At the index of each level's bins in front: 1 for bins that lie behind opaque pixels only.
@group(0) @binding(3) var<storage, read> hidden: array<u32>;
/// Number of particles of each bin.
@group(0) @binding(4) var<storage, read_write> bins: array<atomic<u32>>;
/// Number of pairs of each workgroup; for `pair` the place of its first one.
@group(0) @binding(5) var<storage, read_write> sums: array<u32>;
/// The bin of each pair, and its particle.
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> particles: array<u32>;

const NOWHERE: u32 = 0xffffffffu;

/// The bins that a particle touches: first and last along each axis, in one level of those of all tiers.
struct Reach {
    low: vec3<u32>,
    high: vec3<u32>,
    level: u32,
    touches: bool,
}

/// The tier that a particle belongs to, by its width where cells are widest.
fn tier_of(spot: vec4<f32>) -> u32 {
    let cell = volume.sigma * select(1.0, spot.z + spot.w, volume.perspective != 0u);
    let cells = spot.w / cell;
    var tier = 0u;
    while tier + 1u < volume.tier_count && cells >= WIDE * f32(2u << tier) {
        tier += 1u;
    }
    return tier;
}

fn reach_of(spot: vec4<f32>) -> Reach {
    var reach = Reach(vec3(0u), vec3(0u), 0u, false);
    let h = spot.w;
    if h <= 0.0 {
        return reach;
    }
    let tier_index = tier_of(spot);
    let layers = portion.tiers[tier_index].layers;
    if layers == 0u {
        return reach;
    }
    let nearest = portion.tiers[tier_index].nearest;
    let farthest = portion.tiers[tier_index].farthest;
    let away = max(max(nearest - spot.z, spot.z - farthest), 0.0);
    let square = h * h - away * away;
    if !(square > 0.0) {
        return reach;
    }
    let radius = sqrt(square);
    // The ends of the particle within what is filled; the end where it covers more cells counts.
    let ends = vec2(max(nearest, spot.z - h), min(farthest, spot.z + h));
    let perspective = volume.perspective != 0u;
    let rate = 1.0 / (volume.tiers[tier_index].sigma * select(vec2(1.0), ends, perspective));
    let center = vec2(spot.x, -spot.y);
    let left = center - radius;
    let right = center + radius;
    let slice_rate = volume.tiers[tier_index].slice_rate;
    let along = fma(
        vec2(slice_rate),
        select(ends - volume.near, log(ends / volume.near), perspective),
        vec2(volume.tiers[tier_index].slice_shift),
    );
    // A cell's centre lies at a half. Some room for rounding, and for how well an adapter knows logarithms; what gets into a
    // bin without reaching it is turned down later.
    let rounding = select(5.0e-7 * max(abs(ends.x), abs(ends.y)), 2.0e-5, perspective);
    let room = vec3(0.02, 0.02, 0.02 + rounding * slice_rate);
    let first_brick = vec3(portion.tiers[tier_index].origin, portion.tiers[tier_index].first_layer);
    let window_low = vec3<f32>(first_brick * BRICK);
    let window_high = window_low + vec3<f32>(vec3(volume.tiers[tier_index].window, layers) * BRICK - 1u);
    let middle = volume.tiers[tier_index].middle;
    let low = ceil(vec3(middle + min(left * rate.x, left * rate.y), along.x) - 0.5 - room);
    let high = floor(vec3(middle + max(right * rate.x, right * rate.y), along.y) - 0.5 + room);
    if any(high < window_low) || any(low > window_high) || any(low > high) {
        return reach;
    }
    let first = vec3<u32>(max(low, window_low) - window_low) >> vec3(BRICK_SHIFT);
    let last = vec3<u32>(min(high, window_high) - window_low) >> vec3(BRICK_SHIFT);
    let level_count = volume.tiers[tier_index].level_count;
    var level = 0u;
    while level + 1u < level_count && any((last >> vec3(level)) - (first >> vec3(level)) > vec3(1u)) {
        level += 1u;
    }
    let first_level = volume.tiers[tier_index].first_level;
    return Reach(first >> vec3(level), last >> vec3(level), first_level + level, true);
}

/// One of the eight bins that a particle may touch; NOWHERE if it does not, or nobody would look.
fn bin_of(reach: Reach, corner: u32) -> u32 {
    let at = reach.low + (vec3(corner, corner >> 1u, corner >> 2u) & vec3(1u));
    if !reach.touches || any(at > reach.high) {
        return NOWHERE;
    }
    let grid = volume.levels[reach.level];
    if hidden[grid.x + at.y * grid.y + at.x] != 0u {
        return NOWHERE;
    }
    return grid.x + (at.z * grid.z + at.y) * grid.y + at.x;
}

/// A particle's reach; none behind the last.
fn reach_at(at: u32) -> Reach {
    var spot = vec4(0.0);
    if at < portion.candidates {
        spot = spots[at];
    }
    return reach_of(spot);
}

@compute @workgroup_size(256)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = number_of(group, groups);
    let reach = reach_at(number * BIN_GROUP + lane);
    var pairs = 0u;
    if reach.touches {
        for (var corner = 0u; corner < 8u; corner++) {
            let bin = bin_of(reach, corner);
            if bin != NOWHERE {
                atomicAdd(&bins[bin], 1u);
                pairs += 1u;
            }
        }
    }
    let total = sum_up_to(lane, pairs);
    if lane == 255u && number < arrayLength(&sums) {
        sums[number] = total;
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
    let reach = reach_at(particle);
    var pairs = 0u;
    if reach.touches {
        for (var corner = 0u; corner < 8u; corner++) {
            pairs += select(0u, 1u, bin_of(reach, corner) != NOWHERE);
        }
    }
    let behind = sum_up_to(lane, pairs);
    if pairs == 0u {
        return;
    }
    var place = sums[number] + behind - pairs;
    for (var corner = 0u; corner < 8u; corner++) {
        let bin = bin_of(reach, corner);
        if bin != NOWHERE {
            keys[place] = bin;
            particles[place] = particle;
            place += 1u;
        }
    }
}
