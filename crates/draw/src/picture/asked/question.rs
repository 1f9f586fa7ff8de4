//! Whom questions are about, and where they are asked.

use super::{Failure, State};
use crate::explore::{Data, Fields, IdSet, Members, Opened, Probe, ProbeOptions, ProfileOptions, Region, Work, probe};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::open_with;
use crate::look::DataKind;
use crate::model::{ReadMethod, When};
use crate::store::{PageFile, RunFile};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Which particles, when, and whether of a page file or of what it was built from.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Question {
    /// Which particles.
    pub region: Region,
    /// Whether the source is asked that a page file was built from.
    pub exact: bool,
    /// Whether distances are taken without going round the periodic box.
    pub no_wrap: bool,
    /// When, of a run.
    pub time: Option<String>,
}

/// One path.
///
/// # Errors
/// Where there are several.
pub fn only<'a>(what: &str, paths: &'a [PathBuf]) -> Result<&'a Path, Failure> {
    match paths {
        [only] => Ok(only),
        several => Err(format!("{what}: found {} datasets, expected one", several.len()).into()),
    }
}

impl Question {
    /// The particles, given ids or not; ids stand alone.
    ///
    /// # Errors
    /// A region that makes no sense.
    pub fn members(&self, ids: Option<Vec<u64>>) -> Result<Members, Failure> {
        self.region.check()?;
        match ids {
            None => Ok(Members::Region(self.region.clone())),
            Some(ids) if self.region.is_whole() => Ok(Members::Ids(IdSet::new(ids))),
            Some(_) => Err("ids: found a region, too, expected one of them".into()),
        }
    }

    /// The edge of the periodic box that distances go round.
    ///
    /// # Errors
    /// When the data cannot be read.
    pub fn periodic(&self, data: Data) -> Result<Option<f64>, Failure> {
        Ok(if self.no_wrap { None } else { data.periodic_edge()? })
    }

    /// Opens what is asked, for `what` messages name: of a run with tracks its particles at the time, of one of stills the step at or before it.
    ///
    /// # Errors
    /// When it cannot be read, is of no particles, or has no such time.
    pub fn opened(&self, what: &str, path: &Path) -> Result<Opened, Failure> {
        let method = ReadMethod::default();
        let kind = DataKind::of(path)?;
        let when = self.time.as_deref().map(str::parse::<When>).transpose()?;
        if when.is_some() && kind != DataKind::Run {
            return Err(format!("{}: time: found one moment alone, expected a run", path.display()).into());
        }
        let opened = match kind {
            DataKind::Source => Opened::Source(open_with(path, method)?),
            DataKind::Pages => Opened::Pages(Box::new(PageFile::open_with(path, method)?)),
            DataKind::Run => {
                let run = Arc::new(RunFile::open(path, method)?);
                let moment = run.moment(when.unwrap_or(When::Step(0)))?;
                Opened::of_run(&run, moment, Interpolation::default(), self.exact)?
            }
            DataKind::Grid | DataKind::Heights => {
                let found = kind.described();
                return Err(format!("{}: {what}: found {found}, expected particles", path.display()).into());
            }
        };
        Ok(if self.exact { opened.source()? } else { opened })
    }

    /// Opens what rows are read from: the source at its own precision, or where that is not there any more, and no ids are asked for, the page
    /// file, which is told.
    ///
    /// # Errors
    /// As [`Question::opened`].
    pub fn opened_for_rows(&self, path: &Path, needs_ids: bool, state: &State) -> Result<Opened, Failure> {
        let of_source = Question { exact: true, ..self.clone() };
        match of_source.opened("select", path) {
            Err(reason) if !self.exact && !needs_ids => {
                let opened = self.opened("select", path)?;
                if matches!(opened, Opened::Pages(_)) {
                    state.note(format!("{reason}: values are those of the page file, without ids"));
                }
                Ok(opened)
            }
            opened => opened,
        }
    }
}

/// What is asked of a region.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AskedProbe {
    /// Of whom.
    pub of: Question,
    /// Whose statistics; of all fields where nothing is said.
    pub fields: Option<Vec<String>>,
    /// Shells of equal width of a profile in the region's sphere.
    pub shells: Option<usize>,
    /// The field whose means are in them.
    pub shell_field: Option<String>,
}

impl AskedProbe {
    /// The answer.
    ///
    /// # Errors
    /// As [`Question::opened`], for a region that makes no sense, and for fields that there are not.
    pub fn answer(self, path: &Path, state: &State) -> Result<Probe, Failure> {
        self.of.region.check()?;
        let opened = self.of.opened("probe", path)?;
        let data = opened.data();
        let options = ProbeOptions {
            fields: self.fields.map_or(Fields::All, Fields::Named),
            profile: self.shells.map(|shells| ProfileOptions { shells, inner: None, field: self.shell_field }),
            periodic: self.of.periodic(data)?,
        };
        let work = Work { progress: state, stop: state.stop() };
        Ok(probe(data, &self.of.region, &options, work)?)
    }
}
