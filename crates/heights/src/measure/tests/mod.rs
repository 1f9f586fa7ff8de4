//! Tests of measuring.

mod differences;
mod filters;
mod lines;
mod numbers;
mod paged;
mod places;
mod rays;
mod truth;
