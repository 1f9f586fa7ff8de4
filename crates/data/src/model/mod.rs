//! What the data is, before anything is done with it: particles by family, their attributes with units, bounds and
//! SPH kernels; sampled grids, their samples and where those are; and how settings and parts of files are read. This room knows no file format, no hierarchy and no picture.

pub mod bounds;
pub mod clock;
pub mod cosmology;
pub mod covariance;
pub mod derived;
pub mod family_name;
pub mod fft;
pub mod grid;
pub mod http_date;
pub mod kernel;
#[allow(unsafe_code, reason = "memory that a file is mapped to is read by address, and its faults are signals")]
mod mapping;
pub mod mixing;
pub mod moment;
pub mod new_file;
pub mod particles;
pub mod periodic;
pub mod physical;
pub mod placement;
pub mod portable;
pub mod positioned;
pub mod progress;
pub mod read_file;
pub mod ron_file;
pub mod ron_place;
mod ron_words;
pub mod sample_type;
#[allow(unsafe_code, reason = "only the C library can be told to give back what it keeps")]
pub mod spare_memory;
pub mod stream;
pub mod units;
pub mod url;

pub use bounds::Bounds;
pub use clock::{ClockVariable, Epoch, Motion};
pub use cosmology::{Cosmology, redshift_of, scale_factor_of};
pub use covariance::Covariance;
pub use derived::{Derivation, DerivedQuantity};
pub use family_name::FamilyName;
pub use grid::{Channel, Grid, Region, Scale};
pub use kernel::Kernel;
pub use moment::{Moment, StepTimes, When};
pub use particles::{Attribute, Dataset, Family, Provenance, Skipped};
pub use periodic::PeriodicBox;
pub use physical::PhysicalFactors;
pub use placement::Placement;
pub use progress::Progress;
pub use read_file::{ReadFile, ReadMethod};
pub use sample_type::SampleType;
pub use stream::{Chunk, FamilyStream, ParticleStream, StreamError};
pub use units::Unit;
pub use url::is_url;
