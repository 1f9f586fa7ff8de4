//! Fields in any format of grids: values of a sample side by side are components, or each component is an array of its own in the file.
//! Several files are the times of a field.

use super::axis::Axis;
use super::field::{FieldOptions, Part, Stored};
use crate::import::ImportError;
use crate::import::grid::{GridOptions, GridSource, file_of_part, open_grid};
use crate::model::{Grid, ReadMethod};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Directions that differ by no more than this are the same.
const TURNED: f64 = 1e-6;

/// What files say of a field.
///
/// # Errors
/// [`ImportError`] where one cannot be read, holds no velocities, lies across the axes, or is unlike the first.
pub(super) fn stored(files: &[PathBuf], options: &FieldOptions, method: ReadMethod) -> Result<Stored, ImportError> {
    let named = |file: &Path, name: &str| {
        let mut path = file.as_os_str().to_owned();
        path.push(format!("#{name}"));
        PathBuf::from(path)
    };
    let open = |path: &Path| open_grid(path, &GridOptions { read: method, ..GridOptions::default() }).map(Arc::new);
    let mut steps: Vec<Vec<Part>> = Vec::with_capacity(files.len());
    let (mut first, mut bytes): (Option<Arc<GridSource>>, u64) = (None, 0);
    for file in files {
        let sources = match &options.components[..] {
            [] => vec![open(file)?],
            names => names.iter().map(|name| open(&named(file, name))).collect::<Result<_, _>>()?,
        };
        bytes += sources.first().map_or(0, |source| source.description().bytes);
        let mut components = 0;
        for source in &sources {
            let (grid, like) = (source.grid(), first.get_or_insert_with(|| Arc::clone(source)).grid());
            components += grid.channels.len();
            if grid.shape != like.shape || !grid.to_world.abs_diff_eq(like.to_world, 1e-9 * scale(like)) {
                let path = source.description().path.clone();
                let (found, expected) = (grid.described(), format!("{} at the same places", like.described()));
                return Err(ImportError::Unlike { path, found, expected });
            }
        }
        let dimensions = first.as_ref().map_or(3, |first| first.grid().dimensions);
        if !(2..=3).contains(&components) {
            let found =
                if components == 1 { "1 value a sample".to_owned() } else { format!("{components} values a sample") };
            let expected = "2 or 3, the components of a velocity; --components names their arrays";
            return Err(ImportError::malformed(
                file,
                if dimensions == 2 { "image" } else { "volume" },
                found,
                expected,
            ));
        }
        steps.push(sources.into_iter().map(|source| Part { source, first: 0 }).collect());
    }
    let (Some(first), Some(path)) = (first, files.first()) else {
        return Err(ImportError::missing(Path::new("field"), "files", "one at least"));
    };
    let (about, grid) = (first.description(), first.grid());
    Ok(Stored {
        path: file_of_part(path).to_owned(),
        format: about.format.clone(),
        bytes,
        nodes: nodes(path, grid)?,
        times: None,
        length_unit: grid.length_unit.clone(),
        notes: about.notes.clone(),
        steps,
    })
}

/// What places of a grid are measured against.
fn scale(grid: &Grid) -> f64 {
    grid.spacing().into_iter().fold(grid.to_world.translation.abs().max_element(), f64::max)
}

/// Where the nodes of a grid along the axes are.
fn nodes(path: &Path, grid: &Grid) -> Result<[(String, Vec<f64>); 3], ImportError> {
    let mut nodes = ["x", "y", "z"].map(|name| (name.to_owned(), vec![0.0]));
    for (axis, (name, own)) in nodes.iter_mut().enumerate().take(grid.dimensions) {
        let column = grid.to_world.matrix3.col(axis);
        let across = (0..3).filter(|other| *other != axis).map(|other| column[other].abs()).fold(0.0, f64::max);
        if across > TURNED * column[axis].abs() {
            let expected = "axes along x, y and z, as components of velocities are";
            return Err(ImportError::malformed(path, format!("direction of axis {name}"), column, expected));
        }
        *own = Axis::even(grid.to_world.translation[axis], column[axis], grid.shape[axis]);
    }
    Ok(nodes)
}
