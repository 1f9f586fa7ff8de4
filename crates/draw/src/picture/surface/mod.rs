//! Pictures of measured heights: [`SurfaceSession`] opens a field and draws the shots that are asked for.

mod painting;
mod raw;
mod session;

pub use raw::{SurfaceChannels, SurfaceShown};
pub use session::SurfaceSession;
