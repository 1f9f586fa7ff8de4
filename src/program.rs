//! The program as a value: what another crate adds to deepfield, and the command line that it is started with.

use crate::command_line::cache;
use crate::commands::{demo, description};
use crate::heights::import::height_names;
use crate::import::{self, Format};
use crate::mode::Mode;
use crate::modes;
use crate::store::{keep_pages_from_afar, take_notes};
use std::process::ExitCode;

/// deepfield, with modes, formats and plugins of other crates. All that names modes or recognises files knows them: the
/// command line, RON files, panels, scenes, tours and followers.
///
/// ```no_run
/// use deepfield::mode::Mode;
/// static MODE: Mode = Mode { name: "my-volume", help: "a volume of mine", ..deepfield::modes::grid::MODE };
///
/// fn main() -> std::process::ExitCode {
///     deepfield::Program::default().mode(&MODE).run()
/// }
/// ```
#[derive(Default)]
pub struct Program {
    /// What could not be registered.
    refused: Vec<String>,
}

impl Program {
    /// With one more mode. Its name must not be another one's.
    pub fn mode(mut self, mode: &'static Mode) -> Program {
        self.refused.extend(modes::register(mode).err());
        self
    }

    /// With one more format of sources. Its name must not be another one's.
    pub fn format(mut self, format: &'static dyn Format) -> Program {
        self.refused.extend(import::register(format).err());
        self
    }

    /// With a plugin in every application that draws with an adapter: the window, and those without one. It is added
    /// behind deepfield's render plugins, so its passes can be ordered against theirs.
    #[cfg(feature = "viewer")]
    pub fn plugin(self, plugin: fn(&mut bevy::app::App)) -> Program {
        crate::gpu::plugins::register(plugin);
        self
    }

    /// Parses the command line, calls one command, and turns its outcome into an exit code: 0 for success, 2 for wrong
    /// usage, 1 for failure with one line on standard error.
    pub fn run(self) -> ExitCode {
        if let Some(refused) = self.refused.first() {
            eprintln!("deepfield: {refused}");
            return ExitCode::FAILURE;
        }
        #[cfg(feature = "viewer")]
        crate::gpu::environment::prepare();
        keep_pages_from_afar(cache::for_pages_from_afar);
        import::name_beyond(|| format!("{} (heights)", height_names()));
        let outcome = match description::parse() {
            Ok(Some(command)) => command.run(),
            Ok(None) => demo::run(),
            Err(message) => Err(message.into()),
        };
        take_notes().iter().for_each(|note| eprintln!("deepfield: {note}"));
        match outcome {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) if is_unread(&*error) => ExitCode::SUCCESS,
            Err(error) if error.is::<clap::Error>() => {
                // What only the files that are named make wrong.
                eprint!("{error}");
                ExitCode::from(2)
            }
            Err(error) => {
                // One line, whatever a library's message looks like.
                let text: Vec<String> = error.to_string().lines().map(|line| line.trim().to_owned()).collect();
                eprintln!("deepfield: {}", text.join(" "));
                ExitCode::FAILURE
            }
        }
    }
}

/// Whether all that went wrong is that nobody reads standard output any more, as behind `| head`. What comes of files is told with their
/// names, so that it is not the system's bare error.
fn is_unread(error: &(dyn std::error::Error + Send + Sync + 'static)) -> bool {
    let bare = error.downcast_ref::<std::io::Error>();
    bare.is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe && error.raw_os_error().is_some())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::io::{Error, ErrorKind, Write};
    use std::os::unix::net::UnixStream;

    #[test]
    fn a_reader_that_has_seen_enough_is_no_failure() {
        let (mut ours, theirs) = UnixStream::pair().expect("a pair of sockets");
        drop(theirs);
        let broken = ours.write_all(b"more").expect_err("nobody reads it");
        assert!(is_unread(&broken), "{broken:?}");
        assert!(!is_unread(&Error::new(ErrorKind::BrokenPipe, "out.csv: broken pipe")));
        assert!(!is_unread(&Error::from_raw_os_error(2)) && !is_unread(&std::fmt::Error));
    }
}
