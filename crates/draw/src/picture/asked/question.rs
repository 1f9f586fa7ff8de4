//! Whom questions are about, and where they are asked.

use super::{Failure, State};
use crate::explore::{
    Data, Fields, IdSet, Members, Opened, Probe, ProbeOptions, ProfileOptions, Region, Work, probe, sphere_at,
};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::open_with;
use crate::look::{DataKind, Member};
use crate::model::{ReadMethod, When};
use crate::store::{PageFile, RunFile};
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;

/// Which particles, when, and whether of a page file or of what it was built from.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Question {
    /// Which particles.
    pub region: Region,
    /// Whose sphere they are in, too: an object of a catalogue, `CATALOGUE#N` or `CATALOGUE#NAME`.
    pub at: Option<String>,
    /// The radius of that sphere, in place of the catalogue's.
    pub radius: Option<f64>,
    /// Whether the source is asked that a page file was built from.
    pub exact: bool,
    /// Whether distances are taken without going round the periodic box.
    pub no_wrap: bool,
    /// When, of a run.
    pub time: Option<String>,
}

/// One dataset, which lies where it is by itself.
///
/// # Errors
/// Where there are several, or it was moved or scaled.
pub fn only<'a>(what: &str, members: &'a [Member]) -> Result<&'a Member, Failure> {
    match members {
        [only] if only.is_in_place() => Ok(only),
        [only] => {
            let path = only.path.display();
            Err(format!("{path}: {what}: found a dataset that is moved or scaled, expected one where it is").into())
        }
        several => Err(format!("{what}: found {} datasets, expected one", several.len()).into()),
    }
}

impl Question {
    /// The region in `data`.
    ///
    /// # Errors
    /// When a catalogue cannot be read or has no such object, and of a region that makes no sense.
    pub fn region_in(&self, data: Data) -> Result<Region, Failure> {
        let mut region = self.region.clone();
        match &self.at {
            Some(at) => region.shapes.push(sphere_at(at, self.radius, data)?),
            None if self.radius.is_some() => return Err("radius: found no object, expected one that at names".into()),
            None => {}
        }
        region.check()?;
        Ok(region)
    }

    /// The particles in `data`, given ids or not; ids stand alone.
    ///
    /// # Errors
    /// As [`Question::region_in`].
    pub fn members(&self, ids: Option<Vec<u64>>, data: Data) -> Result<Members, Failure> {
        let region = self.region_in(data)?;
        match ids {
            None => Ok(Members::Region(region)),
            Some(ids) if region.is_whole() => Ok(Members::Ids(IdSet::new(ids))),
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
    /// As [`Question::opened`] and [`Question::region_in`], and for fields that there are not.
    pub fn answer(self, path: &Path, state: &State) -> Result<Probe, Failure> {
        let opened = self.of.opened("probe", path)?;
        let data = opened.data();
        let region = self.of.region_in(data)?;
        let options = ProbeOptions {
            fields: self.fields.map_or(Fields::All, Fields::Named),
            profile: self.shells.map(|shells| ProfileOptions { shells, inner: None, field: self.shell_field }),
            periodic: self.of.periodic(data)?,
        };
        let work = Work { progress: state, stop: state.stop() };
        Ok(probe(data, &region, &options, work)?)
    }
}
