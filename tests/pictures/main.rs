//! From source to picture, across the rooms: the screen-space guarantee, conservation, colour errors, golden images.

mod color_error;
mod conservation;
mod golden;
mod guarantee;
mod support;
