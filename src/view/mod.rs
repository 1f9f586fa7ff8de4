//! What a camera sees: projections, frustum, screen-space error, node selection. Pure functions over plain values;
//! nothing here knows a file or a GPU.

pub mod camera;

pub use camera::{Projection, View};
