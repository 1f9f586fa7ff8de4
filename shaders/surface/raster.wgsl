// Which triangle or point of a surface is seen at each sample of the picture, by the adapter's rasteriser: what visible.wgsl finds but for
// how finely corners are rounded. Their places come from the same operations whatever they belong to.
#import deepfield::surface_constants::{FAN, POINTS, LAID, FANNED, MARGIN}
#import deepfield::surface_margin::{margin_at, margin_depth}
#import deepfield::surface_view::{surface, draws, lists, Draw, corner_of, has_margin, height_of, is_lone, is_measured, camera_of, is_kept, quad_of, half_of}

/// What is drawn at a time.
struct SurfaceStep {
    is_second: u32,
    /// Where `lists` has the chunks' numbers, or the triangles.
    first: u32,
    count: u32,
    counter: u32,
    most: u32,
    unused: u32,
    unused_end: vec2<u32>,
}

@group(1) @binding(0) var<uniform> surface_step: SurfaceStep;

struct Vertex {
    @invariant @builtin(position) place: vec4<f32>,
    /// From the eye.
    @location(0) away: vec3<f32>,
    @location(1) @interpolate(flat) number: u32,
}

/// What is not drawn.
fn nowhere() -> Vertex {
    return Vertex(vec4(0.0, 0.0, -1.0, 1.0), vec3(0.0), 0u);
}

fn corner_at(camera: vec3<f32>, number: u32) -> Vertex {
    let size = vec2<f32>(surface.size);
    let middle = vec2(2.0, -2.0) * surface.middle / size + vec2(-1.0, 1.0);
    let scale = 2.0 * surface.focal / size;
    var place: vec4<f32>;
    if surface.perspective != 0u {
        place = vec4(fma(camera.xy, scale, middle * camera.z), surface.near, camera.z);
    } else {
        // Near is 1, and what is behind the eye above that.
        place = vec4(fma(camera.xy, scale, middle), 1.0 - camera.z / surface.far, 1.0);
    }
    let away = camera.x * surface.world_right + camera.y * surface.world_up + camera.z * surface.world_forward;
    return Vertex(place, away, number);
}

@vertex
fn cell(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Vertex {
    let node = lists[surface_step.first + instance];
    let draw = draws[node];
    let slot = index / 3u % 2u;
    let at = vec2(index / 6u / 256u, index / 6u % 256u);
    if any(at + 1u >= vec2(draw.rows, draw.columns)) {
        return nowhere();
    }
    let sides = u32(at.x == 0u) | u32(at.x + 2u == draw.rows) << 1u | u32(at.y == 0u) << 2u | u32(at.y + 2u == draw.columns) << 3u;
    let is_dotted = (draw.flags & POINTS) != 0u && (sides & (draw.flags >> LAID & 15u)) == 0u;
    let quad = quad_of(draw, at);
    let half = half_of(quad, slot);
    // Points and listed triangles stand for what was measured.
    if !half.exists || !half.is_membrane && (is_dotted || (sides & (draw.flags >> FANNED)) != 0u) {
        return nowhere();
    }
    let corner = half.corners[index % 3u];
    let camera = camera_of(corner_of(draw, at + vec2(corner >> 1u, corner & 1u)), quad.heights[corner]);
    return corner_at(camera, node << 18u | 2u * (at.x * 256u + at.y) + slot);
}

@vertex
fn fan(@builtin(vertex_index) index: u32) -> Vertex {
    let source = surface_step.first + FAN * (index / 3u);
    let at = source + 1u + 3u * (index % 3u);
    return corner_at(camera_of(vec2(lists[at], lists[at + 1u]), bitcast<f32>(lists[at + 2u])), lists[source]);
}

@vertex
fn point(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Vertex {
    let node = lists[surface_step.first + instance];
    let draw = draws[node];
    let margin = draw.flags >> MARGIN & 63u;
    // Those of a larger square come one after the other; no chunk has more than its own margins need.
    let has_points = (draw.flags & POINTS) != 0u;
    let largest = max(max(surface.lone_side, margin), select(0u, surface.point_side, has_points));
    let square = index % (largest * largest);
    let sample = index / (largest * largest);
    let at = vec2(sample / 257u, sample % 257u);
    let size = vec2(draw.rows, draw.columns);
    if any(at >= size) {
        return nowhere();
    }
    let height = height_of(draw, at);
    if !is_measured(height) {
        return nowhere();
    }
    let on = u32(at.x == 0u) | u32(at.x + 1u == size.x) << 1u | u32(at.y == 0u) << 2u | u32(at.y + 1u == size.y) << 3u;
    let is_alone = is_lone(draw, at);
    let is_point = has_points && (on & (draw.flags >> LAID)) == 0u;
    var side = select(surface.point_side, surface.lone_side, is_alone);
    var is_margin = false;
    if !is_alone && !is_point {
        if margin == 0u {
            return nowhere();
        }
        is_margin = has_margin(draw, at);
        side = select(0u, margin, is_margin);
    }
    if square >= side * side {
        return nowhere();
    }
    let camera = camera_of(corner_of(draw, at), height);
    var corner = corner_at(camera, node << 18u | (1u << 17u) + at.x * 257u + at.y);
    // To the middle of the sample of the picture that it is in.
    let pixels = vec2<f32>(surface.size);
    let place = (corner.place.xy / corner.place.w * vec2(0.5, -0.5) + 0.5) * pixels;
    let shift = vec2(f32(square % side), f32(square / side)) - 0.5 * f32(side - 1u);
    let middle = floor(place + shift) + 0.5;
    corner.place = vec4((middle / pixels * vec2(2.0, -2.0) + vec2(-1.0, 1.0)) * corner.place.w, corner.place.zw);
    if is_margin {
#ifdef GLOBE
        if any(middle < vec2(0.0)) || any(middle > pixels) || !margin_at(node, at, middle).exists {
            return nowhere();
        }
#endif
        // Near is 1, and behind all else next to 0.
        let depth = margin_depth(camera, middle);
        let nearness = select(1.0 - depth / surface.far, surface.near * (camera.z / depth), surface.perspective != 0u);
        corner.place.z = max(nearness, 1e-20 * corner.place.z);
    }
    return corner;
}

@fragment
fn number(corner: Vertex) -> @location(0) u32 {
    if surface.clips != 0u && !is_kept(corner.away) {
        discard;
    }
    return ~corner.number;
}
