// What densities and attributes emit and absorb: the tables of a transfer function, as crates/draw/src/cpu/volume/classify.rs reads them.
//
// Whoever imports this has bindings 0 and 1 of group 1 taken. The Rust twin of `Lookup` is in src/gpu/matter.rs.
#define_import_path deepfield::matter
#import deepfield::volume_constants::{BRIGHTNESSES, HIDDEN_BITS, HUES}

struct Lookup {
    /// Factor and offset from an attribute, or its base-2 logarithm, to its place among the hues.
    attribute_map: vec2<f32>,
    /// 1: hues follow the attribute's logarithm.
    attribute_log: u32,
    /// Leading bits of the density of the table's first entry.
    first_entry: u32,
    /// Number of intervals of the table less one.
    last_entry: u32,
    /// Index of the first hue in the table; 0: none.
    hues: u32,
    /// Index of the first entry of the plane of hues and places in the table; 0: none.
    plane: u32,
    unused: u32,
}

@group(1) @binding(0) var<uniform> lookup: Lookup;
@group(1) @binding(1) var<storage, read> table: array<vec4<f32>>;

/// What a table of hues, which begins at `table_start`, has for an attribute's value at a brightness or a place.
fn entry_of(table_start: u32, quantity: f32, brightness: f32) -> vec4<f32> {
    var value = quantity;
    var known = true;
    if lookup.attribute_log != 0u {
        known = quantity > 0.0;
        value = log2(max(quantity, 1.0e-37));
    }
    let at = select(0.0, clamp(fma(value, lookup.attribute_map.x, lookup.attribute_map.y), 0.0, 1.0), known);
    let row = u32(floor(at * f32(HUES - 1u) + 0.5)) * BRIGHTNESSES;
    let column = min(u32(floor(max(brightness, 0.0) * f32(BRIGHTNESSES - 1u) + 0.5)), BRIGHTNESSES - 1u);
    return table[table_start + row + column];
}

/// Colour (linear light) and extinction per length of a density and an attribute.
fn matter_of(density: f32, quantity: f32) -> vec4<f32> {
    let bits = bitcast<u32>(density);
    let entry = bits >> HIDDEN_BITS;
    var at = 0u;
    var between = 0.0;
    if entry >= lookup.first_entry {
        at = entry - lookup.first_entry;
        between = f32(bits & ((1u << HIDDEN_BITS) - 1u)) * (1.0 / f32(1u << HIDDEN_BITS));
        if at > lookup.last_entry {
            at = lookup.last_entry;
            between = 1.0;
        }
    }
    let low = table[at];
    let matter = low + between * (table[at + 1u] - low);
    if matter.x <= 0.0 || lookup.hues == 0u {
        return vec4(matter.yzw, matter.x);
    }
    if lookup.plane != 0u {
        let planar = entry_of(lookup.plane, quantity, matter.z);
        return vec4(planar.rgb, matter.x * planar.a);
    }
    return vec4(entry_of(lookup.hues, quantity, matter.y).rgb, matter.x);
}
