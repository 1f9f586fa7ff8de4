// What compute passes find out about each sample of the picture: the least depth that anything has there, and the least number of what has it.
#define_import_path deepfield::surface_seen

/// What is drawn at a time.
struct SurfaceStep {
    /// Whether numbers are found, and not depths.
    is_second: u32,
    /// Where `lists` has the chunks' numbers, the triangles, or chunks with squares of the picture.
    first: u32,
    /// How many there are.
    count: u32,
    /// Which counter the list of large triangles has.
    counter: u32,
    /// How many that list has room for.
    most: u32,
    unused: u32,
    unused_end: vec2<u32>,
}

@group(1) @binding(0) var<uniform> surface_step: SurfaceStep;
@group(1) @binding(1) var<storage, read_write> nearest: array<atomic<u32>>;
@group(1) @binding(2) var<storage, read_write> shown: array<atomic<u32>>;

/// Keeps the nearer of what is there and this.
fn put(index: u32, depth: f32, number: u32) {
    // Positive floats sort as their bits do. Both are kept inverted: nothing is 0.
    let bits = ~bitcast<u32>(max(depth, 0.0));
    let known = atomicLoad(&nearest[index]);
    if surface_step.is_second == 0u {
        if bits > known {
            atomicMax(&nearest[index], bits);
        }
    } else if bits == known {
        atomicMax(&shown[index], ~number);
    }
}

/// The least depth so far; negative where there is none.
fn depth_at(index: u32) -> f32 {
    let known = atomicLoad(&nearest[index]);
    if known == 0u {
        return -1.0;
    }
    return bitcast<f32>(~known);
}

/// The number of a triangle.
fn number_of(node: u32, cell: vec2<u32>, slot: u32) -> u32 {
    return node << 18u | 2u * (cell.x * 256u + cell.y) + slot;
}
