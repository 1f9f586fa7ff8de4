//! `deepfield render` for the modes that draw colours straight from particles.

use super::CommandResult;
use super::annotate::Stage;
use super::exact_source::ExactSource;
use super::projected;
use super::request::Request;
use super::statistics::{Shown, Times, write_json};
use super::studio::{Studio, look_ahead};
use crate::annotate::Units;
use crate::cpu::volume::{Caster, Processor, VolumeError};
use crate::look::{Backend, ERROR_PX};
use crate::mode::{Adapter, Mode, Painted};
use crate::model::Bounds;
use crate::picture::paint::{Subject, paint_nodes, paint_particles};
use crate::picture::processor;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Statistics of a run, as `--json` writes them.
#[derive(Debug, Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    shown: Shown<'a>,
    levels: &'static str,
    grid: Grid,
    ranges: Ranges<'a>,
    milliseconds: &'a BTreeMap<String, f64>,
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

/// What was painted, and from what.
pub(super) struct Outcome {
    pub painted: Painted,
    pub stage: Stage,
    pub levels: &'static str,
    pub attribute: Option<String>,
    pub converged: bool,
    pub error_pixels: f64,
    pub particles: u64,
    pub nodes: usize,
    /// What drew: backend and adapter.
    pub caster: [String; 2],
    pub milliseconds: BTreeMap<String, f64>,
}

/// Draws a picture of a mode that paints: of an open page file, or where there is none, of source particles.
///
/// # Errors
/// When the source cannot be read, or a setting does not fit the data.
pub(super) fn draw(
    request: &Request,
    mode: &'static Mode,
    studio: Option<&mut Studio>,
) -> Result<Outcome, Box<dyn std::error::Error + Send + Sync>> {
    if request.overdraw.is_some() {
        return Err(format!("--overdraw: the mode {} has no splats", mode.name).into());
    }
    // Settings come from the file that the user wrote, if there is one.
    let named = request.named.display();
    request.look().settings.check(mode).map_err(|error| format!("{named}: {error}"))?;
    if request.shot.is_projected() {
        return projected::paint(request, studio).map_err(|error| format!("{named}: {error}").into());
    }
    let caster = &*caster(request, mode)?;
    let mut times = Times::default();
    let outcome = match studio {
        None => paint_exact(request, caster, &mut times)?,
        Some(studio) => paint_pages(request, caster, studio, &mut times)?,
    };
    Ok(Outcome { caster: caster.name().map(str::to_owned), milliseconds: times.medians(), ..outcome })
}

/// Writes statistics as JSON.
pub(super) fn write_statistics(path: &Path, outcome: &Outcome) -> CommandResult {
    write_json(path, &statistics(outcome))
}

/// What draws: the processor, unless an adapter is asked for, or there is one with a graphics card.
fn caster(request: &Request, mode: &Mode) -> Result<Box<dyn Caster>, Box<dyn std::error::Error + Send + Sync>> {
    let only = |names: &str| format!("--backend: only {names} the mode {}", mode.name);
    let marched = mode.technique.adapter() == Adapter::RayMarcher;
    match request.backend {
        Some(Backend::Raster) if marched => return Err(only("compute and cpu draw").into()),
        Some(Backend::Compute | Backend::Raster) if !marched => return Err(only("cpu draws").into()),
        #[cfg(not(feature = "viewer"))]
        Some(Backend::Compute) => return Err(super::render::ONLY_CPU.into()),
        #[cfg(feature = "viewer")]
        Some(Backend::Compute) => return Ok(Box::new(crate::gpu::VolumeRenderer::open(&Default::default())?)),
        #[cfg(feature = "viewer")]
        None if marched && super::render::has_graphics_card() => {
            match crate::gpu::VolumeRenderer::open(&Default::default()) {
                Ok(renderer) => return Ok(Box::new(renderer)),
                Err(error) => eprintln!("deepfield: {error}; drawing with the CPU instead"),
            }
        }
        _ => {}
    }
    Ok(Box::new(Processor))
}

fn paint_pages(
    request: &Request,
    caster: &dyn Caster,
    studio: &mut Studio,
    times: &mut Times,
) -> Result<Outcome, Box<dyn std::error::Error + Send + Sync>> {
    let (framed, depiction) = (studio.choose(request)?, studio.depict(request)?);
    let Studio { file, scene, ahead, .. } = studio;
    let metadata = file.metadata();
    let view = request.shot.view(framed, metadata.periodic_box())?;
    scene.purpose = depiction.purpose(metadata);
    let detail = depiction.detail(&view, request.look().error_px.unwrap_or(ERROR_PX), metadata);
    let mut tell = |message| eprintln!("deepfield: {message}");
    let selection = times.measure("load", || scene.converge(&view, detail, &mut tell))?;
    look_ahead(scene, ahead.take(), detail);
    let mut painted = None;
    for _ in 0..request.times() {
        painted = Some(times.frame(|times| {
            let selection = times.measure("select", || scene.select(&view, detail));
            let decode = || processor::cut(&view, processor::decode(&depiction, metadata, &selection.nodes));
            let nodes = times.measure("decode", decode);
            let paint = |subject: &Subject<'_>| paint_nodes(&view, &depiction, metadata, &nodes, subject);
            measured(request, framed, caster, times, paint)
        })?);
    }
    Ok(Outcome {
        painted: painted.ok_or("nothing was drawn")?,
        stage: Stage::new(request, view, framed, Units::of_pages(metadata, &depiction), &depiction)?.with_selections(
            request.look().selections.as_deref().unwrap_or_default(),
            file,
            &selection.nodes,
        )?,
        levels: scene.purpose.name(),
        attribute: depiction.attribute.map(|coloring| coloring.name),
        converged: selection.converged,
        error_pixels: selection.error_pixels,
        particles: selection.particles,
        nodes: selection.nodes.len(),
        caster: Default::default(),
        milliseconds: BTreeMap::new(),
    })
}

fn paint_exact(
    request: &Request,
    caster: &dyn Caster,
    times: &mut Times,
) -> Result<Outcome, Box<dyn std::error::Error + Send + Sync>> {
    let source = ExactSource::open(request, times)?;
    let ExactSource { path, dataset, depiction, framed } = &source;
    let families = source.families();
    let view = request.shot.view(*framed, dataset.periodic_box())?;
    let mut painted = None;
    for _ in 0..request.times() {
        painted = Some(times.frame(|times| {
            let paint = |subject: &Subject<'_>| paint_particles(&view, depiction, dataset, &families, subject);
            measured(request, *framed, caster, times, paint)
        })?);
    }
    Ok(Outcome {
        painted: painted.ok_or("nothing was drawn")?,
        stage: Stage::new(request, view, *framed, Units::of_dataset(dataset, depiction), depiction)?
            .with_exact_selections(request, path, &source.names())?,
        levels: "source",
        attribute: depiction.attribute.as_ref().map(|coloring| coloring.name.clone()),
        converged: true,
        error_pixels: 0.0,
        particles: dataset.len() as u64,
        nodes: 0,
        caster: Default::default(),
        milliseconds: BTreeMap::new(),
    })
}

/// Paints, and notes how long the parts took.
fn measured(
    request: &Request,
    framed: Bounds,
    caster: &dyn Caster,
    times: &mut Times,
    paint: impl FnOnce(&Subject<'_>) -> Result<Painted, VolumeError>,
) -> Result<Painted, String> {
    let subject = Subject { transfer: request.look().transfer.as_ref(), diameter: framed.size().length(), caster };
    let painted = times.measure("draw", || paint(&subject)).map_err(|error| {
        let named = request.named.display();
        format!("{named}: {error}")
    })?;
    times.note("resample", painted.report.resampling);
    times.note("render", painted.report.rendering);
    Ok(painted)
}

fn statistics(outcome: &Outcome) -> Statistics<'_> {
    let mode = outcome.stage.depiction.mode;
    let [backend, adapter] = &outcome.caster;
    let Painted { colors, report, levels, isovalues } = &outcome.painted;
    Statistics {
        shown: Shown {
            converged: outcome.converged,
            error_px: outcome.error_pixels,
            particles_drawn: outcome.particles,
            nodes_drawn: outcome.nodes,
            backend,
            adapter,
            mode: mode.name,
            attribute: outcome.attribute.as_deref(),
            width: colors.width,
            height: colors.height,
        },
        levels: outcome.levels,
        grid: Grid {
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
        },
        ranges: Ranges {
            density: levels.density,
            attribute: levels.attribute,
            unit_length: levels.unit_length,
            isovalues,
        },
        milliseconds: &outcome.milliseconds,
    }
}
