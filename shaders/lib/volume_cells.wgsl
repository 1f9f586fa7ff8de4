// The cells of a slab as rays read them: what they hold beside a ray, and how that rises, as crates/draw/src/cpu/volume/raycast.rs has it, whose
// comments say why.
//
// Whoever imports this has bindings 0 and 2 to 4 of group 0 taken.
#define_import_path deepfield::volume_cells
#import deepfield::isosurface::volume
#import deepfield::volume_constants::{BRICK, BRICK_SHIFT, CELLS, COLUMN_VALUES}

/// Depth, spacing, cells per length and thickness of each slice.
@group(0) @binding(2) var<storage, read> depths: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> field: array<f32>;
@group(0) @binding(4) var<storage, read> densest: array<f32>;

const NOTHING: u32 = 0xffffffffu;

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
#endif

#ifdef CENTERED
/// Where a ray's own cells of a layer begin in a brick that is held, `within` it; NOTHING where its part holds nothing.
fn first_cell(held: u32, within: vec2<u32>) -> u32 {
    let holds = densest[held * #{PARTS}u + within.y * #{PARTS}u / BRICK] > 0.0;
    return select(NOTHING, held * VALUES * CELLS + within.y * BRICK + within.x, holds);
}
#endif

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
