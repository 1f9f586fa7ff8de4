//! Pictures of measured heights: [`SurfaceSession`] opens a field and draws the shots that are asked for. Among other data, or several in one
//! picture, [`super::mixed`] draws them.

mod clearance;
mod depths;
mod earlier;
mod eyes;
#[cfg(test)]
pub(in crate::picture) mod fixtures;
mod in_scene;
mod letters;
pub(in crate::picture) mod names;
mod opened;
pub(in crate::picture) mod painting;
mod raw;
pub(in crate::picture) mod session;
pub(in crate::picture) mod standing;

pub use depths::{Piece, SurfaceDepths, pieces};
pub use earlier::Earlier;
pub use in_scene::{FieldInScene, nearest};
pub use opened::OpenSurface;
pub use raw::{CHANNELS, SurfaceChannels, SurfaceShown};
pub use session::{SeenSurface, SurfaceSession};
