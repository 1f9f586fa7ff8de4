// Measured heights as src/gpu/surface/layout.rs hands them over: who looks, which chunks are drawn, and their samples.
//
// Places count from an anchor sample near the eye, heights from a reference: both are whole or exact in 32 bits, and what is far away from
// either is far from the eye as well. A corner's place comes out of `camera_of` and `snapped` whoever asks, by its row, column and height
// alone, so that chunks share their borders to the bit.
//
// On a globe (`GLOBE`) rows and columns are looked up: of each `lists` has how far it is from the anchor, along axes that point away from the globe's
// axis, to the east, and to the north. What is near the anchor is small in all of them, and so exact.
#define_import_path deepfield::surface_view
#import deepfield::surface_constants::{CHUNK, UNMEASURED, FRACTION, BEFORE_POINTS, BEFORE_POLES, BEFORE_SEAM, ROW_WORDS, COLUMN_WORDS, SQUARE, NONE, MIXED}

// What stays while the camera moves comes first: an adapter in software has the first word as a constant, and compiles anew where it changes.
struct SurfaceView {
    contour_color: vec3<f32>,
    contour_major: u32,
    /// The anchor at the reference height, and what a column, a row and a unit of height add, in the camera's coordinates; on a globe the axes
    /// away from its own, to the east and to the north.
    origin: vec3<f32>,
    focal: f32,
    per_column: vec3<f32>,
    near: f32,
    per_row: vec3<f32>,
    perspective: u32,
    per_height: vec3<f32>,
    /// Samples along a pixel's side.
    parts: u32,
    /// The eye and the camera's axes in columns, rows and heights.
    eye: vec3<f32>,
    /// Samples from a row of the picture to the next.
    stride: u32,
    right: vec3<f32>,
    /// The larger one of `step`.
    spacing: f32,
    up: vec3<f32>,
    fade_start: f32,
    forward: vec3<f32>,
    fade_rate: f32,
    /// The camera's axes in the world.
    world_right: vec3<f32>,
    clips: u32,
    world_up: vec3<f32>,
    /// Samples of the picture along the side of a point, and of that of one in no triangle.
    point_side: u32,
    world_forward: vec3<f32>,
    lone_side: u32,
    /// What is left out, from the eye.
    clip_min: vec3<f32>,
    colored_by: u32,
    clip_max: vec3<f32>,
    ramp_last: u32,
    /// Towards the sun.
    sun: vec3<f32>,
    is_sun: u32,
    /// Samples of the picture.
    size: vec2<u32>,
    middle: vec2<f32>,
    /// Column and row of the anchor, and the last ones of the field.
    anchor: vec2<i32>,
    last: vec2<u32>,
    /// The longest distances between neighbours along rows and along columns, world units.
    step: vec2<f32>,
    /// Where values lie in the range of colours.
    low: f32,
    per: f32,
    is_log: u32,
    /// The height that others count from.
    reference: f32,
    ambient: f32,
    /// By how much steeper than its normals say the surface stands, and world units of a unit of height without that.
    steeper: f32,
    true_lift: f32,
    contour_interval: f32,
    /// A height with a line, from the reference.
    contour_base: f32,
    contour_width: f32,
    /// Deeper than all that is drawn.
    far: f32,
    /// Where the tree of chunks begins, and the level of its root.
    tree: u32,
    top: u32,
    /// Whether residuals are what a form leaves, and not heights.
    has_form: u32,
    /// Where `lists` has the rows of its poles, their heights, and how many rows they are beyond the first and the last row.
    pole_at: vec2<u32>,
    pole_height: vec2<f32>,
    pole_rows: vec2<f32>,
    /// Angles of a column and of a row.
    turn: vec2<f32>,
    /// The last column but for that which is the first one again; where there is none, the last one.
    open: u32,
    /// The latitude of the anchor, and the radius of the globe.
    latitude: f32,
    radius: f32,
    /// World units of a unit of height.
    lift: f32,
    /// World lengths of a column and of a row that normals are made with.
    lengths: vec2<f32>,
    /// Rows and columns of a photo's pixels, the pixel that others are counted from, and where the anchor is from that one's edge.
    photo_size: vec2<u32>,
    photo_anchor: vec2<i32>,
    photo_at: vec2<f32>,
    /// Pixels that a row and a column are long.
    photo_per: vec2<f32>,
    /// The field's first and last row, and its first and last column, in pixels.
    photo_rows: vec2<f32>,
    photo_columns: vec2<f32>,
    /// After how many pixels the photo repeats, 0 where it does not, and whether it goes all around.
    photo_period: f32,
    photo_is_endless: u32,
    /// Where `lists` has the light of a photo's values.
    photo_light: u32,
    /// Where it has of each level of the photo where it lists its tiles, `NONE` for those that are not there, and how many of them are in a row;
    /// and how many levels there are.
    photo_table: u32,
    photo_levels: u32,
    /// Width of lines along rims, samples of the picture.
    rim_width: f32,
    /// What is drawn of a flat field, in columns, rows and heights.
    box_min: vec3<f32>,
    /// The height that walls go down or up to.
    wall_base: f32,
    box_max: vec3<f32>,
    /// Most cells that a membrane spans; 0 where there is none.
    spans: f32,
    /// The plane between a globe's near side and its far side, in the camera's coordinates: away from the eye, and how far that is; 0 where there is none.
    limb: vec3<f32>,
    limb_away: f32,
    /// Half of a globe's width at the equator, the square of its eccentricity, and how far above it the reference height is.
    equator: f32,
    squared_eccentricity: f32,
    lifted: f32,
    /// Whether the field's last column is the first one again.
    goes_round: u32,
}

/// A chunk that is drawn.
struct Draw {
    /// Its first word among the samples.
    start: u32,
    rows: u32,
    columns: u32,
    level: u32,
    /// Row and column among the chunks of its level.
    key_row: u32,
    key_column: u32,
    flags: u32,
    /// Where `lists` has its heights along the four sides; `NONE`: they are its own.
    border: u32,
    /// Where `lists` has the chunks that it lies in, itself first.
    chain: u32,
    chain_length: u32,
    /// Between which heights it is, from the reference, and a little more.
    low: f32,
    high: f32,
    /// On a globe: where `lists` has its rows and its columns.
    rows_at: u32,
    columns_at: u32,
    /// Where `lists` has squares of its cells with rims in them, and of its samples with a membrane; `NONE` where there are none.
    rims: u32,
    fill: u32,
    /// Of a globe that rays are cast through: where `lists` has the triangles whose corners are listed, of its poles and of cells along its sides, and the
    /// longest distance between two of its rows; `NONE` where there are no such triangles.
    fans: u32,
    row_length: f32,
}

@group(0) @binding(0) var<uniform> surface: SurfaceView;
/// Samples of chunks: heights, then normals, then what is left of these and coverage, then colours.
@group(0) @binding(1) var<storage, read> words: array<u32>;
@group(0) @binding(2) var<storage, read> draws: array<Draw>;
/// Numbers of chunks in the order in which they are drawn, heights of borders, chains, triangles, rows and columns of a globe, squares of chunks, and
/// a tree that finds chunks: of each branch the four below by row and column, where `lists` has the branch, a `LEAF`, or `NONE`.
///
/// Squares of `SQUARE` x `SQUARE`, row by row, are where `lists` has what is in them, or `NONE`. Of cells with rims that is a byte each, of samples
/// with a membrane a height.
@group(0) @binding(3) var<storage, read> lists: array<u32>;

/// Where a level has a sample, row and column of the field.
fn place_of_sample(index: vec2<u32>, level: u32) -> vec2<u32> {
    let place = index << vec2(level);
#ifdef GLOBE
    let open = vec2(surface.last.y, surface.open);
    // The sample behind the last one closes a globe.
    let is_beyond = (place > open) & (((max(index, vec2(1u)) - 1u) << vec2(level)) >= open);
    return select(min(place, open), surface.last.yx, is_beyond);
#else
    return min(place, surface.last.yx);
#endif
}

/// The cell of a level that a cell of the field is in.
fn cell_of_level(cell: vec2<u32>, level: u32) -> vec2<u32> {
#ifdef GLOBE
    // What closes a globe is a cell of its own.
    let open = vec2(surface.last.y, surface.open);
    let closing = (open + (1u << level) - 1u) >> vec2(level);
    return select(cell >> vec2(level), closing, (cell >= open) & (open < surface.last.yx));
#else
    return cell >> vec2(level);
#endif
}

/// Where a chunk's sample is, row and column of the field.
fn sample_at(draw: Draw, at: vec2<u32>) -> vec2<u32> {
    return place_of_sample(vec2(draw.key_row, draw.key_column) * CHUNK + at, draw.level);
}

/// What `camera_of` is asked with for a chunk's sample: row and column of the field, on a globe where `lists` has them.
fn corner_of(draw: Draw, at: vec2<u32>) -> vec2<u32> {
#ifdef GLOBE
    return vec2(draw.rows_at, draw.columns_at) + vec2(ROW_WORDS, COLUMN_WORDS) * at;
#else
    return sample_at(draw, at);
#endif
}

/// The height of a chunk's sample as it is drawn.
fn height_of(draw: Draw, at: vec2<u32>) -> f32 {
    if draw.border != NONE {
        if at.x == 0u {
            return bitcast<f32>(lists[draw.border + at.y]);
        }
        if at.x == draw.rows - 1u {
            return bitcast<f32>(lists[draw.border + draw.columns + at.y]);
        }
        if at.y == 0u {
            return bitcast<f32>(lists[draw.border + 2u * draw.columns + at.x]);
        }
        if at.y == draw.columns - 1u {
            return bitcast<f32>(lists[draw.border + 2u * draw.columns + draw.rows + at.x]);
        }
    }
    return bitcast<f32>(words[draw.start + at.x * draw.columns + at.y]);
}

fn is_measured(height: f32) -> bool {
    return height < UNMEASURED;
}

/// The coverage of a chunk's sample, of 255.
fn coverage_at(draw: Draw, at: vec2<u32>) -> u32 {
    return words[draw.start + 2u * draw.rows * draw.columns + at.x * draw.columns + at.y] >> 16u & 255u;
}

/// Whether a sample stands for places that are in none of its chunk's triangles (`Mesh::has_margin`).
fn has_margin(draw: Draw, at: vec2<u32>) -> bool {
    if draw.level == 0u || (draw.flags & MIXED) == 0u || coverage_at(draw, at) == 0u {
        return false;
    }
    if any(at == vec2(0u)) || any(at + 1u == vec2(draw.rows, draw.columns)) {
        return true;
    }
    let above = coverage_at(draw, at - vec2(1u, 0u));
    let below = coverage_at(draw, at + vec2(1u, 0u));
    let left = coverage_at(draw, at - vec2(0u, 1u));
    let right = coverage_at(draw, at + vec2(0u, 1u));
    return min(min(above, below), min(left, right)) == 0u;
}

/// Whether a measured sample is in no triangle, and stands for no other place (`Mesh::is_lone`).
fn is_lone(draw: Draw, at: vec2<u32>) -> bool {
    if (draw.flags & MIXED) == 0u {
        return false;
    }
    let is_least = coverage_at(draw, at) == 1u;
    if draw.level == 0u || !is_least {
        return is_least;
    }
    for (var k = 0u; k < 4u; k++) {
        let first = at - vec2(k >> 1u, k & 1u);
        // What is before the first one is beyond all.
        if first.x + 1u < draw.rows && first.y + 1u < draw.columns && first.x <= at.x && first.y <= at.y {
            var count = 0u;
            for (var corner = 0u; corner < 4u; corner++) {
                count += u32(is_measured(height_of(draw, first + vec2(corner >> 1u, corner & 1u))));
            }
            if count > 2u {
                return false;
            }
        }
    }
    return true;
}

/// A sample in the camera's coordinates, by its `corner_of`. Nothing of this is left to a compiler to fuse in one place and not in another.
fn camera_of(corner: vec2<u32>, height: f32) -> vec3<f32> {
#ifdef GLOBE
    let beyond = bitcast<f32>(lists[corner.x]);
    let away = bitcast<f32>(lists[corner.x + 1u]);
    let level = bitcast<f32>(lists[corner.x + 2u]);
    let north = bitcast<f32>(lists[corner.x + 3u]);
    let up = bitcast<f32>(lists[corner.x + 4u]);
    let sine = bitcast<f32>(lists[corner.y]);
    let versine = bitcast<f32>(lists[corner.y + 1u]);
    let lifted = surface.lift * height;
    let from_axis = fma(lifted, level, away);
    let outward = fma(-from_axis, versine, fma(lifted, level, beyond));
    let along = fma(vec3(outward), surface.per_column, surface.origin);
    return fma(vec3(fma(lifted, up, north)), surface.per_height, fma(vec3(from_axis * sine), surface.per_row, along));
#else
    let away = vec2<f32>(vec2<i32>(corner.yx) - surface.anchor);
    let along = fma(vec3(away.x), surface.per_column, surface.origin);
    return fma(vec3(height), surface.per_height, fma(vec3(away.y), surface.per_row, along));
#endif
}

/// A corner in the picture: x and y in parts of its samples, the bits of what is interpolated to its depth, and what it is.
struct Corner {
    place: vec2<i32>,
    linear: f32,
    state: u32,
}

/// Not measured; behind the near plane; in front of it.
const NOTHING: u32 = 0u;
const BEHIND: u32 = 1u;
const AHEAD: u32 = 2u;

fn snapped(camera: vec3<f32>) -> Corner {
    if !(camera.z >= surface.near) {
        return Corner(vec2(0), 0.0, BEHIND);
    }
    var scale = surface.focal;
    var linear = camera.z;
    if surface.perspective != 0u {
        scale = surface.focal / camera.z;
        linear = 1.0 / camera.z;
    }
    let pixels = fma(vec2(camera.x, -camera.y), vec2(scale), surface.middle);
    let part = clamp(round(pixels * f32(1u << FRACTION)), vec2(-2.68e8), vec2(2.68e8));
    return Corner(vec2<i32>(part), linear, AHEAD);
}

/// From the eye to a place of the picture at a depth.
fn from_eye(place: vec2<f32>, depth: f32) -> vec3<f32> {
    var across = vec2(place.x - surface.middle.x, surface.middle.y - place.y) / surface.focal;
    if surface.perspective != 0u {
        across *= depth;
    }
    return across.x * surface.world_right + across.y * surface.world_up + depth * surface.world_forward;
}

/// Whether what is so far from the eye is drawn.
fn is_kept(away: vec3<f32>) -> bool {
    return all(away >= surface.clip_min) && all(away <= surface.clip_max);
}

/// The share of light that comes from a depth.
fn fade_at(depth: f32) -> f32 {
    return exp(-surface.fade_rate * max(depth - surface.fade_start, 0.0));
}

/// The corners of a cell: their heights, and which of these were measured. Others are of a membrane, or there are none.
struct Quad {
    heights: vec4<f32>,
    measured: vec4<bool>,
}

fn quad_of(draw: Draw, at: vec2<u32>) -> Quad {
    var heights: vec4<f32>;
    for (var k = 0u; k < 4u; k++) {
        heights[k] = height_of(draw, at + vec2(k >> 1u, k & 1u));
    }
    let measured = heights < vec4(UNMEASURED);
#ifdef FILLED
    for (var k = 0u; k < 4u; k++) {
        if !measured[k] {
            heights[k] = fill_of(draw, at + vec2(k >> 1u, k & 1u));
        }
    }
#endif
    return Quad(heights, measured);
}

#ifdef FILLED
/// The height of a membrane where a chunk's sample was not measured.
fn fill_of(draw: Draw, at: vec2<u32>) -> f32 {
    if draw.fill == NONE {
        return UNMEASURED;
    }
    let square = at / SQUARE;
    let entry = lists[draw.fill + square.x * ((draw.columns + SQUARE - 1u) / SQUARE) + square.y];
    if entry == NONE {
        return UNMEASURED;
    }
    let within = at % SQUARE;
    return bitcast<f32>(lists[entry + SQUARE * within.x + within.y]);
}
#endif

/// The corners of a cell, of 0 to 3, that make a triangle of it, whether there is one, and whether it is a membrane's.
struct Half {
    corners: vec3<u32>,
    exists: bool,
    is_membrane: bool,
}

fn counted(corners: vec4<bool>) -> u32 {
    return dot(select(vec4(0u), vec4(1u), corners), vec4(1u));
}

/// One of the triangles of these corners of a cell: two, one or none (`Cell::triangles`).
fn half_between(corners: vec4<bool>, slot: u32) -> Half {
    if all(corners) {
        return Half(select(vec3(0u, 2u, 3u), vec3(0u, 1u, 3u), slot == 0u), true, false);
    }
    if counted(corners) < 3u || slot > 0u {
        return Half(vec3(0u), false, false);
    }
    if !corners.x {
        return Half(vec3(1u, 2u, 3u), true, false);
    }
    if !corners.y {
        return Half(vec3(0u, 2u, 3u), true, false);
    }
    return Half(select(vec3(0u, 1u, 2u), vec3(0u, 1u, 3u), !corners.z), true, false);
}

/// One of the triangles of a cell: those of the corners that were measured, then those of a membrane (`Mesh::triangles`).
fn half_in(corners: vec4<bool>, measured: vec4<bool>, slot: u32) -> Half {
    let own = half_between(measured, slot);
#ifdef FILLED
    let count = counted(measured);
    if !own.exists && count < 4u {
        var rest = corners;
        if count == 3u {
            // Opposite to the corner that was not measured is the triangle of those that were.
            let open = dot(select(vec4(0u, 1u, 2u, 3u), vec4(0u), measured), vec4(1u));
            rest = corners & (vec4(3u, 2u, 1u, 0u) != vec4(open));
        }
        var half = half_between(rest, slot - select(0u, 1u, count == 3u));
        half.is_membrane = half.exists;
        return half;
    }
#endif
    return own;
}

fn half_of(quad: Quad, slot: u32) -> Half {
    return half_in(quad.heights < vec4(UNMEASURED), quad.measured, slot);
}

/// What a number says: a chunk's cell and which of its triangles, a sample of a chunk, or a column of cells and the pole beside it.
struct Shown {
    node: u32,
    at: vec2<u32>,
    slot: u32,
}

/// The first slot of triangles to poles, and that of points.
const POLE: u32 = 2u;
const POINT: u32 = 4u;

/// As `Shown::pack` in crates/draw/src/cpu/surface/raster.rs has it.
fn shown_of(number: u32) -> Shown {
    let node = number >> 18u;
    let within = number & 0x3ffffu;
    if within < BEFORE_POINTS {
        return Shown(node, vec2(within / 512u, within / 2u % 256u), within & 1u);
    }
    if within < BEFORE_POLES {
        return Shown(node, vec2((within - BEFORE_POINTS) / 257u, (within - BEFORE_POINTS) % 257u), POINT);
    }
    if within < BEFORE_SEAM {
        let end = (within - BEFORE_POLES) / 257u;
        return Shown(node, vec2(select(0u, draws[node].rows - 1u, end == 1u), (within - BEFORE_POLES) % 257u), POLE + end);
    }
    return Shown(node, vec2((within - BEFORE_SEAM) / 2u, CHUNK), (within - BEFORE_SEAM) & 1u);
}
