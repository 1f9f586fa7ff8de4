// The particles of a tile, front to back: the lists of its bin in each level, merged. Where a list has several particles in front
// of all others' next, these are one run.
//
// Whoever imports this has bindings 0 to 3 of group 0 taken.
#define_import_path deepfield::tile_walk
#import deepfield::tile_constants::MOST_LEVELS
#import deepfield::tile_view::TileView

@group(0) @binding(0) var<uniform> tiles: TileView;
/// The particles of all bins, as numbers in their order front to back.
@group(0) @binding(1) var<storage, read> ranks: array<u32>;
/// First of each bin's, and the one behind its last.
@group(0) @binding(2) var<storage, read> ranges: array<vec2<u32>>;
/// For each tile the particle where it goes on in the next turn.
@group(0) @binding(3) var<storage, read_write> progress: array<u32>;

/// Behind all particles.
const NONE: u32 = 0xffffffffu;

struct Walk {
    /// Next particle of each level but that of the present run, and where it and the end are in the list.
    heads: array<u32, MOST_LEVELS>,
    at: array<u32, MOST_LEVELS>,
    behind: array<u32, MOST_LEVELS>,
    /// The level of the present run, where that is in the list, and the list's end.
    level: u32,
    place: u32,
    end: u32,
    /// Next particle of all, and that of another run.
    head: u32,
    until: u32,
    /// Rounds of loops so far: a software driver ends an invocation's loops after 65535, without a word.
    rounds: u32,
}

/// Begins with the particle `first`, or the next one.
fn begin_walk(walk: ptr<function, Walk>, tile: vec2<u32>, first: u32) {
    (*walk).level = 0u;
    (*walk).rounds = 0u;
    for (var level = 0u; level < tiles.level_count; level++) {
        let grid = tiles.levels[level];
        let at = tile >> vec2(level);
        let range = ranges[grid.x + at.y * grid.y + at.x];
        var low = range.x;
        var high = range.y;
        while first > 0u && low < high {
            let middle = (low + high) / 2u;
            if ranks[middle] < first {
                low = middle + 1u;
            } else {
                high = middle;
            }
            (*walk).rounds += 1u;
        }
        (*walk).at[level] = low;
        (*walk).behind[level] = range.y;
        (*walk).heads[level] = NONE;
        if low < range.y {
            (*walk).heads[level] = ranks[low];
        }
    }
    next_run(walk);
}

/// Finds the level whose next particle is the first of all.
fn next_run(walk: ptr<function, Walk>) {
    var best = NONE;
    var second = NONE;
    for (var level = 0u; level < tiles.level_count; level++) {
        let head = (*walk).heads[level];
        if head < best {
            second = best;
            best = head;
            (*walk).level = level;
        } else {
            second = min(second, head);
        }
    }
    (*walk).until = second;
    (*walk).head = best;
    (*walk).place = (*walk).at[(*walk).level];
    (*walk).end = (*walk).behind[(*walk).level];
    (*walk).rounds += tiles.level_count + 1u;
}

/// The next particle; NONE when there is no other.
fn head_of(walk: ptr<function, Walk>) -> u32 {
    return (*walk).head;
}

/// Goes past the next particle.
fn advance(walk: ptr<function, Walk>) {
    let place = (*walk).place + 1u;
    var head = NONE;
    if place < (*walk).end {
        head = ranks[place];
    }
    (*walk).place = place;
    (*walk).head = head;
    (*walk).rounds += 1u;
    if head > (*walk).until || head == NONE {
        // Within a run only what has changed is kept: lists by level lie in memory, not in registers.
        (*walk).at[(*walk).level] = place;
        (*walk).heads[(*walk).level] = head;
        next_run(walk);
    }
}

/// Whether the next particle is left to another turn.
fn is_spent(walk: ptr<function, Walk>) -> bool {
    return (*walk).rounds > #{ROUNDS}u;
}
