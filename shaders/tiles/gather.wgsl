// Particles of the picture, as the passes want them that list them by tiles: in camera space, those alone that are seen, in the
// order of the draw list whichever workgroup is first. One workgroup for each block of particles.
//
// `survey` counts the particles of each interval of depths; plan.wgsl makes slabs of these that fit into memory. For each
// slab, `count` counts those of each block, and `gather` writes them.
#import deepfield::particle::{block_of, blocks, nodes, camera_axes, load_particle, Block}
#import deepfield::prefix::sum_up_to
#import deepfield::rectangle::reaches_between
#import deepfield::tile_constants::{INTERVALS, SHARE}
#import deepfield::tile_view::{TileView, Portion, Spot, key_of, layer_of}

@group(1) @binding(0) var<uniform> tiles: TileView;
@group(1) @binding(1) var<uniform> portion: Portion;
/// For each slab its first interval of depths and the one behind its last, and how many particles of these are left out.
@group(1) @binding(2) var<storage, read> slabs: array<vec4<u32>>;
/// Particles of each block; for `gather` those of the blocks before it.
@group(1) @binding(3) var<storage, read_write> sums: array<u32>;
/// Particles of each interval.
@group(1) @binding(3) var<storage, read_write> intervals: array<atomic<u32>>;
@group(1) @binding(4) var<storage, read_write> spots: array<Spot>;

/// Whether any line of sight may meet the particle, and it is one of those that are drawn.
fn is_seen(spot: Spot) -> bool {
    let p = spot.place.xyz;
    let radius = spot.place.w * tiles.extent;
    let perspective = tiles.perspective != 0u;
    let low = -tiles.middle / tiles.focal;
    let high = (vec2<f32>(tiles.size) - tiles.middle) / tiles.focal;
    // Some room for rounding: what is not seen after all meets no pixel.
    let room = 1.0e-5 * (abs(p.xy) + select(1.0, abs(p.z), perspective));
    let inside = reaches_between(low, high, perspective, vec4(p, radius), room);
    let around = select(0.0, spot.place.w, tiles.spread != 0u);
    return spot.mass > 0.0 && radius > 0.0 && spot.density > tiles.least && p.z + around >= tiles.planes.x
        && p.z - around <= tiles.planes.y && inside;
}

/// The keys that a particle is listed with, of those of a slab: the first, and how many follow each other.
fn keys_of(spot: Spot, slab: vec4<u32>) -> vec2<u32> {
    if !is_seen(spot) {
        return vec2(0u);
    }
    let by_distance = tiles.over != 0u && tiles.perspective != 0u;
    let depth = select(spot.place.z, length(spot.place.xyz), by_distance);
    if tiles.layers == 0u {
        let key = key_of(tiles, depth - tiles.lead * spot.place.w * tiles.extent);
        let interval = min(key >> tiles.interval_shift, INTERVALS - 1u);
        return vec2(key, select(0u, 1u, interval >= slab.x && interval < slab.y));
    }
    // Each layer is an interval of its own.
    let around = select(0.0, spot.place.w, tiles.spread != 0u);
    let first = max(layer_of(tiles, depth - around), slab.x);
    let behind = min(layer_of(tiles, depth + around) + 1u, slab.y);
    return vec2(first, behind - min(first, behind));
}

/// The smoothing length of a splat blurred by a kernel of some pixels (crates/draw/src/cpu/over/blurred.rs). What has no end in the picture is large
/// enough.
fn blurred(place: vec4<f32>) -> f32 {
    let h = place.w;
    if tiles.perspective == 0u {
        return length(vec2(h, tiles.blur / tiles.focal));
    }
    if !(place.z > h) {
        return h;
    }
    // What it covers is shortest across the direction of the picture's middle, as seen where it is nearest to that.
    let away = length(place.xyz);
    let slim = h / away;
    let aside = length(place.xy) / away;
    var nearest = 1.0;
    if aside > slim {
        nearest = place.z / away * sqrt(1.0 - slim * slim) + aside * slim;
    }
    return length(vec2(h, tiles.blur * away * nearest / tiles.focal));
}

/// The own column of a splat: by its density, or where that tells nothing through its middle.
fn own_column(spot: Spot) -> f32 {
    let by_density = tiles.column_factor * pow(max(spot.density, 1.0e-37), tiles.column_power);
    let through = spot.mass / (tiles.column_area * spot.place.w * spot.place.w);
    return select(through, by_density, spot.density > 0.0 && by_density > 0.0 && by_density < 3.0e38);
}

fn spot_at(axes: mat3x3<f32>, block: Block, number: u32) -> Spot {
    var spot = Spot(vec4(0.0), 0.0, 0.0, 0.0, 0u);
    if number >= block.count {
        return spot;
    }
    let particle = load_particle(axes, nodes[block.node], block.first + number);
    spot = Spot(
        vec4(particle.position, particle.smoothing_length),
        particle.weight,
        particle.density * tiles.density_scale,
        particle.quantity,
        0u,
    );
    if tiles.over != 0u && spot.place.w > 0.0 {
        spot.density = own_column(spot);
        spot.place.w = blurred(spot.place);
    }
    let least = tiles.smallest * select(1.0, max(spot.place.z, 0.0), tiles.perspective != 0u);
    if spot.place.w < least && spot.place.w > 0.0 {
        let share = spot.place.w / least;
        spot.density *= share * share * share;
        spot.place.w = least;
    }
    return spot;
}

/// How often an invocation's particles are listed: SHARE that follow each other, so that their order is kept.
fn listed_of(axes: mat3x3<f32>, block: Block, lane: u32, slab: vec4<u32>) -> u32 {
    var listed = 0u;
    // Slabs that nothing is left for are empty.
    if slab.x < slab.y {
        for (var i = 0u; i < SHARE; i++) {
            listed += keys_of(spot_at(axes, block, lane * SHARE + i), slab).y;
        }
    }
    return listed;
}

@compute @workgroup_size(256)
fn survey(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = block_of(group, groups);
    let axes = camera_axes();
    for (var i = 0u; i < SHARE; i++) {
        let keys = keys_of(spot_at(axes, block, lane * SHARE + i), vec4(0u, INTERVALS, 0u, 0u));
        for (var key = keys.x; key < keys.x + keys.y; key++) {
            atomicAdd(&intervals[min(key >> tiles.interval_shift, INTERVALS - 1u)], 1u);
        }
    }
}

@compute @workgroup_size(256)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = group.y * groups.x + group.x;
    let listed = listed_of(camera_axes(), block_of(group, groups), lane, slabs[portion.slab]);
    let total = sum_up_to(lane, listed);
    if lane == 255u && at < arrayLength(&blocks) {
        sums[portion.first_block + at] = total;
    }
}

@compute @workgroup_size(256)
fn gather(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = group.y * groups.x + group.x;
    let block = block_of(group, groups);
    let axes = camera_axes();
    let slab = slabs[portion.slab];
    let listed = listed_of(axes, block, lane, slab);
    let behind = sum_up_to(lane, listed);
    if listed == 0u {
        return;
    }
    var place = sums[portion.first_block + at] + behind - listed;
    for (var i = 0u; i < SHARE; i++) {
        var spot = spot_at(axes, block, lane * SHARE + i);
        let keys = keys_of(spot, slab);
        for (var key = keys.x; key < keys.x + keys.y; key++) {
            // Of an interval that is more than one slab, each slab has a part.
            if place >= slab.z && place - slab.z < portion.most {
                spot.key = key;
                spots[place - slab.z] = spot;
            }
            place += 1u;
        }
    }
}
