// Draws every splat as one quad into its pyramid level's part of an atlas, where blending adds it: for adapters without
// compute shaders. The same projection and the same sums as by compute.
//
// One instance for each particle, BLOCK of them for each block; a quad holds the cells whose centres the splat reaches.
#import deepfield::particle::{view, nodes, blocks, camera_axes, load_particle}
#import deepfield::projection::{camera, project}
#import deepfield::splat_pixel::{Lens, integrated, sampled}
#import deepfield::splat_view::{Splat, atlas_corner, SMALL, EVERYWHERE, INVISIBLE, DROPPED, ELLIPSE, SMALL_ELLIPSE}
#ifdef ELLIPSOIDS
#import deepfield::small_ellipse::integrated_ellipse
#endif

struct Quad {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) head: vec4<f32>,
    @location(1) @interpolate(flat) tail: vec4<f32>,
    /// From atlas to picture: pixel = position * place.z + place.xy.
    @location(2) @interpolate(flat) place: vec3<f32>,
    @location(3) @interpolate(flat) kind: u32,
}

/// How far a splat reaches along x and y, pixels.
fn extent(splat: Splat, kind: u32) -> vec2<f32> {
#ifdef ELLIPSOIDS
    if kind == ELLIPSE {
        let determinant = splat.head.z * splat.tail.x - splat.head.w * splat.head.w;
        return sqrt(vec2(splat.tail.x, splat.head.z) / determinant);
    }
    if kind == SMALL_ELLIPSE {
        let half = 1.0 / splat.head.zw;
        let lean = splat.tail.x * half.y;
        let reach = vec2(sqrt(half.x * half.x + lean * lean), half.y) + 0.5;
        return select(reach.yx, reach, splat.tail.w > 0.0);
    }
#endif
    return vec2(abs(splat.tail.w));
}

@vertex
fn vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) instance: u32) -> Quad {
    let block = blocks[instance / #{BLOCK}u];
    let number = instance % #{BLOCK}u;
    // A block may have fewer than there are instances for.
    var particle = load_particle(camera_axes(), nodes[block.node], block.first + number);
    particle.weight = select(0.0, particle.weight, number < block.count);
    let projected = project(camera(), particle);
    let splat = projected.splat;
    let grid = view.levels[projected.level];

    // The cells that it reaches, of those that there are.
    let size = vec2(f32(grid.width), f32(grid.height));
    let center = splat.head.xy / grid.scale + f32(grid.pad);
    let reach = extent(splat, projected.kind) / grid.scale;
    let everywhere = projected.kind == EVERYWHERE;
    let low = select(clamp(ceil(center - reach - 0.5), vec2(0.0), size), vec2(0.0), everywhere);
    let high = select(clamp(floor(center + reach - 0.5) + 1.0, vec2(0.0), size), size, everywhere);

    let at = select(low, max(low, high), vec2((corner & 1u) == 1u, corner >= 2u));
    let atlas_size = vec2<f32>(view.atlas);
    let begin = vec2<f32>(atlas_corner(view.levels[0], projected.level, grid));
    let clip = (begin + at) / atlas_size * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    var quad: Quad;
    // All four corners in one place draw nothing. What is not culled is left to the clipper.
    let is_culled = projected.kind == INVISIBLE && view.culling != 0u;
    let shift = select(0.0, 4.0, projected.kind == INVISIBLE);
    let is_dropped = is_culled || projected.kind == DROPPED;
    quad.position = select(vec4(clip.x + shift, clip.y, 0.0, 1.0), vec4(0.0, 0.0, 0.0, 1.0), is_dropped);
    quad.head = splat.head;
    quad.tail = splat.tail;
    quad.place = vec3(-(begin + f32(grid.pad)) * grid.scale, grid.scale);
    quad.kind = projected.kind;
    return quad;
}

@fragment
fn fragment(quad: Quad) -> @location(0) vec2<f32> {
    let splat = Splat(quad.head, quad.tail);
    let pixel = quad.position.xy * quad.place.z + quad.place.xy;
    var value = 0.0;
#ifdef ELLIPSOIDS
    if quad.kind == SMALL_ELLIPSE {
        let at = select(pixel, pixel.yx, splat.tail.w > 0.0);
        return integrated_ellipse(splat, vec4(at.x), vec4(at.y)).x * splat.tail.yz;
    }
#endif
    if quad.kind == SMALL {
        value = integrated(splat, pixel);
    } else {
        value = sampled(splat, Lens(view.middle, view.focal, view.perspective), pixel, quad.kind);
    }
    return value * splat.tail.yz;
}
