//! What commands share: how arguments are parsed, progress in a terminal, and the cache of page files.

pub mod arguments;
pub mod cache;
pub mod cached_run;
pub mod jpeg;
pub mod progress_bar;

use std::fmt::Arguments;
use std::io::{ErrorKind, Write};

/// What a command ends with: nothing, or an error whose text names the file and the cause.
pub type CommandResult = Result<(), Box<dyn std::error::Error + Send + Sync>>;

/// Writes a line to standard output. Who reads that may have seen enough of it, as behind `| head`: the work goes on without them.
///
/// # Errors
/// When it cannot be written for another reason.
pub fn print_line(line: Arguments<'_>) -> std::io::Result<()> {
    match writeln!(std::io::stdout(), "{line}") {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        done => done,
    }
}

/// The text that is written.
pub fn text_of(write: impl FnOnce(&mut String) -> std::fmt::Result) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write(&mut text);
    text
}

/// Wrong usage that only the files that are named make wrong.
pub fn usage(message: String) -> Box<dyn std::error::Error + Send + Sync> {
    Box::new(clap::Error::raw(clap::error::ErrorKind::InvalidValue, message + "\n"))
}
