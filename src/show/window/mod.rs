//! Windows of a show: leading and following, the outputs of a rig, and going on after a failure.

pub mod network;
pub mod output;
pub mod supervised;

mod status;

use crate::show::protocol::{NetworkError, ShowKey};
use crate::show::rig::OutputError;
use crate::show::supervisor::RunFolder;
use crate::window::{AppError, OpenRequest, WindowOptions, build_window, run_app};
use std::net::SocketAddr;
use std::path::PathBuf;

/// The part that a window has in a show on several machines.
#[derive(Clone, Debug)]
pub enum Show {
    /// Others follow it.
    Lead {
        /// Where it listens for them.
        address: SocketAddr,
        /// The show's key.
        key: ShowKey,
    },
    /// It shows what another one shows.
    Follow {
        /// Where that is.
        leader: SocketAddr,
        /// The show's key.
        key: ShowKey,
        /// What the leader's window calls it.
        name: String,
        /// Its copies of the data that is shown; where there are none, they are looked for where the leader has them.
        data: Vec<PathBuf>,
    },
}

/// What a window does beside being one.
#[derive(Clone, Debug, Default)]
pub struct ShowOptions {
    /// Its part in a show on several machines.
    pub part: Option<Show>,
    /// The output that it displays: a file of outputs and a name in it. For one who follows.
    pub output: Option<(PathBuf, String)>,
    /// Where it finds the process that keeps it open, if there is one.
    pub supervised: Option<RunFolder>,
}

/// Why there is no window of a show, or why it closed with a failure.
#[derive(Debug, thiserror::Error)]
pub enum ShowError {
    /// There is no window, or it failed.
    #[error(transparent)]
    Window(#[from] AppError),
    /// The show cannot be led.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The output cannot be displayed.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Opens a window with its part in a show, and runs until it is closed.
///
/// # Errors
/// [`ShowError`].
pub fn run_show_window(mut options: WindowOptions, show: ShowOptions) -> Result<(), ShowError> {
    // A follower is told what it is to show.
    let of_its_own = options.open.is_some();
    let went_on = show.supervised.as_ref().filter(|_| of_its_own).and_then(supervised::resume::State::read);
    let went_on = went_on.map(|(state, scene)| {
        (options.open, options.tour) = (Some(OpenRequest::of(scene)), None);
        state
    });
    options.audience = matches!(show.part, Some(Show::Follow { .. }));
    // What is wrong with its files is said before there is a window.
    let output = show.output.map(|(file, name)| output::OutputWindow::open(&file, &name)).transpose()?;
    let mut app = build_window(options)?;
    status::add(&mut app);
    network::add_section(&mut app);
    if let Some(part) = &show.part {
        network::add(&mut app, part)?;
    }
    if let Some(output) = output {
        output::add(&mut app, output);
    }
    if let Some(folder) = show.supervised {
        supervised::add(&mut app, folder, of_its_own, went_on);
    }
    Ok(run_app(app)?)
}
