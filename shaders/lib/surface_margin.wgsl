// What coarse samples stand for beside their triangles, and how deep that is (crates/draw/src/cpu/surface/coverage.rs).
#define_import_path deepfield::surface_margin
#import deepfield::surface_constants::{CHUNK, FARTHER, MIXED, NONE}
#import deepfield::surface_levels::{level_at, normal_of, slope_of}
#import deepfield::surface_ray::{Hit, chunk_at, coverage_of, no_hit, share_between}
#import deepfield::surface_view::{surface, draws, Draw, camera_of, cell_of_level, corner_of, height_of, sample_at}
#ifdef GLOBE
#import deepfield::surface_globe::{frame_of, sight_at}
#import deepfield::surface_view::lists
#else
#import deepfield::surface_ray::ray_at
#endif

/// Where a line of sight meets the plane of a sample's mean normal: how many rows and columns behind the sample, and the height.
struct Met {
    beside: vec2<f32>,
    height: f32,
    exists: bool,
}

#ifdef GLOBE
/// Most steps to where a line of sight meets what a sample stands for, and how exact that is, in parts of the samples' distance.
const STEPS: u32 = 8u;
const EXACT: f32 = 0.005;

/// That plane is as round as the globe (`Resolver::on_plane`). In the east, the north and the height of the sample all is small near it, and so exact;
/// latitudes are those of a ball that touches the globe there, which is as good as the same between samples.
fn met_by(draw: Draw, at: vec2<u32>, height: f32, slope: vec2<f32>, place: vec2<f32>) -> Met {
    let corner = corner_of(draw, at);
    let first = sample_at(draw, at);
    let axes = frame_of(first, vec2(0.0)).axes;
    let sight = sight_at(place);
    let start = (sight.origin - camera_of(corner, height)) * axes;
    let way = sight.direction * axes;
    let away = bitcast<f32>(lists[corner.x + 1u]);
    let level = bitcast<f32>(lists[corner.x + 2u]);
    let sine = bitcast<f32>(lists[corner.x + 4u]);
    let radius = select(surface.radius, away / level, level > 1e-6) + surface.lift * height;
    // What the plane rises by to the east and to the north.
    let rise = surface.lift / radius * slope / (surface.turn * vec2(max(level, 1e-3), 1.0));
    let small = EXACT * surface.spacing * f32(1u << draw.level) / length(way);
    // By Newton's steps from where the line is nearest to the sample.
    var along = -dot(start, way) / dot(way, way);
    for (var step = 0u; step < STEPS; step++) {
        let there = start + along * way;
        let from_middle = radius + there.z;
        let outward = from_middle * level - there.y * sine;
        let from_axis = length(vec2(outward, there.x));
        // How much farther from the axis it is as it is to the east.
        let more = select(from_axis - outward, there.x * there.x / (from_axis + outward), outward > 0.0);
        let angles = vec2(atan2(there.x, outward), atan2(there.y - more * sine, from_middle + more * level));
        let turned = angles / surface.turn;
        let far = length(vec3(there.xy, from_middle));
        let above = (dot(there.xy, there.xy) + there.z * (radius + from_middle)) / (far + radius);
        let steepness = dot(way, vec3(there.xy, from_middle) / far - vec3(rise, 0.0));
        let change = (above - surface.lift * dot(slope, turned)) / steepness;
        if abs(change) < small {
            return Met(turned.yx, height + dot(slope, turned), along > 0.0);
        }
        along -= change;
    }
    return Met(vec2(0.0), 0.0, false);
}
#else
fn met_by(draw: Draw, at: vec2<u32>, height: f32, slope: vec2<f32>, place: vec2<f32>) -> Met {
    let ray = ray_at(place);
    let own = vec2<f32>(vec2<i32>(sample_at(draw, at).yx) - surface.anchor);
    let plane = height + dot(slope, ray.origin.xy - own);
    let along = (plane - ray.origin.z) / (ray.direction.z - dot(slope, ray.direction.xy));
    let beside = (ray.origin.xy + along * ray.direction.xy - own).yx;
    return Met(beside, ray.origin.z + along * ray.direction.z, along > 0.0);
}
#endif

/// What a place of the picture shows of the margins about a sample (`Resolver::margin`).
fn margin_at(node: u32, at: vec2<u32>, place: vec2<f32>) -> Hit {
    let draw = draws[node];
    if draw.level == 0u || (draw.flags & MIXED) == 0u {
        return no_hit(false);
    }
    let first = sample_at(draw, at);
    let height = height_of(draw, at);
    let slope = slope_of(normal_of(draw.start, draw.rows * draw.columns, at.x * draw.columns + at.y));
    let met = met_by(draw, at, height, slope, place);
    let depth = camera_of(corner_of(draw, at), height).z;
    // What stands for a place is not farther away; on a plane that is seen from its edge all is.
    let pixel = exp2(level_at(depth)) * surface.spacing / surface.step.yx;
    let most = max(2.0 * pixel, vec2(1.5 * f32(1u << draw.level)));
    if !met.exists || !all(abs(met.beside) <= most) {
        return no_hit(false);
    }
    let cell = vec2<i32>(first) + vec2<i32>(floor(met.beside));
    if any(cell < vec2(0)) || any(cell.yx >= vec2<i32>(surface.last)) {
        return no_hit(false);
    }
    var coverage = 0.0;
    let chunk = chunk_at(cell.yx);
    if chunk == NONE {
        // Beside the chunk nothing was measured, but for what its last samples stand for.
        let sample = (vec2<u32>(cell) + (1u << draw.level) / 2u) >> vec2(draw.level);
        let begin = vec2(draw.key_row, draw.key_column) * CHUNK;
        if all(sample >= begin) && all(sample < begin + vec2(draw.rows, draw.columns)) {
            coverage = coverage_of(draw, sample - begin);
        }
    } else if draws[chunk].level > 0u {
        let other = draws[chunk];
        let begin = vec2(other.key_row, other.key_column) * CHUNK;
        let index = min(cell_of_level(vec2<u32>(cell), other.level) - begin, vec2(other.rows, other.columns) - 2u);
        let corner = sample_at(other, index);
        let size = vec2<f32>(sample_at(other, index + 1u) - corner);
        let within = vec2<f32>(vec2<i32>(first) - vec2<i32>(corner)) + met.beside;
        coverage = share_between(other, index, (within / size).yx, size);
    }
    if coverage <= 0.0 {
        return no_hit(false);
    }
    return Hit(node, depth, first, met.beside, met.height, slope, coverage, vec2(0.0), true, false, true, false, false);
}

/// How deep the margin about a sample, which is there in the camera's coordinates, is at a place of the picture: behind all else.
fn margin_depth(camera: vec3<f32>, place: vec2<f32>) -> f32 {
#ifdef GLOBE
    // Through holes the far side is seen, which is behind the margins of the near side (`Limb`).
    let sight = sight_at(place);
    let turn = dot(surface.limb, sight.direction);
    let passed = (surface.limb_away - dot(surface.limb, sight.origin)) / turn;
    if turn > 0.0 && passed > 0.0 && dot(surface.limb, camera) < surface.limb_away {
        return passed;
    }
#endif
    return max(camera.z, 1e-6) * FARTHER;
}
