//! What is written into a picture: a legend of its colours, a scale bar, its time, axes, names of objects, a caption.
//!
//! The layout is computed once, as a [`DisplayList`] of lines and words in logical pixels, and painted by whoever shows the
//! picture: the window's user interface, or [`fn@paint`] on the processor. Both measure text with the same font.

pub mod axes;
pub mod chart;
pub mod clock;
pub mod color_bar;
pub mod display_list;
pub mod font;
pub mod key_arrow;
pub mod labels;
pub mod legend;
pub mod number;
pub mod overlay;
pub mod paint;
pub mod plot;
pub mod scale_bar;
pub mod svg;
pub mod ticks;

pub use chart::{Chart, ChartAxis, Marks, roomy};
pub use display_list::{Anchor, DisplayList, Rgba, Shape};
pub use key_arrow::KeyArrow;
pub use labels::Label;
pub use legend::{Legend, LegendAxis, Shown, Units};
pub use paint::{Paper, paint};

use crate::model::Bounds;
use crate::view::View;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Words and numbers.
pub const TEXT: Rgba = [0xe4, 0xe7, 0xec, 255];
/// What is said more quietly: units.
pub const QUIET: Rgba = [0xa8, 0xaf, 0xba, 255];

/// What is written into a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Annotations {
    /// What the colours mean.
    pub legend: bool,
    /// A round length, to scale at the distance of the point looked at.
    pub scale_bar: bool,
    /// The time of a run that is shown.
    pub clock: bool,
    /// The edges of the data's box, with coordinates.
    pub axes: bool,
    /// The directions of the axes, in a corner.
    pub triad: bool,
    /// How many names of objects there may be.
    pub labels: usize,
    /// A line at the top.
    pub caption: String,
    /// Size of text and lines: 1 has letters of 13 pixels; by the picture's size where it is `None`.
    #[serde(deserialize_with = "scale_in_range")]
    pub scale: Option<f32>,
}

impl Default for Annotations {
    fn default() -> Annotations {
        Annotations { legend: true, scale_bar: true, labels: 24, ..Annotations::NONE }
    }
}

fn scale_in_range<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<f32>, D::Error> {
    let scale = Option::<f32>::deserialize(deserializer)?;
    match scale {
        Some(scale) if !Annotations::SCALES.contains(&scale) => {
            Err(serde::de::Error::custom(format!("scale is {scale}, expected a number from 0.25 to 16")))
        }
        scale => Ok(scale),
    }
}

impl Annotations {
    /// Nothing at all.
    pub const NONE: Annotations = Annotations {
        legend: false,
        scale_bar: false,
        clock: false,
        axes: false,
        triad: false,
        labels: 0,
        caption: String::new(),
        scale: None,
    };
    /// What [`Annotations::scale`] may be.
    pub const SCALES: std::ops::RangeInclusive<f32> = 0.25..=16.0;
    /// The names by which [`Annotations::with`] knows its parts.
    pub const PARTS: [&str; 6] = ["legend", "scale-bar", "clock", "axes", "triad", "labels"];

    /// With the part of that name.
    ///
    /// # Errors
    /// The names that there are, for another one.
    pub fn with(mut self, part: &str) -> Result<Annotations, String> {
        match part {
            "legend" => self.legend = true,
            "scale-bar" => self.scale_bar = true,
            "clock" => self.clock = true,
            "axes" => self.axes = true,
            "triad" => self.triad = true,
            "labels" => self.labels = Annotations::default().labels,
            _ => return Err(format!("{part} is no annotation, expected one of {}", Annotations::PARTS.join(", "))),
        }
        Ok(self)
    }

    /// Pixels per logical pixel in a picture of this size: what is set, or what makes text as large as a reader of the whole
    /// picture expects.
    pub fn scale_for(&self, width: u32, height: u32) -> f32 {
        let usual = (width as f32 / 1200.0).min(height as f32 / 720.0).clamp(0.75, 16.0);
        self.scale.unwrap_or(usual)
    }
}

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The camera; its picture has physical pixels.
    pub view: &'a View,
    /// Physical pixels per logical one.
    pub scale: f32,
    /// The point looked at.
    pub target: DVec3,
    /// The data's box, world units.
    pub bounds: Bounds,
    /// Unit of positions; empty where it is not known.
    pub length_unit: &'a str,
    /// The time in the data's words; empty where the data has none.
    pub time: &'a str,
    /// What the colours mean, where that is known.
    pub legend: Option<&'a Legend>,
    /// Named objects, the most important one first.
    pub labels: &'a [Label],
}

/// Everything that is written into a picture, in logical pixels from its top left corner.
pub fn layout(annotations: &Annotations, subject: &Subject<'_>) -> DisplayList {
    let size = [subject.view.width, subject.view.height].map(|side| side as f32 / subject.scale);
    let mut list = DisplayList::new(size);
    // What stands in the corners comes first; what follows makes room for it.
    if annotations.legend
        && let Some(legend) = subject.legend
    {
        color_bar::layout(&mut list, legend);
    }
    if annotations.scale_bar {
        scale_bar::layout(&mut list, subject);
    }
    if annotations.triad {
        axes::layout_triad(&mut list, subject.view);
    }
    if !annotations.caption.is_empty() {
        list.text([0.5 * size[0], 12.0], Anchor::TOP, &annotations.caption, 16.0, TEXT);
    }
    if annotations.clock {
        clock::layout(&mut list, subject.time);
    }
    if annotations.legend
        && let Some(arrow) = subject.legend.and_then(|legend| legend.arrow.as_ref())
    {
        key_arrow::layout(&mut list, arrow, subject.scale);
    }
    if annotations.axes {
        axes::layout_box(&mut list, subject);
    }
    if annotations.labels > 0 {
        labels::layout(&mut list, subject, annotations.labels);
    }
    list
}

#[cfg(test)]
mod tests;
