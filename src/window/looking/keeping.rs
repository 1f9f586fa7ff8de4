//! What is done with a selection: written to a table, or summed up over the steps of a run.

use super::asking::Asking;
use crate::explore::export::{Exported, Format, Frame, export};
use crate::explore::{ExploreError, Fields, Members, OverTime, over_time};
use crate::window::free_name::free_name;
use crate::window::scene::Scene;
use crate::window::state::answer::Answer;
use crate::window::state::notices::Notices;
use bevy::prelude::*;
use std::path::PathBuf;

/// Work on selections that is going on or done.
#[derive(Resource, Default)]
pub struct Keeping {
    /// The table that is being written.
    pub export: Answer<(PathBuf, Exported)>,
    /// A selection over the steps of the run.
    pub over_time: Answer<OverTime>,
}

impl Keeping {
    /// Writes a selection to a table in the folder of the source or the working folder; from the source where that can be read.
    pub fn write(&mut self, scene: &Scene, name: &str, members: &Members, format: Format) {
        let asking = Asking::about(scene, members, true);
        let members = members.clone();
        let out = free_name(&scene.path, name, format.extension());
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
}

/// Takes what has been worked out.
pub(super) fn receive_tables(mut keeping: ResMut<Keeping>, mut notices: ResMut<Notices>) {
    let keeping = keeping.bypass_change_detection();
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
