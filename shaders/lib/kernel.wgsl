// The projected smoothing kernel as polynomials; coefficients come from src/gpu/splat/profile.rs.
//
// They are constants of the module, not uniforms: a software driver fetches a uniform for each lane, every time.
#define_import_path deepfield::kernel
#import deepfield::constants as constants

/// Coefficients of the kernel's mean over a box.
struct Profile {
    a: vec4<f32>,
    b: vec4<f32>,
    c: vec2<f32>,
}

/// The coefficients of the kernel's mean over a box: F + (trace of the quadratic form) side^2 / 24 * (laplacian / 2).
fn box_profile(correction: f32) -> Profile {
    return Profile(
        constants::PROFILE_A + correction * constants::LAPLACIAN_A,
        constants::PROFILE_B + correction * constants::LAPLACIAN_B,
        constants::PROFILE_C + correction * constants::LAPLACIAN_C,
    );
}

/// The profile at u = (s/h)^2, for four values of u; zero from u = 1 on.
fn evaluate(p: Profile, square: vec4<f32>) -> vec4<f32> {
    let u = min(square, vec4(1.0));
    let t = 1.0 - u;
    var v = fma(u, vec4(p.c.y), vec4(p.c.x));
    v = fma(v, u, vec4(p.b.w));
    v = fma(v, u, vec4(p.b.z));
    v = fma(v, u, vec4(p.b.y));
    v = fma(v, u, vec4(p.b.x));
    v = fma(v, u, vec4(p.a.w));
    v = fma(v, u, vec4(p.a.z));
    v = fma(v, u, vec4(p.a.y));
    v = fma(v, u, vec4(p.a.x));
    return t * t * v;
}

/// F''(u), for four values of u; zero from u = 1 on.
fn curvature(square: vec4<f32>) -> vec4<f32> {
    let u = min(square, vec4(1.0));
    var v = fma(u, vec4(constants::CURVATURE_C.y), vec4(constants::CURVATURE_C.x));
    v = fma(v, u, vec4(constants::CURVATURE_B.w));
    v = fma(v, u, vec4(constants::CURVATURE_B.z));
    v = fma(v, u, vec4(constants::CURVATURE_B.y));
    v = fma(v, u, vec4(constants::CURVATURE_B.x));
    v = fma(v, u, vec4(constants::CURVATURE_A.w));
    v = fma(v, u, vec4(constants::CURVATURE_A.z));
    v = fma(v, u, vec4(constants::CURVATURE_A.y));
    v = fma(v, u, vec4(constants::CURVATURE_A.x));
    return select(v, vec4(0.0), square >= vec4(1.0));
}

/// What a pixel's mean of an ellipse of the quadratic form `form` has beside `box_profile`, where `q^2 = square` at the distances `x` and `y`
/// from its centre.
fn stretching(form: vec3<f32>, x: f32, y: vec4<f32>, square: vec4<f32>) -> vec4<f32> {
    let along = form.x * x + form.y * y;
    let across = form.y * x + form.z * y;
    let turned = fma(along, along, across * across) - 0.5 * (form.x + form.z) * square;
    return curvature(square) * turned * (1.0 / 6.0);
}

/// The polynomial with coefficients `low` and `high` of 1, y .. y^7.
fn polynomial(low: vec4<f32>, high: vec4<f32>, y: vec4<f32>) -> vec4<f32> {
    var v = fma(vec4(high.w), y, vec4(high.z));
    v = fma(v, y, vec4(high.y));
    v = fma(v, y, vec4(high.x));
    v = fma(v, y, vec4(low.w));
    v = fma(v, y, vec4(low.z));
    v = fma(v, y, vec4(low.y));
    return fma(v, y, vec4(low.x));
}

/// The odd polynomial with coefficients `low` and `high` of x, x^3 .. x^15; constant beyond |x| = 1.
fn odd(low: vec4<f32>, high: vec4<f32>, x: vec4<f32>) -> vec4<f32> {
    let t = clamp(x, vec4(-1.0), vec4(1.0));
    let v = polynomial(low, high, t * t);
    return v * t;
}

/// U_1, whose differences are the first factor's integrals.
fn first(x: vec4<f32>) -> vec4<f32> {
    return odd(constants::FIRST_A, constants::FIRST_B, x);
}

/// U_2, whose differences are the second factor's integrals.
fn second(x: vec4<f32>) -> vec4<f32> {
    return odd(constants::SECOND_A, constants::SECOND_B, x);
}

/// The kernel's mass between its middle and a height.
fn mass(x: vec4<f32>) -> vec4<f32> {
    return odd(constants::MASS_A, constants::MASS_B, x);
}

/// The first moment of what lies there.
fn mean(x: vec4<f32>) -> vec4<f32> {
    let y = min(x * x, vec4(1.0));
    return y * polynomial(constants::MEAN_A, constants::MEAN_B, y);
}

/// The second moment.
fn spread(x: vec4<f32>) -> vec4<f32> {
    let t = clamp(x, vec4(-1.0), vec4(1.0));
    return t * t * t * polynomial(constants::SQUARE_A, constants::SQUARE_B, t * t);
}

/// B, whose differences give the second order of a tilted ellipse.
fn bend(x: vec4<f32>) -> vec4<f32> {
    return odd(constants::BEND_A, constants::BEND_B, x);
}

/// V, whose differences give the first order of a tilted ellipse: an even polynomial, zero from |x| = 1 on.
fn shear(x: vec4<f32>) -> vec4<f32> {
    return polynomial(constants::SHEAR_A, constants::SHEAR_B, min(x * x, vec4(1.0)));
}
