//! Multi-resolution hierarchies: the model in, nodes out. This room knows no files and no cameras.

pub mod attribute_info;
pub mod cell;
pub mod kind;
pub mod octree;
pub mod pca;
pub mod purpose;
pub mod spacetime;
pub mod wavelet;

pub use attribute_info::{AttributeInfo, Histogram};
pub use cell::{NodeKey, RootCell};
pub use kind::{Kind, Kinds, Matter};
pub use octree::{Encoding, LevelInfo, OctreeOptions};
pub use pca::ClusterOptions;
pub use purpose::Purpose;
pub use spacetime::HermiteSpline;
