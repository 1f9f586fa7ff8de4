//! `deepfield surface`: the surface of a density or a field of particles, or of a volume's values, as a mesh.

use super::arguments::{bytes, count, positive};
use super::cache::page_file_of;
use super::heights;
use super::probe::short;
use super::region_options::{At, RegionOptions};
use super::statistics::write_json;
use super::{CommandResult, print_line, progress_bar::TerminalProgress, usage};
use crate::explore::{
    Isosurface, IsosurfaceOptions, MeshFormat, Opened, ReadGrid, Work, isosurface, isosurface_of_grid, memory_of_bricks,
};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::{GridOptions, open_grid, step_at};
use crate::look::{DataKind, data_file, is_field};
use crate::model::{Channel, ReadMethod, Unit, When};
use crate::store::{GridFile, Tree};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Writes the surface on which the density of particles, another of their fields, or a volume's value is an isovalue as a
/// mesh of triangles, closed and of any size.
///
/// The density is the sum of the particles' kernels, each with its own smoothing length, on a lattice of points. It is
/// summed up only near the surface, a brick of the lattice at a time, so that neither the particles nor the mesh need
/// to fit in memory. Of a source the page file in the cache is used, which is built first where there is none. A periodic
/// box is gone round: particles at a face add to the density at the opposite one. Another field (--field) is the mean of
/// the particles' values, weighted with volume and kernel; the surface closes where they fill less than 1 % of space.
///
/// Of a volume, built or not, the lattice is that of its samples, which are read in blocks.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield surface snapshot_099.hdf5 --isovalue 1e-4 -o merger.ply
  deepfield surface galaxy.df --isovalue 10 --family gas --attribute temperature -o gas.ply
  deepfield surface galaxy.df --field temperature --isovalue 1e5 -o hot.ply     what is hotter than that
  deepfield surface galaxy.df --isovalue 10 --sphere 21.9,39.0,33.1,1.5 --spacing 0.01 -o halo.stl
  deepfield surface run.df --time last --isovalue 1e-4 -o last.obj --json -
  deepfield surface box.df --isovalue 30 --open -o tile.ply          what meets at opposite faces of the box is the same
  deepfield surface head.nrrd --isovalue 300 --smooth 10 -o skull.stl
  deepfield surface cube.fits --isovalue -0.5 --attribute velocity -o gas.ply    of a volume: another of its channels")]
pub struct Arguments {
    /// The source, page file or run, or the URL of a built file.
    pub path: PathBuf,
    /// The density on the surface, in the data's unit of mass per cube of its unit of length; of a field or a volume the
    /// value on it.
    #[arg(long, value_name = "VALUE", value_parser = finite, allow_hyphen_values = true)]
    pub isovalue: f64,
    /// The field of particles that has the surface: an attribute, mass, density or smoothing-length [default: density].
    /// What has higher values is within.
    #[arg(long, value_name = "NAME")]
    pub field: Option<String>,
    /// From a point of the lattice to the next, in the data's unit of length [default: half the median smoothing length
    /// of particles with densities near the isovalue, or with values of the field that are not below it; or as much more
    /// as --cells asks for]. Volumes have their own.
    #[arg(long, value_name = "LENGTH", value_parser = positive)]
    pub spacing: Option<f64>,
    /// Cells of the lattice that are looked into, at most: those of bricks that the surface may pass.
    #[arg(long, value_name = "N", value_parser = count, default_value = "1e9")]
    pub cells: u64,
    /// Memory for pages and for bricks of the lattice, and for a mesh that is smoothed. Where bricks alone take more, that is said.
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value = "1GiB")]
    pub memory: u64,
    /// The attribute whose mean, weighted with mass, or with volume beside --field, vertices have as `value`; .ply alone
    /// holds it. Of a volume the channel that has the surface [default: the first].
    #[arg(long, value_name = "NAME")]
    pub attribute: Option<String>,
    /// Leave the surface open at the faces of a periodic box or a volume; flat caps close it otherwise. What meets at
    /// opposite faces of a periodic box has the same vertices, to the last bit.
    #[arg(long)]
    pub open: bool,
    /// Steps of smoothing that keeps the volume (Taubin's filter). The mesh is in memory then: about 200 bytes for each
    /// vertex.
    #[arg(long, value_name = "STEPS", default_value_t = 0)]
    pub smooth: u32,
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
    #[serde(skip_serializing_if = "Option::is_none")]
    mass_unit: Option<&'a Unit>,
    #[serde(skip_serializing_if = "Option::is_none")]
    field: Option<QuantityTold<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    channel: Option<QuantityTold<'a>>,
    #[serde(flatten)]
    surface: &'a Isosurface,
    seconds: f64,
}

/// The field of particles or the channel of a volume that has the surface.
#[derive(Serialize)]
struct QuantityTold<'a> {
    name: &'a str,
    unit: &'a Unit,
}

/// Finds and writes the surface.
///
/// # Errors
/// When the data cannot be read, has no such surface, or the file cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, isovalue, cells, attribute, time, region, output, .. } = arguments;
    heights::refuse(path, "particles or a volume")?;
    let format = MeshFormat::of(output)
        .ok_or_else(|| format!("{}: expected a name that ends in .ply, .obj or .stl", output.display()))?;
    let named = data_file(path)?;
    if is_field(&named) {
        arguments.tell_of_memory(false);
        return of_grid(arguments, &named, format);
    }
    let field = arguments.field();
    if field.is_none() && *isovalue <= 0.0 {
        return Err(usage(format!("{}: --isovalue: found {isovalue}, expected a density above 0", path.display())));
    }
    if attribute.is_some() && format != MeshFormat::Ply {
        return Err(usage(format!("{}: --attribute: expected a name that ends in .ply", output.display())));
    }
    arguments.tell_of_memory(attribute.is_some());
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
    let options = arguments.options();
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
    let seconds = start.elapsed().as_secs_f64();
    let unit = field.and_then(|name| opened.data().unit_of(name)).unwrap_or_default();
    let field = field.map(|name| QuantityTold { name, unit: &unit });
    let told = Told { path, length_unit, mass_unit: Some(mass_unit), field, channel: None, surface: &surface, seconds };
    arguments.tell(&told)
}

/// Finds and writes the surface of a volume.
fn of_grid(arguments: &Arguments, path: &Path, format: MeshFormat) -> CommandResult {
    let Arguments { spacing, time, region, output, .. } = arguments;
    let own = [("--field", arguments.field.is_some()), ("--spacing", spacing.is_some()), ("--time", time.is_some())];
    if let Some((name, _)) = own.into_iter().chain(region.given()).find(|(_, is_given)| *is_given) {
        return Err(usage(format!("{}: {name}: found an image or a volume, expected particles", path.display())));
    }
    let start = Instant::now();
    let progress = TerminalProgress::new();
    let source: Box<dyn ReadGrid> = match DataKind::of(path)? {
        DataKind::Grid => Box::new(GridFile::open(path, ReadMethod::default())?),
        _ => Box::new(open_grid(path, &GridOptions::default())?),
    };
    let options = arguments.options();
    let surface = isosurface_of_grid(&*source, &options, (format, output), Work::told(&progress))?;
    drop(progress);
    let (grid, seconds) = (source.grid(), start.elapsed().as_secs_f64());
    let is_named = |channel: &&Channel| arguments.attribute.as_ref().is_none_or(|name| channel.name == *name);
    let channel = grid.channels.iter().find(is_named);
    arguments.tell(&Told {
        path: &arguments.path,
        length_unit: &grid.length_unit,
        mass_unit: None,
        field: None,
        channel: channel.map(|channel| QuantityTold { name: &channel.name, unit: &channel.unit }),
        surface: &surface,
        seconds,
    })
}

impl Arguments {
    /// Says where bricks take more memory than is allowed.
    fn tell_of_memory(&self, has_attribute: bool) {
        let least = memory_of_bricks(self.field().is_some(), has_attribute);
        let (path, found) = (self.path.display(), self.memory);
        if found < least {
            eprintln!(
                "deepfield: {path}: --memory: found {found} bytes, bricks take {least} with {} threads, and pages one at a time",
                rayon::current_num_threads()
            );
        }
    }

    /// The field of particles, where it is not the density.
    fn field(&self) -> Option<&str> {
        self.field.as_deref().filter(|name| *name != "density")
    }

    fn options(&self) -> IsosurfaceOptions {
        IsosurfaceOptions {
            isovalue: self.isovalue,
            field: self.field().map(str::to_owned),
            spacing: self.spacing,
            most_cells: self.cells,
            memory: self.memory,
            attribute: self.attribute.clone(),
            is_open: self.open,
            smooth: self.smooth,
        }
    }

    /// Tells what was written, as JSON where that is asked for.
    fn tell(&self, told: &Told) -> CommandResult {
        if let Some(json) = &self.json {
            write_json(json, told)?;
            // Standard output is the JSON's alone.
            if json == Path::new("-") {
                return Ok(());
            }
        }
        let (Isosurface { mesh, spacing, .. }, length_unit) = (told.surface, told.length_unit);
        let closed = match mesh.boundary_edges {
            0 => "closed".to_owned(),
            edges => format!("{edges} edges at its boundary"),
        };
        let parts = if mesh.components == 1 { "1 part".to_owned() } else { format!("{} parts", mesh.components) };
        let out = self.output.display();
        print_line(format_args!(
            "{} triangles, {} vertices in {out}: {closed}, {parts}",
            mesh.triangles, mesh.vertices
        ))?;
        let (volume, area, spacing) = (short(mesh.volume), short(mesh.area), short(*spacing));
        print_line(format_args!(
            "volume {volume}, area {area}, on a lattice of spacing {spacing}; lengths in {length_unit}"
        ))?;
        Ok(())
    }
}

/// A number.
fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| "expected a number".into())
}

/// Opens the page file of what the path names; of a run the step at or before a time.
fn open(path: &Path, time: Option<When>, progress: &TerminalProgress) -> Result<Opened, Failure> {
    let (path, method) = (data_file(path)?, ReadMethod::default());
    if DataKind::of(&path)? != DataKind::Source {
        let interpolation = Some(Interpolation::Hold);
        return At { time, interpolation }.open(&path, method);
    }
    if let Some(when) = time
        && let Some(step) = step_at(&path, when, method)?
    {
        return At::default().open(&page_file_of(&step, progress)?, method);
    }
    At { time, interpolation: None }.open(&page_file_of(&path, progress)?, method)
}
