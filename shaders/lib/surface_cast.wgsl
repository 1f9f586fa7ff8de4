// How lines of sight meet triangles of a surface, flat or on a globe: by the sides that edges have them on, reckoned in the camera's coordinates.
#define_import_path deepfield::surface_cast
#import deepfield::surface_constants::NONE
#import deepfield::surface_view::{surface, camera_of}

/// More than what rounding adds to a place along a ray, of how far away it is.
const ROUNDING: f32 = 2e-6;

/// What a ray meets: its depth, and the number of the triangle; `NONE` where that is nothing.
struct Met {
    depth: f32,
    number: u32,
}

fn nothing_met() -> Met {
    return Met(3e38, NONE);
}

/// Where a place is beside a ray, in lengths across it at the place's depth, and that depth. `across` is where the ray passes by.
fn aside(place: vec3<f32>, across: vec2<f32>) -> vec3<f32> {
    let scale = select(1.0, place.z, surface.perspective != 0u);
    return vec3(fma(-across, vec2(scale), place.xy), place.z);
}

/// The same of a corner at a height.
fn beside(corner: vec2<u32>, height: f32, across: vec2<f32>) -> vec3<f32> {
    return aside(camera_of(corner, height), across);
}

/// On which side of an edge the ray is. Both triangles of an edge have to ask for its ends in the same order; nothing is left to a compiler to fuse
/// for one of these and not for the other.
fn side_of(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return fma(a.x, b.y, -(a.y * b.x));
}

/// The depth of a triangle where a ray has its edges on such sides, each by the corner opposite; negative where it passes by.
fn depth_between(sides: vec3<f32>, depths: vec3<f32>) -> f32 {
    let area = sides.x + sides.y + sides.z;
    if area == 0.0 || any(select(-sides, sides, area > 0.0) < vec3(0.0)) {
        return -1.0;
    }
    let depth = dot(sides, depths) / area;
    return clamp(depth, min(min(depths.x, depths.y), depths.z), max(max(depths.x, depths.y), depths.z));
}
