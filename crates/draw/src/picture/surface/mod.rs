//! Pictures of measured heights: [`SurfaceSession`] opens a field and draws the shots that are asked for, [`MixedSession`]
//! several, and particles among them.

mod clearance;
mod depths;
mod earlier;
#[cfg(test)]
mod fixtures;
mod in_scene;
mod letters;
mod mixed;
mod names;
mod open_mixed;
mod opened;
mod painting;
mod placement;
mod raw;
mod session;
mod standing;

pub use depths::{Piece, SurfaceDepths, pieces};
pub use earlier::Earlier;
pub use in_scene::{FieldInScene, nearest};
pub use mixed::{MixedSession, ParticlesSeen, SeenMixed};
pub use open_mixed::{OpenField, OpenMixed};
pub use opened::OpenSurface;
pub use raw::{CHANNELS, SurfaceChannels, SurfaceShown};
pub use session::{SeenSurface, SurfaceSession};
