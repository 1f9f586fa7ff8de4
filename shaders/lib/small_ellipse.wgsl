// The integrals over pixels of ellipses that are too thin to be sampled, whatever their length and tilt.
//
// Along the axis in which it is longer an ellipse is cut into strips of a part of a pixel, of which each is a product of functions along and
// across it, and lies where the ellipse is at its height. So all pixels add up to the weight, and the second moments are the ellipse's.
#define_import_path deepfield::small_ellipse
#import deepfield::kernel::{first, second, mass, mean, spread}
#import deepfield::splat_view::Splat

/// Strips of a pixel at most.
const MOST_STRIPS: f32 = 8.0;
/// Strips of a pixel that one leans by, where it is thin.
const LEANING: f32 = 8.0;

/// What lies below a height.
struct Below {
    /// The functions whose differences are integrals along the height.
    u: vec4<f32>,
    v: vec4<f32>,
    /// The kernel's mass, and its first and second moment.
    m: vec4<f32>,
    m_y: vec4<f32>,
    m_yy: vec4<f32>,
}

/// The integrals over four pixels: where their centres are in the direction in which the ellipse is cut, and in the other.
fn integrated_ellipse(splat: Splat, along: vec4<f32>, across: vec4<f32>) -> vec4<f32> {
    let cut_along_y = splat.tail.w > 0.0;
    let middle = select(splat.head.xy, splat.head.yx, cut_along_y);
    let half = 1.0 / splat.head.zw;
    let shear = splat.tail.x;
    // What is wide hides how its strips lean.
    let count = clamp(ceil(LEANING * abs(shear) * inverseSqrt(1.0 + 0.8 * half.x * half.x)), 1.0, MOST_STRIPS);
    let step = splat.head.w / count;
    let lean = shear * half.y;
    // The kernel's variance.
    let whole = 2.0 * spread(vec4(1.0)).x;
    var value = vec4(0.0);
    var low = (along - middle.x - 0.5) * splat.head.w;
    var above = Below(first(low), second(low), mass(low), mean(low), spread(low));
    for (var k = 0.0; k < count; k += 1.0) {
        let high = low + step;
        let below = Below(first(high), second(high), mass(high), mean(high), spread(high));
        let begin = clamp(low, vec4(-1.0), vec4(1.0));
        let finish = clamp(high, vec4(-1.0), vec4(1.0));
        // Where a strip's matter lies, and how far it spreads, in height.
        let per_mass = 1.0 / max(below.m - above.m, vec4(1.0e-9));
        let at = clamp((below.m_y - above.m_y) * per_mass, begin, finish);
        let height = finish - begin;
        let variance = clamp((below.m_yy - above.m_yy) * per_mass - at * at, vec4(0.0), 0.25 * height * height);
        // A strip leans within itself.
        let scale = inverseSqrt(half.x * half.x + variance * (lean * lean / whole));
        let left = (across - middle.y - 0.5 - lean * at) * scale;
        let right = left + scale;
        value += (below.u - above.u) * (first(right) - first(left));
        value -= (below.v - above.v) * (second(right) - second(left));
        low = high;
        above = below;
    }
    return value;
}
