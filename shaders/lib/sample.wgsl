// Which particles of a node a thinned picture draws. The Rust twin, with the why, is crates/draw/src/mode/sample.rs: both must keep
// the same particles.
#define_import_path deepfield::sample

/// Particles that are ranked among themselves.
const GROUP: u32 = 64u;
/// Places that a particle can have.
const PLACES: f32 = 16777216.0;

fn mix_bits(bits: u32) -> u32 {
    var x = (bits ^ (bits >> 16u)) * 0x7feb352du;
    x = (x ^ (x >> 15u)) * 0x846ca68bu;
    return x ^ (x >> 16u);
}

/// The coins of a group: one for each inner node of a binary tree over its particles.
fn tosses(group: u32) -> vec2<u32> {
    let first = mix_bits(group);
    return vec2(first, mix_bits(first ^ 0x9e3779b9u));
}

/// The coin at the end of `path`, which has `level` steps.
fn coin(coins: vec2<u32>, level: u32, path: u32) -> u32 {
    return select(coins.y >> path, coins.x >> ((1u << level) - 1u + path), level < 5u) & 1u;
}

/// The place in its group of the particle with this rank.
fn lane_of(coins: vec2<u32>, rank: u32) -> u32 {
    var path = 0u;
    for (var level = 0u; level < 6u; level++) {
        path = (path << 1u) | (((rank >> level) & 1u) ^ coin(coins, level, path));
    }
    return path;
}

/// The rank of the particle at this place in its group.
fn rank_of(coins: vec2<u32>, lane: u32) -> u32 {
    var rank = 0u;
    for (var level = 0u; level < 6u; level++) {
        let path = lane >> (6u - level);
        rank |= (((lane >> (5u - level)) & 1u) ^ coin(coins, level, path)) << level;
    }
    return rank;
}

/// The factor on the weight of a particle; 0 if it is not drawn.
fn sample_factor(seed: u32, scale: f32, index: u32, importance: f32) -> f32 {
    let p = importance * scale;
    if p >= 1.0 {
        return 1.0;
    }
    let group = seed + index / GROUP;
    let lane = index % GROUP;
    let jitter = mix_bits(group ^ ((lane + 1u) * 0x9e3779b9u)) >> 14u;
    let place = (rank_of(tosses(group), lane) << 18u) | jitter;
    return select(0.0, 1.0 / p, f32(place) < p * PLACES);
}
