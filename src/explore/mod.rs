//! Looking closer: regions of space and of values, selections, sums over the whole data, ids, export, histograms and
//! catalogues of named objects.
//!
//! Everything here works over two kinds of data: a page file (fast, within its stated quantisation error) and the source
//! itself (exact, in the source's own precision). Nothing is held in memory but a few chunks and the answer, so both may be of
//! any size. This room knows no window; commands and the window use it alike.

pub mod error;
pub mod ids;
pub mod lasso;
pub mod region;
pub mod selection;
pub mod shape;

pub use error::ExploreError;
pub use ids::IdSet;
pub use lasso::{Lasso, LassoProjection};
pub use region::{Region, Shape, ValueRange};
pub use selection::{Members, SelectionSet, Show};
pub use shape::{Cover, Shapes};
