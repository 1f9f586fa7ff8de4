// Gamma-encoded sRGB and linear light, as the processor's `to_encoded` and `to_linear`.
#define_import_path deepfield::srgb

/// Gamma-encoded sRGB from linear light.
fn encoded(light: vec3<f32>) -> vec3<f32> {
    let low = light * 12.92;
    let high = 1.055 * pow(max(light, vec3(0.0)), vec3(1.0 / 2.4)) - 0.055;
    return select(high, low, light <= vec3(0.0031308));
}

/// Linear light of an encoded colour.
fn decoded(color: vec3<f32>) -> vec3<f32> {
    return select(pow((color + 0.055) / 1.055, vec3(2.4)), color / 12.92, color <= vec3(0.04045));
}
