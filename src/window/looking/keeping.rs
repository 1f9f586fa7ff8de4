//! What is done with a selection: written to a table, counted along one field, or drawn against two.

use super::asking::Asking;
use crate::explore::export::{Exported, Format, Frame, export};
use crate::explore::histogram::{AxisOptions, FieldHistogram, Scatter, histogram, scatter};
use crate::explore::{ExploreError, Fields, Members, OverTime, over_time};
use crate::window::free_name::free_name;
use crate::window::scene::Scene;
use crate::window::state::answer::Answer;
use crate::window::state::notices::Notices;
use bevy::prelude::*;
use std::path::PathBuf;

/// Bins of a histogram.
const BINS: usize = 48;
/// Points of a scatter plot.
const POINTS: usize = 4000;

/// Work on selections that is going on or done.
#[derive(Resource, Default)]
pub struct Keeping {
    /// The table that is being written.
    pub export: Answer<(PathBuf, Exported)>,
    /// The plot that is shown.
    pub plot: Answer<Plot>,
    /// What it was asked for.
    pub asked: Option<Asked>,
    /// A selection over the steps of the run.
    pub over_time: Answer<OverTime>,
    /// The fields to plot, as the panel's boxes say: along x, and along y unless numbers are counted.
    pub fields: (String, Option<String>),
}

/// What a plot is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Whose values; all where it is `None`.
    pub members: Option<Members>,
    /// The field along x.
    pub x: String,
    /// The field along y; counts where it is `None`.
    pub y: Option<String>,
    /// The file that is asked.
    pub generation: u32,
}

/// A plot.
#[derive(Clone, Debug, PartialEq)]
pub enum Plot {
    /// How many particles have which value.
    Histogram(FieldHistogram),
    /// Two values of a sample of the particles.
    Scatter(Scatter),
}

impl Keeping {
    /// Writes a selection to a table in the folder of the source or the working folder; from the source where that can be read.
    pub fn write(&mut self, scene: &Scene, name: &str, members: &Members, format: Format) {
        let asking = Asking::about(scene, members, true);
        let members = members.clone();
        let extension = match format {
            Format::Csv => "csv",
            Format::Parquet => "parquet",
            Format::Ply => "ply",
        };
        let out = free_name(&scene.path, name, extension);
        self.export = Answer::ask("export", move |work| {
            let exported = asking.ask(&members, work, |data, members, periodic| {
                export(data, members, format, &Frame::Stored, &out, periodic, work)
            })?;
            Ok::<_, ExploreError>((out, exported))
        });
    }

    /// Sums up a selection at every step of the run.
    pub fn over_time(&mut self, scene: &Scene, members: &Members) {
        let Some(following) = scene.following.clone() else { return };
        let members = members.clone();
        self.over_time = Answer::ask("over time", move |work| {
            over_time(following.run(), Some(&following), &members, &Fields::All, true, work)
        });
    }

    /// Plots, unless that plot is there already.
    pub fn plot(&mut self, scene: &Scene, asked: Asked) {
        if self.asked.as_ref() == Some(&asked) {
            return;
        }
        let members = asked.members.clone().unwrap_or(Members::Region(crate::explore::Region::whole()));
        let asking = Asking::about(scene, &members, false);
        self.asked = Some(asked.clone());
        self.plot = Answer::ask("plot", move |work| {
            asking.ask(&members, work, |data, members, periodic| {
                Ok(match &asked.y {
                    Some(y) => Plot::Scatter(scatter(data, members, [&asked.x, y], POINTS, periodic, work)?),
                    None => {
                        let axes = [AxisOptions::new(asked.x.clone(), BINS)];
                        Plot::Histogram(histogram(data, members, &axes, periodic, work)?)
                    }
                })
            })
        });
    }
}

/// Takes what has been worked out.
pub(super) fn receive_tables(mut keeping: ResMut<Keeping>, mut notices: ResMut<Notices>) {
    let keeping = keeping.bypass_change_detection();
    keeping.plot.receive();
    keeping.over_time.receive();
    if keeping.export.receive() {
        match &keeping.export {
            Answer::Here((path, exported)) => {
                let whence = if exported.exact { "" } else { " (from the page file: no ids, values as quantised)" };
                let rows = crate::annotate::number::count(exported.rows);
                notices.info(format!("{rows} particles written to {}{whence}", path.display()));
            }
            Answer::Failed(why) => notices.error(why),
            Answer::Nothing | Answer::Coming(_) => {}
        }
    }
}
