//! HDF5: snapshots of Gadget-2, -3 and -4, AREPO, GIZMO, EAGLE and SWIFT, and bare files with coordinates.

mod expansion;
mod file;
mod header;
mod names;
mod snapshot;
mod tables;
mod units;

pub use tables::{Hdf5Column, Hdf5Tables};

use super::{Format, ImportError, Source};
use crate::model::ReadMethod;
use std::path::Path;

/// The HDF5 format.
pub(super) struct Hdf5;

/// What a superblock begins with.
const SIGNATURE: &[u8; 8] = b"\x89HDF\r\n\x1a\n";

impl Format for Hdf5 {
    fn name(&self) -> &'static str {
        "HDF5 snapshot"
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        // A user block may precede the superblock, which then starts at 512, 1024, 2048, ...
        [0, 512, 1024, 2048].iter().any(|start| head.get(*start..).is_some_and(|rest| rest.starts_with(SIGNATURE)))
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(snapshot::Snapshot::open(path, method)?))
    }
}
