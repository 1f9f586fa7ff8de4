// How much mass the field has at each density, and at each value of the attribute: classes of equal leading bits, in ascending
// order of the values (crates/draw/src/cpu/volume/range.rs has the same classes).
//
// One workgroup for each brick of a slab. Sums of masses are floats that are added by comparing and exchanging: the adapter need not
// know how to add floats atomically, and cells that hold something are few.
#import deepfield::volume_view::{VolumeView, Portion, number_of}
#import deepfield::volume_constants::{BORDER, BRICK, CELLS, RANGE_CLASSES, RANGE_HIDDEN_BITS}

@group(0) @binding(0) var<uniform> volume: VolumeView;
@group(0) @binding(1) var<uniform> portion: Portion;
/// Depth, spacing, cells per length and thickness of each slice.
@group(0) @binding(2) var<storage, read> depths: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> field: array<f32>;
@group(0) @binding(4) var<storage, read> densest: array<f32>;
/// The bits of the mass of each class of densities; then of each class of attributes.
@group(0) @binding(5) var<storage, read_write> masses: array<atomic<u32>>;

fn class_of(value: f32) -> u32 {
    let bits = bitcast<u32>(value);
    return select(bits | 0x80000000u, ~bits, (bits >> 31u) == 1u) >> RANGE_HIDDEN_BITS;
}

fn add(class_index: u32, mass: f32) {
    var known = atomicLoad(&masses[class_index]);
    // Rounds of this are few: as many as others add to the same class at the same time.
    for (var round = 0u; round < 4096u; round++) {
        let sum = bitcast<u32>(bitcast<f32>(known) + mass);
        let result = atomicCompareExchangeWeak(&masses[class_index], known, sum);
        if result.exchanged {
            break;
        }
        known = result.old_value;
    }
}

@compute @workgroup_size(64)
fn measure(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let brick = number_of(group, groups);
    let columns = volume.window.x * volume.window.y;
    if brick >= columns * portion.layers {
        return;
    }
    let layer = portion.first_layer + brick / columns;
    let held = layer % volume.ring * columns + brick % columns;
    let corner = (portion.origin + vec2(brick % volume.window.x, brick / volume.window.x % volume.window.y)) * BRICK;
    // The picture's own cells.
    let at = corner + vec2(lane % BRICK, lane / BRICK);
    let inside = all(at >= portion.first_pixel + BORDER) && all(at < portion.behind_pixel + BORDER);
    let part = lane / BRICK * #{PARTS}u / BRICK;
    if !inside || densest[held * #{PARTS}u + part] <= 0.0 {
        return;
    }
    for (var z = 0u; z < BRICK; z++) {
        let slice = layer * BRICK + z;
        let within = z * 64u + lane;
#ifdef ATTRIBUTE
        let density = field[held * 2u * CELLS + within];
        let weighted = field[held * 2u * CELLS + CELLS + within];
#else
        let density = field[held * CELLS + within];
#endif
        if slice < volume.slices && density > 0.0 {
            // In units that no single precision overflows.
            let width = depths[slice].y / depths[volume.slices / 2u].y;
            let mass = density * width * width * width;
            add(class_of(density), mass);
#ifdef ATTRIBUTE
            add(RANGE_CLASSES + class_of(weighted / density), mass);
#endif
        }
    }
}
