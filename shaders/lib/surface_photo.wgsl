// A photo over measured heights: its mean light over what a sample of the picture shows (crates/draw/src/cpu/surface/photo.rs).
//
// Pixels count from one near the anchor. Tiles of levels that are not there are left to coarser ones.
#define_import_path deepfield::surface_photo
#import deepfield::surface_constants::{NONE, NO_PHOTO, PHOTO_TILE, MOST_TEXELS, MOST_LONGER}
#import deepfield::surface_levels::{level_at, slope_of}
#import deepfield::surface_ray::{Hit, ray_at}
#import deepfield::surface_view::{surface, lists}

/// Texels of tiles: red, green, blue, and the share that lies on the surface, a byte each.
@group(1) @binding(3) var<storage, read> texels: array<u32>;

/// The rows and columns that the sides of a sample of the picture reach over.
struct Sides {
    right: vec2<f32>,
    down: vec2<f32>,
}

/// Where a sample beside a place meets the plane of a hit, in rows and columns from it, at most so far, and whether it does.
fn side_to(hit: Hit, slope: vec2<f32>, place: vec2<f32>, least: vec2<f32>) -> vec3<f32> {
    let ray = ray_at(place);
    let at = vec2<f32>(vec2<i32>(hit.first.yx) - surface.anchor) + hit.within.yx;
    let plane = hit.height + dot(slope, ray.origin.xy - at);
    let depth = (plane - ray.origin.z) / (ray.direction.z - dot(slope, ray.direction.xy));
    if !(depth > 0.0 && depth < 1e30) {
        return vec3(0.0);
    }
    let side = 2.0 * (ray.origin.xy + depth * ray.direction.xy - at).yx;
    return vec3(side / max(length(side / least) / MOST_LONGER, 1.0), 1.0);
}

fn sides_of(hit: Hit, normal: vec3<f32>, place: vec2<f32>) -> Sides {
    // A sample as it is seen from above.
    let least = exp2(level_at(hit.depth)) * surface.spacing / surface.step.yx;
    let level = Sides(vec2(0.0, least.y), vec2(least.x, 0.0));
#ifdef GLOBE
    return level;
#else
    let slope = slope_of(normal);
    let right = side_to(hit, slope, place + vec2(0.5, 0.0), least);
    let down = side_to(hit, slope, place + vec2(0.0, 0.5), least);
    if right.z * down.z == 0.0 {
        return level;
    }
    return Sides(right.xy, down.xy);
#endif
}

/// Where the photo ends along rows (0) and columns.
fn photo_ends(axis: u32) -> vec2<f32> {
    let first = -surface.photo_anchor[axis];
    return vec2(f32(first), f32(first + i32(surface.photo_size[axis])));
}

/// The light of the photo on what a sample of the picture shows of a hit.
fn photo_of(hit: Hit, normal: vec3<f32>, place: vec2<f32>) -> vec3<f32> {
    if surface.photo_levels == 0u {
        return NO_PHOTO;
    }
    var sides = sides_of(hit, normal, place);
    sides.right *= surface.photo_per;
    sides.down *= surface.photo_per;
    let wide = abs(sides.right) + abs(sides.down);
    let away = vec2<f32>(vec2<i32>(hit.first) - surface.anchor.yx) + hit.within;
    var at = surface.photo_at + away * surface.photo_per;
    var field = array<vec2<f32>, 2>(surface.photo_rows, surface.photo_columns);
    if surface.photo_period > 0.0 {
        // The copy whose middle is nearest.
        let ends = photo_ends(1u);
        let ahead = round((at.y - 0.5 * (ends.x + ends.y)) / surface.photo_period) * surface.photo_period;
        at.y -= ahead;
        field[1] -= ahead;
    }
    var share = 1.0;
    for (var axis = 0u; axis < 2u; axis++) {
        if axis == 1u && surface.photo_is_endless != 0u {
            continue;
        }
        // What of it lies in the field is in the photo or beside it.
        let ends = photo_ends(axis);
        let low = max(at[axis] - 0.5 * wide[axis], field[axis].x);
        let high = min(at[axis] + 0.5 * wide[axis], field[axis].y);
        if low < high {
            share *= max((min(high, ends.y) - max(low, ends.x)) / (high - low), 0.0);
        } else {
            share *= select(0.0, 1.0, at[axis] >= ends.x && at[axis] <= ends.y);
        }
    }
    // What is no number is nowhere.
    if !(share > 0.0) {
        return NO_PHOTO;
    }
    let own = mean_of(at, sides, wide);
    return select(NO_PHOTO, mix(NO_PHOTO, own.rgb, share), own.a > 0.0);
}

/// The mean light over a parallelogram about a place, and whether it is known.
fn mean_of(at: vec2<f32>, sides: Sides, wide: vec2<f32>) -> vec4<f32> {
    if all(wide <= vec2(1.0)) {
        return mean_of_box(at, wide);
    }
    var mean = vec4(0.0);
    for (var k = 0u; k < 4u; k++) {
        let quarter = vec2(f32(k & 1u), f32(k >> 1u)) * 0.5 - 0.25;
        let own = mean_of_box(at + quarter.x * sides.right + quarter.y * sides.down, 0.5 * wide);
        if own.a == 0.0 {
            return own;
        }
        mean += 0.25 * own;
    }
    return mean;
}

/// How many texels of a level a box has a part of.
fn count_of(wide: vec2<f32>, level: u32) -> f32 {
    let count = max(wide / exp2(f32(level)), vec2(1.0)) + 1.0;
    return count.x * count.y;
}

fn mean_of_box(at: vec2<f32>, wide: vec2<f32>) -> vec4<f32> {
    let most = surface.photo_levels - 1u;
    var level = min(u32(0.5 * log2(max(wide.x * wide.y / MOST_TEXELS, 1.0))), most);
    while level < most && count_of(wide, level) > MOST_TEXELS {
        level++;
    }
    for (; level <= most; level++) {
        let mean = of_level(at, wide, level);
        if mean.a > 0.0 {
            return mean;
        }
    }
    return vec4(0.0);
}

/// The mean over a level's texels, of which only those count that lie on the surface; all where none does.
fn of_level(at: vec2<f32>, wide: vec2<f32>, level: u32) -> vec4<f32> {
    let texel = exp2(f32(level));
    let first_edge = vec2(photo_ends(0u).x, photo_ends(1u).x);
    let last_edge = vec2(photo_ends(0u).y, photo_ends(1u).y);
    let half = 0.5 * max(wide, vec2(texel));
    let middle = clamp(at, first_edge, last_edge);
    // The box in texels from one near the anchor, as far as it is in the photo, and the texels that it meets.
    let origin = surface.photo_anchor >> vec2(level);
    let behind = vec2<f32>(surface.photo_anchor - (origin << vec2(level)));
    let low = (max(middle - half, first_edge) + behind) / texel;
    let high = (min(middle + half, last_edge) + behind) / texel;
    let size = vec2<i32>((surface.photo_size + ((1u << level) - 1u)) >> vec2(level));
    let first = clamp(vec2<i32>(floor(low)) + origin, vec2(0), size - 1);
    let end = clamp(vec2<i32>(ceil(high)) + origin, first + 1, size);
    let entry = surface.photo_table + 2u * level;
    let tiles = lists[entry];
    let in_row = lists[entry + 1u];
    var on = vec4(0.0);
    var whole = vec4(0.0);
    for (var row = first.x; row < end.x; row++) {
        let from_row = f32(row - origin.x);
        let tall = max(min(from_row + 1.0, high.x) - max(from_row, low.x), 0.0);
        for (var column = first.y; column < end.y; column++) {
            let from_column = f32(column - origin.y);
            let own = tall * max(min(from_column + 1.0, high.y) - max(from_column, low.y), 0.0);
            let tile = vec2(u32(row), u32(column)) / PHOTO_TILE;
            let start = lists[tiles + tile.x * in_row + tile.y];
            if start == NONE {
                return vec4(0.0);
            }
            let within = vec2(u32(row), u32(column)) - PHOTO_TILE * tile;
            let columns = min(u32(size.y) - PHOTO_TILE * tile.y, PHOTO_TILE);
            let packed = texels[start + within.x * columns + within.y];
            let light = vec4(light_of(packed), light_of(packed >> 8u), light_of(packed >> 16u), 1.0);
            on += own * f32(packed >> 24u) / 255.0 * light;
            whole += own * light;
        }
    }
    if on.a > 0.0 {
        return vec4(on.rgb / on.a, 1.0);
    }
    return select(vec4(0.0), vec4(whole.rgb / whole.a, 1.0), whole.a > 0.0);
}

/// The light of a value of eight bits.
fn light_of(value: u32) -> f32 {
    return bitcast<f32>(lists[surface.photo_light + (value & 255u)]);
}
