// What the passes share that draw layers. The Rust twin of `LayerView` is in src/gpu/layered.rs; a test in src/gpu/shaders/
// compares the layouts.
#define_import_path deepfield::layer_view

struct LayerView {
    /// Rays that are as opaque end.
    termination: f32,
    /// Densities up to this show nothing.
    least: f32,
    /// Variance of the kernel along an axis, for h = 1.
    moment: f32,
    unused: f32,
}

/// A splat of one layer.
struct Part {
    /// `Splat.head`.
    head: vec4<f32>,
    /// The beginning of `Splat.tail`.
    tail: vec3<f32>,
    /// Its layer, kind, and INSIDE where the eye is inside the kernel.
    tag: u32,
}

const KIND_BITS: u32 = 4u;
const INSIDE: u32 = 8u;
