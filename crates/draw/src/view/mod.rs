//! What a camera sees: projections, frustum, screen-space error, node selection. Pure functions over plain values;
//! nothing here knows a file or a GPU.

pub mod budget;
pub mod camera;
pub mod cut;
pub mod detail;
pub mod error;
pub mod frame;
pub mod frustum;
pub mod images;
pub mod panorama;
pub mod perspective_grid;
pub mod scope;
pub mod sections;
pub mod selection;
pub mod stereo;
pub mod travel;

pub use camera::{Projection, View, ViewError};
pub use cut::{Cut, CutSettings};
pub use detail::Detail;
pub use frustum::Extent;
pub use images::{Images, Periodic};
pub use panorama::{CubeLayout, Panorama, Side, Surround};
pub use perspective_grid::PerspectiveGrid;
pub use scope::Scope;
pub use sections::{Sampling, Sections};
pub use selection::{Drawn, Hidden, Missing, NodeInfo, NodeTree, Occluder, Selection, select, select_unhidden};
pub use stereo::{Eye, Eyes, Omnidirectional, Stereo, StereoKind};
