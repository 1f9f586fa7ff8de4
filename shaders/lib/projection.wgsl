// From a particle in camera space to its splat: where it lies in the picture, its shape there, and the pyramid level that
// it is drawn in (F12 4.9.1).
#define_import_path deepfield::projection
#import deepfield::constants::TILE
#import deepfield::particle::{view, Particle}
#import deepfield::splat_view::{Splat, SAMPLED, SMALL, EVERYWHERE, INVISIBLE, DROPPED, ELLIPSE, SMALL_ELLIPSE}
#ifdef ELLIPSOIDS
#import deepfield::ellipsoid::{Ellipse, parallel_image, far_image}
#endif

/// What the projection needs of the view; to be read once, not for each particle.
struct Camera {
    size: vec2<f32>,
    middle: vec2<f32>,
    focal: f32,
    near: f32,
    perspective: bool,
    fixed_radius: f32,
    moment: f32,
    level_count: u32,
    /// Bins around each level's cells.
    margin: u32,
    faintest: f32,
    peak: f32,
    /// Radius in cells from which on splats are sampled.
    sampled_radius: f32,
}

fn camera() -> Camera {
    return Camera(
        vec2<f32>(view.size),
        view.middle,
        view.focal,
        view.near,
        view.perspective != 0u,
        view.fixed_radius,
        view.moment,
        view.level_count,
        view.levels[0].margin,
        view.faintest,
        view.peak,
        view.levels[0].sampled_radius,
    );
}

struct Projected {
    splat: Splat,
    /// The pyramid level that it is drawn in.
    level: u32,
    /// SAMPLED, SMALL, EVERYWHERE, ELLIPSE, SMALL_ELLIPSE, INVISIBLE or DROPPED.
    kind: u32,
}

/// Pixels per world unit at a depth.
fn magnification_at(camera: Camera, depth: f32) -> f32 {
    return camera.focal / select(1.0, max(depth, camera.near), camera.perspective);
}

/// The smoothing length, or the length that has the wanted radius in pixels on the axis.
fn length_of(camera: Camera, particle: Particle, magnification: f32) -> f32 {
    return select(particle.smoothing_length, camera.fixed_radius / magnification, camera.fixed_radius > 0.0);
}

/// The most that any pixel has of a particle of weight 1 and smoothing length `h` (F12 4.7.3): its peak, or where it is smaller than
/// a pixel, all of it.
fn concentration(camera: Camera, h: f32, magnification: f32) -> f32 {
    let inverse = 1.0 / h;
    let minor = h * magnification;
    return select(min(camera.peak * inverse * inverse, magnification * magnification),
        min(camera.peak / (minor * minor), 1.0), camera.fixed_radius > 0.0);
}

#ifdef ELLIPSOIDS
/// Ellipsoids that reach further than this share of their distance in depth are drawn as balls of equal spread: second order is too little.
const DEEPEST: f32 = 0.5;
/// Squared half width of the thinnest row, square pixels.
const THINNEST: f32 = 1.0e-6;

/// What an ellipsoid looks like.
fn image(camera: Camera, particle: Particle) -> Ellipse {
    let squares = particle.squares / camera.moment;
    let products = particle.products / camera.moment;
    if camera.perspective {
        return far_image(camera.focal, camera.moment, particle.position, squares, products);
    }
    return parallel_image(camera.focal, squares, products);
}

/// The splat of an ellipse, and where it is drawn.
fn project_ellipse(camera: Camera, particle: Particle, ellipse: Ellipse) -> Projected {
    let p = particle.position;
    let center = camera.middle + vec2(p.x, -p.y) * magnification_at(camera, p.z) + ellipse.center;
    let xx = ellipse.spread.x;
    let xy = ellipse.spread.y;
    let yy = ellipse.spread.z;
    let difference = 0.5 * (xx - yy);
    let long = sqrt(0.5 * (xx + yy) + sqrt(difference * difference + xy * xy));
    let determinant = max(xx * yy - xy * xy, THINNEST * max(xx, yy));
    let area = sqrt(determinant);
    let short = area / long;
    let weight = particle.weight * ellipse.flux * vec2(1.0, particle.quantity);
    var result: Projected;
    if short < camera.sampled_radius {
        let cut_along_y = yy >= xx;
        let height = select(xx, yy, cut_along_y);
        let half = sqrt(vec2(determinant / height, height));
        result.splat = Splat(vec4(center, 1.0 / half), vec4(xy / height, weight, select(-1.0, 1.0, cut_along_y) * (long + 0.5)));
        result.level = 0u;
        result.kind = SMALL_ELLIPSE;
    } else {
        result.splat = Splat(vec4(center, vec2(yy, -xy) / determinant), vec4(xx / determinant, weight / area, long));
        result.level = min(u32(log2(short / camera.sampled_radius)), camera.level_count - 1u);
        result.kind = ELLIPSE;
    }
    let outside = any(abs(center - 0.5 * camera.size) > 0.5 * camera.size + sqrt(vec2(xx, yy)) + 0.5);
    if p.z <= camera.near || outside || !(long > 0.0) {
        result.kind = INVISIBLE;
    } else if camera.faintest > 0.0 && weight.x / area * min(area, camera.peak) < camera.faintest {
        result.kind = DROPPED;
    }
    if particle.weight == 0.0 {
        result.kind = DROPPED;
    }
    return result;
}
#endif

/// A particle's splat, and where it is drawn.
fn project(camera: Camera, particle: Particle) -> Projected {
#ifdef ELLIPSOIDS
    if dot(particle.squares, vec3(1.0)) > 0.0 && camera.fixed_radius == 0.0 {
        let ellipse = image(camera, particle);
        if ellipse.depth < DEEPEST {
            return project_ellipse(camera, particle, ellipse);
        }
    }
#endif
    let p = particle.position;
    let perspective = camera.perspective;
    let half_size = 0.5 * camera.size;
    let in_front = p.z > camera.near;
    let magnification = magnification_at(camera, p.z);
    let center = camera.middle + vec2(p.x, -p.y) * magnification;

    let h = length_of(camera, particle, magnification);
    let minor = h * magnification;

    // The cone of rays that touch the particle: theta off the axis, alpha its half opening (F12 figure 4.7).
    let distance_squared = dot(p, p);
    let distance = sqrt(distance_squared);
    let sin_alpha = min(h / distance, 1.0);
    let cos_alpha = sqrt(max(1.0 - sin_alpha * sin_alpha, 0.0));
    let cos_theta = p.z / distance;
    let sin_theta = sqrt(max(1.0 - cos_theta * cos_theta, 0.0));
    let cos_edge = cos_theta * cos_alpha - sin_theta * sin_alpha;
    // The far side of the cone meets the picture at tan(theta + alpha), or never.
    let far_side = camera.focal * sin_alpha / (cos_theta * max(cos_edge, 1.0e-3));
    let is_point = camera.fixed_radius > 0.0;
    let reach = select(minor, far_side, perspective && !is_point);

    // Outside one of the four sides of the frustum by more than h?
    let rest = camera.size - camera.middle;
    let slope_low = vec2(camera.middle.x, rest.y) / camera.focal;
    let slope_high = vec2(rest.x, camera.middle.y) / camera.focal;
    let side_low = (-p.xy - slope_low * p.z) * inverseSqrt(1.0 + slope_low * slope_low);
    let side_high = (p.xy - slope_high * p.z) * inverseSqrt(1.0 + slope_high * slope_high);
    let outside_cone = any(max(side_low, side_high) > vec2(h));
    let outside_box = any(abs(center - half_size) > half_size + minor);
    let visible = in_front && h > 0.0 && minor > 0.0 && !select(outside_box, outside_cone, perspective && !is_point);

    // F = w / h^2 Phi(q^2); for discs of fixed size w per pixel.
    let inverse = 1.0 / h;
    let amplitude = particle.weight * select(inverse * inverse, 1.0 / (minor * minor), is_point);
    let weight = vec2(amplitude, amplitude * particle.quantity);
    // q^2 = |p x d|^2 / (h^2 |ray|^2) for the step d from the centre's ray to the pixel's.
    let e = inverse * inverse / (camera.focal * camera.focal);
    let tilted = e * vec3(p.z * p.z + p.y * p.y, p.x * p.y, p.z * p.z + p.x * p.x);
    let straight = vec3(1.0 / (minor * minor), 0.0, 1.0 / (minor * minor));
    let form = select(straight, tilted, perspective && !is_point);

    let ratio = minor / camera.sampled_radius;
    var result: Projected;
    let signed_reach = select(reach, -reach, perspective && !is_point && distance <= h);
    result.splat = Splat(vec4(center, form.xy), vec4(form.z, weight, signed_reach));
    // Small splats: integrals over pixels need the ellipse at the centre itself.
    if ratio < 1.0 {
        let local = form * select(1.0, p.z * p.z / distance_squared, perspective && !is_point);
        let determinant = local.x * local.z - local.y * local.y;
        let spread = vec3(local.z, -local.y, local.x) / determinant;
        let radius = sqrt(spread.xz);
        let whole = weight * inverseSqrt(determinant);
        // The middle line is not the sphere's mean: outwards a pixel sees less of an angle. First order of that.
        let tangent = (center - camera.middle) / camera.focal;
        let mean = vec2(dot(spread.xy, tangent), dot(spread.yz, tangent))
            * (4.0 * camera.moment / (camera.focal * (1.0 + dot(tangent, tangent))));
        result.splat.head = vec4(select(center, center + mean, perspective && !is_point), 1.0 / radius);
        result.splat.tail = vec4(spread.y / (radius.x * radius.y), whole, max(radius.x, radius.y) + 0.5);
        result.level = 0u;
        result.kind = SMALL;
    } else {
        let level = min(u32(log2(ratio)), camera.level_count);
        result.level = min(level, camera.level_count - 1u);
        // A splat that reaches further than its level's margin of bins, or belongs to a level above the last, is
        // evaluated in the last level, by every tile of it.
        let everywhere = level >= camera.level_count || cos_edge < 0.02 && perspective && !is_point
            || reach > f32(TILE * camera.margin) * exp2(f32(result.level));
        result.kind = select(SAMPLED, EVERYWHERE, everywhere);
        result.level = select(result.level, camera.level_count - 1u, everywhere);
    }
    // Presence acceleration (F12 4.9.2): the most that it adds to a pixel.
    if !visible {
        result.kind = INVISIBLE;
    } else if camera.faintest > 0.0 && particle.weight * concentration(camera, h, magnification) < camera.faintest {
        result.kind = DROPPED;
    }
    if particle.weight == 0.0 {
        result.kind = DROPPED;
    }
    return result;
}
