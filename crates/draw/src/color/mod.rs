//! What values look like: transfer functions and colour maps, the accumulated sums and the light that they are turned
//! into, and how both are written to files.

pub mod accumulation;
pub mod bloom;
pub mod colormap;
pub mod colors;
pub mod composite;
pub mod exposure_mode;
pub mod output;
pub mod splat_colors;
pub mod transfer;

pub use accumulation::Accumulation;
pub use bloom::Bloom;
pub use colormap::ColorMap;
pub use colors::Colors;
pub use composite::{Image, composite};
pub use exposure_mode::ExposureMode;
pub use transfer::TransferFunction;
