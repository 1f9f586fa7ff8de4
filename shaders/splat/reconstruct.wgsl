// Adds a pyramid level to the next finer one, interpolated at its cell centres by a separable filter of eight taps for
// each of its two phases.
//
// One invocation for each 4 x 16 cells of each layer's finer level: it walks down over sixteen rows of the coarser one,
// interpolates each along x once, and keeps the last nine. Loads are what this costs, 2.5 for each finer cell.
#import deepfield::constants as constants
#import deepfield::splat_view::{SplatView, Pass}

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<uniform> batch: Pass;
@group(0) @binding(2) var<storage, read_write> cells: array<vec2<f32>>;

/// P and P S of four cells of a row.
struct Four {
    p: vec4<f32>,
    ps: vec4<f32>,
}

/// What a coarser cell gives to four finer ones.
fn add_cell(row: ptr<function, Four>, weights: vec4<f32>, line: i32, x: i32, last: i32) {
    let value = cells[line + clamp(x, 0, last)];
    (*row).p = fma(weights, vec4(value.x), (*row).p);
    (*row).ps = fma(weights, vec4(value.y), (*row).ps);
}

/// Four finer cells' values along x, from the ten coarser cells of a row from `x` on.
fn row_at(line: i32, x: i32, last: i32) -> Four {
    var row = Four(vec4(0.0), vec4(0.0));
    add_cell(&row, constants::WINDOW_0, line, x, last);
    add_cell(&row, constants::WINDOW_1, line, x + 1, last);
    add_cell(&row, constants::WINDOW_2, line, x + 2, last);
    add_cell(&row, constants::WINDOW_3, line, x + 3, last);
    add_cell(&row, constants::WINDOW_4, line, x + 4, last);
    add_cell(&row, constants::WINDOW_5, line, x + 5, last);
    add_cell(&row, constants::WINDOW_6, line, x + 6, last);
    add_cell(&row, constants::WINDOW_7, line, x + 7, last);
    add_cell(&row, constants::WINDOW_8, line, x + 8, last);
    add_cell(&row, constants::WINDOW_9, line, x + 9, last);
    return row;
}

/// A row of the finer level from eight rows of the coarser one, in the order of the taps.
fn combine(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>, e: vec4<f32>, f: vec4<f32>, g: vec4<f32>, h: vec4<f32>)
    -> vec4<f32> {
    let low = constants::TAPS_LOW;
    let high = constants::TAPS_HIGH;
    return fma(a, vec4(low.x), fma(b, vec4(low.y), fma(c, vec4(low.z), fma(d, vec4(low.w),
        fma(e, vec4(high.x), fma(f, vec4(high.y), fma(g, vec4(high.z), h * high.w)))))));
}

/// Adds four cells to a row of the finer level.
fn add_row(at: u32, room: u32, p: vec4<f32>, ps: vec4<f32>) {
    cells[at] += vec2(p.x, ps.x);
    if room > 1u {
        cells[at + 1u] += vec2(p.y, ps.y);
    }
    if room > 2u {
        cells[at + 2u] += vec2(p.z, ps.z);
    }
    if room > 3u {
        cells[at + 3u] += vec2(p.w, ps.w);
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let coarse = view.levels[batch.level];
    let fine = view.levels[batch.level - 1u];
    let corner = id.xy * vec2(4u, 16u);
    if corner.x >= fine.width || corner.y >= fine.height {
        return;
    }
    let layer = id.z * view.cell_count;
    // The window's first cell: fine.pad is even, coarse.pad large enough.
    let start = (vec2<i32>(corner) - i32(fine.pad)) / 2 + i32(coarse.pad) - 4;
    let last = vec2(i32(coarse.width), i32(coarse.height)) - 1;
    let first_cell = i32(layer + coarse.first_cell);
    let stride = i32(coarse.width);
    let room = fine.width - corner.x;
    let fine_first = layer + fine.first_cell + corner.x;

    let zero = Four(vec4(0.0), vec4(0.0));
    var a = zero;
    var b = zero;
    var c = zero;
    var d = zero;
    var e = zero;
    var f = zero;
    var g = zero;
    var h = zero;
    for (var row = 0; row < 16; row++) {
        let line = first_cell + clamp(start.y + row, 0, last.y) * stride;
        let i = row_at(line, start.x, last.x);
        if row >= 8 {
            // The coarser row four above the newest lies between these two.
            let y = corner.y + 2u * u32(row - 8);
            let at = fine_first + y * fine.width;
            if y < fine.height {
                add_row(
                    at,
                    room,
                    combine(a.p, b.p, c.p, d.p, e.p, f.p, g.p, h.p),
                    combine(a.ps, b.ps, c.ps, d.ps, e.ps, f.ps, g.ps, h.ps),
                );
            }
            if y + 1u < fine.height {
                add_row(
                    at + fine.width,
                    room,
                    combine(i.p, h.p, g.p, f.p, e.p, d.p, c.p, b.p),
                    combine(i.ps, h.ps, g.ps, f.ps, e.ps, d.ps, c.ps, b.ps),
                );
            }
        }
        a = b;
        b = c;
        c = d;
        d = e;
        e = f;
        f = g;
        g = h;
        h = i;
    }
}
