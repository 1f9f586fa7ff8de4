// Which place of measured heights a sample of the picture shows.
#define_import_path deepfield::surface_look
#import deepfield::surface_constants::{LAID, POINTS}
#import deepfield::surface_levels::{level_at, normal_of, point_coverage, slope_of}
#import deepfield::surface_margin::margin_at
#import deepfield::surface_ray::{Hit, around, hit_triangle, ray_at, walk, WIDE, ENDLESS}
#import deepfield::surface_view::{surface, draws, Draw, corner_of, sample_at, height_of, is_lone, camera_of, shown_of, POINT}
#ifdef GLOBE
#import deepfield::surface_globe::hit_globe
#import deepfield::surface_point::hit_point
#endif

/// What each sample shows, inverted: 0 is nothing.
@group(1) @binding(0) var<storage, read> numbers: array<u32>;

fn number_at(at: vec2<u32>) -> u32 {
    return ~numbers[at.y * surface.stride + at.x];
}

/// Whether a sample is drawn as a point of its chunk (`Mesh::is_point`).
fn is_point(draw: Draw, at: vec2<u32>) -> bool {
    let on = u32(at.x == 0u) | u32(at.x + 1u == draw.rows) << 1u | u32(at.y == 0u) << 2u | u32(at.y + 1u == draw.columns) << 3u;
    return (draw.flags & POINTS) != 0u && (on & (draw.flags >> LAID)) == 0u;
}

/// The place of the surface that a sample of the picture shows: of a point, where its ray meets what the point belongs to.
fn look(number: u32, place: vec2<f32>) -> Hit {
    let shown = shown_of(number);
#ifdef GLOBE
    if shown.slot != POINT {
        return hit_globe(shown, place);
    }
    // Where nothing else is.
    if !is_lone(draws[shown.node], shown.at) && !is_point(draws[shown.node], shown.at) {
        return margin_at(shown.node, shown.at, place);
    }
    return hit_point(shown, place);
#else
    let node = shown.node;
    let at = shown.at;
    let ray = ray_at(place);
    if shown.slot != POINT {
        return hit_triangle(node, at, shown.slot, ray);
    }
    let draw = draws[node];
    let first = sample_at(draw, at);
    let height = height_of(draw, at);
    let depth = camera_of(corner_of(draw, at), height).z;
    if !is_lone(draw, at) {
        // Where nothing else is.
        if !is_point(draw, at) {
            return margin_at(node, at, place);
        }
        var hit = around(node, at, ray);
        if !hit.exists {
            hit = walk(node, ray, depth, WIDE, ENDLESS);
        }
        // It may pass by what the point is of, and by all else; where that is not known the point is shown.
        if hit.exists {
            return hit;
        }
        if !hit.is_beside {
            return margin_at(node, at, place);
        }
    }
    var hit = Hit(node, depth, first, vec2(0.0), height, vec2(0.0), 1.0, vec2(0.0), true, false, true, false, false);
    hit.slope = slope_of(normal_of(draw.start, draw.rows * draw.columns, at.x * draw.columns + at.y));
    // What lies under the middle of the sample of the picture, unless that plane is seen from its edge.
    let place_of_sample = vec2<f32>(vec2<i32>(first.yx) - surface.anchor);
    let plane = height + dot(hit.slope, ray.origin.xy - place_of_sample);
    let along = (plane - ray.origin.z) / (ray.direction.z - dot(hit.slope, ray.direction.xy));
    let beside = (ray.origin.xy + along * ray.direction.xy - place_of_sample).yx;
    if all(abs(beside) <= vec2(2.0 * exp2(max(level_at(depth), 0.0)))) {
        hit.within = beside;
        hit.height = ray.origin.z + along * ray.direction.z;
    }
    hit.coverage = point_coverage(hit, at, -1.0);
    return hit;
#endif
}
