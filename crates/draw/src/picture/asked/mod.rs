//! What other programs ask, as JSON, and what they are told: those of Python, and browsers.

mod about;
mod data;
mod facts;
mod question;
mod request;
mod state;

pub use about::about;
pub use data::{AskedData, said};
pub use facts::{ChannelValues, channels, facts, units_and_ends};
pub use question::{AskedProbe, Question, only};
pub use request::Asked;
pub use state::State;

/// Why something could not be done.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Does the work on so many threads; on all where nothing is said.
///
/// # Errors
/// Those of the work, and where the threads cannot be started.
pub fn on_threads<T: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> Result<T, Failure> + Send,
) -> Result<T, Failure> {
    match threads {
        Some(threads) => rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(work),
        None => work(),
    }
}
