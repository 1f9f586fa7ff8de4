// The bins that splats are sorted by: tiles of cells of their level, and some around the picture.
#define_import_path deepfield::splat_bins
#import deepfield::constants::TILE
#import deepfield::particle::view
#import deepfield::projection::Projected
#import deepfield::splat_view::{SMALL, EVERYWHERE, INVISIBLE, DROPPED, ELLIPSE, SMALL_ELLIPSE}

/// No bin.
const NOWHERE: u32 = 0xffffffffu;

#ifdef ELLIPSOIDS
/// The bin of an ellipse: in the finest of its level's grids whose margin it does not reach beyond; `outside` where no tile looks.
fn bin_of_ellipse(projected: Projected, outside: u32) -> u32 {
    let grid = view.levels[projected.level];
    let cell = projected.splat.head.xy / grid.scale + f32(grid.pad);
    let reach = abs(projected.splat.tail.w) / grid.scale;
    var first = select(grid.ellipse_bins.x, grid.ellipse_bins.y, projected.kind == SMALL_ELLIPSE);
    var tiles = vec2(grid.tiles_x, (grid.height + TILE - 1u) / TILE);
    var edge = f32(TILE);
    loop {
        let bins = tiles + 2u * grid.margin;
        if reach <= edge * f32(grid.margin) {
            let bin = floor(cell / edge) + f32(grid.margin);
            if any(bin < vec2(0.0)) || any(bin >= vec2<f32>(bins)) {
                return outside;
            }
            let at = vec2<u32>(bin);
            return first + at.y * bins.x + at.x;
        }
        first += bins.x * bins.y;
        if all(tiles <= vec2(1u)) {
            break;
        }
        tiles = (tiles + 1u) / 2u;
        edge *= 2.0;
    }
    return first;
}
#endif

/// The bin of a splat; NOWHERE if it is not drawn. The grid of the small splats' bins is like level 0. The last bin is for
/// what no pixel sees, unless that is culled.
fn bin_of(projected: Projected) -> u32 {
    if projected.kind == DROPPED {
        return NOWHERE;
    }
    let outside = select(view.bin_count - 1u, NOWHERE, view.culling != 0u);
#ifdef ELLIPSOIDS
    if projected.kind == ELLIPSE || projected.kind == SMALL_ELLIPSE {
        return bin_of_ellipse(projected, outside);
    }
#endif
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
