//! Synthetic images and volumes as files: NRRD, or NumPy arrays where the name says so. Rows are written as they are made, so that memory does
//! not grow with the grid.

use super::files::WriteError;
use super::grids::SyntheticGrid;
use crate::import::grid::head::{npy_head, nrrd_head};
use crate::model::new_file;
use crate::model::progress::Progress;
use crate::store::temporary::{folder_of, free_bytes};
use rayon::prelude::*;
use std::io::{Error, ErrorKind, Write};
use std::path::Path;

/// Bytes that are made together.
const CHUNK: u64 = 8 << 20;

/// Writes a grid; nothing is left behind on failure.
///
/// # Errors
/// [`WriteError`] names the file and the cause; before anything is written where the disk has too little room.
pub fn write(grid: &SyntheticGrid, path: &Path, progress: &dyn Progress) -> Result<(), WriteError> {
    let fail = |source: Error| WriteError { path: path.to_owned(), source };
    let [width, height, depth] = grid.shape();
    let row = width.checked_mul(grid.sample_type().size() as u64);
    let rows = height.checked_mul(depth);
    let needed = row.zip(rows).and_then(|(row, rows)| row.checked_mul(rows)).filter(|bytes| *bytes < 1 << 62);
    let (Some(needed), Some(rows)) = (needed, rows) else {
        return Err(fail(Error::new(ErrorKind::InvalidInput, "more samples than a file can hold")));
    };
    let folder = folder_of(path);
    if let Some(free) = free_bytes(folder).filter(|free| needed > *free) {
        let message = format!("takes {} MiB, and the disk has {} MiB left", needed >> 20, free >> 20);
        return Err(fail(Error::new(ErrorKind::StorageFull, message)));
    }
    let mut file = new_file::builder().tempfile_in(folder).map_err(fail)?;
    let is_array = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("npy"));
    let about = grid.grid();
    let head = if is_array { npy_head(&about, true) } else { nrrd_head(&about, true).into_bytes() };
    file.write_all(&head).map_err(fail)?;
    progress.begin("writing rows", rows);
    // So many rows in a part, and so many parts at a time, that all threads have some.
    let part = (CHUNK / 16 / (needed / rows).max(1)).max(1);
    let mut first = 0;
    while first < rows {
        let end = rows.min(first + 16 * part);
        let parts: Vec<Vec<u8>> = (0..(end - first).div_ceil(part))
            .into_par_iter()
            .map(|number| {
                let start = first + number * part;
                let mut bytes = Vec::new();
                (start..end.min(start + part)).for_each(|row| grid.row(row, &mut bytes));
                bytes
            })
            .collect();
        parts.iter().try_for_each(|bytes| file.write_all(bytes)).map_err(fail)?;
        progress.advance(end - first);
        first = end;
    }
    file.persist(path).map_err(|error| fail(error.error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::super::grids::Kind;
    use super::*;
    use crate::import::grid::{GridOptions, open_grid};

    #[test]
    fn files_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        for (kind, dimensions, shape) in [
            (Kind::Blobs, 3, [40, 30, 20]),
            (Kind::Plateaus, 2, [50, 40, 1]),
            (Kind::Edge { angle: 22.5 }, 2, [30, 20, 1]),
            (Kind::Wave { level: 2, direction: 11, angle: 10.0 }, 3, [20, 24, 28]),
        ] {
            let grid = SyntheticGrid::new(kind, dimensions, shape, 3);
            let mut expected = Vec::new();
            (0..shape[1] * shape[2]).for_each(|row| grid.row(row, &mut expected));
            for name in ["grid.nrrd", "grid.npy", "grid"] {
                let path = folder.path().join(name);
                write(&grid, &path, &()).unwrap();
                let source = open_grid(&path, &GridOptions::default()).unwrap();
                assert_eq!((source.grid().shape, source.grid().dimensions), (shape, dimensions), "{name}");
                assert_eq!(source.grid().sample_type, grid.sample_type());
                let mut bytes = vec![0; expected.len()];
                source.read(&source.grid().region(), &mut bytes).unwrap();
                assert!(cfg!(target_endian = "big") || bytes == expected, "{name}");
            }
        }
    }
}
