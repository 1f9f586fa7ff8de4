// What one splat adds to one pixel, as accumulate.wgsl adds it to many.
#define_import_path deepfield::splat_pixel
#import deepfield::kernel::{box_profile, evaluate, first, second, shear, bend, stretching}
#import deepfield::splat_view::{Splat, oblique, EVERYWHERE, ELLIPSE}

/// What a picture's lines of sight are.
struct Lens {
    /// Where the middle one meets the picture, pixels.
    middle: vec2<f32>,
    /// Pixels per world unit (at depth 1 in perspective).
    focal: f32,
    /// 1: perspective.
    perspective: u32,
}

/// The mean over the cell of a splat that is sampled at its centre; see `add_sampled` in accumulate.wgsl.
fn sampled(splat: Splat, lens: Lens, pixel: vec2<f32>, kind: u32) -> f32 {
    let d = pixel - splat.head.xy;
    var square = splat.head.z * d.x * d.x + 2.0 * splat.head.w * d.x * d.y + splat.tail.x * d.y * d.y;
#ifdef OBLIQUE
    // An ellipse is what is seen from far away already.
    square *= select(oblique(lens.middle, lens.focal, lens.perspective, pixel), 1.0, kind == ELLIPSE);
    if kind == EVERYWHERE && splat.tail.w > 0.0 {
        let along = dot(splat.head.xy - lens.middle, pixel - lens.middle) / (lens.focal * lens.focal);
        square = select(1.0, square, 1.0 + along > 0.0);
    }
#endif
    // Most of a tile's splats do not reach the pixel; the profile is zero there.
    if square >= 1.0 {
        return 0.0;
    }
    let mean = evaluate(box_profile((splat.head.z + splat.tail.x) * (1.0 / 24.0)), vec4(square)).x;
    if kind == ELLIPSE {
        return mean + stretching(vec3(splat.head.zw, splat.tail.x), d.x, vec4(d.y), vec4(square)).x;
    }
    return mean;
}

/// The integral over the pixel of a small splat; see `add_small` in accumulate.wgsl.
fn integrated(splat: Splat, pixel: vec2<f32>) -> f32 {
    let low = (pixel - splat.head.xy - 0.5) * splat.head.zw;
    // Beyond its ends all integrals are the same.
    if any(low >= vec2(1.0)) || any(low + splat.head.zw <= vec2(-1.0)) {
        return 0.0;
    }
    let edges = vec4(low.x, low.x + splat.head.z, low.y, low.y + splat.head.w);
    let u = first(edges);
    let v = second(edges);
    var value = (u.y - u.x) * (u.w - u.z) - (v.y - v.x) * (v.w - v.z);
#ifdef OBLIQUE
    let tilt = splat.tail.x;
    let s = shear(edges);
    let b = bend(edges);
    value += tilt * ((s.y - s.x) * (s.w - s.z) + 0.5 * tilt * (b.y - b.x) * (b.w - b.z));
#endif
    return value;
}
