// The projected smoothing kernel as polynomials. Coefficients come from src/gpu/splat/profile.rs.
#define_import_path deepfield::kernel

/// Ten coefficients.
struct Profile {
    a: vec4<f32>,
    b: vec4<f32>,
    c: vec2<f32>,
}

/// The coefficients of the kernel's mean over a box: F + (trace of the quadratic form) side^2 / 24 * (laplacian / 2).
fn box_profile(f: array<vec4<f32>, 3>, l: array<vec4<f32>, 3>, correction: f32) -> Profile {
    return Profile(f[0] + correction * l[0], f[1] + correction * l[1], f[2].xy + correction * l[2].xy);
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

/// The odd polynomial with coefficients p at x, constant beyond |x| = 1.
fn cumulative(p: array<vec4<f32>, 2>, x: f32) -> f32 {
    let t = clamp(x, -1.0, 1.0);
    let y = t * t;
    var v = fma(p[1].w, y, p[1].z);
    v = fma(v, y, p[1].y);
    v = fma(v, y, p[1].x);
    v = fma(v, y, p[0].w);
    v = fma(v, y, p[0].z);
    v = fma(v, y, p[0].y);
    v = fma(v, y, p[0].x);
    return v * t;
}

/// The derivative of `cumulative`.
fn density(p: array<vec4<f32>, 2>, x: f32) -> f32 {
    let t = clamp(x, -1.0, 1.0);
    let y = t * t;
    var v = fma(15.0 * p[1].w, y, 13.0 * p[1].z);
    v = fma(v, y, 11.0 * p[1].y);
    v = fma(v, y, 9.0 * p[1].x);
    v = fma(v, y, 7.0 * p[0].w);
    v = fma(v, y, 5.0 * p[0].z);
    v = fma(v, y, 3.0 * p[0].y);
    v = fma(v, y, p[0].x);
    return v;
}
