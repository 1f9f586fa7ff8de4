//! The surface on which a field is an isovalue, as a mesh in a file. The field is the density of particles,
//! `sum m_i W(|x - x_i|, h_i)` (F12 equation 3.1) with each particle's own smoothing length, the mean of one of their
//! columns `A`, `sum V_i A_i W / sum V_i W` with `V_i = m_i / rho_i` (equation 3.2 by the share of space that is filled), or
//! what a volume's samples are (`grids`). A mean ends, and closes the surface, where less than
//! [`LEAST_FILLED`](crate::cpu::volume::attributes::LEAST_FILLED) of space is filled, as it does in pictures.
//!
//! Nothing is held in memory but pages within a budget, a few bricks of the lattice on which the field is summed up, and
//! the front between bricks; vertices and triangles are written as they are found, but where the surface is smoothed
//! (`output`). A periodic box is gone round: particles at a face add to the field at the opposite one (`periodic`).

mod bricks;
mod grids;
mod output;
mod particles;
mod periodic;
#[cfg(test)]
mod tests;

use super::batch::Work;
use super::data::Data;
use super::error::ExploreError;
use super::export::mesh::{MeshAbout, MeshFormat};
use super::region::Region;
use crate::cpu::mesh::{BRICK, Faces, Lattice, MeshReport, Samples};
use crate::model::Bounds;
use crate::store::Tree;
use bricks::{Level, ParticleField, Plan, Planned};
pub use grids::{ReadGrid, isosurface_of_grid};
use output::{Searched, write_surface};
use particles::{Particles, Survey};
use periodic::PeriodicSpace;
use serde::Serialize;
use std::path::Path;

/// The surface that is wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct IsosurfaceOptions {
    /// The density on it, mass unit per cubed length unit; positive. Of a column or a volume the value on it.
    pub isovalue: f64,
    /// The column of particles whose mean, weighted with volume, is the field; the density where none is said.
    pub field: Option<String>,
    /// From a point of the lattice to the next, length unit; half the median smoothing length near the isovalue where
    /// it is not said.
    pub spacing: Option<f64>,
    /// Cells that are looked into, at most: those of bricks that the surface may pass.
    pub most_cells: u64,
    /// Bytes of memory for pages and bricks, and for a mesh that is smoothed.
    pub memory: u64,
    /// The attribute whose mean vertices have, weighted with mass, or with volume where the field is a column; of a volume
    /// the channel that has the surface.
    pub attribute: Option<String>,
    /// Whether the surface is open where a periodic box or a volume ends; flat caps close it otherwise.
    pub is_open: bool,
    /// Steps of smoothing (Taubin 1995); 0 for none.
    pub smooth: u32,
}

/// A surface that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Isosurface {
    /// The value on it.
    pub isovalue: f64,
    /// The lattice's, length unit; of a volume the edge of a cube as large as its cells.
    pub spacing: f64,
    /// The spacing that the data asks for, where that would be too many cells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finer_spacing: Option<f64>,
    /// Cells of the bricks that were looked into.
    pub cells: u64,
    /// Particles whose field it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub particles: Option<u64>,
    /// Samples of the volume whose values it is of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<u64>,
    /// Steps in which it was smoothed.
    pub smoothed: u32,
    /// What it is.
    #[serde(flatten)]
    pub mesh: MeshReport,
    /// Size of the file, bytes.
    pub bytes: u64,
}

/// Writes the surface of the particles in a region to the file `out`. Kernels and distances in the region go around a
/// periodic box of edge `periodic`, from the origin on, or none.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read, there is no such surface, it needs more cells than are allowed, or the
/// file cannot be written; a file that was there before stays as it was.
pub fn isosurface(
    tree: &dyn Tree,
    (region, periodic): (&Region, Option<f64>),
    options: &IsosurfaceOptions,
    (format, out): (MeshFormat, &Path),
    work: Work,
) -> Result<Isosurface, ExploreError> {
    isosurface_in_bricks(tree, (region, periodic), options, (format, out), BRICK, work)
}

/// Bytes of memory that bricks of the field of a column or of another one take, with or without an attribute, however few
/// [`IsosurfaceOptions::memory`] is; what pages have is the rest of it.
pub fn memory_of_bricks(is_of_column: bool, has_attribute: bool) -> u64 {
    memory_of_bricks_of(BRICK, is_of_column, has_attribute)
}

fn memory_of_bricks_of(side: usize, is_of_column: bool, has_attribute: bool) -> u64 {
    2 * rayon::current_num_threads() as u64 * Samples::memory(side, is_of_column, has_attribute)
}

fn isosurface_in_bricks(
    tree: &dyn Tree,
    (region, periodic): (&Region, Option<f64>),
    options: &IsosurfaceOptions,
    (format, out): (MeshFormat, &Path),
    side: usize,
    work: Work,
) -> Result<Isosurface, ExploreError> {
    let IsosurfaceOptions { isovalue, memory, .. } = *options;
    let (column, attribute) = (options.field.as_deref(), options.attribute.as_deref());
    let of_bricks = memory_of_bricks_of(side, column.is_some(), attribute.is_some());
    let most_bytes = memory.saturating_sub(of_bricks);
    let particles = Particles::new(tree, (region, periodic), (column, attribute), most_bytes, work)?;
    let (leaves, survey) = particles.survey(isovalue)?;
    let level = match column {
        None => Level::Density(isovalue),
        Some(_) => Level::Mean { isovalue, least_filled: survey.least_filled() },
    };
    let has_attribute = attribute.is_some();
    let periodic = periodic.map(|edge| PeriodicSpace { edge });
    if let Some(PeriodicSpace { edge }) = periodic.filter(|periodic| survey.longest > 0.5 * periodic.edge) {
        let expected = format!("at most half the edge {edge} of the periodic box, or --no-wrap");
        return Err(ExploreError::malformed(tree.path(), "smoothing length", survey.longest, expected));
    }
    let faces = match (periodic, options.is_open) {
        (None, _) => Faces::Open,
        (Some(_), true) => Faces::Cut,
        (Some(_), false) => Faces::Capped,
    };
    let lattice = Lattice { origin: survey.bounds.min, spacing: 1.0, cells: [1; 3] };
    let (particles, leaves) = (&particles, leaves.as_slice());
    let field = ParticleField { particles, leaves, lattice, level, side, has_attribute, periodic, faces };
    let (field, plan, wanted) = fine_enough(field, &survey, options, tree, work)?;
    let spacing = field.lattice.spacing;
    let (length_unit, mass_unit) = (&tree.metadata().length_unit, &tree.metadata().mass_unit);
    let bounds = periodic.map_or(survey.bounds, PeriodicSpace::bounds);
    let unit = match column {
        None => format!("{mass_unit} / ({length_unit})^3"),
        Some(name) => Data::Pages(tree).unit_of(name).unwrap_or_default().to_string(),
    };
    let weight = if column.is_some() { "volume" } else { "mass" };
    let about = MeshAbout {
        isovalue,
        spacing,
        length_unit,
        quantity: column.unwrap_or("density"),
        unit: &unit,
        attribute: attribute.map(|name| (name, weight)),
        is_double: needs_doubles(bounds, spacing),
        smooth: options.smooth,
    };
    let planned = Planned { field: &field, plan: &plan };
    let searched = Searched { path: tree.path(), lattice: &field.lattice, side, bricks: &plan.bricks };
    let Some((mesh, bytes)) = write_surface(&planned, searched, options, &about, (format, out), work)? else {
        let quantity = column.unwrap_or("density");
        let largest = survey.largest as f32;
        // Between the points of a coarse lattice there may be more.
        let expected = match isovalue < survey.largest {
            true => format!(
                "less, or a finer --spacing than {spacing}: particles have up to {largest}, and its points less than the isovalue"
            ),
            false => format!("less than the largest {quantity}; particles have up to {largest}"),
        };
        return Err(ExploreError::malformed(tree.path(), "--isovalue", isovalue, expected));
    };
    Ok(Isosurface {
        isovalue,
        spacing,
        finer_spacing: (wanted < spacing).then_some(wanted),
        cells: cells_of(plan.bricks.len(), side),
        particles: Some(survey.count),
        samples: None,
        smoothed: options.smooth,
        mesh,
        bytes,
    })
}

/// The field on a lattice with the spacing that is asked for, or that the data asks for, or the next coarser one that
/// needs no more cells than are allowed; which bricks to look into; and the spacing that was asked for.
fn fine_enough<'a>(
    field: ParticleField<'a>,
    survey: &Survey,
    options: &IsosurfaceOptions,
    tree: &dyn Tree,
    work: Work,
) -> Result<(ParticleField<'a>, Plan, f64), ExploreError> {
    let Some(length) = survey.median_smoothing_length() else {
        return Err(ExploreError::missing(tree.path(), "particles", "some with a mass and a smoothing length"));
    };
    let wanted = options.spacing.unwrap_or(0.5 * length);
    let most = options.most_cells / cells_of(1, field.side);
    let mut spacing = wanted;
    loop {
        work.progress.begin("looking for the surface", 0);
        let lattice = match field.periodic {
            None => Lattice::around(survey.bounds, spacing),
            Some(periodic) => periodic.lattice(spacing),
        };
        if let Some(lattice) = lattice {
            let field = ParticleField { lattice, ..field };
            if let Some(plan) = field.plan(most.max(1))? {
                return Ok((field, plan, wanted));
            }
        } else if !(spacing > 0.0 && survey.bounds.size().is_finite()) {
            return Err(ExploreError::malformed(tree.path(), "extent", survey.bounds.size(), "finite lengths"));
        }
        if options.spacing.is_some() {
            let expected = format!("a coarser one, or more cells than {}: --cells", options.most_cells);
            return Err(ExploreError::malformed(tree.path(), "--spacing", spacing, expected));
        }
        spacing *= std::f64::consts::SQRT_2;
    }
}

/// Cells of so many bricks.
fn cells_of(bricks: usize, side: usize) -> u64 {
    bricks as u64 * (side as u64).pow(3)
}

/// Whether single precision tells less than a hundredth of the lattice's spacing at the edge of the data.
fn needs_doubles(bounds: Bounds, spacing: f64) -> bool {
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    farthest * f64::from(f32::EPSILON) > 0.01 * spacing
}
