// What the passes share that draw particles as spheres. The Rust twin is `SphereUniform` in src/gpu/spheres.rs; a test in
// src/gpu/shaders/ compares the layouts.
#define_import_path deepfield::sphere_view

struct SphereView {
    /// Depth of the near plane.
    near: f32,
    /// Radius of the filter, in radii of the sphere that a pixel shows.
    smoothing: f32,
    /// 1: the surface is lit.
    lit: u32,
    ambient: f32,
    specular: f32,
    shininess: f32,
    /// 1: colours follow the attribute; 0: the density.
    of_attribute: u32,
    /// 1: they follow the logarithm.
    log_scale: u32,
    /// Factor and offset from what they follow, or its base-2 logarithm, to its place among them.
    color_map: vec2<f32>,
    /// Number of colours less one.
    last_color: f32,
    unused: f32,
}

/// What a pixel shows.
struct Hit {
    /// Depth of the surface; FAR where there is none.
    depth: f32,
    /// Radius of the sphere, world units.
    radius: f32,
    density: f32,
    quantity: f32,
}

/// Behind everything.
const FAR: f32 = 3.0e38;
