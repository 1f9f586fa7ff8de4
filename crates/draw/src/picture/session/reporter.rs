//! Who is told what happens while pictures are made.

use crate::model::Progress;

/// Who is told what there is to tell while data is opened and pictures are drawn, and shows how long it takes.
pub trait Reporter: Send + Sync {
    /// A sentence for the user.
    fn tell(&self, message: String);

    /// Shows the progress of one long work.
    fn progress(&self) -> Box<dyn Progress + '_>;

    /// Whether nobody waits for the picture any more. Asked before a view is drawn, also between those that pictures of all directions and for two
    /// eyes are put together from.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// Nobody is told.
impl Reporter for () {
    fn tell(&self, _: String) {}

    fn progress(&self) -> Box<dyn Progress + '_> {
        Box::new(())
    }
}
