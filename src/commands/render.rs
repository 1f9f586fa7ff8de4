//! `deepfield render`: a picture of a source or page file, without a window.

use super::CommandResult;
use super::annotate::Stage;
use super::drawing::Drawing;
use super::exact_source::ExactSource;
use super::picture_statistics::LeftOut;
use super::projected;
pub use super::render_arguments::Arguments;
use super::request::Request;
use super::statistics::Times;
use super::studio::{Studio, look_ahead};
use crate::annotate::Units;
use crate::color::{Accumulation, Image, output};
use crate::cpu::Method;
use crate::hierarchy::Purpose;
pub use crate::look::Backend;
use crate::look::{ERROR_PX, shown_families};
#[cfg(feature = "viewer")]
use crate::mode::Adapter;
use crate::mode::{Economy, Mode, Plan};
use crate::model::FamilyName;
use crate::picture::look::transfer_of;
use crate::picture::{pilot, processor};
use crate::store::PageFile;
use crate::view::{CubeLayout, Side, Surround};
use std::collections::BTreeMap;

/// Why an adapter does not draw in a program without the viewer.
pub(super) const ONLY_CPU: &str = "this deepfield was built without the feature `viewer`, so only --backend cpu draws";

/// What was drawn, and how.
#[derive(Clone)]
pub(super) struct Picture {
    pub accumulation: Accumulation,
    pub stage: Stage,
    pub mode: &'static Mode,
    pub attribute: Option<String>,
    pub converged: bool,
    pub error_pixels: f64,
    pub particles: u64,
    pub nodes: usize,
    pub backend: &'static str,
    pub adapter: String,
    pub economy: LeftOut,
    pub milliseconds: BTreeMap<String, f64>,
}

/// Renders the picture and writes it.
///
/// # Errors
/// When the source cannot be read, a setting does not fit the data, no adapter draws, or a file cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let request = arguments.request()?;
    match arguments.threads {
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build()?;
            pool.install(|| render(arguments, request))
        }
        None => render(arguments, request),
    }
}

fn render(arguments: &Arguments, mut request: Request) -> CommandResult {
    let output = &arguments.output;
    let is_exr = match output.extension().and_then(|extension| extension.to_str()) {
        Some("png") => false,
        Some("exr") => true,
        _ => return Err(format!("{}: expected a name that ends in .png or .exr", output.display()).into()),
    };
    if is_exr {
        if arguments.annotate.is_given() {
            let why = "an EXR picture holds numbers, only PNG pictures are annotated";
            return Err(format!("{}: {why}", output.display()).into());
        }
        request.shot.look.annotations = None;
    }
    let request = &request;
    let mut studio = None;
    let drawing = Drawing::new(request, &mut studio)?;
    match is_exr {
        _ if request.shot.surround == (Surround::Cube { layout: CubeLayout::Files }) => {
            if is_exr {
                return Err("--layout files: writes .png; a strip can be .exr".into());
            }
            for (side, face) in Side::ALL.iter().zip(faces(&drawing.finished(request, &mut studio)?)) {
                output::write_png(&output.with_extension(format!("{}.png", side.as_str())), &face)?;
            }
        }
        true => drawing.write_exr(output)?,
        false => output::write_png(output, &drawing.finished(request, &mut studio)?)?,
    }
    if let Some(raw) = &arguments.raw {
        drawing.write_npy(raw)?;
    }
    if let Some(json) = &arguments.json {
        drawing.write_statistics(json)?;
    }
    Ok(())
}

/// The six faces of a strip.
fn faces(strip: &Image) -> Vec<Image> {
    let edge = strip.height;
    let face = |index: usize| {
        let rows = strip.rgba.chunks(strip.width as usize);
        let start = index * edge as usize;
        let rgba = rows.flat_map(|row| row[start..start + edge as usize].iter().copied()).collect();
        Image { width: edge, height: edge, rgba }
    };
    (0..6).map(face).collect()
}

/// Draws a picture that is made of splats: of an open page file, or where there is none, of source particles.
///
/// # Errors
/// As [`run`].
pub(super) fn draw(
    request: &Request,
    studio: Option<&mut Studio>,
) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>> {
    if cfg!(not(feature = "viewer")) && matches!(request.backend, Some(Backend::Compute | Backend::Raster)) {
        return Err(ONLY_CPU.into());
    }
    if request.shot.is_projected() {
        return projected::draw(request, studio);
    }
    match studio {
        Some(studio) => draw_pages(request, studio),
        None => draw_exact(request),
    }
}

/// Draws the selected nodes of a page file.
fn draw_pages(request: &Request, studio: &mut Studio) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>> {
    let (framed, depiction) = (studio.choose(request)?, studio.depict(request)?);
    let Studio { file, scene, ahead, .. } = studio;
    let metadata = file.metadata();
    scene.purpose = Purpose::Splats;
    let view = request.shot.view(framed, metadata.periodic_box())?;
    let seen = depiction.selection_view(&view);
    let tau = request.look().error_px.unwrap_or(ERROR_PX);
    let mut times = Times::default();
    let mut tell = |message| eprintln!("deepfield: {message}");
    let selection = times.measure("load", || scene.converge(&seen, tau, &mut tell))?;
    look_ahead(scene, ahead.take(), tau);
    let economy = request.look().budget.file_economy();
    let transfer = transfer_of(request.look(), &depiction);
    let plan = times
        .measure("plan", || pilot::plan(&view, &depiction, metadata, &selection.nodes, &economy, &transfer, None))?;
    let mut left_out = LeftOut::new(&economy, &plan);
    if let Some(path) = &request.overdraw {
        let nodes = processor::decode_planned(&view, &depiction, metadata, &selection.nodes, &plan);
        let overdraw = processor::overdraw_of(&view, &depiction, metadata, &nodes, &plan)?;
        output::write_png(path, &overdraw.image())?;
        left_out.overdraw = Some((overdraw.mean(), overdraw.max()));
    }
    let picture =
        Picture {
            accumulation: Accumulation::default(),
            stage: Stage::new(request, view, framed, Units::of_pages(metadata, &depiction), &depiction)?
                .with_selections(request.look().selections.as_deref().unwrap_or_default(), file, &selection.nodes)?,
            mode: depiction.mode,
            attribute: depiction.attribute.as_ref().map(|coloring| coloring.name.clone()),
            economy: left_out.clone(),
            converged: selection.converged,
            error_pixels: selection.error_pixels,
            particles: selection.particles,
            nodes: selection.nodes.len(),
            backend: "cpu",
            adapter: "cpu".into(),
            milliseconds: BTreeMap::new(),
        };
    #[cfg(feature = "viewer")]
    if let Some(backend) = gpu_backend(depiction.mode, request.backend)? {
        let headless =
            || crate::gpu::depiction::request_nodes(&view, &depiction, metadata, &selection.nodes, &plan, backend);
        if let Some(picture) = draw_on_gpu(request, headless, picture.clone(), &times)? {
            return Ok(picture);
        }
    }
    let mut accumulation = Accumulation::default();
    for _ in 0..request.times() {
        times.frame(|times| {
            let selection = times.measure("select", || scene.select(&seen, tau));
            let nodes = times
                .measure("decode", || processor::decode_planned(&view, &depiction, metadata, &selection.nodes, &plan));
            let method = Method::Pyramid;
            let (drawn, counts) = times
                .measure("draw", || processor::draw_planned(&view, &depiction, metadata, &nodes, method, &plan))?;
            let kept: u64 = nodes.iter().map(|node| node.len() as u64).sum();
            left_out.thinned = Some(selection.particles - kept);
            (left_out.faint, left_out.outside) = (Some(counts.faint), Some(counts.outside));
            left_out.splats = Some(counts.drawn);
            accumulation = drawn;
            Ok::<_, crate::cpu::volume::VolumeError>(())
        })?;
    }
    Ok(Picture { accumulation, economy: left_out, milliseconds: times.medians(), ..picture })
}

/// What draws a mode on an adapter, unless the CPU is asked for, or does the same faster.
///
/// # Errors
/// When the backend that is asked for does not draw the mode.
#[cfg(feature = "viewer")]
fn gpu_backend(mode: &Mode, backend: Option<Backend>) -> Result<Option<crate::gpu::Backend>, String> {
    use crate::gpu::Backend as Gpu;
    let on_processor = mode.technique.on_processor();
    let only = |names: &str| Err(format!("--backend: only {names} the mode {}", mode.name));
    match (backend, mode.technique.adapter()) {
        (Some(Backend::Cpu), _) => Ok(None),
        (Some(Backend::Compute), Adapter::Splats | Adapter::Plugin) => Ok(Some(Gpu::Compute)),
        (Some(Backend::Raster), Adapter::Splats) => Ok(Some(Gpu::Raster)),
        (Some(_), Adapter::Plugin) => only(if on_processor { "compute and cpu draw" } else { "compute draws" }),
        (Some(_), _) => only("cpu draws"),
        // A driver without a graphics card draws on the processor too, and slower than our own renderer.
        (None, Adapter::Splats) => Ok(has_graphics_card().then_some(Gpu::Auto)),
        (None, Adapter::Plugin) => Ok((!on_processor || has_graphics_card()).then_some(Gpu::Compute)),
        (None, _) => Ok(None),
    }
}

/// Whether there is an adapter that is not the processor.
#[cfg(feature = "viewer")]
pub(super) fn has_graphics_card() -> bool {
    crate::gpu::device::probe().is_ok_and(|adapter| adapter.device_type != wgpu::DeviceType::Cpu)
}

/// Draws with an adapter. `None` where there is none and the user did not ask for one, so that the CPU draws.
#[cfg(feature = "viewer")]
fn draw_on_gpu(
    request: &Request,
    headless: impl FnOnce() -> crate::gpu::HeadlessRequest,
    picture: Picture,
    times: &Times,
) -> Result<Option<Picture>, crate::gpu::GpuError> {
    let headless = crate::gpu::HeadlessRequest { repeat: request.times(), ..headless() };
    match crate::gpu::render_headless(headless) {
        Ok(frame) => {
            let mut milliseconds = times.clone().medians();
            milliseconds.extend(frame.stats.passes.medians().map(|(pass, time)| (pass.to_owned(), time)));
            milliseconds.insert("frame".to_owned(), frame.stats.frame);
            let (backend, adapter) = (frame.stats.backend, frame.stats.adapter);
            let economy = LeftOut { splats: frame.stats.splats, ..picture.economy.clone() };
            Ok(Some(Picture { accumulation: frame.accumulation, economy, backend, adapter, milliseconds, ..picture }))
        }
        Err(error) if request.backend.is_none() => {
            eprintln!("deepfield: {error}; drawing with the CPU instead");
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// Draws every particle of the source; for a page file, of the source that it was built from.
fn draw_exact(request: &Request) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>> {
    let mut times = Times::default();
    let source = ExactSource::open(request, &mut times)?;
    let ExactSource { path, dataset, depiction, framed } = &source;
    let families = source.families();
    let view = request.shot.view(*framed, dataset.periodic_box())?;
    let picture = Picture {
        accumulation: Accumulation::default(),
        stage: Stage::new(request, view, *framed, Units::of_dataset(dataset, depiction), depiction)?
            .with_exact_selections(request, path, &source.names())?,
        mode: depiction.mode,
        attribute: depiction.attribute.as_ref().map(|coloring| coloring.name.clone()),
        economy: LeftOut::new(&Economy::NONE, &Plan::default()),
        converged: true,
        error_pixels: 0.0,
        particles: dataset.len() as u64,
        nodes: 0,
        backend: "cpu",
        adapter: "cpu".into(),
        milliseconds: BTreeMap::new(),
    };
    #[cfg(feature = "viewer")]
    let backend = if request.exact == Some(Method::Exact) { Some(Backend::Cpu) } else { request.backend };
    #[cfg(feature = "viewer")]
    if let Some(backend) = gpu_backend(depiction.mode, backend)? {
        let headless = || crate::gpu::depiction::request_particles(&view, depiction, dataset, &families, backend);
        if let Some(picture) = draw_on_gpu(request, headless, picture.clone(), &times)? {
            return Ok(picture);
        }
    }
    let method = request.exact.unwrap_or_default();
    let mut accumulation = Accumulation::default();
    for _ in 0..request.times() {
        times.frame(|times| {
            let drawn =
                times.measure("draw", || processor::draw_particles(&view, depiction, dataset, &families, method));
            drawn.map(|drawn| accumulation = drawn)
        })?;
    }
    Ok(Picture { accumulation, milliseconds: times.medians(), ..picture })
}

/// Indices of the families of a page file that are drawn.
///
/// # Errors
/// Where the family that the user names is not there, or none of those that a scene shows.
pub(super) fn families(request: &Request, file: &PageFile) -> Result<Vec<u32>, String> {
    let families = &file.metadata().families;
    let all = |shown: &dyn Fn(usize) -> bool| -> Vec<u32> {
        (0..families.len()).filter(|&i| shown(i)).map(|i| i as u32).collect()
    };
    let missing = |name: FamilyName| format!("{}: no particles of family {name}", request.path().display());
    let (found, absent) = match request.family {
        Some(name) => (all(&|i| families[i].name == name), vec![name]),
        None => {
            let (shown, missing) = shown_families(file, &request.members);
            (all(&|i| shown[i]), missing)
        }
    };
    match (found.is_empty(), absent.first()) {
        (false, _) => Ok(found),
        (true, Some(&name)) => Err(missing(name)),
        (true, None) => Err(format!("{}: the scene shows no family", request.path().display())),
    }
}
