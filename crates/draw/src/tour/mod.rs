//! Tours: keyframes in time, the camera's way through them, and what is shown when.
//!
//! A [`TourFile`] is what a user writes (docs/tours.md). [`Timeline::new`] resolves it, for the data that it is shown with, and
//! [`Timeline::state`] is what is shown at a time: a pure function, the same for a window at any frame rate and for a recording.

pub mod exposure;
pub mod path;
pub mod spline;
pub mod zoom_pan;

mod adaptation;
mod around;
mod check;
mod file;
mod frames;
mod highlights;
mod pace;
mod place;
mod show;
mod timeline;
mod usual;

pub use around::Surroundings;
pub use exposure::Exposure;
pub use file::{Around, Comfort, Easing, Keyframe, Move, TimeEasing, TourError, TourFile, What};
pub use frames::{Frames, Pattern};
pub use pace::{Remark, remarks};
pub use path::{Path, Pose};
pub use show::{Show, Take};
pub use timeline::{Blend, Caption, State, Stop, Timeline};
pub use usual::{around_data, play_along};
