// The point of a globe that a sample of the picture shows, and how much of that sample is covered (crates/draw/src/cpu/surface/coverage.rs).
#define_import_path deepfield::surface_point
#import deepfield::surface_constants::{CHUNK, MIDDLE, MIXED, MOST_SAMPLES, NONE}
#import deepfield::surface_globe::{met_by, place_of_camera}
#import deepfield::surface_levels::{level_at, normal_of, point_coverage, share_in, slope_of}
#import deepfield::surface_ray::{Hit, chunk_at, coverage_of}
#import deepfield::surface_view::{surface, draws, lists, Draw, Shown, camera_of, corner_of, height_of, is_lone, place_of_sample, sample_at}

/// The place of a point: its sample's own.
fn hit_point(shown: Shown, place: vec2<f32>) -> Hit {
    let draw = draws[shown.node];
    let height = height_of(draw, shown.at);
    let camera = camera_of(corner_of(draw, shown.at), height);
    let first = sample_at(draw, shown.at);
    var hit = Hit(shown.node, camera.z, first, vec2(0.0), height, vec2(0.0), 1.0, vec2(0.0), true, false, true, false, false);
    hit.slope = slope_of(normal_of(draw.start, draw.rows * draw.columns, shown.at.x * draw.columns + shown.at.y));
    hit.aside = place_of_camera(camera) - place;
    // Levels tell what is covered about the middle of the picture's sample (`Resolver::middle`); where that is beside the globe, its samples do.
    var about = hit;
    var mean = -1.0;
    let level = level_at(camera.z);
    if (draw.flags & MIXED) != 0u && level > 0.0 {
        let met = met_by(draw, shown.at, height, hit.slope, place);
        let pixel = exp2(level) * surface.spacing / surface.step.yx;
        if met.exists && all(abs(met.beside) <= MIDDLE * pixel) {
            about.within = met.beside;
        } else if !is_lone(draw, shown.at) {
            mean = mean_share(hit, shown.at, place);
        }
    }
    hit.coverage = point_coverage(about, shown.at, mean);
    return hit;
}

/// Where a sample stands on its globe. Places near it are told by what is different there, which is small, and so exact.
struct Stand {
    camera: vec3<f32>,
    /// Away from the axis and to the east, in the camera's coordinates.
    outward: vec3<f32>,
    east: vec3<f32>,
    /// Cosine and sine of the latitude.
    level: f32,
    sine: f32,
    /// How long the upright line is from the axis to the globe, and from there to the sample.
    upright: f32,
    above: f32,
}

fn stand_of(draw: Draw, at: vec2<u32>, height: f32) -> Stand {
    let corner = corner_of(draw, at);
    let turned = bitcast<f32>(lists[corner.y]);
    let ahead = 1.0 - bitcast<f32>(lists[corner.y + 1u]);
    let sine = bitcast<f32>(lists[corner.x + 4u]);
    var stand: Stand;
    stand.camera = camera_of(corner, height);
    stand.outward = ahead * surface.per_column + turned * surface.per_row;
    stand.east = ahead * surface.per_row - turned * surface.per_column;
    stand.level = bitcast<f32>(lists[corner.x + 2u]);
    stand.sine = sine;
    stand.upright = surface.equator / sqrt(1.0 - surface.squared_eccentricity * sine * sine);
    stand.above = surface.lifted + surface.lift * height;
    return stand;
}

/// What is so many rows and columns behind a sample, and so much higher, in the camera's coordinates (`Globe::place`).
fn camera_beside(stand: Stand, beside: vec2<f32>, higher: f32) -> vec3<f32> {
    let angles = beside.yx * surface.turn;
    let sines = sin(angles);
    let halves = sin(0.5 * angles);
    let versines = 2.0 * halves * halves;
    // What the cosine of the latitude is less, and its sine more.
    let less = stand.level * versines.y + stand.sine * sines.y;
    let more = stand.level * sines.y - stand.sine * versines.y;
    let sine = stand.sine + more;
    let square = surface.squared_eccentricity;
    let own = sqrt(1.0 - square * stand.sine * stand.sine);
    let there = sqrt(1.0 - square * sine * sine);
    let longer = stand.upright * square * more * (stand.sine + sine) / (there * (own + there));
    let lifted = surface.lift * higher;
    let reach = stand.upright + stand.above;
    let farther = (longer + lifted) * (stand.level - less) - reach * less;
    let from_axis = reach * stand.level + farther;
    let north = ((1.0 - square) * longer + lifted) * sine + (reach - square * stand.upright) * more;
    let across = (farther - from_axis * versines.x) * stand.outward + from_axis * sines.x * stand.east;
    return stand.camera + across + north * surface.per_height;
}

/// How many rows and columns of samples a level has.
fn samples_of(level: u32) -> vec2<u32> {
    let cells = (vec2(surface.last.y, surface.open) + (1u << level) - 1u) >> vec2(level);
    return cells + 1u + vec2(0u, surface.last.x - surface.open);
}

/// How many rows and columns of cells of full resolution a file says that a sample of a level, but the finest, stands for.
fn stood_for(level: u32, sample: vec2<u32>) -> vec2<f32> {
    let ends = vec2(surface.last.y, surface.open);
    let half = 1u << (level - 1u);
    let middle = sample << vec2(level);
    return vec2<f32>(min(middle + half, ends) - min(max(middle, vec2(half)) - half, ends));
}

/// How many cells of full resolution a sample of a level stands for (`Resolver::cells`).
fn cells_of(level: u32, sample: vec2<u32>) -> f32 {
    let goes_round = surface.goes_round != 0u;
    if level == 0u {
        let is_end = (sample == vec2(0u)) | (sample == surface.last.yx);
        let stood = select(vec2(1.0), vec2(0.5), is_end & vec2(true, !goes_round));
        return stood.x * stood.y;
    }
    var stood = stood_for(level, sample);
    if goes_round && sample.y == 0u {
        stood.y += stood_for(level, samples_of(level) - 1u).y;
    }
    // What closes a globe belongs to the samples on both sides of it.
    let place = place_of_sample(sample, level).y;
    if surface.open < surface.last.x && (place == 0u || place == surface.open) {
        stood.y += 0.5;
    }
    return stood.x * stood.y;
}

/// The share of a sample of a chunk's level, which may be in another chunk; below 0 where only coarser ones are known (`Resolver::share_of`,
/// but that what only an ancestor of drawn chunks knows counts as nothing).
fn share_at(draw: Draw, sample: vec2<u32>) -> f32 {
    let own = sample - vec2(draw.key_row, draw.key_column) * CHUNK;
    // What is before the first one is beyond all.
    if all(own < vec2(draw.rows, draw.columns)) {
        return coverage_of(draw, own);
    }
    let cell = min(place_of_sample(sample, draw.level), surface.last.yx - 1u);
    let node = chunk_at(vec2<i32>(cell.yx));
    if node == NONE {
        return 0.0;
    }
    let other = draws[node];
    if other.level > draw.level {
        return -1.0;
    }
    let up = draw.level - other.level;
    let entry = other.chain + 3u * up;
    let start = lists[entry];
    let size = vec2(lists[entry + 1u], lists[entry + 2u]);
    let index = sample - (vec2(other.key_row, other.key_column) >> vec2(up)) * CHUNK;
    if start == NONE || any(index >= size) {
        return -1.0;
    }
    return share_in(start, size.x * size.y, index.x * size.y + index.y);
}

/// The mean share of a level's samples that are in one of the picture's, as they are found row by row.
struct Mean {
    /// The point that is shown there.
    hit: Hit,
    stand: Stand,
    /// The middle of the picture's sample.
    place: vec2<f32>,
    is_near: bool,
    /// The first and the last row and column that are looked at, and how many columns the level has all around: 0 where it does not go round.
    low: vec2<i32>,
    high: vec2<i32>,
    turn: i32,
    sum: f32,
    weight: f32,
}

/// Whether something is on the near side of the globe (`Limb`).
fn is_on_near_side(camera: vec3<f32>) -> bool {
    return dot(surface.limb, camera) < surface.limb_away;
}

/// Adds a sample, and says whether it is in that of the picture. Those of the other side are not.
fn add(mean: ptr<function, Mean>, row: i32, column: i32) -> bool {
    let at = vec2(row, column);
    if any(at < (*mean).low) || any(at > (*mean).high) {
        return false;
    }
    let hit = (*mean).hit;
    let draw = draws[hit.node];
    let turn = (*mean).turn;
    // Less than a turn is looked at.
    let turns = select(0, select(0, 1, column >= turn) - select(0, 1, column < 0), turn > 0);
    let sample = vec2<u32>(vec2(row, column - turns * turn));
    let there = vec2<i32>(place_of_sample(sample, draw.level)) + vec2(0, turns * i32(surface.last.x));
    let beside = vec2<f32>(there - vec2<i32>(hit.first));
    let camera = camera_beside((*mean).stand, beside, dot(hit.slope, beside.yx));
    let away = place_of_camera(camera) - (*mean).place;
    let is_there = camera.z > 0.0 && all(away >= vec2(-0.5)) && all(away < vec2(0.5));
    if !is_there || is_on_near_side(camera) != (*mean).is_near {
        return false;
    }
    let share = share_at(draw, sample);
    if share >= 0.0 {
        let weight = cells_of(draw.level, sample);
        (*mean).sum += weight * share;
        (*mean).weight += weight;
    }
    return true;
}

/// Adds the samples of a row that are in the picture's, beside those of the row next to it, and says which are the first and the last column of them;
/// there are none where the first is behind the last.
fn scan(mean: ptr<function, Mean>, row: i32, beside: vec2<i32>) -> vec2<i32> {
    var found = vec2(beside.y + 2, beside.x - 2);
    // To the right, and then to the left of where that began.
    var column = beside.x - 1;
    var way = 1;
    loop {
        let is_in = add(mean, row, column);
        if is_in {
            found = vec2(min(found.x, column), max(found.y, column));
        }
        if is_in || (way > 0 && column <= beside.y) {
            column += way;
        } else if way > 0 && found.x < beside.x {
            way = -1;
            column = beside.x - 2;
        } else {
            break;
        }
    }
    return found;
}

/// The mean share of the samples of a chunk's level that are in a sample of the picture, which shows one of them; below 0 where none is known
/// (`Resolver::mean_on_globe`).
fn mean_share(hit: Hit, at: vec2<u32>, place: vec2<f32>) -> f32 {
    let draw = draws[hit.node];
    let count = vec2<i32>(samples_of(draw.level));
    let own = vec2<i32>(vec2(draw.key_row, draw.key_column) * CHUNK + at);
    var mean: Mean;
    mean.hit = hit;
    mean.stand = stand_of(draw, at, hit.height);
    mean.place = place;
    mean.is_near = is_on_near_side(mean.stand.camera);
    var reach = vec2(i32(MOST_SAMPLES));
    mean.turn = select(0, count.y - 1, surface.goes_round != 0u);
    if mean.turn > 0 {
        reach.y = min(reach.y, (mean.turn - 1) / 2);
    }
    let is_endless = vec2(false, mean.turn > 0);
    mean.low = select(max(own - reach, vec2(0)), own - reach, is_endless);
    mean.high = select(min(own + reach, count - 1), own + reach, is_endless);
    // Upwards from the point's row, and then downwards.
    var shown = own.yy;
    var beside = shown;
    var row = own.x;
    var way = -1;
    loop {
        let found = scan(&mean, row, beside);
        if found.x <= found.y {
            if row == own.x {
                shown = found;
            }
            beside = found;
            row += way;
        } else if way < 0 && row != own.x {
            way = 1;
            beside = shown;
            row = own.x + 1;
        } else {
            break;
        }
    }
    if mean.weight > 0.0 {
        return mean.sum / mean.weight;
    }
    return -1.0;
}
