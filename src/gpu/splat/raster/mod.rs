//! Splatting by blended quads, without compute shaders; see [`super`] for its passes.

mod bindings;
mod pass;
pub(in crate::gpu) mod pipeline;

pub use bindings::{RasterBindings, bind};
pub use pass::encode;
pub use pipeline::RasterPipelines;

/// Cells from one row of the picture's buffer to the next: a texture's rows are copied to multiples of 256 bytes.
pub fn stride(width: u32) -> u32 {
    width.next_multiple_of(32)
}
