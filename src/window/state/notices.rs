//! What the program has to tell: kept in a list for the panel, and shown over the picture for a while.

use bevy::prelude::*;
use std::collections::VecDeque;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// Good to know.
    Info,
    /// Something did not work; the program goes on.
    Error,
}

/// One notice.
#[derive(Clone, Debug, PartialEq)]
pub struct Notice {
    /// How bad it is.
    pub severity: Severity,
    /// The text, one sentence.
    pub text: String,
    /// When it was said, seconds since the start.
    pub at_secs: f64,
}

/// The latest notices, oldest first.
#[derive(Resource, Clone, Debug, Default)]
pub struct Notices {
    list: VecDeque<Notice>,
    said: u64,
    now_secs: f64,
}

/// How many notices are kept.
const KEPT: usize = 1000;

impl Notices {
    /// Says something good to know.
    pub fn info(&mut self, text: impl Into<String>) {
        self.push(Severity::Info, text.into());
    }

    /// Says that something did not work.
    pub fn error(&mut self, text: impl Into<String>) {
        self.push(Severity::Error, text.into());
    }

    fn push(&mut self, severity: Severity, text: String) {
        match severity {
            Severity::Info => info!("{text}"),
            Severity::Error => warn!("{text}"),
        }
        self.said += 1;
        self.list.push_back(Notice { severity, text, at_secs: self.now_secs });
        if self.list.len() > KEPT {
            self.list.pop_front();
        }
    }

    /// All that is kept, oldest first.
    pub fn all(&self) -> impl DoubleEndedIterator<Item = &Notice> {
        self.list.iter()
    }

    /// How many have been said since the start, those included that are not kept any more.
    pub fn said(&self) -> u64 {
        self.said
    }

    /// Seconds since a notice was given.
    pub fn age_secs(&self, notice: &Notice) -> f64 {
        self.now_secs - notice.at_secs
    }
}

/// Keeps the clock by which notices age.
pub(crate) fn advance_notices(time: Res<Time<Real>>, mut notices: ResMut<Notices>) {
    notices.bypass_change_detection().now_secs = time.elapsed_secs_f64();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_notices_make_room() {
        let mut notices = Notices::default();
        for i in 0..KEPT + 5 {
            notices.error(format!("{i}"));
        }
        assert_eq!((notices.all().count(), notices.said()), (KEPT, KEPT as u64 + 5));
        assert_eq!(notices.all().next().unwrap().text, "5");
    }
}
