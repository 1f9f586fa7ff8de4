// Bricks that a slab fills, of all tiers together, and where tiers lie. A brick's number is that of its bin in its tier's
// first level.
#define_import_path deepfield::volume_bricks
#import deepfield::volume_view::{VolumeView, Portion, TierPortion}
#import deepfield::volume_constants::BORDER

@group(0) @binding(0) var<uniform> volume: VolumeView;
@group(0) @binding(1) var<uniform> portion: Portion;

/// The first brick of a tier's window.
fn first_brick_of(filled: TierPortion) -> vec2<u32> {
    return vec2(filled.origin & 0xffffu, filled.origin >> 16u);
}

/// The first layer that is filled of a tier.
fn first_layer_of(filled: TierPortion) -> u32 {
    return filled.layers & 0xffffffu;
}

/// The first layer of a tier that the slab may read: of the finest tier the last layer of the slab before is filled up too, where
/// it has turned out to show, and a brick reads from half its place on.
fn first_layer_read(tier: u32) -> u32 {
    return (max(portion.first_layer, 1u) - 1u) >> tier;
}

/// How many layers are filled of a tier.
fn layers_of(filled: TierPortion) -> u32 {
    return filled.layers >> 24u;
}

/// Cells of the finest tier are so much narrower than those of a tier.
fn scale_of(tier: u32) -> f32 {
    return 1.0 / f32(1u << tier);
}

/// The middle line of sight, stored cells of a tier. By arithmetic: a software driver fetches uniforms for each lane.
fn middle_of(tier: u32) -> vec2<f32> {
    return fma(volume.middle - 2.0 * f32(BORDER), vec2(scale_of(tier)), vec2(2.0 * f32(BORDER)));
}

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
    let layer = first_layer_of(portion.tiers[tier]) + place.z;
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
