//! From source to picture, across the rooms: the screen-space guarantee, conservation, colour errors, golden images.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[path = "../support/cases.rs"]
mod cases;
mod color_error;
mod conservation;
mod cut;
mod economy;
mod golden;
#[cfg(feature = "viewer")]
mod gpu;
mod guarantee;
mod joined;
mod periodic;
mod support;
#[cfg(feature = "viewer")]
mod volume_gpu;
