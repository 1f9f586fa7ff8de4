//! Tests of measuring.

mod numbers;
mod places;
mod rays;
mod truth;
