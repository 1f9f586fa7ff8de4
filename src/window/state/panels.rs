//! Which panels are shown.

use bevy::prelude::*;
use std::collections::BTreeSet;

/// A side of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Dock {
    /// What is shown and how.
    Left,
    /// What one learns about it.
    Right,
}

/// What is shown beside the picture.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// The docks, if they are not hidden one by one.
    pub panel: bool,
    /// The dock at the left.
    pub left: bool,
    /// The dock at the right.
    pub right: bool,
    /// The help page.
    pub help: bool,
}

impl Shown {
    /// Whether a dock is to be seen.
    pub fn dock(&self, dock: Dock) -> bool {
        self.panel
            && match dock {
                Dock::Left => self.left,
                Dock::Right => self.right,
            }
    }

    /// Shows or hides a dock; where all are hidden, only this one is shown.
    pub fn toggle(&mut self, dock: Dock) {
        let side = match dock {
            Dock::Left => &mut self.left,
            Dock::Right => &mut self.right,
        };
        if self.panel {
            *side = !*side;
        } else {
            *self = Shown { panel: true, left: dock == Dock::Left, right: dock == Dock::Right, ..*self };
        }
    }
}

/// The sections that the user has closed, by name.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Closed(pub BTreeSet<String>);

impl Closed {
    /// Opens or closes a section.
    pub fn toggle(&mut self, name: &str) {
        if !self.0.remove(name) {
            self.0.insert(name.to_owned());
        }
    }
}
