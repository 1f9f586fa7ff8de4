//! Hierarchies side by side: the same particles in the same views, within the same numbers of splats, through each of them.

mod curves;
mod in_memory;
mod of_fields;
mod of_particles;
mod pictures;
mod report;
pub mod ways;

use super::Arguments;
use super::splat::Failure;
use crate::command_line::usage;
use crate::mode::Mode;
use crate::modes::{column_density, xray};
use crate::synth::grids::{self, SyntheticGrid};
use crate::synth::{Generator, clusters::Clusters, filaments::Filaments, gadget, grid_files};
use of_particles::Bench;
use report::write_csv;
use std::path::Path;
use ways::{Data, Way};

pub(super) use pictures::color_errors;
pub use pictures::{Camera, ColorError};
pub use report::{Best, Outcome, Report, Reports};

/// What is compared.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "bench-hierarchies")]
pub struct Options {
    /// Hierarchies that `bench hierarchies` compares [default: all that take the data's kind, but pca-gaussian, pca-disc and pca-pixel].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_enum)]
    pub hierarchies: Vec<Way>,
    /// Numbers of splats of `bench hierarchies`, as numbers or shares of the particles.
    #[arg(long, value_name = "N%,...", value_delimiter = ',', value_parser = budget, default_values = ["1%", "4%", "16%"])]
    pub budgets: Vec<Budget>,
    /// Views of `bench hierarchies`: the first is from above.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub views: u16,
}

/// A number of splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// So many.
    Splats(u64),
    /// A share of the particles.
    Share(f64),
}

fn budget(text: &str) -> Result<Budget, String> {
    let expected = || "expected a number of splats from 1, or a share of the particles such as 4%".to_owned();
    let number = |text: &str| text.parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
    match text.strip_suffix('%') {
        Some(share) => number(share).map(|share| Budget::Share(0.01 * share)).ok_or_else(expected),
        None => number(text).filter(|n| *n >= 1.0).map(|n| Budget::Splats(n as u64)).ok_or_else(expected),
    }
}

impl Budget {
    fn of(self, particles: u64) -> u64 {
        match self {
            Budget::Splats(splats) => splats,
            Budget::Share(share) => ((share * particles as f64) as u64).max(1),
        }
    }
}

/// Data that is made where none is named.
enum Made {
    /// A snapshot.
    Particles(Box<dyn Generator>),
    /// A volume, as `synth` makes it.
    Volume(SyntheticGrid),
}

/// Samples along the sides of volumes that are made: as many samples as particles, where that is quickly built and drawn.
const SIDES: [f64; 2] = [8.0, 64.0];

impl Made {
    /// All that is made, by its names for `synth`.
    fn all(arguments: &Arguments, particles: u64) -> [(&'static str, Made); 4] {
        let side = (particles as f64).cbrt().round().clamp(SIDES[0], SIDES[1]) as u64;
        let volume = |kind| Made::Volume(SyntheticGrid::new(kind, 3, [side; 3], arguments.seed));
        [
            ("filaments", Made::Particles(Box::new(Filaments::new(arguments.seed, particles)))),
            ("clusters", Made::Particles(Box::new(Clusters::new(arguments.seed, particles)))),
            ("wave", volume(grids::Kind::Wave { level: 2, direction: 0, angle: 0.0 })),
            ("blobs", volume(grids::Kind::Blobs)),
        ]
    }

    /// What it is, and the mode by whose sums it is compared.
    fn data(&self) -> (Data, &'static Mode) {
        match self {
            Made::Particles(_) => (Data::Particles, &column_density::MODE),
            Made::Volume(_) => (Data::Samples, &xray::MODE),
        }
    }

    /// Compares it by those of its hierarchies that are asked for.
    fn compare(&self, name: &str, arguments: &Arguments, folder: &Path) -> Result<Report, Failure> {
        let temporary = tempfile::tempdir()?;
        let source = temporary.path().join(name);
        let (data, _) = self.data();
        let asked = &arguments.hierarchies.hierarchies;
        let own: Vec<Way> = asked.iter().copied().filter(|way| way.takes(data)).collect();
        match self {
            Made::Particles(generator) => {
                let mut file = std::io::BufWriter::new(std::fs::File::create(&source)?);
                gadget::write(generator.as_ref(), &mut file, &())?;
                std::io::Write::flush(&mut file)?;
                let named = format!("synth {name} -n {}", generator.len());
                let ways = data.chosen(&own, &named)?;
                Bench::new(&source, named, arguments)?.run(&ways, folder)
            }
            Made::Volume(grid) => {
                grid_files::write(grid, &source, &())?;
                let [x, y, z] = grid.shape();
                let named = format!("synth {name} --size {x},{y},{z}");
                let ways = data.chosen(&own, &named)?;
                of_fields::compare(&source, named, &ways, arguments, folder)
            }
        }
    }
}

/// Compares hierarchies, writes pictures, differences and curves, and prints a table to standard error.
///
/// # Errors
/// When the data cannot be read or built, a hierarchy that is asked for does not take it, or a file cannot be written.
pub fn measure(arguments: &Arguments) -> Result<Reports, Failure> {
    // What is asked for on the command line; the default names all.
    if !arguments.backends.iter().any(|name| name == "cpu") {
        let found = arguments.backends.join(",");
        return Err(usage(format!("--backends: found {found}, expected cpu, which hierarchies are compared on")));
    }
    let folder = arguments.flight.output.as_deref().unwrap_or(Path::new("hierarchies"));
    let asked = &arguments.hierarchies.hierarchies;
    if let Some(path) = &arguments.path {
        let named = path.display().to_string();
        let data = Data::of(path)?;
        let ways = data.chosen(asked, &named)?;
        let report = match data {
            Data::Particles => {
                check_mode(&named, arguments.flight.mode, &column_density::MODE)?;
                Bench::new(path, named, arguments)?.run(&ways, folder)?
            }
            Data::Samples | Data::BuiltSamples => of_fields::compare(path, named, &ways, arguments, folder)?,
        };
        write_csv(arguments, std::slice::from_ref(&report))?;
        return Ok(Reports::One(Box::new(report)));
    }
    let particles = arguments.sizes.first().copied().unwrap_or(200_000);
    let mut reports = Vec::new();
    for (name, made) in Made::all(arguments, particles) {
        let (data, mode) = made.data();
        let is_taken = asked.is_empty() || asked.iter().any(|way| way.takes(data));
        if is_taken && arguments.flight.mode.is_none_or(|asked| asked.name == mode.name) {
            reports.push(made.compare(name, arguments, &folder.join(name))?);
        }
    }
    if let (true, Some(mode)) = (reports.is_empty(), arguments.flight.mode) {
        let [particles, volumes] = [column_density::MODE.name, xray::MODE.name];
        return Err(usage(format!(
            "--mode: found {}, expected {particles} with hierarchies of particles, {volumes} with those of volumes",
            mode.name
        )));
    }
    write_csv(arguments, &reports)?;
    Ok(Reports::Several(reports))
}

/// Refuses another mode than the one by whose sums hierarchies of such data are compared; `named` is the data's name.
///
/// # Errors
/// Wrong usage.
fn check_mode(named: &str, asked: Option<&'static Mode>, own: &Mode) -> Result<(), Failure> {
    match asked.filter(|asked| asked.name != own.name) {
        Some(asked) => Err(usage(format!("{named}: --mode: found {}, expected {}", asked.name, own.name))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_modes_are_refused() {
        let check = |asked| check_mode("a.hdf5", asked, &column_density::MODE);
        assert!(check(None).is_ok() && check(Some(&column_density::MODE)).is_ok());
        let told = check(Some(&xray::MODE)).map_err(|error| error.to_string());
        assert!(told.is_err_and(|told| told.contains("a.hdf5: --mode: found xray, expected column-density")));
    }
}
