// Where lines of sight meet measured heights on a globe, and directions there. Between corners that stand on it triangles are flat.
#define_import_path deepfield::surface_globe
#import deepfield::surface_constants::{COLUMN_WORDS, PLANE_STEPS}
#import deepfield::surface_levels::Met
#import deepfield::surface_ray::{Hit, cell_of, hit_of, place_of}
#import deepfield::surface_view::{surface, draws, lists, Draw, Shown, POLE, camera_of, corner_of, half_of, height_of, sample_at}

/// A line of sight in the camera's coordinates; its parameter is the depth.
struct Sight {
    origin: vec3<f32>,
    direction: vec3<f32>,
}

fn sight_at(place: vec2<f32>) -> Sight {
    let across = vec2(place.x - surface.middle.x, surface.middle.y - place.y) / surface.focal;
    if surface.perspective != 0u {
        return Sight(vec3(0.0), vec3(across, 1.0));
    }
    return Sight(vec3(across, 0.0), vec3(0.0, 0.0, 1.0));
}

/// What each corner of a triangle counts where a line of sight meets it: where it passes by, on the edge; in the middle of one that is seen from
/// its edge.
fn shares_of(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, sight: Sight) -> vec3<f32> {
    let size = max(distance(a, b), distance(a, c));
    let ab = (b - a) / size;
    let ac = (c - a) / size;
    let normal = cross(ab, ac);
    let depth = dot(normal, a - sight.origin) / dot(normal, sight.direction);
    let at = (sight.origin + depth * sight.direction - a) / size;
    let along = vec2(dot(cross(at, ac), normal), dot(cross(ab, at), normal)) / dot(normal, normal);
    let inside = max(vec3(1.0 - along.x - along.y, along), vec3(0.0));
    let sum = dot(inside, vec3(1.0));
    if sum > 0.0 && sum < 1e6 {
        return inside / sum;
    }
    return vec3(1.0 / 3.0);
}

/// The place of the triangle that a sample of the picture shows.
fn hit_globe(shown: Shown, place: vec2<f32>) -> Hit {
    let draw = draws[shown.node];
    let sight = sight_at(place);
    if shown.slot >= POLE {
        return hit_pole(shown, sight);
    }
    let cell = cell_of(draw, shown.at);
    let half = half_of(cell.quad, shown.slot);
    var corners: array<vec3<f32>, 3>;
    for (var k = 0u; k < 3u; k++) {
        let corner = half.corners[k];
        corners[k] = camera_of(corner_of(draw, shown.at + vec2(corner >> 1u, corner & 1u)), cell.quad.heights[corner]);
    }
    let shares = shares_of(corners[0], corners[1], corners[2], sight);
    let depth = dot(shares, vec3(corners[0].z, corners[1].z, corners[2].z));
    return hit_of(shown.node, shown.at, cell, half, place_of(half, shares), depth);
}

/// The place of a triangle between the first or last row and a pole: rows beyond the field, and heights between both.
fn hit_pole(shown: Shown, sight: Sight) -> Hit {
    let draw = draws[shown.node];
    let end = shown.slot - POLE;
    let at = shown.at;
    let next = at + vec2(0u, 1u);
    let heights = vec3(surface.pole_height[end], height_of(draw, at), height_of(draw, next));
    let rim = corner_of(draw, at);
    let pole = camera_of(vec2(surface.pole_at[end], rim.y), heights.x);
    let left = camera_of(rim, heights.y);
    let right = camera_of(rim + vec2(0u, COLUMN_WORDS), heights.z);
    let shares = shares_of(pole, left, right, sight);
    let sides = shares.y + shares.z;
    let along = select(0.5, shares.z / max(sides, 1e-30), sides > 0.0);
    let first = sample_at(draw, at);
    let columns = f32(sample_at(draw, next).y - first.y);
    let rows = surface.pole_rows[end];
    let slope = vec2((heights.z - heights.y) / columns, (heights.x - mix(heights.y, heights.z, along)) / rows);
    let depth = dot(shares, vec3(pole.z, left.z, right.z));
    let within = vec2(shares.x * rows, along * columns);
    return Hit(shown.node, depth, first, within, dot(shares, heights), slope, 1.0, vec2(0.0), true, false, false, false, true);
}

/// Where something is in the picture.
fn place_of_camera(camera: vec3<f32>) -> vec2<f32> {
    let scale = surface.focal / select(1.0, camera.z, surface.perspective != 0u);
    return surface.middle + vec2(camera.x, -camera.y) * scale;
}

/// East, north and upwards, in the camera's coordinates, and the cosine of the latitude.
struct Frame {
    axes: mat3x3<f32>,
    level: f32,
}

fn frame_at(hit: Hit) -> Frame {
    return frame_of(hit.first, hit.within);
}

/// The same so many rows and columns behind a sample of the field.
fn frame_of(first: vec2<u32>, within: vec2<f32>) -> Frame {
    let away = vec2<f32>(vec2<i32>(first.yx) - surface.anchor) + within.yx;
    let angles = away * surface.turn + vec2(0.0, surface.latitude);
    let sine = sin(angles);
    let cosine = cos(angles);
    let east = cosine.x * surface.per_row - sine.x * surface.per_column;
    let outward = cosine.x * surface.per_column + sine.x * surface.per_row;
    let north = cosine.y * surface.per_height - sine.y * outward;
    let up = cosine.y * outward + sine.y * surface.per_height;
    return Frame(mat3x3(east, north, up), cosine.y);
}

/// How exact it is where a line of sight meets what a sample stands for, in parts of the samples' distance.
const EXACT: f32 = 0.005;

/// Where a line of sight meets the plane of a sample's mean normal, which is as round as the globe (`Resolver::on_plane`). In the east, the north and
/// the height of the sample all is small near it, and so exact; latitudes are those of a ball that touches the globe there, which is as good as the
/// same between samples.
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
    for (var step = 0u; step < PLANE_STEPS; step++) {
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

/// How far something moves in the picture that moves in space, and is there already.
fn moved(camera: vec3<f32>, way: vec3<f32>) -> vec2<f32> {
    if surface.perspective != 0u {
        let across = (way.xy - camera.xy * (way.z / camera.z)) * (surface.focal / camera.z);
        return vec2(across.x, -across.y);
    }
    return vec2(way.x, -way.y) * surface.focal;
}

/// What a sample of the picture to the right and one down add to the height of a surface that a place sees, and whether it is not seen from its
/// edge.
fn rise_of(hit: Hit, place: vec2<f32>) -> vec3<f32> {
    let sight = sight_at(place + hit.aside);
    let camera = sight.origin + hit.depth * sight.direction;
    let frame = frame_at(hit);
    let steps = surface.turn * surface.radius * vec2(frame.level, 1.0);
    let lift = surface.lift * frame.axes[2];
    let a = moved(camera, steps.x * frame.axes[0] + hit.slope.x * lift);
    let b = moved(camera, steps.y * frame.axes[1] + hit.slope.y * lift);
    let area = a.x * b.y - a.y * b.x;
    if area == 0.0 {
        return vec3(0.0);
    }
    let rise = vec2(hit.slope.x * b.y - hit.slope.y * a.y, hit.slope.y * a.x - hit.slope.x * b.x) / area;
    return vec3(rise, 1.0);
}
