//! Windows of a show: leading and following, the outputs of a rig, and going on after a failure.

pub mod network;
pub mod output;
pub mod supervised;
