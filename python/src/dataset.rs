//! Data that Python has opened: what it holds, pictures of it, and what is asked of it.

use crate::asked::read_asked;
use crate::cache;
use crate::error::{Failure, told};
use crate::grids::{AskedSamples, Samples};
use crate::picture::{Drawn, Picture};
use crate::plots::AskedPlot;
use crate::table::{AskedRows, arrays};
use crate::tours::AskedTour;
use crate::work;
use deepfield_draw::explore::Rows;
use deepfield_draw::look::{DatasetRef, Member, Shot};
use deepfield_draw::model::Progress;
use deepfield_draw::picture::asked::{Asked, AskedData, AskedProbe, State, about, on_threads, only};
use deepfield_draw::picture::{AnySession, PictureError, Reporter, SessionOptions};
use deepfield_draw::store::keep_pages_from_afar;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;

/// Datasets that are shown together.
#[pyclass(frozen, module = "deepfield._deepfield")]
pub struct Dataset {
    /// Where they lie, and what is said of them.
    members: Arc<[Member]>,
    /// Bytes that builds into the cache may take; half of what is free where nothing is said.
    memory: Option<u64>,
    /// What they hold, as JSON.
    about: String,
}

/// Opens what `paths` name, or a scene does; sources of particles are built into the cache first, on so many threads and in so many bytes of memory, unless they are
/// there. Also gives what there was to tell.
///
/// # Errors
/// As [`work::run`].
#[pyfunction]
pub fn open(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    asked: &str,
    threads: Option<usize>,
    memory: Option<u64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Dataset, Vec<String>)> {
    let asked: AskedData = read_asked(asked).map_err(told)?;
    let job = move |state: &Arc<State>| -> Result<Dataset, Failure> {
        keep_pages_from_afar(cache::for_pages_from_afar);
        on_threads(threads, || {
            let members: Arc<[Member]> = asked.members(&paths, &**state)?.into();
            let about =
                about(&members, |path| Ok(cache::page_file(&members, path, memory, state)?), &**state)?.to_string();
            Ok(Dataset { members, memory, about })
        })
    };
    work::run_writing(py, progress, job)
}

/// The file of the one dataset that is asked for `what`: where something is derived for its particles their page file in the cache, which is built first
/// unless it is there.
fn asked_of(what: &str, members: &[Member], memory: Option<u64>, state: &State) -> Result<PathBuf, Failure> {
    let member = only(what, members)?;
    match member.said.derive.is_empty() {
        true => Ok(member.path.clone()),
        false => cache::page_file(members, &member.path, memory, state),
    }
}

/// What is said of a dataset, as scenes have it but without its path, which need not be a text.
fn said_of(member: &Member) -> Result<Value, Failure> {
    let dataset = DatasetRef { path: PathBuf::new(), ..DatasetRef::from(member.clone()) };
    let mut said = serde_json::to_value(dataset)?;
    if let Some(fields) = said.as_object_mut() {
        fields.retain(|name, value| name != "path" && !value.is_null());
    }
    Ok(said)
}

/// Opens datasets for shots of them, as `deepfield render` does; `memory` is of builds into the cache.
fn session<'a>(
    members: &[Member],
    options: SessionOptions,
    shots: impl IntoIterator<Item = &'a Shot>,
    memory: Option<u64>,
    state: &Arc<State>,
) -> Result<AnySession, PictureError> {
    let reporter: Arc<dyn Reporter> = state.clone();
    AnySession::open(members, options, shots, |path| Ok(cache::page_file(members, path, memory, state)?), reporter)
}

/// Ids that an array holds.
fn ids_in(ids: Option<Bound<'_, PyArray1<u64>>>) -> PyResult<Option<Vec<u64>>> {
    let Some(ids) = ids else { return Ok(None) };
    let ids = ids.try_readonly().map_err(|error| told(format!("ids: {error}").into()))?;
    Ok(Some(ids.as_array().to_vec()))
}

/// Rows as arrays, what they are as JSON, and what there was to tell.
type Table<'py> = (Bound<'py, PyDict>, String, Vec<String>);

#[pymethods]
impl Dataset {
    /// What it holds, as JSON.
    #[getter]
    fn about(&self) -> &str {
        &self.about
    }

    /// What files it is of.
    #[getter]
    fn paths(&self) -> Vec<OsString> {
        // Python's own paths would have one slash of a URL's two.
        self.members.iter().map(|member| member.path.as_os_str().to_owned()).collect()
    }

    /// Bytes that builds into the cache may take, where that is said.
    #[getter]
    fn memory(&self) -> Option<u64> {
        self.memory
    }

    /// What is said of each of them, as JSON.
    #[getter]
    fn said(&self) -> PyResult<String> {
        let said = self.members.iter().map(said_of).collect::<Result<Vec<_>, _>>().map_err(told)?;
        Ok(Value::from(said).to_string())
    }

    /// A picture, and what there was to tell.
    fn render(
        &self,
        py: Python<'_>,
        asked: &str,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Picture, Vec<String>)> {
        let (members, memory, asked) = (Arc::clone(&self.members), self.memory, asked.to_owned());
        let job = move |state: &Arc<State>| -> Result<Drawn, Failure> {
            on_threads(threads, || {
                let asked: Asked = read_asked(&asked)?;
                let mut members = members.to_vec();
                let (mut shot, options) = asked.request(&mut members, &**state)?;
                let mut session = session(&members, options, [&shot], memory, state)?;
                // Without a stage nobody is told anything, nor may end it.
                state.begin("drawing", 0);
                state.set_writing(false);
                asked.recolor(&mut session, &mut shot)?;
                let drawn = session.draw(&shot)?;
                let image = session.finished(&shot, &drawn)?;
                Ok(Drawn::new(&mut session, &shot, image, drawn))
            })
        };
        let (drawn, told) = work::run_alone(py, progress, job)?;
        Ok((drawn.into_picture(py)?, told))
    }

    /// What is in a region, as JSON, and what there was to tell.
    fn probe(
        &self,
        py: Python<'_>,
        asked: &str,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(String, Vec<String>)> {
        let (members, memory, asked) = (Arc::clone(&self.members), self.memory, asked.to_owned());
        let job = move |state: &Arc<State>| -> Result<String, Failure> {
            let asked: AskedProbe = read_asked(&asked)?;
            on_threads(threads, || {
                Ok(serde_json::to_string(&asked.answer(&asked_of("probe", &members, memory, state)?, state)?)?)
            })
        };
        work::run_alone(py, progress, job)
    }

    /// The numbers of a plot, as JSON, and what there was to tell.
    fn plot(
        &self,
        py: Python<'_>,
        asked: &str,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(String, Vec<String>)> {
        let (members, memory, asked) = (Arc::clone(&self.members), self.memory, asked.to_owned());
        let job = move |state: &Arc<State>| -> Result<String, Failure> {
            let asked: AskedPlot = read_asked(&asked)?;
            on_threads(threads, || asked.answer(&asked_of("plot", &members, memory, state)?, state))
        };
        work::run_alone(py, progress, job)
    }

    /// The rows of a region, or of ids: arrays by name, what they are, and what there was to tell.
    fn select<'py>(
        &self,
        py: Python<'py>,
        asked: &str,
        ids: Option<Bound<'py, PyArray1<u64>>>,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Table<'py>> {
        let (members, memory, asked) = (Arc::clone(&self.members), self.memory, asked.to_owned());
        let ids = ids_in(ids)?;
        let job = move |state: &Arc<State>| -> Result<Rows, Failure> {
            let asked: AskedRows = read_asked(&asked)?;
            on_threads(threads, || asked.rows(&asked_of("select", &members, memory, state)?, ids, state))
        };
        let (rows, told) = work::run_alone(py, progress, job)?;
        let (found, about) = arrays(py, rows)?;
        Ok((found, about, told))
    }

    /// Writes the rows of a region, or of ids, to a file; gives their number, and what there was to tell.
    fn export(
        &self,
        py: Python<'_>,
        asked: &str,
        ids: Option<Bound<'_, PyArray1<u64>>>,
        out: PathBuf,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(u64, Vec<String>)> {
        let (members, memory, asked) = (Arc::clone(&self.members), self.memory, asked.to_owned());
        let ids = ids_in(ids)?;
        let job = move |state: &Arc<State>| -> Result<u64, Failure> {
            let asked: AskedRows = read_asked(&asked)?;
            on_threads(threads, || {
                let named = &only("export", &members)?.path;
                asked.export(&asked_of("export", &members, memory, state)?, named, ids, &out, state)
            })
        };
        work::run_writing(py, progress, job)
    }

    /// The ends of tracks of a run in the same way.
    fn tracks<'py>(
        &self,
        py: Python<'py>,
        asked: &str,
        ids: Option<Bound<'py, PyArray1<u64>>>,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Table<'py>> {
        let (members, asked) = (Arc::clone(&self.members), asked.to_owned());
        let ids = ids_in(ids)?;
        let job = move |state: &Arc<State>| -> Result<Rows, Failure> {
            let asked: AskedRows = read_asked(&asked)?;
            on_threads(threads, || asked.paths(&only("paths", &members)?.path, ids, state))
        };
        let (rows, told) = work::run_alone(py, progress, job)?;
        let (found, about) = arrays(py, rows)?;
        Ok((found, about, told))
    }

    /// Samples of an image or a volume as bytes, and what they are, as JSON.
    fn samples<'py>(
        &self,
        py: Python<'py>,
        asked: &str,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray1<u8>>, String)> {
        let (members, asked) = (Arc::clone(&self.members), asked.to_owned());
        let job = move |state: &Arc<State>| -> Result<Samples, Failure> {
            let asked: AskedSamples = read_asked(&asked)?;
            asked.grid(&only("array", &members)?.path, state)
        };
        let (found, _) = work::run_alone(py, progress, job)?;
        Ok((PyArray1::from_vec(py, found.bytes), found.about.to_string()))
    }

    /// A window of measured heights, and what they are, as JSON.
    fn heights<'py>(
        &self,
        py: Python<'py>,
        asked: &str,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, String)> {
        let (members, asked) = (Arc::clone(&self.members), asked.to_owned());
        let job = move |_: &Arc<State>| -> Result<(Vec<f64>, [usize; 2], Value), Failure> {
            let asked: AskedSamples = read_asked(&asked)?;
            asked.heights(only("heights", &members)?)
        };
        let ((heights, shape, about), _) = work::run_alone(py, progress, job)?;
        Ok((PyArray1::from_vec(py, heights).reshape(shape)?, about.to_string()))
    }

    /// Draws the frames of a tour into a folder; gives their files, and what there was to tell.
    fn record(
        &self,
        py: Python<'_>,
        asked: &str,
        folder: PathBuf,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Vec<PathBuf>, Vec<String>)> {
        let (members, memory, asked) = (Arc::clone(&self.members), self.memory, asked.to_owned());
        let job = move |state: &Arc<State>| -> Result<Vec<PathBuf>, Failure> {
            let asked: AskedTour = read_asked(&asked)?;
            let open = |members: &[Member], options: SessionOptions| session(members, options, [], memory, state);
            on_threads(asked.threads, || {
                let mut show = asked.open(only("tour", &members)?, open, state)?;
                asked.record(&mut show, &folder, state)
            })
        };
        work::run_writing(py, progress, job)
    }

    /// The text of the scene that a tour shows at a time, in seconds, and what there was to tell.
    fn scene(
        &self,
        py: Python<'_>,
        asked: &str,
        time: f64,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(String, Vec<String>)> {
        let (members, memory, asked) = (Arc::clone(&self.members), self.memory, asked.to_owned());
        let job = move |state: &Arc<State>| -> Result<String, Failure> {
            let asked: AskedTour = read_asked(&asked)?;
            let open = |members: &[Member], options: SessionOptions| session(members, options, [], memory, state);
            let mut show = asked.open(only("tour", &members)?, open, state)?;
            asked.scene(&mut show, time)
        };
        work::run_alone(py, progress, job)
    }
}
