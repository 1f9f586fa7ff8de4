//! Samples as bytes and back, without loss but for rounding within a bound where that is asked for.

pub mod bits;
pub mod heights;
pub mod predict;
pub mod residuals;
pub mod validity;
pub mod values;
pub mod words;
