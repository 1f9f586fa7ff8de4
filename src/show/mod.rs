//! Shows on several screens and machines: the messages between a leader and its followers, the projectors of a rig, the
//! process that keeps a show's windows open, and what those windows do.

pub mod protocol;
pub mod rig;
pub mod supervisor;
#[cfg(feature = "viewer")]
pub mod window;
