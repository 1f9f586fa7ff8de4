//! Samples as bytes and back, without loss.

pub mod bits;
pub mod heights;
pub mod predict;
pub mod residuals;
pub mod validity;
pub mod words;
