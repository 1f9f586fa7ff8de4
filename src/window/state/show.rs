//! What the window knows of a show on several screens that it is a part of; nothing where it is alone.

use bevy::prelude::*;
use serde::Serialize;
use std::net::SocketAddr;

/// What a window does in a show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Others follow it.
    Leader,
    /// It shows what the leader shows.
    Follower,
}

/// The window's part in a show, as its state for scripts says it.
#[derive(Resource, Clone, Debug, PartialEq, Serialize)]
pub struct ShowStatus {
    /// What it does.
    pub role: Role,
    /// Where the leader is.
    pub address: Option<SocketAddr>,
    /// Whether the leader is there.
    pub joined: bool,
    /// Who follows, and whether they are there and in step.
    pub followers: Vec<(String, bool, bool)>,
    /// The windows of this machine's outputs, and the numbers of their processes.
    pub outputs: Vec<(String, u32)>,
}
