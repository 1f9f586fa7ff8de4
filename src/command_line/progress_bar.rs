//! What there is to tell on the terminal: sentences, and the progress of long work as a bar; no bar where standard error is no
//! terminal.

use crate::model::progress::Progress;
use crate::picture::Reporter;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Standard error.
pub struct Terminal;

impl Reporter for Terminal {
    fn tell(&self, message: String) {
        eprintln!("deepfield: {message}");
    }

    fn progress(&self) -> Box<dyn Progress> {
        Box::new(TerminalProgress::new())
    }
}

/// A bar on standard error.
pub struct TerminalProgress {
    bar: ProgressBar,
}

impl TerminalProgress {
    /// A bar that appears with the first stage.
    pub fn new() -> TerminalProgress {
        // indicatif hides the bar by itself where standard error is not a terminal.
        TerminalProgress { bar: ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr()) }
    }
}

impl Default for TerminalProgress {
    fn default() -> Self {
        TerminalProgress::new()
    }
}

impl Progress for TerminalProgress {
    fn begin(&self, stage: &str, total: u64) {
        let template = if total > 0 {
            "{msg:28} {bar:40.cyan/dim} {percent:>3} % {eta:>4} left"
        } else {
            "{msg:28} {spinner} {elapsed}"
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            self.bar.set_style(style.progress_chars("━╸─"));
        }
        self.bar.reset();
        if total > 0 {
            self.bar.set_length(total);
        }
        self.bar.set_message(stage.to_owned());
    }

    fn advance(&self, n: u64) {
        self.bar.inc(n);
    }

    fn say(&self, line: &str) {
        // The bar must not be drawn while the line is written.
        self.bar.suspend(|| eprintln!("{line}"));
    }
}

impl Drop for TerminalProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
