//! Drawing with the processor, on background tasks: the whole picture for the `cpu` backend, and for every backend the
//! measurement of how bright the view is.
//!
//! While the view moves, as large a sample of the particles is drawn as the preset's time for a picture allows, with half as
//! many pixels a side where that is not all of them; volumes have a fixed limit, and as many pixels as there is time for. When the
//! view rests, the full picture follows.

use super::exposure::Exposure;
use super::live::LiveParticles;
use super::look::Look;
use super::messages::Messages;
use super::occlusion::Occlusion;
use super::pages::ViewSelection;
use super::picture::Picture;
use super::preset::Preset;
use super::scene::{Scene, Settings};
use super::statistics::{ActiveBackend, Converged, Statistics};
use super::volume_caster::VolumeCaster;
use crate::model::{Dataset, Family, FamilyName};
use crate::modes::governor::{self, Governor};
use crate::modes::paint::{Subject, paint_nodes, paint_particles};
use crate::modes::{Depiction, Footprint, Plan, cpu, pilot};
use crate::raster::composite::composite_at;
use crate::raster::transfer::{Levels, TransferFunction};
use crate::raster::volume::{Caster, OpaqueDepths, Processor, VolumeError};
use crate::raster::{Accumulation, Method};
use crate::store::PageFile;
use crate::stream::SceneNode;
use crate::view::View;
use crate::view::perspective_grid::GridError;
use bevy::asset::RenderAssetUsages;
use bevy::image::ImageSampler;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use std::sync::Arc;
use std::time::Instant;

/// What an accumulation depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DrawKey {
    selection: u64,
    /// The state of live particles.
    live: u64,
    depiction: u64,
    generation: u32,
    size: UVec2,
    /// How many particles a volume may take.
    particles: u64,
}

/// A picture that has been drawn.
#[derive(Clone)]
struct Drawn {
    key: DrawKey,
    picture: Arc<Accumulation>,
    /// For modes that draw colours: these, and the settings they were drawn with.
    painted: Option<Arc<PaintedPicture>>,
    milliseconds: f64,
}

/// A picture in colours, and what they mean.
struct PaintedPicture {
    image: crate::raster::composite::Image,
    levels: Levels,
    transfer: TransferFunction,
    /// Why not the adapter but the processor has drawn it.
    trouble: Option<String>,
    /// How many particles it took, where those are not all.
    sampled: Option<u64>,
    opaque: Option<Arc<OpaqueDepths>>,
}

/// What a background task hands back.
struct Done {
    drawn: Drawn,
    /// What the settings leave out, whatever time there was.
    plan: Plan,
    /// How many particles it took, if it was drawn anew; and whether that is not all that the plan would.
    taken: Option<u64>,
    cut: bool,
    /// Whether everything was there that the view needs.
    complete: bool,
    exposure: Exposure,
    /// The picture in colours, and what they were made with.
    colors: Option<(crate::raster::composite::Image, Levels, TransferFunction)>,
}

/// The processor's picture and the task that draws the next one.
#[derive(Resource, Default)]
pub struct CpuPicture {
    task: Option<Task<Result<Done, String>>>,
    drawn: Option<Drawn>,
    plan: Plan,
    colored: Option<(DrawKey, Levels, TransferFunction)>,
    governor: Governor,
    moved: Option<([u64; 2], Instant)>,
    measured: Option<Instant>,
    /// What the task draws, and what could not be drawn.
    tried: Option<(DrawKey, TransferFunction)>,
    failed: Option<(DrawKey, TransferFunction)>,
}

impl CpuPicture {
    /// What the last picture left out: what the next one may leave out too.
    pub fn plan(&self) -> Plan {
        self.plan
    }

    /// Whether the view or its nodes have changed a moment ago.
    pub fn is_moving(&self) -> bool {
        self.moved.is_some_and(|(_, since)| since.elapsed().as_millis() < REST_MS)
    }

    /// Whether the present selection has been drawn or measured.
    pub fn is_current(&self, selection: &ViewSelection) -> bool {
        self.drawn.as_ref().is_some_and(|drawn| drawn.key.selection == selection.revision)
    }
}

/// How long the view must rest before the full picture is drawn, milliseconds.
const REST_MS: u128 = 120;
/// Least time between two measurements of a view that moves and that the GPU draws, milliseconds.
const MEASURE_MS: u128 = 300;
/// Time that a volume's picture in motion may take where the preset says none, milliseconds.
const MOVING_MS: f64 = 50.0;
/// Particles that a volume in motion takes at most, drawn by the processor and by an adapter.
const MOVING_PARTICLES: [u64; 2] = [200_000, 4_000_000];
/// Longest side of the picture that is drawn only to measure the exposure, pixels.
const SKETCH: u32 = 320;

/// The size of the picture to draw now; `strained`: there is no time for all particles.
fn drawing_size(full: UVec2, strained: bool, backend: ActiveBackend, fixed_discs: bool) -> UVec2 {
    let shrink = match backend {
        // Discs of a fixed number of pixels would cover another share of a smaller picture.
        _ if fixed_discs => 1,
        ActiveBackend::Cpu if strained => 2,
        ActiveBackend::Cpu => 1,
        ActiveBackend::Gpu => full.max_element().div_ceil(SKETCH).max(1),
    };
    (full / shrink).max(UVec2::ONE)
}

/// The size of a volume's picture in motion, from the size and milliseconds of the last one: a volume has as many cells as
/// the cube of a side. A quarter at least.
fn moving_size(full: UVec2, last: Option<(UVec2, f64)>, budget: f64) -> UVec2 {
    let shrink = last.map_or(4.0, |(size, milliseconds)| {
        let sides = f64::from(full.max_element()) / f64::from(size.max_element().max(1));
        (milliseconds / budget).cbrt() * sides
    });
    // In quarters of a step, so that times that differ a little do not make another picture.
    let shrink = ((4.0 * shrink).ceil() / 4.0).clamp(1.0, 4.0);
    (full.as_dvec2() / shrink).as_uvec2().max(UVec2::ONE)
}

/// How many particles a volume's picture may take of so many in the view: all at rest.
fn volume_limit(moving: bool, on_adapter: bool, particles: u64) -> u64 {
    let most = MOVING_PARTICLES[usize::from(on_adapter)];
    if moving && particles > most { most } else { u64::MAX }
}

/// Whose particles are drawn.
enum Source {
    /// Nodes of the open file.
    Nodes(Arc<[SceneNode]>),
    /// Particles that another system hands over, and the families that are shown.
    Live(Arc<Dataset>, Vec<FamilyName>),
}

/// The families of live particles that are shown.
fn shown<'a>(dataset: &'a Dataset, families: &[FamilyName]) -> Vec<&'a Family> {
    dataset.families.iter().filter(|family| families.contains(&family.name)).collect()
}

/// Draws the source with `size` pixels; blocks for as long as it takes. What is left out is what `plan` says, or what
/// is found to be within the settings, which is handed back; and then as much as a sample of `limit` particles needs. Also
/// says how many it took.
fn draw(
    file: &PageFile,
    depiction: &Depiction,
    source: &Source,
    view: &View,
    size: UVec2,
    (plan, limit): (Option<Plan>, u64),
    (transfer, levels): (&TransferFunction, Option<Levels>),
) -> Result<(Accumulation, Plan, (u64, bool)), String> {
    let metadata = file.metadata();
    let nodes = match source {
        Source::Nodes(nodes) => nodes,
        Source::Live(dataset, families) => {
            let view = View { width: size.x, height: size.y, ..*view };
            let families = shown(dataset, families);
            let drawn = cpu::draw_particles(&view, depiction, dataset, &families, Method::Pyramid);
            let taken = families.iter().map(|family| family.len() as u64).sum();
            return drawn.map(|drawn| (drawn, Plan::default(), (taken, false))).map_err(|error| error.to_string());
        }
    };
    // What may be left out is decided for the whole picture, also where this one has fewer pixels.
    let economy = depiction.settings.economy();
    let plan = match plan {
        Some(plan) => Ok(plan),
        None => pilot::plan(view, depiction, metadata, nodes, &economy, transfer, levels),
    };
    let drawn = plan.and_then(|plan| {
        let important = governor::most_important(depiction, metadata);
        let (fitting, taken) = governor::within(limit, plan, view, depiction, metadata, nodes, &important);
        let decoded = cpu::decode_planned(view, depiction, metadata, nodes, &fitting);
        let view = View { width: size.x, height: size.y, ..*view };
        let drawn = cpu::draw_planned(&view, depiction, metadata, &decoded, Method::Pyramid, &fitting)?;
        Ok((drawn.0, plan, (taken, fitting != plan)))
    });
    drawn.map_err(|error| error.to_string())
}

/// Draws the source in the colours of a mode that has no splats; blocks for as long as it takes.
fn paint(
    file: &PageFile,
    depiction: &Depiction,
    source: &Source,
    view: &View,
    diameter: f64,
    (transfer, levels): (&TransferFunction, Levels),
    (caster, limit): (&dyn Caster, u64),
) -> Result<PaintedPicture, String> {
    let metadata = file.metadata();
    let (decoded, sampled) = match source {
        Source::Nodes(nodes) => {
            let important = governor::most_important(depiction, metadata);
            let (plan, taken) = governor::within(limit, Plan::default(), view, depiction, metadata, nodes, &important);
            let decoded = cpu::decode_planned(view, depiction, metadata, nodes, &plan);
            (decoded, (!plan.is_complete()).then_some(taken))
        }
        Source::Live(..) => (Vec::new(), None),
    };
    let with = |caster| {
        let subject = Subject { transfer: Some(transfer), diameter, caster };
        match source {
            Source::Nodes(_) => paint_nodes(view, depiction, metadata, &decoded, &subject),
            Source::Live(dataset, families) => {
                paint_particles(view, depiction, dataset, &shown(dataset, families), &subject)
            }
        }
    };
    let (painted, trouble) = match with(caster) {
        Err(VolumeError::Device(why)) => (with(&Processor), Some(why)),
        painted => (painted, None),
    };
    // Who looks away from the data sees nothing, and need not be told.
    if matches!(painted, Err(VolumeError::Grid(GridError::NothingInView))) {
        let rgba = vec![[0, 0, 0, 255]; view.width as usize * view.height as usize];
        let image = crate::raster::composite::Image { width: view.width, height: view.height, rgba };
        return Ok(PaintedPicture { image, levels, transfer: transfer.clone(), trouble, sampled: None, opaque: None });
    }
    let painted = painted.map_err(|error| error.to_string())?;
    let levels = Levels { p: painted.levels.density, s: painted.levels.attribute };
    let image = painted.colors.image();
    // A sample's wider kernels may hide what all particles together do not.
    let opaque = painted.report.opaque.filter(|_| sampled.is_none());
    Ok(PaintedPicture { image, levels, transfer: transfer.clone(), trouble, sampled, opaque })
}

/// Takes in what has been drawn, and starts to draw what is wanted now.
pub(super) fn draw_on_cpu(
    mut cpu: ResMut<CpuPicture>,
    backend: Res<ActiveBackend>,
    scene: Option<Res<Scene>>,
    selection: Res<ViewSelection>,
    look: Option<Res<Look>>,
    (picture, preset): (Res<Picture>, Res<Preset>),
    mut images: ResMut<Assets<Image>>,
    mut exposure: ResMut<Exposure>,
    mut statistics: ResMut<Statistics>,
    mut converged: ResMut<Converged>,
    mut occlusion: ResMut<Occlusion>,
    (mut messages, mut caster): (ResMut<Messages>, ResMut<VolumeCaster>),
    (live, settings): (Res<LiveParticles>, Res<Settings>),
) {
    let cpu = &mut *cpu;
    let cast = look.as_ref().is_some_and(|look| look.depiction.mode.is_cast()) && caster.is_on_adapter();
    if !cast {
        caster.rest();
    }
    let name = if cast { "compute" } else { "cpu" };
    if *backend == ActiveBackend::Cpu && statistics.backend != name {
        statistics.backend = name.to_owned();
    }
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else {
        cpu.task = None;
        return;
    };
    let revisions = [selection.revision, live.state()];
    if cpu.moved.is_none_or(|(before, _)| before != revisions) {
        cpu.moved = Some((revisions, Instant::now()));
    }
    if let Some(outcome) = cpu.task.as_mut().and_then(check_ready) {
        cpu.task = None;
        match outcome {
            Ok(done) => {
                if let Some(trouble) = done.drawn.painted.as_ref().and_then(|painted| painted.trouble.clone()) {
                    messages.error(format!("{trouble}; the processor draws instead"));
                    caster.give_up();
                }
                let state = done.drawn.key.live;
                let painted = done.drawn.painted.as_ref();
                let opaque = painted.and_then(|painted| painted.opaque.clone());
                // Live particles hide nothing of the file.
                let opaque = opaque.filter(|_| live.particles().is_none());
                occlusion.drew(opaque, (done.drawn.key.generation, done.drawn.key.depiction), done.complete);
                take_in(cpu, done, *backend, &picture, &mut images, &mut exposure, &mut statistics);
                statistics.live = live.particles().map(|_| state);
            }
            Err(error) => {
                cpu.failed = cpu.tried.take();
                messages.error(error);
            }
        }
    }
    if statistics.live.is_some() && live.particles().is_none() {
        statistics.live = None;
    }
    let moving = cpu.is_moving();
    let fixed_discs = matches!(look.depiction.footprint(), Footprint::Pixels(_));
    let full = picture.size();
    let limit = match preset.drawing.frame_ms {
        frame_ms if frame_ms > 0.0 && moving && *backend == ActiveBackend::Cpu => cpu.governor.limit(frame_ms),
        _ => u64::MAX,
    };
    let painted = look.depiction.mode.painter().is_some();
    let size = match painted && moving {
        true => {
            let budget = if preset.drawing.frame_ms > 0.0 { preset.drawing.frame_ms } else { MOVING_MS };
            let last = cpu.drawn.as_ref().filter(|drawn| drawn.painted.is_some());
            moving_size(full, last.map(|drawn| (drawn.key.size, drawn.milliseconds)), budget)
        }
        false => drawing_size(full, statistics.particles > limit, *backend, fixed_discs),
    };
    let key = DrawKey {
        selection: selection.revision,
        live: live.state(),
        depiction: look.depiction_revision,
        generation: scene.generation,
        size,
        particles: volume_limit(painted && moving, caster.is_on_adapter(), statistics.particles),
    };
    let trial = (key, look.transfer.clone());
    let drawn = cpu.drawn.as_ref().filter(|drawn| drawn.key == key);
    let colored = cpu
        .colored
        .as_ref()
        .is_some_and(|(drawn, levels, transfer)| *drawn == key && *levels == look.levels && *transfer == look.transfer);
    let current = drawn.is_some() && (*backend == ActiveBackend::Gpu || colored);
    if *backend == ActiveBackend::Cpu {
        // What is hidden may have changed with the last picture.
        let chosen = selection.complete && selection.occlusion == occlusion.revision;
        converged.0 = current && chosen && !moving && size == full && look.settled;
    }
    // The ranges of a transfer function that has changed are measured in the picture that is there.
    if cpu.task.is_some() || (current && look.settled && !look.is_changed()) {
        return;
    }
    // Before anything has come there is nothing that colours could be of, and nothing to complain of.
    if painted && selection.nodes.is_empty() && !selection.complete && live.particles().is_none() {
        return;
    }
    // What could not be drawn once cannot be drawn again either.
    if cpu.failed.as_ref() == Some(&trial) {
        return;
    }
    // A measurement is a courtesy: it must not take the processor from what draws.
    let paced = cpu.measured.is_none_or(|since| since.elapsed().as_millis() > MEASURE_MS);
    if *backend == ActiveBackend::Gpu && moving && !paced {
        return;
    }
    cpu.measured = Some(Instant::now());
    cpu.tried = Some(trial);
    let drawn_with = |drawn: &&Drawn| drawn.painted.as_ref().is_none_or(|painted| painted.transfer == look.transfer);
    let reused = drawn.filter(drawn_with).cloned();
    let diameter = scene.frame.size().length();
    let (file, depiction) = (Arc::clone(&scene.file), look.depiction.clone());
    let source = match live.particles() {
        Some(particles) => {
            let families = scene.file.metadata().families.iter().zip(&settings.families);
            let shown = families.filter(|(_, shown)| **shown).map(|(family, _)| family.name).collect();
            Source::Live(Arc::clone(particles), shown)
        }
        None => Source::Nodes(Arc::clone(&selection.nodes)),
    };
    let (transfer, levels, on_cpu) = (look.transfer.clone(), look.levels, *backend == ActiveBackend::Cpu);
    let complete = selection.complete;
    let (known, old_plan) = (look.settled.then_some(look.levels), cpu.plan);
    // Finding a plan takes longer than there is between two pictures of a motion.
    let kept_plan = (moving && *backend == ActiveBackend::Cpu).then_some(old_plan);
    // Splats have no use for it.
    let caster: Arc<dyn Caster> = if cast { caster.caster() } else { Arc::new(Processor) };
    cpu.task = Some(AsyncComputeTaskPool::get().spawn(async move {
        let (drawn, plan, taken, cut) = match reused {
            Some(drawn) => (drawn, old_plan, None, false),
            None if painted => {
                let start = Instant::now();
                let (view, with) = (View { width: size.x, height: size.y, ..view }, (&*caster, key.particles));
                let painted =
                    Some(Arc::new(paint(&file, &depiction, &source, &view, diameter, (&transfer, levels), with)?));
                let milliseconds = 1000.0 * start.elapsed().as_secs_f64();
                (Drawn { key, picture: Arc::default(), painted, milliseconds }, old_plan, None, false)
            }
            None => {
                let start = Instant::now();
                let plan = (kept_plan, limit);
                let (picture, plan, (taken, cut)) =
                    draw(&file, &depiction, &source, &view, size, plan, (&transfer, known))?;
                let picture = Arc::new(picture);
                let milliseconds = 1000.0 * start.elapsed().as_secs_f64();
                (Drawn { key, picture, painted: None, milliseconds }, plan, Some(taken), cut)
            }
        };
        let (exposure, colors) = match &drawn.painted {
            Some(painted) => {
                let exposure = Exposure::of_codebooks(file.metadata(), &depiction, &transfer, painted.levels);
                (exposure, on_cpu.then(|| (painted.image.clone(), levels, transfer.clone())))
            }
            None => {
                let colors =
                    on_cpu.then(|| (composite_at(&drawn.picture, &transfer, &levels), levels, transfer.clone()));
                (Exposure::of(&drawn.picture, &transfer), colors)
            }
        };
        Ok(Done { drawn, plan, taken, cut, complete, exposure, colors })
    }));
}

/// Takes in a finished task's work.
fn take_in(
    cpu: &mut CpuPicture,
    done: Done,
    backend: ActiveBackend,
    picture: &Picture,
    images: &mut Assets<Image>,
    exposure: &mut ResMut<Exposure>,
    statistics: &mut ResMut<Statistics>,
) {
    exposure.set_if_neq(done.exposure);
    if let Some((colors, levels, transfer)) = done.colors
        && backend == ActiveBackend::Cpu
    {
        if images.insert(&picture.image, to_image(colors)).is_err() {
            warn!("the picture's image is gone");
        }
        cpu.colored = Some((done.drawn.key, levels, transfer));
        if let Some(taken) = done.taken {
            statistics.draw_ms = Some(done.drawn.milliseconds);
            statistics.sampled = done.cut.then_some(taken);
            cpu.governor.drew(taken, done.drawn.milliseconds);
        }
    }
    if let Some(painted) = &done.drawn.painted {
        statistics.draw_ms = Some(done.drawn.milliseconds);
        statistics.sampled = painted.sampled;
    }
    cpu.plan = done.plan;
    cpu.drawn = Some(done.drawn);
}

/// Colours as an image that egui shows; smoothed where it is stretched.
fn to_image(colors: crate::raster::composite::Image) -> Image {
    let size = Extent3d { width: colors.width, height: colors.height, depth_or_array_layers: 1 };
    let bytes = bytemuck::allocation::cast_vec::<[u8; 4], u8>(colors.rgba);
    let mut image =
        Image::new(size, TextureDimension::D2, bytes, TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::default());
    image.sampler = ImageSampler::linear();
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_in_motion_are_as_large_as_there_is_time_for() {
        let full = UVec2::new(1000, 600);
        assert_eq!(moving_size(full, None, 50.0), full / 4);
        assert_eq!(moving_size(full, Some((full, 40.0)), 50.0), full);
        assert_eq!(moving_size(full, Some((full, 400.0)), 50.0), full / 2);
        assert_eq!(moving_size(full, Some((full / 2, 50.0)), 50.0), full / 2);
        assert_eq!(moving_size(full, Some((full / 4, 1e6)), 50.0), full / 4);
    }

    #[test]
    fn volumes_in_motion_take_a_sample_of_many_particles() {
        assert_eq!(volume_limit(true, false, 1_000), u64::MAX);
        assert_eq!(volume_limit(true, false, 1_000_000), MOVING_PARTICLES[0]);
        assert_eq!(volume_limit(true, true, 1_000_000), u64::MAX);
        assert_eq!(volume_limit(false, false, 1_000_000_000), u64::MAX);
    }

    #[test]
    fn strain_costs_pixels_and_rest_brings_them_back() {
        let full = UVec2::new(1000, 600);
        assert_eq!(drawing_size(full, false, ActiveBackend::Cpu, false), full);
        assert_eq!(drawing_size(full, true, ActiveBackend::Cpu, false), full / 2);
        assert_eq!(drawing_size(full, true, ActiveBackend::Cpu, true), full);
        let sketch = drawing_size(full, false, ActiveBackend::Gpu, false);
        assert!(sketch.max_element() <= SKETCH);
    }
}
