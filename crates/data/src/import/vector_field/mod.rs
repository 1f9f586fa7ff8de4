//! Velocity fields on grids, steady and unsteady, and the particles that they carry along (F12 6.6.2): [`trace`] makes a run of them, whose
//! tracks are the field's streamlines or pathlines.
//!
//! A field is trilinear between its nodes and a cubic in time between its times, each of which needs the four around it; that is what
//! paths are exact for ([`particle`]). What it has no number for, such as land in an ocean, is outside.

mod axis;
mod cell;
mod field;
mod frames;
mod grids;
mod interval;
mod numpy;
mod particle;
mod seeds;
mod step;
mod trace;

pub use field::{FieldOptions, VectorField};
pub use frames::Frame;
pub use interval::Interval;
pub use seeds::Seeds;
pub use trace::{DEFAULT_SEEDS, DEFAULT_STEPS, DEFAULT_TOLERANCE, TraceOptions, trace};

use crate::import::grid::NumpyArrays;
use crate::model::ReadMethod;
use std::path::Path;

/// A sentence about the velocities that a file of NumPy's arrays looks like it holds, and what reads them; `None` of every other file.
pub fn velocities_in(path: &Path) -> Option<String> {
    // What cannot be read is told where it is opened.
    let arrays = NumpyArrays::open(path, ReadMethod::default()).ok()??;
    let what = numpy::velocities(&arrays)?;
    Some(format!("{what}: deepfield build --trace reads a velocity field"))
}
