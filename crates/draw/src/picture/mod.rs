//! From what is wanted to a picture: [`Session`] selects, reads, decodes, draws, colours and annotates, for every command, tour
//! and window.

mod account;
pub mod adapter;
mod adapter_faces;
pub mod annotation;
mod any_session;
pub mod around;
pub mod asked;
mod darkening;
pub mod decode;
pub mod drawing_cost;
pub mod fade;
mod frame_budget;
mod glow;
pub mod ground;
mod hiding;
pub mod left_out;
mod lettering;
pub mod level_report;
pub mod look;
pub mod mixed;
mod node_traits;
mod opening;
pub mod panorama;
pub mod paths;
mod placement;
mod projected;
pub mod ranges;
mod sampling_error;
pub mod session;
pub mod source;
pub mod splat_budget;
pub mod stand_in;
pub mod subject;
pub mod summing;
mod supplied;
pub mod surface;
mod times;

mod drawn;
mod error;
pub mod field;

pub use adapter::{Adapter, AdapterFrame, AdapterJob};
pub use any_session::AnySession;
pub use drawn::{Coloration, Picture, ShownMoment};
pub use error::PictureError;
pub use left_out::LeftOut;
pub use level_report::LevelReport;
pub use session::{Reporter, Session, SessionOptions};
pub use subject::Subject;
