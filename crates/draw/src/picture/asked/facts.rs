//! What a finished picture shows, in numbers and as JSON.

use crate::annotate::{Legend, LegendAxis, Shown, Units};
use crate::look::Shot;
use crate::mode::Raw;
use crate::picture::surface::CHANNELS;
use crate::picture::{AnySession, Picture};
use crate::store::FamilyMetadata;
use crate::view::{Projection, View};
use serde_json::{Value, json};
use std::sync::Arc;

/// The values of a channel, row 0 at the top.
pub enum ChannelValues {
    /// Single precision.
    Single(Vec<f32>),
    /// Places, which 32 bits do not hold.
    Double(Vec<f64>),
}

/// The numbers of a picture: `P`, and `S` where it has some, NaN where nothing was drawn; of colours linear light, premultiplied with opacity;
/// of sections through particles these and the values, of heights these and what is at the middle of each pixel. `ends` are those of the
/// attribute, between which its means are: beside the edge of what is drawn the filters of the image pyramid leave sums that are small beside
/// their own error, and the ratio of two such is any number.
pub fn channels(drawn: Picture, ends: Option<[f64; 2]>) -> Vec<(&'static str, ChannelValues)> {
    let (light, shown) = match drawn.values {
        Raw::Sums(sums, _) => {
            let within = |s: f32| match ends {
                Some([least, largest]) => s.max(least as f32).min(largest as f32),
                None => s,
            };
            let s: Option<Vec<f32>> = sums
                .has_attribute()
                .then(|| (0..sums.p.len()).map(|index| sums.s(index).map_or(f32::NAN, within)).collect());
            let s = s.map(|s| ("S", ChannelValues::Single(s)));
            return [("P", ChannelValues::Single(sums.p))].into_iter().chain(s).collect();
        }
        Raw::Light(painted) => (painted.colors.rgba, painted.report.values.map(Arc::unwrap_or_clone)),
    };
    let of_light = |(at, name): (usize, &'static str)| {
        (name, ChannelValues::Single(light.iter().map(|pixel| pixel[at]).collect()))
    };
    let mut channels: Vec<(&'static str, ChannelValues)> =
        ["R", "G", "B", "A"].into_iter().enumerate().map(of_light).collect();
    channels.extend(shown.map(|values| ("value", ChannelValues::Single(values))));
    if let Some(found) = drawn.surface.and_then(|surface| surface.channels) {
        let of_heights = |(at, name): (usize, &'static str)| {
            (name, ChannelValues::Double(found.values.iter().map(|pixel| pixel[at]).collect()))
        };
        channels.extend(CHANNELS.into_iter().enumerate().map(of_heights));
    }
    channels
}

/// The smallest and the largest value of an attribute in some families; `None` where none of them has any.
fn attribute_ends(families: &[FamilyMetadata], name: &str) -> Option<[f64; 2]> {
    let known = families.iter().flat_map(|family| {
        let own = family.quantities.iter().chain(&family.attributes);
        own.filter(move |info| info.name == name && info.missing < family.count).map(|info| [info.min, info.max])
    });
    known.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// The units of a picture of particles, and the smallest and the largest value of the attribute that colours it.
pub fn units_and_ends(session: &mut AnySession, drawn: &Picture) -> (Option<Units>, Option<[f64; 2]>) {
    let known = session.particles().map(|session| {
        let metadata = session.tree().metadata();
        // Between its steps a run knows those of a few steps alone.
        let name = drawn.attribute().filter(|_| session.run().is_none());
        let ends = name.and_then(|name| attribute_ends(&metadata.families, name));
        (Units::of(metadata, &drawn.annotation.depiction), ends)
    });
    let (units, ends) = known.unzip();
    (units, ends.flatten())
}

/// What a picture shows. `units` are those of particles.
pub fn facts(drawn: &Picture, shot: &Shot, units: Option<&Units>) -> Value {
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
    // Brightness is told in the middle of the hues, where there are some, and hues where they differ most: the brightest may all be white.
    let brightness = axis(&legend.p, along(&|place| legend.color(place, 0.5)));
    let hues = (0..=16).map(|step| along(&|place| legend.color(step as f32 / 16.0, place)));
    let hue = legend.s.as_ref().map(|s| axis(s, hues.max_by_key(|colors| differences(colors)).unwrap_or_default()));
    json!({ "brightness": brightness, "hue": hue })
}

/// How far colours are from those before them, in all.
fn differences(colors: &[[u8; 4]]) -> u32 {
    let of_pair = |pair: &[[u8; 4]]| -> u32 { (0..3).map(|i| u32::from(pair[0][i].abs_diff(pair[1][i]))).sum() };
    colors.windows(2).map(of_pair).sum()
}

/// Left, right, lower and upper edge of a picture with parallel lines of sight, from its middle along its own right and up.
fn extent(view: &View) -> Option<[f64; 4]> {
    let Projection::Orthographic { height } = view.projection else { return None };
    let (half_height, half_width) = (0.5 * height, 0.5 * height * f64::from(view.width) / f64::from(view.height));
    Some([-half_width, half_width, -half_height, half_height])
}
