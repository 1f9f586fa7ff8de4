//! Rows of particles as arrays of NumPy, and as files.

use crate::building::refuse_over;
use crate::error::Failure;
use deepfield_draw::build::default_memory;
use deepfield_draw::explore::{
    Data, Following, Format, Frame, Members, Opened, Region, Rows, Work, export, files_of_catalogue, ids_of, rows,
};
use deepfield_draw::look::DataKind;
use deepfield_draw::model::{Progress, ReadMethod, When};
use deepfield_draw::picture::asked::{Question, State};
use deepfield_draw::store::RunFile;
use deepfield_draw::store::run::{PathsOf, RunPaths};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// What rows are asked for.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AskedRows {
    /// Of whom.
    of: Question,
    /// The columns; all where nothing is said.
    fields: Option<Vec<String>>,
    /// Bytes that they may take.
    memory: Option<u64>,
    /// Of files: whether lengths, densities and velocities are physical ones, in place of those that the data has.
    physical: bool,
    /// Of tracks: from when on, and until when.
    from: Option<String>,
    to: Option<String>,
}

impl AskedRows {
    /// The rows of a region or of ids.
    ///
    /// # Errors
    /// When they cannot be read, or take too much memory.
    pub fn rows(&self, path: &Path, ids: Option<Vec<u64>>, state: &State) -> Result<Rows, Failure> {
        let needs_ids = ids.is_some() || self.fields.iter().flatten().any(|field| field == "id");
        let opened = self.of.opened_for_rows(path, needs_ids, state)?;
        let data = opened.data();
        let members = self.of.members(ids, data)?;
        let periodic = self.of.periodic(data)?;
        self.read(data, &members, periodic, state)
    }

    /// Writes all fields of the rows of a region or of ids to the table `out`, or their ids to a list of such, as its name says; gives how many rows
    /// there are. `named` is what `path` was made of, or is itself.
    ///
    /// # Errors
    /// When they cannot be read, or `out` not be written or is a file that is read.
    pub fn export(
        &self,
        path: &Path,
        named: &Path,
        ids: Option<Vec<u64>>,
        out: &Path,
        state: &State,
    ) -> Result<u64, Failure> {
        let written = out.display();
        let format = Format::of(out);
        if out.is_dir() {
            return Err(format!("{written}: cannot be written: found a folder, expected the name of a file").into());
        }
        let is_list = out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ids"));
        if format.is_none() && !is_list {
            return Err(format!("{written}: expected a name that ends in {}, or .ids", Format::ENDINGS).into());
        }
        let mut read = vec![path.to_owned(), named.to_owned()];
        read.extend(self.of.at.as_deref().map(files_of_catalogue).transpose()?.unwrap_or_default());
        refuse_over(out, &read)?;
        let opened = self.of.opened_for_rows(path, ids.is_some() || format.is_none(), state)?;
        let data = opened.data();
        let members = self.of.members(ids, data)?;
        let periodic = self.of.periodic(data)?;
        let physical = match data {
            Data::Source(source) => Frame::physical(source),
            Data::Pages(_) => None,
        };
        let frame = match (self.physical, physical) {
            (false, _) => Frame::Stored,
            (true, Some(physical)) => physical,
            (true, None) => {
                let found = "found data that does not say its scale factor and what its velocities are";
                let expected = "expected a comoving source or run that does, or no frame";
                return Err(format!("{}: frame: {found}, {expected}", path.display()).into());
            }
        };
        let work = Work { progress: state, stop: state.stop() };
        // Whoever is interrupted from here on waits until nothing unfinished is left.
        state.begin("writing", 0);
        let rows = match (format, &opened) {
            (Some(format), _) => export(data, &members, format, &frame, out, periodic, work)?.rows,
            (None, Opened::Source(source)) => {
                let found = ids_of(source.as_ref(), &members, periodic, work)?;
                found.write(out, &format!(" of {}", path.display()))?;
                found.len()
            }
            (None, Opened::Pages(_)) => return Err(format!("{}: a page file has no ids", path.display()).into()),
        };
        if let Members::Ids(wanted) = &members
            && rows < wanted.len()
        {
            state.note(format!("{} of {} ids are not there", wanted.len() - rows, wanted.len()));
        }
        Ok(rows)
    }

    /// The ends of the tracks of a run: of those with these ids, else of those that lie in the region.
    ///
    /// # Errors
    /// When the run cannot be read or has no tracks.
    pub fn paths(&self, path: &Path, ids: Option<Vec<u64>>, state: &State) -> Result<Rows, Failure> {
        let kind = DataKind::of(path)?;
        if kind != DataKind::Run {
            return Err(format!("{}: paths: found {}, expected a run", path.display(), kind.described()).into());
        }
        let run = Arc::new(RunFile::open(path, ReadMethod::default())?);
        let moment = |when: &Option<String>, usual: When| -> Result<_, Failure> {
            let when = when.as_deref().map(str::parse::<When>).transpose()?;
            Ok(run.moment(when.unwrap_or(usual))?)
        };
        let (from, to) = (moment(&self.from, When::Step(0))?, moment(&self.to, When::Last)?);
        if run.time(from) >= run.time(to) {
            let (from, to) = (run.time(from), run.time(to));
            return Err(format!("{}: start: found {from}, expected a time before end, {to}", path.display()).into());
        }
        let members = self.of.members(ids, self.of.opened("tracks", path)?.data())?;
        let following = Following::new(Arc::clone(&run)).filter(|_| members.stay());
        let work = Work { progress: state, stop: state.stop() };
        let followed = following.map(|following| following.of(&members, work)).transpose()?.flatten();
        match followed {
            Some(followed) => {
                let wanted = |family, id| followed.has(family, id);
                let paths = RunPaths::of_members(run, PathsOf::Particles, from, to, &wanted)?;
                self.read(Data::Source(&paths), &Members::Region(Region::whole()), None, state)
            }
            None => {
                let paths = RunPaths::open(run, PathsOf::Particles, from, to)?;
                self.read(Data::Source(&paths), &members, None, state)
            }
        }
    }

    fn read(&self, data: Data, members: &Members, periodic: Option<f64>, state: &State) -> Result<Rows, Failure> {
        let memory = self.memory.unwrap_or_else(default_memory);
        let work = Work { progress: state, stop: state.stop() };
        Ok(rows(data, members, self.fields.as_deref(), memory, periodic, work)?)
    }
}

/// Rows as arrays by name, which take their memory over; and what they are, as JSON: names, units, families, whether they are exact.
///
/// # Errors
/// When Python has no room for them.
pub fn arrays(py: Python<'_>, rows: Rows) -> PyResult<(Bound<'_, PyDict>, String)> {
    let units = rows.columns.iter().map(|column| (column.name.clone(), column.unit.0.clone()));
    let units: BTreeMap<String, String> = units.collect();
    let about = json!({
        "families": rows.families,
        "units": units,
        "exact": rows.exact,
    });
    let found = PyDict::new(py);
    found.set_item("family", PyArray1::from_vec(py, rows.family))?;
    if let Some(ids) = rows.ids {
        found.set_item("id", PyArray1::from_vec(py, ids))?;
    }
    for column in rows.columns {
        found.set_item(column.name, PyArray1::from_vec(py, column.values))?;
    }
    Ok((found, about.to_string()))
}
