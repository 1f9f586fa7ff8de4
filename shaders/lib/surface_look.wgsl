// Which place of measured heights a sample of the picture shows.
#define_import_path deepfield::surface_look
#import deepfield::surface_globe::hit_globe
#import deepfield::surface_levels::{level_at, normal_of, point_coverage, slope_of}
#import deepfield::surface_ray::{Hit, around, hit_triangle, ray_at, walk, WIDE, ENDLESS}
#import deepfield::surface_view::{surface, draws, corner_of, sample_at, height_of, is_lone, camera_of, shown_of, POINT}

/// What each sample shows, inverted: 0 is nothing.
@group(1) @binding(0) var<storage, read> numbers: array<u32>;

fn number_at(at: vec2<u32>) -> u32 {
    return ~numbers[at.y * surface.stride + at.x];
}

/// The place of the surface that a sample of the picture shows: of a point, where its ray meets what the point belongs to.
fn look(number: u32, place: vec2<f32>) -> Hit {
    let shown = shown_of(number);
#ifdef GLOBE
    return hit_globe(shown, place);
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
        var hit = around(node, at, ray);
        if !hit.exists {
            hit = walk(node, ray, depth, WIDE, ENDLESS);
        }
        // It may pass by what the point is of, and by all else; where that is not known the point is shown.
        if hit.exists || !hit.is_beside {
            return hit;
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
    hit.coverage = point_coverage(hit, at);
    return hit;
#endif
}
