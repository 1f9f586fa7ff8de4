//! Numbers of plots: what `deepfield plot` finds.

use crate::error::Failure;
use deepfield_draw::explore::{BinnedAxis, Effort, Plot, PlotOptions, ProfileOptions, Weight, Work, radials};
use deepfield_draw::picture::asked::{Question, State};
use serde::Deserialize;
use std::path::Path;

/// What is to be found.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AskedPlot {
    /// Of whom.
    of: Question,
    /// The axes of a histogram, or of two fields together.
    axes: Vec<AskedAxis>,
    /// What particles count for.
    weight: Weight,
    /// Relative error that is enough of a page file.
    error: Option<f64>,
    /// Profiles in a sphere, in place of axes.
    profiles: Vec<ProfileOptions>,
}

/// An axis.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AskedAxis {
    /// The field along it.
    field: String,
    /// How many bins.
    bins: usize,
    /// Whether they are equal in the logarithm; as values ask for where it is `None`.
    logarithmic: Option<bool>,
    /// From where to where.
    range: Option<[f64; 2]>,
}

impl AskedPlot {
    /// The numbers as JSON; of profiles a list.
    ///
    /// # Errors
    /// When the data cannot be read or has no such field.
    pub fn answer(self, path: &Path, state: &State) -> Result<String, Failure> {
        let opened = self.of.opened("plot", path)?;
        let data = opened.data();
        let members = self.of.members(None, data)?;
        let periodic = self.of.periodic(data)?;
        let effort = Effort::within(self.error.unwrap_or_default());
        let work = Work { progress: state, stop: state.stop() };
        if !self.profiles.is_empty() {
            let found = radials(data, &members, &self.profiles, effort, periodic, work)?;
            return Ok(serde_json::to_string(&found)?);
        }
        let axes = self.axes.into_iter().map(|AskedAxis { field, bins, logarithmic, range }| BinnedAxis {
            field,
            bins,
            logarithmic,
            range,
        });
        let options = PlotOptions::Binned { axes: axes.collect(), weight: self.weight };
        Ok(serde_json::to_string(&Plot::find(data, &members, &options, effort, periodic, work)?)?)
    }
}
