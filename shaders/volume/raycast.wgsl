// Ray casting through one slab, front to back (F12 5.6): emission and absorption with post-classification, isosurfaces, or
// both; step for step what crates/draw/src/cpu/volume/raycast.rs does, whose comments say why.
//
// One invocation for each pixel, whose state is carried from slab to slab in `rays` and `progress`.
//
// What rays do rarely stands behind the loops over what they do often: a software driver goes through all that a loop holds in
// every round, and on a graphics card rays would wait for each other. So rays go past cells that do not show, through cells that
// do, to surfaces, and to the next layer that is not empty in four loops, each within the one that follows.
//
// With CENTERED (cells are pixels) rays go through the cells' centres. With EVEN the table's entries lie evenly between 1 and 2: those of a
// sampled field, whose samples say which way surfaces face. With LIT the volume itself is lit, by differences of cells. With COLUMNS cells are
// of fields of particles' columns: surfaces may be of numbers of their own, both may have holes, in which there is no value that neighbours may
// be compared with, and the volume's extinction may be multiplied. With FACES a surface is kept for each pixel: the one that adds most, or with
// COVERING the first one that covers.
#import deepfield::isosurface::{
    volume, Crossings, NO_CROSSING, crossings_of, is_crossed, shaded, surface_levels, take_nearest,
}
#ifdef EVEN
#ifdef SURFACES
#import deepfield::field_slope::{has_slope, slope_at}
#endif
#endif
#import deepfield::volume_cells::{
    Place, depth_of, depths, first_cell, gradient, gradient_of, least_at, number_at, on_ray, sample,
}
#import deepfield::volume_view::Portion
#import deepfield::volume_constants::{
    BRICK, BRICK_SHIFT, BRIGHTNESSES, HIDDEN_BITS, HUES, SURFACE_BRIGHTNESS, VALUE_ENTRIES,
    COVERS, DIMMED, EVEN_TABLE, FACE_WORDS, HOLES_OF_SURFACES, HOLES_OF_VOLUME,
}

@group(0) @binding(1) var<uniform> portion: Portion;
/// For each column of bricks one bit for each of the slab's layers: rays may meet something there.
@group(0) @binding(5) var<storage, read> reach: array<vec2<u32>>;
/// Extinction and colour of each density, or its brightness and its place in the range in place of the colour where there are
/// hues; then the hues, each from dark to bright; then colours and factors on the extinction for hues and places.
@group(0) @binding(6) var<storage, read> table: array<vec4<f32>>;
/// Light gathered, linear, premultiplied, and opacity.
@group(0) @binding(7) var<storage, read_write> rays: array<vec4<f32>>;
/// Share of the present cell that has been drawn; the step in which a ray ended. With FACES, behind those of all pixels of the
/// window, the surface of each: its share of the pixel, its depth, where its line of sight is at depth 1 along x and y, its slope, and its
/// colour as it is before light; with COVERING no slope, and its colour as it is lit.
@group(0) @binding(8) var<storage, read_write> progress: array<f32>;
/// For each column of pixels, then for each row, the stored cell before its rays, and the bits of the share of the way to
/// the next one.
@group(0) @binding(9) var<storage, read> places: array<vec2<u32>>;

/// What every sample asks for: a software driver fetches uniforms for each lane, every time.
struct Lookup {
    first_entry: u32,
    last_entry: u32,
    hues: u32,
    plane: u32,
    attribute_log: bool,
    attribute_map: vec2<f32>,
}
var<private> lookup: Lookup;

#ifdef COLUMNS
/// How columns are read, the ray's place, and its distance from the middle line of sight, cells.
var<private> columns_read: u32;
var<private> ray_place: Place;
var<private> ray_middle: vec2<f32>;
/// Where cells have the numbers of the volume, those of surfaces, and what the extinction is multiplied by.
const OWN_NUMBERS: u32 = 0u;
const SURFACE_NUMBERS: u32 = 2u;
const FACTORS: u32 = 3u;
#else ifdef LIT
/// The ray's place, and its distance from the middle line of sight, cells.
var<private> ray_place: Place;
var<private> ray_middle: vec2<f32>;
#endif

struct Ray {
    color: vec3<f32>,
    alpha: f32,
    done: f32,
}

#ifdef COLUMNS
/// The number that surfaces are of, before the ray; below 0 where there is nothing.
fn level_at(place: Place, slice: i32) -> f32 {
    return number_at(place, vec2(0), slice, SURFACE_NUMBERS, (columns_read & HOLES_OF_SURFACES) != 0u);
}
#endif

/// What is behind, seen through what is here.
fn under(ray: ptr<function, Ray>, color: vec3<f32>, alpha: f32) {
    let share = (1.0 - (*ray).alpha) * alpha;
    (*ray).color += share * color;
    (*ray).alpha += share;
}

/// What a table of hues, which begins at `table_start`, has for an attribute's value at a brightness or a place.
fn entry_of(table_start: u32, quantity: f32, brightness: f32) -> vec4<f32> {
    var value = quantity;
    var known = true;
    if lookup.attribute_log {
        known = quantity > 0.0;
        value = log2(max(quantity, 1.0e-37));
    }
    let at = select(0.0, clamp(fma(value, lookup.attribute_map.x, lookup.attribute_map.y), 0.0, 1.0), known);
    let row = u32(floor(at * f32(HUES - 1u) + 0.5)) * BRIGHTNESSES;
    let column = min(u32(floor(max(brightness, 0.0) * f32(BRIGHTNESSES - 1u) + 0.5)), BRIGHTNESSES - 1u);
    return table[table_start + row + column];
}

/// The colour of an attribute's value at a brightness.
fn tinted(quantity: f32, brightness: f32) -> vec3<f32> {
    if lookup.hues == 0u {
        return vec3(1.0);
    }
    return entry_of(lookup.hues, quantity, brightness).rgb;
}

/// Passes a share of a cell.
fn through(ray: ptr<function, Ray>, slice: u32, value: vec2<f32>, share: f32, secant: f32, faintest: f32) {
    if value.x <= faintest || share <= 0.0 {
        return;
    }
    let last = lookup.last_entry;
#ifdef EVEN
    let entry = clamp((value.x - 1.0) * f32(VALUE_ENTRIES - 1u), 0.0, f32(VALUE_ENTRIES - 1u));
    let at = min(u32(entry), last);
    let between = entry - f32(at);
#else
    let bits = bitcast<u32>(value.x);
    let entry = bits >> HIDDEN_BITS;
    let first = lookup.first_entry;
    var at = 0u;
    var between = 0.0;
    if entry >= first {
        at = entry - first;
        between = f32(bits & ((1u << HIDDEN_BITS) - 1u)) * (1.0 / f32(1u << HIDDEN_BITS));
        if at > last {
            at = last;
            between = 1.0;
        }
    }
#ifdef COLUMNS
    if (columns_read & EVEN_TABLE) != 0u {
        let even = clamp((value.x - 1.0) * f32(VALUE_ENTRIES - 1u), 0.0, f32(VALUE_ENTRIES - 1u));
        at = min(u32(even), last);
        between = even - f32(at);
    }
#endif
#endif
    let low = table[at];
    let matter = low + between * (table[at + 1u] - low);
    if matter.x <= 0.0 {
        return;
    }
    var color = matter.yzw;
    var extinction = matter.x;
#ifdef ATTRIBUTE
    if lookup.plane != 0u {
        let planar = entry_of(lookup.plane, value.y / value.x, matter.z);
        color = planar.rgb;
        extinction *= planar.a;
    } else if lookup.hues != 0u {
        color = tinted(value.y / value.x, matter.y);
    }
#endif
#ifdef COLUMNS
    if (columns_read & DIMMED) != 0u {
        extinction *= number_at(ray_place, vec2(0), i32(slice), FACTORS, false);
    }
#endif
#ifdef LIT
    // The slice is where the step behind it begins, or where the last one ends.
    let is_last = slice + 1u >= volume.slices;
    let lit_step = i32(select(slice + 1u, slice, is_last));
#ifdef COLUMNS
    let has_holes = (columns_read & HOLES_OF_VOLUME) != 0u;
    let slope = gradient_of(ray_place, ray_middle, lit_step, select(0.0, 1.0, is_last), OWN_NUMBERS, has_holes);
#else
    let slope = gradient(ray_place, ray_middle, lit_step, select(0.0, 1.0, is_last));
#endif
    let sigma = select(0.0, volume.sigma, volume.perspective != 0u);
    color = shaded(color, slope, normalize(vec3(ray_middle.x * sigma, -ray_middle.y * sigma, 1.0)));
#endif
    let passed = depths[slice].w * secant * share;
    under(ray, color, 1.0 - exp(-extinction * passed));
}

#ifdef SURFACES
/// Which way a density rises on its surface. Where a field ends or is cut the cells alone say that: what is outside is 0.
fn slope_of(place: Place, middle: vec2<f32>, step: u32, at: f32, density: f32) -> vec3<f32> {
#ifdef EVEN
    if has_slope(step) && min(least_at(place, step - 1u), least_at(place, step)) > 0.0 {
        let here = mix(depth_of(place, i32(step) - 1), depth_of(place, i32(step)), at);
        return slope_at(middle * here.y, here.x, density);
    }
#endif
#ifdef COLUMNS
    let has_holes = (columns_read & HOLES_OF_SURFACES) != 0u;
    return gradient_of(place, middle, i32(step), at, SURFACE_NUMBERS, has_holes);
#else
    return gradient(place, middle, i32(step), at);
#endif
}

#ifdef FACES
/// Where the pixel's surface is kept.
var<private> face: u32;

/// Keeps a surface at a place along the slices where it adds more to the pixel than the one before; with COVERING where there is none before.
fn offer(share: f32, slice: f32, line: vec3<f32>, slope: vec3<f32>, color: vec3<f32>) {
#ifdef COVERING
    if progress[face] > 0.0 {
        return;
    }
#else
    if share <= progress[face] {
        return;
    }
#endif
    let far = slice / volume.slice_rate;
    progress[face] = share;
    progress[face + 1u] = select(volume.near + far, volume.near * exp(far), volume.perspective != 0u);
    progress[face + 2u] = line.x;
    progress[face + 3u] = line.y;
    for (var k = 0u; k < 3u; k++) {
        progress[face + 4u + k] = slope[k];
        progress[face + 7u + k] = color[k];
    }
}
#endif

/// Meets a surface at a share of a step.
fn meet(
    ray: ptr<function, Ray>,
    place: Place,
    middle: vec2<f32>,
    step: u32,
    at: f32,
    index: u32,
    before: vec2<f32>,
    now: vec2<f32>,
) {
    let surface = volume.surfaces[index];
    var color = volume.colors[index].rgb;
    if surface.z == 0.0 {
        let value = before + at * (now - before);
        color = tinted(value.y / value.x, SURFACE_BRIGHTNESS);
    }
    let sigma = select(0.0, volume.sigma, volume.perspective != 0u);
    let line = vec3(middle.x * sigma, -middle.y * sigma, 1.0);
    if volume.lit != 0u {
        let slope = slope_of(place, middle, step, at, surface.x);
#ifdef FACES
#ifndef COVERING
        offer((1.0 - (*ray).alpha) * surface.y, f32(step) - 0.5 + at, line, slope, color);
#endif
#endif
        color = shaded(color, slope, normalize(line));
    }
#ifdef COVERING
    if surface.y >= COVERS {
        offer((1.0 - (*ray).alpha) * surface.y, f32(step) - 0.5 + at, line, vec3(0.0), color);
    }
#endif
    under(ray, color, surface.y);
}
#endif

@compute @workgroup_size(8, 8)
fn cast_rays(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let pixel = invocation.xy + portion.first_pixel;
    if any(pixel >= portion.behind_pixel) {
        return;
    }
    let index = invocation.y * (portion.behind_pixel.x - portion.first_pixel.x) + invocation.x;
#ifdef FACES
    let size = portion.behind_pixel - portion.first_pixel;
    face = size.x * size.y + FACE_WORDS * index;
#endif
    lookup = Lookup(
        volume.first_entry, volume.last_entry, volume.hues, volume.plane, volume.attribute_log != 0u, volume.attribute_map,
    );
#ifdef COLUMNS
    columns_read = volume.columns_read;
#endif
    let column_place = places[pixel.x];
    let row_place = places[portion.rows + pixel.y];
    var place: Place;
    place.cell = vec2(column_place.x, row_place.x);
    place.shares = bitcast<vec2<f32>>(vec2(column_place.y, row_place.y));
    place.origin = portion.origin;
    place.window = volume.window;
    place.last_slice = volume.slices - 1u;
    let brick = place.cell >> vec2(BRICK_SHIFT);
    let gathered = rays[index];
    let termination = volume.termination;
    if gathered.w >= termination {
        return;
    }
    var ray = Ray(gathered.rgb, gathered.w, 0.0);
#ifdef SURFACES
    ray.done = progress[index];
#endif

    let column = (brick.y - place.origin.y) * place.window.x + brick.x - place.origin.x;
    let columns = place.window.x * place.window.y;
    let middle = vec2<f32>(place.cell) + place.shares + 0.5 - volume.middle;
    let sigma = select(0.0, volume.sigma, volume.perspective != 0u);
    let secant = sqrt(1.0 + sigma * sigma * dot(middle, middle));
    let slices = volume.slices;
    let ring = volume.ring;
    let last_layer = volume.last_layer;
    let faintest = volume.faintest;
    let behind = portion.behind_step;
#ifdef SURFACES
    let levels = surface_levels();
#endif

    var layers_left = reach[column];
    var step = portion.first_step;
    while any(layers_left != vec2(0u)) && ray.alpha < termination {
        let of_low = layers_left.x != 0u;
        let layer = portion.first_layer + firstTrailingBit(select(layers_left.y, layers_left.x, of_low)) + select(32u, 0u, of_low);
        layers_left = select(
            vec2(0u, layers_left.y & (layers_left.y - 1u)), vec2(layers_left.x & (layers_left.x - 1u), layers_left.y), of_low,
        );
        // A layer has the steps whose next slice is in it, for a gradient's sake; the last one those to the end. Before the first
        // slice there is nothing.
        let start = max(max(layer << BRICK_SHIFT, 2u) - 1u, portion.first_step);
        let end = select(behind, min(behind, (layer << BRICK_SHIFT) + BRICK - 1u), layer < last_layer);
        if start != step {
            ray.done = 0.0;
        }
        step = start;
        place.layer = layer;
        place.here = layer % ring * columns;
        place.front = (layer + ring - 1u) % ring * columns;
#ifdef CENTERED
        let within = place.cell & vec2(BRICK - 1u);
        place.here_cell = first_cell(place.here + column, within);
        place.front_cell = first_cell(place.front + column, within);
#endif
#ifdef COLUMNS
        ray_place = place;
        ray_middle = middle;
#else ifdef LIT
        ray_place = place;
        ray_middle = middle;
#endif
#ifdef SURFACES
        while step < end && ray.alpha < termination {
            var crossed = false;
            var before = on_ray(place, step - 1u).x;
#ifdef COLUMNS
            var level = level_at(place, i32(step) - 1);
#endif
            while step < end && ray.alpha < termination {
                var now = 0.0;
#ifdef COLUMNS
                var next_level = -1.0;
#endif
                for (; step < end; step++) {
                    now = 0.0;
#ifdef COLUMNS
                    next_level = -1.0;
#endif
                    if step < slices {
                        now = on_ray(place, step).x;
#ifdef COLUMNS
                        next_level = level_at(place, i32(step));
                        crossed = min(level, next_level) >= 0.0 && is_crossed(levels, level, next_level);
#else
                        crossed = is_crossed(levels, before, now);
#endif
                    }
                    if crossed || before > faintest {
                        break;
                    }
                    ray.done = 0.0;
                    before = now;
#ifdef COLUMNS
                    level = next_level;
#endif
                }
                if crossed || step == end {
                    break;
                }
                through(&ray, step - 1u, on_ray(place, step - 1u), 1.0 - ray.done, secant, faintest);
                ray.done = 0.0;
                before = now;
#ifdef COLUMNS
                level = next_level;
#endif
                step += select(0u, 1u, ray.alpha < termination);
            }
            if crossed {
                let before = on_ray(place, step - 1u);
                let now = on_ray(place, step);
#ifdef COLUMNS
                let from_level = level_at(place, i32(step) - 1);
                let to_level = level_at(place, i32(step));
                let first_level = level_at(place, i32(step) - 2);
                let last_level = level_at(place, i32(step) + 1);
                // The nearest that there is in place of what is nothing.
                let first = select(first_level, from_level, first_level < 0.0);
                let last = select(last_level, to_level, last_level < 0.0);
                var left = crossings_of(vec4(first, from_level, to_level, last), levels);
#else
                let first = sample(place, vec2(0), i32(step) - 2).x;
                let last = sample(place, vec2(0), i32(step) + 1).x;
                var left = crossings_of(vec4(first, before.x, now.x, last), levels);
#endif
                var next_done = 0.0;
                for (var n = 0u; n < 8u; n++) {
                    let nearest = take_nearest(&left);
                    let share = nearest.at;
                    if share == NO_CROSSING {
                        break;
                    }
                    let until = min(0.5 + share, 1.0);
                    through(&ray, step - 1u, before, until - ray.done, secant, faintest);
                    ray.done = until;
                    let beyond = max(share - 0.5, 0.0);
                    if beyond > next_done {
                        through(&ray, step, now, beyond - next_done, secant, faintest);
                        next_done = beyond;
                    }
                    meet(&ray, place, middle, step, share, nearest.surface, before, now);
                }
                through(&ray, step - 1u, before, 1.0 - ray.done, secant, faintest);
                ray.done = next_done;
                step += select(0u, 1u, ray.alpha < termination);
            }
        }
#else
        while step < end && ray.alpha < termination {
            var value = vec2(0.0);
            for (; step < end; step++) {
                value = on_ray(place, step - 1u);
                if value.x > faintest {
                    break;
                }
            }
            if step < end {
                through(&ray, step - 1u, value, 1.0, secant, faintest);
                step += select(0u, 1u, ray.alpha < termination);
            }
        }
#endif
    }
    // Of a ray that has ended nobody wants to know the share, but where that was.
    let has_ended = ray.alpha >= termination;
    if ray.alpha != gathered.w {
        rays[index] = vec4(ray.color, ray.alpha);
    }
#ifdef SURFACES
    if !has_ended && step != behind {
        ray.done = 0.0;
    }
    progress[index] = select(ray.done, f32(step), has_ended);
#else
    if has_ended {
        progress[index] = f32(step);
    }
#endif
}
