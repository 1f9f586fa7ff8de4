// What an ellipsoid looks like: along parallel lines of sight, and through a pinhole to second order in its extent over its distance, as
// crates/draw/src/cpu/ellipsoid.rs has it.
#define_import_path deepfield::ellipsoid

/// An ellipse in the picture. The ellipsoid is that in which the kernel ends.
struct Ellipse {
    /// From where the ellipsoid's centre appears, pixels.
    center: vec2<f32>,
    /// xx, xy and yy of the semi-axes' squares, square pixels.
    spread: vec3<f32>,
    /// The sum over its pixels for weight 1.
    flux: f32,
    /// Half its extent in depth over its distance, but for what of that makes no difference.
    depth: f32,
}

/// Along parallel lines of sight, `focal` pixels a world unit. `squares` (xx, yy, zz) and `products` (xy, xz, yz) are those of the
/// semi-axes, in camera space (right, up, depth).
fn parallel_image(focal: f32, squares: vec3<f32>, products: vec3<f32>) -> Ellipse {
    let area = focal * focal;
    return Ellipse(vec2(0.0), area * vec3(squares.x, -products.x, squares.y), area, 0.0);
}

/// Through a pinhole, `focal` pixels a unit of slope, for a kernel of this variance, of an ellipsoid around `c`.
fn far_image(focal: f32, variance: f32, c: vec3<f32>, squares: vec3<f32>, products: vec3<f32>) -> Ellipse {
    let scale = focal / c.z;
    let slope = c.xy / c.z;
    let deep = products.yz;
    let across = squares.xy + slope * (slope * squares.z - 2.0 * deep);
    let tilt = products.x - slope.x * deep.y - slope.y * deep.x + slope.x * slope.y * squares.z;
    // The semi-axes' matrix times the centre.
    let towards = vec3(
        dot(vec3(squares.x, products.xy), c),
        dot(vec3(products.x, squares.y, products.z), c),
        dot(vec3(products.yz, squares.z), c),
    );
    let square = dot(c, c);
    let moved = variance * scale
        * ((towards.xy - slope * towards.z) / square - 4.0 * (deep - slope * squares.z) / c.z);
    let along = dot(c, towards) / (square * square);
    let both = towards.z / (square * c.z);
    let depth = squares.z / (c.z * c.z);
    let second = 0.5 * dot(squares, vec3(1.0)) / square - 0.5 * along - 3.0 * both + 6.0 * depth;
    let flux = scale * scale * sqrt(square) / c.z * (1.0 + variance * second);
    let gradient = max(along - 8.0 * both + 16.0 * depth, 0.0);
    return Ellipse(vec2(moved.x, -moved.y), scale * scale * vec3(across.x, -tilt, across.y), flux, sqrt(gradient) / 3.0);
}
