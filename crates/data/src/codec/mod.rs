//! Lossy and lossless codes: Morton order, quantised coordinates, vector quantisation of attributes (F12 3.3, 3.4, 4.7.4).
//!
//! This room turns columns of numbers into indices and back; it knows neither trees nor files.

pub mod clusters;
pub mod codebook;
pub mod coordinates;
pub mod morton;
pub mod packing;
pub mod positions;
pub mod quantize;
pub mod quantizer;
pub mod refinement;
pub mod samples;
pub mod scaling;
pub mod shapes;
pub mod states;

mod pca_split;

pub use codebook::{Codebook, CodebookScope, QuantityError};
pub use packing::{CodeBits, VqBits};
pub(crate) use pca_split::principal_component;
pub use quantize::{BatchInfo, Batches, Coded, Quantities, Quantized, Scaling, quantize};
pub use refinement::Refinement;
pub use scaling::{AttributeMerge, ColumnScaling};
