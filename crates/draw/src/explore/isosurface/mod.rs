//! The surface on which the density of particles is an isovalue, as a mesh in a file: `sum m_i W(|x - x_i|, h_i)` (F12
//! equation 3.1) with each particle's own smoothing length.
//!
//! Nothing is held in memory but pages within a budget, a few bricks of the lattice on which the density is summed up,
//! and the front between bricks; vertices and triangles are written as they are found. A periodic box is not gone
//! round: what leaves it is closed where the kernels end.

mod bricks;
mod particles;
#[cfg(test)]
mod tests;

use super::batch::Work;
use super::error::ExploreError;
use super::export::mesh::{MeshAbout, MeshFile, MeshFormat};
use super::region::Region;
use crate::cpu::mesh::{BRICK, Lattice, MeshReport, Samples, extract};
use crate::model::Bounds;
use crate::store::Tree;
use bricks::{Density, Plan, Planned};
use particles::{Particles, Survey};
use serde::Serialize;
use std::path::Path;

/// The surface that is wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct IsosurfaceOptions {
    /// The density on it, mass unit per cubed length unit; positive.
    pub isovalue: f64,
    /// From a point of the lattice to the next, length unit; half the median smoothing length near the isovalue where
    /// it is not said.
    pub spacing: Option<f64>,
    /// Cells that are looked into, at most: those of bricks that the surface may pass.
    pub most_cells: u64,
    /// Bytes of memory for pages and bricks.
    pub memory: u64,
    /// The attribute whose mean, weighted with mass, vertices have.
    pub attribute: Option<String>,
}

/// A surface that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Isosurface {
    /// The density on it.
    pub isovalue: f64,
    /// The lattice's, length unit.
    pub spacing: f64,
    /// The spacing that the data asks for, where that would be too many cells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finer_spacing: Option<f64>,
    /// Cells of the bricks that were looked into.
    pub cells: u64,
    /// Particles whose density it is.
    pub particles: u64,
    /// What it is.
    #[serde(flatten)]
    pub mesh: MeshReport,
    /// Size of the file, bytes.
    pub bytes: u64,
}

/// Writes the surface of the particles in a region to the file `out`. Distances in the region go around a periodic box
/// of edge `periodic` or none.
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

fn isosurface_in_bricks(
    tree: &dyn Tree,
    (region, periodic): (&Region, Option<f64>),
    options: &IsosurfaceOptions,
    (format, out): (MeshFormat, &Path),
    side: usize,
    work: Work,
) -> Result<Isosurface, ExploreError> {
    let IsosurfaceOptions { isovalue, memory, .. } = *options;
    let attribute = options.attribute.as_deref();
    let of_bricks = 2 * rayon::current_num_threads() as u64 * Samples::memory(side, attribute.is_some());
    let particles = Particles::new(tree, (region, periodic), attribute, memory.saturating_sub(of_bricks), work)?;
    let (leaves, survey) = particles.survey(isovalue)?;
    let has_attribute = attribute.is_some();
    let lattice = Lattice { origin: survey.bounds.min, spacing: 1.0, cells: [1; 3] };
    let density = Density { particles: &particles, leaves: &leaves, lattice, isovalue, side, has_attribute };
    let (density, plan, wanted) = fine_enough(density, &survey, options, tree, work)?;
    let spacing = density.lattice.spacing;
    let about = MeshAbout {
        isovalue,
        spacing,
        length_unit: &tree.metadata().length_unit,
        mass_unit: &tree.metadata().mass_unit,
        attribute,
        is_double: needs_doubles(survey.bounds, spacing),
    };
    let failed = |source| ExploreError::io(out, "writing", source);
    let mut file = MeshFile::create(format, out, &about).map_err(failed)?;
    work.progress.begin("finding the surface", plan.bricks.len() as u64);
    let planned = Planned { density: &density, plan: &plan };
    let mesh = extract(&density.lattice, (side, &plan.bricks), isovalue, &planned, work.progress, |piece| {
        file.write(piece).map_err(failed)
    })?;
    if mesh.triangles == 0 {
        let expected = format!("less than the largest density; particles have up to {}", survey.densest);
        return Err(ExploreError::malformed(tree.path(), "--isovalue", isovalue, expected));
    }
    let bytes = file.finish(out).map_err(failed)?;
    Ok(Isosurface {
        isovalue,
        spacing,
        finer_spacing: (wanted < spacing).then_some(wanted),
        cells: cells_of(plan.bricks.len(), side),
        particles: survey.count,
        mesh,
        bytes,
    })
}

/// The density on a lattice with the spacing that is asked for, or that the data asks for, or the next coarser one that
/// needs no more cells than are allowed; which bricks to look into; and the spacing that was asked for.
fn fine_enough<'a>(
    density: Density<'a>,
    survey: &Survey,
    options: &IsosurfaceOptions,
    tree: &dyn Tree,
    work: Work,
) -> Result<(Density<'a>, Plan, f64), ExploreError> {
    let Some(length) = survey.median_smoothing_length() else {
        return Err(ExploreError::missing(tree.path(), "particles", "some with a mass and a smoothing length"));
    };
    let wanted = options.spacing.unwrap_or(0.5 * length);
    let most = options.most_cells / cells_of(1, density.side);
    let mut spacing = wanted;
    loop {
        work.progress.begin("looking for the surface", 0);
        if let Some(lattice) = Lattice::around(survey.bounds, spacing) {
            let density = Density { lattice, ..density };
            if let Some(plan) = density.plan(most.max(1))? {
                return Ok((density, plan, wanted));
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
