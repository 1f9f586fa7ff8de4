// Projects particles, drops those that no pixel sees, and counts the others into bins.
//
// One workgroup for each block of up to BLOCK particles of one node. Out: one Splat for each particle, its bin and its
// place in the bin; the number of splats in each bin.
#import deepfield::splat_view::{SplatView, Splat}

struct Node {
    /// Camera-space position of the node's lowest corner, relative to the eye; computed in double precision.
    origin: vec3<f32>,
    /// World units per step of a packed coordinate.
    step: f32,
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
    unused_a: u32,
    unused_b: u32,
}

struct Block {
    node: u32,
    /// First particle in the node.
    first: u32,
    count: u32,
    /// Where the first one's splat goes.
    splat: u32,
}

struct Entry {
    smoothing_length: f32,
    weight: f32,
    quantity: f32,
}

struct Place {
    bin: u32,
    rank: u32,
}

const ENCODING_GRID: u32 = 0u;
const ENCODING_LEAF: u32 = 1u;
const ENCODING_WORLD: u32 = 2u;
const NOWHERE: u32 = 0xffffffffu;

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<storage, read> nodes: array<Node>;
@group(0) @binding(2) var<storage, read> blocks: array<Block>;
@group(0) @binding(3) var<storage, read> words: array<u32>;
@group(0) @binding(4) var<storage, read> entries: array<Entry>;
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(6) var<storage, read_write> places: array<Place>;
@group(0) @binding(7) var<storage, read_write> counts: array<atomic<u32>>;

struct Particle {
    /// Camera space: right, up, depth.
    position: vec3<f32>,
    smoothing_length: f32,
    weight: f32,
    quantity: f32,
}

fn to_camera(local: vec3<f32>) -> vec3<f32> {
    return vec3(dot(view.right.xyz, local), dot(view.up.xyz, local), dot(view.forward.xyz, local));
}

fn load_packed(node: Node, index: u32, leaf: bool) -> Particle {
    // A packed coordinate stands for its step's centre.
    let stride = select(1u, 2u, leaf);
    let low = words[node.positions + index * stride];
    let high = words[node.positions + index * stride + stride - 1u];
    let grid = vec3(low & 0x3ffu, (low >> 10u) & 0x3ffu, (low >> 20u) & 0x3ffu);
    let fine = vec3(low & 0x1fffffu, (low >> 21u) | ((high & 0x3ffu) << 11u), (high >> 10u) & 0x1fffffu);
    let steps = vec3<f32>(select(grid, fine, leaf)) + 0.5;
    let word = words[node.codes + (index >> 1u)];
    let code = select(word & 0xffffu, word >> 16u, (index & 1u) == 1u);
    let entry = entries[node.table + min(code, node.table_length - 1u)];
    return Particle(node.origin + to_camera(steps * node.step), entry.smoothing_length, entry.weight, entry.quantity);
}

fn load_raw(node: Node, index: u32, world: bool) -> Particle {
    let at = node.positions + 6u * index;
    let position = vec3(bitcast<f32>(words[at]), bitcast<f32>(words[at + 1u]), bitcast<f32>(words[at + 2u]));
    return Particle(
        select(position, node.origin + to_camera(position), world),
        bitcast<f32>(words[at + 3u]),
        bitcast<f32>(words[at + 4u]),
        bitcast<f32>(words[at + 5u]),
    );
}

/// The bin of a splat centre in a level's grid (or the small splats', which is like level 0); NOWHERE if it cannot
/// reach the grid.
fn grid_bin(level: u32, first_bin: u32, center: vec2<f32>) -> u32 {
    let grid = view.levels[level];
    let cell = center / grid.scale + f32(grid.pad);
    let bin = floor(cell / 8.0) + f32(grid.margin);
    let inside = all(bin >= vec2(0.0)) && all(bin < vec2(f32(grid.bins_x), f32(grid.bins_y)));
    let at = vec2<u32>(clamp(bin, vec2(0.0), vec2(f32(grid.bins_x - 1u), f32(grid.bins_y - 1u))));
    return select(NOWHERE, first_bin + at.y * grid.bins_x + at.x, inside);
}

struct Projected {
    splat: Splat,
    bin: u32,
}

fn project(particle: Particle) -> Projected {
    let p = particle.position;
    let perspective = view.perspective != 0u;
    let half_size = 0.5 * vec2<f32>(view.size);
    let in_front = p.z > view.near;
    let depth = select(1.0, max(p.z, view.near), perspective);
    let magnification = view.focal / depth;
    let center = half_size + vec2(p.x, -p.y) * magnification;

    // The smoothing length, or the length that has the wanted radius in pixels on the axis.
    let h = select(particle.smoothing_length, view.fixed_radius / magnification, view.fixed_radius > 0.0);
    let minor = h * magnification;

    // The cone of rays that touch the particle: theta off the axis, alpha its half opening (F12 figure 4.7).
    let distance_squared = dot(p, p);
    let distance = sqrt(distance_squared);
    let sin_alpha = min(h / distance, 1.0);
    let cos_alpha = sqrt(max(1.0 - sin_alpha * sin_alpha, 0.0));
    let cos_theta = p.z / distance;
    let sin_theta = sqrt(max(1.0 - cos_theta * cos_theta, 0.0));
    let cos_edge = cos_theta * cos_alpha - sin_theta * sin_alpha;
    // The far side of the cone meets the picture at tan(theta + alpha), or never.
    let far_side = view.focal * sin_alpha / (cos_theta * max(cos_edge, 1.0e-3));
    let is_point = view.fixed_radius > 0.0;
    let reach = select(minor, far_side, perspective && !is_point);

    // Outside one of the four sides of the frustum by more than h?
    let slope = half_size / view.focal;
    let side = (abs(p.xy) - slope * p.z) * inverseSqrt(1.0 + slope * slope);
    let outside_cone = any(side > vec2(h));
    let outside_box = any(abs(center - half_size) > half_size + minor);
    let visible = in_front && h > 0.0 && minor > 0.0 && !select(outside_box, outside_cone, perspective && !is_point);

    // F = w / h^2 Phi(q^2); for discs of fixed size w per pixel.
    let inverse = 1.0 / h;
    let amplitude = particle.weight * select(inverse * inverse, 1.0 / (minor * minor), is_point);
    let weight = vec2(amplitude, amplitude * particle.quantity);
    // q^2 = |p x d|^2 / (h^2 |ray|^2) for the step d from the centre's ray to the pixel's.
    let e = inverse * inverse / (view.focal * view.focal);
    let tilted = e * vec3(p.z * p.z + p.y * p.y, p.x * p.y, p.z * p.z + p.x * p.x);
    let straight = vec3(1.0 / (minor * minor), 0.0, 1.0 / (minor * minor));
    let form = select(straight, tilted, perspective && !is_point);

    let ratio = minor / view.sampled_radius;
    var result: Projected;
    let signed_reach = select(reach, -reach, perspective && distance <= h);
    result.splat = Splat(vec4(center, form.xy), vec4(form.z, weight, signed_reach));
    // Small splats: integrals over pixels need the ellipse at the centre itself.
    if ratio < 1.0 || is_point {
        let local = form * select(1.0, p.z * p.z / distance_squared, perspective && !is_point);
        let determinant = local.x * local.z - local.y * local.y;
        let spread = vec3(local.z, -local.y, local.x) / determinant;
        let radius = sqrt(spread.xz);
        let whole = weight * inverseSqrt(determinant);
        result.splat.head = vec4(center, 1.0 / radius);
        result.splat.tail = vec4(spread.y * view.moment, whole, max(radius.x, radius.y) + 0.5);
        result.bin = grid_bin(0u, view.small_bin, center);
    } else {
        let level = min(u32(log2(ratio)), view.level_count);
        // A splat that reaches further than its level's margin of bins, or belongs to a level above the last, is
        // evaluated in the last level, by every tile of it.
        let grid = view.levels[min(level, view.level_count - 1u)];
        let everywhere = level >= view.level_count || cos_edge < 0.02 && perspective
            || reach > f32(8u * grid.margin) * grid.scale;
        result.bin = select(grid_bin(level, grid.first_bin, center), view.everywhere_bin, everywhere);
    }
    if !visible {
        result.bin = NOWHERE;
    }
    return result;
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = group.y * groups.x + group.x;
    if at >= arrayLength(&blocks) {
        return;
    }
    let block = blocks[at];
    let node = nodes[block.node];
    for (var i = lane; i < block.count; i += 64u) {
        var particle: Particle;
        if node.encoding <= ENCODING_LEAF {
            particle = load_packed(node, block.first + i, node.encoding == ENCODING_LEAF);
        } else {
            particle = load_raw(node, block.first + i, node.encoding == ENCODING_WORLD);
        }
        particle.weight *= node.weight_scale;
        let projected = project(particle);
        var rank = 0u;
        if projected.bin != NOWHERE {
            rank = atomicAdd(&counts[projected.bin], 1u);
            splats[block.splat + i] = projected.splat;
        }
        places[block.splat + i] = Place(projected.bin, rank);
    }
}
