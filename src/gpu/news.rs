//! What the render world tells the main world.

use bevy::prelude::Resource;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What has been found out about pictures of one kind. Clones share it.
#[derive(Resource, Clone, Debug, Default)]
pub struct News<T: Send + Sync + 'static>(Arc<Mutex<T>>);

impl<T: Clone + Send + Sync + 'static> News<T> {
    /// What is known now.
    pub fn now(&self) -> T {
        self.lock().clone()
    }

    pub(in crate::gpu) fn lock(&self) -> MutexGuard<'_, T> {
        // Every change is one assignment: whoever panicked left something consistent.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
