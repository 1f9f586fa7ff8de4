// Bricks that a slab fills, of all tiers together. A brick's number is that of its bin in its tier's first level.
#define_import_path deepfield::volume_bricks
#import deepfield::volume_view::{VolumeView, Portion}

@group(0) @binding(0) var<uniform> volume: VolumeView;
@group(0) @binding(1) var<uniform> portion: Portion;

struct Brick {
    tier: u32,
    /// Column and row in the window, and layer among those that are filled.
    place: vec3<u32>,
    /// Index among its layer's bricks.
    column: u32,
    /// Layer of the tier.
    layer: u32,
    /// Index among the bricks that are held.
    held: u32,
}

/// A brick of a tier by its index among those that are filled, or by its bin there: layers of all columns.
fn brick_of_tier(tier: u32, index: u32) -> Brick {
    let window = volume.tiers[tier].window;
    let columns = window.x * window.y;
    let column = index % columns;
    let place = vec3(column % window.x, column / window.x, index / columns);
    let layer = portion.tiers[tier].first_layer + place.z;
    let held = volume.tiers[tier].first_brick + layer % volume.tiers[tier].ring * columns + column;
    return Brick(tier, place, column, layer, held);
}

/// The first bin of a tier.
fn first_bin(tier: u32) -> u32 {
    return volume.levels[volume.tiers[tier].first_level].x;
}

/// The brick with a number.
fn brick_of(number: u32) -> Brick {
    var tier = 0u;
    while tier + 1u < volume.tier_count && number >= first_bin(tier + 1u) {
        tier += 1u;
    }
    return brick_of_tier(tier, number - first_bin(tier));
}
