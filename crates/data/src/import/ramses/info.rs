//! What the texts of an output say: `info_NNNNN.txt`, the descriptions of what files hold, and the list of fields in `header_NNNNN.txt`
//! (`output_amr.f90`, `file_descriptor.f90`).

use crate::import::expansion::{Stated, cosmology};
use crate::import::hdf5::{length_name, mass_name};
use crate::import::{Description, ImportError};
use crate::model::{Motion, Unit, redshift_of};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The most that is read of a text, bytes: behind the numbers it lists the domains of all processes.
const MOST_TEXT: u64 = 1 << 16;

/// The most processes of a run: their numbers have five digits.
const MOST_CPUS: f64 = 99_999.0;

/// One megaparsec, cm.
const MEGAPARSEC: f64 = 3.085_677_581_491_367e24;

/// The beginning of a text; `None` where there is no such file.
///
/// # Errors
/// When it cannot be read.
pub(super) fn text(path: &Path) -> Result<Option<String>, ImportError> {
    if !path.is_file() {
        return Ok(None);
    }
    let io = |error| ImportError::io(path, "text", error);
    let mut bytes = Vec::new();
    File::open(path).map_err(io)?.take(MOST_TEXT).read_to_end(&mut bytes).map_err(io)?;
    Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
}

/// Whether a text is that of an output's numbers.
pub(super) fn is_info(head: &[u8]) -> bool {
    let head = &head[..head.len().min(128)];
    let mut lines = head.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii_start);
    let is = |line: Option<&[u8]>, name: &[u8]| line.is_some_and(|line| line.starts_with(name) && line.contains(&b'='));
    is(lines.next(), b"ncpu") && is(lines.next(), b"ndim")
}

/// The numbers of an output.
pub(super) struct Info {
    numbers: Vec<(String, f64)>,
    /// How many processes wrote it.
    pub cpus: u32,
    /// Length of a coarse cell, in the unit of lengths.
    pub coarse: f64,
}

impl Info {
    /// Reads them.
    ///
    /// # Errors
    /// When the file cannot be read, or what particles are placed by is missing or cannot be.
    pub(super) fn read(path: &Path) -> Result<Info, ImportError> {
        let text = text(path)?.unwrap_or_default();
        let named = text.lines().filter_map(|line| line.split_once('='));
        // Fortran may write an exponent with a D.
        let number = |(name, value): (&str, &str)| {
            Some((name.trim().to_owned(), value.trim().replace(['D', 'd'], "E").parse::<f64>().ok()?))
        };
        let mut info = Info { numbers: named.filter_map(number).collect(), cpus: 0, coarse: 1.0 };
        let needed = |name: &str| info.number(name).ok_or_else(|| ImportError::missing(path, name, "a number"));
        let (cpus, dimensions, coarse) = (needed("ncpu")?, needed("ndim")?, needed("boxlen")?);
        if !(1.0..=MOST_CPUS).contains(&cpus) || cpus.fract() != 0.0 {
            return Err(ImportError::malformed(path, "ncpu", cpus, format!("a number from 1 to {MOST_CPUS}")));
        }
        if dimensions != 3.0 {
            return Err(ImportError::malformed(path, "ndim", dimensions, "3"));
        }
        if !(coarse > 0.0 && coarse.is_finite()) {
            return Err(ImportError::malformed(path, "boxlen", coarse, "a positive number"));
        }
        (info.cpus, info.coarse) = (cpus as u32, coarse);
        Ok(info)
    }

    fn number(&self, name: &str) -> Option<f64> {
        self.numbers.iter().find(|(other, _)| other == name).map(|(_, value)| *value)
    }

    fn positive(&self, name: &str) -> Option<f64> {
        self.number(name).filter(|value| *value > 0.0 && value.is_finite())
    }

    /// The scale factor of a run in an expanding universe; any other has `aexp` and `H0` of 1.
    pub(super) fn scale_factor(&self) -> Option<f64> {
        let (a, hubble) = (self.positive("aexp")?, self.positive("H0")?);
        (a != 1.0 || hubble != 1.0).then_some(a)
    }

    /// km/s by the stored unit of velocities, where space expands and that unit changes with time.
    pub(super) fn velocity_factor(&self) -> Option<f64> {
        self.scale_factor()?;
        Some(self.positive("unit_l")? / self.positive("unit_t")? / 1e5)
    }

    /// The units of lengths and masses, where the output says them; 1 cm and 1 g/cm^3 are none.
    pub(super) fn units(&self) -> (Unit, Unit) {
        let (Some(length), Some(density)) = (self.positive("unit_l"), self.positive("unit_d")) else {
            return Default::default();
        };
        if length == 1.0 && density == 1.0 {
            return Default::default();
        }
        let mass = Unit::new(mass_name(density * length.powi(3)));
        match self.scale_factor() {
            Some(a) => (Unit::new(format!("a {}", length_name(length / a))), mass),
            None => (Unit::new(length_name(length)), mass),
        }
    }

    /// Adds to the description units, time, expansion and what velocities are.
    pub(super) fn describe(&self, about: &mut Description) {
        (about.length_unit, about.mass_unit) = self.units();
        about.time = self.number("time").filter(|time| time.is_finite());
        let Some(a) = self.scale_factor() else {
            about.motion = Motion::Coordinate;
            return;
        };
        about.scale_factor = Some(a);
        about.redshift = redshift_of(a);
        let (Some(_), Some(length)) = (self.velocity_factor(), self.positive("unit_l")) else { return };
        about.motion = Motion::Peculiar;
        about.notes.push("velocities are peculiar ones in km/s".into());
        let stated = |name: &'static str| self.number(name).map(|value| Stated { name, value });
        if let Some(hubble) = self.positive("H0") {
            let hubble = hubble * length / a / MEGAPARSEC;
            about.cosmology = cosmology(stated("omega_m"), stated("omega_l"), hubble, false, &mut about.notes);
        }
    }
}

/// A name in a description of what a file holds, and the letter of its type where there is one.
pub(super) type Described = (String, Option<char>);

/// The names of the arrays in a file, from its description: lines such as `1, density, d` of newer versions, or `variable # 1: density` of
/// older ones.
pub(super) fn described(text: &str) -> Vec<Described> {
    let lines = text.lines().map(str::trim).filter(|line| !line.starts_with('#'));
    let name = |line: &str| {
        if let Some((before, name)) = line.split_once(':') {
            return before.starts_with("variable").then(|| (printable(name), None));
        }
        let mut parts = line.split(',').map(str::trim);
        let (_, name, kind) = (parts.next()?.parse::<u32>().ok()?, parts.next()?, parts.next()?);
        Some((printable(name), kind.chars().next()))
    };
    lines.filter_map(name).collect()
}

/// The names of the arrays of particles that `header_NNNNN.txt` lists in its last line.
pub(super) fn listed(text: &str) -> Option<Vec<Described>> {
    let mut lines = text.lines().skip_while(|line| line.trim() != "Particle fields");
    lines.next()?;
    let mut names = Vec::new();
    for word in lines.next()?.split_whitespace() {
        let own: &[&str] = match word {
            "pos" => &["position_x", "position_y", "position_z"],
            "vel" => &["velocity_x", "velocity_y", "velocity_z"],
            "iord" => &["identity"],
            "level" => &["levelp"],
            "phi" => &["potential"],
            "tform" => &["birth_time"],
            "metal" => &["metallicity"],
            other => &[other],
        };
        names.extend(own.iter().map(|name| (printable(name), None)));
    }
    Some(names)
}

/// A name that fits in one line.
fn printable(name: &str) -> String {
    name.trim().chars().filter(|letter| !letter.is_control()).take(64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_out_of_every_style_of_description() {
        let names = |text| described(text).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
        assert_eq!(
            names("nvar        =   2\nvariable #  1: density\nvariable #  2: velocity_x\n"),
            ["density", "velocity_x"]
        );
        assert_eq!(names("# version:  1\n# ivar, variable_name, variable_type\n 1, density, d\n"), ["density"]);
        assert_eq!(described(" 8, identity, i\n"), [("identity".to_owned(), Some('i'))]);
        let header = "# Family Count\n DM 5\n Particle fields\npos vel mass iord level family tag tform metal \n";
        let found = listed(header).unwrap();
        assert_eq!(found.len(), 13);
        assert_eq!((&*found[7].0, &*found[12].0), ("identity", "metallicity"));
        assert_eq!(listed("Total number of particles\n 5\n"), None);
    }
}
