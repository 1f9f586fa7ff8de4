//! What `render --json` tells about a picture.

use super::CommandResult;
use crate::color::output;
use crate::cpu::slice::arrows::ArrowKey;
use crate::cpu::surface::SurfaceReport;
use crate::mode::{LightPicture, Raw};
use crate::picture::field::PointsReport;
use crate::picture::surface::SurfaceShown;
use crate::picture::{LeftOut, LevelReport, Picture, ShownMoment};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// Statistics of a picture.
#[derive(Debug, Serialize)]
struct Statistics<'a> {
    /// Whether everything that the view needs at its error bound was drawn.
    converged: bool,
    /// Largest displacement of a drawn particle, pixels.
    error_px: f64,
    /// Particles of the selection.
    particles_drawn: u64,
    /// Nodes of the selection.
    nodes_drawn: usize,
    /// What drew.
    backend: &'a str,
    /// Its name and driver.
    adapter: &'a str,
    /// Visualization mode.
    mode: &'static str,
    /// The attribute that colours the picture.
    attribute: Option<&'a str>,
    /// Pixels.
    width: u32,
    /// Pixels.
    height: u32,
    /// When it is, of a run.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    moment: Option<&'a ShownMoment>,
    /// Of images and volumes.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    points: Option<&'a PointsReport>,
    #[serde(flatten)]
    values: Values<'a>,
    /// Of heights among other things.
    #[serde(skip_serializing_if = "Option::is_none")]
    surface: Option<Surface>,
    milliseconds: &'a BTreeMap<String, f64>,
}

/// What sums and colours tell of themselves.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Values<'a> {
    Sums {
        /// What was left out, and how that was decided.
        economy: &'a LeftOut,
        sum: f64,
        /// The time that was asked for, milliseconds.
        budget_ms: Option<f64>,
        #[serde(flatten)]
        levels: &'a LevelReport,
    },
    Surface {
        #[serde(flatten)]
        surface: Surface,
        /// What colours are spread over.
        range: [f64; 2],
        /// Heights that are written along lines.
        #[serde(skip_serializing_if = "Option::is_none")]
        contour_labels: Option<Vec<ContourLabel<'a>>>,
    },
    Light {
        levels: &'static str,
        splats: u64,
        budget: Option<u64>,
        /// The time that was asked for, milliseconds.
        budget_ms: Option<f64>,
        /// Of splats that lie over each other alone.
        #[serde(skip_serializing_if = "Option::is_none")]
        order: Option<&'static str>,
        grid: Box<Grid>,
        ranges: Ranges<'a>,
        /// Of slices with arrows.
        #[serde(skip_serializing_if = "Option::is_none")]
        arrows: Option<Arrows>,
    },
}

/// How long the arrows of a slice are.
#[derive(Debug, Serialize)]
struct Arrows {
    /// Length of a vector whose arrow is as long as arrows are apart.
    scale: f64,
    /// That, pixels.
    spacing: f64,
}

/// A height that is written along a line.
#[derive(Debug, Serialize)]
struct ContourLabel<'a> {
    level: f64,
    text: &'a str,
    /// The box around it: left, top, right, bottom, pixels.
    #[serde(rename = "box")]
    area: [f64; 4],
}

/// What was drawn of heights.
#[derive(Debug, Serialize)]
struct Surface {
    /// The finest and the coarsest level.
    levels: [u8; 2],
    samples_drawn: u64,
    points: u64,
    triangles: u64,
    /// The sum of alpha, pixels.
    covered: f64,
    /// Where the eye was lifted to.
    #[serde(skip_serializing_if = "Option::is_none")]
    eye: Option<[f64; 3]>,
}

impl Surface {
    fn of(SurfaceShown { report, lifted, .. }: &SurfaceShown) -> Surface {
        let SurfaceReport { levels, samples_drawn, points, triangles, covered, .. } = *report;
        Surface { levels, samples_drawn, points, triangles, covered, eye: *lifted }
    }
}

/// What the grid was, and what was done in it.
#[derive(Debug, Serialize)]
struct Grid {
    size: [u32; 3],
    near: f64,
    far: f64,
    slabs: usize,
    particles: u64,
    raised: u64,
    pairs: u64,
    bricks: u64,
    hidden: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    samples: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    crossings: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    memory_bytes: Option<u64>,
}

/// The ranges in use.
#[derive(Debug, Serialize)]
struct Ranges<'a> {
    density: [f64; 2],
    attribute: [f64; 2],
    unit_length: f64,
    isovalues: &'a [f64],
}

/// Writes a picture's statistics to a file, or to standard output for `-`.
///
/// # Errors
/// When the file cannot be written.
pub(super) fn write(path: &Path, picture: &Picture) -> CommandResult {
    let [backend, adapter] = &picture.drawn_by;
    let [width, height] = picture.size();
    write_json(
        path,
        &Statistics {
            converged: picture.converged,
            error_px: picture.error_px,
            particles_drawn: picture.particles,
            nodes_drawn: picture.nodes,
            backend,
            adapter,
            mode: picture.annotation.depiction.mode.name,
            attribute: picture.attribute(),
            width,
            height,
            moment: picture.moment.as_ref(),
            points: picture.points.as_ref(),
            values: values(picture),
            surface: picture.surface.as_ref().filter(|_| !picture.is_of_heights_alone()).map(Surface::of),
            milliseconds: &picture.milliseconds,
        },
    )
}

fn values(picture: &Picture) -> Values<'_> {
    if let (Some(surface), Raw::Light(light), true) = (&picture.surface, &picture.values, picture.is_of_heights_alone())
    {
        let contour_labels = surface.labels.as_ref().map(|labels| {
            labels
                .iter()
                .map(|label| ContourLabel { level: label.level, text: &label.text, area: label.area() })
                .collect()
        });
        return Values::Surface { surface: Surface::of(surface), range: light.levels.density, contour_labels };
    }
    let budget_ms = picture.annotation.depiction.choice.frame_ms;
    let LightPicture { report, levels, isovalues, .. } = match &picture.values {
        Raw::Sums(sums, _) => {
            let (economy, levels) = (&picture.left_out, &picture.level_report);
            return Values::Sums { economy, sum: sums.sum(), budget_ms, levels };
        }
        Raw::Light(painted) => painted,
    };
    Values::Light {
        levels: picture.drawn_from,
        splats: picture.level_report.splats,
        budget: picture.level_report.budget,
        budget_ms,
        order: picture.level_report.order,
        grid: Box::new(Grid {
            size: report.grid,
            near: report.planes[0],
            far: report.planes[1],
            slabs: report.slabs,
            particles: report.particles,
            raised: report.raised,
            pairs: report.pairs,
            bricks: report.bricks,
            hidden: report.hidden,
            samples: report.samples,
            crossings: report.crossings,
            memory_bytes: report.memory,
        }),
        ranges: Ranges {
            density: levels.density,
            attribute: levels.attribute,
            unit_length: levels.unit_length,
            isovalues,
        },
        arrows: picture.arrows().map(|ArrowKey { scale, spacing }| Arrows { scale, spacing }),
    }
}

/// Writes statistics of any kind to a file, or to standard output for `-`.
///
/// # Errors
/// When the file cannot be written.
pub(super) fn write_json(path: &Path, statistics: &impl Serialize) -> CommandResult {
    let text = serde_json::to_string_pretty(statistics)? + "\n";
    if path == Path::new("-") {
        std::io::stdout().write_all(text.as_bytes())?;
    } else {
        output::write_atomically(path, text.as_bytes())?;
    }
    Ok(())
}
