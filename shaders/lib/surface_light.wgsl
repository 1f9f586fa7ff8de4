// What a place of measured heights looks like: its attribute's colour, the light on it, lines of equal height (crates/draw/src/cpu/surface/shade.rs).
#define_import_path deepfield::surface_light
#import deepfield::srgb::decoded
#import deepfield::surface_constants::{FINER, SECANTS, MINOR, EDGE, REACH, BY_HEIGHT, BY_SLOPE, BY_ASPECT, BY_CURVATURE, BY_LEVEL, BY_PRIMITIVE, BY_RESIDUAL, BY_DIFFERENCE, BY_PLANE, BY_TEXTURE, BY_PHOTO, BESIDE, UNMEASURED, NONE, POINTS}
#import deepfield::surface_globe::{frame_at, rise_of, sight_at}
#import deepfield::surface_levels::{between, index_of, share_of, levels_of, level_at, normal_of}
#import deepfield::surface_look::{look, number_at}
#import deepfield::surface_ray::{Hit, ray_at, walk, WIDE, ENDLESS}
#import deepfield::surface_view::{surface, words, draws, fade_at}
#ifdef PHOTO
#import deepfield::surface_photo::photo_of
#endif
#ifdef RIMS
#import deepfield::surface_constants::RIM
#import deepfield::surface_rim::rim_share
#endif
#ifdef FILLED
#import deepfield::surface_constants::HATCH
#endif

/// Colours over the range of values.
@group(1) @binding(1) var<storage, read> ramp: array<vec4<f32>>;

/// What a place looks like.
struct Texel {
    normal: vec3<f32>,
    height: f32,
    planes: vec3<f32>,
    curvature: f32,
    /// The height of a form, or what was added to an earlier field.
    value: f32,
    /// The share of it that is known.
    known: f32,
    exists: bool,
}

/// Whether samples have a number each, beside their heights.
fn has_values() -> bool {
    return surface.colored_by == BY_DIFFERENCE || surface.colored_by == BY_RESIDUAL && surface.has_form != 0u;
}

fn texel_at(hit: Hit, level: u32) -> Texel {
    let four = between(draws[hit.node], level, hit.first, hit.within);
    var texel = Texel(vec3(0.0), 0.0, vec3(0.0), 0.0, 0.0, 0.0, false);
    if !four.exists {
        return texel;
    }
    var sum = 0.0;
    var leans: array<vec2<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        let index = index_of(four, k);
        let normal = normal_of(four.start, four.count, index);
        leans[k] = normal.xy / max(normal.z, 1e-6);
        let weight = four.weights[k] * share_of(four, index);
        if weight <= 0.0 {
            continue;
        }
        sum += weight;
        texel.normal += weight * normal;
        texel.height += weight * bitcast<f32>(words[four.start + index]);
        if surface.colored_by == BY_PLANE || surface.colored_by == BY_TEXTURE {
            texel.planes += weight * decoded(unpack4x8unorm(words[four.start + 3u * four.count + index]).xyz);
        } else if has_values() {
            let value = bitcast<f32>(words[four.start + 3u * four.count + index]);
            if value < UNMEASURED {
                texel.value += weight * value;
                texel.known += weight;
            }
        }
    }
    if sum <= 0.0 {
        return texel;
    }
    texel.normal /= sum;
    texel.planes /= sum;
    texel.value /= max(texel.known, 1e-37);
    texel.known /= sum;
    texel.height = select(texel.height / sum, hit.height, level == 0u);
    let across = 0.5 * (leans[1].x + leans[3].x - leans[0].x - leans[2].x) / (surface.lengths.x * four.apart.y);
    let along = 0.5 * (leans[2].y + leans[3].y - leans[0].y - leans[1].y) / (surface.lengths.y * four.apart.x);
    texel.curvature = 0.5 * (across + along);
    texel.exists = true;
    return texel;
}

/// What a hit looks like at the distance of its samples.
fn texel_of(hit: Hit) -> Texel {
    let draw = draws[hit.node];
    let wanted = level_at(hit.depth) - FINER;
    let levels = levels_of(draw, wanted);
    var texel = texel_at(hit, u32(levels.x));
    if !texel.exists {
        texel = Texel(vec3(0.0, 0.0, 1.0), hit.height, vec3(0.0), 0.0, 0.0, 0.0, true);
    }
    if levels.y > 0.0 {
        let coarse = texel_at(hit, u32(levels.x) + 1u);
        if coarse.exists {
            texel.normal = mix(texel.normal, coarse.normal, levels.y);
            texel.height = mix(texel.height, coarse.height, levels.y);
            texel.planes = mix(texel.planes, coarse.planes, levels.y);
            texel.curvature = mix(texel.curvature, coarse.curvature, levels.y);
            // What is known of finer samples alone is theirs.
            if coarse.known >= 0.5 {
                texel.value = mix(texel.value, coarse.value, levels.y);
            }
        }
    }
    let level = levels.x + levels.y;
    if wanted < level {
        // A sample stands for more than is seen here.
        texel.height = hit.height + exp2(wanted - level) * (texel.height - hit.height);
    }
    return texel;
}

/// The colour of a value. Heights count from the reference.
fn colored(value: f32) -> vec3<f32> {
    var place = (value - surface.low) * surface.per;
    if surface.is_log != 0u {
        let all = select(value, value + surface.reference, surface.colored_by == BY_HEIGHT);
        place = select(0.0, (log(max(all, 1e-37)) - surface.low) * surface.per, all > 0.0);
    }
    let at = clamp(place, 0.0, 1.0) * f32(surface.ramp_last);
    let index = min(u32(at), max(surface.ramp_last, 1u) - 1u);
    let next = min(index + 1u, surface.ramp_last);
    return mix(ramp[index].rgb, ramp[next].rgb, at - f32(index));
}

/// The complementary error function (Abramowitz and Stegun 7.1.26).
fn erfc(x: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.3275911 * abs(x));
    let tail = ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t * exp(-x * x);
    return select(tail, 2.0 - tail, x < 0.0);
}

/// The mean of a normal distribution's positive part, and the share of it that is positive.
fn positive(mean: f32, deviation: f32) -> vec2<f32> {
    if deviation <= 1e-5 * abs(mean) {
        return vec2(max(mean, 0.0), select(0.0, 1.0, mean > 0.0));
    }
    let place = mean / deviation;
    let share = 0.5 * erfc(-place * 0.70710678);
    return vec2(mean * share + deviation * exp(-0.5 * place * place) * 0.39894228, share);
}

/// The mean light on what is seen of facets of a mean normal (crates/draw/src/cpu/surface/lambert.rs).
fn lit(normal: vec3<f32>, towards: vec3<f32>, eye: vec3<f32>) -> f32 {
    let steeper = surface.steeper;
    var up = max(normal.z, 1e-6);
    let slope = normal.xy / up;
    var variance = max(0.5 * (1.0 / (up * up) - dot(slope, slope) - 1.0), 0.0);
    // Of facets that are alike rounding leaves this.
    variance = select(variance, 0.0, variance * up * up < 1e-4) * steeper * steeper;
    let steep = vec3(slope * steeper, 1.0);
    if steeper != 1.0 {
        up = inverseSqrt(dot(steep, steep) + 2.0 * variance);
    }
    let turned = select(1.0, -1.0, dot(steep, eye) < 0.0);
    let shown = positive(turned * dot(steep, eye), sqrt(variance * dot(eye.xy, eye.xy)));
    if shown.x <= 0.0 {
        return 0.0;
    }
    let mean = turned * dot(steep, towards);
    var bright = vec2(mean, 1.0);
    if surface.is_sun != 0u {
        bright = positive(mean, sqrt(variance * dot(towards.xy, towards.xy)));
    }
    let across = variance * dot(towards.xy, eye.xy);
    return clamp(up * (bright.x + across * shown.y * bright.y / shown.x), 0.0, 1.0);
}

/// How much of a sample is line: see `Contours::share`.
fn line_share(number: f32, away: f32, change: f32) -> f32 {
    if change <= 0.0 {
        return 0.0;
    }
    var strength = 1.0;
    var all_lines = 1.0;
    let major = f32(surface.contour_major);
    if surface.contour_major > 1u {
        all_lines = MINOR + (1.0 - MINOR) / major;
        strength = select(MINOR, 1.0, abs(number - major * round(number / major)) < 0.5);
    }
    let apart = surface.contour_interval / change;
    let size = 1.0 / f32(surface.parts);
    let line = strength * clamp((0.5 * surface.contour_width - away) / (2.0 * EDGE * size) + 0.5, 0.0, 1.0);
    let mean = all_lines * min(surface.contour_width / apart, 0.5);
    let single = clamp(apart / surface.contour_width - 1.0, 0.0, 1.0);
    return mix(mean, line, single);
}

/// The height of a hit's plane where another place's ray meets it, and whether that is in front of the eye.
fn plane_height(hit: Hit, place: vec2<f32>) -> vec2<f32> {
    let ray = ray_at(place);
    let at = vec2<f32>(vec2<i32>(hit.first.yx) - surface.anchor) + hit.within.yx;
    let plane = hit.height + dot(hit.slope, ray.origin.xy - at);
    let depth = (plane - ray.origin.z) / (ray.direction.z - dot(hit.slope, ray.direction.xy));
    let is_ahead = depth > 0.0 && depth < 1e30;
    return vec2(ray.origin.z + depth * ray.direction.z, select(0.0, 1.0, is_ahead));
}

/// The height at a place of the picture, what a sample to the right and one down add to it, and whether these are known.
struct Relief {
    height: f32,
    rise: vec2<f32>,
    exists: bool,
}

fn relief_at(hit: Hit, place: vec2<f32>) -> Relief {
#ifdef GLOBE
    let rise = rise_of(hit, place);
    return Relief(hit.height - dot(rise.xy, hit.aside), rise.xy, rise.z != 0.0);
#else
    let right = plane_height(hit, place + vec2(0.25, 0.0));
    let below = plane_height(hit, place + vec2(0.0, 0.25));
    return Relief(hit.height, vec2(right.x - hit.height, below.x - hit.height) / 0.25, right.y * below.y != 0.0);
#endif
}

/// The height that is seen at another place of the picture near a hit, and whether there is one.
fn height_near(hit: Hit, place: vec2<f32>) -> vec2<f32> {
#ifdef GLOBE
    let sample = vec2<i32>(floor(place));
    if any(sample < vec2(0)) || any(sample >= vec2<i32>(surface.size)) {
        return vec2(0.0);
    }
    let number = number_at(vec2<u32>(sample));
    if number == NONE {
        return vec2(0.0);
    }
    let relief = relief_at(look(number, place), place);
    return vec2(relief.height, select(0.0, 1.0, relief.exists));
#else
    let there = walk(hit.node, ray_at(place), hit.depth, WIDE, ENDLESS);
    return vec2(there.height, select(0.0, 1.0, there.exists));
#endif
}

/// How much of a place is a line of equal height.
fn line_at(hit: Hit, place: vec2<f32>) -> f32 {
    let relief = relief_at(hit, place);
    let number = round((relief.height - surface.contour_base) / surface.contour_interval);
    let nearest = surface.contour_base + number * surface.contour_interval;
    if !relief.exists {
        return line_share(number, 0.0, 1e30);
    }
    let rise = relief.rise;
    let steep = length(rise);
    var away = abs(nearest - relief.height) / max(steep, 1e-37);
    let parts = f32(surface.parts);
    let width = surface.contour_width * parts;
    let share = away / width;
    // Where the line is told to be the surface may have another slope: by secants to where it is.
    if surface.contour_interval > width * steep && share >= 0.02 && share < REACH {
        let along = rise / max(steep, 1e-37) * sign(nearest - relief.height);
        var last = vec2(0.0, relief.height);
        var is_found = false;
        for (var k = 0u; k < SECANTS; k++) {
            let there = height_near(hit, place + along * away);
            if there.y == 0.0 {
                break;
            }
            let next = away + (nearest - there.x) * (away - last.x) / (there.x - last.y);
            if !(next > 0.0 && next < 1e30) {
                break;
            }
            last = vec2(away, there.x);
            away = clamp(next, 0.25 * away, 4.0 * away);
            if abs(next - last.x) < 0.02 {
                is_found = true;
                break;
            }
        }
        // The surface ends before.
        if !is_found {
            away = 1e30;
        }
    }
    return line_share(number, away / parts, steep * parts);
}

#ifdef FILLED
/// The light of a membrane at a place of the picture: stripes, which no data has.
fn hatch(place: vec2<f32>) -> f32 {
    let size = HATCH * f32(surface.parts);
    let away = 2.0 * abs(fract((place.x + place.y) / (size * sqrt(2.0))) - 0.5);
    return 0.5 - 0.38 * clamp((away - 0.5) * 0.5 * size + 0.5, 0.0, 1.0);
}
#endif

/// The colour of a hit at a place of the picture: linear light, premultiplied.
fn color_of(hit: Hit, place: vec2<f32>) -> vec4<f32> {
    let draw = draws[hit.node];
    let texel = texel_of(hit);
    var normal = texel.normal;
#ifdef FILLED
    if hit.is_membrane {
        // Its triangle's own.
        normal = normalize(vec3(-hit.slope * surface.true_lift / surface.lengths, 1.0));
    }
#endif
    var value = texel.height;
    // Whether there is nothing to compare it with.
    var is_beside = false;
    switch surface.colored_by {
        case BY_SLOPE: { value = degrees(atan2(length(normal.xy), normal.z)); }
        case BY_ASPECT: {
            // Of no direction WGSL says nothing.
            value = select(degrees(atan2(normal.x, normal.y)), 0.0, all(normal.xy == vec2(0.0)));
            value += select(0.0, 360.0, value < 0.0);
        }
        case BY_CURVATURE: { value = texel.curvature; }
        case BY_LEVEL: { value = f32(draw.level); }
        case BY_PRIMITIVE: { value = select(1.0, 0.0, (draw.flags & POINTS) != 0u); }
        case BY_RESIDUAL: {
            value = texel.height + surface.reference;
            if surface.has_form != 0u {
                value = texel.height - texel.value;
                is_beside = texel.known < 0.999;
            }
        }
        case BY_DIFFERENCE: {
            value = texel.value;
            is_beside = texel.known < 0.5;
        }
        case BY_PLANE: { value = texel.planes.x; }
        default: {}
    }
    var plain = colored(value);
    if surface.colored_by == BY_TEXTURE {
        plain = texel.planes;
    }
#ifdef PHOTO
    if surface.colored_by == BY_PHOTO {
        plain = photo_of(hit, normal, place);
    }
#endif
    plain = select(plain, BESIDE, is_beside);
#ifdef FILLED
    plain = select(plain, vec3(hatch(place)), hit.is_membrane);
#endif
    var toward = -surface.world_forward;
    if surface.perspective != 0u {
        let across = vec2(place.x - surface.middle.x, surface.middle.y - place.y) / surface.focal;
        toward = -normalize(across.x * surface.world_right + across.y * surface.world_up + surface.world_forward);
    }
#ifdef GLOBE
    // As normals are: to the east, to the north and upwards.
    toward = -normalize(sight_at(place).direction) * frame_at(hit).axes;
#endif
    let bright = lit(normal, select(toward, surface.sun, surface.is_sun != 0u), toward);
    let light = surface.ambient + (1.0 - surface.ambient) * bright;
    var color = plain * light;
    if surface.contour_interval > 0.0 && !hit.is_membrane {
        color = mix(color, surface.contour_color, line_at(hit, place));
    }
#ifdef RIMS
    color = mix(color, RIM, rim_share(hit, place));
#endif
    let whole = fade_at(hit.depth);
    let alpha = hit.coverage * whole;
#ifdef FILLED
    // What a coarse sample leaves open are holes that are smaller than it.
    if hit.coverage < 1.0 && surface.spans >= f32(1u << draw.level) {
        return vec4(color * alpha + vec3(hatch(place) * light * (whole - alpha)), whole);
    }
#endif
    return vec4(color * alpha, alpha);
}
