// Sums the splats of every tile of every pyramid level, without atomics: each invocation owns one column of eight cells
// and walks over the bins whose splats may reach its tile.
//
// One workgroup for each 8 x 8 tile; along z for each layer, where there are several. Level 0 also takes the small splats. In: splats sorted by bin. Out: the pyramid's
// cells, each written (first batch) or added to (further ones).
//
// Crowded tiles are cut into slices of `view.slice` splats of each range of bins: a workgroup takes a tile's first slice
// and lists the further ones, which a second dispatch sums into patches (slices.wgsl adds them to the cells). So no tile
// keeps one workgroup busy while others idle; and a software driver ends an invocation's loops after 65535 rounds,
// without a word.
//
// With SUBGROUP (subgroups of exactly eight, as on a CPU driver) a workgroup is one subgroup: its lanes look at eight
// splats at a time and then draw those that reach the tile one after the other. Without, each invocation looks at each
// splat.
#import deepfield::splat_view::{SplatView, Level, Pass, Splat, oblique, SAMPLED, SMALL, EVERYWHERE, ELLIPSE, SMALL_ELLIPSE}
#ifdef ELLIPSOIDS
#import deepfield::small_ellipse::integrated_ellipse
#endif
#ifdef LAYERS
#import deepfield::layer_group::{layers, goes_on}
#endif
#import deepfield::kernel::{box_profile, evaluate, first, second, shear, bend, stretching}

@group(0) @binding(0) var<uniform> view: SplatView;
@group(0) @binding(1) var<uniform> batch: Pass;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read_write> cells: array<vec2<f32>>;
/// Tile, among those of all layers, and number of each further slice of a crowded tile.
@group(0) @binding(5) var<storage, read_write> slices: array<vec2<u32>>;
/// For each tile of each layer the first of its further slices, and their number.
@group(0) @binding(6) var<storage, read_write> tile_slices: array<vec2<u32>>;
/// Number of further slices.
@group(0) @binding(7) var<storage, read_write> slice_count: array<atomic<u32>>;
/// The sums of further slices: eight rows of eight cells each.
@group(0) @binding(8) var<storage, read_write> patches: array<vec2<f32>>;

/// The sums of one column of eight cells: four rows in each vector.
struct Column {
    p_top: vec4<f32>,
    p_bottom: vec4<f32>,
    ps_top: vec4<f32>,
    ps_bottom: vec4<f32>,
}

/// Where a column's cell centres lie, pixels, and the ray lengths there.
struct Place {
    x: f32,
    y_top: vec4<f32>,
    y_bottom: vec4<f32>,
    oblique_top: vec4<f32>,
    oblique_bottom: vec4<f32>,
    /// Where the row with the invocation's number lies, pixels.
    y_lane: f32,
    /// The picture's middle, pixels, and the focal length.
    axis: vec2<f32>,
    focal: f32,
    /// The tile's middle and half its edge, pixels.
    middle: vec2<f32>,
    half_edge: f32,
}

const ROWS: vec4<f32> = vec4<f32>(0.0, 1.0, 2.0, 3.0);

/// Adds a splat that is sampled at cell centres. Rays whose nearest point to the particle lies behind the eye do not see
/// it unless the eye is inside it; only splats in the bin EVERYWHERE are near enough for that.
fn add_sampled(column: ptr<function, Column>, place: Place, splat: Splat, kind: u32) {
    let form = vec3(splat.head.zw, splat.tail.x);
    let profile = box_profile((form.x + form.z) * (1.0 / 24.0));
    let dx = place.x - splat.head.x;
    let xx = form.x * dx * dx;
    let xy = 2.0 * form.y * dx;
    let dy_top = place.y_top - splat.head.y;
    let dy_bottom = place.y_bottom - splat.head.y;
#ifdef OBLIQUE
    var u_top = fma(dy_top, fma(dy_top, vec4(form.z), vec4(xy)), vec4(xx)) * place.oblique_top;
    var u_bottom = fma(dy_bottom, fma(dy_bottom, vec4(form.z), vec4(xy)), vec4(xx)) * place.oblique_bottom;
#ifdef ELLIPSOIDS
    if kind == ELLIPSE {
        // It is what is seen from far away already.
        u_top = fma(dy_top, fma(dy_top, vec4(form.z), vec4(xy)), vec4(xx));
        u_bottom = fma(dy_bottom, fma(dy_bottom, vec4(form.z), vec4(xy)), vec4(xx));
    }
#endif
    if kind == EVERYWHERE && splat.tail.w > 0.0 {
        let along = (splat.head.xy - place.axis) / (place.focal * place.focal);
        let across = 1.0 + along.x * (place.x - place.axis.x);
        u_top = select(vec4(1.0), u_top, across + along.y * (place.y_top - place.axis.y) > vec4(0.0));
        u_bottom = select(vec4(1.0), u_bottom, across + along.y * (place.y_bottom - place.axis.y) > vec4(0.0));
    }
#else
#ifdef ELLIPSOIDS
    let u_top = fma(dy_top, fma(dy_top, vec4(form.z), vec4(xy)), vec4(xx));
    let u_bottom = fma(dy_bottom, fma(dy_bottom, vec4(form.z), vec4(xy)), vec4(xx));
#else
    let u_top = fma(dy_top * form.z, dy_top, vec4(xx));
    let u_bottom = fma(dy_bottom * form.z, dy_bottom, vec4(xx));
#endif
#endif
    var f_top = evaluate(profile, u_top);
    var f_bottom = evaluate(profile, u_bottom);
#ifdef ELLIPSOIDS
    if kind == ELLIPSE {
        f_top += stretching(form, dx, dy_top, u_top);
        f_bottom += stretching(form, dx, dy_bottom, u_bottom);
    }
#endif
    (*column).p_top = fma(f_top, vec4(splat.tail.y), (*column).p_top);
    (*column).p_bottom = fma(f_bottom, vec4(splat.tail.y), (*column).p_bottom);
    (*column).ps_top = fma(f_top, vec4(splat.tail.z), (*column).ps_top);
    (*column).ps_bottom = fma(f_bottom, vec4(splat.tail.z), (*column).ps_bottom);
}

/// A value for each of the eight rows.
struct Rows {
    top: vec4<f32>,
    bottom: vec4<f32>,
}

#ifdef SUBGROUP
/// Every row's value, from the invocation with the row's number.
fn gather_rows(value: f32) -> Rows {
    return Rows(
        vec4(subgroupShuffle(value, 0u), subgroupShuffle(value, 1u), subgroupShuffle(value, 2u), subgroupShuffle(value, 3u)),
        vec4(subgroupShuffle(value, 4u), subgroupShuffle(value, 5u), subgroupShuffle(value, 6u), subgroupShuffle(value, 7u)),
    );
}
#endif

/// Adds a splat that is integrated over each pixel: a sum of products of functions of x and y, and for tilted ellipses
/// the first two orders of their correlation.
fn add_small(column: ptr<function, Column>, place: Place, splat: Splat) {
    let x = (place.x - splat.head.x + vec2(-0.5, 0.5)) * splat.head.z;
    // Integrals over the column's width, and over the heights of the rows.
#ifdef SUBGROUP
    let y = (place.y_lane - splat.head.y + vec2(-0.5, 0.5)) * splat.head.w;
    let edges = vec4(x, y);
    let u = first(edges);
    let v = second(edges);
    let y_first = gather_rows(u.w - u.z);
    let y_second = gather_rows(v.w - v.z);
#else
    let edges = vec4(x, x);
    let u = first(edges);
    let v = second(edges);
    let low_top = (place.y_top - splat.head.y - 0.5) * splat.head.w;
    let high_top = low_top + splat.head.w;
    let low_bottom = low_top + 4.0 * splat.head.w;
    let high_bottom = low_bottom + splat.head.w;
    let y_first = Rows(first(high_top) - first(low_top), first(high_bottom) - first(low_bottom));
    let y_second = Rows(second(high_top) - second(low_top), second(high_bottom) - second(low_bottom));
#endif
    let x_first = u.y - u.x;
    let x_second = v.y - v.x;
    var f_top = x_first * y_first.top - x_second * y_second.top;
    var f_bottom = x_first * y_first.bottom - x_second * y_second.bottom;
#ifdef OBLIQUE
    let tilt = splat.tail.x;
    let s = shear(edges);
    let b = bend(edges);
    let x_shear = tilt * (s.y - s.x);
    let x_bend = 0.5 * tilt * tilt * (b.y - b.x);
#ifdef SUBGROUP
    let y_shear = gather_rows(s.w - s.z);
    let y_bend = gather_rows(b.w - b.z);
#else
    let y_shear = Rows(shear(high_top) - shear(low_top), shear(high_bottom) - shear(low_bottom));
    let y_bend = Rows(bend(high_top) - bend(low_top), bend(high_bottom) - bend(low_bottom));
#endif
    f_top = fma(vec4(x_shear), y_shear.top, fma(vec4(x_bend), y_bend.top, f_top));
    f_bottom = fma(vec4(x_shear), y_shear.bottom, fma(vec4(x_bend), y_bend.bottom, f_bottom));
#endif
    (*column).p_top = fma(f_top, vec4(splat.tail.y), (*column).p_top);
    (*column).p_bottom = fma(f_bottom, vec4(splat.tail.y), (*column).p_bottom);
    (*column).ps_top = fma(f_top, vec4(splat.tail.z), (*column).ps_top);
    (*column).ps_bottom = fma(f_bottom, vec4(splat.tail.z), (*column).ps_bottom);
}

#ifdef ELLIPSOIDS
/// Adds an ellipse that is integrated over each pixel.
fn add_small_ellipse(column: ptr<function, Column>, place: Place, splat: Splat) {
    let x = vec4(place.x);
    var f_top: vec4<f32>;
    var f_bottom: vec4<f32>;
    if splat.tail.w > 0.0 {
        f_top = integrated_ellipse(splat, place.y_top, x);
        f_bottom = integrated_ellipse(splat, place.y_bottom, x);
    } else {
        f_top = integrated_ellipse(splat, x, place.y_top);
        f_bottom = integrated_ellipse(splat, x, place.y_bottom);
    }
    (*column).p_top = fma(f_top, vec4(splat.tail.y), (*column).p_top);
    (*column).p_bottom = fma(f_bottom, vec4(splat.tail.y), (*column).p_bottom);
    (*column).ps_top = fma(f_top, vec4(splat.tail.z), (*column).ps_top);
    (*column).ps_bottom = fma(f_bottom, vec4(splat.tail.z), (*column).ps_bottom);
}

/// Whether an ellipse may touch the tile, and certainly where it does.
fn ellipse_touches(place: Place, splat: Splat, kind: u32) -> bool {
    let d = place.middle - splat.head.xy;
    if kind == SMALL_ELLIPSE {
        let at = select(d.yx, d, splat.tail.w > 0.0);
        let reach = place.half_edge + 0.5;
        let beyond = abs(vec2(at.x - splat.tail.x * at.y, at.y)) - reach * vec2(1.0 + abs(splat.tail.x), 1.0);
        let outside = max(beyond, vec2(0.0)) * splat.head.zw;
        return dot(outside, outside) < 1.0;
    }
    let square = splat.head.z * d.x * d.x + 2.0 * splat.head.w * d.x * d.y + splat.tail.x * d.y * d.y;
    return sqrt(max(square, 0.0)) - place.half_edge * (sqrt(splat.head.z) + sqrt(splat.tail.x)) < 1.0;
}

/// Adds a slice of a level's ellipses of one kind that may touch a tile; returns how many there are in the longest range of bins.
fn add_ellipses(
    column: ptr<function, Column>, place: Place, grid: Level, tile: vec2<u32>, slice: u32, kind: u32, offset: u32, lane: u32,
) -> u32 {
    var first = offset + select(grid.ellipse_bins.x, grid.ellipse_bins.y, kind == SMALL_ELLIPSE);
    var tiles = vec2(grid.tiles_x, (grid.height + 7u) / 8u);
    var at = tile;
    let reach = 2u * grid.margin;
    var longest = 0u;
    loop {
        let bins = tiles + reach;
        for (var row = at.y; row <= at.y + reach; row++) {
            let bin = first + row * bins.x + at.x;
            longest = max(longest, add_bins(column, place, bin, bin + reach + 1u, slice, kind, lane));
        }
        first += bins.x * bins.y;
        if all(tiles <= vec2(1u)) {
            break;
        }
        tiles = (tiles + 1u) / 2u;
        at = at / 2u;
    }
    return max(longest, add_bins(column, place, first, first + 1u, slice, kind, lane));
}
#endif

/// Whether a splat touches the tile.
fn touches(place: Place, splat: Splat, kind: u32) -> bool {
#ifdef ELLIPSOIDS
    if kind >= ELLIPSE {
        return ellipse_touches(place, splat, kind);
    }
#endif
    let outside = max(abs(splat.head.xy - place.middle) - place.half_edge, vec2(0.0));
    return dot(outside, outside) < splat.tail.w * splat.tail.w;
}

/// Adds a slice of the splats in bins `bin` to `behind - 1`; returns how many splats there are in all.
fn add_bins(column: ptr<function, Column>, place: Place, bin: u32, behind: u32, slice: u32, kind: u32, lane: u32) -> u32 {
    let begin = starts[bin];
    let end = starts[behind];
    let first = min(begin + slice * view.slice, end);
    add_range(column, place, first, min(first + view.slice, end), kind, lane);
    return end - begin;
}

/// Adds a splat.
fn add_one(column: ptr<function, Column>, place: Place, splat: Splat, kind: u32) {
#ifdef ELLIPSOIDS
    if kind == SMALL_ELLIPSE {
        add_small_ellipse(column, place, splat);
        return;
    }
#endif
    if kind == SMALL {
        add_small(column, place, splat);
    } else {
        add_sampled(column, place, splat, kind);
    }
}

/// Adds the splats at places `first` to `last - 1` of the order.
fn add_range(column: ptr<function, Column>, place: Place, first: u32, last: u32, kind: u32, lane: u32) {
#ifdef SUBGROUP
    for (var base = first; base < last; base += 8u) {
        let at = base + lane;
        let mine = splats[min(at, last - 1u)];
        var pending = subgroupBallot(at < last && touches(place, mine, kind)).x;
        loop {
            if pending == 0u {
                break;
            }
            let source = firstTrailingBit(pending);
            pending &= pending - 1u;
            let splat = Splat(subgroupShuffle(mine.head, source), subgroupShuffle(mine.tail, source));
            add_one(column, place, splat, kind);
        }
    }
#else
    for (var at = first; at < last; at++) {
        let splat = splats[at];
        if touches(place, splat, kind) {
            add_one(column, place, splat, kind);
        }
    }
#endif
}

@compute @workgroup_size(8, #{TILES_PER_GROUP})
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    // Which slice of which tile of which level.
    let item = (group.y * groups.x + group.x) * #{TILES_PER_GROUP}u + local.y;
    var tile = item;
    var layer = group.z;
    var slice = 0u;
    if batch.further != 0u {
        if item >= atomicLoad(&slice_count[0]) || item >= arrayLength(&slices) {
            return;
        }
        layer = slices[item].x / view.tile_count;
        tile = slices[item].x - layer * view.tile_count;
        slice = slices[item].y;
    }
#ifdef LAYERS
    let bins = (layers.first + layer) * view.bin_count;
    let adds = goes_on();
#else
    let bins = 0u;
    let adds = batch.add != 0u;
#endif
    var level = view.level_count - 1u;
    while level > 0u && view.levels[level].first_tile > tile {
        level -= 1u;
    }
    let grid = view.levels[level];
    let index = tile - grid.first_tile;
    let tile_x = index % grid.tiles_x;
    let tile_y = index / grid.tiles_x;
    if tile_y * 8u >= grid.height {
        return;
    }

    let cell = vec2(tile_x * 8u + local.x, tile_y * 8u);
    let corner = (vec2<f32>(vec2(tile_x, tile_y) * 8u) - f32(grid.pad)) * grid.scale;
    var place: Place;
    place.x = corner.x + (f32(local.x) + 0.5) * grid.scale;
    place.y_top = corner.y + (ROWS + 0.5) * grid.scale;
    place.y_bottom = place.y_top + 4.0 * grid.scale;
    for (var i = 0; i < 4; i++) {
        place.oblique_top[i] = oblique(view.middle, view.focal, view.perspective, vec2(place.x, place.y_top[i]));
        place.oblique_bottom[i] = oblique(view.middle, view.focal, view.perspective, vec2(place.x, place.y_bottom[i]));
    }
    place.y_lane = corner.y + (f32(local.x) + 0.5) * grid.scale;
    place.axis = view.middle;
    place.focal = view.focal;
    place.middle = corner + 4.0 * grid.scale;
    place.half_edge = 4.0 * grid.scale;

    var column = Column(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0));
    // The bins of a row follow each other, so a row of neighbours is one range.
    let reach = 2u * grid.margin;
    var longest = 0u;
    for (var row = tile_y; row <= tile_y + reach; row++) {
        let bin = bins + grid.first_bin + row * grid.bins_x + tile_x;
        longest = max(longest, add_bins(&column, place, bin, bin + reach + 1u, slice, SAMPLED, local.x));
    }
    if level == view.level_count - 1u {
        let bin = bins + view.everywhere_bin;
        longest = max(longest, add_bins(&column, place, bin, bin + 1u, slice, EVERYWHERE, local.x));
    }
    if level == 0u {
        for (var row = tile_y; row <= tile_y + reach; row++) {
            let bin = bins + view.small_bin + row * grid.bins_x + tile_x;
            longest = max(longest, add_bins(&column, place, bin, bin + reach + 1u, slice, SMALL, local.x));
        }
    }
#ifdef ELLIPSOIDS
    let at = vec2(tile_x, tile_y);
    longest = max(longest, add_ellipses(&column, place, grid, at, slice, ELLIPSE, bins, local.x));
    if level == 0u {
        longest = max(longest, add_ellipses(&column, place, grid, at, slice, SMALL_ELLIPSE, bins, local.x));
    }
#endif

    if batch.further != 0u {
        for (var i = 0u; i < 4u; i++) {
            let at = item * 64u + i * 8u + local.x;
            patches[at] = vec2(column.p_top[i], column.ps_top[i]);
            patches[at + 32u] = vec2(column.p_bottom[i], column.ps_bottom[i]);
        }
        return;
    }
    if local.x == 0u {
        let further = (max(longest, 1u) - 1u) / view.slice;
        var begin = 0u;
        if further > 0u {
            begin = atomicAdd(&slice_count[0], further);
        }
        // The list holds all that there can be.
        let room = min(further, arrayLength(&slices) - min(begin, arrayLength(&slices)));
        let own = layer * view.tile_count + tile;
        tile_slices[own] = vec2(begin, room);
        for (var i = 0u; i < room; i++) {
            slices[begin + i] = vec2(own, i + 1u);
        }
    }
    if cell.x >= grid.width {
        return;
    }
    let first = layer * view.cell_count + grid.first_cell + cell.y * grid.width + cell.x;
    for (var i = 0u; i < 8u; i++) {
        if cell.y + i < grid.height {
            var value = vec2(column.p_top[i & 3u], column.ps_top[i & 3u]);
            if i >= 4u {
                value = vec2(column.p_bottom[i & 3u], column.ps_bottom[i & 3u]);
            }
            let target_cell = first + i * grid.width;
            if adds {
                value += cells[target_cell];
            }
            cells[target_cell] = value;
        }
    }
}
