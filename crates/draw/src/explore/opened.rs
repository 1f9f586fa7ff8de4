//! What is asked, opened.

use super::data::{Data, source_of};
use super::error::ExploreError;
use crate::hierarchy::spacetime::Interpolation;
use crate::import::Source;
use crate::model::Moment;
use crate::store::{PageFile, RunFile};
use std::sync::Arc;

/// A page file or a source, opened.
pub enum Opened {
    /// A page file.
    Pages(Box<PageFile>),
    /// A source.
    Source(Box<dyn Source>),
}

impl Opened {
    /// A run at a moment: of one with tracks its particles between steps, and of one that keeps no stills, or where it is asked itself
    /// (`exact`), at steps, too; otherwise the page file of the step at or before it.
    ///
    /// # Errors
    /// [`ExploreError`] where it cannot be read.
    pub fn of_run(
        run: &Arc<RunFile>,
        moment: Moment,
        interpolation: Interpolation,
        exact: bool,
    ) -> Result<Opened, ExploreError> {
        let moves = moment.u > 0.0 && interpolation != Interpolation::Hold;
        if (exact || moves || !run.has_stills()) && run.tracks().is_ok() {
            return Ok(Opened::Source(Box::new(run.at(moment, interpolation)?)));
        }
        Ok(Opened::Pages(Box::new(run.placed_still(moment.step)?)))
    }

    /// The source behind it: itself, or what the page file was built from.
    ///
    /// # Errors
    /// As [`source_of`].
    pub fn source(self) -> Result<Opened, ExploreError> {
        match self {
            Opened::Pages(file) => Ok(Opened::Source(source_of(&file)?)),
            source => Ok(source),
        }
    }

    /// The same to be asked.
    pub fn data(&self) -> Data<'_> {
        match self {
            Opened::Pages(file) => Data::Pages(&**file),
            Opened::Source(source) => Data::Source(source.as_ref()),
        }
    }
}
