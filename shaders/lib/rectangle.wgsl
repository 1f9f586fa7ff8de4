// The rectangle around a sphere's picture.
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
