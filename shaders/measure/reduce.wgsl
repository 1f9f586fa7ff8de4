// A picture's cells in fewer pixels, for its ranges and histograms: each the mean of the cells that it stands for or, where splats have a
// fixed size in pixels and would cover another share of a smaller picture, the one in their middle.

struct Reduction {
    /// Width and height, pixels: of the picture, and of what is made of it.
    size: vec2<u32>,
    reduced: vec2<u32>,
    /// Cells from a row of the picture to the next.
    stride: u32,
    /// Pixels along each side that one pixel stands for.
    side: u32,
    /// 1: one of them is taken as it is.
    one: u32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> reduction: Reduction;
/// `P` and `P S`.
@group(0) @binding(1) var<storage, read> cells: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> reduced_cells: array<vec2<f32>>;

@compute @workgroup_size(8, 8)
fn reduce(@builtin(global_invocation_id) at: vec3<u32>) {
    if any(at.xy >= reduction.reduced) {
        return;
    }
    let first = at.xy * reduction.side;
    let behind = min(first + reduction.side, reduction.size);
    var sum = vec2(0.0);
    if reduction.one != 0u {
        let middle = (first + behind) / 2u;
        sum = cells[min(middle.y, behind.y - 1u) * reduction.stride + min(middle.x, behind.x - 1u)];
    } else {
        for (var y = first.y; y < behind.y; y++) {
            for (var x = first.x; x < behind.x; x++) {
                sum += cells[y * reduction.stride + x];
            }
        }
        sum /= f32((behind.x - first.x) * (behind.y - first.y));
    }
    reduced_cells[at.y * reduction.reduced.x + at.x] = sum;
}
