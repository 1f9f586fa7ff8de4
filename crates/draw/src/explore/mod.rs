//! Looking closer: regions of space and of values, selections, sums over the whole data, ids, export, plots and
//! catalogues of named objects.
//!
//! Everything here works over two kinds of [`Data`]: a page file (fast, within its stated quantisation error) and the source
//! itself (exact, in the source's own precision). Nothing is held in memory but a few chunks and the answer, so both may be of
//! any size. This room knows no window; commands and the window use it alike.

pub mod batch;
pub mod binned;
pub mod catalogue;
pub mod center;
pub mod data;
pub mod error;
pub mod export;
pub mod farthest;
pub mod field_probe;
pub mod followed;
pub mod highlight;
pub mod histogram;
pub mod identify;
pub mod ids;
pub mod isosurface;
pub mod lasso;
pub mod marks;
pub mod merger_tree;
pub mod moments;
pub mod opened;
pub mod over_time;
pub mod particle;
pub mod places;
pub mod plot;
pub mod probe;
pub mod profile;
pub mod query;
pub mod radial;
pub mod region;
pub mod selection;
pub mod shape;

mod bins;
mod coded;
mod estimate;
mod paged;
mod several;
mod sourced;

pub use batch::{Batch, Gather, Uncertain, Work};
pub use binned::{Binned, BinnedAxis, BinnedError, Weight, binned};
pub use bins::edges;
pub use catalogue::{Catalogue, Object, Property, files_of_catalogue, sphere_at};
pub use center::{Center, CenterSums, center};
pub use data::{Data, FieldAbout, source_of};
pub use error::ExploreError;
pub use estimate::{Effort, Estimate};
pub use export::rows::{Rows, rows};
pub use export::{Exported, Format, Frame, export, mesh::MeshFormat, xml_escaped};
pub use farthest::farthest;
pub use followed::{Followed, Following};
pub use highlight::{Highlighter, Marked};
pub use histogram::{Axis, AxisOptions, FieldHistogram, Scatter, histogram, scatter};
pub use identify::{Identified, PageParticle, find_id, identify, ids_of};
pub use ids::IdSet;
pub use isosurface::{Isosurface, IsosurfaceOptions, ReadGrid, isosurface, isosurface_of_grid, memory_of_bricks};
pub use lasso::{Lasso, LassoProjection};
pub use merger_tree::MergerTree;
pub use opened::Opened;
pub use over_time::{AtStep, OverTime, over_time};
pub use places::{FoundIds, Places};
pub use plot::{ChartScales, Plot, PlotKind, PlotOf, PlotOptions, PlotScale, PlotSettings};
pub use probe::{Fields, Probe, ProbeOptions, probe};
pub use profile::ProfileOptions;
pub use query::Of;
pub use radial::{Radial, RadialError, RadialEstimate, members_about, radial, radials};
pub use region::{Region, Shape, ValueRange};
pub use selection::{Members, SelectionSet, Show};
pub use shape::{Cover, Shapes};
