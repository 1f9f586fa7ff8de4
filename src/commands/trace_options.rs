//! Tracing of velocity fields, on the command line.

use super::arguments::positive;
use crate::import::Times;
use crate::import::vector_field::{
    DEFAULT_SEEDS, DEFAULT_STEPS, DEFAULT_TOLERANCE, FieldOptions, Seeds, TraceOptions as Trace,
};
use crate::model::Bounds;
use glam::DVec3;

/// Options of velocity fields on a grid, through which particles are traced.
#[derive(clap::Args, Clone, Debug, PartialEq)]
#[command(next_help_heading = "Velocity fields")]
pub struct TraceOptions {
    /// Takes the source for a velocity field on a grid, and builds a run of the particles that it carries along: NumPy arrays with axes
    /// (time, z, y, x, component), any volume or image with 2 or 3 values a sample, or several of them, one for each time. --times says
    /// when each time of the field is.
    #[arg(long, conflicts_with_all = ["every", "skip_damaged", "clock", "shape"])]
    pub trace: bool,
    /// Particles, spread evenly where the field has velocities.
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SEEDS, requires = "trace",
        value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub seeds: u64,
    /// Where they begin: smallest and largest coordinates; the box may have no thickness [default: everywhere].
    #[arg(long, value_name = "X0,Y0[,Z0],X1,Y1[,Z1]", value_parser = part, allow_hyphen_values = true, requires = "trace")]
    pub seed_box: Option<Bounds>,
    /// A particle at this place, instead of those; may be given several times.
    #[arg(long, value_name = "X,Y[,Z]", value_parser = place, allow_hyphen_values = true, requires = "trace",
        conflicts_with_all = ["seeds", "seed_box", "seed"])]
    pub seed_point: Vec<DVec3>,
    /// Another seed spreads particles otherwise.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "trace")]
    pub seed: u64,
    /// Steps of the run: at how many times particles are kept.
    #[arg(long, value_name = "N", default_value_t = DEFAULT_STEPS as u32, requires = "trace",
        value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub steps: u32,
    /// When particles begin [default: with the field].
    #[arg(long, value_name = "TIME", allow_hyphen_values = true, requires = "trace")]
    pub start: Option<f64>,
    /// How long they go [default: to the end of the field; in a steady one twice its longest side at mean speed].
    #[arg(long, value_name = "TIME", value_parser = positive, requires = "trace")]
    pub duration: Option<f64>,
    /// Takes the field as it is at this time for a steady one: streamlines instead of pathlines.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true, requires = "trace")]
    pub instant: Option<f64>,
    /// The field goes on at its other end, along all axes or those that are named.
    #[arg(long, value_name = "AXES", num_args = 0..=1, require_equals = true, default_missing_value = "xyz",
        value_parser = axes, requires = "trace")]
    pub periodic: Option<Axes>,
    /// Where the nodes of the field are: the first and the last ones, or one period of a periodic axis [default: as the file says, else 1
    /// apart].
    #[arg(long = "box", value_name = "X0,Y0[,Z0],X1,Y1[,Z1]", value_parser = whole, allow_hyphen_values = true,
        requires = "trace")]
    pub cuboid: Option<Bounds>,
    /// Names of the arrays that hold one component each [default: an array of vectors, or u, v and w].
    #[arg(long, value_name = "U,V[,W]", value_delimiter = ',', requires = "trace")]
    pub components: Vec<String>,
    /// The error of a step of the integration, in cells of the grid.
    #[arg(long, value_name = "CELLS", value_parser = positive, default_value_t = DEFAULT_TOLERANCE, requires = "trace")]
    pub tolerance: f64,
}

/// Axes of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axes([bool; 3]);

impl TraceOptions {
    /// What they say; `None` where nothing is to be traced.
    pub fn trace(&self, times: Option<&Times>) -> Option<Trace> {
        if !self.trace {
            return None;
        }
        let seeds = match &self.seed_point[..] {
            [] => Seeds::Spread { count: self.seeds, within: self.seed_box, random: self.seed },
            points => Seeds::At(points.iter().map(DVec3::to_array).collect()),
        };
        Some(Trace {
            field: FieldOptions {
                components: self.components.clone(),
                times: times.cloned(),
                periodic: self.periodic.map_or([false; 3], |Axes(axes)| axes),
                bounds: self.cuboid,
            },
            seeds,
            steps: self.steps as usize,
            start: self.start,
            duration: self.duration,
            instant: self.instant,
            tolerance: self.tolerance,
        })
    }
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|part| part.trim().parse().ok().filter(|value: &f64| value.is_finite())).collect()
}

fn place(text: &str) -> Result<DVec3, String> {
    match numbers(text).as_deref() {
        Some([x, y]) => Ok(DVec3::new(*x, *y, 0.0)),
        Some([x, y, z]) => Ok(DVec3::new(*x, *y, *z)),
        _ => Err("expected a place x,y or x,y,z".into()),
    }
}

/// A box; one of a flat field has `z` for its third axis.
fn cuboid(text: &str, z: [f64; 2]) -> Result<Bounds, String> {
    let (min, max) = match numbers(text).as_deref() {
        Some([x0, y0, x1, y1]) => (DVec3::new(*x0, *y0, z[0]), DVec3::new(*x1, *y1, z[1])),
        Some([x0, y0, z0, x1, y1, z1]) => (DVec3::new(*x0, *y0, *z0), DVec3::new(*x1, *y1, *z1)),
        _ => (DVec3::ONE, DVec3::ZERO),
    };
    if min.cmple(max).all() {
        Ok(Bounds { min, max })
    } else {
        Err("expected the smallest and the largest coordinates x0,y0,x1,y1 or x0,y0,z0,x1,y1,z1".into())
    }
}

/// The box of a field.
fn whole(text: &str) -> Result<Bounds, String> {
    cuboid(text, [0.0; 2])
}

/// A box in it, all of it along an axis that is not said.
fn part(text: &str) -> Result<Bounds, String> {
    cuboid(text, [f64::NEG_INFINITY, f64::INFINITY])
}

fn axes(text: &str) -> Result<Axes, String> {
    let is_known = !text.is_empty() && text.chars().all(|axis| "xyz".contains(axis));
    let has = ['x', 'y', 'z'].map(|axis| text.contains(axis));
    if is_known { Ok(Axes(has)) } else { Err("expected axes such as xy, of x, y and z".into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_places_and_axes_are_read_or_refused() {
        assert_eq!(whole("0,0,2,1"), Ok(Bounds { min: DVec3::ZERO, max: DVec3::new(2.0, 1.0, 0.0) }));
        assert_eq!(part("0,0,2,1").map(|within| within.max.z), Ok(f64::INFINITY));
        assert_eq!(
            part("-1,0,0,2,1,0"),
            Ok(Bounds { min: DVec3::new(-1.0, 0.0, 0.0), max: DVec3::new(2.0, 1.0, 0.0) })
        );
        for wrong in ["", "1,2,3", "1,0,0,1", "0,0,nan,1", "0,0,0,1,1,inf", "0,0,0,1,1,1,1"] {
            assert!(whole(wrong).is_err(), "{wrong}");
        }
        assert_eq!(place("1, -2"), Ok(DVec3::new(1.0, -2.0, 0.0)));
        assert!(place("1").is_err() && place("1,2,3,4").is_err());
        assert_eq!(axes("zx"), Ok(Axes([true, false, true])));
        assert!(axes("").is_err() && axes("t").is_err());
    }
}
