// Values between the samples of a field's level, as crates/draw/src/cpu/field/mod.rs has them: samples lie in a texture bit for bit, since
// shaders need not know of numbers that are none.
#define_import_path deepfield::field_samples

/// A value between samples; not known in holes.
struct Sample {
    value: f32,
    known: bool,
}

/// Where a value is read: the samples before and behind it, and the shares of the way between them.
struct Place {
    first: vec3<u32>,
    next: vec3<u32>,
    share: vec3<f32>,
}

/// The place at a level's own index; beyond the outermost samples these are read.
fn place_of(index: vec3<f32>, shape: vec3<u32>) -> Place {
    let last = shape - 1u;
    let at = clamp(index, vec3(0.0), vec3<f32>(last));
    let first = vec3<u32>(at);
    return Place(first, min(first + 1u, last), at - vec3<f32>(first));
}

const LANES: vec4<u32> = vec4<u32>(0u, 1u, 2u, 3u);

/// The bits of the four samples of a plane around a place.
fn plane_of(texels: texture_3d<u32>, place: Place, z: u32) -> vec4<u32> {
    return vec4(
        textureLoad(texels, vec3(place.first.xy, z), 0).x,
        textureLoad(texels, vec3(place.next.x, place.first.y, z), 0).x,
        textureLoad(texels, vec3(place.first.x, place.next.y, z), 0).x,
        textureLoad(texels, vec3(place.next.xy, z), 0).x,
    );
}

fn is_hole(bits: vec4<u32>) -> vec4<bool> {
    return (bits & vec4(0x7fffffffu)) > vec4(0x7f800000u);
}

/// Trilinear; beside holes of what neighbours there are, where the nearest one is there.
fn sample(texels: texture_3d<u32>, place: Place) -> Sample {
    let near = plane_of(texels, place, place.first.z);
    let far = plane_of(texels, place, place.next.z);
    let u = place.share.x;
    let v = place.share.y;
    let w = place.share.z;
    let near_holes = is_hole(near);
    let far_holes = is_hole(far);
    // Of holes another number is read.
    let a = bitcast<vec4<f32>>(select(near, vec4(0u), near_holes));
    let b = bitcast<vec4<f32>>(select(far, vec4(0u), far_holes));
    if !any(near_holes) && !any(far_holes) {
        let rows = vec4(a.xz, b.xz) + u * (vec4(a.yw, b.yw) - vec4(a.xz, b.xz));
        let planes = rows.xz + v * (rows.yw - rows.xz);
        return Sample(planes.x + w * (planes.y - planes.x), true);
    }
    let nearest = LANES == vec4(select(0u, 1u, u > 0.5) + select(0u, 2u, v > 0.5));
    if any(select(vec4(false), select(near_holes, far_holes, vec4(w > 0.5)), nearest)) {
        return Sample(0.0, false);
    }
    let shares = vec4(1.0 - u, u, 1.0 - u, u) * vec4(1.0 - v, 1.0 - v, v, v);
    let near_weights = select((1.0 - w) * shares, vec4(0.0), near_holes);
    let far_weights = select(w * shares, vec4(0.0), far_holes);
    let weights = dot(near_weights, vec4(1.0)) + dot(far_weights, vec4(1.0));
    return Sample((dot(near_weights, a) + dot(far_weights, b)) / weights, true);
}
