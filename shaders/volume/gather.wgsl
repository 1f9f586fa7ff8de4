// Resampling (F12 5.5): every brick gathers its own particles, so nothing is added by two invocations and no atomics on
// floats are needed. Each cell holds `sum m W(|r - r_j|, h_j)` at its centre, and `sum m A W` where there is an attribute. Bricks
// of all tiers are alike; what coarser ones add is interpolated later (interpolate.wgsl).
//
// One workgroup of 64 invocations for each brick of 8 x 8 x 8 cells. An invocation owns one column of eight cells along z, in
// registers: what is computed of a particle once serves eight cells, and a row of the brick is written in one go. The
// particles come 64 at a time through the workgroup's memory: one indirect read for the 64 cells' columns together, of those
// that may reach the brick by the quarters of the bin they are in, and a test against the brick. What is left of the 64 moves
// up, in its order: a software driver goes through a loop's body for all that it counts, whatever is skipped in it.
//
// With SUBGROUP (subgroups of exactly eight, as on a CPU driver) a workgroup is one subgroup, and a brick has four parts
// of two rows each: a lane owns two columns of a part. Lanes look at eight candidates at a time and list those that may reach
// the brick; then, part by part, they look at eight of the list and add those that reach the part one after the other. What is
// read of memory is most of the work there, lane by lane and word by word, and this reads least: one word of most candidates.
//
// Crowded bricks take several turns: a software driver ends an invocation's loops after 65535 rounds in all, without a word.
#import deepfield::volume_view::{Turn, number_of}
#import deepfield::volume_bricks::{volume, portion, brick_of, first_brick_of, middle_of}
#import deepfield::volume_constants::{BRICK, BRICK_SHIFT, CELLS, HEADER, PARTICLE_BITS}

@group(0) @binding(2) var<uniform> turn: Turn;
@group(0) @binding(3) var<storage, read> spots: array<vec4<f32>>;
/// Mass, and mass times attribute, with the kernel's factor over h^3.
@group(0) @binding(4) var<storage, read> amounts: array<vec2<f32>>;
/// Where each bin's particles begin.
@group(0) @binding(5) var<storage, read> bins: array<u32>;
/// The particles, bin by bin, and which quarters of it they may reach: see bin.wgsl.
@group(0) @binding(6) var<storage, read> candidates: array<u32>;
@group(0) @binding(7) var<storage, read> items: array<u32>;
/// Depth, spacing, cells per length and thickness of each slice.
@group(0) @binding(8) var<storage, read> depths: array<vec4<f32>>;
/// The cells of each brick, slice by slice: its densities, then `sum m A W` where there is an attribute.
@group(0) @binding(9) var<storage, read_write> field: array<f32>;
/// The largest density of each part of each brick.
@group(0) @binding(10) var<storage, read_write> densest: array<f32>;

#ifdef SUBGROUP
/// Most particles that are listed before they are added: a multiple of eight.
const ROOM: u32 = 2048u;
/// Particles that may reach the brick, and above PARTICLE_BITS one bit for each part that they may reach.
var<workgroup> listed: array<u32, ROOM>;
#else
/// Camera coordinates and 1 / h^2.
var<workgroup> staged_spots: array<vec4<f32>, 64>;
var<workgroup> staged_amounts: array<vec2<f32>, 64>;
/// One bit for each of 64 particles: it reaches the brick.
var<workgroup> reached: array<atomic<u32>, 2>;
var<workgroup> largest: array<f32, 64>;
#endif

/// The kernel at four squared distances in units of h, without its leading factor; 0 from 1 on.
fn kernel(q2: vec4<f32>) -> vec4<f32> {
#ifdef POLY6
    let t = max(1.0 - q2, vec4(0.0));
    return t * t * t;
#else ifdef QUARTIC_SPLINE
    // (1 - q)^4 - 5 (3/5 - q)^4 + 10 (1/5 - q)^4, each where its base is positive.
    let q = sqrt(q2);
    let a = max(1.0 - q, vec4(0.0));
    let b = max(0.6 - q, vec4(0.0));
    let c = max(0.2 - q, vec4(0.0));
    return a * a * a * a - 5.0 * (b * b * b * b) + 10.0 * (c * c * c * c);
#else ifdef QUINTIC_SPLINE
    // (1 - q)^5 - 6 (2/3 - q)^5 + 15 (1/3 - q)^5, each where its base is positive.
    let q = sqrt(q2);
    let a = max(1.0 - q, vec4(0.0));
    let b = max(2.0 / 3.0 - q, vec4(0.0));
    let c = max(1.0 / 3.0 - q, vec4(0.0));
    return a * a * a * a * a - 6.0 * (b * b * b * b * b) + 15.0 * (c * c * c * c * c);
#else ifdef WENDLAND_C2
    let q = sqrt(q2);
    let a = max(1.0 - q, vec4(0.0));
    return a * a * a * a * fma(q, vec4(4.0), vec4(1.0));
#else ifdef WENDLAND_C4
    let q = sqrt(q2);
    let a = max(1.0 - q, vec4(0.0));
    let a3 = a * a * a;
    return a3 * a3 * fma(q, fma(q, vec4(35.0 / 3.0), vec4(6.0)), vec4(1.0));
#else ifdef WENDLAND_C6
    let q = sqrt(q2);
    let a = max(1.0 - q, vec4(0.0));
    let a2 = a * a;
    let a4 = a2 * a2;
    return a4 * a4 * fma(q, fma(q, fma(q, vec4(32.0), vec4(25.0)), vec4(8.0)), vec4(1.0));
#else
    // 2 (1 - q)^3 - 8 (1/2 - q)^3, each where it is positive.
    let q = sqrt(q2);
    let a = max(1.0 - q, vec4(0.0));
    let b = max(0.5 - q, vec4(0.0));
    return fma(a * a, a + a, -8.0 * (b * b * b));
#endif
}

/// Writes four cells of a column, added to what other particles gave.
fn write_column(at: u32, values: vec4<f32>, add: bool) -> f32 {
    var sum = values;
    for (var i = 0u; i < 4u; i++) {
        if add {
            sum[i] += field[at + 64u * i];
        }
        field[at + 64u * i] = sum[i];
    }
    return max(max(sum.x, sum.y), max(sum.z, sum.w));
}

/// One bit for each quarter along x, y and z of its bin of a level in which a brick lies.
fn quarters_of(place: vec3<u32>, level: u32) -> vec3<u32> {
    let cell = (place & vec3((1u << level) - 1u)) * BRICK;
    let shift = vec3(level + BRICK_SHIFT - 2u);
    let marks = (vec3(2u) << ((cell + (BRICK - 1u)) >> shift)) - (vec3(1u) << (cell >> shift));
    return marks << (PARTICLE_BITS + vec3(0u, 4u, 8u));
}

/// Whether a candidate may reach a brick with such quarters.
fn may_reach(candidate: u32, quarters: vec3<u32>) -> bool {
    return all((vec3(candidate) & quarters) != vec3(0u));
}

/// The particle of a candidate.
fn particle_of(candidate: u32) -> u32 {
    return candidate & ((1u << PARTICLE_BITS) - 1u);
}

#ifdef SUBGROUP
/// One bit for each part of a brick that a candidate of a level's bin may reach, by the quarters along y: in the first level these
/// are the parts, in the second one each is two parts wide.
fn parts_of(candidate: u32, row: u32, level: u32) -> u32 {
    let along_y = (candidate >> (PARTICLE_BITS + 4u)) & 15u;
    let half = along_y >> (2u * (row & 1u));
    let of_half = select(0u, 3u, (half & 1u) != 0u) | select(0u, 12u, (half & 2u) != 0u);
    return select(select(15u, of_half, level == 1u), along_y, level == 0u);
}

/// The values of lanes 0 to 3.
fn first_lanes(value: f32) -> vec4<f32> {
    return vec4(
        subgroupBroadcast(value, 0u), subgroupBroadcast(value, 1u), subgroupBroadcast(value, 2u), subgroupBroadcast(value, 3u),
    );
}

/// The values of lanes 4 to 7.
fn last_lanes(value: f32) -> vec4<f32> {
    return vec4(
        subgroupBroadcast(value, 4u), subgroupBroadcast(value, 5u), subgroupBroadcast(value, 6u), subgroupBroadcast(value, 7u),
    );
}

/// Squared distance of a place from a box.
fn square_from(place: vec3<f32>, low: vec3<f32>, high: vec3<f32>) -> f32 {
    let away = max(max(low - place, place - high), vec3(0.0));
    return dot(away, away);
}

@compute @workgroup_size(8)
fn gather(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let item = number_of(group, groups);
    let later = turn.number > 0u;
    if item >= select(items[0], items[1], later) {
        return;
    }
    let brick = brick_of(items[HEADER + select(0u, volume.brick_room, later) + item]);
    let place = brick.place;
    let corner = vec3(first_brick_of(portion.tiers[brick.tier]) + place.xy, brick.layer) * BRICK;
    let first_slice = volume.tiers[brick.tier].first_slice + corner.z;
    let middle = middle_of(brick.tier);

    // Where the cells lie, in camera space.
    let slice = depths[first_slice + lane];
    let near_depth = first_lanes(slice.x);
    let far_depth = last_lanes(slice.x);
    let near_spacing = first_lanes(slice.y);
    let far_spacing = last_lanes(slice.y);
    let low_cell = (vec2<f32>(corner.xy) + 0.5 - middle) * vec2(1.0, -1.0);
    let near_x = (low_cell.x + f32(lane)) * near_spacing;
    let far_x = (low_cell.x + f32(lane)) * far_spacing;

    // The box around all of the brick's cell centres.
    let spacings = vec2(near_spacing.x, far_spacing.w);
    let left = low_cell.x * spacings;
    let right = (low_cell.x + 7.0) * spacings;
    let upper = low_cell.y * spacings;
    let lower = (low_cell.y - 7.0) * spacings;
    let box_low = vec3(min(left.x, left.y), min(lower.x, lower.y), near_depth.x);
    let box_high = vec3(max(right.x, right.y), max(upper.x, upper.y), far_depth.w);

    let held = brick.held;
    // Parts to which an earlier batch or turn has given something.
    var given = subgroupBallot(densest[held * #{PARTS}u + lane % #{PARTS}u] > 0.0).x;
    // Turn 0 takes the first candidates of all levels together, turn 1 the next, ...
    var before = turn.number * #{TURN}u;
    var left_over = #{TURN}u;
    let first_level = volume.tiers[brick.tier].first_level;
    let level_count = volume.tiers[brick.tier].level_count;
    var level = 0u;
    var base = 0u;
    var behind = 0u;
    var quarters = vec3(0u);
    var parts_level = 0u;
    // Bins of eight levels: one for each lane.
    var begins = 0u;
    var ends = 0u;
    loop {
        var count = 0u;
        loop {
            // The next bin that has candidates left.
            while base >= behind && level < level_count {
                if level % 8u == 0u {
                    let own = min(level + lane, level_count - 1u);
                    let bin_grid = volume.levels[first_level + own];
                    let bin_place = place >> vec3(own);
                    let bin = bin_grid.x + (bin_place.z * bin_grid.z + bin_place.y) * bin_grid.y + bin_place.x;
                    begins = bins[bin];
                    ends = bins[bin + 1u];
                }
                let begin = subgroupShuffle(begins, level % 8u);
                let end = subgroupShuffle(ends, level % 8u);
                let passed = min(before, end - begin);
                before -= passed;
                base = begin + passed;
                let taken = min(left_over, end - base);
                left_over -= taken;
                behind = base + taken;
                quarters = quarters_of(place, level);
                parts_level = level;
                level += 1u;
            }
            if base >= behind {
                break;
            }
            // As many as surely fit, in rounds of eight.
            let stop = min(behind, base + ((ROOM - count) & ~7u));
            loop {
                let candidate = candidates[min(base + lane, behind - 1u)];
                let reaches = base + lane < behind && may_reach(candidate, quarters);
                let found = subgroupBallot(reaches).x;
                if reaches {
                    listed[count + countOneBits(found & ((1u << lane) - 1u))] =
                        particle_of(candidate) | (parts_of(candidate, place.y, parts_level) << PARTICLE_BITS);
                }
                count += countOneBits(found);
                base += 8u;
                continuing {
                    break if base >= stop;
                }
            }
            continuing {
                break if count > ROOM - 8u;
            }
        }
        workgroupBarrier();
        for (var part = 0u; part < 4u && count > 0u; part++) {
            let upper_row = low_cell.y - 2.0 * f32(part);
            let lower_row = upper_row - 1.0;
            let near_upper = upper_row * near_spacing;
            let far_upper = upper_row * far_spacing;
            let near_lower = lower_row * near_spacing;
            let far_lower = lower_row * far_spacing;
            let part_upper = upper_row * spacings;
            let part_lower = lower_row * spacings;
            let part_low = vec3(box_low.x, min(part_lower.x, part_lower.y), box_low.z);
            let part_high = vec3(box_high.x, max(part_upper.x, part_upper.y), box_high.z);
            var near_upper_density = vec4(0.0);
            var far_upper_density = vec4(0.0);
            var near_lower_density = vec4(0.0);
            var far_lower_density = vec4(0.0);
#ifdef ATTRIBUTE
            var near_upper_weighted = vec4(0.0);
            var far_upper_weighted = vec4(0.0);
            var near_lower_weighted = vec4(0.0);
            var far_lower_weighted = vec4(0.0);
#endif
            var touched = false;
            var first = 0u;
            loop {
                let candidate = listed[min(first + lane, count - 1u)];
                var mine = vec4(0.0);
                var amounts_of_mine = vec2(0.0);
                var reaches = false;
                if first + lane < count && ((candidate >> (PARTICLE_BITS + part)) & 1u) != 0u {
                    mine = spots[particle_of(candidate)];
                    let square = mine.w * mine.w;
                    // The box is exact but for rounding: a thousandth more.
                    reaches = square_from(mine.xyz, part_low, part_high) < 1.001 * square;
                    mine.w = 1.0 / square;
                    if reaches {
                        amounts_of_mine = amounts[particle_of(candidate)];
                    }
                }
                var pending = subgroupBallot(reaches).x;
                first += 8u;
                if pending == 0u {
                    continue;
                }
                touched = true;
                loop {
                    let source = firstTrailingBit(pending);
                    pending &= pending - 1u;
                    let spot = subgroupShuffle(mine, source);
                    let amount = subgroupShuffle(amounts_of_mine, source);
                    let near_offset = near_x - spot.x;
                    let far_offset = far_x - spot.x;
                    let near_away = near_depth - spot.z;
                    let far_away = far_depth - spot.z;
                    let near_rest = fma(near_offset, near_offset, near_away * near_away);
                    let far_rest = fma(far_offset, far_offset, far_away * far_away);
                    let a = near_upper - spot.y;
                    let b = far_upper - spot.y;
                    let c = near_lower - spot.y;
                    let d = far_lower - spot.y;
                    let near_upper_value = kernel(fma(a, a, near_rest) * spot.w);
                    let far_upper_value = kernel(fma(b, b, far_rest) * spot.w);
                    let near_lower_value = kernel(fma(c, c, near_rest) * spot.w);
                    let far_lower_value = kernel(fma(d, d, far_rest) * spot.w);
                    near_upper_density = fma(vec4(amount.x), near_upper_value, near_upper_density);
                    far_upper_density = fma(vec4(amount.x), far_upper_value, far_upper_density);
                    near_lower_density = fma(vec4(amount.x), near_lower_value, near_lower_density);
                    far_lower_density = fma(vec4(amount.x), far_lower_value, far_lower_density);
#ifdef ATTRIBUTE
                    near_upper_weighted = fma(vec4(amount.y), near_upper_value, near_upper_weighted);
                    far_upper_weighted = fma(vec4(amount.y), far_upper_value, far_upper_weighted);
                    near_lower_weighted = fma(vec4(amount.y), near_lower_value, near_lower_weighted);
                    far_lower_weighted = fma(vec4(amount.y), far_lower_value, far_lower_weighted);
#endif
                    continuing {
                        break if pending == 0u;
                    }
                }
                continuing {
                    break if first >= count;
                }
            }
            // What is not written is not read either.
            if touched {
                let add = ((given >> part) & 1u) != 0u;
                let column = 2u * part * BRICK + lane;
#ifdef ATTRIBUTE
                let start = held * 2u * CELLS + column;
                let upper_weighted = start + CELLS;
                let a = write_column(upper_weighted, near_upper_weighted, add);
                let b = write_column(upper_weighted + 256u, far_upper_weighted, add);
                let c = write_column(upper_weighted + BRICK, near_lower_weighted, add);
                let d = write_column(upper_weighted + BRICK + 256u, far_lower_weighted, add);
#else
                let start = held * CELLS + column;
#endif
                let most_upper =
                    max(write_column(start, near_upper_density, add), write_column(start + 256u, far_upper_density, add));
                let most_lower = max(
                    write_column(start + BRICK, near_lower_density, add),
                    write_column(start + BRICK + 256u, far_lower_density, add),
                );
                let most = subgroupMax(max(most_upper, most_lower));
                if lane == 0u {
                    densest[held * #{PARTS}u + part] = most;
                }
                given |= 1u << part;
            }
        }
        if base >= behind && level >= level_count {
            break;
        }
        workgroupBarrier();
    }
}
#else
@compute @workgroup_size(64)
fn gather(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = number_of(group, groups);
    let later = turn.number > 0u;
    let listed = select(items[0], items[1], later);
    if at >= listed {
        return;
    }
    let brick = brick_of(items[HEADER + select(0u, volume.brick_room, later) + at]);
    let place = brick.place;
    let corner = vec3(first_brick_of(portion.tiers[brick.tier]) + place.xy, brick.layer) * BRICK;
    let first_slice = volume.tiers[brick.tier].first_slice + corner.z;
    let middle = middle_of(brick.tier);

    // Where the column's cells lie, in camera space.
    var near_depth: vec4<f32>;
    var far_depth: vec4<f32>;
    var near_spacing: vec4<f32>;
    var far_spacing: vec4<f32>;
    for (var i = 0u; i < 4u; i++) {
        let front = depths[first_slice + i];
        let back = depths[first_slice + 4u + i];
        near_depth[i] = front.x;
        near_spacing[i] = front.y;
        far_depth[i] = back.x;
        far_spacing[i] = back.y;
    }
    let cell = vec2<f32>(corner.xy) + vec2(f32(lane % BRICK), f32(lane / BRICK)) + 0.5;
    let offset = (cell - middle) * vec2(1.0, -1.0);
    let near_x = offset.x * near_spacing;
    let near_y = offset.y * near_spacing;
    let far_x = offset.x * far_spacing;
    let far_y = offset.y * far_spacing;

    // The box around all of the brick's cell centres.
    let low_cell = (vec2<f32>(corner.xy) + 0.5 - middle) * vec2(1.0, -1.0);
    let high_cell = low_cell + vec2(7.0, -7.0);
    let spacings = vec2(near_spacing.x, far_spacing.w);
    let left = min(low_cell.x * spacings.x, low_cell.x * spacings.y);
    let right = max(high_cell.x * spacings.x, high_cell.x * spacings.y);
    let top = max(low_cell.y * spacings.x, low_cell.y * spacings.y);
    let bottom = min(high_cell.y * spacings.x, high_cell.y * spacings.y);
    let box_low = vec3(left, bottom, near_depth.x);
    let box_high = vec3(right, top, far_depth.w);

    var near_density = vec4(0.0);
    var far_density = vec4(0.0);
#ifdef ATTRIBUTE
    var near_weighted = vec4(0.0);
    var far_weighted = vec4(0.0);
#endif
    // Turn 0 takes the first candidates of all levels together, turn 1 the next, ...
    var before = turn.number * #{TURN}u;
    var left_over = #{TURN}u;
    let first_level = volume.tiers[brick.tier].first_level;
    let level_count = volume.tiers[brick.tier].level_count;
    for (var level = 0u; level < level_count; level++) {
        let bin_grid = volume.levels[first_level + level];
        let bin_place = place >> vec3(level);
        let bin = bin_grid.x + (bin_place.z * bin_grid.z + bin_place.y) * bin_grid.y + bin_place.x;
        var begin = bins[bin];
        let end = bins[bin + 1u];
        let passed = min(before, end - begin);
        begin += passed;
        before -= passed;
        let taken = min(left_over, end - begin);
        left_over -= taken;
        let behind = begin + taken;
        let quarters = quarters_of(place, level);
        for (var base = begin; base < behind; base += 64u) {
            workgroupBarrier();
            if lane < 2u {
                atomicStore(&reached[lane], 0u);
            }
            workgroupBarrier();
            var spot = vec4(0.0);
            var amount = vec2(0.0);
            var reaches = false;
            let candidate = candidates[min(base + lane, behind - 1u)];
            if base + lane < behind && may_reach(candidate, quarters) {
                let particle = particle_of(candidate);
                spot = spots[particle];
                amount = amounts[particle];
                let away = max(max(box_low - spot.xyz, spot.xyz - box_high), vec3(0.0));
                let square = spot.w * spot.w;
                // The box is exact but for rounding: a thousandth more.
                reaches = dot(away, away) < 1.001 * square;
                spot.w = 1.0 / square;
            }
            if reaches {
                atomicOr(&reached[lane >> 5u], 1u << (lane & 31u));
            }
            workgroupBarrier();
            let low = atomicLoad(&reached[0]);
            let high = atomicLoad(&reached[1]);
            if reaches {
                let below = (1u << (lane & 31u)) - 1u;
                var rank = countOneBits(low & below);
                if lane >= 32u {
                    rank = countOneBits(low) + countOneBits(high & below);
                }
                staged_spots[rank] = spot;
                staged_amounts[rank] = amount;
            }
            workgroupBarrier();
            let staged = countOneBits(low) + countOneBits(high);
            for (var i = 0u; i < staged; i++) {
                let spot = staged_spots[i];
                let amount = staged_amounts[i];
                // The half of the column that the particle does not reach is passed over: for the many small ones that
                // is most of the brick.
                let x = near_x - spot.x;
                let y = near_y - spot.y;
                let z = near_depth - spot.z;
                let q2 = fma(x, x, fma(y, y, z * z)) * spot.w;
                if any(q2 < vec4(1.0)) {
                    let value = kernel(q2);
                    near_density = fma(vec4(amount.x), value, near_density);
#ifdef ATTRIBUTE
                    near_weighted = fma(vec4(amount.y), value, near_weighted);
#endif
                }
                let u = far_x - spot.x;
                let v = far_y - spot.y;
                let w = far_depth - spot.z;
                let r2 = fma(u, u, fma(v, v, w * w)) * spot.w;
                if any(r2 < vec4(1.0)) {
                    let value = kernel(r2);
                    far_density = fma(vec4(amount.x), value, far_density);
#ifdef ATTRIBUTE
                    far_weighted = fma(vec4(amount.y), value, far_weighted);
#endif
                }
            }
        }
    }

    let held = brick.held;
    // What an earlier batch or turn has written.
    let add = densest[held] > 0.0;
#ifdef ATTRIBUTE
    let first = held * 2u * CELLS + lane;
    let near_weighted_largest = write_column(first + CELLS, near_weighted, add);
    let far_weighted_largest = write_column(first + CELLS + 256u, far_weighted, add);
#else
    let first = held * CELLS + lane;
#endif
    let near_largest = write_column(first, near_density, add);
    largest[lane] = max(near_largest, write_column(first + 256u, far_density, add));
    for (var stride = 32u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if lane < stride {
            largest[lane] = max(largest[lane], largest[lane + stride]);
        }
    }
    if lane == 0u {
        densest[held] = largest[0];
    }
}
#endif
