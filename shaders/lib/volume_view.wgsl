// What the passes of a volume share: the grid, its bricks and bins, and what is shown of the field. The Rust twins are
// `VolumeUniform`, `Portion` and `Turn` in src/gpu/volume/layout.rs; a test in src/gpu/shaders/ compares the layouts.
#define_import_path deepfield::volume_view

/// Stored cells reach two cells beyond the picture on every side: stored column `c` is column `c - 2` of the grid. Bricks
/// are 8 x 8 x 8 stored cells; a layer is all bricks of 8 slices.
///
/// A tier is such a grid: tier 0 is the picture's own, cells of tier `t` are `2^t` times as wide and as deep. Particles of wide
/// kernels belong to coarser tiers, whose fields are interpolated. Coordinate `x` of a tier is `x / 2 + BORDER` in the next, so
/// `2 BORDER` is the same in all.
struct VolumeView {
    /// Bricks along x and y of the window: the part of the picture that is drawn at once.
    window: vec2<u32>,
    /// The middle line of sight, stored cells.
    middle: vec2<f32>,
    /// Factor and offset from an attribute, or its base-2 logarithm, to its place among the hues.
    attribute_map: vec2<f32>,
    /// Layers that are held.
    ring: u32,
    /// Slices of the grid.
    slices: u32,
    /// The last layer.
    last_layer: u32,
    /// Tiers in use.
    tier_count: u32,
    /// Bins of all levels.
    bin_count: u32,
    /// 1: perspective.
    perspective: u32,
    /// Surfaces in use.
    surface_count: u32,
    /// Width of a cell at depth 1 (perspective) or everywhere.
    sigma: f32,
    /// Depth of the near plane.
    near: f32,
    /// Slices for a factor of e in depth (perspective) or a unit of depth.
    slice_rate: f32,
    /// Most bricks that a slab fills.
    brick_room: u32,
    /// Densities up to this show nothing.
    least: f32,
    /// Densities up to this do not show in the volume.
    faintest: f32,
    /// Rays that are as opaque end.
    termination: f32,
    /// Leading bits of the density of the table's first entry.
    first_entry: u32,
    /// Number of intervals of the table less one.
    last_entry: u32,
    /// Index of the first hue in the table; 0: none.
    hues: u32,
    /// 1: hues follow the attribute's logarithm.
    attribute_log: u32,
    /// 1: surfaces are lit.
    lit: u32,
    ambient: f32,
    specular: f32,
    shininess: f32,
    /// Index of the first entry of the plane of hues and places in the table; 0: none.
    plane: u32,
    /// Least smoothing length, cells.
    smallest: f32,
    /// The kernel's leading factor, for a smoothing length of 1.
    kernel_factor: f32,
    /// One of so many particles is drawn, with the mass and the volume of all.
    stride: u32,
    /// Factor on the smoothing lengths of those.
    growth: f32,
    /// How cells of fields of columns are read: EVEN_TABLE, HOLES_OF_VOLUME, HOLES_OF_SURFACES and DIMMED together.
    columns_read: u32,
    /// Width and height of the picture, cells; the last ones may lie in it in part.
    cells: vec2<f32>,
    /// The tiers, finest first.
    tiers: array<Tier, 7>,
    /// For each level of bins of each tier: its first bin, and its bins along x, y and z. A bin of a tier's level `l` is `2^l`
    /// bricks wide.
    levels: array<vec4<u32>, 80>,
    /// For each surface its density, its opacity, and 1 where its colour is set.
    surfaces: array<vec4<f32>, 8>,
    /// Their colours, linear light.
    colors: array<vec4<f32>, 8>,
}

/// A grid of cells.
struct Tier {
    /// Bricks along x and y of the window.
    window: vec2<u32>,
    /// Layers that are held.
    ring: u32,
    /// Where its bricks begin among those that are held, and its slices among those of all tiers.
    first_brick: u32,
    first_slice: u32,
    /// Its levels of bins: first, and their number.
    first_level: u32,
    level_count: u32,
    unused: u32,
}

/// What a slab fills of a tier.
struct TierPortion {
    /// The window's first brick: column, and row from bit 16 on.
    origin: u32,
    /// First layer, and their number from bit 24 on.
    layers: u32,
    /// Depths of the centres of their first and last slice.
    nearest: f32,
    farthest: f32,
}

/// One slab of one window, and one batch of particles.
struct Portion {
    /// The window's first brick.
    origin: vec2<u32>,
    /// The pixels that the window draws: first, and behind the last.
    first_pixel: vec2<u32>,
    behind_pixel: vec2<u32>,
    /// Where the windows' rows begin in the lists of pixels' and bricks' places.
    rows: u32,
    brick_rows: u32,
    /// First layer of the slab, and their number.
    first_layer: u32,
    layers: u32,
    /// First step, and behind the last.
    first_step: u32,
    behind_step: u32,
    /// Particles of the batch.
    candidates: u32,
    /// 1: the first batch of the slab.
    opening: u32,
    /// Bricks of all tiers that are filled.
    bricks: u32,
    unused: u32,
    /// What is filled of each tier: of the finest the slab's own layers.
    tiers: array<TierPortion, 7>,
}

/// Which part of crowded bricks is gathered, which digit is sorted by, or which tier is interpolated to.
struct Turn {
    number: u32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

/// The number of a workgroup, of those that a dispatch spreads over two dimensions: one holds at most 65535.
fn number_of(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}
