//! A surface on its way to a file: piece by piece as it is found, or, where it is smoothed, when all of it is.

use super::IsosurfaceOptions;
use crate::cpu::mesh::{Field, Lattice, MeshReport, WholeMesh, extract};
use crate::explore::batch::Work;
use crate::explore::error::ExploreError;
use crate::explore::export::mesh::{MeshAbout, MeshFile, MeshFormat};
use std::path::Path;

/// Where a surface is looked for.
pub(super) struct Searched<'a> {
    /// The data, for messages.
    pub path: &'a Path,
    pub lattice: &'a Lattice,
    /// Cells along an edge of a brick.
    pub side: usize,
    /// The first cell of each brick.
    pub bricks: &'a [[u32; 3]],
}

/// Finds and writes a surface: what it is, and the size of its file, bytes. `None` where there is none; no file is
/// written then.
pub(super) fn write_surface<F: Field<Error = ExploreError>>(
    field: &F,
    searched: Searched,
    options: &IsosurfaceOptions,
    about: &MeshAbout,
    (format, out): (MeshFormat, &Path),
    work: Work,
) -> Result<Option<(MeshReport, u64)>, ExploreError> {
    let Searched { path, lattice, side, bricks } = searched;
    let failed = |source| ExploreError::io(out, "writing", source);
    let mut file = MeshFile::create(format, out, about).map_err(failed)?;
    let mut whole = (options.smooth > 0).then(WholeMesh::default);
    work.progress.begin("finding the surface", bricks.len() as u64);
    let mut mesh =
        extract(lattice, (side, bricks), options.isovalue, field, work.progress, |piece| match &mut whole {
            None => file.write(piece).map_err(failed),
            Some(whole) => {
                let is_counted = whole.take(piece);
                if is_counted && whole.memory() <= options.memory {
                    return Ok(());
                }
                let found = format!("a mesh that takes more than {} bytes of memory", options.memory);
                Err(ExploreError::malformed(path, "--smooth", found, "a smaller one, or more memory (--memory)"))
            }
        })?;
    if mesh.triangles == 0 {
        return Ok(None);
    }
    if let Some(mut whole) = whole {
        work.go_on()?;
        work.progress.begin("smoothing", options.smooth.into());
        mesh = whole.smooth(options.smooth, mesh, || {
            work.progress.advance(1);
            work.go_on()
        })?;
        file.write(&whole.into_piece()).map_err(failed)?;
    }
    let bytes = file.finish(out).map_err(failed)?;
    Ok(Some((mesh, bytes)))
}
