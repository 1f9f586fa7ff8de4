//! Who looks: so many at a time, each known by a cookie.

use super::drawer::Drawer;
use super::shown::Shown;
use renetcode::generate_random_bytes;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Why somebody cannot look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoPlace {
    /// As many as there may be look already.
    Full,
    /// The system gives no thread.
    NoThread,
}

/// Those who look.
pub(super) struct Visitors {
    most: usize,
    shown: Arc<Shown>,
    known: Mutex<HashMap<String, Arc<Drawer>>>,
}

impl Visitors {
    /// Nobody yet; `most` at a time.
    pub(super) fn new(most: usize, shown: Arc<Shown>) -> Visitors {
        Visitors { most, shown, known: Mutex::default() }
    }

    /// How many there may be.
    pub(super) fn most(&self) -> usize {
        self.most
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.present().len()
    }

    /// Whether a visitor is there, or could come.
    pub(super) fn has_place(&self, id: Option<&str>) -> bool {
        let present = self.present();
        present.len() < self.most || id.is_some_and(|id| present.contains_key(id))
    }

    /// The visitor of that name, or a new one.
    ///
    /// # Errors
    /// [`NoPlace`].
    pub(super) fn admit(&self, id: Option<String>) -> Result<(String, Arc<Drawer>), NoPlace> {
        let mut present = self.present();
        let id = id.unwrap_or_else(new_id);
        let before = present.get(&id);
        if let Some(drawer) = before.filter(|drawer| drawer.keep()) {
            return Ok((id, Arc::clone(drawer)));
        }
        if before.is_none() && present.len() >= self.most {
            return Err(NoPlace::Full);
        }
        let drawer = Drawer::start(Arc::clone(&self.shown), before).map_err(|_| NoPlace::NoThread)?;
        present.insert(id.clone(), Arc::clone(&drawer));
        Ok((id, drawer))
    }

    /// Takes leave of a visitor, whose place is free once nothing is drawn or on its way any more: who came and left in turns would have
    /// threads and pictures without end.
    pub(super) fn leave(&self, id: &str) {
        if let Some(drawer) = self.present().get(id) {
            drawer.close();
        }
    }

    /// Those who are there, or for whom something is still drawn or on its way.
    fn present(&self) -> MutexGuard<'_, HashMap<String, Arc<Drawer>>> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|_, drawer| !drawer.has_ended());
        known
    }
}

impl Drop for Visitors {
    fn drop(&mut self) {
        self.present().values().for_each(|drawer| drawer.close());
    }
}

/// A name that nobody guesses.
pub(super) fn new_id() -> String {
    generate_random_bytes::<16>().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Whether a text can be such a name.
pub(super) fn is_id(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}
