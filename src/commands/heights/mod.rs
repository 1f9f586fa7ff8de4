//! What the commands do with measured height fields: each command hands them on to its file here.

pub mod before;
pub mod build;
pub mod contours;
pub mod difference;
pub mod info;
pub mod options;
pub mod pixels;
pub mod probe;
pub mod profile;
pub mod ratio;
pub mod refusal;
pub mod select;
pub mod synth;
pub mod texture;

pub use before::BeforeOptions;
pub use options::{HeightsOptions, SpacingOptions, StatedOptions};
pub use refusal::{refuse, refuse_options, refuse_without};
pub use texture::TextureOptions;
