//! Tests of measuring.

mod degrees;
mod differences;
mod filters;
mod lines;
mod numbers;
mod paged;
mod places;
mod rays;
mod truth;
