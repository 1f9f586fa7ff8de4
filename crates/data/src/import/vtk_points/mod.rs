//! VTK's points with their arrays: `POLYDATA` and `UNSTRUCTURED_GRID` of legacy files, `PolyData` and `UnstructuredGrid` in XML, in any number of
//! pieces, and the parallel files that name others with these. Cells are left out. Image data is a grid, which [`super::grid`] opens.

mod arrays;
mod legacy;
mod xml;

use super::grid::{Content, XML_POINTS, is_vtk_of_points, xml_data_set};
use super::packed::Packing;
use super::{Format, HEAD, ImportError, Source};
use crate::model::ReadMethod;
use std::io::Read;
use std::path::{Path, PathBuf};

/// VTK's formats of points.
pub(super) struct VtkPoints;

impl Format for VtkPoints {
    fn name(&self) -> &'static str {
        "VTK points"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["vtk", "vtp", "vtu", "pvtp", "pvtu"]
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
        let pieces = if is_vtk_of_points(&content.head) { legacy::open(&content)? } else { xml::open(&content)? };
        Ok(Box::new(pieces.source(&content.named)?))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        let content = Content::open(path, ReadMethod::Positioned)?;
        let mut files = vec![path.to_owned()];
        for name in xml::sources(&content)?.unwrap_or_default() {
            files.push(content.beside(xml::SOURCE, &name)?.path);
        }
        Ok(files)
    }
}
