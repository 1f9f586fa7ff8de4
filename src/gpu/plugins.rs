//! Plugins of other crates, which every application that draws adds behind deepfield's own.

use bevy::app::{App, Plugin};
use std::sync::{PoisonError, RwLock};

static REGISTERED: RwLock<Vec<fn(&mut App)>> = RwLock::new(Vec::new());

/// Adds a plugin to all applications that are made from now on.
pub fn register(plugin: fn(&mut App)) {
    REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(plugin);
}

/// All that have been registered.
pub struct OtherCrates;

impl Plugin for OtherCrates {
    fn build(&self, app: &mut App) {
        let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner).clone();
        registered.into_iter().for_each(|plugin| plugin(app));
    }
}
