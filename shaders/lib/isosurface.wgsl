// Where rays cross the isosurfaces of a volume, and how these are lit, as crates/draw/src/cpu/volume/surface.rs has it, whose comments say why.
//
// Whoever imports this has binding 0 of group 0 taken.
#define_import_path deepfield::isosurface
#import deepfield::volume_view::VolumeView

@group(0) @binding(0) var<uniform> volume: VolumeView;

const NO_CROSSING: f32 = 2.0;
const LANES: vec4<u32> = vec4<u32>(0u, 1u, 2u, 3u);

/// The densities of all surfaces, more than any density where there is none.
struct Levels {
    low: vec4<f32>,
    high: vec4<f32>,
}

/// Where a step crosses each of the surfaces, as a share of the step; NO_CROSSING where it does not.
struct Crossings {
    low: vec4<f32>,
    high: vec4<f32>,
}

struct Crossing {
    at: f32,
    surface: u32,
}

/// To be asked once, not for each step: a software driver fetches uniforms for each lane.
fn surface_levels() -> Levels {
    var levels = Levels(vec4(3.0e38), vec4(3.0e38));
    for (var i = 0u; i < 4u; i++) {
        if i < volume.surface_count {
            levels.low[i] = volume.surfaces[i].x;
        }
        if i + 4u < volume.surface_count {
            levels.high[i] = volume.surfaces[i + 4u].x;
        }
    }
    return levels;
}

/// Whether a step between two densities crosses a surface.
fn is_crossed(levels: Levels, before: f32, now: f32) -> bool {
    return any((vec4(before) < levels.low) != (vec4(now) < levels.low))
        || any((vec4(before) < levels.high) != (vec4(now) < levels.high));
}

/// The cubic through the middle two of four samples, with central differences as tangents.
fn cubic(samples: vec4<f32>, t: vec4<f32>) -> vec4<f32> {
    let start = 0.5 * (samples.z - samples.x);
    let end = 0.5 * (samples.w - samples.y);
    let t2 = t * t;
    let t3 = t2 * t;
    return (2.0 * t3 - 3.0 * t2 + 1.0) * samples.y + (t3 - 2.0 * t2 + t) * start
        + (3.0 * t2 - 2.0 * t3) * samples.z + (t3 - t2) * end;
}

/// Where the cubic has four values; meant for those that lie between the middle two samples.
fn refine(samples: vec4<f32>, value: vec4<f32>) -> vec4<f32> {
    var low = vec4(0.0);
    var high = vec4(1.0);
    var at_low = samples.y - value;
    var at_high = samples.z - value;
    // False position, with the bisection's guarantee: the sign changes between the ends.
    for (var turn = 0; turn < 6; turn++) {
        var middle = clamp(low + (high - low) * at_low / (at_low - at_high), low, high);
        if turn % 3 == 2 {
            middle = 0.5 * (low + high);
        }
        let at_middle = cubic(samples, middle) - value;
        let same = (at_middle < vec4(0.0)) == (at_low < vec4(0.0));
        low = select(low, middle, same);
        at_low = select(at_low, at_middle, same);
        high = select(middle, high, same);
        at_high = select(at_middle, at_high, same);
    }
    let found = low + (high - low) * at_low / (at_low - at_high);
    // Where the ends are equal the quotient is nothing.
    return clamp(select(0.5 * (low + high), found, at_low != at_high), vec4(0.0), vec4(1.0));
}

/// Where the step from the second to the third of four successive samples crosses surfaces.
fn crossings_of(samples: vec4<f32>, levels: Levels) -> Crossings {
    let low_crossed = (vec4(samples.y) < levels.low) != (vec4(samples.z) < levels.low);
    let high_crossed = (vec4(samples.y) < levels.high) != (vec4(samples.z) < levels.high);
    return Crossings(
        select(vec4(NO_CROSSING), refine(samples, levels.low), low_crossed),
        select(vec4(NO_CROSSING), refine(samples, levels.high), high_crossed),
    );
}

/// Takes the nearest that is left, of equal ones the first; NO_CROSSING where none is.
fn take_nearest(left: ptr<function, Crossings>) -> Crossing {
    var nearest = Crossing(NO_CROSSING, 0u);
    for (var i = 0u; i < 4u; i++) {
        if (*left).low[i] < nearest.at {
            nearest = Crossing((*left).low[i], i);
        }
    }
    for (var i = 0u; i < 4u; i++) {
        if (*left).high[i] < nearest.at {
            nearest = Crossing((*left).high[i], i + 4u);
        }
    }
    (*left).low = select((*left).low, vec4(NO_CROSSING), LANES == vec4(nearest.surface));
    (*left).high = select((*left).high, vec4(NO_CROSSING), LANES + 4u == vec4(nearest.surface));
    return nearest;
}

/// The cosine between a slope and a ray, whose direction has a length of 1, on either side of the surface; 1 where there is no slope.
fn cosine_between(slope: vec3<f32>, direction: vec3<f32>) -> f32 {
    let length_squared = dot(slope, slope);
    if length_squared > 0.0 {
        return min(abs(dot(slope, direction)) * inverseSqrt(length_squared), 1.0);
    }
    return 1.0;
}

/// A surface's colour where a ray meets it, whose direction has a length of 1.
fn shaded(color: vec3<f32>, slope: vec3<f32>, direction: vec3<f32>) -> vec3<f32> {
    return lit_by(color, cosine_between(slope, direction));
}

/// A colour as it is seen where a ray meets the surface at this cosine.
fn lit_by(color: vec3<f32>, cosine: f32) -> vec3<f32> {
    let highlight = volume.specular * pow(cosine, volume.shininess);
    return color * (volume.ambient + (1.0 - volume.ambient) * cosine) + highlight;
}
