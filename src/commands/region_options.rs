//! How regions are named on the command line, and which data they are looked for in.

use super::arguments::{Given, family_name, positive};
use crate::explore::{Catalogue, Data, Opened, Region, Shape, ValueRange, sphere_at};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::{open_with, step_at};
use crate::look::{DataKind, data_file, one_snapshot};
use crate::model::{FamilyName, ReadMethod, When, ron_file};
use crate::store::{PageFile, RunFile};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Which particles. Several options together mean particles that all of them let through.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct RegionOptions {
    /// A sphere: its centre and radius, in the data's units. In a periodic box it goes on at the opposite face.
    #[arg(long, value_name = "X,Y,Z,R", value_parser = sphere, allow_hyphen_values = true)]
    pub sphere: Option<Shape>,
    /// A box: its smallest and largest coordinates.
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = cuboid, allow_hyphen_values = true)]
    pub cuboid: Option<Shape>,
    /// A region as RON, with any shapes (a lasso, too), ranges and families.
    #[arg(long, value_name = "FILE.ron")]
    pub region: Option<PathBuf>,
    /// A range of values: FIELD:MIN..MAX; either end may be left out. May be given several times.
    #[arg(long = "where", value_name = "FIELD:MIN..MAX")]
    pub ranges: Vec<ValueRange>,
    /// A family: gas, dark, type2, type3, stars or black-holes. May be given several times [default: all].
    #[arg(long, value_name = "NAME", value_parser = family_name)]
    pub family: Vec<FamilyName>,
    /// The sphere of an object of a catalogue: CATALOGUE#N for the one at place N by importance, from 0, or CATALOGUE#NAME.
    #[arg(long, value_name = "CATALOGUE#N", conflicts_with_all = ["sphere", "object"])]
    pub at: Option<String>,
    /// The sphere of the object of that name, of the catalogue.
    #[arg(long, value_name = "NAME", requires = "catalogue", conflicts_with = "sphere")]
    pub object: Option<String>,
    /// Catalogue for --object: CSV, RON, a group catalogue of Gadget-4, AREPO or SUBFIND, or haloes of Rockstar, AHF, VELOCIraptor or HBT+.
    #[arg(long, value_name = "FILE")]
    pub catalogue: Option<PathBuf>,
    /// Radius of the sphere around an object [default: the catalogue's].
    #[arg(long, value_name = "R", value_parser = positive)]
    pub radius: Option<f64>,
    /// Take distances without going round the periodic box.
    #[arg(long)]
    pub no_wrap: bool,
}

fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let parse = |part: &str| part.trim().parse().ok().filter(|value: &f64| value.is_finite());
    let numbers: Option<Vec<f64>> = text.split(',').map(parse).collect();
    numbers?.try_into().ok()
}

fn sphere(text: &str) -> Result<Shape, String> {
    match numbers(text) {
        Some([x, y, z, radius]) if radius > 0.0 => Ok(Shape::Sphere { center: DVec3::new(x, y, z), radius }),
        _ => Err("expected a centre and a positive radius x,y,z,r such as 25,25,25,1.5".into()),
    }
}

fn cuboid(text: &str) -> Result<Shape, String> {
    let expected = || "expected the smallest and the largest coordinates x0,y0,z0,x1,y1,z1".to_owned();
    let [x0, y0, z0, x1, y1, z1] = numbers(text).ok_or_else(expected)?;
    let (min, max) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
    if min.cmple(max).all() { Ok(Shape::Box { min, max }) } else { Err(expected()) }
}

impl RegionOptions {
    /// The options, and which of them are given.
    pub fn given(&self) -> [Given; 10] {
        let RegionOptions { sphere, cuboid, region, ranges, family, at, object, catalogue, radius, no_wrap } = self;
        [
            ("--sphere", sphere.is_some()),
            ("--box", cuboid.is_some()),
            ("--region", region.is_some()),
            ("--where", !ranges.is_empty()),
            ("--family", !family.is_empty()),
            ("--at", at.is_some()),
            ("--object", object.is_some()),
            ("--catalogue", catalogue.is_some()),
            ("--radius", radius.is_some()),
            ("--no-wrap", *no_wrap),
        ]
    }

    /// The region in `data`.
    ///
    /// # Errors
    /// When a file that is named cannot be read, or has no such object.
    pub fn region(&self, data: Data) -> Result<Region, Failure> {
        let mut region = match &self.region {
            Some(path) => ron_file::read(path)?,
            None => Region::whole(),
        };
        region.shapes.extend(self.sphere.iter().chain(&self.cuboid).cloned());
        region.ranges.extend(self.ranges.iter().cloned());
        region.families.extend(&self.family);
        region.shapes.extend(match (&self.at, &self.object, &self.catalogue) {
            (Some(at), ..) => Some(sphere_at(at, self.radius, data)?),
            (None, Some(name), Some(path)) => {
                let catalogue = Catalogue::read_at(path, data.time(), false)?;
                Some(catalogue.sphere(catalogue.named(name)?, self.radius, data)?)
            }
            _ if self.radius.is_some() => return Err("--radius goes with --at or --object".into()),
            _ => None,
        });
        region.check()?;
        Ok(region)
    }

    /// The edge of the periodic box that distances go round.
    ///
    /// # Errors
    /// When the data cannot be read.
    pub fn periodic(&self, data: Data) -> Result<Option<f64>, Failure> {
        Ok(if self.no_wrap { None } else { data.periodic_edge()? })
    }
}

/// When it is asked, of a run.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct At {
    /// When, of a run: a time, step:12, z:1.5, a:0.4 or last [default: the first step].
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub time: Option<When>,
    /// How particles of a run move between steps: auto (along splines, fading where steps are too far apart for them), hermite, linear,
    /// fade or hold (the step before) [default: auto].
    #[arg(long, value_name = "HOW")]
    pub interpolation: Option<Interpolation>,
}

impl At {
    /// The options, and which of them are given.
    pub fn given(&self) -> [Given; 2] {
        let At { time, interpolation } = self;
        [("--time", time.is_some()), ("--interpolation", interpolation.is_some())]
    }

    /// Opens what the path names, by its content, to be read in the way `method`; of a run with tracks its particles at that moment, of
    /// one of stills alone the step at or before it.
    ///
    /// # Errors
    /// When it cannot be opened, or has no such time.
    pub fn open(self, path: &Path, method: ReadMethod) -> Result<Opened, Failure> {
        self.opened(path, method, false)
    }

    /// Opens the source behind the path: what it names, or what the page file that it names was built from. A run with tracks is its own
    /// source; of one of stills alone it is what the step was built from.
    ///
    /// # Errors
    /// When it cannot be opened, or is not what the page file was built from.
    pub fn source(self, path: &Path, method: ReadMethod) -> Result<Opened, Failure> {
        Ok(self.opened(path, method, true)?.source()?)
    }

    fn opened(self, path: &Path, method: ReadMethod, exact: bool) -> Result<Opened, Failure> {
        let At { time, interpolation } = self;
        let path = &data_file(path)?;
        let kind = DataKind::of(path)?;
        if let (Some(when), DataKind::Source) = (time, kind)
            && let Some(step) = step_at(path, when, method)?
        {
            return Ok(Opened::Source(open_with(&step, method)?));
        }
        let opened = match kind {
            DataKind::Pages => Opened::Pages(Box::new(PageFile::open_with(path, method)?)),
            DataKind::Source => Opened::Source(open_with(path, method)?),
            DataKind::Heights => return Err(format!("{}: heights, expected particles", path.display()).into()),
            DataKind::Grid => {
                return Err(format!("{}: an image or a volume, expected particles", path.display()).into());
            }
            DataKind::Run => {
                let run = Arc::new(RunFile::open(path, method)?);
                let moment = run.moment(time.unwrap_or(When::Step(0)))?;
                let opened = Opened::of_run(&run, moment, interpolation.unwrap_or_default(), exact)?;
                if moment.u > 0.0 && matches!(opened, Opened::Pages(_)) {
                    let (step, at) = (moment.step, run.times().times[moment.step]);
                    eprintln!("deepfield: {}: between steps: what is told is of step {step}, at {at}", path.display());
                }
                return Ok(opened);
            }
        };
        match time {
            Some(_) => Err(one_snapshot(path, time_of(&opened)).into()),
            None => Ok(opened),
        }
    }
}

/// The time that a page file or a source says of itself.
///
/// # Errors
/// When it cannot be opened.
pub fn own_time(path: &Path) -> Result<Option<f64>, Failure> {
    Ok(time_of(&At::default().open(path, ReadMethod::default())?))
}

fn time_of(opened: &Opened) -> Option<f64> {
    match opened {
        Opened::Pages(file) => file.metadata().provenance.time,
        Opened::Source(source) => source.description().time,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_boxes_and_families_are_read_or_refused() {
        assert_eq!(sphere("-1, 2,3e1,0.5"), Ok(Shape::Sphere { center: DVec3::new(-1.0, 2.0, 30.0), radius: 0.5 }));
        for wrong in ["", "1,2,3", "1,2,3,0", "1,2,3,-1", "1,2,3,nan", "1,2,3,4,5"] {
            assert!(sphere(wrong).is_err(), "{wrong}");
        }
        assert_eq!(cuboid("0,0,0,1,1,1"), Ok(Shape::Box { min: DVec3::ZERO, max: DVec3::ONE }));
        for wrong in ["", "0,0,0,1,1", "1,0,0,0,1,1"] {
            assert!(cuboid(wrong).is_err(), "{wrong}");
        }
        assert!(family_name("black-holes").is_ok() && family_name("black holes").is_err());
    }
}
