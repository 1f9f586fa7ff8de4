//! Data that Python has opened: what it holds, pictures of it, and what is in a region.

use crate::about::about;
use crate::error::Failure;
use crate::opening::open_any;
use crate::picture::Picture;
use crate::request::Asked;
use crate::work::{self, State};
use deepfield_draw::explore::{self, Data, Fields, ProbeOptions, ProfileOptions, Region, Work, probe, source_of};
use deepfield_draw::import::{Source, open_with};
use deepfield_draw::look::{DataKind, Member, data_file};
use deepfield_draw::model::{ReadMethod, When};
use deepfield_draw::store::{PageFile, RunFile};
use pyo3::prelude::*;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Datasets that are shown together.
#[pyclass(frozen, module = "deepfield._deepfield")]
pub struct Dataset {
    /// What files they are.
    paths: Vec<PathBuf>,
    /// What they hold, as JSON.
    about: String,
}

/// Opens what `paths` name; sources of particles are built into the cache first, unless they are there. Also gives what there was to tell.
///
/// # Errors
/// As [`work::run`].
#[pyfunction]
pub fn open(py: Python<'_>, paths: Vec<PathBuf>, progress: Option<Py<PyAny>>) -> PyResult<(Dataset, Vec<String>)> {
    let job = |state: &Arc<State>| -> Result<Dataset, Failure> {
        let paths = paths.iter().map(|path| data_file(path)).collect::<Result<Vec<_>, _>>()?;
        let about = about(&members(&paths), state)?.to_string();
        Ok(Dataset { paths, about })
    };
    work::run(py, progress, job)
}

fn members(paths: &[PathBuf]) -> Vec<Member> {
    paths.iter().map(Member::new).collect()
}

#[pymethods]
impl Dataset {
    /// What it holds, as JSON.
    #[getter]
    fn about(&self) -> &str {
        &self.about
    }

    /// What files it is of.
    #[getter]
    fn paths(&self) -> Vec<PathBuf> {
        self.paths.clone()
    }

    /// A picture, and what there was to tell.
    fn render(&self, py: Python<'_>, asked: &str, progress: Option<Py<PyAny>>) -> PyResult<(Picture, Vec<String>)> {
        let job = |state: &Arc<State>| -> Result<Picture, Failure> {
            let asked: Asked = serde_json::from_str(asked)?;
            let mut members = members(&self.paths);
            let (shot, options) = asked.request(&mut members)?;
            let mut session = open_any(&members, options, &shot, state)?;
            let drawn = session.draw(&shot)?;
            let image = session.finished(&shot, &drawn)?;
            Ok(Picture::new(&mut session, &shot, image, drawn))
        };
        work::run(py, progress, job)
    }

    /// What is in a region, as JSON, and what there was to tell.
    fn probe(&self, py: Python<'_>, asked: &str, progress: Option<Py<PyAny>>) -> PyResult<(String, Vec<String>)> {
        let job = |state: &Arc<State>| -> Result<String, Failure> {
            let asked: AskedProbe = serde_json::from_str(asked)?;
            match &self.paths[..] {
                [only] => asked.answer(only, state),
                several => Err(format!("probe: found {} datasets, expected one", several.len()).into()),
            }
        };
        work::run(py, progress, job)
    }
}

/// What is asked of a region.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct AskedProbe {
    /// Which particles.
    region: Region,
    /// Whose statistics; of all fields where nothing is said.
    fields: Option<Vec<String>>,
    /// Shells of equal width of a profile in the region's sphere.
    shells: Option<usize>,
    /// The field whose means are in them.
    shell_field: Option<String>,
    /// Whether the source is asked that a page file was built from.
    exact: bool,
    /// Whether distances are taken without going round the periodic box.
    no_wrap: bool,
    /// When, of a run.
    time: Option<String>,
}

/// A page file or a source, opened.
enum Opened {
    Pages(Box<PageFile>),
    Source(Box<dyn Source>),
}

impl AskedProbe {
    fn answer(&self, path: &Path, state: &State) -> Result<String, Failure> {
        self.region.check()?;
        let opened = self.opened(path)?;
        let data = match &opened {
            Opened::Pages(file) => Data::Pages(&**file),
            Opened::Source(source) => Data::Source(source.as_ref()),
        };
        let options = ProbeOptions {
            fields: self.fields.clone().map_or(Fields::All, Fields::Named),
            profile: self.shells.map(|shells| ProfileOptions { shells, inner: None, field: self.shell_field.clone() }),
            periodic: if self.no_wrap { None } else { data.periodic_edge()? },
        };
        let work = Work { progress: state, stop: state.stop() };
        let found: explore::Probe = probe(data, &self.region, &options, work)?;
        Ok(serde_json::to_string(&found)?)
    }

    /// Opens what is asked: of a run the stored step at or before the time.
    fn opened(&self, path: &Path) -> Result<Opened, Failure> {
        let method = ReadMethod::default();
        let kind = DataKind::of(path)?;
        let when = self.time.as_deref().map(str::parse::<When>).transpose()?;
        if when.is_some() && kind != DataKind::Run {
            return Err(format!("{}: time: found one moment alone, expected a run", path.display()).into());
        }
        let file = match kind {
            DataKind::Source => return Ok(Opened::Source(open_with(path, method)?)),
            DataKind::Pages => PageFile::open_with(path, method)?,
            DataKind::Run => {
                let run = RunFile::open(path, method)?;
                run.placed_still(run.moment(when.unwrap_or(When::Step(0)))?.step)?
            }
            DataKind::Grid | DataKind::Heights => {
                return Err(format!("{}: probe: found {}, expected particles", path.display(), kind.described()).into());
            }
        };
        Ok(match self.exact {
            true => Opened::Source(source_of(&file)?),
            false => Opened::Pages(Box::new(file)),
        })
    }
}
