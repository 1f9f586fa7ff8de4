// To which bricks wide particles add something that may show. A brick of a tier reads eight cells of the next one along each
// axis, in eight bricks at most: the one at half its place, and the next where its place is odd.
//
// Of the finest tier a brick is left out where nothing that it holds may show, and of the next one a brick that none of
// these reads; coarser tiers have so few bricks that all are chosen. `bound` and `mark` find how dense bricks may become at most,
// by what they hold of their own and by what is known of the next tier: more than it has come to there, unless it is
// complete. So first the coarser tiers are completed; then `mark` and `need` say which bricks of the second tier are wanted; and
// when these are complete too, `mark` knows better which of the finest tier may show. Of that a brick beside one that may
// show is read too, but not (ALONE) where rays go through cells' centres, meet no surfaces and are not lit.
//
// Bricks of layers that slabs before have filled are chosen from again: whether they are needed is known only
// when what is behind them is. Nothing has looked at what was left out until then.
#import deepfield::volume_view::{Turn, number_of}
#import deepfield::volume_bricks::{
    volume, portion, brick_of_tier, first_brick_of, first_layer_of, first_layer_read, layers_of,
}
#import deepfield::volume_constants::{CHOSEN, HEADER, OVERSHOOT}

@group(0) @binding(2) var<uniform> turn: Turn;
/// At the index of each level's bins in front: 1 for bins that lie behind opaque pixels only.
@group(0) @binding(3) var<storage, read> hidden: array<u32>;
/// The largest amount in each part of each brick that is held.
@group(0) @binding(4) var<storage, read> densest: array<f32>;
/// For each brick that is held: 1 if it may show (finest tier) or is wanted (others); 1 if it has been chosen.
@group(0) @binding(5) var<storage, read_write> marks: array<atomic<u32>>;
/// Numbers of bricks that are chosen, one for each tier; then each brick's index, and which parts of the next tier it reads.
@group(0) @binding(6) var<storage, read_write> items: array<atomic<u32>>;
/// Workgroups along x, y and z for the bricks that are chosen.
@group(0) @binding(7) var<storage, read_write> dispatch: array<u32>;
/// The largest amount that each brick of the coarser tiers may come to, before it has been chosen.
@group(0) @binding(8) var<storage, read_write> bounds: array<f32>;

const NOTHING: u32 = 0xffffffffu;

/// Index among the bricks that are held of one of the eight of the next tier that a brick reads; NOTHING if it does not.
fn brick_read(tier: u32, brick: vec3<u32>, corner: u32) -> u32 {
    let coarse = tier + 1u;
    let window = volume.tiers[coarse].window;
    let next = vec3(corner, corner >> 1u, corner >> 2u) & vec3(1u);
    let at = (brick >> vec3(1u)) - vec3(first_brick_of(portion.tiers[coarse]), 0u) + next;
    if any(next > (brick & vec3(1u))) || any(at.xy >= window) {
        return NOTHING;
    }
    return volume.tiers[coarse].first_brick + (at.z % volume.tiers[coarse].ring * window.y + at.y) * window.x + at.x;
}

/// A brick's place in the grid of its tier.
fn in_grid(tier: u32, place: vec2<u32>, layer: u32) -> vec3<u32> {
    return vec3(first_brick_of(portion.tiers[tier]) + place, layer);
}

/// The largest amount in a brick that is held, of its own particles or all.
fn peak(held: u32) -> f32 {
    var found = 0.0;
    for (var part = 0u; part < #{PARTS}u; part++) {
        found = max(found, densest[held * #{PARTS}u + part]);
    }
    return found;
}

/// How much a brick may come to at most, of its own particles and of all coarser tiers.
fn bound_of(tier: u32, place: vec2<u32>, layer: u32, held: u32) -> f32 {
    var under = 0.0;
    if tier + 1u < volume.tier_count {
        let brick = in_grid(tier, place, layer);
        for (var corner = 0u; corner < 8u; corner++) {
            let next = brick_read(tier, brick, corner);
            if next != NOTHING {
                let complete = atomicLoad(&marks[2u * next + 1u]) != 0u;
                under = max(under, select(bounds[next], peak(next), complete));
            }
        }
    }
    // A thousandth more, for rounding.
    return 1.001 * (peak(held) + OVERSHOOT * under);
}

fn is_hidden(tier: u32, column: u32) -> bool {
    return hidden[volume.levels[volume.tiers[tier].first_level].x + column] != 0u;
}

// One invocation for each brick of a coarser tier that is filled.
@compute @workgroup_size(64)
fn bound(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tier = turn.number;
    let index = number_of(group, groups) * 64u + lane;
    let window = volume.tiers[tier].window;
    if index >= window.x * window.y * layers_of(portion.tiers[tier]) {
        return;
    }
    let brick = brick_of_tier(tier, index);
    bounds[brick.held] = bound_of(tier, brick.place.xy, brick.layer, brick.held);
    atomicStore(&marks[2u * brick.held], select(0u, 1u, tier > 1u));
    atomicStore(&marks[2u * brick.held + 1u], 0u);
}

// One invocation for each brick of the finest tier that is filled.
@compute @workgroup_size(64)
fn mark(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let index = number_of(group, groups) * 64u + lane;
    if index >= volume.window.x * volume.window.y * portion.layers {
        return;
    }
    let brick = brick_of_tier(0u, index);
    var shows = false;
    if !is_hidden(0u, brick.column) {
        shows = bound_of(0u, brick.place.xy, brick.layer, brick.held) > volume.least;
    }
    atomicStore(&marks[2u * brick.held], select(0u, 1u, shows));
    atomicStore(&marks[2u * brick.held + 1u], 0u);
}

/// Whether a brick of the finest tier, or one beside it, may show, of the layers from `first` on.
fn shows_near(place: vec2<u32>, layer: u32, first: u32) -> bool {
    let window = volume.window;
#ifdef ALONE
    return atomicLoad(&marks[2u * ((layer % volume.ring * window.y + place.y) * window.x + place.x)]) != 0u;
#else
    let low = max(place, vec2(1u)) - 1u;
    let high = min(place + 1u, window - 1u);
    let last = min(layer + 1u, portion.first_layer + portion.layers - 1u);
    var found = 0u;
    for (var z = max(layer, first + 1u) - 1u; z <= last; z++) {
        for (var y = low.y; y <= high.y; y++) {
            for (var x = low.x; x <= high.x; x++) {
                found |= atomicLoad(&marks[2u * ((z % volume.ring * window.y + y) * window.x + x)]);
            }
        }
    }
    return found != 0u;
#endif
}

/// A brick that wants what the next tier holds.
struct Wanting {
    wants: bool,
    held: u32,
    /// Its place in the grid of its tier.
    brick: vec3<u32>,
}

/// The brick with an index among those of a tier that the slab may read.
fn wanting(tier: u32, index: u32) -> Wanting {
    let filled = portion.tiers[tier];
    let window = volume.tiers[tier].window;
    let columns = window.x * window.y;
    let first = first_layer_read(tier);
    let layer = first + index / columns;
    let column = index % columns;
    if layer >= first_layer_of(filled) + layers_of(filled) || is_hidden(tier, column) {
        return Wanting(false, 0u, vec3(0u));
    }
    let place = vec2(column % window.x, column / window.x);
    let held = volume.tiers[tier].first_brick + layer % volume.tiers[tier].ring * columns + column;
    var wants = atomicLoad(&marks[2u * held + 1u]) == 0u;
    if tier == 0u {
        wants = wants && shows_near(place, layer, first);
    } else {
        wants = wants && atomicLoad(&marks[2u * held]) != 0u;
    }
    return Wanting(wants, held, in_grid(tier, place, layer));
}

// One invocation for each brick of the finest tier that the slab may read.
@compute @workgroup_size(64)
fn need(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let found = wanting(0u, number_of(group, groups) * 64u + lane);
    if !found.wants {
        return;
    }
    for (var corner = 0u; corner < 8u; corner++) {
        let next = brick_read(0u, found.brick, corner);
        if next != NOTHING {
            atomicStore(&marks[2u * next], 1u);
        }
    }
}

// One invocation for each brick of a tier that the slab may read.
@compute @workgroup_size(64)
fn choose(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tier = turn.number;
    let index = number_of(group, groups) * 64u + lane;
    let found = wanting(tier, index);
    if !found.wants {
        return;
    }
    // One bit for each part that holds something: parts of the brick at half the place, the next along x, y, both, and the
    // same for the next layer.
    var parts = 0u;
    for (var corner = 0u; corner < 8u; corner++) {
        let next = brick_read(tier, found.brick, corner);
        if next != NOTHING {
            for (var part = 0u; part < #{PARTS}u; part++) {
                let holds = densest[next * #{PARTS}u + part] > 0.0;
                parts |= select(0u, 1u << (corner * #{PARTS}u + part), holds);
            }
        }
    }
    if parts == 0u {
        return;
    }
    atomicStore(&marks[2u * found.held + 1u], 1u);
    let item = HEADER + 2u * atomicAdd(&items[CHOSEN + tier], 1u);
    atomicStore(&items[item], index);
    atomicStore(&items[item + 1u], parts);
}

// One invocation.
@compute @workgroup_size(1)
fn dispatch_chosen() {
    let number = atomicLoad(&items[CHOSEN + turn.number]);
    // One dimension holds at most 65535.
    dispatch[7] = min(number, 32768u);
    dispatch[8] = (number + 32767u) / 32768u;
    dispatch[9] = 1u;
}
