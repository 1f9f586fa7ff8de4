//! From somebody else's file to particles: one file (or folder) per format behind one trait. Nothing outside this room
//! knows a format.
//!
//! [`open`] gives a [`Source`] that reads in bounded ranges, [`summarize`] what `info` prints, [`load`] particles in memory,
//! [`streams()`] particles in chunks. Images and volumes have a room of their own, [`grid`], and so do velocity fields, [`vector_field`].

mod attributes;
mod bytes;
mod check;
mod choice;
pub(crate) mod derived;
mod error;
mod expansion;
mod find_source;
mod folder;
mod format;
mod gadget;
mod generic_io;
pub mod grid;
pub mod guarded;
mod hdf5;
mod las;
mod load;
mod multifile;
mod nchilada;
pub(crate) mod neighbours;
mod packed;
mod phantom;
mod ply;
mod ramses;
mod rows;
mod run;
mod source;
mod step_at;
mod step_name;
mod stream;
mod summary;
mod table;
mod tipsy;
mod trajectory;
mod typed_columns;
mod units;
mod unpacked;
mod unpacking;
pub mod vector_field;
mod vtk_points;

pub use attributes::has_attribute;
pub use bytes::Order as ByteOrder;
pub use check::LeftOut;
pub use choice::replaced_densities;
pub use derived::derivable;
pub use error::ImportError;
pub use find_source::find_source;
pub use folder::{OtherKind, file_in, is_one_table};
pub use format::{
    Format, HEAD, extensions, files_of, formats, name_beyond, names, open, open_with, register, steps_in,
};
pub use grid::voxels;
pub use grid::{GridOptions, GridSource, grid_format, open_grid, summarize_grid};
pub use hdf5::{Hdf5Column, Hdf5Tables};
pub use load::{AttributeChoice, DEFAULT_NEIGHBOURS, LoadOptions, Smoothing, load, load_source};
pub use multifile::names as names_of_parts;
pub use rows::{FamilyRows, Scalar};
pub use run::{Run, RunOptions, RunStep, Times, open_run, sources_of};
pub use source::{Description, FamilyInfo, Field, FieldKind, Source};
pub use step_at::step_at;
pub use step_name::{file_of_step, step_name};
pub use stream::{SourceStream, StateChunk, Streams, streams};
pub use summary::{FamilySummary, FieldSummary, Statistic, Summary, summarize, summarize_source};
use table::text_head;
pub use unpacking::UnpackedOnce;
