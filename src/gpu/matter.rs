//! What densities and attributes emit and absorb, as shaders that import `deepfield::matter` read it.

use crate::color::transfer::Scale;
use crate::cpu::volume::Classifier;
use bytemuck::{Pod, Zeroable};

/// WGSL `Lookup`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LookupUniform {
    /// Factor and offset from an attribute, or its base-2 logarithm, to its place among the hues.
    pub attribute_map: [f32; 2],
    /// 1: hues follow the attribute's logarithm.
    pub attribute_log: u32,
    /// Leading bits of the density of the table's first entry.
    pub first_entry: u32,
    /// Number of intervals of the table less one.
    pub last_entry: u32,
    /// Index of the first hue in the table; 0: none.
    pub hues: u32,
    /// Index of the first entry of the plane of hues and places in the table; 0: none.
    pub plane: u32,
    /// Padding.
    pub unused: u32,
}

impl LookupUniform {
    /// How a classifier's table is read.
    pub fn new(classifier: &Classifier) -> LookupUniform {
        let tables = classifier.tables();
        let (attribute_map, attribute_log) = map_to_place(tables.scale, tables.attribute);
        LookupUniform {
            attribute_map,
            attribute_log,
            first_entry: tables.first,
            last_entry: tables.densities.len() as u32 - 2,
            hues: if tables.hues.is_empty() { 0 } else { tables.densities.len() as u32 },
            plane: if tables.plane.is_empty() { 0 } else { (tables.densities.len() + tables.hues.len()) as u32 },
            unused: 0,
        }
    }
}

/// Factor and offset that place a value (1: its base-2 logarithm) between the ends of a range.
pub fn map_to_place(scale: Scale, [min, max]: [f64; 2]) -> ([f32; 2], u32) {
    let (min, max, log) = match scale {
        Scale::Log => (min.log2(), max.log2(), 1),
        Scale::Linear => (min, max, 0),
    };
    let factor = 1.0 / (max - min);
    ([factor as f32, (-min * factor) as f32], log)
}

/// The table: densities, then hues, then the plane.
pub fn table(classifier: &Classifier) -> Vec<[f32; 4]> {
    let tables = classifier.tables();
    let hues = tables.hues.iter().map(|&[r, g, b]| [r, g, b, 0.0]);
    tables.densities.iter().copied().chain(hues).chain(tables.plane.iter().copied()).collect()
}
