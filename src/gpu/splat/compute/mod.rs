//! Splatting by compute, without blending and without atomics on floats; see [`super`] for its passes.

mod bindings;
mod pass;
pub(in crate::gpu) mod pipeline;
pub(in crate::gpu) mod sums;

pub use bindings::{ComputeBindings, MAX_BATCH, Scratch, bind};
pub use pass::encode;
pub use pipeline::ComputePipelines;
