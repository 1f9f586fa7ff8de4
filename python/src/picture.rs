//! A finished picture, as Python has it: colours, numbers, and what they mean.

use crate::error::told;
use deepfield_draw::color::{Image, output};
use deepfield_draw::look::Shot;
use deepfield_draw::picture::asked::{ChannelValues, channels, facts, units_and_ends};
use deepfield_draw::picture::{self, AnySession};
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyType};
use std::path::PathBuf;

/// A picture as it was drawn, away from the interpreter.
pub struct Drawn {
    image: Image,
    channels: Vec<(&'static str, ChannelValues)>,
    /// What it shows, as JSON.
    about: String,
}

impl Drawn {
    /// A picture that was drawn of a shot, and its colours.
    pub fn new(session: &mut AnySession, shot: &Shot, image: Image, drawn: picture::Picture) -> Drawn {
        let (units, ends) = units_and_ends(session, &drawn);
        let about = facts(&drawn, shot, units.as_ref()).to_string();
        Drawn { image, channels: channels(drawn, ends), about }
    }

    /// The picture for Python, whose arrays take its memory over.
    ///
    /// # Errors
    /// When Python has no room for it.
    pub fn into_picture(self, py: Python<'_>) -> PyResult<Picture> {
        let Image { width, height, rgba } = self.image;
        let shape = [height as usize, width as usize];
        let channels = PyDict::new(py);
        for (name, values) in self.channels {
            match values {
                ChannelValues::Single(values) => {
                    channels.set_item(name, PyArray1::from_vec(py, values).reshape(shape)?)?;
                }
                ChannelValues::Double(values) => {
                    channels.set_item(name, PyArray1::from_vec(py, values).reshape(shape)?)?;
                }
            }
        }
        let rgba = PyArray1::from_vec(py, rgba.into_flattened()).unbind();
        Ok(Picture { width, height, rgba, channels: channels.unbind(), about: self.about })
    }
}

/// Width, height, colours, channels and what else is known of a picture.
type Parts = (u32, u32, Py<PyArray1<u8>>, Py<PyDict>, String);

/// A picture.
#[pyclass(frozen, module = "deepfield._deepfield")]
pub struct Picture {
    width: u32,
    height: u32,
    /// Red, green, blue and opacity of each pixel, one after the other; Python gets views of them, and may give those another shape.
    rgba: Py<PyArray1<u8>>,
    channels: Py<PyDict>,
    /// What it shows, as JSON.
    about: String,
}

#[pymethods]
impl Picture {
    /// The picture of what [`Picture::__reduce__`] tells.
    #[new]
    fn new(
        width: u32,
        height: u32,
        rgba: Bound<'_, PyArray1<u8>>,
        channels: Bound<'_, PyDict>,
        about: String,
    ) -> PyResult<Picture> {
        let expected = 4 * u64::from(width) * u64::from(height);
        if rgba.len() as u64 != expected {
            return Err(told(format!("rgba: found {} bytes, expected {expected}", rgba.len()).into()));
        }
        Ok(Picture { width, height, rgba: rgba.unbind(), channels: channels.unbind(), about })
    }

    /// How it is copied and sent to other processes.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyType>, Parts) {
        let py = slf.py();
        let Picture { width, height, rgba, channels, about } = slf.get();
        (slf.get_type(), (*width, *height, rgba.clone_ref(py), channels.clone_ref(py), about.clone()))
    }

    /// What it shows, as JSON.
    #[getter]
    fn about(&self) -> &str {
        &self.about
    }

    /// Its colours: height, width, and red, green, blue and opacity.
    fn rgba<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        self.rgba.bind(py).reshape([self.height as usize, self.width as usize, 4])
    }

    /// Its numbers by the channels' names: height and width each.
    fn channels(&self, py: Python<'_>) -> Py<PyDict> {
        self.channels.clone_ref(py)
    }

    /// Its colours as the bytes of a PNG.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let image = self.image(py)?;
        let bytes = py.detach(|| output::png(&image)).map_err(|error| told(error.into()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Writes its colours as PNG.
    fn write_png(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let image = self.image(py)?;
        py.detach(|| output::write_png(&path, &image)).map_err(|error| told(error.into()))
    }
}

impl Picture {
    /// A copy of its colours as they are now: other threads may write to them while a file is made.
    fn image(&self, py: Python<'_>) -> PyResult<Image> {
        let rgba = self.rgba.bind(py).try_readonly().map_err(|error| told(format!("rgba: {error}").into()))?;
        let bytes = rgba.as_slice().map_err(|error| told(format!("rgba: {error}").into()))?;
        Ok(Image { width: self.width, height: self.height, rgba: bytes.as_chunks::<4>().0.to_vec() })
    }
}
