//! The hierarchy of a height field: nested levels of chunks.

pub mod chunks;
