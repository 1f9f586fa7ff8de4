// Lines along the rims of holes: how far a place is from where the drawn surface ends (crates/draw/src/cpu/surface/rims.rs).
#define_import_path deepfield::surface_rim
#import deepfield::surface_constants::{SQUARE, RIM_AROUND, RIM_CELLS, RIM_EDGE, RIM_CROWDED, RIM_ALL, NONE}
#import deepfield::surface_globe::{frame_at, moved, place_of_camera, sight_at}
#import deepfield::surface_ray::{Hit, chunk_at}
#import deepfield::surface_view::{surface, draws, lists, camera_of, corner_of, quad_of, sample_at}

/// What is known of rims near a place of the picture: how far the nearest is, and how long they are within a radius.
struct Rims {
    nearest: f32,
    length: f32,
}

/// Takes in a part of a rim, from the place.
fn with_part(rims: Rims, start: vec2<f32>, end: vec2<f32>, radius: f32) -> Rims {
    let along = end - start;
    let square = dot(along, along);
    let foot = select(0.0, -dot(start, along) / max(square, 1e-37), square > 0.0);
    var found = Rims(min(rims.nearest, length(start + clamp(foot, 0.0, 1.0) * along)), rims.length);
    let away = length(start + foot * along);
    if square > 0.0 && away < radius {
        let half = sqrt((radius * radius - away * away) / square);
        found.length += max(min(foot + half, 1.0) - max(foot - half, 0.0), 0.0) * sqrt(square);
    }
    return found;
}

/// The corners of a cell that one of its edges is between: of its four sides, and of the one across it.
fn ends_of(edge: u32, measured: vec4<bool>) -> vec2<u32> {
    switch edge {
        case 0u: { return vec2(0u, 1u); }
        case 1u: { return vec2(2u, 3u); }
        case 2u: { return vec2(0u, 2u); }
        case 3u: { return vec2(1u, 3u); }
        default: { return select(vec2(1u, 2u), vec2(0u, 3u), measured.x && measured.w); }
    }
}

/// Takes in the rims of a chunk's cells between rows and columns that count from a hit's.
fn with_chunk(rims: Rims, node: u32, hit: Hit, ends: vec4<f32>, place: vec2<f32>, radius: f32) -> Rims {
    var found = rims;
    let draw = draws[node];
    if draw.rims == NONE {
        return found;
    }
    let begin = vec2<f32>(vec2<i32>(sample_at(draw, vec2(0u))) - vec2<i32>(hit.first));
    let whole = f32(1u << draw.level);
    let cells = vec2(draw.rows, draw.columns) - 1u;
    let from_cell = vec2<u32>(clamp(floor((ends.xy - begin) / whole) - 1.0, vec2(0.0), vec2<f32>(cells)));
    let to_cell = vec2<u32>(clamp(ceil((ends.zw - begin) / whole) + 1.0, vec2(0.0), vec2<f32>(cells)));
    let squares = (cells.y + SQUARE - 1u) / SQUARE;
    for (var down = from_cell.x / SQUARE; down * SQUARE < to_cell.x; down++) {
        for (var right = from_cell.y / SQUARE; right * SQUARE < to_cell.y; right++) {
            let entry = lists[draw.rims + down * squares + right];
            if entry == NONE {
                continue;
            }
            let corner = SQUARE * vec2(down, right);
            let first = max(corner, from_cell) - corner;
            let last = min(corner + SQUARE, to_cell) - corner;
            for (var row = first.x; row < last.x; row++) {
                for (var column = first.y; column < last.y; column++) {
                    let index = row * SQUARE + column;
                    let bits = lists[entry + index / 4u] >> (8u * (index % 4u)) & 255u;
                    if bits == 0u {
                        continue;
                    }
                    let at = corner + vec2(row, column);
                    let quad = quad_of(draw, at);
                    for (var edge = 0u; edge < 5u; edge++) {
                        if (bits >> edge & 1u) == 0u {
                            continue;
                        }
                        let corners = ends_of(edge, quad.measured);
                        let a = camera_of(corner_of(draw, at + vec2(corners.x >> 1u, corners.x & 1u)), quad.heights[corners.x]);
                        let b = camera_of(corner_of(draw, at + vec2(corners.y >> 1u, corners.y & 1u)), quad.heights[corners.y]);
                        if surface.perspective == 0u || min(a.z, b.z) >= surface.near {
                            found = with_part(found, place_of_camera(a) - place, place_of_camera(b) - place, radius);
                        }
                    }
                }
            }
        }
    }
    return found;
}

/// How much of a hit at a place of the picture is line.
fn rim_share(hit: Hit, place: vec2<f32>) -> f32 {
    if hit.is_point {
        return 0.0;
    }
    let radius = RIM_AROUND * surface.rim_width;
    let sight = sight_at(place);
    let camera = sight.origin + hit.depth * sight.direction;
#ifdef GLOBE
    let frame = frame_at(hit);
    let steps = surface.turn * surface.radius * vec2(frame.level, 1.0);
    let lift = surface.lift * frame.axes[2];
    let by_column = moved(camera, steps.x * frame.axes[0] + hit.slope.x * lift);
    let by_row = moved(camera, steps.y * frame.axes[1] + hit.slope.y * lift);
#else
    let by_column = moved(camera, surface.per_column + hit.slope.x * surface.per_height);
    let by_row = moved(camera, surface.per_row + hit.slope.y * surface.per_height);
#endif
    // Rows and columns that may be in the radius on a surface of this slope; more only where it is seen from its edge.
    let own = draws[hit.node];
    let area = max(abs(by_column.x * by_row.y - by_column.y * by_row.x), 1e-37);
    let most = RIM_CELLS * f32(1u << own.level);
    let reach = min(radius * vec2(length(by_column), length(by_row)) / area, vec2(most));
    let ends = vec4(hit.within - reach, hit.within + reach);
    // The chunk and those beside it that reach there.
    let first = vec2<i32>(hit.first);
    let own_first = vec2<f32>(vec2<i32>(sample_at(own, vec2(0u))) - first);
    let own_last = vec2<f32>(vec2<i32>(sample_at(own, vec2(own.rows, own.columns) - 1u)) - first);
    let is_inside = all(ends.xy > own_first) && all(ends.zw < own_last);
    var nodes = array<u32, 5>(hit.node, NONE, NONE, NONE, NONE);
    var rims = Rims(1e30, 0.0);
    for (var k = 0u; k < 5u; k++) {
        if k > 0u {
            let at = vec2(select(ends.x, ends.z, (k & 1u) == 1u), select(ends.y, ends.w, k > 2u));
            // What closes a globe is in the chunk that is beside it.
            let cell = clamp(vec2<i32>(floor(at)) + first, vec2(0), vec2<i32>(vec2(surface.last.y, surface.open)) - 1);
            nodes[k] = chunk_at(cell.yx);
        }
        var is_known = nodes[k] == NONE;
        for (var other = 0u; other < k; other++) {
            is_known = is_known || nodes[other] == nodes[k];
        }
        if !is_known {
            rims = with_chunk(rims, nodes[k], hit, ends, place, radius);
        }
        if is_inside {
            break;
        }
    }
    let line = clamp((surface.rim_width - rims.nearest) / (2.0 * RIM_EDGE) + 0.5, 0.0, 1.0);
    // Where there are many they fade, as coverage shows them.
    let crowd = clamp((rims.length / radius - RIM_CROWDED) / (RIM_ALL - RIM_CROWDED), 0.0, 1.0);
    return line * (1.0 - crowd);
}
