// Adds a pyramid level to the next finer one, interpolated at its cell centres by a separable filter of
// RECONSTRUCTION_TAPS taps for each of the two phases.
//
// One invocation for each 4 x 4 cells of the finer level; it reads WINDOW x WINDOW cells of the coarser one.
#import deepfield::splat_view::SplatView

struct Pass {
    add: u32,
    /// The coarser level.
    level: u32,
    unused_a: u32,
    unused_b: u32,
}

struct Weights {
    /// What each of the window's cells (rows or columns alike) gives to each of the four finer ones.
    window: array<vec4<f32>, #{WINDOW}>,
}

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<uniform> batch: Pass;
@group(0) @binding(2) var<uniform> weights: Weights;
@group(0) @binding(3) var<storage, read_write> cells: array<vec2<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let coarse = view.levels[batch.level];
    let fine = view.levels[batch.level - 1u];
    let corner = 4u * id.xy;
    if corner.x >= fine.width || corner.y >= fine.height {
        return;
    }
    // The window's first cell: fine.pad is even, coarse.pad large enough.
    let start = (vec2<i32>(corner) - i32(fine.pad)) / 2 + i32(coarse.pad) - #{WINDOW} / 2 + 1;
    let limit = vec2(i32(coarse.width), i32(coarse.height)) - 1;

    // Columns of the 4 x 4 finer cells.
    var p: mat4x4<f32>;
    var ps: mat4x4<f32>;
    for (var row = 0; row < #{WINDOW}; row++) {
        let y = clamp(start.y + row, 0, limit.y);
        let line = coarse.first_cell + u32(y) * coarse.width;
        var p_row = vec4(0.0);
        var ps_row = vec4(0.0);
        for (var column = 0; column < #{WINDOW}; column++) {
            let value = cells[line + u32(clamp(start.x + column, 0, limit.x))];
            p_row = fma(weights.window[column], vec4(value.x), p_row);
            ps_row = fma(weights.window[column], vec4(value.y), ps_row);
        }
        let weight = weights.window[row];
        for (var i = 0; i < 4; i++) {
            p[i] = fma(weight, vec4(p_row[i]), p[i]);
            ps[i] = fma(weight, vec4(ps_row[i]), ps[i]);
        }
    }

    let first = fine.first_cell + corner.y * fine.width + corner.x;
    for (var i = 0u; i < 4u; i++) {
        for (var j = 0u; j < 4u; j++) {
            if corner.x + i < fine.width && corner.y + j < fine.height {
                let at = first + j * fine.width + i;
                cells[at] += vec2(p[i][j], ps[i][j]);
            }
        }
    }
}
