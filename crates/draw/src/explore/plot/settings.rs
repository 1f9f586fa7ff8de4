//! What the window's panel plots, as scene files keep it.

use super::{ChartScales, INNER, PlotOptions};
use crate::explore::binned::{BinnedAxis, Weight};
use crate::explore::profile::ProfileOptions;
use serde::{Deserialize, Serialize};

/// The name by which a profile knows the mass of a shell over its volume.
pub const DENSITY: &str = "density";
/// Bins of a histogram, cells of a phase diagram to the right and upwards, shells of a profile and points of a scatter plot, for a plot that
/// is some hundred pixels wide.
const BINS: usize = 80;
const CELLS: [usize; 2] = [128, 96];
const SHELLS: usize = 40;
const POINTS: usize = 5000;

/// Which plot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlotKind {
    /// The weight in each bin of a field.
    #[default]
    Histogram,
    /// The weight in each cell of two fields.
    Phase,
    /// Points at the values of two fields.
    Scatter,
    /// Means in shells.
    Radial,
}

/// How an axis counts.
#[derive(clap::ValueEnum, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlotScale {
    /// As values ask for.
    #[default]
    Auto,
    /// Equal differences are equally long.
    Linear,
    /// Equal ratios are equally long; zero and negative values are left out.
    Log,
}

impl PlotScale {
    /// Whether it is logarithmic; `None` where that is left open.
    pub fn is_logarithmic(self) -> Option<bool> {
        match self {
            PlotScale::Auto => None,
            PlotScale::Linear => Some(false),
            PlotScale::Log => Some(true),
        }
    }
}

/// Whose values are plotted.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlotOf {
    /// Those of the region that is looked at; of all particles where there is none.
    #[default]
    Region,
    /// Those of all particles.
    All,
    /// Those of what the picture shows.
    View,
    /// Those of the selection of this name.
    Selection(String),
}

/// A plot as it is chosen in a panel.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlotSettings {
    /// Which plot.
    pub kind: PlotKind,
    /// The field to the right; where it is empty or not there, one that is.
    pub x: String,
    /// The field upwards, and that of a profile: there [`DENSITY`] is the mass over the volume.
    pub y: String,
    /// What particles count for.
    pub weight: Weight,
    /// Axes of fields and radii.
    pub scale: PlotScale,
    /// The axis of weights or their colours, and upwards in a profile.
    pub weight_scale: PlotScale,
    /// Whose values.
    pub of: PlotOf,
}

impl PlotSettings {
    /// The same with fields that are among these: others become the density and the temperature, or else the first ones; empty where
    /// there are none.
    pub fn fit(&mut self, fields: &[String]) {
        let is_there = |name: &str| fields.iter().any(|field| field == name);
        let instead = |usual: &str, not: &str| {
            let others = || fields.iter().filter(move |field| field.as_str() != not);
            let found = others().find(|field| field.as_str() == usual).or_else(|| others().next());
            found.or(fields.first()).cloned().unwrap_or_default()
        };
        if !is_there(&self.x) {
            self.x = instead("density", "");
        }
        let is_density = self.kind == PlotKind::Radial && self.y == DENSITY;
        if !is_density && !is_there(&self.y) {
            self.y = if self.kind == PlotKind::Radial { DENSITY.to_owned() } else { instead("temperature", &self.x) };
        }
    }

    /// What is to be found.
    pub fn options(&self) -> PlotOptions {
        let axis = |field: &String, bins: usize| BinnedAxis {
            field: field.clone(),
            bins,
            logarithmic: self.scale.is_logarithmic(),
            range: None,
        };
        let weight = self.weight.clone();
        match self.kind {
            PlotKind::Histogram => PlotOptions::Binned { axes: vec![axis(&self.x, BINS)], weight },
            PlotKind::Phase => {
                let axes = vec![axis(&self.x, CELLS[0]), axis(&self.y, CELLS[1])];
                PlotOptions::Binned { axes, weight }
            }
            PlotKind::Scatter => PlotOptions::Scatter { fields: [self.x.clone(), self.y.clone()], points: POINTS },
            PlotKind::Radial => PlotOptions::Radial(ProfileOptions {
                shells: SHELLS,
                inner: (self.scale != PlotScale::Linear).then_some(INNER),
                field: Some(self.y.clone()).filter(|field| field != DENSITY),
            }),
        }
    }

    /// How the axes of its chart count.
    pub fn chart_scales(&self) -> ChartScales {
        ChartScales {
            fields: self.scale.is_logarithmic(),
            weights: self.weight_scale.is_logarithmic(),
            by_count: self.weight == Weight::Count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ron_file;

    #[test]
    fn settings_are_read_and_written_as_ron() {
        let settings = PlotSettings {
            kind: PlotKind::Phase,
            x: "density".into(),
            y: "temperature".into(),
            weight: Weight::Count,
            scale: PlotScale::Log,
            weight_scale: PlotScale::Linear,
            of: PlotOf::Selection("core".into()),
        };
        let text = ron::to_string(&settings).unwrap();
        assert_eq!(ron_file::parse::<PlotSettings>("p", &text).unwrap(), settings, "{text}");
        assert_eq!(ron_file::parse::<PlotSettings>("p", "()").unwrap(), PlotSettings::default());
        let short: PlotSettings =
            ron_file::parse("p", "(kind: radial, weight: \"mass\", of: selection(\"core\"), scale: log)").unwrap();
        assert_eq!(short.of, PlotOf::Selection("core".into()));
        for (wrong, name) in [("(kind: pie)", "pie"), ("(colour: 3)", "colour"), ("(of: nobody)", "nobody")] {
            let message = ron_file::parse::<PlotSettings>("p", wrong).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
    }

    #[test]
    fn fields_that_are_not_there_become_others() {
        let names = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
        let fitted = |kind, of: &str| {
            let mut settings = PlotSettings { kind, ..PlotSettings::default() };
            settings.fit(&names(of));
            (settings.x, settings.y)
        };
        let pair = |x: &str, y: &str| (x.to_owned(), y.to_owned());
        assert_eq!(fitted(PlotKind::Phase, "temperature mass density"), pair("density", "temperature"));
        assert_eq!(fitted(PlotKind::Phase, "speed mass"), pair("speed", "mass"));
        assert_eq!(fitted(PlotKind::Phase, "mass"), pair("mass", "mass"));
        assert_eq!(fitted(PlotKind::Radial, "mass"), pair("mass", DENSITY));
        let mut kept = PlotSettings { x: "mass".into(), y: "speed".into(), ..PlotSettings::default() };
        kept.fit(&names("density speed mass"));
        assert_eq!((kept.x.as_str(), kept.y.as_str()), ("mass", "speed"));
        kept.fit(&[]);
        assert_eq!((kept.x.as_str(), kept.y.as_str()), ("", ""), "nothing is there");
    }
}
