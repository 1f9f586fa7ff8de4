// Where spheres lie in a picture: the rectangle around one, and whether it reaches into the picture.
#define_import_path deepfield::rectangle

/// Two corners, pixels; rows go down.
struct Rectangle {
    low: vec2<f32>,
    high: vec2<f32>,
}

/// Farther away than the edge of any picture, pixels.
const UNBOUNDED: f32 = 1.0e9;

/// The rectangle around a sphere in camera space (`place.w` its radius), with the pixels per world unit (at depth 1 in perspective)
/// and where the middle line of sight meets the picture. Unbounded where the sphere meets the plane of the eye.
fn rectangle_of(middle: vec2<f32>, focal: f32, perspective: bool, place: vec4<f32>) -> Rectangle {
    let radius = place.w;
    // Rows go down, y goes up.
    let across = vec2(place.x, -place.y);
    if !perspective {
        return Rectangle(middle + (across - radius) * focal, middle + (across + radius) * focal);
    }
    if !(place.z > radius) {
        return Rectangle(vec2(-UNBOUNDED), vec2(UNBOUNDED));
    }
    // The planes through the eye that touch the sphere.
    let ahead = (place.z - radius) * (place.z + radius);
    let spread = radius * sqrt(across * across + ahead);
    return Rectangle(
        middle + focal * (across * place.z - spread) / ahead,
        middle + focal * (across * place.z + spread) / ahead,
    );
}

/// Whether a sphere in camera space reaches into a picture whose sides have these slopes along x and y, rows going down (in an
/// orthographic picture these places), with some room for rounding. Before the eye or behind it is not asked.
fn reaches_between(low: vec2<f32>, high: vec2<f32>, perspective: bool, place: vec4<f32>, room: vec2<f32>) -> bool {
    let depth = select(1.0, place.z, perspective);
    let across = vec2(place.x, -place.y);
    // Lengths of the side planes' normals.
    let low_norm = select(vec2(1.0), sqrt(1.0 + low * low), perspective);
    let high_norm = select(vec2(1.0), sqrt(1.0 + high * high), perspective);
    return !(any(low * depth - across > place.w * low_norm + room) || any(across - high * depth > place.w * high_norm + room));
}
