// The particles of a picture: nodes, blocks of particles, and how a packed or raw particle is read.
//
// Whoever imports this has bindings 0 to 5 of group 0 taken. The Rust twins are in src/gpu/splat/layout.rs.
#define_import_path deepfield::particle
#import deepfield::splat_view::SplatView
#import deepfield::sample::{GROUP, tosses, lane_of, sample_factor}

struct Node {
    /// Whole steps from the node's lowest corner to the eye. Their difference to a packed coordinate is exact, so that the
    /// rounding of what remains is small against the distance from the eye, however near that comes.
    eye_steps: vec3<i32>,
    /// World units per step of a packed coordinate.
    step: f32,
    /// The eye's place within its step, from the step's middle; of raw particles the eye's place from the node's origin, world units.
    eye_rest: vec3<f32>,
    /// Factor on smoothing lengths.
    growth: f32,
    /// Index of the first word of positions or of raw particles.
    positions: u32,
    /// Index of the first word of codes, two in a word.
    codes: u32,
    /// First entry of the node's table and number of its entries.
    table: u32,
    table_length: u32,
    /// ENCODING_*.
    encoding: u32,
    /// Factor on every weight.
    weight_scale: f32,
    /// Number of particles.
    count: u32,
    /// The sample that is drawn; see sample.wgsl. Of clusters the limit by which they are drawn.
    seed: u32,
    /// A particle of importance q is drawn with probability q scale.
    scale: f32,
    /// Particles with this rank or a higher one are not drawn; 0: all are drawn.
    ranks: u32,
    /// 1: every particle has importance 1.
    even: u32,
    /// Of moving particles: the edge of the periodic box that they are wrapped into, or 0, the corner of that box, from the node's
    /// origin, and how far they are on their way, from 0 to 1.
    edge: f32,
    corner: vec3<f32>,
    u: f32,
}

struct Block {
    node: u32,
    /// First candidate in the node.
    first: u32,
    count: u32,
    /// Where its places begin: their number, then one for each of the `count`.
    place: u32,
}

struct Particle {
    /// Camera space: right, up, depth.
    position: vec3<f32>,
    smoothing_length: f32,
    /// 0: not drawn.
    weight: f32,
    quantity: f32,
    /// Its own density, where the node's table tells densities; not that of the sums.
    density: f32,
    /// Second moments xx, yy, zz and xy, xz, yz in camera space, where it is an ellipsoid; zero else. The smoothing length is then that of a
    /// ball of equal spread.
    squares: vec3<f32>,
    products: vec3<f32>,
}

const NOTHING: Particle = Particle(vec3<f32>(0.0), 0.0, 0.0, 0.0, 0.0, vec3<f32>(0.0), vec3<f32>(0.0));

const ENCODING_GRID: u32 = 0u;
const ENCODING_LEAF: u32 = 1u;
const ENCODING_WORLD: u32 = 2u;
const ENCODING_MOVING: u32 = 4u;
const ENCODING_CLUSTERS: u32 = 5u;

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<storage, read> nodes: array<Node>;
@group(0) @binding(2) var<storage, read> blocks: array<Block>;
/// The chunk with the particles, as words and as vectors: a software driver loads each lane's value in a loop, and one
/// loop for four numbers costs little more than for one.
@group(0) @binding(3) var<storage, read> words: array<u32>;
@group(0) @binding(4) var<storage, read> vectors: array<vec4<f32>>;
/// Attribute tables: smoothing length, weight, attribute and importance of each entry; behind a table's last one the
/// densities of four entries each, where it has them.
@group(0) @binding(5) var<storage, read> entries: array<vec4<f32>>;

/// A workgroup's block; an empty one beyond the last.
fn block_of(group: vec3<u32>, groups: vec3<u32>) -> Block {
    let at = group.y * groups.x + group.x;
    var block = Block(0u, 0u, 0u, 0u);
    if at < arrayLength(&blocks) {
        block = blocks[at];
    }
    return block;
}

/// The camera's axes: rows of the rotation from world to camera. To be read once, not for each particle.
fn camera_axes() -> mat3x3<f32> {
    return transpose(mat3x3(view.right.xyz, view.up.xyz, view.forward.xyz));
}

fn load_packed(axes: mat3x3<f32>, node: Node, index: u32, leaf: bool) -> Particle {
    let word = words[node.codes + (index >> 1u)];
    let code = select(word & 0xffffu, word >> 16u, (index & 1u) == 1u);
    let at = min(code, node.table_length - 1u);
    let entry = entries[node.table + at];
    var factor = 1.0;
    if node.ranks != 0u {
        factor = sample_factor(node.seed, node.scale, index, select(entry.w, 1.0, node.even == 1u));
        if factor == 0.0 {
            return NOTHING;
        }
    }
    let stride = select(1u, 2u, leaf);
    let low = words[node.positions + index * stride];
    let high = words[node.positions + index * stride + stride - 1u];
    let grid = vec3(low & 0x3ffu, (low >> 10u) & 0x3ffu, (low >> 20u) & 0x3ffu);
    let fine = vec3(low & 0x1fffffu, (low >> 21u) | ((high & 0x3ffu) << 11u), (high >> 10u) & 0x1fffffu);
    let steps = vec3<f32>(vec3<i32>(select(grid, fine, leaf)) - node.eye_steps) - node.eye_rest;
    let densities = entries[node.table + node.table_length + (at >> 2u)];
    let place = axes * (steps * node.step);
    let round = vec3(0.0);
    return Particle(place, entry.x * node.growth, entry.y * factor, entry.z, densities[at & 3u], round, round);
}

fn load_raw(axes: mat3x3<f32>, node: Node, index: u32, world: bool) -> Particle {
    let at = (node.positions >> 2u) + 2u * index;
    let first = vectors[at];
    let second = vectors[at + 1u];
    let place = select(first.xyz, axes * (first.xyz - node.eye_rest), world);
    return Particle(place, first.w, second.x, second.y, second.z, vec3(0.0), vec3(0.0));
}

/// What lies at `u` between two values: linear in the logarithm where `is_log` and both are positive.
fn between(ends: vec2<f32>, u: f32, is_log: bool) -> f32 {
    if is_log && ends.x > 0.0 && ends.y > 0.0 {
        return ends.x * exp(u * log(ends.y / ends.x));
    }
    return mix(ends.x, ends.y, u);
}

/// A particle on its way (src/gpu/moving.rs): the cubic Hermite spline of F12, equation 6.1.
fn load_moving(axes: mat3x3<f32>, node: Node, index: u32) -> Particle {
    var factor = 1.0;
    if node.ranks != 0u {
        factor = sample_factor(node.seed, node.scale, index, 1.0);
        if factor == 0.0 {
            return NOTHING;
        }
    }
    let at = (node.positions >> 2u) + 6u * index;
    let begin = vectors[at];
    let end = vectors[at + 1u];
    let leaves = vectors[at + 2u];
    let comes = vectors[at + 3u];
    let values = vectors[at + 4u];
    let densities = vectors[at + 5u];
    let u = node.u;
    let rest = 1.0 - u;
    var place = (1.0 + 2.0 * u) * rest * rest * begin.xyz + u * u * (3.0 - 2.0 * u) * end.xyz;
    place += u * rest * (rest * leaves.xyz - u * comes.xyz);
    if node.edge > 0.0 {
        place -= node.edge * floor((place - node.corner) / node.edge);
    }
    let weight = mix(leaves.w, comes.w, u) * between(values.xy, u, true);
    return Particle(
        axes * (place - node.eye_rest),
        between(vec2(begin.w, end.w), u, true) * node.growth,
        weight * factor,
        between(values.zw, u, densities.z > 0.5),
        between(densities.xy, u, true),
        vec3(0.0),
        vec3(0.0),
    );
}

/// A cluster (src/gpu/clusters.rs), if it is drawn with the node's limit.
fn load_cluster(axes: mat3x3<f32>, node: Node, index: u32) -> Particle {
    let at = (node.positions >> 2u) + 4u * index;
    let about = vectors[at + 3u];
    if about.y < f32(node.seed) {
        return NOTHING;
    }
    let first = vectors[at];
    let second = vectors[at + 1u];
    let third = vectors[at + 2u];
    let moments = mat3x3(
        second.x, second.w, third.x,
        second.w, second.y, third.y,
        third.x, third.y, second.z,
    );
    let turned = axes * moments * transpose(axes);
    return Particle(
        axes * (first.xyz - node.eye_rest),
        first.w,
        third.z,
        third.w,
        about.x,
        vec3(turned[0].x, turned[1].y, turned[2].z),
        vec3(turned[0].y, turned[0].z, turned[1].z),
    );
}

/// What the view leaves of the weight of a particle at a place in camera space (crates/draw/src/view/cut.rs).
fn cut_factor(axes: mat3x3<f32>, position: vec3<f32>) -> f32 {
    // The rows of the rotation back are the columns of `axes`.
    let world = position * axes;
    let inside = all(world >= view.clip_min.xyz) && all(world <= view.clip_max.xyz);
    return select(0.0, exp(-view.fade_rate * max(dot(view.fade_along.xyz, position) - view.fade_start, 0.0)), inside);
}

/// Candidate `number` of a node, whatever its encoding: its particles in order, or where ranks are left out, those of the
/// other ranks, group by group.
fn load_particle(axes: mat3x3<f32>, node: Node, number: u32) -> Particle {
    var index = number;
    if node.ranks != 0u && node.ranks < GROUP {
        let group = number / node.ranks;
        index = group * GROUP + lane_of(tosses(node.seed + group), number % node.ranks);
    }
    var particle = NOTHING;
    if index >= node.count {
        return particle;
    }
    if node.encoding <= ENCODING_LEAF {
        particle = load_packed(axes, node, index, node.encoding == ENCODING_LEAF);
    } else if node.encoding == ENCODING_MOVING {
        particle = load_moving(axes, node, index);
    } else if node.encoding == ENCODING_CLUSTERS {
        particle = load_cluster(axes, node, index);
    } else {
        particle = load_raw(axes, node, index, node.encoding == ENCODING_WORLD);
    }
    particle.weight *= node.weight_scale;
    if view.cut != 0u {
        particle.weight *= cut_factor(axes, particle.position);
    }
    return particle;
}
