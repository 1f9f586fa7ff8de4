//! A finished picture, as Python has it: colours, numbers, and what they mean.

use crate::error::told;
use deepfield_draw::annotate::{Legend, LegendAxis, Shown, Units};
use deepfield_draw::color::{Image, output};
use deepfield_draw::look::Shot;
use deepfield_draw::mode::Raw;
use deepfield_draw::picture::surface::CHANNELS;
use deepfield_draw::picture::{self, AnySession};
use deepfield_draw::view::{Projection, View};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};
use std::path::PathBuf;

/// The values of a channel, row 0 at the top.
enum Values {
    Single(Vec<f32>),
    /// Places, which 32 bits do not hold.
    Double(Vec<f64>),
}

/// A picture.
#[pyclass(frozen, module = "deepfield._deepfield")]
pub struct Picture {
    image: Image,
    channels: Vec<(&'static str, Values)>,
    /// What it shows, as JSON.
    about: String,
}

impl Picture {
    /// A picture that was drawn of a shot, and its colours.
    pub fn new(session: &mut AnySession, shot: &Shot, image: Image, drawn: picture::Picture) -> Picture {
        let units =
            session.particles().map(|session| Units::of(session.tree().metadata(), &drawn.annotation.depiction));
        let about = about(&drawn, shot, units.as_ref()).to_string();
        Picture { image, channels: channels(drawn), about }
    }
}

/// The numbers of a picture: `P`, and `S` where it has some, NaN where nothing was drawn; of colours linear light, premultiplied with opacity;
/// of heights these and what is at the middle of each pixel.
fn channels(drawn: picture::Picture) -> Vec<(&'static str, Values)> {
    let light = match drawn.values {
        Raw::Sums(sums, _) => {
            let s: Option<Vec<f32>> = sums
                .has_attribute()
                .then(|| (0..sums.p.len()).map(|index| sums.s(index).unwrap_or(f32::NAN)).collect());
            let s = s.map(|s| ("S", Values::Single(s)));
            return [("P", Values::Single(sums.p))].into_iter().chain(s).collect();
        }
        Raw::Light(painted) => painted.colors.rgba,
    };
    let of_light =
        |(at, name): (usize, &'static str)| (name, Values::Single(light.iter().map(|pixel| pixel[at]).collect()));
    let mut channels: Vec<(&'static str, Values)> =
        ["R", "G", "B", "A"].into_iter().enumerate().map(of_light).collect();
    if let Some(found) = drawn.surface.and_then(|surface| surface.channels) {
        let of_heights = |(at, name): (usize, &'static str)| {
            (name, Values::Double(found.values.iter().map(|pixel| pixel[at]).collect()))
        };
        channels.extend(CHANNELS.into_iter().enumerate().map(of_heights));
    }
    channels
}

fn about(drawn: &picture::Picture, shot: &Shot, units: Option<&Units>) -> Value {
    let depiction = &drawn.annotation.depiction;
    let view = &drawn.annotation.view;
    let is_sum = matches!(drawn.values, Raw::Sums(..));
    let p_unit = units.map(|units| match &units.value {
        Shown::Named(_, unit) => unit.clone(),
        Shown::Mode | Shown::Colors => (depiction.mode.unit)(&units.mass, &units.length),
    });
    json!({
        "mode": depiction.mode.name,
        "quantity": depiction.mode.quantity,
        "attribute": drawn.attribute(),
        "unit": units.map(|units| &units.length),
        "units": {
            "P": p_unit.filter(|_| is_sum),
            "S": units.map(|units| &units.attribute).filter(|_| is_sum),
        },
        "extent": extent(view).filter(|_| !shot.is_projected()),
        "fov": match view.projection {
            Projection::Perspective { fov_y } => Some(fov_y.to_degrees()),
            Projection::Orthographic { .. } => None,
        },
        "view": {
            "eye": view.eye.to_array(),
            "right": view.right.to_array(),
            "up": view.up.to_array(),
            "forward": view.forward.to_array(),
        },
        "converged": drawn.converged,
        "error_px": drawn.error_px,
        "legend": drawn.legend().as_ref().map(legend),
        "particles": drawn.particles,
        "nodes": drawn.nodes,
        "drawn_from": drawn.drawn_from,
        "milliseconds": drawn.milliseconds,
    })
}

/// What colours mean: the axis of brightness, or of the one colour there is, and that of the hue, with the colours along each.
fn legend(legend: &Legend) -> Value {
    let axis = |axis: &LegendAxis, colors: Vec<[u8; 4]>| {
        json!({
            "title": axis.title,
            "unit": axis.unit,
            "range": axis.range,
            "logarithmic": axis.log,
            "colors": colors,
        })
    };
    let along = |color: &dyn Fn(f32) -> [u8; 4]| -> Vec<[u8; 4]> {
        (0..256).map(|place| color(place as f32 / 255.0)).collect()
    };
    // A hue is told at full brightness, and brightness where there is one in the middle of the hues.
    let brightness = axis(&legend.p, along(&|place| legend.color(place, 0.5)));
    let hue = legend.s.as_ref().map(|s| axis(s, along(&|place| legend.color(1.0, place))));
    json!({ "brightness": brightness, "hue": hue })
}

/// Left, right, lower and upper edge of a picture with parallel lines of sight, from its middle along its own right and up.
fn extent(view: &View) -> Option<[f64; 4]> {
    let Projection::Orthographic { height } = view.projection else { return None };
    let (half_height, half_width) = (0.5 * height, 0.5 * height * f64::from(view.width) / f64::from(view.height));
    Some([-half_width, half_width, -half_height, half_height])
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
                Values::Single(values) => found.set_item(*name, PyArray1::from_slice(py, values).reshape(shape)?)?,
                Values::Double(values) => found.set_item(*name, PyArray1::from_slice(py, values).reshape(shape)?)?,
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
