//! Plots of particles: what is asked for, what was found, and that as a table ([`mod@table`]), in words ([`mod@notes`]) and as a chart
//! ([`mod@chart`]). `deepfield plot` and the window make the same ones.

pub mod brush;
pub mod chart;
pub mod notes;
pub mod settings;
pub mod table;

pub use brush::Part;
pub use chart::ChartScales;
pub use settings::{PlotKind, PlotOf, PlotScale, PlotSettings};

use super::batch::Work;
use super::binned::{Binned, BinnedAxis, Weight, binned};
use super::data::Data;
use super::error::ExploreError;
use super::estimate::{Effort, Estimate};
use super::histogram::scatter;
use super::profile::ProfileOptions;
use super::radial::{Radial, radial};
use super::selection::Members;
use crate::model::Unit;
use serde::Serialize;

/// Radius of the innermost shell as a share of the sphere's, of logarithmic ones.
pub const INNER: f64 = 0.01;

/// What is to be found.
#[derive(Clone, Debug, PartialEq)]
pub enum PlotOptions {
    /// The weight along one axis, or two.
    Binned {
        /// The axes.
        axes: Vec<BinnedAxis>,
        /// What particles count for.
        weight: Weight,
    },
    /// Values of two fields, of particles drawn at random.
    Scatter {
        /// To the right and upwards.
        fields: [String; 2],
        /// Most points.
        points: usize,
    },
    /// Shells around the centre of the first sphere of the members' region.
    Radial(ProfileOptions),
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Plot {
    /// A histogram or a phase diagram.
    Binned(Binned),
    /// A scatter plot.
    Scatter {
        /// The fields to the right and upwards.
        fields: [ScatterAxis; 2],
        /// Values of the first.
        x: Vec<f64>,
        /// Values of the second, of the same particles.
        y: Vec<f64>,
        /// Particles with both values, of which these are a sample.
        of: u64,
        /// Whether the source was asked.
        exact: bool,
        /// How far off shares of the sample may be, where a part of the page file was read; `None` where all of it was.
        estimate: Option<Estimate>,
    },
    /// A radial profile.
    Radial(Radial),
}

/// A field along an axis of a scatter plot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScatterAxis {
    /// The field.
    pub field: String,
    /// Its unit.
    pub unit: Unit,
}

impl Plot {
    /// Finds it, from as much of a page file as is wanted.
    ///
    /// # Errors
    /// When the data cannot be read or has no such field or family, no particle has a place in the plot, or a profile is of no sphere.
    pub fn find(
        data: Data,
        members: &Members,
        options: &PlotOptions,
        effort: Effort,
        periodic: Option<f64>,
        work: Work,
    ) -> Result<Plot, ExploreError> {
        match options {
            PlotOptions::Binned { axes, weight } => {
                Ok(Plot::Binned(binned(data, members, axes, weight, effort, periodic, work)?))
            }
            PlotOptions::Scatter { fields: [x, y], points } => {
                let found = scatter(data, members, [x.as_str(), y.as_str()], *points, effort, periodic, work)?;
                let unit = |field: &str| data.unit_of(field).unwrap_or_default();
                let fields = [x, y].map(|field| ScatterAxis { field: field.clone(), unit: unit(field) });
                let (exact, estimate) = (data.is_exact(), found.estimate);
                Ok(Plot::Scatter { fields, x: found.x, y: found.y, of: found.of, exact, estimate })
            }
            PlotOptions::Radial(options) => Ok(Plot::Radial(radial(data, members, options, effort, periodic, work)?)),
        }
    }

    /// How far off it may be because a part of the page file was read; `None` where all of it was.
    pub fn estimate(&self) -> Option<&Estimate> {
        match self {
            Plot::Binned(found) => found.estimate.as_ref(),
            Plot::Scatter { estimate, .. } => estimate.as_ref(),
            Plot::Radial(found) => found.estimate.as_ref().map(|estimate| &estimate.of_masses),
        }
    }

    /// How many particles it is of.
    pub fn particles(&self) -> u64 {
        match self {
            Plot::Binned(found) => found.count,
            Plot::Scatter { of, .. } => *of,
            Plot::Radial(found) => found.count,
        }
    }
}

/// A name with its unit, where that is known.
fn named(name: &str, unit: &Unit) -> String {
    if unit.is_unknown() { name.to_owned() } else { format!("{name} [{unit}]") }
}

/// The unit of a mass over a volume.
fn density_unit(mass: &Unit, length: &Unit) -> Unit {
    if mass.is_unknown() || length.is_unknown() {
        return Unit::default();
    }
    let volume = if length.0.contains(['/', ' ']) { format!("({length})^3") } else { format!("{length}^3") };
    Unit::new(format!("{mass}/{volume}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_have_the_unit_of_a_mass_over_a_volume() {
        assert_eq!(density_unit(&Unit::new("Msun"), &Unit::new("kpc")).0, "Msun/kpc^3");
        assert_eq!(density_unit(&Unit::new("Msun"), &Unit::new("Mpc/h")).0, "Msun/(Mpc/h)^3");
        assert!(density_unit(&Unit::default(), &Unit::new("kpc")).is_unknown());
    }
}
