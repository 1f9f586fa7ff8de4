//! Pictures of all directions, and pictures for two eyes: drawn view by view and put together before they become colours.
//!
//! The processor draws them. Nodes are selected for each face, so the error bound holds in every direction, in pixels of
//! the panorama's own rate.

use super::annotate::Stage;
use super::exact_source::ExactSource;
use super::paint::Outcome;
use super::picture_statistics::LeftOut;
use super::render::Picture;
use super::request::Request;
use super::statistics::Times;
use super::studio::Studio;
use crate::annotate::Units;
use crate::cpu::volume::Processor;
use crate::cpu::{Counts, SplatOptions, Splats};
use crate::hierarchy::Purpose;
use crate::look::{Backend, ERROR_PX};
use crate::mode::{Depiction, Economy, Footprint, Painted, Plan};
use crate::model::{Bounds, Kernel, PeriodicBox};
use crate::picture::around::{Alike, sketch, with_images};
use crate::picture::paint::{Subject, densest, densest_of};
use crate::picture::panorama::{Texels, assemble};
use crate::picture::processor::{self, SeenFamily};
use crate::stream::SceneSelection;
use crate::view::{Detail, Eye, Eyes, Panorama, Projection, Sampling, Sections, Stereo, View};
use std::collections::BTreeMap;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// How splats are sampled: with a few more pixels than the panorama has, since they may be as small as one.
const SPLATS: Sampling = Sampling { oversampling: 1.5, density: 1.5, margin: 0 };
/// How colours are sampled: rays cost more than splats, and a volume's grid is smooth.
const COLORS: Sampling = Sampling { oversampling: 1.0, density: 1.5, margin: 1 };

/// What is put together.
pub(super) struct Projector {
    /// The camera, in the middle of both eyes.
    base: View,
    panorama: Option<Panorama>,
    stereo: Option<Stereo>,
}

/// A view to be drawn.
struct Shot<'a> {
    view: &'a View,
    /// Angle of a panorama's pixel, and the view's pixels for one of these; `None` for a flat picture.
    around: Option<[f64; 2]>,
}

impl Shot<'_> {
    /// The view's pixels for one of the picture.
    fn scale(&self) -> f64 {
        self.around.map_or(1.0, |[_, scale]| scale)
    }
}

impl Projector {
    fn new(request: &Request, framed: Bounds, periodic: Option<PeriodicBox>) -> Result<Projector, Failure> {
        if matches!(request.backend, Some(Backend::Compute | Backend::Raster)) {
            return Err("--backend: only cpu draws projections and stereo pictures".into());
        }
        if request.overdraw.is_some() {
            return Err("--overdraw: is for flat pictures".into());
        }
        let economy = request.look().budget.file_economy();
        if economy.presence > 0.0 || economy.thinning > 0.0 {
            eprintln!("deepfield: presence and thinning are for flat pictures; nothing is left out");
        }
        if request.look().selections.as_ref().is_some_and(|sets| !sets.is_empty()) {
            eprintln!("deepfield: selections are shown in flat pictures only");
        }
        let (surround, stereo) = (request.shot.surround, request.shot.stereo);
        let mut base = request.shot.view(framed, periodic)?;
        if stereo.is_some() && matches!(base.projection, Projection::Orthographic { .. }) {
            return Err("--stereo: an orthographic picture has no place for two eyes".into());
        }
        let panorama = Panorama::around(&base, surround)?;
        base.cut.around = panorama.is_some() && base.cut.fade_rate > 0.0;
        Ok(Projector { base, panorama, stereo })
    }

    /// Puts the picture together.
    fn shoot<const N: usize>(
        &self,
        sampling: Sampling,
        mut draw: impl FnMut(&Shot<'_>) -> Result<Texels<N>, Failure>,
    ) -> Result<Texels<N>, Failure> {
        let mut whole: Option<Texels<N>> = None;
        let eyes = self.stereo.map_or(&[][..], |stereo| stereo.eyes.each());
        let each: Vec<Option<Eye>> =
            if eyes.is_empty() { vec![None] } else { eyes.iter().copied().map(Some).collect() };
        for eye in each {
            let pair = self.stereo.zip(eye);
            let picture = match (&self.panorama, pair) {
                (None, None) => draw(&Shot { view: &self.base, around: None })?,
                (None, Some((stereo, eye))) => draw(&Shot { view: &stereo.off_axis(&self.base, eye)?, around: None })?,
                (Some(panorama), pair) => {
                    let pixel = panorama.pixel_angle();
                    let circle = pair.map(|(stereo, eye)| stereo.omnidirectional(eye, pixel)).transpose()?;
                    let sections = Sections::new(*panorama, circle, sampling);
                    let around = Some([pixel, sections.oversampling()]);
                    assemble(&sections, &self.base, |view| draw(&Shot { view, around }))?
                }
            };
            let below = self.stereo.is_some_and(|stereo| stereo.eyes == Eyes::OverUnder);
            whole = Some(match whole {
                None => picture,
                Some(first) => first.beside(&picture, below),
            });
        }
        whole.ok_or_else(|| "nothing was drawn".into())
    }

    /// The angle of a pixel in the picture's middle.
    fn pixel(&self) -> f64 {
        self.panorama.map_or(1.0 / self.base.focal_pixels(), |panorama| panorama.pixel_angle())
    }
}

/// What was selected for all views together.
struct Tally {
    converged: bool,
    error_pixels: f64,
    particles: u64,
    nodes: usize,
    counts: Counts,
}

impl Tally {
    fn new() -> Tally {
        Tally { converged: true, error_pixels: 0.0, particles: 0, nodes: 0, counts: Counts::default() }
    }

    fn add(&mut self, selection: &SceneSelection, shot: &Shot<'_>) {
        self.converged &= selection.converged;
        self.error_pixels = self.error_pixels.max(selection.error_pixels / shot.scale());
        self.particles += selection.particles;
        self.nodes += selection.nodes.len();
    }
}

fn splats(
    shot: &Shot<'_>,
    depiction: &Depiction,
    batches: &[Splats<'_>],
    options: SplatOptions,
    known: impl FnOnce() -> (Bounds, f64),
    tally: &mut Tally,
) -> Result<Texels<2>, Failure> {
    let (picture, counts) = match shot.around {
        Some([pixel, _]) => processor::draw_face(shot.view, depiction, batches, pixel, options, known)?,
        None => processor::draw_batches(shot.view, depiction, batches, options, known)?,
    };
    tally.counts += counts;
    Ok(picture.into())
}

/// The view by which nodes are selected: discs reach into a face from outside.
fn seen(depiction: &Depiction, shot: &Shot<'_>) -> View {
    match depiction.footprint() {
        Footprint::Kernel => *shot.view,
        // A face's pixels are narrower towards its edges, by half and more.
        Footprint::Pixels(radius) => shot.view.padded((3.0 * shot.scale() * f64::from(radius)).ceil() as u32),
    }
}

/// Draws splats of an open page file, or where there is none, of source particles.
///
/// # Errors
/// As [`super::render::run`].
pub(super) fn draw(request: &Request, studio: Option<&mut Studio>) -> Result<Picture, Failure> {
    let (mut times, mut tally) = (Times::default(), Tally::new());
    match studio {
        None => {
            let source = ExactSource::open(request, &mut times)?;
            let ExactSource { dataset, depiction, framed, .. } = &source;
            let projector = Projector::new(request, *framed, dataset.periodic_box())?;
            let stage = Stage::new(request, projector.base, *framed, Units::of_dataset(dataset, depiction), depiction)?;
            let particles = SeenFamily::of(&projector.base, depiction, &source.families());
            let batches = processor::seen_batches(depiction, &particles)?;
            let method = request.exact.unwrap_or_default();
            let options = SplatOptions { method, kernel: dataset.kernel, ..SplatOptions::default() };
            let known = || (dataset.bounds(), densest(&source.families()));
            let shoot =
                || projector.shoot(SPLATS, |shot| splats(shot, depiction, &batches, options, known, &mut tally));
            let texels = times.measure("frame", shoot)?;
            tally.particles = dataset.len() as u64;
            Ok(picture_of(&texels, stage, tally, times.medians()))
        }
        Some(studio) => {
            let (framed, depiction) = (studio.choose(request)?, studio.depict(request)?);
            let Studio { file, scene, .. } = studio;
            let metadata = file.metadata();
            scene.purpose = Purpose::Splats;
            let projector = Projector::new(request, framed, metadata.periodic_box())?;
            let stage = Stage::new(request, projector.base, framed, Units::of_pages(metadata, &depiction), &depiction)?;
            let tau = request.look().error_px.unwrap_or(ERROR_PX);
            let options = SplatOptions { kernel: metadata.kernel, ..SplatOptions::default() };
            let shoot = || {
                projector.shoot(SPLATS, |shot| {
                    let mut tell = |message| eprintln!("deepfield: {message}");
                    let selection = scene.converge(&seen(&depiction, shot), tau * shot.scale(), &mut tell)?;
                    tally.add(&selection, shot);
                    let nodes = processor::cut(shot.view, processor::decode(&depiction, metadata, &selection.nodes));
                    let known = || (metadata.bounds(), densest_of(metadata));
                    splats(shot, &depiction, &processor::batches(&depiction, &nodes)?, options, known, &mut tally)
                })
            };
            let texels = times.measure("frame", shoot)?;
            Ok(picture_of(&texels, stage, tally, times.medians()))
        }
    }
}

fn picture_of(texels: &Texels<2>, stage: Stage, tally: Tally, milliseconds: BTreeMap<String, f64>) -> Picture {
    let attribute = stage.depiction.attribute.as_ref().map(|coloring| coloring.name.clone());
    let economy = LeftOut::new(&Economy::NONE, &Plan::default());
    Picture {
        accumulation: texels.accumulation(attribute.is_some()),
        mode: stage.depiction.mode,
        stage,
        attribute,
        converged: tally.converged,
        error_pixels: tally.error_pixels,
        particles: tally.particles,
        nodes: tally.nodes,
        backend: "cpu",
        adapter: "cpu".into(),
        economy: LeftOut { outside: Some(tally.counts.outside), splats: Some(tally.counts.drawn), ..economy },
        milliseconds,
    }
}

/// What all views of a painted picture share.
struct Studied {
    alike: Alike,
    kernel: Kernel,
    densest: f64,
    diameter: f64,
    /// What the last view that showed something was painted with.
    painted: Option<Painted>,
}

impl Studied {
    fn paint(&mut self, shot: &Shot<'_>, batches: &[Splats<'_>]) -> Result<Texels<4>, Failure> {
        let subject = Subject { transfer: None, diameter: self.diameter, caster: &Processor };
        let painted = self.alike.paint(shot.view, batches, (self.kernel, self.densest), &subject)?;
        let Some(mut painted) = painted else { return Ok(Texels::black(shot.view.width, shot.view.height)) };
        let colors = std::mem::take(&mut painted.colors);
        self.painted = Some(painted);
        Ok(colors.into())
    }

    fn outcome(self, texels: Texels<4>) -> Result<Painted, Failure> {
        let painted = self.painted.ok_or("eye, target: no particles are in view")?;
        Ok(Painted { colors: texels.into(), ..painted })
    }
}

/// Paints a mode's colours.
///
/// # Errors
/// As [`super::render::run`].
pub(super) fn paint(request: &Request, studio: Option<&mut Studio>) -> Result<Outcome, Failure> {
    let (mut times, mut tally) = (Times::default(), Tally::new());
    let transfer = request.look().transfer.as_ref();
    let (painted, stage, levels) = match studio {
        None => {
            let source = ExactSource::open(request, &mut times)?;
            let ExactSource { dataset, depiction, framed, .. } = &source;
            let families = source.families();
            let projector = Projector::new(request, *framed, dataset.periodic_box())?;
            let stage = Stage::new(request, projector.base, *framed, Units::of_dataset(dataset, depiction), depiction)?;
            let particles = SeenFamily::of(&projector.base, depiction, &families);
            let batches = processor::seen_batches(depiction, &particles)?;
            let (base, kernel) = (&projector.base, dataset.kernel);
            let bounds = with_images(base, dataset.bounds());
            let alike = Alike::new(base, depiction, bounds, projector.pixel(), transfer, (&batches, kernel))?;
            let mut studied =
                Studied { alike, kernel, densest: densest(&families), diameter: framed.size().length(), painted: None };
            let shoot = || projector.shoot(sampling(depiction), |shot| studied.paint(shot, &batches));
            let texels = times.measure("frame", shoot)?;
            tally.particles = dataset.len() as u64;
            (studied.outcome(texels)?, stage, "source")
        }
        Some(studio) => {
            let (framed, depiction) = (studio.choose(request)?, studio.depict(request)?);
            let Studio { file, scene, .. } = studio;
            let metadata = file.metadata();
            let projector = Projector::new(request, framed, metadata.periodic_box())?;
            let base = &projector.base;
            let stage = Stage::new(request, *base, framed, Units::of_pages(metadata, &depiction), &depiction)?;
            scene.purpose = depiction.purpose(metadata);
            let bounds = with_images(base, metadata.bounds());
            let mut tell = |message| eprintln!("deepfield: {message}");
            // Ranges are found from all the data, as a parallel view of it has them.
            let drawn = |selection: &SceneSelection, view: &View| {
                processor::cut(view, processor::decode(&depiction, metadata, &selection.nodes))
            };
            let all = sketch(base, bounds)?;
            let detail = match scene.purpose {
                Purpose::Splats => Detail::Error { tau: 1.0 },
                Purpose::Samples => Detail::Sampling { sigma: 1.0 / all.focal_pixels(), near: 0.0 },
            };
            let selected = times.measure("load", || scene.converge(&all, detail, &mut tell))?;
            // What is left out and faded is that of the picture's own view.
            let all_nodes = drawn(&selected, base);
            let all_batches = processor::batches(&depiction, &all_nodes)?;
            let kernel = metadata.kernel;
            let alike = Alike::new(base, &depiction, bounds, projector.pixel(), transfer, (&all_batches, kernel))?;
            let mut studied = Studied {
                alike,
                kernel,
                densest: densest_of(metadata),
                diameter: framed.size().length(),
                painted: None,
            };
            let of_data = depiction.needs().of_data;
            let shoot = || {
                projector.shoot(sampling(&depiction), |shot| {
                    if of_data {
                        tally.add(&selected, shot);
                        return studied.paint(shot, &all_batches);
                    }
                    let tau = request.look().error_px.unwrap_or(ERROR_PX) * shot.scale();
                    let detail = studied.alike.depiction.detail(shot.view, tau, metadata);
                    let selection = scene.converge(shot.view, detail, &mut tell)?;
                    tally.add(&selection, shot);
                    let nodes = drawn(&selection, shot.view);
                    studied.paint(shot, &processor::batches(&depiction, &nodes)?)
                })
            };
            let texels = times.measure("frame", shoot)?;
            (studied.outcome(texels)?, stage, scene.purpose.name())
        }
    };
    Ok(Outcome {
        painted,
        attribute: stage.depiction.attribute.as_ref().map(|coloring| coloring.name.clone()),
        stage,
        levels,
        converged: tally.converged,
        error_pixels: tally.error_pixels,
        particles: tally.particles,
        nodes: tally.nodes,
        caster: ["cpu", "cpu"].map(str::to_owned),
        milliseconds: times.medians(),
    })
}

fn sampling(depiction: &Depiction) -> Sampling {
    Sampling { margin: depiction.needs().margin_px, ..COLORS }
}
