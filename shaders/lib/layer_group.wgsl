// Layers of depth whose pictures are summed at once: some of those of a slab, which src/gpu/tiles/spots.rs makes.
//
// Whoever imports this has bindings 2 and 3 of group 1 taken. The Rust twin of `LayerGroup` is in src/gpu/layered/sums.rs; a test in
// src/gpu/shaders/ compares the layouts.
#define_import_path deepfield::layer_group

struct LayerGroup {
    /// Which slab.
    slab: u32,
    /// Number of slabs.
    slabs: u32,
    /// The first layer, from the slab's first.
    first: u32,
    /// The most layers that there may be.
    layers: u32,
    /// Where the dispatches begin whose workgroups along z are the layers, and their number.
    dispatch: u32,
    dispatches: u32,
    unused_a: u32,
    unused_b: u32,
}

@group(1) @binding(2) var<uniform> layers: LayerGroup;
/// For each slab its first layer and the one behind its last, and how many of their particles belong to slabs before.
@group(1) @binding(3) var<storage, read> slabs: array<vec4<u32>>;

/// The slab's first layer.
fn first_of_slab() -> u32 {
    return slabs[layers.slab].x;
}

/// How many layers of the group the slab has.
fn layers_of_group() -> u32 {
    let slab = slabs[layers.slab];
    let first = slab.x + layers.first;
    return min(slab.y - min(first, slab.y), layers.layers);
}

/// Whether the slab goes on with the one layer of the slab before, which has more particles than one slab can hold.
fn goes_on() -> bool {
    return slabs[layers.slab].z > 0u;
}

/// Whether the next slab goes on with this one's layer.
fn is_open() -> bool {
    return layers.slab + 1u < layers.slabs && slabs[layers.slab + 1u].z > 0u;
}
