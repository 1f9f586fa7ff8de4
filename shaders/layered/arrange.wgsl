// Particles in the order of their layers, as splats (F12 5.10): whole, or what of each lies in the layer, as
// src/cpu/layered/caps.rs cuts it. One invocation for each.
#import deepfield::layer_view::{LayerView, Part, KIND_BITS, INSIDE}
#import deepfield::particle::Particle
#import deepfield::projection::{Camera, project}
#import deepfield::splat_view::{SMALL, EVERYWHERE, INVISIBLE, DROPPED}
#import deepfield::tile_reach::tiles_between
#import deepfield::tile_view::{TileView, Spot, front_of}

@group(0) @binding(0) var<uniform> tiles: TileView;
/// Number of particles.
@group(0) @binding(1) var<storage, read> work: array<u32>;
@group(0) @binding(2) var<storage, read> spots: array<Spot>;
/// Their numbers in the order of layers.
@group(0) @binding(3) var<storage, read> ranks: array<u32>;
@group(0) @binding(4) var<storage, read_write> arranged: array<Part>;
/// The tiles that each reaches.
@group(0) @binding(5) var<storage, read_write> reaches: array<vec2<u32>>;
@group(1) @binding(0) var<uniform> layered: LayerView;
/// At equal steps of depth from a kernel's centre: mass and second moment up to there, and the moment of depth from there on.
@group(1) @binding(1) var<storage, read> caps: array<vec4<f32>>;

/// Mass, second moment and moment of depth of a kernel in front of a plane.
fn below(zeta: f32) -> vec3<f32> {
    let last = arrayLength(&caps) - 1u;
    let position = min(abs(zeta), 1.0) * f32(last);
    let index = min(u32(position), last - 1u);
    let sums = mix(caps[index].xyz, caps[index + 1u].xyz, position - f32(index));
    let half = vec2(0.5, caps[last].y);
    return vec3(half + select(1.0, -1.0, zeta < 0.0) * sums.xy, -sums.z);
}

@compute @workgroup_size(256)
fn arrange(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if at >= work[0] {
        return;
    }
    let spot = spots[ranks[at]];
    var particle = Particle(spot.place.xyz, spot.place.w, spot.mass, spot.quantity, 0.0);
    if tiles.spread != 0u {
        let front = (front_of(tiles, spot.key) - spot.place.z) / spot.place.w;
        let back = (front_of(tiles, spot.key + 1u) - spot.place.z) / spot.place.w;
        let cut = below(back) - below(front);
        // Of a whole kernel.
        let second = 2.0 * caps[arrayLength(&caps) - 1u].y;
        let is_some = cut.x > 1.0e-7 && cut.y > 0.0;
        let mass = select(1.0, cut.x, is_some);
        particle.weight *= select(0.0, mass, is_some);
        particle.position.z += spot.place.w * clamp(cut.z / mass, front, back);
        particle.smoothing_length *= select(1.0, clamp(sqrt(cut.y / (mass * second)), 0.01, 1.25), is_some);
    }
    let perspective = tiles.perspective != 0u;
    // A parallel projection has layers behind its eye plane too.
    let nearest = select(-3.0e38, 0.0, perspective);
    let camera = Camera(
        vec2<f32>(tiles.size), tiles.middle, tiles.focal, nearest, perspective, 0.0, layered.moment, 16u, 0u, 0.0, 0.0,
    );
    let projected = project(camera, particle);
    let splat = projected.splat;
    let is_nowhere = projected.kind == INVISIBLE || projected.kind == DROPPED;
    // Splats that are wider than the last level's are sampled as all others are; only the nearest ones may be behind the eye.
    let is_inside = splat.tail.w < 0.0;
    let tag = (spot.key << KIND_BITS) | projected.kind | select(0u, INSIDE, is_inside);
    arranged[at] = Part(splat.head, splat.tail.xyz, tag);
    let reach = select(abs(splat.tail.w), 1.0e9, projected.kind == EVERYWHERE) + 0.02;
    let between = tiles_between(tiles, splat.head.xy - reach, splat.head.xy + reach);
    reaches[at] = select(between, vec2(1u, 0u), is_nowhere);
}
