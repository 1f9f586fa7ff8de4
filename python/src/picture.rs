//! A finished picture, as Python has it: colours, numbers, and what they mean.

use crate::error::told;
use deepfield_draw::annotate::Units;
use deepfield_draw::color::{Image, output};
use deepfield_draw::look::Shot;
use deepfield_draw::picture::asked::{ChannelValues, channels, facts};
use deepfield_draw::picture::{self, AnySession};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A picture.
#[pyclass(frozen, module = "deepfield._deepfield")]
pub struct Picture {
    image: Image,
    channels: Vec<(&'static str, ChannelValues)>,
    /// What it shows, as JSON.
    about: String,
}

impl Picture {
    /// A picture that was drawn of a shot, and its colours.
    pub fn new(session: &mut AnySession, shot: &Shot, image: Image, drawn: picture::Picture) -> Picture {
        let units =
            session.particles().map(|session| Units::of(session.tree().metadata(), &drawn.annotation.depiction));
        let about = facts(&drawn, shot, units.as_ref()).to_string();
        Picture { image, channels: channels(drawn), about }
    }
}

#[pymethods]
impl Picture {
    /// What it shows, as JSON.
    #[getter]
    fn about(&self) -> &str {
        &self.about
    }

    /// Its colours: height, width, and red, green, blue and opacity.
    fn rgba<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        PyArray1::from_slice(py, self.image.rgba.as_flattened()).reshape([self.rows(), self.columns(), 4])
    }

    /// Its numbers by the channels' names: height and width each.
    fn channels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = PyDict::new(py);
        let shape = [self.rows(), self.columns()];
        for (name, values) in &self.channels {
            match values {
                ChannelValues::Single(values) => {
                    found.set_item(*name, PyArray1::from_slice(py, values).reshape(shape)?)?
                }
                ChannelValues::Double(values) => {
                    found.set_item(*name, PyArray1::from_slice(py, values).reshape(shape)?)?
                }
            }
        }
        Ok(found)
    }

    /// Writes its colours as PNG.
    fn write_png(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| output::write_png(&path, &self.image)).map_err(|error| told(error.into()))
    }
}

impl Picture {
    fn rows(&self) -> usize {
        self.image.height as usize
    }

    fn columns(&self) -> usize {
        self.image.width as usize
    }
}
