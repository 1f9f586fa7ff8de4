//! What draws surfaces: an adapter, where one is asked for or faster and knows how, else the processor.

use super::letters::ProgramFont;
use crate::cpu::surface::channels::channels;
use crate::cpu::surface::darken::darken;
use crate::cpu::surface::lettering;
use crate::cpu::surface::look::{Attribute, Look};
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::photo::PhotoCut;
use crate::cpu::surface::picture::{counted, parts, report, scene};
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::raster::Visibility;
use crate::cpu::surface::select::{Coarse, Technique};
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::source::SurfaceNodes as _;
use crate::cpu::surface::stitch::Scene;
use crate::cpu::surface::{SurfaceOptions, SurfacePicture, SurfaceReport, draw_lettered};
use crate::cpu::volume::VolumeError;
use crate::look::Backend;
use crate::picture::adapter::{Adapter, AdapterSurface, AdapterValues, Passes, WITHOUT_ADAPTER};
use crate::picture::session::Reporter;
use crate::view::View;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What may draw beside the processor, and what has been told of it.
#[derive(Default)]
pub(in crate::picture) struct Painter {
    /// An adapter.
    pub(in crate::picture) adapter: Option<Box<dyn Adapter>>,
    told: Vec<String>,
}

/// What has drawn a picture.
#[derive(Clone, Debug)]
pub(super) struct DrawnBy {
    /// The backend, and the adapter's name.
    pub(super) names: [String; 2],
    /// Of each of an adapter's passes.
    pub(super) milliseconds: BTreeMap<String, f64>,
}

impl Default for DrawnBy {
    fn default() -> DrawnBy {
        DrawnBy { names: ["cpu".into(), String::new()], milliseconds: BTreeMap::new() }
    }
}

/// What an adapter is to draw of a field.
pub(in crate::picture) struct Field<'a> {
    /// Its chunks.
    pub(in crate::picture) nodes: &'a PagedSurface,
    /// Where it stands.
    pub(in crate::picture) placed: &'a Placed,
    /// The least and the largest height.
    pub(in crate::picture) extremes: [f64; 2],
}

impl Field<'_> {
    /// What an adapter is asked for, and what is known of its picture: the chunks for a flat view, read and joined; `None` where it is not flat,
    /// or has no colours.
    pub(super) fn job(
        &self,
        sight: &Sight,
        options: &SurfaceOptions,
        passes: Passes,
    ) -> Option<(AdapterSurface, SurfaceReport)> {
        self.asked(sight, (options, options), parts(options.samples), passes)
    }

    /// The same of what raw channels are found in: a sample for each pixel, and chunks as pictures without colours have them.
    fn channels_job(
        &self,
        sight: &Sight,
        options: &SurfaceOptions,
        passes: Passes,
    ) -> Option<(AdapterSurface, SurfaceReport)> {
        let chosen = SurfaceOptions { look: None, ..options.clone() };
        self.asked(sight, (options, &chosen), 1, passes)
    }

    /// A picture with so many samples along a pixel's side, and with the chunks that `chosen` asks for.
    fn asked(
        &self,
        sight: &Sight,
        (options, chosen): (&SurfaceOptions, &SurfaceOptions),
        parts: u32,
        passes: Passes,
    ) -> Option<(AdapterSurface, SurfaceReport)> {
        let (Sight::Flat(view), Some(look)) = (sight.refined(parts), options.look.clone()) else { return None };
        let scene = Arc::new(scene(self.nodes, self.placed, sight, chosen));
        let job = self.job_of(scene, (view, parts), (options, look), passes);
        let [samples, points, triangles] = counted(&job.scene);
        let counts = [samples, points, if job.casts_rays() { 0 } else { triangles }];
        let report = report(&job.scene, counts, f64::from(parts));
        Some((job, report))
    }

    /// The same of a scene that is there, by a camera whose pixels are samples, so many along the side of one of the picture's.
    fn job_of(
        &self,
        scene: Arc<Scene>,
        (view, parts): (View, u32),
        (options, look): (&SurfaceOptions, Look),
        passes: Passes,
    ) -> AdapterSurface {
        let reference = 0.5 * (self.extremes[0] + self.extremes[1]);
        let SurfaceOptions { technique, point, holes, walls, .. } = *options;
        let form = options.form.clone().filter(|_| look.attribute == Attribute::Residual);
        let tiles = self.nodes.photo().filter(|_| look.attribute == Attribute::Photo);
        let photo = tiles.and_then(|tiles| PhotoCut::new(tiles, &scene, &view));
        AdapterSurface { scene, view, parts, look, form, photo, technique, point, holes, walls, reference, passes }
    }
}

/// Whether there is something in a flat picture that an adapter does not draw in frames of its own: ambient occlusion and shadows, which the
/// processor finds in what has been drawn, and pyramids of means.
pub(super) fn is_beyond_frames(options: &SurfaceOptions) -> bool {
    options.shadowing.is_some() || options.coarse == Coarse::Means
}

/// Whether heights are written along lines.
pub(super) fn has_labels(options: &SurfaceOptions) -> bool {
    options.look.as_ref().and_then(|look| look.contours?.labels).is_some()
}

/// Who looks at what an adapter has drawn, sample by sample, and what the samples show by their numbers.
fn found(job: &AdapterSurface, numbers: &[u32]) -> Result<(Sight, Visibility), VolumeError> {
    let seen = Visibility::of_numbers([job.view.width, job.view.height], numbers, &job.scene);
    let missing = || VolumeError::Device("the adapter does not tell what is seen of surfaces".into());
    Ok((Sight::Flat(job.view), seen.ok_or_else(missing)?))
}

impl Painter {
    /// The passes that draw for somebody who asks for `backend`; `None` where the processor does.
    fn passes(&mut self, backend: Option<Backend>) -> Option<Passes> {
        match backend {
            Some(Backend::Compute) => Some(Passes::Compute),
            Some(Backend::Raster) => Some(Passes::Raster),
            Some(Backend::Cpu) => None,
            None => Some(Passes::Best).filter(|_| self.adapter.as_mut().is_some_and(|adapter| adapter.is_card())),
        }
    }

    /// Whether an adapter draws flat pictures for somebody who asks for `backend`.
    pub(super) fn is_by_adapter(&mut self, backend: Option<Backend>) -> bool {
        self.adapter.is_some() && self.passes(backend).is_some()
    }

    /// Draws a picture for somebody who asks for `backend`.
    ///
    /// # Errors
    /// Where an adapter is asked for and there is none, or it fails.
    pub(super) fn draw(
        &mut self,
        field: &Field<'_>,
        sight: &Sight,
        options: &SurfaceOptions,
        backend: Option<Backend>,
        reporter: &dyn Reporter,
    ) -> Result<(SurfacePicture, DrawnBy), VolumeError> {
        field.nodes.prepare(field.placed, sight, options);
        if let Some(passes) = self.passes(backend) {
            if backend.is_some() && self.adapter.is_none() {
                return Err(VolumeError::Device(WITHOUT_ADAPTER.into()));
            }
            let left = match sight {
                Sight::Around { .. } => Some("pictures of all directions"),
                Sight::Flat(_) => (options.coarse == Coarse::Means).then_some("pyramids of means"),
            };
            if let Some(what) = left {
                if backend.is_some() {
                    self.tell(format!("--backend: the processor draws {what} of heights"), reporter);
                }
            } else {
                if options.technique == Technique::Rays && passes == Passes::Raster {
                    self.tell("--backend: raster draws heights as triangles in place of rays".into(), reporter);
                }
                match self.draw_on_adapter(field, sight, options, passes, reporter) {
                    Ok(Some(drawn)) => return Ok(drawn),
                    Ok(None) => {}
                    Err(VolumeError::Device(error)) if backend.is_none() => {
                        self.tell(format!("{error}; drawing with the CPU instead"), reporter);
                        self.adapter = None;
                    }
                    Err(error) => return Err(error),
                }
            }
        }
        let picture = draw_lettered(field.nodes, field.placed, sight, options, Some(&ProgramFont));
        Ok((picture, DrawnBy::default()))
    }

    /// What each sample of a flat view, whose pixels are these samples, shows of a scene, where an adapter finds it for somebody who asks for
    /// `backend`; `None` where the processor is to, which casts rays.
    pub(in crate::picture) fn seen(
        &mut self,
        field: &Field<'_>,
        (scene, sight): (&Arc<Scene>, &Sight),
        options: &SurfaceOptions,
        backend: Option<Backend>,
        reporter: &dyn Reporter,
    ) -> Option<Visibility> {
        let passes = self.passes(backend).filter(|_| options.technique != Technique::Rays)?;
        let (Sight::Flat(view), Some(look)) = (sight, options.look.clone()) else { return None };
        // What is nearest does not depend on what colours it.
        let look = Look { attribute: Attribute::Height, ..look };
        let adapter = self.adapter.as_mut()?;
        let job = Arc::new(field.job_of(Arc::clone(scene), (*view, parts(options.samples)), (options, look), passes));
        let drawn = adapter.surface_seen(Arc::clone(&job), false);
        match drawn.and_then(|(_, numbers)| found(&job, &numbers)) {
            Ok((_, seen)) => Some(seen),
            Err(error) => {
                self.tell(format!("{error}; drawing with the CPU instead"), reporter);
                self.adapter = None;
                None
            }
        }
    }

    fn draw_on_adapter(
        &mut self,
        field: &Field<'_>,
        sight: &Sight,
        options: &SurfaceOptions,
        passes: Passes,
        reporter: &dyn Reporter,
    ) -> Result<Option<(SurfacePicture, DrawnBy)>, VolumeError> {
        let (Some(adapter), Some((job, mut report))) = (self.adapter.as_mut(), field.job(sight, options, passes))
        else {
            return Ok(None);
        };
        let (job, has_labels) = (Arc::new(job), has_labels(options));
        let (frame, numbers) = match has_labels {
            true => adapter.surface_seen(Arc::clone(&job), true)?,
            false => (adapter.surface(Arc::clone(&job))?, Vec::new()),
        };
        let AdapterValues::Light(colors, _) = frame.values else {
            return Err(VolumeError::Device("the adapter does not draw surfaces".into()));
        };
        let alpha = || colors.rgba.iter().map(|color| f64::from(color[3])).sum::<f64>();
        report.covered = frame.covered.unwrap_or_else(alpha);
        let names = [frame.backend.to_owned(), frame.adapter];
        let (mut milliseconds, mut notes) = (frame.milliseconds, vec![frame.note]);
        let mut picture = SurfacePicture { colors, report, ..SurfacePicture::default() };
        darken(&mut picture.colors, &[], (field.nodes, field.placed, sight), options);
        if has_labels {
            let (sight, seen) = found(&job, &numbers)?;
            let seen = (&*job.scene, &sight, &seen);
            lettering::write(&mut picture, (field.nodes, field.placed), seen, options, &ProgramFont);
        }
        if options.raw
            && let Some((job, report)) = field.channels_job(sight, options, passes)
        {
            let job = Arc::new(job);
            let (frame, numbers) = adapter.surface_seen(Arc::clone(&job), false)?;
            let (sight, seen) = found(&job, &numbers)?;
            picture.add_channels(channels(&job.scene, &sight, &seen), report);
            for (pass, time) in frame.milliseconds {
                *milliseconds.entry(pass).or_default() += time;
            }
            notes.push(frame.note);
        }
        notes.into_iter().flatten().for_each(|note| self.tell(note, reporter));
        Ok(Some((picture, DrawnBy { names, milliseconds })))
    }

    /// Tells something once.
    fn tell(&mut self, message: String, reporter: &dyn Reporter) {
        if !self.told.contains(&message) {
            reporter.tell(message.clone());
            self.told.push(message);
        }
    }
}
