// Ray casting through a Cartesian grid all of which is held: emission and absorption with post-classification, isosurfaces, or both;
// step for step what crates/draw/src/cpu/cartesian/march.rs does, whose comments say why.
//
// `find_rooms` finds how dense the field is at most in each room and those around it; then `march`, one invocation for each pixel.
//
// What rays do rarely stands behind the loops over what they do often, as in raycast.wgsl: they go past what does not show, through
// what does, to surfaces, and to the next room in four loops, each within the one that follows.
#import deepfield::isosurface::{
    volume, Crossings, NO_CROSSING, crossings_of, is_crossed, shaded, surface_levels, take_nearest,
}
#import deepfield::matter::{entry_of, lookup, matter_of}
#import deepfield::volume_constants::{BRICK, BRICK_SHIFT, CELLS, ROOM, STEP, SURFACE_BRIGHTNESS}
#import deepfield::volume_view::number_of

/// The rays of a picture, in stored coordinates of the grid, and the grid's rooms. The Rust twin is `MarchUniform` in
/// src/gpu/volume/march.rs.
// What stays while the camera moves comes first: an adapter in software has the first word as a constant, and compiles anew where it changes.
struct MarchView {
    /// Rooms along x, y and z.
    rooms: vec3<u32>,
    /// Densities up to this show nothing.
    least: f32,
    /// Where the middle line of sight passes a certain depth.
    middle_place: vec4<f32>,
    /// How much further a ray passes that depth that is one pixel to the right, or below.
    right: vec4<f32>,
    down: vec4<f32>,
    /// The way along the middle line of sight for a unit of depth; how it changes for a pixel to the right, or down.
    along: vec4<f32>,
    along_right: vec4<f32>,
    along_down: vec4<f32>,
    /// The box outside which nothing is sampled.
    low: vec4<f32>,
    high: vec4<f32>,
    /// Where the middle line of sight meets the picture, pixels.
    middle: vec2<f32>,
    /// Depths of the planes, from that certain depth.
    planes: vec2<f32>,
    /// Pixels.
    size: vec2<u32>,
    /// World units to the width of a cell.
    cell: f32,
    unused: u32,
}

@group(0) @binding(1) var<uniform> rays_view: MarchView;
/// The cells of all bricks, layer by layer; zero where nothing is.
@group(0) @binding(2) var<storage, read> field: array<f32>;
/// The largest density of each part of each brick.
@group(0) @binding(3) var<storage, read> densest: array<f32>;
/// The largest density in each room and those around it.
@group(0) @binding(4) var<storage, read_write> rooms: array<f32>;
/// Light, linear, premultiplied, and opacity of each pixel.
@group(0) @binding(5) var<storage, read_write> light: array<vec4<f32>>;

#ifdef ATTRIBUTE
const VALUES: u32 = 2u;
#else
const VALUES: u32 = 1u;
#endif
/// Bricks along a room's side.
const ROOM_BRICKS: u32 = ROOM / BRICK;

// One invocation for each room.
@compute @workgroup_size(64)
fn find_rooms(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let room = number_of(group, groups) * 64u + lane;
    let count = rays_view.rooms;
    if room >= count.x * count.y * count.z {
        return;
    }
    let at = vec3(room % count.x, room / count.x % count.y, room / (count.x * count.y));
    let bricks = vec3(volume.window, volume.last_layer + 1u);
    let first = (max(at, vec3(1u)) - 1u) * ROOM_BRICKS;
    let behind = min((at + 2u) * ROOM_BRICKS, bricks);
    var found = 0.0;
    for (var z = first.z; z < behind.z; z++) {
        for (var y = first.y; y < behind.y; y++) {
            for (var x = first.x; x < behind.x; x++) {
                let brick = (z * bricks.y + y) * bricks.x + x;
                for (var part = 0u; part < #{PARTS}u; part++) {
                    found = max(found, densest[brick * #{PARTS}u + part]);
                }
            }
        }
    }
    rooms[room] = found;
}

/// What every sample asks for: a software driver fetches uniforms for each lane, every time.
struct Strides {
    /// Places in the field from a brick to the next along y and z.
    row: u32,
    layer: u32,
    /// The last cell that has a next one.
    last: vec3<f32>,
}

/// Density and `sum m A W` at a place: trilinear between the cells around it.
fn sample(strides: Strides, place: vec3<f32>) -> vec2<f32> {
    let low = clamp(floor(place - 0.5), vec3(0.0), strides.last);
    let share = place - 0.5 - low;
    let here = vec3<u32>(low);
    let beyond = here + 1u;
    let x = (vec2(here.x, beyond.x) >> vec2(BRICK_SHIFT)) * (VALUES * CELLS) + (vec2(here.x, beyond.x) & vec2(BRICK - 1u));
    let y = (vec2(here.y, beyond.y) >> vec2(BRICK_SHIFT)) * strides.row + (vec2(here.y, beyond.y) & vec2(BRICK - 1u)) * BRICK;
    let z = (vec2(here.z, beyond.z) >> vec2(BRICK_SHIFT)) * strides.layer
        + (vec2(here.z, beyond.z) & vec2(BRICK - 1u)) * (BRICK * BRICK);
    let corners = vec4(z.x + y.x, z.x + y.y, z.y + y.x, z.y + y.y);
    var value = vec2(mixed(corners, x, share), 0.0);
#ifdef ATTRIBUTE
    value.y = mixed(corners + CELLS, x, share);
#endif
    return value;
}

/// What eight cells come to: in four rows, each with two of its cells.
fn mixed(rows: vec4<u32>, cells: vec2<u32>, share: vec3<f32>) -> f32 {
    let low = vec4(field[rows.x + cells.x], field[rows.y + cells.x], field[rows.z + cells.x], field[rows.w + cells.x]);
    let high = vec4(field[rows.x + cells.y], field[rows.y + cells.y], field[rows.z + cells.y], field[rows.w + cells.y]);
    let of_rows = low + share.x * (high - low);
    let of_layers = of_rows.xz + share.y * (of_rows.yw - of_rows.xz);
    return of_layers.x + share.z * (of_layers.y - of_layers.x);
}

/// What is behind, seen through what is here.
fn under(ray: ptr<function, vec4<f32>>, color: vec3<f32>, alpha: f32) {
    *ray += (1.0 - (*ray).a) * alpha * vec4(color, 1.0);
}

/// The mean of an attribute.
fn quantity_of(value: vec2<f32>) -> f32 {
#ifdef ATTRIBUTE
    return value.y / value.x;
#else
    return 0.0;
#endif
}

/// Passes a share of a step that has one matter.
fn through(ray: ptr<function, vec4<f32>>, value: vec2<f32>, length: f32, faintest: f32) {
    if value.x > faintest && length > 0.0 {
        let matter = matter_of(value.x, quantity_of(value));
        under(ray, matter.rgb, 1.0 - exp(-matter.a * length));
    }
}

/// Passes a step, or what is left of it behind a share: its first half has the matter of its beginning, the other that of its end.
fn pass_by(
    ray: ptr<function, vec4<f32>>,
    before: vec2<f32>,
    now: vec2<f32>,
    start: f32,
    stop: f32,
    length: f32,
    faintest: f32,
) {
    through(ray, before, length * (min(stop, 0.5) - start), faintest);
    through(ray, now, length * (stop - max(start, 0.5)), faintest);
}

/// Where a ray leaves a room.
fn exit_of(low: vec3<f32>, origin: vec3<f32>, direction: vec3<f32>) -> f32 {
    let high = low + f32(ROOM);
    let ends = (select(low, high, direction > vec3(0.0)) - origin) / select(direction, vec3(1.0), direction == vec3(0.0));
    let exits = select(ends, vec3(3.0e38), direction == vec3(0.0));
    return min(exits.x, min(exits.y, exits.z));
}

@compute @workgroup_size(8, 8)
fn march(@builtin(global_invocation_id) pixel: vec3<u32>) {
    let size = rays_view.size;
    if any(pixel.xy >= size) {
        return;
    }
    let away = vec2<f32>(pixel.xy) + 0.5 - rays_view.middle;
    let middle_place = rays_view.middle_place.xyz + away.x * rays_view.right.xyz + away.y * rays_view.down.xyz;
    let along = rays_view.along.xyz + away.x * rays_view.along_right.xyz + away.y * rays_view.along_down.xyz;
    let scale = length(along);
    let direction = along / scale;
    let slopes = select(direction, vec3(1.0), direction == vec3(0.0));
    let at_low = (rays_view.low.xyz - middle_place) / slopes;
    let at_high = (rays_view.high.xyz - middle_place) / slopes;
    let is_beside = (middle_place < rays_view.low.xyz) | (middle_place > rays_view.high.xyz);
    var span = rays_view.planes * scale;
    for (var k = 0u; k < 3u; k++) {
        if direction[k] != 0.0 {
            span = vec2(max(span.x, min(at_low[k], at_high[k])), min(span.y, max(at_low[k], at_high[k])));
        } else if is_beside[k] {
            span = vec2(0.0);
        }
    }
    let origin = middle_place + span.x * direction;
    let end = span.y - span.x;
    let counts = rays_view.rooms;
    let least = rays_view.least;
    let cell = rays_view.cell;
    let faintest = volume.faintest;
    let termination = volume.termination;
    let row = volume.window.x * VALUES * CELLS;
    let stored = vec3<f32>(vec3(volume.window, volume.last_layer + 1u) * BRICK);
    let strides = Strides(row, row * volume.window.y, stored - 2.0);
#ifdef SURFACES
    let levels = surface_levels();
#endif
    var ray = vec4(0.0);
    var t = 0.0;
    // The last sample, where the next step begins with it.
    var last = vec2(0.0);
    var has_last = false;
    while t < end && ray.a < termination {
        let room = min(vec3<u32>(max(origin + t * direction, vec3(0.0))) / ROOM, counts - 1u);
        let exit = min(exit_of(vec3<f32>(room * ROOM), origin, direction), end);
        let began = t;
        if rooms[(room.z * counts.y + room.y) * counts.x + room.x] <= least {
            t = max(t, exit);
        }
        while t < exit && ray.a < termination {
            var before = last;
            if !has_last {
                before = sample(strides, origin + t * direction);
            }
            has_last = true;
            var now = before;
            var next = t;
            var crossed = false;
            while t < exit && ray.a < termination {
                while t < exit {
                    next = min(t + STEP, end);
                    now = sample(strides, origin + next * direction);
#ifdef SURFACES
                    crossed = is_crossed(levels, before.x, now.x);
#endif
                    // A surface shows, however faint the volume is.
                    if before.x > least || now.x > least {
                        break;
                    }
                    t = next;
                    before = now;
                }
                if t >= exit || crossed {
                    break;
                }
                pass_by(&ray, before, now, 0.0, 1.0, (next - t) * cell, faintest);
                t = next;
                before = now;
            }
#ifdef SURFACES
            if t < exit && crossed && ray.a < termination {
                let way = next - t;
                let earlier = sample(strides, origin + (t - way) * direction).x;
                let later = sample(strides, origin + (next + way) * direction).x;
                var left = crossings_of(vec4(earlier, before.x, now.x, later), levels);
                var done = 0.0;
                for (var n = 0u; n < 8u; n++) {
                    let nearest = take_nearest(&left);
                    if nearest.at == NO_CROSSING {
                        break;
                    }
                    pass_by(&ray, before, now, done, nearest.at, way * cell, faintest);
                    done = nearest.at;
                    meet(&ray, strides, origin + (t + done * way) * direction, direction, nearest.surface, mix(before, now, done));
                }
                pass_by(&ray, before, now, done, 1.0, way * cell, faintest);
                t = next;
                before = now;
            }
#endif
            last = before;
        }
        if t <= exit || t == began {
            // Beyond the face, by more than single precision rounds.
            t = max(t, exit);
            t += max(1.0e-3, 2.0e-6 * t);
            has_last = false;
        }
    }
    light[pixel.y * size.x + pixel.x] = ray;
}

#ifdef SURFACES
/// Meets a surface.
fn meet(
    ray: ptr<function, vec4<f32>>,
    strides: Strides,
    place: vec3<f32>,
    direction: vec3<f32>,
    index: u32,
    value: vec2<f32>,
) {
    let surface = volume.surfaces[index];
    var color = volume.colors[index].rgb;
    if surface.z == 0.0 {
        color = vec3(1.0);
        if lookup.hues != 0u {
            color = entry_of(lookup.hues, quantity_of(value), SURFACE_BRIGHTNESS).rgb;
        }
    }
    if volume.lit != 0u {
        var slope = vec3(0.0);
        for (var k = 0u; k < 3u; k++) {
            let step = vec3<f32>(vec3(k) == vec3(0u, 1u, 2u));
            slope[k] = sample(strides, place + step).x - sample(strides, place - step).x;
        }
        color = shaded(color, slope, direction);
    }
    under(ray, color, surface.y);
}
#endif
