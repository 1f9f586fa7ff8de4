//! VTK's points with their arrays: `POLYDATA` and `UNSTRUCTURED_GRID` of legacy files, `PolyData` and `UnstructuredGrid` in XML. Cells are
//! left out. Image data is a grid, which [`super::grid`] opens.

mod arrays;
mod legacy;
mod xml;

use super::grid::{Content, XML_POINTS, is_vtk_of_points, xml_data_set};
use super::packed::Packing;
use super::{Format, HEAD, ImportError, Source};
use crate::model::ReadMethod;
use std::io::Read;
use std::path::Path;

/// VTK's formats of points.
pub(super) struct VtkPoints;

impl Format for VtkPoints {
    fn name(&self) -> &'static str {
        "VTK points"
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let mut unpacked = Vec::new();
        if let Some(packing) = Packing::of(head) {
            // The head ends in the middle of the stream.
            let _ = packing.unpacked(head).take(HEAD as u64).read_to_end(&mut unpacked);
        }
        let head = if unpacked.is_empty() { head } else { &unpacked[..] };
        is_vtk_of_points(head) || xml_data_set(head).is_some_and(|kind| XML_POINTS.contains(&&*kind))
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let content = Content::open(path, method)?;
        let arrays = if is_vtk_of_points(&content.head) { legacy::open(&content)? } else { xml::open(&content)? };
        Ok(Box::new(arrays.source(&content)?))
    }
}
