//! What a session tells.

use deepfield::model::Progress;
use deepfield::picture::Reporter;
use std::sync::Mutex;

/// Keeps what it is told.
#[derive(Default)]
pub struct Told(pub Mutex<Vec<String>>);

impl Reporter for Told {
    fn tell(&self, message: String) {
        self.0.lock().unwrap().push(message);
    }

    fn progress(&self) -> Box<dyn Progress + '_> {
        Box::new(())
    }
}
