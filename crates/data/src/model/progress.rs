//! How long work tells whoever started it how far it has come.

/// Receives the progress of long work. Calls come from any thread, so an implementation synchronises itself.
pub trait Progress: Sync {
    /// A stage named `stage` begins and will take `total` steps (particles, pages, bytes); 0 when that is not known.
    fn begin(&self, stage: &str, total: u64);

    /// `n` further steps of the current stage are done.
    fn advance(&self, n: u64);

    /// A line that whoever started the work should read even if nobody watches the progress.
    fn say(&self, _line: &str) {}
}

/// Nobody listens.
impl Progress for () {
    fn begin(&self, _stage: &str, _total: u64) {}

    fn advance(&self, _n: u64) {}
}
