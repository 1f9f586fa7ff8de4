// What the passes share that draw layers. The Rust twin of `LayerView` is in src/gpu/layered/mod.rs; a test in src/gpu/shaders/
// compares the layouts.
#define_import_path deepfield::layer_view

struct LayerView {
    /// Rays that are as opaque end.
    termination: f32,
    /// Densities up to this show nothing.
    least: f32,
    unused_a: f32,
    unused_b: f32,
}
