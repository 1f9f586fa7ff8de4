//! The adapter that draws pictures which no window shows.

use super::depiction::request_from;
use super::device::GpuError;
use super::headless::{HeadlessFrame, HeadlessRequest};
use super::integrals::IntegralView;
use super::renderer::HeadlessRenderer;
use super::surface::SurfaceView;
use super::tile_passes::TilePasses;
use super::timing::MeasuredPasses;
use super::view::Backend;
use super::volume::{Shows, VolumeFindings, VolumeJob, VolumeView};
use super::{device, headless};
use crate::color::Colors;
use crate::cpu::overdraw::Overdraw;
use crate::cpu::shadowing::Covering;
use crate::cpu::volume::attributes::Column;
use crate::cpu::volume::range::Sketch;
use crate::cpu::volume::{FieldRange, VolumeError, VolumeOptions, VolumeReport};
use crate::mode::{FieldPasses, LightPasses};
use crate::picture::adapter::{Adapter, AdapterField, AdapterFrame, AdapterJob, AdapterSurface, AdapterValues, Passes};
use crate::view::perspective_grid::GridError;
use crate::view::{Extent, View};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::{self, JoinHandle};

/// Slabs that a frame draws.
const SLABS: u32 = 4;

/// The best adapter there is: opened when something is to be drawn, and kept for the next picture.
#[derive(Default)]
pub struct Offscreen {
    is_card: Option<bool>,
    studio: Option<Studio>,
    /// Counts jobs.
    number: u64,
}

/// What is read back of a picture of light.
#[derive(Clone, Copy)]
struct Reads {
    colors: bool,
    covering: bool,
}

/// What is done with the renderer, if one is open.
type Work = Box<dyn FnOnce(&mut Option<HeadlessRenderer>) + Send>;

/// The thread that holds the renderer: an application stays on the thread that made it, and whoever draws need not.
struct Studio {
    work: Option<Sender<Work>>,
    thread: Option<JoinHandle<()>>,
}

impl Studio {
    fn open() -> Result<Studio, GpuError> {
        let (work, received) = channel::<Work>();
        let hold = move || {
            let mut renderer = None;
            received.into_iter().for_each(|work| work(&mut renderer));
        };
        let thread = thread::Builder::new().name("adapter".into()).spawn(hold);
        let thread = thread.map_err(|error| GpuError::Failed(format!("(no thread for it: {error})")))?;
        Ok(Studio { work: Some(work), thread: Some(thread) })
    }

    /// Has the thread do something, and waits for what comes of it; `None` where it has ended.
    fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Option<HeadlessRenderer>) -> T + Send + 'static,
    ) -> Option<T> {
        let (answer, received) = channel();
        let work: Work = Box::new(move |renderer| {
            // Who asked waits below.
            let _ = answer.send(work(renderer));
        });
        self.work.as_ref()?.send(work).ok()?;
        received.recv().ok()
    }
}

impl Drop for Studio {
    fn drop(&mut self) {
        // The thread ends with its work, and the adapter is given back before the program goes on.
        self.work = None;
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

impl Adapter for Offscreen {
    fn is_card(&mut self) -> bool {
        let probe = || device::probe().is_ok_and(|adapter| adapter.device_type != wgpu::DeviceType::Cpu);
        *self.is_card.get_or_insert_with(probe)
    }

    fn draw(&mut self, job: &AdapterJob<'_>) -> Result<AdapterFrame, VolumeError> {
        match job.light {
            Some(plan) => {
                self.light(job, &plan.passes, Reads { colors: true, covering: false }).map(|(frame, _)| frame)
            }
            None => self.sums(job).map_err(device),
        }
    }

    fn draw_covering(
        &mut self,
        job: &AdapterJob<'_>,
        is_colored: bool,
    ) -> Result<(AdapterFrame, Covering), VolumeError> {
        let reads = Reads { colors: is_colored, covering: true };
        let drawn = job.light.map(|plan| self.light(job, &plan.passes, reads)).transpose()?;
        let mode = job.depiction.mode.name;
        let untold = || VolumeError::Device(format!("the adapter does not tell what covers pictures of {mode}"));
        drawn.and_then(|(frame, covering)| Some((frame, covering?))).ok_or_else(untold)
    }

    fn field(&mut self, job: &AdapterField<'_>) -> Result<AdapterFrame, VolumeError> {
        let march = match job.passes {
            FieldPasses::March(march) => march,
            FieldPasses::Integrals => return self.integrals(job).map_err(device),
        };
        let wanted = VolumeJob::of_field(self.next(), job.view, job.field, job.hue, march);
        let (grid, planes) = (wanted.grid.size, [wanted.grid.near, wanted.grid.far]);
        let request = HeadlessRequest::without_particles(job.view, job.hue.is_some());
        let (volume, repeat) = (VolumeView::of_field(wanted, u64::MAX, SLABS), job.repeat);
        let drawn = self.with(move |slot| {
            let renderer = loaded(slot, &request)?;
            let (colors, found, (passes, frame)) = renderer.volume(volume, repeat)?;
            let note = found.coarser.map(|(_, by)| coarser(by));
            let report = report_of((grid, planes), found, renderer);
            Ok(AdapterFrame { note, ..light_frame(colors, report, renderer, &passes, frame) })
        });
        drawn.map_err(device)
    }

    fn surface(&mut self, job: Arc<AdapterSurface>) -> Result<AdapterFrame, VolumeError> {
        let drawn = self.heights(job, true, |_| Ok(()));
        drawn.map(|(frame, ())| frame).map_err(device)
    }

    fn surface_seen(
        &mut self,
        job: Arc<AdapterSurface>,
        is_colored: bool,
    ) -> Result<(AdapterFrame, Vec<u32>), VolumeError> {
        self.heights(job, is_colored, HeadlessRenderer::surface_seen).map_err(device)
    }

    fn ranges(&mut self, job: &AdapterJob<'_>, options: &VolumeOptions) -> Result<FieldRange, VolumeError> {
        let request = request(job);
        let particles = request.nodes.iter().map(|node| node.upload.payload.len()).sum();
        let sketch = Sketch::of(job.view, particles, options);
        let (grid, _) = sketch.grid(within(job, &request))?;
        let Sketch { view, options, stride, .. } = sketch;
        let (number, stride) = (self.next(), stride as u32);
        let wanted = VolumeJob { number, view, grid, options, stride, shows: Shows::Ranges, covers: false };
        let volume = volume(job, &request, [None, Some(wanted)]);
        let found = self.with(move |slot| loaded(slot, &request)?.ranges(volume));
        let found = found.map_err(device)?;
        found.ok_or(VolumeError::Grid(GridError::NothingInView))
    }

    fn overdraw(&mut self, job: &AdapterJob<'_>) -> Result<Overdraw, VolumeError> {
        let request = request(job);
        self.with(move |slot| headless::overdraw(able(slot, &request)?, request)).map_err(device)
    }
}

impl Offscreen {
    /// One that draws all that it can, though the processor may be faster.
    pub fn preferred() -> Offscreen {
        Offscreen { is_card: Some(true), ..Offscreen::default() }
    }

    /// Has the renderer's thread do something.
    fn with<T: Send + 'static>(
        &mut self,
        work: impl FnOnce(&mut Option<HeadlessRenderer>) -> Result<T, GpuError> + Send + 'static,
    ) -> Result<T, GpuError> {
        let studio = match self.studio.take() {
            Some(studio) => studio,
            None => Studio::open()?,
        };
        let done = studio.run(work).unwrap_or_else(|| Err(GpuError::Failed("(its thread has ended)".into())));
        // After a failure the next picture begins with an adapter that is opened anew.
        if done.is_ok() {
            self.studio = Some(studio);
        }
        done
    }

    fn sums(&mut self, job: &AdapterJob<'_>) -> Result<AdapterFrame, GpuError> {
        let request = request(job);
        let frame = self.with(move |slot| headless::render(able(slot, &request)?, request))?;
        Ok(sums_frame(frame))
    }

    /// Draws measured heights, in colours if they are wanted, and reads back what else is asked for.
    fn heights<T: Send + 'static>(
        &mut self,
        job: Arc<AdapterSurface>,
        is_colored: bool,
        read: impl FnOnce(&mut HeadlessRenderer) -> Result<T, GpuError> + Send + 'static,
    ) -> Result<(AdapterFrame, T), GpuError> {
        let (is_raster, [width, height]) = (job.is_raster(), job.size());
        let request = HeadlessRequest::without_particles(&job.view.resized(width, height), false);
        let view = SurfaceView { number: self.next(), job, memory: u64::MAX, is_colored };
        self.with(move |slot| {
            let renderer = loaded(slot, &request)?;
            let (colors, (passes, frame)) = renderer.surface(view)?;
            let covered = is_colored.then(|| renderer.surface_covered()).transpose()?;
            let found = read(renderer)?;
            let backend = if is_raster { "raster" } else { "compute" };
            let frame = light_frame(colors, VolumeReport::default(), renderer, &passes, frame);
            Ok((AdapterFrame { backend, covered, ..frame }, found))
        })
    }

    /// Draws line integrals of samples.
    fn integrals(&mut self, job: &AdapterField<'_>) -> Result<AdapterFrame, GpuError> {
        let request = HeadlessRequest { repeat: job.repeat, ..HeadlessRequest::without_particles(job.view, false) };
        let integrals = IntegralView { number: self.next(), field: Arc::clone(job.field), memory: u64::MAX };
        self.with(move |slot| {
            let renderer = able(slot, &request)?;
            let frame = headless::render_with(renderer, request, integrals)?;
            match renderer.integral_findings() {
                found if found.no_room => Err(GpuError::NoRoom("samples".to_owned())),
                found => Ok(AdapterFrame { note: found.coarser.map(coarser), ..sums_frame(frame) }),
            }
        })
    }

    /// Draws light, and tells what covers the pixels where it is to and that is known.
    fn light(
        &mut self,
        job: &AdapterJob<'_>,
        passes: &LightPasses,
        reads: Reads,
    ) -> Result<(AdapterFrame, Option<Covering>), VolumeError> {
        // The same particles are there once for each column.
        let (request, columns) = match passes {
            LightPasses::Columns(march) => (request_for(job, job.view, &march.columns), march.columns.len().max(1)),
            _ => (request(job), 1),
        };
        let extents: Vec<Extent> = within(job, &request).collect();
        let attribute = job.depiction.attribute.is_some();
        let Some(wanted) = VolumeJob::picture_of(self.next(), passes, job.view, &extents, attribute)? else {
            let found = TilePasses::of(passes, job.view, &extents)?;
            let passes = found.ok_or_else(|| VolumeError::Device("no passes draw this mode".into()))?;
            return self.tiles(request, passes, reads).map_err(device);
        };
        let wanted = if reads.covering { wanted.covering() } else { wanted };
        let keeps_covering = wanted.keeps_covering();
        let (grid, planes) = match wanted.cartesian() {
            Some(picture) => (picture.lattice.cells, picture.planes),
            None => (wanted.grid.size, [wanted.grid.near, wanted.grid.far]),
        };
        let request = match wanted.cartesian() {
            // What no page codes is in the space of the camera that it is brought to.
            Some(_) if request.has_own_particles() => request_for(job, &wanted.view, &[Column::Attribute]),
            _ => request,
        };
        let volume = volume(job, &request, [Some(wanted), None]);
        let drawn = self.with(move |slot| {
            let renderer = loaded(slot, &request)?;
            let (found, (passes, frame)) = renderer.draw_volume(volume, request.repeat)?;
            let colors = if reads.colors { renderer.light()? } else { Colors::default() };
            let covering = keeps_covering.then(|| renderer.volume_covering()).transpose()?;
            let report = report_of((grid, planes), found, renderer);
            let [particles, raised] = [report.particles, report.raised].map(|all| all / columns as u64);
            let report = VolumeReport { particles, raised, ..report };
            Ok((light_frame(colors, report, renderer, &passes, frame), covering))
        });
        drawn.map_err(|error| match (error, passes) {
            (GpuError::GridTooLarge { most }, LightPasses::Cartesian(_, _, cartesian)) => VolumeError::Setting {
                field: "cells",
                found: cartesian.cells.to_string(),
                expected: format!("at most {most}: the graphics memory has no room for more"),
            },
            (error, _) => device(error),
        })
    }

    /// Draws by passes that complete a picture in one frame.
    fn tiles(
        &mut self,
        request: HeadlessRequest,
        passes: TilePasses,
        reads: Reads,
    ) -> Result<(AdapterFrame, Option<Covering>), GpuError> {
        let [width, height] = [request.view.width, request.view.height];
        let planes = passes.planes();
        let smoothing = passes.spheres().filter(|_| reads.covering).map(|spheres| spheres.smoothing);
        let number = self.next();
        self.with(move |slot| {
            let renderer = loaded(slot, &request)?;
            let (opaque, (passes, frame)) = renderer.draw_tiles(number, passes, request.repeat)?;
            let colors = if reads.colors { renderer.light()? } else { Colors::default() };
            let covering = smoothing.map(|smoothing| Ok::<_, GpuError>(renderer.spheres_shown()?.covering(smoothing)));
            let covering = covering.transpose()?;
            let particles = renderer.particles();
            let report =
                VolumeReport { grid: [width, height, 1], planes, particles, opaque, ..VolumeReport::default() };
            Ok((light_frame(colors, report, renderer, &passes, frame), covering))
        })
    }

    fn next(&mut self) -> u64 {
        self.number += 1;
        self.number
    }
}

/// What is handed back of a picture of sums.
fn sums_frame(frame: HeadlessFrame) -> AdapterFrame {
    let passes = frame.stats.passes.medians().map(|(pass, time)| (pass.to_owned(), time));
    AdapterFrame {
        milliseconds: passes.chain([("frame".to_owned(), frame.stats.frame)]).collect(),
        values: AdapterValues::Sums(frame.accumulation),
        splats: frame.stats.splats,
        backend: frame.stats.backend,
        adapter: frame.stats.adapter,
        covered: None,
        note: None,
    }
}

/// What is told of samples that did not all fit.
fn coarser(levels: usize) -> String {
    let side = 1u64 << levels;
    format!("the graphics memory is too small for all samples: means of {side} along each axis are drawn")
}

/// What drawing a volume between these planes took.
fn report_of((grid, planes): ([u32; 3], [f64; 2]), found: VolumeFindings, renderer: &HeadlessRenderer) -> VolumeReport {
    VolumeReport {
        grid,
        planes,
        slabs: found.slabs[1],
        particles: renderer.particles(),
        raised: found.raised,
        pairs: found.pairs,
        bricks: found.bricks,
        opaque: found.opaque.map(|(_, opaque)| opaque),
        ..VolumeReport::default()
    }
}

fn device(error: GpuError) -> VolumeError {
    VolumeError::Device(error.to_string())
}

/// What is handed back of a picture of light.
fn light_frame(
    colors: Colors,
    report: VolumeReport,
    renderer: &HeadlessRenderer,
    passes: &MeasuredPasses,
    frame: f64,
) -> AdapterFrame {
    let passes = passes.medians().map(|(pass, time)| (pass.to_owned(), time));
    AdapterFrame {
        values: AdapterValues::Light(colors, report),
        splats: None,
        backend: "compute",
        adapter: renderer.adapter().to_owned(),
        milliseconds: passes.chain([("frame".to_owned(), frame)]).collect(),
        covered: None,
        note: None,
    }
}

/// A renderer that serves a request: the one that is open, or another.
fn able<'a>(
    slot: &'a mut Option<HeadlessRenderer>,
    request: &HeadlessRequest,
) -> Result<&'a mut HeadlessRenderer, GpuError> {
    match slot.take().filter(|renderer| renderer.serves(request.backend)) {
        Some(renderer) => Ok(slot.insert(renderer)),
        None => Ok(slot.insert(HeadlessRenderer::bare(&request.device, request.backend)?)),
    }
}

/// The same, with the request's particles.
fn loaded<'a>(
    slot: &'a mut Option<HeadlessRenderer>,
    request: &HeadlessRequest,
) -> Result<&'a mut HeadlessRenderer, GpuError> {
    let renderer = able(slot, request)?;
    renderer.load(request)?;
    Ok(renderer)
}

/// What the renderer needs for a job.
fn request(job: &AdapterJob<'_>) -> HeadlessRequest {
    request_for(job, job.view, &[Column::Attribute])
}

/// The same with particles that `camera` sees, once for each of some columns.
fn request_for(job: &AdapterJob<'_>, camera: &View, columns: &[Column]) -> HeadlessRequest {
    let backend = match job.passes {
        Passes::Best => Backend::Auto,
        Passes::Compute => Backend::Compute,
        Passes::Raster => Backend::Raster,
    };
    let views = (job.view, camera);
    let request = request_from(views, job.depiction, job.metadata, job.nodes, job.plan, (backend, columns));
    HeadlessRequest { repeat: job.repeat, ..request }
}

/// The extents of a request's particles, without what the view leaves out.
fn within<'a>(job: &'a AdapterJob<'_>, request: &'a HeadlessRequest) -> impl Iterator<Item = Extent> + 'a {
    request.nodes.iter().filter_map(|node| node.reach.within(&job.view.cut.bounds))
}

fn volume(job: &AdapterJob<'_>, request: &HeadlessRequest, [light, ranges]: [Option<VolumeJob>; 2]) -> VolumeView {
    VolumeView {
        extents: request.nodes.iter().map(|node| node.reach).collect(),
        light,
        ranges,
        attribute: job.depiction.attribute.is_some(),
        ranges_only: false,
        memory: u64::MAX,
        slabs: SLABS,
    }
}
