//! What commands share: how arguments are parsed, progress in a terminal, and the cache of page files.

pub mod arguments;
pub mod cache;
pub mod cached_run;
pub mod jpeg;
pub mod progress_bar;

/// What a command ends with: nothing, or an error whose text names the file and the cause.
pub type CommandResult = Result<(), Box<dyn std::error::Error + Send + Sync>>;

/// Wrong usage that only the files that are named make wrong.
pub fn usage(message: String) -> Box<dyn std::error::Error + Send + Sync> {
    Box::new(clap::Error::raw(clap::error::ErrorKind::InvalidValue, message + "\n"))
}
