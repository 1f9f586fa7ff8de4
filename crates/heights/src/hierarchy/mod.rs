//! The hierarchy of a height field: nested levels of chunks, and the pyramid of a photo over it.

pub mod chunks;
pub mod photo;
