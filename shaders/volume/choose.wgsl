// To which bricks wide particles add something that may show. A brick of a tier reads eight cells of the next one along each
// axis, in eight bricks at most: the one at half its place, and the next where its place is odd.
//
// In the finest tier a brick is left out where neither it nor one beside it may be denser than what shows nothing: `mark` says
// which may, by bounds of what they hold and of what is added. The last layer of a slab is chosen from again with the next
// slab, when the layer behind it is known; nothing has looked at what was left out until then.
#import deepfield::volume_view::{Turn, number_of}
#import deepfield::volume_bricks::{volume, portion, brick_of_tier}
#import deepfield::volume_constants::{CHOSEN, HEADER, OVERSHOOT}

@group(0) @binding(2) var<uniform> turn: Turn;
/// At the index of each level's bins in front: 1 for bins that lie behind opaque pixels only.
@group(0) @binding(3) var<storage, read> hidden: array<u32>;
/// The largest amount in each part of each brick that is held.
@group(0) @binding(4) var<storage, read> densest: array<f32>;
/// For each brick of the finest tier that is held: 1 if it may show; 1 if it has been chosen.
@group(0) @binding(5) var<storage, read_write> marks: array<u32>;
/// Numbers of bricks that are chosen, one for each tier; then each brick's index, and which parts of the next tier it reads.
@group(0) @binding(6) var<storage, read_write> items: array<atomic<u32>>;
/// Workgroups along x, y and z for the bricks that are chosen.
@group(0) @binding(7) var<storage, read_write> dispatch: array<u32>;

/// What a brick reads of the next tier.
struct Under {
    /// The largest amount.
    peak: f32,
    /// One bit for each part that holds something: parts of the brick at half the place, the next along x, y, both, and the
    /// same for the next layer.
    parts: u32,
}

fn under(tier: u32, place: vec2<u32>, layer: u32) -> Under {
    let coarse = tier + 1u;
    let window = volume.tiers[coarse].window;
    let ring = volume.tiers[coarse].ring;
    let first_brick = volume.tiers[coarse].first_brick;
    let brick = vec3(portion.tiers[tier].origin + place, layer);
    let first = (brick >> vec3(1u)) - vec3(portion.tiers[coarse].origin, 0u);
    let odd = brick & vec3(1u);
    var found = Under(0.0, 0u);
    for (var corner = 0u; corner < 8u; corner++) {
        let next = vec3(corner, corner >> 1u, corner >> 2u) & vec3(1u);
        let at = first + next;
        if any(next > odd) || any(at.xy >= window) {
            continue;
        }
        let held = first_brick + (at.z % ring * window.y + at.y) * window.x + at.x;
        for (var part = 0u; part < #{PARTS}u; part++) {
            let amount = densest[held * #{PARTS}u + part];
            found.peak = max(found.peak, amount);
            found.parts |= select(0u, 1u << (corner * #{PARTS}u + part), amount > 0.0);
        }
    }
    return found;
}

fn is_hidden(tier: u32, column: u32) -> bool {
    return hidden[volume.levels[volume.tiers[tier].first_level].x + column] != 0u;
}

// One invocation for each brick of the finest tier that is filled.
@compute @workgroup_size(64)
fn mark(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let index = number_of(group, groups) * 64u + lane;
    let columns = volume.window.x * volume.window.y;
    if index >= columns * portion.layers {
        return;
    }
    let brick = brick_of_tier(0u, index);
    var shows = false;
    if !is_hidden(0u, brick.column) {
        var own = 0.0;
        for (var part = 0u; part < #{PARTS}u; part++) {
            own = max(own, densest[brick.held * #{PARTS}u + part]);
        }
        // A thousandth more, for rounding.
        shows = 1.001 * (own + OVERSHOOT * under(0u, brick.place.xy, brick.layer).peak) > volume.least;
    }
    marks[2u * brick.held] = select(0u, 1u, shows);
    marks[2u * brick.held + 1u] = 0u;
}

/// Whether a brick of the finest tier or one beside it may show, of the layers from `first` on.
fn shows_near(place: vec2<u32>, layer: u32, first: u32) -> bool {
    let window = volume.window;
    let low = max(place, vec2(1u)) - 1u;
    let high = min(place + 1u, window - 1u);
    let last = min(layer + 1u, portion.first_layer + portion.layers - 1u);
    var found = 0u;
    for (var z = max(layer, first + 1u) - 1u; z <= last; z++) {
        for (var y = low.y; y <= high.y; y++) {
            for (var x = low.x; x <= high.x; x++) {
                found |= marks[2u * ((z % volume.ring * window.y + y) * window.x + x)];
            }
        }
    }
    return found != 0u;
}

// One invocation for each brick of a tier that is filled, and of the finest one's layer before.
@compute @workgroup_size(64)
fn choose(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tier = turn.number;
    let window = volume.tiers[tier].window;
    let columns = window.x * window.y;
    let index = number_of(group, groups) * 64u + lane;
    // Of the finest tier the first ones are those of the layer before.
    let first_layer = portion.tiers[tier].first_layer;
    let first = select(first_layer, max(first_layer, 1u) - 1u, tier == 0u);
    let layer = first + index / columns;
    let column = index % columns;
    if layer >= first_layer + portion.tiers[tier].layers || is_hidden(tier, column) {
        return;
    }
    let place = vec2(column % window.x, column / window.x);
    let mark = 2u * (layer % volume.ring * columns + column);
    if tier == 0u && (marks[mark + 1u] != 0u || !shows_near(place, layer, first)) {
        return;
    }
    let found = under(tier, place, layer);
    if found.parts == 0u {
        return;
    }
    if tier == 0u {
        marks[mark + 1u] = 1u;
    }
    let item = HEADER + 2u * atomicAdd(&items[CHOSEN + tier], 1u);
    atomicStore(&items[item], index);
    atomicStore(&items[item + 1u], found.parts);
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
