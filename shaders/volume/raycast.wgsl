// Ray casting through one slab, front to back (F12 5.6): emission and absorption with post-classification, isosurfaces, or
// both; step for step what src/raster/volume/raycast.rs does, whose comments say why.
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
#import deepfield::volume_view::Portion
#import deepfield::volume_constants::{
    BRICK, BRICK_SHIFT, BRIGHTNESSES, CELLS, HIDDEN_BITS, HUES, SURFACE_BRIGHTNESS, VALUE_ENTRIES,
    COLUMN_VALUES, COVERS, DIMMED, EVEN_TABLE, FACE_WORDS, HOLES_OF_SURFACES, HOLES_OF_VOLUME,
}

@group(0) @binding(1) var<uniform> portion: Portion;
/// Depth, spacing, cells per length and thickness of each slice.
@group(0) @binding(2) var<storage, read> depths: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> field: array<f32>;
@group(0) @binding(4) var<storage, read> densest: array<f32>;
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

const NOTHING: u32 = 0xffffffffu;

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

/// Where a ray reads the field: a layer and the one in front of it, in the ring of layers that are held.
struct Place {
    /// The stored cell before the ray, and the shares of the way to the next column and row.
    cell: vec2<u32>,
    shares: vec2<f32>,
    /// The window's first brick, and its size.
    origin: vec2<u32>,
    window: vec2<u32>,
    layer: u32,
    /// First brick that is held of the layer and the one in front.
    here: u32,
    front: u32,
    last_slice: u32,
#ifdef CENTERED
    /// The ray's own cell in the first slice of the layer and the one in front; NOTHING where the part holds nothing.
    here_cell: u32,
    front_cell: u32,
#endif
}

#ifdef COLUMNS
const VALUES: u32 = COLUMN_VALUES;
#else ifdef ATTRIBUTE
const VALUES: u32 = 2u;
#else
const VALUES: u32 = 1u;
#endif

/// Density and `sum m A W` by the index of a cell.
fn values_at(at: u32) -> vec2<f32> {
#ifdef ATTRIBUTE
    return vec2(field[at], field[at + CELLS]);
#else
    return vec2(field[at], 0.0);
#endif
}

/// The index of a stored cell; NOTHING where there is none.
fn index_of(place: Place, cell: vec2<u32>, slice: u32) -> u32 {
    let brick = (cell >> vec2(BRICK_SHIFT)) - place.origin;
    let held = select(place.front, place.here, (slice >> BRICK_SHIFT) == place.layer)
        + brick.y * place.window.x + brick.x;
    let inside = vec3(cell, slice) & vec3(BRICK - 1u);
    // Parts that hold nothing are not written, and bricks outside the window do not exist.
    if any(brick >= place.window) || densest[held * #{PARTS}u + inside.y * #{PARTS}u / BRICK] <= 0.0 {
        return NOTHING;
    }
    return held * VALUES * CELLS + ((((inside.z << BRICK_SHIFT) | inside.y) << BRICK_SHIFT) | inside.x);
}

/// Density and `sum m A W` of a stored cell.
fn cell_at(place: Place, cell: vec2<u32>, slice: u32) -> vec2<f32> {
    let at = index_of(place, cell, slice);
    if at == NOTHING {
        return vec2(0.0);
    }
    return values_at(at);
}

/// Density and `sum m A W` before the ray, moved by whole cells: bilinear. Slices beyond the grid's ends repeat the last one.
fn sample(place: Place, moved: vec2<i32>, slice: i32) -> vec2<f32> {
    let z = min(u32(max(slice, 0)), place.last_slice);
    let cell = vec2<u32>(vec2<i32>(place.cell) + moved);
    let a = cell_at(place, cell, z);
#ifdef CENTERED
    return a;
#else
    let b = cell_at(place, cell + vec2(1u, 0u), z);
    let c = cell_at(place, cell + vec2(0u, 1u), z);
    let d = cell_at(place, cell + vec2(1u, 1u), z);
    let u = place.shares.x;
    let v = place.shares.y;
    return (a + u * (b - a)) * (1.0 - v) + (c + u * (d - c)) * v;
#endif
}

/// Density and `sum m A W` where the ray passes a slice of the layer or the one in front.
fn on_ray(place: Place, slice: u32) -> vec2<f32> {
#ifdef CENTERED
    let first = select(place.front_cell, place.here_cell, (slice >> BRICK_SHIFT) == place.layer);
    if first == NOTHING {
        return vec2(0.0);
    }
    return values_at(first + (slice & (BRICK - 1u)) * BRICK * BRICK);
#else
    return sample(place, vec2(0), i32(slice));
#endif
}

#ifdef COLUMNS
/// One of the values of a stored cell.
fn value_of(place: Place, cell: vec2<u32>, slice: u32, value: u32) -> f32 {
    let at = index_of(place, cell, slice);
    if at == NOTHING {
        return 0.0;
    }
    return field[at + value * CELLS];
}

/// The same before the ray, moved by whole cells: bilinear; below 0 where some of it is a hole, if there are holes.
fn number_at(place: Place, moved: vec2<i32>, slice: i32, value: u32, has_holes: bool) -> f32 {
    let z = min(u32(max(slice, 0)), place.last_slice);
    let cell = vec2<u32>(vec2<i32>(place.cell) + moved);
    let a = value_of(place, cell, z, value);
#ifdef CENTERED
    return select(a, -1.0, has_holes && a <= 0.0);
#else
    if all(place.shares == vec2(0.0)) {
        return select(a, -1.0, has_holes && a <= 0.0);
    }
    let b = value_of(place, cell + vec2(1u, 0u), z, value);
    let c = value_of(place, cell + vec2(0u, 1u), z, value);
    let d = value_of(place, cell + vec2(1u, 1u), z, value);
    let u = place.shares.x;
    let v = place.shares.y;
    let mean = (a + u * (b - a)) * (1.0 - v) + (c + u * (d - c)) * v;
    return select(mean, -1.0, has_holes && min(min(a, b), min(c, d)) <= 0.0);
#endif
}

/// The number that surfaces are of, before the ray; below 0 where there is nothing.
fn level_at(place: Place, slice: i32) -> f32 {
    return number_at(place, vec2(0), slice, SURFACE_NUMBERS, (columns_read & HOLES_OF_SURFACES) != 0u);
}
#endif

#ifdef CENTERED
/// Where a ray's own cells of a layer begin in a brick that is held, `within` it; NOTHING where its part holds nothing.
fn first_cell(held: u32, within: vec2<u32>) -> u32 {
    let holds = densest[held * #{PARTS}u + within.y * #{PARTS}u / BRICK] > 0.0;
    return select(NOTHING, held * VALUES * CELLS + within.y * BRICK + within.x, holds);
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

fn depth_of(place: Place, slice: i32) -> vec2<f32> {
    return depths[min(u32(max(slice, 0)), place.last_slice)].xy;
}

fn difference(low: f32, high: f32, distance: f32) -> f32 {
    return select(0.0, (high - low) / max(distance, 1.0e-37), distance > 0.0);
}

/// The gradient of the density in camera axes at a share of a step: differences between neighbours in the grid, brought to
/// camera space by the chain rule (F12 5.6).
fn gradient(place: Place, middle: vec2<f32>, step: i32, at: f32) -> vec3<f32> {
    let left = mix(sample(place, vec2(-1, 0), step - 1).x, sample(place, vec2(-1, 0), step).x, at);
    let right = mix(sample(place, vec2(1, 0), step - 1).x, sample(place, vec2(1, 0), step).x, at);
    let above = mix(sample(place, vec2(0, -1), step - 1).x, sample(place, vec2(0, -1), step).x, at);
    let below = mix(sample(place, vec2(0, 1), step - 1).x, sample(place, vec2(0, 1), step).x, at);
    let along = 0.5 * vec2(right - left, below - above);
    let before = sample(place, vec2(0, 0), step - 2).x;
    let front = sample(place, vec2(0, 0), step - 1).x;
    let back = sample(place, vec2(0, 0), step).x;
    let behind = sample(place, vec2(0, 0), step + 1).x;
    let near_slice = depth_of(place, step - 1);
    let far_slice = depth_of(place, step);
    let start = difference(before, back, far_slice.x - depth_of(place, step - 2).x);
    let end = difference(front, behind, depth_of(place, step + 1).x - near_slice.x);
    let along_z = start + at * (end - start);
    let here = mix(near_slice, far_slice, at);
    let shear = select(0.0, dot(middle, along) / here.x, volume.perspective != 0u);
    // Rows go down, y goes up.
    return vec3(along.x / here.y, -along.y / here.y, along_z - shear);
}

#ifdef COLUMNS
/// The difference of two numbers at a distance from each other; another one where there is nothing at one of them.
fn known_difference(low: f32, high: f32, distance: f32, otherwise: f32) -> f32 {
    return select(otherwise, difference(low, high, distance), min(low, high) >= 0.0);
}

/// What a number is at a share of a step; below 0 where there is nothing at one end.
fn known_within(place: Place, moved: vec2<i32>, step: i32, at: f32, value: u32, has_holes: bool) -> f32 {
    let front = number_at(place, moved, step - 1, value, has_holes);
    let back = number_at(place, moved, step, value, has_holes);
    return select(-1.0, front + at * (back - front), min(front, back) >= 0.0);
}

/// Half of the difference between the numbers on both sides of a middle one; that to the middle one where there is nothing on one of them.
fn known_across(low: f32, middle: f32, high: f32) -> f32 {
    if min(low, high) >= 0.0 {
        return 0.5 * (high - low);
    }
    if middle < 0.0 || max(low, high) < 0.0 {
        return 0.0;
    }
    return select(high - middle, middle - low, low >= 0.0);
}

/// The gradient of one of the values of cells, as that of the density.
fn gradient_of(place: Place, middle: vec2<f32>, step: i32, at: f32, value: u32, has_holes: bool) -> vec3<f32> {
    let here = known_within(place, vec2(0), step, at, value, has_holes);
    let left = known_within(place, vec2(-1, 0), step, at, value, has_holes);
    let right = known_within(place, vec2(1, 0), step, at, value, has_holes);
    let above = known_within(place, vec2(0, -1), step, at, value, has_holes);
    let below = known_within(place, vec2(0, 1), step, at, value, has_holes);
    let along = vec2(known_across(left, here, right), known_across(above, here, below));
    let before = number_at(place, vec2(0), step - 2, value, has_holes);
    let front = number_at(place, vec2(0), step - 1, value, has_holes);
    let back = number_at(place, vec2(0), step, value, has_holes);
    let behind = number_at(place, vec2(0), step + 1, value, has_holes);
    let near_slice = depth_of(place, step - 1);
    let far_slice = depth_of(place, step);
    let within = known_difference(front, back, far_slice.x - near_slice.x, 0.0);
    let start = known_difference(before, back, far_slice.x - depth_of(place, step - 2).x, within);
    let end = known_difference(front, behind, depth_of(place, step + 1).x - near_slice.x, within);
    let along_z = start + at * (end - start);
    let depth = mix(near_slice, far_slice, at);
    let shear = select(0.0, dot(middle, along) / depth.x, volume.perspective != 0u);
    return vec3(along.x / depth.y, -along.y / depth.y, along_z - shear);
}
#endif

#ifdef SURFACES
#ifdef EVEN
/// The least of the cells that a sample before the ray is made of.
fn least_at(place: Place, slice: u32) -> f32 {
    let a = cell_at(place, place.cell, slice).x;
#ifdef CENTERED
    return a;
#else
    if all(place.shares == vec2(0.0)) {
        return a;
    }
    let b = cell_at(place, place.cell + vec2(1u, 0u), slice).x;
    let c = cell_at(place, place.cell + vec2(0u, 1u), slice).x;
    let d = cell_at(place, place.cell + vec2(1u, 1u), slice).x;
    return min(min(a, b), min(c, d));
#endif
}
#endif

/// The same of a surface of a density. Where a field ends or is cut the cells alone say which way it faces: what is outside is 0.
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
