//! Tests of measuring.

mod degrees;
mod differences;
mod filters;
mod globe;
mod lines;
mod numbers;
mod paged;
mod places;
mod rays;
mod truth;
