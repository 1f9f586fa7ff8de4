//! From what is wanted to a picture: nodes are decoded, drawn, coloured and put together.

pub mod around;
pub mod fade;
pub mod governor;
pub mod look;
pub mod paint;
pub mod panorama;
pub mod pilot;
pub mod processor;
