//! The section about colours: the transfer-function editor, and how light is exposed and spreads.

use super::{Dock, Section, light, transfer};
use bevy::prelude::DetectChangesMut;

/// The section.
pub static SECTION: Section = Section {
    name: "transfer",
    title: "Colours",
    dock: Dock::Left,
    applies: |state| state.look.is_some(),
    show: |ui, state| {
        let (Some(scene), Some(look)) = (&state.scene, &state.look) else { return };
        let mut edited = state.settings.clone();
        let shown = transfer::Shown { scene, look, exposure: &state.exposure, choices: &state.choices };
        transfer::show(ui, &shown, &mut state.presets, &mut edited);
        light::show(ui, &mut edited);
        state.settings.set_if_neq(edited);
    },
};
