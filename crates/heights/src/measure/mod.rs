//! Measuring: rays, places, profiles, numbers of roughness, form and its removal, filters, lines and differences. Everything reads heights in
//! windows, so that fields of any size are measured, and everything is measured on T.

mod autocorrelation;
mod bands;
mod chains;
mod fourier;
mod material;
mod solve;
mod tiles;

pub mod alignment;
pub mod contours;
pub mod course;
pub mod difference;
pub mod filter;
pub mod fit;
pub mod form;
pub mod geojson;
pub mod great_circle;
pub mod iso;
pub mod on_globe;
pub mod paged;
pub mod part;
pub mod pick;
pub mod probe;
pub mod profile;
pub mod pyramid;
pub mod ray;
pub mod residuals;

#[cfg(test)]
mod tests;

pub use alignment::Alignment;
pub use autocorrelation::{Correlation, Texture, correlation};
pub use contours::{Contour, ContourError, contours, levels};
pub use course::{Course, Courses, Spread};
pub use difference::{Difference, DifferenceError, Volumes, volumes, volumes_on};
pub use filter::{Filter, Filtered};
pub use fit::{FormError, fit};
pub use form::{Form, FormKind, FormNumbers, Residual};
pub use geojson::GeoJson;
pub use great_circle::great_circle;
pub use iso::{Iso, Roughness, roughness, roughness_on};
pub use material::{Material, material_ratio};
pub use on_globe::pick_on_globe;
pub use paged::{PagedPyramid, Stands, pick_all};
pub use part::{Disc, Part, window_of};
pub use pick::{Pick, pick};
pub use probe::{Probe, Sample, gradient, nearest, probe, probe_on, probe_sample};
pub use profile::{Profile, ProfilePoint, profile, profile_of_pieces, profile_on};
pub use pyramid::Pyramid;
pub use ray::{Hit, MinMax, Ray, Rise, cast, cast_all, height_ratio};
pub use residuals::{FittedForm, fitted};
pub use tiles::{OnSurface, Tiles, height_between};
