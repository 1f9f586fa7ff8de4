//! The space-time hierarchy of trajectories (F12 chapter 6): particles as tracks from step to step.

pub mod differences;
pub mod spline;

pub use differences::{chord, difference_at};
pub use spline::HermiteSpline;
