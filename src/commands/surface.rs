//! `deepfield surface`: the surface of a density of particles, as a mesh.

use super::arguments::{bytes, count, positive};
use super::cache::page_file_of;
use super::heights;
use super::probe::short;
use super::region_options::{At, Opened, RegionOptions};
use super::statistics::write_json;
use super::{CommandResult, progress_bar::TerminalProgress, usage};
use crate::explore::{Isosurface, IsosurfaceOptions, MeshFormat, Work, isosurface};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::step_at;
use crate::look::{DataKind, data_file, is_field};
use crate::model::{ReadMethod, Unit, When};
use crate::store::Tree;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Writes the surface on which the density of particles is an isovalue as a mesh of triangles, closed and of any size.
///
/// The density is the sum of the particles' kernels, each with its own smoothing length, on a lattice of points. It is
/// summed up only near the surface, a brick of the lattice at a time, so that neither the particles nor the mesh need
/// to fit in memory. Of a source the page file in the cache is used, which is built first where there is none.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield surface snapshot_099.hdf5 --isovalue 1e-4 -o merger.ply
  deepfield surface galaxy.df --isovalue 10 --family gas --attribute temperature -o gas.ply
  deepfield surface galaxy.df --isovalue 10 --sphere 21.9,39.0,33.1,1.5 --spacing 0.01 -o halo.stl
  deepfield surface run.df --time last --isovalue 1e-4 -o last.obj --json -")]
pub struct Arguments {
    /// The source, page file or run.
    pub path: PathBuf,
    /// The density on the surface, in the data's unit of mass per cube of its unit of length.
    #[arg(long, value_name = "DENSITY", value_parser = positive)]
    pub isovalue: f64,
    /// From a point of the lattice to the next, in the data's unit of length [default: half the median smoothing length
    /// of particles with densities near the isovalue, or as much more as --cells asks for].
    #[arg(long, value_name = "LENGTH", value_parser = positive)]
    pub spacing: Option<f64>,
    /// Cells of the lattice that are looked into, at most: those of bricks that the surface may pass.
    #[arg(long, value_name = "N", value_parser = count, default_value = "1e9")]
    pub cells: u64,
    /// Memory for pages and for bricks of the lattice.
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value = "1GiB")]
    pub memory: u64,
    /// The attribute whose mean, weighted with mass, vertices have as `value`; .ply alone holds it.
    #[arg(long, value_name = "NAME")]
    pub attribute: Option<String>,
    /// When, of a run: a time, step:12, z:1.5, a:0.4 or last; between steps the one before [default: the first step].
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub time: Option<When>,
    /// Which particles have a density [default: all].
    #[command(flatten)]
    pub region: RegionOptions,
    /// Write what the surface is as JSON to a file, or to standard output for `-`.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// The mesh: .ply, .obj or .stl.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// What is told of a surface.
#[derive(Serialize)]
struct Told<'a> {
    path: &'a Path,
    length_unit: &'a Unit,
    mass_unit: &'a Unit,
    #[serde(flatten)]
    surface: &'a Isosurface,
    seconds: f64,
}

/// Finds and writes the surface.
///
/// # Errors
/// When the data cannot be read, has no such surface, or the file cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, isovalue, spacing, cells, memory, attribute, time, region, json, output } = arguments;
    heights::refuse(path, "particles")?;
    let format = MeshFormat::of(output)
        .ok_or_else(|| format!("{}: expected a name that ends in .ply, .obj or .stl", output.display()))?;
    if attribute.is_some() && format != MeshFormat::Ply {
        return Err(usage(format!("{}: --attribute: expected a name that ends in .ply", output.display())));
    }
    let start = Instant::now();
    let progress = TerminalProgress::new();
    let opened = open(path, *time, &progress)?;
    let Opened::Pages(file) = &opened else {
        let expected = "a page file, a source, or a run that keeps its stills";
        return Err(format!("{}: content: found tracks alone, expected {expected}", path.display()).into());
    };
    let tree: &dyn Tree = &**file;
    let chosen = region.region(opened.data())?;
    let periodic = region.periodic(opened.data())?;
    let options = IsosurfaceOptions {
        isovalue: *isovalue,
        spacing: *spacing,
        most_cells: *cells,
        memory: *memory,
        attribute: attribute.clone(),
    };
    let surface = isosurface(tree, (&chosen, periodic), &options, (format, output), Work::told(&progress))?;
    drop(progress);
    let (length_unit, mass_unit) = (&tree.metadata().length_unit, &tree.metadata().mass_unit);
    if let Some(finer) = surface.finer_spacing {
        let (own, finer) = (short(surface.spacing), short(finer));
        eprintln!(
            "deepfield: {}: spacing {own}, not {finer} as the data has it: {cells} cells at most (--cells)",
            path.display()
        );
    }
    if let Some(json) = json {
        let seconds = start.elapsed().as_secs_f64();
        write_json(json, &Told { path, length_unit, mass_unit, surface: &surface, seconds })?;
        // Standard output is the JSON's alone.
        if json == Path::new("-") {
            return Ok(());
        }
    }
    let Isosurface { mesh, spacing, .. } = &surface;
    let closed = match mesh.boundary_edges {
        0 => "closed".to_owned(),
        edges => format!("{edges} edges at its boundary"),
    };
    let parts = if mesh.components == 1 { "1 part".to_owned() } else { format!("{} parts", mesh.components) };
    println!("{} triangles, {} vertices in {}: {closed}, {parts}", mesh.triangles, mesh.vertices, output.display());
    let (volume, area, spacing) = (short(mesh.volume), short(mesh.area), short(*spacing));
    println!("volume {volume}, area {area}, on a lattice of spacing {spacing}; lengths in {length_unit}");
    Ok(())
}

/// Opens the page file of what the path names; of a run the step at or before a time.
fn open(path: &Path, time: Option<When>, progress: &TerminalProgress) -> Result<Opened, Failure> {
    let (path, method) = (data_file(path)?, ReadMethod::default());
    if DataKind::of(&path)? != DataKind::Source {
        let interpolation = Some(Interpolation::Hold);
        return Opened::open(&path, At { time, interpolation }, method);
    }
    if is_field(&path) {
        return Err(format!("{}: content: found an image or a volume, expected particles", path.display()).into());
    }
    if let Some(when) = time
        && let Some(step) = step_at(&path, when, method)?
    {
        return Opened::open(&page_file_of(&step, progress)?, At::default(), method);
    }
    Opened::open(&page_file_of(&path, progress)?, At { time, interpolation: None }, method)
}
