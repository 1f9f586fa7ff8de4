//! How long work tells whoever started it how far it has come.

/// Receives the progress of long work. Calls come from any thread, so an implementation synchronises itself.
pub trait Progress: Sync {
    /// A stage named `stage` begins and will take `total` steps (particles, pages, bytes); 0 when that is not known.
    fn begin(&self, stage: &str, total: u64);

    /// `n` further steps of the current stage are done.
    fn advance(&self, n: u64);

    /// Asks whether anybody still waits, between steps that are long: where nobody does, work is unwound from here, as from
    /// [`Progress::begin`] and [`Progress::advance`]. Cheap enough for every few thousand particles.
    fn go_on(&self) {}

    /// A line that whoever started the work should read even if nobody watches the progress.
    fn say(&self, _line: &str) {}
}

/// Asks whether work is to go on and counts nothing: for a part of a stage whose steps are counted as a whole.
pub struct Uncounted<'a>(pub &'a dyn Progress);

impl Progress for Uncounted<'_> {
    fn begin(&self, _stage: &str, _total: u64) {
        self.go_on();
    }

    fn advance(&self, _n: u64) {
        self.go_on();
    }

    fn go_on(&self) {
        self.0.go_on();
    }

    fn say(&self, line: &str) {
        self.0.say(line);
    }
}

/// Nobody listens.
impl Progress for () {
    fn begin(&self, _stage: &str, _total: u64) {}

    fn advance(&self, _n: u64) {}
}
