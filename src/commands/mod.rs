//! One file per subcommand: its arguments and what it does with the rooms below.

pub mod arguments;
pub mod build;
pub mod info;
pub mod modes;
pub mod progress_bar;

/// What a command ends with: nothing, or an error whose text names the file and the cause.
pub type CommandResult = Result<(), Box<dyn std::error::Error + Send + Sync>>;
