//! The window of a show on several machines: one leads ([`leading`]), others follow ([`following`], [`data`]).
//!
//! The leader's window is the presenter's: all its panels and keys, and a section that says who follows. A follower's window is the
//! audience's: the leader's picture and nothing else. What goes from one to the other is in [`crate::show::protocol`].

pub mod data;
pub mod following;
pub mod leading;

mod section;

pub use following::{Following, is_led};
pub use leading::Leading;

use super::Show;
use crate::show::protocol::{Follower, Leader, NetworkError};
use crate::window::camera::CameraSystems;
use crate::window::input::PointerOwner;
use crate::window::{WindowSystems, look, panel, touring};
use bevy::prelude::*;

/// Makes a window lead or follow: after everything else that it does.
///
/// # Errors
/// [`NetworkError::Bind`].
pub fn add(app: &mut App, show: &Show) -> Result<(), NetworkError> {
    match show {
        Show::Lead { address, key } => {
            add_leader(app, Leader::bind(*address, key.clone())?);
        }
        Show::Follow { leader, key, name, data } => {
            add_follower(app, Following::new(Follower::new(*leader, key.clone(), name), data.clone()));
        }
    }
    Ok(())
}

/// Adds the section that a leader's panels have; presets may name it in every window.
pub fn add_section(app: &mut App) {
    app.world_mut().resource_mut::<panel::Sections>().add_above("statistics", &section::SECTION);
    app.add_systems(Update, section::update_section.run_if(resource_exists::<Leading>));
}

/// What leads.
pub fn add_leader(app: &mut App, leader: Leader) {
    app.insert_resource(Leading::new(leader))
        .add_systems(PreUpdate, leading::receive_from_followers)
        .add_systems(PostUpdate, leading::send_frame.after(CameraSystems::Settle));
}

/// What follows.
pub fn add_follower(app: &mut App, following: Following) {
    let follow = (following::find_data, following::show_led_picture, following::close_on_keys);
    app.configure_sets(Update, WindowSystems::TakeInput.run_if(not(resource_exists::<Following>)))
        .configure_sets(Update, WindowSystems::PlayTour.run_if(not(is_led)))
        .insert_resource(following)
        .insert_resource(PointerOwner::nobody())
        .init_resource::<look::Held>()
        .add_systems(PreUpdate, following::receive_from_leader)
        .add_systems(
            Update,
            (
                follow.chain().after(touring::player::play_tour).before(look::follow_settings),
                following::hold_levels.after(touring::ranges::hold_ranges).before(look::glide_levels),
            ),
        )
        .add_systems(PostUpdate, following::report_to_leader.after(CameraSystems::Settle));
}

#[cfg(test)]
mod tests;
