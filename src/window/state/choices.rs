//! What the open data and the program offer to choose from.

use crate::color::colormap::ColorMap;
use crate::store::Metadata;
use bevy::prelude::*;
use bevy_egui::egui::Color32;

/// What the combo boxes offer beyond the modes.
#[derive(Resource, Clone, Debug, Default)]
pub struct Choices {
    /// Attributes of the open dataset, each once.
    pub attributes: Vec<String>,
    /// Colour maps with a few of their colours.
    color_maps: Vec<(ColorMap, Vec<Color32>)>,
}

impl Choices {
    /// Colour maps with a few of their colours.
    pub fn color_maps(&self) -> &[(ColorMap, Vec<Color32>)] {
        &self.color_maps
    }

    /// The attributes of all families, each once: first those that only some have, then the quantities that all have.
    pub fn attributes_of(metadata: &Metadata) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        let attributes = metadata.families.iter().flat_map(|family| &family.attributes);
        let quantities = metadata.families.iter().flat_map(|family| &family.quantities);
        for attribute in attributes.chain(quantities) {
            if !names.contains(&attribute.name) {
                names.push(attribute.name.clone());
            }
        }
        names
    }

    /// What does not depend on a dataset.
    pub fn of_program() -> Choices {
        let color = |[r, g, b]: [f32; 3]| {
            let byte = |component: f32| (255.0 * component).round() as u8;
            Color32::from_rgb(byte(r), byte(g), byte(b))
        };
        let sampled = |map: ColorMap| (map.clone(), map.sample(24).into_iter().map(color).collect());
        Choices { attributes: Vec::new(), color_maps: ColorMap::all().map(sampled).collect() }
    }
}
