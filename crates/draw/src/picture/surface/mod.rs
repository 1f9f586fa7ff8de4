//! Pictures of measured heights: [`SurfaceSession`] opens a field and draws the shots that are asked for.

mod letters;
mod opened;
mod raw;
mod session;

pub use opened::{OpenSurface, ray_in_file, rise_of};
pub use raw::{SurfaceChannels, SurfaceShown};
pub use session::{SeenSurface, SurfaceSession};
