// The bins that splats are sorted by: tiles of cells of their level, and some around the picture.
#define_import_path deepfield::splat_bins
#import deepfield::constants::TILE
#import deepfield::particle::view
#import deepfield::projection::Projected
#import deepfield::splat_view::{SMALL, EVERYWHERE, INVISIBLE, DROPPED}

/// No bin.
const NOWHERE: u32 = 0xffffffffu;

/// The bin of a splat; NOWHERE if it is not drawn. The grid of the small splats' bins is like level 0. The last bin is for
/// what no pixel sees, unless that is culled.
fn bin_of(projected: Projected) -> u32 {
    if projected.kind == DROPPED {
        return NOWHERE;
    }
    let outside = select(view.bin_count - 1u, NOWHERE, view.culling != 0u);
    let grid = view.levels[projected.level];
    let cell = projected.splat.head.xy / grid.scale + f32(grid.pad);
    let bin = floor(cell / f32(TILE)) + f32(grid.margin);
    let inside = all(bin >= vec2(0.0)) && all(bin < vec2(f32(grid.bins_x), f32(grid.bins_y)));
    let at = vec2<u32>(clamp(bin, vec2(0.0), vec2(f32(grid.bins_x - 1u), f32(grid.bins_y - 1u))));
    let first = select(grid.first_bin, view.small_bin, projected.kind == SMALL);
    let found = select(outside, first + at.y * grid.bins_x + at.x, inside);
    if projected.kind == EVERYWHERE {
        return view.everywhere_bin;
    }
    return select(found, outside, projected.kind == INVISIBLE);
}
