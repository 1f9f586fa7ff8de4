// What coarse samples stand for beside their triangles, and how deep that is (crates/draw/src/cpu/surface/coverage.rs).
#define_import_path deepfield::surface_margin
#import deepfield::surface_constants::{CHUNK, FARTHER, MIXED, NONE}
#import deepfield::surface_levels::{Met, level_at, normal_of, slope_of}
#import deepfield::surface_ray::{Hit, chunk_at, coverage_of, no_hit, share_between}
#import deepfield::surface_view::{surface, draws, Draw, camera_of, cell_of_level, corner_of, height_of, sample_at}
#ifdef GLOBE
#import deepfield::surface_globe::{met_by, sight_at}
#else
#import deepfield::surface_ray::ray_at
#endif

#ifndef GLOBE
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
