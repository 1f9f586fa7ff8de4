// Splats of the particles of a slab of layers (F12 5.10), in the order of their layers and bins: whole, or what of each lies in the
// layer, as crates/draw/src/cpu/layered/caps.rs cuts it.
//
// `count` gives each particle its bin and its place there; `place` projects again, which moves less than splats in between would,
// once the bins' sizes have become their first places. One invocation for each particle of each layer.
#import deepfield::layer_group::first_of_slab
#import deepfield::particle::{view, Particle}
#import deepfield::projection::{camera, project, Projected}
#import deepfield::splat_bins::{bin_of, NOWHERE}
#import deepfield::splat_view::Splat
#import deepfield::tile_view::{TileView, Spot, front_of}

@group(0) @binding(1) var<uniform> tiles: TileView;
/// Number of particles.
@group(0) @binding(2) var<storage, read> work: array<u32>;
@group(0) @binding(3) var<storage, read> spots: array<Spot>;
/// The bin of each, and its place there.
@group(0) @binding(4) var<storage, read_write> places: array<vec2<u32>>;
/// Number of splats in each bin of each layer; then, for `place`, in the bins before it.
@group(0) @binding(5) var<storage, read_write> starts: array<atomic<u32>>;
@group(0) @binding(6) var<storage, read_write> splats: array<Splat>;
/// At equal steps of depth from a kernel's centre: mass and second moment up to there, and the moment of depth from there on.
@group(0) @binding(7) var<storage, read> caps: array<vec4<f32>>;

/// Mass, second moment and moment of depth of a kernel in front of a plane.
fn below(zeta: f32) -> vec3<f32> {
    let last = arrayLength(&caps) - 1u;
    let position = min(abs(zeta), 1.0) * f32(last);
    let index = min(u32(position), last - 1u);
    let sums = mix(caps[index].xyz, caps[index + 1u].xyz, position - f32(index));
    let half = vec2(0.5, caps[last].y);
    return vec3(half + select(1.0, -1.0, zeta < 0.0) * sums.xy, -sums.z);
}

/// What of a particle lies in its layer, as a splat.
fn splat_of(spot: Spot) -> Projected {
    var particle = Particle(spot.place.xyz, spot.place.w, spot.mass, spot.quantity, 0.0, vec3(0.0), vec3(0.0));
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
    var camera = camera();
    // A parallel projection has layers behind its eye plane too.
    camera.near = select(-3.0e38, 0.0, camera.perspective);
    camera.faintest = 0.0;
    return project(camera, particle);
}

@compute @workgroup_size(256)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if at >= work[0] {
        return;
    }
    let spot = spots[at];
    let own = bin_of(splat_of(spot));
    var place = vec2(NOWHERE, 0u);
    if own != NOWHERE {
        let bin = (spot.key - first_of_slab()) * view.bin_count + own;
        place = vec2(bin, atomicAdd(&starts[bin], 1u));
    }
    places[at] = place;
}

@compute @workgroup_size(256)
fn place(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if at >= work[0] {
        return;
    }
    let place = places[at];
    if place.x != NOWHERE {
        splats[atomicLoad(&starts[place.x]) + place.y] = splat_of(spots[at]).splat;
    }
}
