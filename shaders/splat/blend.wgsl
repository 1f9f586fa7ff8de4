// Draws every splat as one quad into its pyramid level's part of an atlas, where blending adds it: for adapters without
// compute shaders. The same projection and the same sums as by compute.
//
// One instance for each particle, BLOCK of them for each block; a quad holds the cells whose centres the splat reaches.
#import deepfield::kernel::{box_profile, evaluate, first, second, shear, bend}
#import deepfield::particle::{view, nodes, blocks, camera_axes, load_particle}
#import deepfield::projection::{camera, project}
#import deepfield::splat_view::{Splat, oblique, atlas_corner, SMALL, EVERYWHERE, INVISIBLE, DROPPED}

struct Quad {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) head: vec4<f32>,
    @location(1) @interpolate(flat) tail: vec4<f32>,
    /// From atlas to picture: pixel = position * place.z + place.xy.
    @location(2) @interpolate(flat) place: vec3<f32>,
    @location(3) @interpolate(flat) kind: u32,
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
    let reach = abs(splat.tail.w) / grid.scale;
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

/// The mean over the cell of a splat that is sampled at its centre; see `add_sampled` in accumulate.wgsl.
fn sampled(splat: Splat, pixel: vec2<f32>, kind: u32) -> f32 {
    let d = pixel - splat.head.xy;
    var square = splat.head.z * d.x * d.x + 2.0 * splat.head.w * d.x * d.y + splat.tail.x * d.y * d.y;
#ifdef OBLIQUE
    square *= oblique(view.middle, view.focal, view.perspective, pixel);
    if kind == EVERYWHERE && splat.tail.w > 0.0 {
        let along = dot(splat.head.xy - view.middle, pixel - view.middle) / (view.focal * view.focal);
        square = select(1.0, square, 1.0 + along > 0.0);
    }
#endif
    return evaluate(box_profile((splat.head.z + splat.tail.x) * (1.0 / 24.0)), vec4(square)).x;
}

/// The integral over the pixel of a small splat; see `add_small` in accumulate.wgsl.
fn integrated(splat: Splat, pixel: vec2<f32>) -> f32 {
    let low = (pixel - splat.head.xy - 0.5) * splat.head.zw;
    let edges = vec4(low.x, low.x + splat.head.z, low.y, low.y + splat.head.w);
    let u = first(edges);
    let v = second(edges);
    var value = (u.y - u.x) * (u.w - u.z) - (v.y - v.x) * (v.w - v.z);
#ifdef OBLIQUE
    let tilt = splat.tail.x;
    let s = shear(edges);
    let b = bend(edges);
    value += tilt * ((s.y - s.x) * (s.w - s.z) + 0.5 * tilt * (b.y - b.x) * (b.w - b.z));
#endif
    return value;
}

@fragment
fn fragment(quad: Quad) -> @location(0) vec2<f32> {
    let splat = Splat(quad.head, quad.tail);
    let pixel = quad.position.xy * quad.place.z + quad.place.xy;
    var value = 0.0;
    if quad.kind == SMALL {
        value = integrated(splat, pixel);
    } else {
        value = sampled(splat, pixel, quad.kind);
    }
    return value * splat.tail.yz;
}
