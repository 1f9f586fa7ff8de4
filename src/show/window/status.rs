//! What the window's state for scripts says of its show.

use super::network::{Following, Leading};
use super::supervised::Supervised;
use crate::window::state::show::{Role, ShowStatus};
use bevy::prelude::*;

/// Keeps the window's [`ShowStatus`].
pub fn add(app: &mut App) {
    app.add_systems(PostUpdate, update_status);
}

fn update_status(
    mut commands: Commands,
    known: Option<Res<ShowStatus>>,
    leading: Option<Res<Leading>>,
    following: Option<Res<Following>>,
    supervised: Option<Res<Supervised>>,
) {
    let status = if let Some(following) = following.as_deref().map(Following::follower) {
        let (address, joined) = (Some(following.leader()), following.is_joined());
        ShowStatus { role: Role::Follower, address, joined, followers: Vec::new(), outputs: Vec::new() }
    } else if let Some(leader) = leading.as_deref().map(Leading::leader) {
        let followers = leader.followers().iter().map(|info| (info.name.clone(), info.is_here, info.is_in_step()));
        let outputs = supervised.iter().flat_map(|supervised| supervised.outputs());
        ShowStatus {
            role: Role::Leader,
            address: leader.address(),
            joined: true,
            followers: followers.collect(),
            outputs: outputs.map(|(name, process)| (name.to_owned(), process)).collect(),
        }
    } else {
        return;
    };
    if known.is_none_or(|known| *known != status) {
        commands.insert_resource(status);
    }
}
